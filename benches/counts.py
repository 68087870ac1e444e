"""Instruction counts of the kernels of `counts.rs` under callgrind, beside the numbers stored in the repository.

Usage: counts.py [--store] [--against FILE] [--binary FILE] [KERNEL ...]

A count does not depend on the load of the machine: a change of 3 % is seen where times vary by 30 %. It does depend
on the compiler and, through the C library's choice of routines, on the processor; the stored file names both. Standard
library only. Needs `valgrind`; exits with 1 when a kernel takes more than LIMIT times what was stored, with 2 without
valgrind.
"""

import argparse
import json
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STORED = ROOT / "benches" / "counts.json"
LIMIT = 1.03
"""Largest ratio that is no finding."""
AT_A_TIME = 2


def build() -> Path:
    """Builds the kernels in the profile of a release and returns the program."""
    command = ["cargo", "bench", "--locked", "--no-run", "--bench", "counts", "--message-format", "json"]
    found = subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    lines = (json.loads(line) for line in found.stdout.splitlines())
    programs = (line["executable"] for line in lines if line.get("target", {}).get("name") == "counts")
    return Path(next(program for program in programs if program))


def kernels(program: Path) -> dict[str, int]:
    """Names of the kernels and the calls in one round of each."""
    text = subprocess.run([program, "list"], check=True, stdout=subprocess.PIPE, text=True).stdout
    return {name: int(calls) for name, calls in (line.split() for line in text.splitlines())}


def count(program: Path, kernel: str, calls: int) -> int:
    """Instructions per call."""
    with tempfile.TemporaryDirectory() as place:
        options = [f"--callgrind-out-file={place}/out", "--toggle-collect=*counts::counted*"]
        command = ["valgrind", "--tool=callgrind", *options, str(program), kernel]
        run = subprocess.run(command, check=False, capture_output=True, text=True)
        if run.returncode:
            raise SystemExit(f"{kernel} failed under callgrind:\n{run.stderr}")
        totals = re.findall(r"^(?:summary|totals): (\d+)", Path(place, "out").read_text(), re.MULTILINE)
    instructions = max(map(int, totals), default=0)
    if not instructions:
        raise SystemExit(f"{kernel}: callgrind saw no call of counts::counted")
    return round(instructions / calls)


def machine() -> dict[str, str]:
    """What a count depends on beside the code."""
    rustc = subprocess.run(["rustc", "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout
    information = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    processor = re.search(r"model name\s*: (.*)", information)
    return {
        "compiler": " ".join(rustc.split()[:2]),
        "processor": processor.group(1) if processor else platform.machine(),
        "libc": " ".join(platform.libc_ver()),
    }


def commit() -> str:
    """The commit of the working tree, with a + when there is more than that in it."""
    describe = ["git", "describe", "--always", "--dirty=+", "--abbrev=7", "--exclude=*"]
    found = subprocess.run(describe, check=False, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    return found.stdout.strip() or "unknown"


def table(new: dict[str, int], old: dict[str, int], name: str) -> list[str]:
    """Prints both counts and their ratio; returns the kernels above LIMIT."""
    width = max(map(len, new))
    print(f"{'instructions per call':{width}}  {name:>13}  {'now':>13}   ratio")
    worse = []
    for kernel, now in new.items():
        before = old.get(kernel)
        if before is None:
            print(f"{kernel:{width}}  {'-':>13}  {now:>13,}")
            continue
        ratio = now / before
        mark = ""
        if ratio > LIMIT:
            mark = "  more"
            worse.append(kernel)
        elif ratio < 1 / LIMIT:
            mark = "  less"
        print(f"{kernel:{width}}  {before:>13,}  {now:>13,}  {ratio:6.3f}{mark}")
    for kernel in old.keys() - new.keys():
        print(f"{kernel:{width}}  {old[kernel]:>13,}  is gone")
    return worse


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--store", action="store_true", help="store the counts instead of comparing them")
    parser.add_argument("--against", type=Path, default=STORED, help="stored counts (default: %(default)s)")
    parser.add_argument("--binary", type=Path, help="a program built before, instead of building one")
    parser.add_argument("kernels", nargs="*", help="kernels to count (default: all)")
    options = parser.parse_args()
    if shutil.which("valgrind") is None:
        print("counts.py needs valgrind (Debian: apt-get install valgrind)", file=sys.stderr)
        raise SystemExit(2)
    program = (options.binary or build()).resolve()
    known = kernels(program)
    if unknown := set(options.kernels) - known.keys():
        raise SystemExit(f"unknown kernel {', '.join(unknown)}; there are {', '.join(known)}")
    chosen = {name: calls for name, calls in known.items() if not options.kernels or name in options.kernels}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        counts = pool.map(lambda item: count(program, *item), chosen.items())
        new = dict(zip(chosen, counts, strict=True))
    stored = json.loads(options.against.read_text()) if options.against.exists() else {}
    here = machine()
    if options.store:
        kept = {name: n for name, n in stored.get("kernels", {}).items() if name in known} | new
        document = {
            "commit": commit(),
            **here,
            "kernels": {name: kept[name] for name in known if name in kept},
        }
        options.against.write_text(json.dumps(document, indent=1) + "\n")
        print(f"{len(new)} kernels stored in {options.against}")
        return
    for what, value in here.items():
        if stored and stored.get(what) != value:
            print(f"note: stored with {what} {stored.get(what)}, here it is {value}")
    if worse := table(new, stored.get("kernels", {}), stored.get("commit", "stored")):
        raise SystemExit(f"more than {LIMIT:.0%} of what was stored: {', '.join(worse)}")


if __name__ == "__main__":
    main()
