"""Every configuration for a pose, for three different arms through one interface.

An S-R-S arm has circles, an arm with a spherical wrist has points, and the Panda has closed curves.
"""

import numpy as np

import redundancy as rd


def table(name: str, posture: list[float]) -> None:
    """Prints what is over the pose of `posture`: pieces, where the joint limits hold, and the best of each kind."""
    chain = rd.catalog.load(name)
    pose = chain.forward(posture)
    form = rd.closed_form(chain)
    s = rd.solutions(chain, pose)
    kind = ["points", "curves"][s.dimension]
    print(
        f"{name}: closed form {form.name if form else None}, {len(s.pieces)} {kind}, {s.status}, proven {s.proven}"
    )
    if s.reason:
        print(f"  {s.reason}")
    for piece in s.pieces:
        lo, hi = piece.range
        arcs = [f"{a:.3f} .. {b:.3f}" if b > a else "holds" for a, b in piece.intervals()]
        print(f"  {piece.label:8}  u {lo:6.3f} .. {hi:5.3f}  limits: {', '.join(arcs) or '-'}")
        assert np.allclose(chain.forward(piece.q(lo)), pose, atol=1e-10)
    best = s.best(rd.JointRange(chain))
    print(
        f"  best joint range {best.value:.6f} on {best.piece.label} at u = {best.u:.4f}, proven {best.proven}"
    )
    near = s.nearest(posture)
    print(f"  nearest to the posture: {near.value:.1e} away, proven {near.proven}\n")


table("iiwa14", [0.1, 0.5, 0.2, -1.2, 0.3, 0.8, 0.0])
table("puma560", [0.3, 0.5, -0.2, 1.1, 0.4, 0.7])
table("panda", [0.1, 0.4, -0.2, -1.9, 0.3, 1.7, 0.5])
