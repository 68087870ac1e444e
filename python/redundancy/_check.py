"""What `redundancy check` does: read, judge, print for people, programs or GitHub."""

import json
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import Any

import redundancy as rd

FORMATS = ("text", "json", "github")


@dataclass
class Job:
    """One run of `check`."""

    chain: rd.Chain
    robot: str
    trajectory_file: File
    path_file: File | None = None
    scene_file: File | None = None
    options: dict[str, Any] = field(default_factory=dict)

    def run(self) -> rd.CheckReport:
        """The report of the file."""
        path = None if self.path_file is None else rd.Path.from_csv(self.path_file)
        scene = None if self.scene_file is None else rd.Scene.from_json(self.scene_file)
        return rd.check(self.chain, self.trajectory_file, path, scene=scene, **self.options)

    def text(self, report: rd.CheckReport) -> str:
        """A line per finding, and how many there are."""
        lines = [f"{f.severity}: {f.kind}: row {f.row}: {f.message}" for f in report.findings]
        what = f"{self.trajectory_file}: {_count(len(report), 'row')}"
        if report.findings:
            found = f"{_count(report.errors, 'error')}, {_count(report.warnings, 'warning')}"
        else:
            found = "nothing found"
        return "\n".join([*lines, f"{what}, {found}"])

    def json(self, report: rd.CheckReport) -> str:
        """Everything as one JSON object."""
        document = {
            "trajectory": str(self.trajectory_file),
            "robot": self.chain.name,
            "robot_source": self.robot,
            "rows": len(report),
            "judged": report.judged,
            "ok": report.ok,
            "errors": report.errors,
            "warnings": report.warnings,
            "findings": [
                {
                    "kind": f.kind,
                    "severity": f.severity,
                    "row": f.row,
                    "rows": list(f.rows),
                    "t": f.t,
                    "joint": f.joint,
                    "link": f.link,
                    "value": f.value,
                    "bound": f.bound,
                    "message": f.message,
                }
                for f in report.findings
            ],
        }
        return json.dumps(document, indent=2, allow_nan=False)

    def github(self, report: rd.CheckReport) -> str:
        """Workflow commands of GitHub Actions: each finding is shown beside the file, in CSV at its line."""
        lines = []
        for f in report.findings:
            place = f"file={_property(str(self.trajectory_file))}"
            if self.trajectory_file.suffix.lower() == ".csv":
                place += f",line={f.row + 2}"
            lines.append(
                f"::{f.severity} {place},title={_property(f.kind)}::{_data(f'row {f.row}: {f.message}')}"
            )
        return "\n".join(lines)


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _data(text: str) -> str:
    """Escaped for the text of a workflow command."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """Escaped for a property of a workflow command."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
