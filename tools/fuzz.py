"""Fuzz targets one after the other with cargo-fuzz, and keep count. Resumable: what was found is kept in fuzz/work.

Usage: fuzz.py [--seconds S] TARGET ...
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "fuzz/work"


def run(target: str, seconds: int) -> tuple[int, int]:
    """Executions and exit status of a target."""
    grown = WORK / "corpus" / target
    crashes = WORK / "crashes" / target
    for folder in (grown, crashes):
        folder.mkdir(parents=True, exist_ok=True)
    command = [
        "cargo",
        "fuzz",
        "run",
        "--sanitizer",
        "none",
        target,
        str(grown),
        str(ROOT / "fuzz/corpus" / target),
    ]
    limits = [
        f"-max_total_time={seconds}",
        "-timeout=20",
        "-rss_limit_mb=4096",
        f"-artifact_prefix={crashes}/",
    ]
    command += ["--", *limits, "-print_final_stats=1"]
    done = subprocess.run(command, check=False, cwd=ROOT / "fuzz", capture_output=True, text=True)
    counted = re.search(r"number_of_executed_units:\s*(\d+)", done.stderr)
    if counted is None or done.returncode:
        print(done.stderr[-3000:])
    return (int(counted[1]) if counted else 0), done.returncode


def main() -> int:
    """Every target for its time; the exit status is 1 where one found something."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("targets", nargs="+")
    parser.add_argument("--seconds", type=int, default=60)
    options = parser.parse_args()
    if shutil.which("cargo-fuzz") is None:
        print("cargo-fuzz is not installed: make tools")
        return 2
    WORK.mkdir(parents=True, exist_ok=True)
    file = WORK / "counts.json"
    counts = json.loads(file.read_text()) if file.is_file() else {}
    worst = 0
    for target in options.targets:
        executions, status = run(target, options.seconds)
        before = counts.setdefault(target, {"executions": 0, "seconds": 0, "findings": 0})
        before["executions"] += executions
        before["seconds"] += options.seconds
        before["findings"] += status != 0
        file.write_text(json.dumps(counts, indent=1))
        verdict = f"a finding, see fuzz/work/crashes/{target}" if status else "nothing found"
        print(f"{target}: {executions:,} executions, {before['executions']:,} in all; {verdict}", flush=True)
        worst = max(worst, status != 0)
    return int(worst)


if __name__ == "__main__":
    sys.exit(main())
