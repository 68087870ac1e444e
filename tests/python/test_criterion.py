"""Criteria: values, derivatives, sums and pickles."""

import pickle

import numpy as np
import pytest

import redundancy as rd

TASKS = ["pose", "pose_rpy", "position", "pointing", "planar", "planar_pose"]


def test_manipulability_is_the_determinant_of_numpy() -> None:
    chain = rd.catalog.load("iiwa14")
    rows = {"pose": [0, 1, 2, 3, 4, 5], "position": [0, 1, 2], "planar": [0, 1], "planar_pose": [0, 1, 5]}
    q = np.random.default_rng(1).uniform(chain.lower, chain.upper, (20, 7))
    for task, which in rows.items():
        h = rd.Manipulability(chain, task=task)
        jacobians = np.stack([chain.jacobian(row)[which] for row in q])
        expected = np.linalg.det(jacobians @ jacobians.swapaxes(1, 2))
        np.testing.assert_allclose(h.value(q), expected, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(
            rd.Manipulability(chain, task, "sqrt").value(q), np.sqrt(expected), rtol=1e-9
        )


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("measure", ["det", "sqrt"])
def test_manipulability_against_differences(task: str, measure: str) -> None:
    chain = rd.catalog.load("iiwa14")
    h = rd.Manipulability(chain, task=task, measure=measure)
    q = np.array([0.3, 0.7, -0.4, -1.2, 0.5, 0.8, 0.1])
    steps = 1e-5 * np.eye(7)
    expected = (h.value(q + steps) - h.value(q - steps)) / 2e-5
    np.testing.assert_allclose(h.gradient(q), expected, atol=1e-8 * (1 + np.abs(expected).max()))
    expected = (h.gradient(q + steps) - h.gradient(q - steps)) / 2e-5
    np.testing.assert_allclose(h.hessian(q), expected, atol=1e-8 * (1 + np.abs(expected).max()))


def test_manipulability_adds_up_and_pickles() -> None:
    chain = rd.catalog.load("iiwa14")
    h = rd.Manipulability(chain, task=rd.Task.pointing((1, 0, 0)), measure="sqrt")
    q = np.full(7, 0.4)
    total = 0.5 * h + -rd.JointRange(chain)
    assert total.sense == "maximize"
    assert total.value(q) == pytest.approx(0.5 * h.value(q) - rd.JointRange(chain).value(q), rel=1e-14)
    for criterion in (h, total):
        again = pickle.loads(pickle.dumps(criterion))
        assert repr(again) == repr(criterion)
        np.testing.assert_array_equal(again.gradient(q), criterion.gradient(q))


def test_manipulability_names_what_is_wrong() -> None:
    chain = rd.catalog.load("iiwa14")
    with pytest.raises(rd.RedundancyError, match="det, sqrt"):
        rd.Manipulability(chain, measure="root")
    with pytest.raises(rd.RedundancyError, match="planar_pose"):
        rd.Manipulability(chain, task="plane")
    with pytest.raises(rd.RedundancyError, match="minimize"):
        rd.Manipulability(chain) + rd.JointRange(chain)
