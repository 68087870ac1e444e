"""Kinds of optima, critical points over a pose, and where they break [Park1996]."""

import pickle

import numpy as np
import pytest

import redundancy as rd

# Table 2 of the paper: degrees, H, A, kind. The last digit of P3's q3 is misprinted by a tenth more than rounding.
TABLE_2 = [
    ((-87.1742, 111.7847, 77.5352), 75.0395, -4860.58, "maximum"),
    ((-83.4304, 179.8777, -82.0847), 61.0392, -3428.24, "maximum"),
    ((-8.8531, 112.6675, 155.6028), 20.5785, -897.94, "maximum"),
    ((-21.6863, 94.1577, 147.1470), 18.7790, 1373.58, "minimum"),
    ((12.3080, 150.8068, 153.8209), 13.9617, 1024.89, "minimum"),
    ((-126.9744, 161.2385, -4.6209), 27.0532, 2251.39, "minimum"),
]


@pytest.fixture(scope="module")
def planar() -> tuple[rd.Chain, rd.Manipulability]:
    arm = rd.catalog.load("planar3r")
    return arm, rd.Manipulability(arm, task="planar")


def test_table_2(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    points = rd.constrained_optima(arm, (2.0, 0.0), h, task="planar")
    assert len(points) == 12
    for degrees, value, a, kind in TABLE_2:
        near = [p for p in points if np.abs(np.degrees(p.q) - degrees).max() <= 0.54e-4]
        assert len(near) == 1
        assert str(near[0].kind) == kind
        assert near[0].value == pytest.approx(value, abs=0.501e-4)
        paper = rd.cofactor_condition(arm, near[0].q, h, task="planar")
        assert paper.condition == pytest.approx(a, abs=0.501e-2)
        assert near[0].eigenvalues[0] * near[0].value == pytest.approx(paper.condition, rel=1e-8)
        at = rd.classify(arm, np.radians(degrees), h, task="planar")
        assert str(at.kind) == kind
        assert at.sigma_min == pytest.approx(np.linalg.svd(arm.jacobian(np.radians(degrees))[:2])[1].min())


def test_kinematic_singularities_are_no_critical_points(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    for q2 in (0.0, np.pi):
        for q3 in (0.0, np.pi):
            at = rd.classify(arm, [0.3, q2, q3], h, task="planar")
            assert at.kind == rd.Kind.KINEMATIC_SINGULARITY
            assert at.sigma_min < 1e-12
    # (2.5, 0) has the arm with q = (0, 0, pi) + ... on its self-motion.
    q = np.array([0.3, 0.0, np.pi])
    tip = arm.forward(q)[:2, 3]
    for p in rd.constrained_optima(arm, tip, h, task="planar"):
        assert p.kind in ("maximum", "minimum", "degenerate")


def test_the_saddle_of_the_4r_arm() -> None:
    arm = rd.catalog.load("planar4r")
    h = rd.Manipulability(arm, task="planar")
    q = [1.4523200054, -2.2285317342, -0.2952995971, 1.4314560205]
    at = rd.classify(arm, q, h, task="planar")
    assert at.kind == "saddle"
    assert h.value(q) == pytest.approx(269.0886314, abs=1e-6)
    np.testing.assert_allclose(at.eigenvalues, [-112.95383219, 54.23547925], atol=1e-6)
    np.testing.assert_allclose(at.multipliers, [80.40134486, 0], atol=1e-6)
    found = rd.constrained_optima(arm, (4.5, 0.0), h, task="planar", starts=400)
    assert any(np.abs(p.q - q).max() < 1e-8 and p.kind == "saddle" for p in found)


def test_batches_and_words(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    many = rd.classify(arm, np.radians([row[0] for row in TABLE_2]), h, task=rd.Task("planar"))
    assert [str(x.kind) for x in many] == [row[3] for row in TABLE_2]
    assert rd.classify(arm, np.zeros((0, 3)), h, task="planar") == []
    for thing in (many[0], rd.cofactor_condition(arm, [1.0, 1, 1], h, task="planar")):
        assert repr(pickle.loads(pickle.dumps(thing))) == repr(thing)
    point = rd.constrained_optima(arm, (2.0, 0.0), h, task="planar")[0]
    assert repr(pickle.loads(pickle.dumps(point))) == repr(point)


def test_wrong_input_is_refused(planar: tuple[rd.Chain, rd.Manipulability]) -> None:
    arm, h = planar
    with pytest.raises(rd.RedundancyError, match="expected"):
        rd.classify(arm, [1.0, 2.0], h, task="planar")
    with pytest.raises(rd.RedundancyError, match="finite"):
        rd.classify(arm, [1.0, 2.0, np.nan], h, task="planar")
    with pytest.raises(rd.RedundancyError, match="no spare freedom"):
        rd.classify(arm, [1.0, 2.0, 3.0], h, task="planar_pose")
    with pytest.raises(rd.RedundancyError, match="joints of the criterion"):
        rd.classify(arm, [1.0, 2.0, 3.0], rd.JointRange(rd.catalog.load("pa10")), task="planar")
    with pytest.raises(rd.RedundancyError, match="step"):
        rd.constrained_optima(arm, (2.0, 0.0), h, task="planar", step=-1.0)
    with pytest.raises(rd.RedundancyError, match="finite"):
        rd.constrained_optima(arm, (np.nan, 0.0), h, task="planar")
