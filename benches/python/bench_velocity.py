"""One control step: joint velocities for a tool velocity, beside pinocchio with numpy, pink with daqp, and placo.

Random configurations of iiwa14 and dexter with sigma_min > 0.1, a slow tool velocity, dt 10 ms. Every job gets q and
the wanted velocity and gives joint velocities. Ours and the numpy row pull to mid-range with the projected gradient;
pink and placo solve a quadratic program with position and velocity limits and a weak pull to a posture, so the row to
compare them with is `saturated_nullspace`, which holds the limits too. The error is |J qd - v|. placo wants an older
pinocchio than the tests do: it is no part of the bench extra and is measured where it is installed.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import redundancy as rd

sys.path.insert(0, str(Path(__file__).parent))
from neighbours import Array, machine, medians, optional, random_q, table, time_text, urdf

DT = 0.01
GAIN = 1.0
COUNT = 300
VELOCITY = np.array([0.05, -0.025, 0.015, 0.05, 0.01, -0.05])
HEAD = ("robot", "step", "median", "times ours", "median error", "limits")
Job = Callable[[int], Array]


def regular(chain: rd.Chain) -> Array:
    """Configurations away from singularities and from the limits."""
    q = random_q(chain, 20 * COUNT, seed=3)
    room = np.minimum(q - chain.lower, chain.upper - q).min(axis=1) > 0.05
    sigma = np.array([np.linalg.svd(chain.jacobian(x), compute_uv=False)[-1] for x in q])
    return np.ascontiguousarray(q[room & (sigma > 0.1)][:COUNT])


def ours(chain: rd.Chain, q: Array) -> dict[str, Job]:
    """Our schemes through Python."""
    h = rd.JointRange(chain)
    projected = rd.ProjectedGradient(chain, h, GAIN)
    reduced = rd.ReducedGradient(chain, h, GAIN)
    saturated = rd.SaturatedNullspace(chain, h, GAIN)
    return {
        "projected_gradient": lambda i: projected.step(q[i], VELOCITY).qd,
        "reduced_gradient": lambda i: reduced.step(q[i], VELOCITY).qd,
        "saturated_nullspace": lambda i: saturated.step(q[i], VELOCITY, dt=DT).qd,
    }


def with_numpy(pin: Any, model: Any, chain: rd.Chain, q: Array) -> Job:
    """What one writes by hand: pinocchio's Jacobian, numpy's pseudoinverse, the projected gradient of joint range."""
    data, frame = model.createData(), model.getFrameId("tool")
    middle, half = (chain.lower + chain.upper) / 2, (chain.upper - chain.lower) / 2
    n = chain.dof

    def step(i: int) -> Array:
        j = pin.computeFrameJacobian(model, data, q[i], frame, pin.LOCAL_WORLD_ALIGNED)
        inverse = np.linalg.pinv(j)
        eta = -GAIN * (q[i] - middle) / (n * (2 * half) ** 2)
        return inverse @ VELOCITY + eta - inverse @ (j @ eta)

    return step


def with_pink(pin: Any, pink: Any, model: Any, q: Array) -> Job:
    """A frame task and a weak posture task, position and velocity limits, solved by daqp."""
    data = model.createData()
    frame = model.getFrameId("tool")
    tool = pink.tasks.FrameTask("tool", position_cost=1.0, orientation_cost=1.0)
    posture = pink.tasks.PostureTask(cost=1e-3)
    posture.set_target((model.lowerPositionLimit + model.upperPositionLimit) / 2)

    def step(i: int) -> Array:
        configuration = pink.Configuration(model, data, q[i], copy_data=False, forward_kinematics=True)
        pose = configuration.data.oMf[frame]
        turn = pin.exp3(VELOCITY[3:] * DT)
        tool.set_target(pin.SE3(turn @ pose.rotation, pose.translation + VELOCITY[:3] * DT))
        return pink.solve_ik(configuration, [tool, posture], DT, solver="daqp")

    return step


def with_placo(placo: Any, pin: Any, text: str, chain: rd.Chain, q: Array) -> Job:
    """A frame task and a weak joint task, position and velocity limits, placo's own solver."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "robot.urdf").write_text(text)
        robot = placo.RobotWrapper(folder, placo.Flags.ignore_collisions)
    solver = placo.KinematicsSolver(robot)
    solver.mask_fbase(True)
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(True)
    solver.dt = DT
    tool = solver.add_frame_task("tool", np.eye(4))
    tool.configure("tool", "soft", 1.0, 1.0)
    names = [f"joint{k}" for k in range(1, chain.dof + 1)]
    middle = (chain.lower + chain.upper) / 2
    posture = solver.add_joints_task()
    posture.set_joints(dict(zip(names, middle.tolist(), strict=True)))
    posture.configure("posture", "soft", 1e-6)
    first = 6

    def step(i: int) -> Array:
        state = robot.state.q
        state[first + 1 :] = q[i]
        robot.state.q = state
        robot.update_kinematics()
        pose = np.array(robot.get_T_world_frame("tool"))
        pose[:3, :3] = pin.exp3(VELOCITY[3:] * DT) @ pose[:3, :3]
        pose[:3, 3] += VELOCITY[:3] * DT
        tool.T_world_frame = pose
        return np.array(solver.solve(False))[first:] / DT

    return step


def main() -> None:
    pin, pink, placo = optional("pinocchio"), optional("pink"), optional("placo")
    lines = []
    for name in ("iiwa14", "dexter"):
        chain = rd.catalog.load(name)
        q = regular(chain)
        jobs: dict[str, Job] = ours(chain, q)
        held = {"saturated_nullspace": "held", "pink + daqp": "held", "placo": "held"}
        if pin is not None:
            text = urdf(chain)
            model = pin.buildModelFromXML(text)
            jobs["pinocchio + numpy"] = with_numpy(pin, model, chain, q)
            if pink is not None:
                jobs["pink + daqp"] = with_pink(pin, pink, model, q)
            if placo is not None:
                jobs["placo"] = with_placo(placo, pin, text, chain, q)
        seconds = medians(jobs, len(q))
        for job, time in seconds.items():
            errors = [np.linalg.norm(chain.jacobian(q[i]) @ jobs[job](i) - VELOCITY) for i in range(40)]
            like = "saturated_nullspace" if job in held else "projected_gradient"
            ratio = "" if job in ours(chain, q) else f"{time / seconds[like]:.0f}"
            lines.append(
                (name, job, time_text(time), ratio, f"{np.median(errors):.0e}", held.get(job, "none"))
            )
    print(table(HEAD, lines))
    print(machine())


if __name__ == "__main__":
    main()
