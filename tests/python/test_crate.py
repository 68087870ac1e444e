"""What `cargo package` would publish, the declared Rust version, and the listing of the public Rust API."""

import importlib.util
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def cargo(*arguments: str) -> str:
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not installed")
    command = ["cargo", *arguments, "--offline"]
    run = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def packages() -> list[dict]:
    return json.loads(cargo("metadata", "--format-version", "1", "--locked"))["packages"]


def test_the_package_is_complete():
    files = set(cargo("package", "--list", "-p", "redundancy-core", "--allow-dirty").split())
    wanted = {"LICENSE-MIT", "LICENSE-APACHE", "README.md", "Cargo.toml", "src/lib.rs", "katex-header.html"}
    wanted |= {f"examples/{file.name}" for file in (ROOT / "examples/rust").glob("*.rs")}
    assert wanted <= files, wanted - files
    for licence in ("LICENSE-MIT", "LICENSE-APACHE"):
        assert (ROOT / "crates/redundancy-core" / licence).read_text() == (ROOT / licence).read_text()


def version(text: str | None) -> tuple[int, ...]:
    return tuple([*(int(x) for x in (text or "0").split(".")), 0, 0][:3])


def test_the_declared_rust_version_suits_every_dependency(packages):
    own = next(version(p["rust_version"]) for p in packages if p["name"] == "redundancy-core")
    newer = {p["name"]: p["rust_version"] for p in packages if version(p["rust_version"]) > own}
    assert not newer, f"declared is {own}, newer are {newer}"
    assert own > (1, 0, 0)


def allowed(expression: str, licences: set[str]) -> bool:
    """Whether an SPDX expression of `OR` and `AND` can be met."""
    expression = expression.replace("/", " OR ")
    words = re.sub(r"[()]", lambda m: f" {m[0]} ", expression)
    words = re.sub(r" WITH ", "_WITH_", words)
    parts = {"OR": "or", "AND": "and", "(": "(", ")": ")"}
    known = {licence.replace(" WITH ", "_WITH_") for licence in licences}
    return bool(eval(" ".join(parts.get(word, str(word in known)) for word in words.split())))


def test_every_dependency_has_an_allowed_licence(packages):
    licences = set(tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"])
    assert allowed("MIT OR (GPL-3.0 AND Apache-2.0)", licences) and not allowed("MIT AND GPL-3.0", licences)
    refused = {p["name"]: p["license"] for p in packages if not allowed(p["license"] or "none", licences)}
    assert not refused, "cargo deny check licenses"


def test_every_dependency_is_from_the_registry(packages):
    sources = {p["source"] for p in packages}
    assert sources == {None, "registry+https://github.com/rust-lang/crates.io-index"}


def test_the_listing_of_the_api_reads_rustdoc(tmp_path):
    spec = importlib.util.spec_from_file_location("public_api", ROOT / "tools/public_api.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    folder = tmp_path / "some_crate/room"
    folder.mkdir(parents=True)
    (folder / "struct.Arm.html").write_text(
        '<pre class="rust item-decl"><code>pub struct Arm { <span>/* private */</span> }</code></pre>'
        '<h2 id="implementations">Implementations</h2><h3 class="code-header">impl <a>Arm</a></h3>'
        '<h4 class="code-header">pub fn <a>solve</a>(\n    &amp;self,\n    q: f64,\n) -&gt; f64</h4>'
        '<h2 id="trait-implementations">x</h2><h3 class="code-header">impl Clone for Arm</h3>'
    )
    assert module.listing(tmp_path / "some_crate") == [
        "some_crate::room::Arm: impl Arm",
        "some_crate::room::Arm: pub fn solve(&self, q: f64, ) -> f64",
        "some_crate::room::Arm: pub struct Arm { /* private */ }",
    ]


def test_the_stored_listing_names_what_the_readme_of_the_crate_uses():
    lines = (ROOT / "crates/redundancy-core/public-api.txt").read_text().splitlines()
    assert len(lines) > 500 and lines == sorted(set(lines))
    for name in (
        "solutions::closed_form::srs::SrsArm",
        "planning::plan",
        "ik::IkSolver",
        "path::Path",
        "chain::Chain",
    ):
        assert any(line.startswith(f"redundancy_core::{name}: ") for line in lines), name
