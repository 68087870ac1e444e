"""Install the wheel and the source distribution, each into an empty environment, and use them there.

Usage: clean_install.py DIRECTORY, which holds exactly one wheel and one source distribution.
"""

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

# Runs inside the empty environment; must do without any extra.
CHECK = """
import importlib.metadata as metadata
import subprocess, sys

installed = {d.name.lower() for d in metadata.distributions()}
assert installed <= {"pip", "setuptools", "numpy", "redundancy"}, installed

import redundancy as rd

arm = rd.SrsArm(rd.catalog.load("pa10"))
path = rd.paths.circle((0.45, 0, 0.5), 0.1, n=50, orientation=[[-1, 0, 0], [0, 1, 0], [0, 0, -1]])
assert len(rd.plan_swivel(arm, path)) == 50
command = subprocess.run([sys.executable, "-m", "redundancy"], capture_output=True, text=True)
assert command.returncode == 2 and "redundancy[cli]" in command.stderr, command

assert rd.__version__ == metadata.version("redundancy")
assert "matplotlib" not in sys.modules and "typer" not in sys.modules
files = {str(f) for f in metadata.files("redundancy")}
for wanted in ("redundancy/py.typed", "redundancy/_core.pyi", "redundancy/data/kuka_iiwa.urdf"):
    assert wanted in files, wanted
for wanted in ("LICENSE-MIT", "LICENSE-APACHE"):
    assert any(f.endswith(wanted) for f in files), wanted
"""


def main(directory: Path) -> None:
    for pattern in ("*.whl", "*.tar.gz"):
        (archive,) = directory.glob(pattern)
        if pattern == "*.whl":
            assert "-cp311-abi3-" in archive.name, f"{archive.name} is not an abi3 wheel for Python 3.11"
        with tempfile.TemporaryDirectory() as place:
            venv.create(place, with_pip=True)
            python = Path(place) / "bin" / "python"
            environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "PYO3_PYTHON"}}
            install = [python, "-m", "pip", "install", "--quiet", archive.resolve()]
            subprocess.run(install, check=True, env=environment, cwd=place)
            subprocess.run([python, "-I", "-c", CHECK], check=True, env=environment, cwd=place)
            print(f"{archive.name}: installs and works with numpy alone", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
