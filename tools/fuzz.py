"""Run the fuzz targets one after the other, built by cargo-fuzz with coverage, and count what was executed.

Resumable: counts and the inputs that reached something new are kept in fuzz/work. Rounds of --seconds each are repeated
until every target has its number of executions, or once where no number is given.

Usage: fuzz.py [--seconds S] [--readers N] [--numeric N] [TARGET ...]
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "fuzz/work"
BUILT = ROOT / "fuzz/target"
READERS = ("urdf", "srdf", "mesh", "path_csv", "scene_json", "trajectory_json", "dh")
"""Targets that read a file or a table; `--readers` is the number of executions of each."""
NUMERIC = ("srs", "panda_class", "parallel_axes", "spherical_wrist", "ik", "velocity")
"""Targets that compute from a pose or a velocity; `--numeric` is the number of executions of all together."""
LONGEST = {"reader": 4096, "numeric": 128}
"""Most bytes of an input; a numeric target reads fewer than 128."""


def build() -> None:
    """All targets, by a stable compiler: the variable lets it take the options of cargo-fuzz.

    The core has no unsafe code of its own, so no sanitizer is used; overflows and debug assertions are findings.
    """
    command = ["cargo", "fuzz", "build", "--sanitizer", "none", "--features", "libfuzzer"]
    environment = os.environ | {"RUSTC_BOOTSTRAP": "1", "CARGO_TARGET_DIR": str(BUILT)}
    subprocess.run(command, check=True, cwd=ROOT, env=environment)


def program(target: str) -> Path:
    """The program that cargo-fuzz has built; it is in a folder named by the platform."""
    found = [f for f in BUILT.glob(f"*/release/{target}") if f.is_file()]
    if len(found) != 1:
        sys.exit(f"expected one built program of '{target}' in {BUILT}, found {len(found)}")
    return found[0]


def run(target: str, seconds: float) -> tuple[int, int]:
    """Executions and exit status of a target."""
    grown, crashes = WORK / "corpus" / target, WORK / "crashes" / target
    for folder in (grown, crashes):
        folder.mkdir(parents=True, exist_ok=True)
    command = [
        str(program(target)),
        str(grown),
        str(ROOT / "fuzz/corpus" / target),
        f"-max_total_time={round(seconds)}",
        f"-max_len={LONGEST['reader' if target in READERS else 'numeric']}",
        f"-artifact_prefix={crashes}/",
        "-timeout=20",
        "-rss_limit_mb=4096",
        "-print_final_stats=1",
    ]
    done = subprocess.run(command, check=False, cwd=WORK, capture_output=True)
    text = done.stderr.decode(errors="replace")
    # The statistics are missing after a crash, the line of the last event is not.
    counted = re.findall(r"number_of_executed_units:\s*(\d+)", text) or re.findall(r"^#(\d+)", text, re.M)
    if done.returncode:
        print(text[-3000:])
    return (int(counted[-1]) if counted else 0), done.returncode


def missing(counts: dict[str, Any], targets: list[str], readers: int, numeric: int) -> list[str]:
    """The targets that still have executions to do."""
    done = {t: counts.get(t, {}).get("executions", 0) for t in (*READERS, *NUMERIC)}
    all_numeric = sum(done[t] for t in NUMERIC)
    return [t for t in targets if (done[t] < readers if t in READERS else all_numeric < numeric)]


def main() -> int:
    """Every target for its time; the exit status is 1 where one found something."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("targets", nargs="*", choices=[[], *READERS, *NUMERIC], help="all by default")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of a round")
    parser.add_argument("--readers", type=int, help="executions of each reader, over all runs")
    parser.add_argument("--numeric", type=int, help="executions of all numeric targets, over all runs")
    options = parser.parse_args()
    if shutil.which("cargo-fuzz") is None:
        sys.exit("cargo-fuzz is not installed, nothing was fuzzed: 'make tools' installs it")
    if shutil.which(os.environ.get("CXX", "c++")) is None:
        sys.exit("libFuzzer needs a C++ compiler, and none was found: install g++ or clang, or set CXX")
    WORK.mkdir(parents=True, exist_ok=True)
    build()
    file = WORK / "counts.json"
    counts: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
    targets = options.targets or [*READERS, *NUMERIC]
    counted = options.readers is not None or options.numeric is not None
    goals = (options.readers or 0, options.numeric or 0)
    found: set[str] = set()
    while todo := [t for t in (missing(counts, targets, *goals) if counted else targets) if t not in found]:
        for target in todo:
            begin = time.monotonic()
            executions, status = run(target, options.seconds)
            total = counts.setdefault(target, {"executions": 0, "seconds": 0.0, "findings": 0})
            total["executions"] += executions
            total["seconds"] += time.monotonic() - begin
            total["findings"] += status != 0
            file.write_text(json.dumps(counts, indent=1))
            verdict = f"a finding, see fuzz/work/crashes/{target}" if status else "nothing found"
            print(
                f"{target}: {executions:,} executions, {total['executions']:,} in {total['seconds'] / 3600:.2f} h "
                f"in all; {verdict}",
                flush=True,
            )
            if status:
                found.add(target)
        if not counted:
            break
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
