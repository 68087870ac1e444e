"""A Panda with meshes from a package: convex hulls, self-collision, clearance per link, allowed contact.

The meshes are those of the PyPI package `example-robot-data`. Writes the picture of docs/scene.md when a file is named.

    python examples/python/bodies.py [bodies.png]
"""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import redundancy as rd


def share() -> Path | None:
    """The folder that holds the package `example-robot-data`, as the PyPI wheel lays it out."""
    found = importlib.util.find_spec("pinocchio")
    if found is None or not found.submodule_search_locations:
        return None
    folder = Path(found.submodule_search_locations[0]).parents[3] / "share"
    return folder if (folder / "example-robot-data").is_dir() else None


def draw(chain: rd.Chain, packages: Path, scene: rd.Scene, rows: np.ndarray, file: str) -> None:
    """The hulls at the end of a motion, and its distances."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    space: Any = figure.add_subplot(1, 2, 1, projection="3d")
    meshes = packages / "example-robot-data/robots/panda_description/meshes/collision"
    for k in range(8):
        mesh = rd.Mesh.from_file(meshes / f"link{k}.stl")
        at = chain.forward(rows[-1], link=f"panda_link{k}")
        corners = mesh.vertices @ at[:3, :3].T + at[:3, 3]
        faces = Poly3DCollection(corners[mesh.faces], facecolor="#7aa6c2", edgecolor="none", alpha=0.5)
        space.add_collection3d(faces)
    box = scene.obstacles[0]
    assert isinstance(box, rd.Box)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = signs * box.half_extents @ box.pose[:3, :3].T + box.pose[:3, 3]
    sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    space.add_collection3d(Poly3DCollection(corners[sides], facecolor="#c25b4e", alpha=0.35))
    space.set(
        xlim=(-0.5, 0.7), ylim=(-0.6, 0.6), zlim=(0, 1.1), xlabel="x (m)", ylabel="y (m)", zlabel="z (m)"
    )
    space.set_box_aspect((1, 1, 0.95))
    space.set_title("hulls of the links, and a box", fontsize=10)
    plot = figure.add_subplot(1, 2, 2)
    links = panda(packages)[1]
    near = scene.clearance(chain, rows, links)
    share_of_way = np.linspace(0, 1, len(rows))
    for name, one in near.by_link.items():
        if one.distance.min() < 0.25:
            plot.plot(share_of_way, 1e3 * one.distance, lw=1.2, label=name)
    plot.plot(
        share_of_way, 1e3 * links.self_clearance(rows).distance, "k--", lw=1.2, label="links from each other"
    )
    plot.axhline(0, color="0.6", lw=0.8)
    plot.set(xlabel="share of the motion", ylabel="distance (mm)")
    plot.legend(fontsize=8)
    figure.savefig(file, dpi=110)


def panda(packages: Path) -> tuple[rd.Chain, rd.LinkGeometry]:
    """The arm and its body."""
    folder = packages / "example-robot-data/robots/panda_description"
    chain = rd.Chain.from_urdf(folder / "urdf/panda.urdf", "panda_link0", "panda_link8")
    links = rd.LinkGeometry.from_urdf(
        chain,
        folder / "urdf/panda.urdf",
        package_dirs=[packages],
        srdf=folder / "srdf/panda.srdf",
        posture={"panda_finger_joint1": 0.02},  # the fingers are no joints of the chain
    )
    return chain, links


def main() -> None:
    """Loads the body, asks for distances, allows a contact."""
    packages = share()
    if packages is None:
        print("skipped: the meshes come with the PyPI packages pin and example-robot-data")
        return
    chain, links = panda(packages)
    print(f"{links}: {', '.join(links.names)}")

    ready = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
    near = links.self_clearance(ready)
    print(f"nearest links: {near.first} and {near.second}, {1e3 * near.distance:.1f} mm apart")
    folded = np.array([0.0, 1.5, 0.0, -3.0, 0.0, 0.1, 0.8])
    near = links.self_clearance(folded)
    verdict = "contact" if near.distance < 0 else "clear"
    print(f"folded: {near.first} and {near.second}, {1e3 * near.distance:.1f} mm, {verdict}")

    # A box beside the elbow, and a rod in the hand that may touch it.
    at = np.eye(4)
    at[:3, 3] = (0.35, -0.3, 0.35)
    box = rd.Box(at, (0.08, 0.08, 0.35), name="box")
    rod = rd.Capsule((0, 0, 0), (0, 0, 0.25), 0.01, name="rod", attached_to="panda_link8")
    scene = rd.Scene([box, rod])
    turned = ready + np.array([-0.55, 0.2, -0.4, 0.0, 0.3, 0.0, 0.0])
    rows = np.linspace(ready, turned, 101)
    near = scene.clearance(chain, turned, links)
    print(f"nearest to the box: {near.link}, {1e3 * near.distance:.1f} mm")
    for name, one in sorted(near.by_link.items(), key=lambda item: item[1].distance)[:3]:
        print(f"  {name}: {1e3 * one.distance:.1f} mm from {scene.obstacles[one.obstacle].name}")
    allowed = rd.Scene([box, rod], allowed=[("rod", "box")])
    near = allowed.clearance(chain, turned, links)
    print(f"with the rod allowed to touch it: {near.link}, {1e3 * near.distance:.1f} mm")
    if len(sys.argv) > 1:
        draw(chain, packages, scene, rows, sys.argv[1])


if __name__ == "__main__":
    main()
