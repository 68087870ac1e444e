"""[Moore2010]: the worked example and figures 7 to 10.

Swivel and elbow beside a ball, for constant and rising desired swivels. The tool of a PA10 moves around a circle three
times, with the flow as printed, eq. (32), and in figure 9 the robust one.
Writes PNGs into the folder that is named, or a temporary one. Needs matplotlib (`pip install '.[plot]'`).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import redundancy as rd

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)
arm = rd.SrsArm(rd.catalog.load("pa10"))

# The worked example, eqs (17) to (28); the paper's branch has theta4 < 0.
motion = arm.self_motion(rd.pose((0.5, 0.1, 1.0), quaternion_wxyz=(np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)))
branch = next(b for b in motion.branches if b.signs == (1, -1, 1))
q3, q4, wrist = branch.quaternions(0.0)
for name, value in (
    ("C", motion.center),
    ("n", motion.axis),
    ("rho", motion.radius),
    ("q_A", motion.q_a),
    ("p_E", motion.elbow(0.0)),
    ("q_3", q3),
    ("q_4", q4),
    ("conj(q_4) q", wrist),
    ("theta", branch.q(0.0)),
):
    print(f"{name:12} {np.round(value, 5)}")
print(f"{len(branch.windings(0.0))} windings of this configuration within the limits of the PA10")

# The motions of figures 7 to 10: the tool points down, the circle takes 6 s; a ball stands where the elbow passes.
dt, turns = 0.02, 3
circle = rd.paths.circle(
    (0.45, 0.0, 0.5), 0.12, turns=turns, orientation=np.diag([-1.0, 1.0, -1.0]), n=turns * 300 + 1
)
path = circle.with_times(np.linspace(0.0, 6.0 * turns, len(circle)))
ball_center, ball_radius = np.array([0.2842, -0.3539, 0.4817]), 0.06
ball = rd.Scene([rd.Sphere(ball_center, ball_radius)])
nothing = rd.Scene([])


def follow(
    desired: object, start: float, scene: rd.Scene, form: str = "paper"
) -> tuple[np.ndarray, np.ndarray]:
    """Swivels `(N,)` and elbows `(N, 3)` along the path."""
    flow = rd.SwivelFlow(arm, desired, scene, form=form)
    plan = flow.follow(path, start, dt)
    swivel = np.unwrap(np.asarray(plan.swivel))
    at = np.round(np.interp(plan.t, path.t, np.arange(len(path)))).astype(int)
    elbow = np.array(
        [arm.self_motion(path.poses[k]).elbow(float(s)) for k, s in zip(at, swivel, strict=True)]
    )
    return swivel, elbow


def ramp(t: float) -> float:
    """The linearly increasing wish of example 2."""
    return -np.pi + 2 * np.pi * t / (6.0 * turns)


def sphere(axes: object) -> None:
    """The sphere of the upper arm around the shoulder, and the ball."""
    u, v = np.mgrid[0 : 2 * np.pi : 37j, 0 : np.pi : 19j]
    ball_of = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    for center, radius, style in (
        (arm.shoulder, arm.lengths[0], {"color": "#bbbbbb", "linewidth": 0.3}),
        (ball_center, ball_radius, {"color": "#c8792a", "linewidth": 0.5}),
    ):
        x, y, z = center[:, None, None] + radius * ball_of
        axes.plot_wireframe(x, y, z, **style)
    axes.set_box_aspect((1, 1, 1))
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")


# Figures 3 to 5: the circle of the worked example on the two spheres, with n and the direction of s = 0.
figure = Figure(figsize=(6, 6), layout="constrained")
axes = figure.add_subplot(projection="3d")
wrist_center = arm.shoulder + motion.axis * np.linalg.norm(np.array([0.42, 0.1, 1.0]) - arm.shoulder)
u, v = np.mgrid[0 : 2 * np.pi : 37j, 0 : np.pi : 19j]
unit = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
for middle, radius, color in (
    (arm.shoulder, arm.lengths[0], "#bbbbbb"),
    (wrist_center, arm.lengths[1], "#a9c6d9"),
):
    axes.plot_wireframe(*(middle[:, None, None] + radius * unit), color=color, linewidth=0.3)
ring, elbow_at_zero = motion.elbow(np.linspace(0, 2 * np.pi, 181)), motion.elbow(0.0)
axes.plot(*ring.T, color="#c0392b", label="circle of the elbow, radius rho")
axes.plot(
    *np.array([arm.shoulder, elbow_at_zero, wrist_center]).T, "o-", color="#1b5e8c", label="S, E, W at s = 0"
)
axes.plot(*np.array([arm.shoulder, wrist_center]).T, ":", color="#555555", label="line A, along n")
axes.plot(*np.array([motion.center, elbow_at_zero]).T, "-", color="#c8792a", label="from C to E")
axes.set_box_aspect((1, 1, 1))
axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", title="The worked example (figures 3 to 5)")
axes.legend(fontsize="small")
figure.savefig(folder / "moore_figure_3.png", dpi=110)

figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
t = np.arange(0.0, path.t[-1] + dt / 2, dt)
for wish in np.deg2rad([-150.0, -120.0, -90.0, -60.0, -30.0]):
    swivel, _ = follow(float(wish), float(wish), ball)
    axes.plot(t[: len(swivel)], np.rad2deg(swivel), label=f"{np.rad2deg(wish):.0f} deg")
axes.set(xlabel="t (s)", ylabel="swivel (deg)", title="Example 1: fixed wishes beside a ball (figure 7)")
axes.legend(fontsize="small")
figure.savefig(folder / "moore_figure_7.png", dpi=110)

for number, wish, start, title in (
    (8, -np.pi / 2, -0.9, "wish -90 degrees"),  # at the wish itself the arm would start inside the ball
    (10, ramp, -np.pi, "a wish that rises by a turn"),
):
    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    sphere(axes)
    for scene, color, label in (
        (nothing, "#1b5e8c", "without the ball"),
        (ball, "#c0392b", "beside the ball"),
    ):
        swivel, elbow = follow(wish, start, scene)
        axes.plot(*elbow.T, color=color, linestyle="--" if scene is nothing else "-", label=label)
        least = np.linalg.norm(elbow - ball_center, axis=1).min() - ball_radius
        print(f"figure {number}, {label}: the elbow comes to {1e3 * least:.0f} mm of the ball")
    axes.view_init(elev=20, azim=-60)
    axes.set_title(f"The elbow on its sphere, {title} (figure {number})", fontsize=10)
    axes.legend(fontsize="small")
    figure.savefig(folder / f"moore_figure_{number}.png", dpi=110)

figure = Figure(figsize=(8, 4), layout="constrained")
axes = figure.subplots()
axes.plot(t, np.rad2deg([ramp(x) for x in t]), "--", color="#1b5e8c", label="wish")
for form, color in (("robust", "#c0392b"), ("paper", "#c8792a")):
    swivel, _ = follow(ramp, -np.pi, ball, form)
    axes.plot(t[: len(swivel)], np.rad2deg(swivel), color=color, label=f"swivel, {form} form")
axes.set(xlabel="t (s)", ylabel="swivel (deg)", title="Example 2: a rising wish beside a ball (figure 9)")
axes.legend(fontsize="small")
figure.savefig(folder / "moore_figure_9.png", dpi=110)
print("pictures in", folder)
