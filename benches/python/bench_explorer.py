"""From a moved gizmo or slider to the new configuration in the explorer: ms, in one process, without a browser."""

import time

import numpy as np

import redundancy as rd
from redundancy.explorer import drawing
from redundancy.explorer.model import PoseModel

ROUNDS = 500


def measured(action):
    """Median and 95 % quantile, ms."""
    times = []
    for k in range(ROUNDS):
        begin = time.perf_counter()
        action(k)
        times.append(1e3 * (time.perf_counter() - begin))
    return f"{np.median(times):8.3f}{np.quantile(times, 0.95):8.3f}"


def main():
    """Print a table."""
    print(f"{'':10}{'':34}{'median':>8}{'p95':>8}")
    for name in ("iiwa14", "panda"):
        chain = rd.catalog.load(name)
        model = PoseModel(chain)
        start = model.target.copy()

        def move(k, model=model, start=start):
            pose = start.copy()
            pose[:3, 3] += 0.03 * np.sin(0.05 * k + np.arange(3.0))
            model.move(pose)

        print(f"{name:10}{'gizmo to configuration':34}{measured(move)}")
        print(
            f"{'':10}{'slider to configuration':34}{measured(lambda k, m=model: m.slide(-3.0 + 0.012 * k))}"
        )
        view = rd.explore(chain, port=0, open_browser=False)
        with view:
            wxyz, at = drawing.quaternion(view.pose.target), view.pose.target[:3, 3].copy()
            panel = view.pose_panel
            print(
                f"{'':10}{'gizmo to everything sent':34}"
                f"{measured(lambda k, p=panel, a=at, w=wxyz: p.move(a + 0.03 * np.sin(0.05 * k + np.arange(3.0)), w))}"
            )
            print(
                f"{'':10}{'slider to everything sent':34}{measured(lambda k, p=panel: p.slide(-170.0 + 0.6 * k))}"
            )


if __name__ == "__main__":
    main()
