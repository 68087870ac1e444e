"""`make counts`: every kernel has a stored count, and the script counts where valgrind and a build are at hand."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUILT = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "debug" / "deps"


def kernels() -> list[str]:
    source = (ROOT / "benches" / "counts.rs").read_text()
    table = source[source.index("const KERNELS") : source.index("];")]
    return re.findall(r'\(\s*"(\w+/[a-z0-9_/]+)"', table)


def test_every_kernel_is_stored() -> None:
    file = ROOT / "benches" / "counts.json"
    if not file.exists():
        pytest.skip("no counts are stored: `make counts-store`")
    stored = json.loads(file.read_text())
    assert list(stored["kernels"]) == kernels(), "run `make counts-store`"
    assert all(isinstance(n, int) and n > 0 for n in stored["kernels"].values())
    assert stored["compiler"].startswith("rustc ")


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="needs valgrind")
def test_a_kernel_is_counted(tmp_path: Path) -> None:
    programs = sorted(BUILT.glob("counts-*[!d]"), key=lambda p: p.stat().st_mtime)
    programs = [p for p in programs if os.access(p, os.X_OK) and not p.suffix]
    if not programs:
        pytest.skip("`cargo test --benches` has not built the kernels")
    kernel, stored = "kinematics/forward/iiwa14", tmp_path / "counts.json"
    script = [sys.executable, ROOT / "benches" / "counts.py", "--binary", programs[-1], "--against", stored]

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*script, *options, kernel], capture_output=True, text=True, check=False)

    assert run("--store").returncode == 0
    count = json.loads(stored.read_text())["kernels"][kernel]
    assert 500 < count < 50_000
    again = run()
    assert (again.returncode, "1.000" in again.stdout) == (0, True), again.stdout
    stored.write_text(json.dumps({"kernels": {kernel: count // 2}}))
    twice = run()
    assert twice.returncode == 1
    assert "more" in twice.stdout
    assert kernel in twice.stderr
