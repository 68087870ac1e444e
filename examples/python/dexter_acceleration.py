"""[Bettini2000], its outlook: DEXTER's runs at acceleration level, without a jump at the change of basis."""

import sys
from pathlib import Path

import numpy as np

import redundancy as rd

chain = rd.catalog.load("dexter")
h = rd.JointRange(chain)
q_in = np.deg2rad([40.0, 0, 90, 180, -90, 180, -90, 0])
basis = (0, 2, 3, 4, 5, 7)  # "columns 2 and 7 deleted"
schedule = [(2.5, (0, 2, 3, 5, 6, 7))]  # figure 5: from then on the fifth column is left out instead
dt, seconds, duration = 0.025, 10.0, 5.0
t = np.arange(0.0, seconds + dt / 2, dt)
gain, velocity_gain = 10.0, 10.0
position_gain, rate_gain = 100.0, 20.0  # error feedback, critically damped, 1/s^2 and 1/s

start = chain.forward(q_in)
r = start[:3, :3]
begin = np.r_[
    start[:3, 3], np.arctan2(r[1, 0], r[0, 0]), np.arcsin(-r[2, 0]), np.arctan2(r[2, 1], r[2, 2])
]  # x, y, z, phi, theta, psi of Rz(phi) Ry(theta) Rx(psi)
end = np.array([0.6, -0.3, 0.5, *np.deg2rad([10.0, -20.0, 40.0])])


def coordinates(pose: np.ndarray) -> np.ndarray:
    """Position and roll-pitch-yaw of a pose."""
    r = pose[:3, :3]
    phi, theta = np.arctan2(r[1, 0], r[0, 0]), np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    return np.r_[pose[:3, 3], phi, theta, np.arctan2(r[2, 1], r[2, 2])]


def wanted(time: float, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The quintic profile: coordinates, their velocity and acceleration."""
    u = min(time / duration, 1.0)
    s = u**3 * (10 - 15 * u + 6 * u**2)
    ds = 30 * u**2 * (1 - u) ** 2 / duration
    dds = 60 * u * (1 - u) * (1 - 2 * u) / duration**2
    return begin + s * distance, ds * distance, dds * distance


def run(
    make: "type[rd.ProjectedGradient] | type[rd.ReducedGradient]", level: str, moving: bool, **options: object
) -> dict[str, np.ndarray]:
    """Integrates one run; both levels feed back the position, the acceleration level the velocity too."""
    levels = {"level": level} if level != "velocity" else {}
    scheme = make(chain, h, gain, task="pose_rpy", damping=None, **options, **levels)  # type: ignore[arg-type]
    distance = (end - begin) if moving else np.zeros(6)
    q, qd = q_in.copy(), np.zeros(8)
    if level == "acceleration":  # starts with the joint velocity that the velocity level has
        first = {key: value for key, value in options.items() if key != "schedule"}
        qd = make(chain, h, gain, task="pose_rpy", damping=None, **first).step(q, np.zeros(6)).qd  # type: ignore[arg-type]
    rows: dict[str, list] = {"q": [], "qd": [], "error": [], "angle": []}
    for time in t:
        x, v, a = wanted(time, distance)
        error = x - coordinates(chain.forward(q))
        if level == "velocity":
            qd = scheme.step(q, v + 5.0 * error, dt).qd
        for name, value in (("q", q), ("qd", qd), ("error", np.linalg.norm(error[:3]))):
            rows[name].append(value)
        rows["angle"].append(np.abs(error[3:]).max())
        if level == "velocity":
            q = q + dt * qd
            continue
        rates = scheme.jacobian(q) @ qd
        task = a + rate_gain * (v - rates) + position_gain * error
        qdd = scheme.step_acceleration(q, qd, task, dt).qdd
        q, qd = q + dt * qd + 0.5 * dt**2 * qdd, qd + dt * qdd
    return {name: np.array(values) for name, values in rows.items()}


def jump(qd: np.ndarray) -> float:
    """The largest change of the joint velocity in a step around the change of basis, beyond that of the step before."""
    changes = np.linalg.norm(np.diff(qd, axis=0), axis=1)
    at = round(2.5 / dt)
    return float(changes[at - 2 : at + 4].max())


curves = {}
for title, moving in (("self-motion", False), ("point-to-point", True)):
    for name, make, options in (
        ("PG", rd.ProjectedGradient, {}),
        ("RG", rd.ReducedGradient, {"basis": basis}),
        ("RG, basis changed at 2.5 s", rd.ReducedGradient, {"basis": basis, "schedule": schedule}),
    ):
        if "changed" in name and not moving:
            continue
        for level in ("velocity", "acceleration"):
            result = run(make, level, moving, **options)
            curves[title, name, level] = result
            value = h.value(result["q"])
            marks = "  ".join(f"{value[round(s / dt)]:.6f}" for s in (0, 0.5, 1, 2, 3, 5, 10))
            millimetres, degrees = 1e3 * result["error"].max(), np.rad2deg(result["angle"].max())
            print(
                f"{title:15} {name:27} {level:12} H {marks}  error {millimetres:.4f} mm {degrees:.4f} deg"
                + (f"  jump {jump(result['qd']):.3f} rad/s" if "changed" in name else "")
            )

NAME = "RG, basis changed at 2.5 s"
changed = {level: curves["point-to-point", NAME, level] for level in ("velocity", "acceleration")}
steps = {level: np.linalg.norm(np.diff(result["qd"], axis=0), axis=1) for level, result in changed.items()}
DRIFT = max(1e3 * result["error"].max() for key, result in curves.items() if key[2] == "acceleration")
print(f"acceleration level: at most {DRIFT:.4f} mm off the path")

if len(sys.argv) > 1:  # a directory for the figure; needs matplotlib
    import matplotlib.pyplot as plt

    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5.5), sharex=True, layout="constrained")
    for level, result in changed.items():
        above.plot(t, np.linalg.norm(result["qd"], axis=1), label=f"{level} level")
        below.semilogy(t, np.maximum(1e3 * result["error"], 1e-7), label=f"{level} level")
    above.axvline(2.5, color="0.8", zorder=0)
    above.set(ylabel="|qd| (rad/s)", title="DEXTER, reduced gradient, basis changed at 2.5 s")
    below.set(xlabel="t (s)", ylabel="off the path (mm)")
    above.legend()
    figure.savefig(out / "dexter_acceleration.png", dpi=120)
    plt.close(figure)
