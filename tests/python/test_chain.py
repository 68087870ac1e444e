"""The chain as a Python object: properties, D-H rows, changes, pickling."""

import copy
import pickle
import threading

import numpy as np
import pytest

import redundancy as rd

NAMES = rd.catalog.names()


def test_catalogue() -> None:
    assert sorted(NAMES) == NAMES and len(NAMES) == 23
    for name in NAMES:
        assert rd.catalog.load(name).name == name
    with pytest.raises(rd.RedundancyError, match="unknown robot 'kr6', expected one of: dexter, fr3"):
        rd.catalog.load("kr6")


def test_properties() -> None:
    arm = rd.catalog.load("pa10")
    assert arm.dof == 7
    assert arm.joint_names == ["S1", "S2", "S3", "E1", "E2", "W1", "W2"]
    assert arm.link_names == ["base", *(f"link{i}" for i in range(1, 8)), "flange"]
    assert np.allclose(np.degrees(arm.upper), [177, 91, 174, 137, 255, 165, 360])
    assert np.array_equal(arm.lower, -arm.upper)
    assert np.allclose(np.degrees(arm.velocity_limit), [57, 57, 114, 114, 360, 360, 360])
    assert np.isposinf(arm.effort_limit).all() and np.isposinf(arm.acceleration_limit).all()
    assert np.array_equal(arm.base, np.eye(4)) and np.array_equal(arm.tool, np.eye(4))
    assert repr(arm).startswith("Chain('pa10', 7 joints from 'base' to 'flange': revolute S1")
    arm.upper[:] = 0  # a copy: the arm does not change
    assert arm == rd.catalog.load("pa10")
    with pytest.raises(AttributeError):
        arm.name = "x"  # type: ignore[misc]


def test_planar_arm_has_no_limits() -> None:
    arm = rd.catalog.load("planar3r")
    assert (
        np.isneginf(arm.lower).all()
        and np.isposinf(arm.upper).all()
        and np.isposinf(arm.velocity_limit).all()
    )


@pytest.mark.parametrize("name", NAMES)
def test_pickle_and_copy_keep_every_bit(name: str) -> None:
    arm = rd.catalog.load(name).with_tool(
        np.array([[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0.3], [0, 0, 0, 1.0]])
    )
    q = np.linspace(-1, 1, arm.dof)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(arm, protocol))
        assert again == arm
        assert np.array_equal(again.kinematics(q)[1], arm.kinematics(q)[1])
        assert pickle.dumps(again, protocol) == pickle.dumps(arm, protocol)
    assert copy.deepcopy(arm) == arm == copy.copy(arm)


def test_equality() -> None:
    arm = rd.catalog.load("pa10")
    assert arm == rd.catalog.load("pa10") and arm != rd.catalog.load("iiwa14")
    assert (
        arm != arm.with_limits(velocity=1.0)
        and arm != arm.with_tool(np.diag([-1.0, -1, 1, 1]))
        and arm != "pa10"
    )


def test_from_dh_is_the_catalogues_puma() -> None:
    half = np.pi / 2
    rows = [
        [0, 0, half, 0],
        [0.4318, 0, 0, 0],
        [0.0203, 0.15005, -half, 0],
        [0, 0.4318, half, 0],
        [0, 0, -half, 0],
        [0, 0, 0, 0],
    ]
    inertia = [
        (0, [0, 0, 0], [0, 0.35, 0]),
        (17.4, [-0.3638, 0.006, 0.2275], np.diag([0.13, 0.524, 0.539])),
        (4.8, [-0.0203, -0.0141, 0.070], [0.066, 0.086, 0.0125]),
        (0.82, [0, 0.019, 0], [1.8e-3, 1.3e-3, 1.8e-3]),
        (0.34, [0, 0, 0], [0.3e-3, 0.4e-3, 0.3e-3]),
        (0.09, [0, 0, 0.032], [0.15e-3, 0.15e-3, 0.04e-3]),
    ]
    ratio = np.array([62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686])
    motor = np.array([2e-4, 2e-4, 2e-4, 3.3e-5, 3.3e-5, 3.3e-5])
    arm = rd.Chain.from_dh(
        rows,
        lower=np.radians([-160, -45, -232, -140, -100, -266]),
        upper=np.radians([160, 225, 52, 140, 100, 266]),
        effort=[97.6, 186.4, 89.4, 24.2, 20.1, 21.3],
        inertia=inertia,
        rotor_inertia=ratio * ratio * motor,
        name="puma560",
    )
    assert arm == rd.catalog.load("puma560")


