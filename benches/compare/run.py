"""The public benchmark: one command, one seed, one environment for each neighbour, this library beside it in every row.

Usage: run.py --wheels FOLDER --environments FOLDER [--page FILE] [--seed N] [--poses N] [NEIGHBOUR ...]

For each file in `environments/` a virtual environment is made once, with the neighbour and the wheel of this library,
and `worker.py` runs there: both libraries take turns on the same inputs, in one process and one thread. The rows are
written to `results.json`, and from that the page of the documentation. A neighbour that cannot be installed or run is
a line that says why.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.json"


def environment(name: str, folder: Path, wheel: Path) -> Path:
    """The Python of the neighbour's environment, made if need be, with this wheel in it."""
    place = folder / name
    python = place / "bin/python"
    if not python.is_file():
        venv.create(place, with_pip=True)
    install = [python, "-m", "pip", "install", "--quiet", "--only-binary=:all:"]
    subprocess.run(
        [*install, "-r", HERE / f"environments/{name}.txt", "numpy"], check=True, capture_output=True
    )
    subprocess.run([*install, "--no-deps", "--force-reinstall", wheel], check=True, capture_output=True)
    return python


def measured(name: str, options: argparse.Namespace, wheel: Path) -> dict[str, Any]:
    """The rows of a neighbour, or why there are none."""
    try:
        python = environment(name, options.environments, wheel)
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or b"").decode().strip().splitlines() or ["pip failed"]
        return {"rows": [], "failed": f"does not install: {lines[-1]}"}
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}
    variables = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | one
    command = [python, HERE / "worker.py", name, "--seed", str(options.seed), "--poses", str(options.poses)]
    try:
        run = subprocess.run(command, check=True, capture_output=True, text=True, env=variables, timeout=1800)
    except subprocess.TimeoutExpired:
        return {"rows": [], "failed": "took more than half an hour"}
    except subprocess.CalledProcessError as error:
        return {"rows": [], "failed": "does not run: " + (error.stderr.strip().splitlines() or ["?"])[-1]}
    found: dict[str, Any] = json.loads(run.stdout.strip().splitlines()[-1])
    if not found["rows"]:
        found["failed"] = "installs; no comparison has been written yet"
    return found


def time_text(us: float) -> str:
    """A time with three digits."""
    return f"{us:.3g} us" if us < 1e3 else f"{us / 1e3:.3g} ms" if us < 1e6 else f"{us / 1e6:.3g} s"


def remark(row: dict[str, Any]) -> str:
    """What was violated, and the quality of the answers where the job has one."""
    parts = [f"{count} {kind.replace('_', ' ')}" for kind, count in row["violations"].items() if count]
    if "median_duration_s" in row:
        parts.append(f"median duration {row['median_duration_s']:.4f} s")
    if "largest_excess" in row and row["largest_excess"] > 0:
        parts.append(f"up to {100 * row['largest_excess']:.1f} % over a limit")
    if "median_error" in row:
        parts.append(f"median error {row['median_error']:.0e}")
    return ", ".join(parts)


def page(results: dict[str, Any]) -> str:
    """The page of the documentation."""
    notes = json.loads((HERE / "neighbours.json").read_text())
    machine = results["machine"]
    lines = [
        "# Benchmark",
        "",
        "<!-- Written by benches/compare/run.py: change that, not this. -->",
        "Written by `make compare`. Each neighbour has a virtual environment of its own, with the wheel of this",
        "library beside it. Both take turns on the same inputs in one process and on one thread, seed "
        f"{results['seed']}. Times are those of",
        "single calls from Python. *Ratio* is the median time of the neighbour over ours: below 1 the neighbour is",
        "faster.",
        "",
        f"Machine: {machine['cores']} cores, {machine['system']}, Python {machine['python']}, load average "
        f"{machine['load']}; where the",
        "load is above the number of cores, the 99th percentiles say more about the machine than about the libraries.",
        "",
        "```python",
        "import numpy as np",
        "from matplotlib.figure import Figure",
        "",
    ]
    bars = []
    table = [
        "| job | arm | solver | success | median | p90 | p99 | ratio | remarks |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, found in sorted(results["neighbours"].items()):
        for job, arm in dict.fromkeys((r["job"], r["arm"]) for r in found["rows"]):
            rows = [r for r in found["rows"] if (r["job"], r["arm"]) == (job, arm)]
            theirs = next(r for r in rows if r["solver"] == "theirs")
            for row in rows:
                own = row is not theirs
                ratio = theirs["median_us"] / row["median_us"]
                label = f"**{row['solver']}**" if own else f"{name} {found['version']}"
                times = [time_text(row[key]) for key in ("median_us", "p90_us", "p99_us")]
                cells = [
                    job,
                    arm,
                    label,
                    f"{100 * row['success']:.1f} %",
                    *times,
                    f"{ratio:.2g}" if own else "",
                    remark(row),
                ]
                table.append("| " + " | ".join(cells) + " |")
                if own:
                    bars.append((f"{name}: {job}, {arm} ({row['solver']})", round(ratio, 4)))
    lines += [f"RATIOS = {json.dumps(bars, indent=4)}", ""]
    lines += [
        "figure = Figure(figsize=(8, 0.28 * len(RATIOS) + 1), layout='constrained')".replace("'", '"'),
        "axes = figure.subplots()",
        "names, ratios = zip(*RATIOS, strict=True)",
        'colors = ["tab:blue" if r >= 1 else "tab:orange" for r in ratios]',
        "axes.barh(np.arange(len(names)), np.array(ratios) - 1, left=1, color=colors)",
        'axes.set(xscale="log", xlabel="time of the neighbour / ours (orange: the neighbour is faster)")',
        "axes.set_yticks(np.arange(len(names)), names, fontsize=7)",
        "axes.invert_yaxis()",
        'axes.axvline(1, color="black", lw=0.8)',
        "figure",
        "```",
        "",
        "## All rows",
        "*Success*: the answer is there, meets its pose within 2e-6 and is within the limits; for a velocity step, the",
        "error is below 1e-2; for kinematics and distances, both libraries agree.",
        "",
        *table,
        "",
        "## The neighbours",
        "| neighbour | settings | what it is better at |",
        "|---|---|---|",
    ]
    for name, found in sorted(results["neighbours"].items()):
        settings = notes[name]["tuned"] if found["rows"] else f"*no rows: {found['failed']}*"
        lines.append(f"| {name} | {settings} | {notes[name]['better']} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Measure, store, write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("neighbours", nargs="*", help="all by default; others keep their stored rows")
    parser.add_argument("--wheels", type=Path, required=True, help="folder with the wheel of this library")
    parser.add_argument("--environments", type=Path, required=True, help="folder of the environments")
    parser.add_argument("--page", type=Path, help="Markdown file to write")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--poses", type=int, default=500)
    options = parser.parse_args()
    (wheel,) = options.wheels.glob("*.whl")
    stored: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {"neighbours": {}}
    names = options.neighbours or sorted(file.stem for file in (HERE / "environments").glob("*.txt"))
    for name in names:
        found = measured(name, options, wheel.resolve())
        stored["neighbours"][name] = found
        print(f"{name}: {found.get('failed', str(len(found['rows'])) + ' rows')}", flush=True)
    stored["seed"] = options.seed
    load = f"{os.getloadavg()[1]:.1f}"
    version = platform.python_version()
    stored["machine"] = {
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": version,
        "load": load,
    }
    RESULTS.write_text(json.dumps(stored, indent=1) + "\n")
    if options.page:
        options.page.write_text(page(stored))
    return 0


if __name__ == "__main__":
    sys.exit(main())
