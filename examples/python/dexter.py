"""[Bettini2000]: the 8R arm DEXTER with the projected and the reduced gradient, and figures 3 to 5 redrawn."""

import sys
from pathlib import Path

import numpy as np

import redundancy as rd

chain = rd.catalog.load("dexter")
h = rd.JointRange(chain)
q_in = np.deg2rad([40.0, 0, 90, 180, -90, 180, -90, 0])
basis = (0, 2, 3, 4, 5, 7)  # "columns 2 and 7 deleted"
dt, seconds = 0.025, 10.0
t = np.arange(0.0, seconds + dt / 2, dt)

# The straight line in position and roll-pitch-yaw angles, from the exact start, with a quintic profile over 5 s.
start = chain.forward(q_in)
r = start[:3, :3]
angles = np.array(
    [np.arctan2(r[1, 0], r[0, 0]), np.arcsin(-r[2, 0]), np.arctan2(r[2, 1], r[2, 2])]
)  # phi, theta, psi of Rz Ry Rx
end = np.array([0.6, -0.3, 0.5, *np.deg2rad([10.0, -20.0, 40.0])])
begin = np.r_[start[:3, 3], angles]
u = np.clip(t / 5.0, 0.0, 1.0)
line = begin + (u**3 * (10 - 15 * u + 6 * u**2))[:, None] * (end - begin)


def pose(x: np.ndarray) -> np.ndarray:
    """Position and roll-pitch-yaw as a homogeneous matrix."""
    (cz, sz), (cy, sy), (cx, sx) = ((np.cos(a), np.sin(a)) for a in x[3:])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    matrix = np.eye(4)
    matrix[:3, :3] = about_z @ about_y @ about_x
    matrix[:3, 3] = x[:3]
    return matrix


moving = rd.Path([pose(x) for x in line], t=t)
standing = rd.Path([start, start], t=[0.0, seconds])
schemes = {
    "PG": rd.ProjectedGradient(chain, h, 10.0, task="pose_rpy", damping=None),
    "RG": rd.ReducedGradient(chain, h, 10.0, task="pose_rpy", damping=None, basis=basis),
}
# Figure 5's change of basis: at 2.5 s the fifth column is left out instead of the seventh.
scheduled = rd.ReducedGradient(
    chain, h, 10.0, task="pose_rpy", damping=None, basis=basis, schedule=[(2.5, (0, 2, 3, 5, 6, 7))]
)
figures = {}
for title, path in (("self-motion", standing), ("point-to-point", moving)):
    for name, scheme in schemes.items():
        run = rd.track(chain, scheme, path, q_in, dt, feedback=5.0)
        value = h.value(run.q)
        figures[title, name] = (run.t, value, np.linalg.norm(run.qd, axis=1))
        marks = "  ".join(f"{value[round(s / dt)]:.6f}" for s in (0, 0.5, 1, 2, 3, 5, 10))
        millimetres, degrees = 1e3 * run.position_error, np.rad2deg(run.orientation_error)
        print(f"{title:15} {name}  H {marks}  error {millimetres:.3f} mm {degrees:.3f} deg")
assert abs(figures["self-motion", "RG"][1][-1] - 0.0037635839) < 1e-8

run = rd.track(chain, scheduled, moving, q_in, dt, feedback=5.0)
figures["point-to-point", "RG, (2,7) to (2,5) at 2.5 s"] = (
    run.t,
    h.value(run.q),
    np.linalg.norm(run.qd, axis=1),
)
print(f"basis changes at {[event.t for event in run.events]} s, error {1e3 * run.position_error:.3f} mm")

# The paper's damping on its basis, in its fourth frame and formula: 35.6 mm off the path at the end of its 10 s.
paper = rd.Damping(0.1, 0.2, 0.25)
astray = {}
for label, frame, form in (
    ("frame 4, as printed", "link4", "paper"),
    ("frame 4, exact projector", "link4", "robust"),
    ("tool, as printed", None, "paper"),
    ("tool, exact projector", None, "robust"),
):
    scheme = rd.ReducedGradient(
        chain, h, 10.0, task="pose_rpy", damping=paper, basis=basis, frame=frame, form=form
    )
    run = rd.track(chain, scheme, moving, q_in, dt, feedback=5.0)
    error = 1e3 * np.linalg.norm(chain.forward(run.q)[:, :3, 3] - line[:, :3], axis=1)
    astray[label] = error
    print(
        f"damped, {label:25} {error.max():.1f} mm off its path, {error[-1]:.1f} mm at the end, {run.status}"
    )
assert abs(astray["frame 4, as printed"].max() - 35.6) < 1.0

# With default settings the basis is chosen and changed as needed, and every change is reported.
free = rd.track(chain, rd.ReducedGradient(chain, h, 10.0, task="pose_rpy"), moving, q_in, dt)
for event in free.events:
    print(f"t = {event.t:.3f} s: {event.kind}: {event.message}")
assert free.position_error < 5e-4

if len(sys.argv) > 1:  # a directory for the figures; needs matplotlib
    import matplotlib.pyplot as plt

    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    for number, title, column, label in (
        (3, "self-motion", 1, "H"),
        (4, "point-to-point", 1, "H"),
        (5, "point-to-point", 2, "|qd| (rad/s)"),
    ):
        figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
        for name in [name for key, name in figures if key == title]:
            if number == 4 and "(" in name:
                continue
            data = figures[title, name]
            axis.plot(data[0], data[column], label=name)
        axis.set(xlabel="t (s)", ylabel=label, title=f"DEXTER, {title} (figure {number})")
        axis.legend()
        figure.savefig(out / f"dexter_figure_{number}.png", dpi=120)
        plt.close(figure)
    figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
    for label, error in astray.items():
        axis.plot(t, error, label=label)
    axis.set(
        xlabel="t (s)",
        ylabel="off the path (mm)",
        title="DEXTER, the paper's damping without a change of basis",
    )
    axis.legend()
    figure.savefig(out / "dexter_damped.png", dpi=120)
    plt.close(figure)
