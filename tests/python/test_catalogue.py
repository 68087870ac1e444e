"""The catalogue against its sources, read a second time by another program (tests/golden/PROVENANCE.md)."""

import json
from pathlib import Path

import numpy as np
import pytest

import redundancy as rd

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "catalog.json").read_text())

FORMS = {
    "fr3": "panda_class",
    "panda": "panda_class",
    "xarm7": "panda_class",
    "iiwa14": "srs",
    "pa10": "srs",
    "openarm": "srs",
    "rby1": "srs",
    "irb2400": "spherical_wrist",
    "kr6_r900": "spherical_wrist",
    "puma560": "spherical_wrist",
    "ur3e": "parallel_axes",
    "ur5e": "parallel_axes",
    "ur10e": "parallel_axes",
    "ur16e": "parallel_axes",
    "ur20": "parallel_axes",
    "ur30": "parallel_axes",
}


@pytest.mark.parametrize("name", sorted(GOLDEN))
def test_numbers_are_those_of_the_source(name: str) -> None:
    chain, golden = rd.catalog.load(name), GOLDEN[name]
    for row in golden["poses"]:
        np.testing.assert_allclose(chain.forward(row["q"]).ravel(), row["pose"], atol=1e-12)
    for found, key, none in (
        (chain.lower, "lower", -np.inf),
        (chain.upper, "upper", np.inf),
        (chain.velocity_limit, "velocity", np.inf),
        (chain.effort_limit, "effort", np.inf),
    ):
        np.testing.assert_allclose(found, [none if x is None else x for x in golden[key]], rtol=1e-12)


def test_every_arm_has_the_closed_form_of_its_class() -> None:
    for name in rd.catalog.names():
        form = rd.closed_form(rd.catalog.load(name))
        assert (form.name if form else None) == FORMS.get(name), name
        assert form is None or max(form.defect) < 1e-7, (name, form.defect)
