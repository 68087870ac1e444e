"""The public benchmark: the page is that of the stored results, every row has its counterpart, losses are shown."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COMPARE = ROOT / "benches/compare"
RESULTS = json.loads((COMPARE / "results.json").read_text())


@pytest.fixture(scope="module")
def run():
    spec = importlib.util.spec_from_file_location("compare_run", COMPARE / "run.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_written_from_the_stored_results(run):
    assert (ROOT / "docs/benchmark.md").read_text() == run.page(RESULTS)


def test_every_neighbour_has_an_environment_a_note_and_rows_or_a_reason():
    names = {file.stem for file in (COMPARE / "environments").glob("*.txt")}
    assert names == set(json.loads((COMPARE / "neighbours.json").read_text())) == set(RESULTS["neighbours"])
    for name, found in RESULTS["neighbours"].items():
        assert bool(found["rows"]) != bool(found.get("failed")), name
        for row in found["rows"]:
            assert row["median_us"] <= row["p90_us"] <= row["p99_us"] and 0.0 <= row["success"] <= 1.0
            beside = [r for r in found["rows"] if (r["job"], r["arm"]) == (row["job"], row["arm"])]
            assert sum(r["solver"] == "theirs" for r in beside) == 1
            assert any(r["solver"].startswith("ours") for r in beside)


def test_rows_in_which_a_neighbour_wins_are_shown(run):
    row = {
        "job": "j",
        "arm": "a",
        "median_us": 1.0,
        "p90_us": 2.0,
        "p99_us": 3.0,
        "success": 0.5,
        "violations": {"none": 3},
    }
    rows = [
        row | {"solver": "theirs"},
        row | {"solver": "ours", "median_us": 10.0, "p90_us": 10.0, "p99_us": 10.0},
    ]
    neighbours = {
        "pink": {"version": "1", "rows": rows},
        "drake": {"rows": [], "failed": "does not install: x"},
    }
    text = run.page({"neighbours": neighbours, "seed": 0, "machine": RESULTS["machine"]})
    assert "| j | a | **ours** | 50.0 % | 10 us | 10 us | 10 us | 0.1 | 3 none |" in text
    assert "*no rows: does not install: x*" in text
