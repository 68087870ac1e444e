"""docs/cli.md describes every command and every option of `redundancy --help`, and no others."""

import re
from pathlib import Path

import pytest
import typer

from redundancy import _commands

PAGE = Path(__file__).resolve().parents[2] / "docs/cli.md"
COMMANDS = typer.main.get_command(_commands.app).commands


def _section(command: str) -> str:
    found = re.search(rf"^## `redundancy {command}`\n(.*?)(?=^## |\Z)", PAGE.read_text(), re.S | re.M)
    assert found is not None, f"docs/cli.md has no section '## `redundancy {command}`'"
    return found[1]


def test_every_section_is_a_command() -> None:
    assert set(re.findall(r"^## `redundancy ([\w-]+)`$", PAGE.read_text(), re.M)) == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_the_help_is_described(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    rows = re.findall(r"^\| (`--.*?) \|", _section(command), re.M)
    described = {option for row in rows for option in re.findall(r"--[a-z][a-z0-9-]*", row)}
    options = [set(p.opts + p.secondary_opts) for p in COMMANDS[command].params if p.opts[0].startswith("--")]
    options = [names for names in options if "--help" not in names]
    left_out = [sorted(names) for names in options if not names & described]
    assert not left_out, f"docs/cli.md, `redundancy {command}`, has no row for {left_out}"
    unknown = described - set().union(*options)
    assert not unknown, f"docs/cli.md describes {sorted(unknown)}, which `redundancy {command}` does not have"
    assert _commands.run([command, "--help"]) == 0
    shown = capsys.readouterr().out
    assert all(any(name in shown for name in names) for names in options)
