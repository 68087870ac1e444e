"""Batches in child processes, also made while the parent runs one; each case in its own process with a watchdog."""

import multiprocessing
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("fork_batches.py")
AVAILABLE = multiprocessing.get_all_start_methods()
# With 'during' the parent has run batches before, too.
CASES = [("os.fork", "idle"), ("os.fork", "before"), ("os.fork", "during")] if "fork" in AVAILABLE else []
CASES += [(method, "during") for method in AVAILABLE]


@pytest.mark.parametrize(("method", "when"), CASES)
def test_batches_in_children(method: str, when: str) -> None:
    command = [sys.executable, SCRIPT, method, when]
    run = subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)
    assert (run.returncode, run.stdout) == (0, "ok\n"), run.stderr
