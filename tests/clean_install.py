"""Install the wheel and the source distribution, each into an empty environment, and use them there.

Usage: clean_install.py [--wheel-only] [--tests] DIRECTORY

DIRECTORY holds exactly one wheel and, without `--wheel-only`, one source distribution. With `--tests` the Python tests
run in each environment, after the extras that they need were added. Sizes are bounded, since a user downloads them.
"""

import os
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

WHEEL_BYTES = 6_000_000
"""Largest wheel."""
ENVIRONMENT_BYTES = 120_000_000
"""Most that the package and numpy may take in an environment, without pip."""
ROOT = Path(__file__).resolve().parents[1]

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


def installed_bytes(place: Path) -> int:
    """What the package and what it needs take on the disk."""
    packages = next(place.glob("[lL]ib/**/site-packages"))
    own = [
        d
        for d in packages.iterdir()
        if not d.name.startswith(("pip", "setuptools", "_distutils", "distutils"))
    ]
    return sum(f.stat().st_size for d in own for f in (d.rglob("*") if d.is_dir() else [d]) if f.is_file())


def main(directory: Path, wheel_only: bool, tests: bool) -> None:
    """Check each archive."""
    for pattern in ("*.whl",) if wheel_only else ("*.whl", "*.tar.gz"):
        (archive,) = directory.glob(pattern)
        if pattern == "*.whl":
            assert "-cp311-abi3-" in archive.name, f"{archive.name} is not an abi3 wheel for Python 3.11"
            size = archive.stat().st_size
            assert size <= WHEEL_BYTES, f"{archive.name} has {size} bytes, at most {WHEEL_BYTES} are allowed"
        with tempfile.TemporaryDirectory() as place:
            venv.create(place, with_pip=True)
            folder, name = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")
            python = Path(place) / folder / name
            environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "PYO3_PYTHON"}}
            install = [python, "-m", "pip", "install", "--quiet", archive.resolve()]
            subprocess.run(install, check=True, env=environment, cwd=place)
            subprocess.run([python, "-I", "-c", CHECK], check=True, env=environment, cwd=place)
            size = installed_bytes(Path(place))
            assert size <= ENVIRONMENT_BYTES, (
                f"{size} bytes are installed, at most {ENVIRONMENT_BYTES} are allowed"
            )
            print(
                f"{archive.name}: {archive.stat().st_size / 1e6:.1f} MB, "
                f"installs and works with numpy alone, {size / 1e6:.0f} MB in all",
                flush=True,
            )
            if tests:
                run_tests(python, environment)


def run_tests(python: Path, environment: dict[str, str]) -> None:
    """The Python tests against the package that is installed, never against the sources."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    needed = [r for extra in ("cli", "dev") for r in extras[extra]]
    subprocess.run([python, "-m", "pip", "install", "--quiet", *needed], check=True, env=environment)
    where = [python, "-I", "-c", "import redundancy; print(redundancy.__file__)"]
    found = subprocess.run(where, check=True, env=environment, capture_output=True, text=True).stdout.strip()
    assert "site-packages" in found, f"the tests would use {found}"
    subprocess.run([python, "-P", "-m", "pytest", "-q"], check=True, env=environment, cwd=ROOT)


if __name__ == "__main__":
    options = [a for a in sys.argv[1:] if a.startswith("--")]
    main(Path(sys.argv[-1]), "--wheel-only" in options, "--tests" in options)