def test_from_dh_options() -> None:
    rows = np.array([[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8]])
    base, tool = np.eye(4), np.eye(4)
    base[:3, 3], tool[:3, 3] = [1, 2, 3], [4, 5, 6]
    arm = rd.Chain.from_dh(rows, "modified", base, tool, ["a", "b"], velocity=2.0)
    assert arm.joint_names == ["a", "b"] and np.array_equal(arm.velocity_limit, [2, 2])
    assert np.array_equal(arm.base, base) and np.array_equal(arm.tool, tool)
    plain = rd.Chain.from_dh(rows, convention="modified")
    q = [0.3, -0.4]
    assert np.allclose(arm.forward(q), base @ plain.forward(q) @ tool, rtol=0, atol=1e-14)
    standard = rd.Chain.from_dh(rows)

    def rot(axis: int, angle: float) -> np.ndarray:
        out, (i, j) = np.eye(4), ((1, 2), (2, 0), (0, 1))[axis]
        out[i, i] = out[j, j] = np.cos(angle)
        out[j, i] = np.sin(angle)
        out[i, j] = -out[j, i]
        return out

    def along(x: float, z: float) -> np.ndarray:
        out = np.eye(4)
        out[0, 3], out[2, 3] = x, z
        return out

    expected = {"standard": np.eye(4), "modified": np.eye(4)}
    for (a, d, alpha, theta), angle in zip(rows, q, strict=True):
        z, x = rot(2, theta + angle) @ along(0, d), along(a, 0) @ rot(0, alpha)
        expected["standard"] = expected["standard"] @ z @ x
        expected["modified"] = expected["modified"] @ x @ z
    assert np.allclose(standard.forward(q), expected["standard"], rtol=0, atol=1e-14)
    assert np.allclose(plain.forward(q), expected["modified"], rtol=0, atol=1e-14)


def test_with_limits_changes_what_is_given() -> None:
    arm = rd.catalog.load("panda")
    slow = arm.with_limits(velocity=np.full(7, 0.5), acceleration=1.0)
    assert np.array_equal(slow.velocity_limit, np.full(7, 0.5)) and np.array_equal(
        slow.acceleration_limit, np.ones(7)
    )
    assert np.array_equal(slow.lower, arm.lower) and np.array_equal(slow.effort_limit, arm.effort_limit)
    free = arm.with_limits(lower=-np.inf, upper=np.inf, effort=np.inf)
    assert np.isneginf(free.lower).all() and np.isposinf(free.effort_limit).all()
    assert free.with_limits(arm.lower, arm.upper, effort=arm.effort_limit) == arm


ROW = [[0.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rd.Chain.from_dh([]), ["rows"]),
        (lambda: rd.Chain.from_dh(np.zeros((0, 4))), ["no moving joint"]),
        (lambda: rd.Chain.from_dh([[1, 2, 3]]), ["rows", "(1, 3)", "(N, 4)"]),
        (lambda: rd.Chain.from_dh([[0, 0, np.nan, 0]]), ["D-H row 0", "entry 2", "NaN"]),
        (lambda: rd.Chain.from_dh(ROW, "craig"), ["convention", "'craig'", "standard, modified"]),
        (lambda: rd.Chain.from_dh(ROW, names=["a", "b"]), ["joint names", "expected 1", "got 2"]),
        (lambda: rd.Chain.from_dh(ROW * 2, names=["a", "a"]), ["'a'", "twice"]),
        (lambda: rd.Chain.from_dh(ROW, lower=[1], upper=[-1]), ["joint1", "1", "above", "-1"]),
        (lambda: rd.Chain.from_dh(ROW, lower=[1, 2]), ["lower", "expected 1", "got 2"]),
        (lambda: rd.Chain.from_dh(ROW, velocity=[0]), ["joint1", "velocity", "> 0"]),
        (lambda: rd.Chain.from_dh(ROW, effort=[np.nan]), ["joint1", "effort", "NaN"]),
        (lambda: rd.Chain.from_dh(ROW, base=np.zeros((4, 4))), ["pose", "bottom row"]),
        (lambda: rd.Chain.from_dh(ROW, inertia=[(-1, [0, 0, 0], [1, 1, 1])]), ["mass", "-1"]),
        (
            lambda: rd.Chain.from_dh(ROW, inertia=[(1, [0, 0], [1, 1, 1])]),
            ["inertia[0]", "centre", "expected 3"],
        ),
        (lambda: rd.Chain.from_dh(ROW, inertia=[]), ["inertias", "expected 1", "got 0"]),
        (lambda: rd.Chain.from_dh(ROW, rotor_inertia=[-1]), ["rotor", "-1"]),
        (lambda: rd.catalog.load("pa10").with_limits(lower=np.zeros(6)), ["lower", "expected 7", "got 6"]),
        (lambda: rd.catalog.load("pa10").with_limits(lower=3.2), ["S1", "3.2", "above"]),
        (lambda: rd.catalog.load("pa10").with_limits(upper=np.nan), ["S1", "NaN"]),
    ],
)
def test_bad_input_is_named(call, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(rd.RedundancyError) as caught:
        call()
    for word in words:
        assert word in str(caught.value), f"{caught.value} lacks {word}"


@pytest.mark.parametrize("item", [1.0, (1.0, [0, 0, 0]), (1.0, [0, 0, 0], np.zeros((2, 3)))])
def test_malformed_inertia_is_a_type_error(item: object) -> None:
    with pytest.raises((TypeError, rd.RedundancyError), match=r"inertia\[0\]"):
        rd.Chain.from_dh(ROW, inertia=[item])  # type: ignore[list-item]


def test_one_arm_in_many_threads() -> None:
    arm = rd.catalog.load("iiwa14")
    q = np.random.default_rng(0).uniform(-2, 2, (200, 7))
    expected = [arm.jacobian(row) for row in q]
    wrong = []

    def work() -> None:
        for row, known in zip(q, expected, strict=True):
            if not np.array_equal(arm.jacobian(row), known):
                wrong.append(row)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
