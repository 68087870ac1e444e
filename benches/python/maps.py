"""Cost of maps: core-seconds per million poses per arm and metric, Dask beside the bare core, bytes per pose.

Core-seconds are CPU times of this process, so that other programs on the machine count little. Half of the poses are
drawn from joints within the limits, half anywhere in a box around the arm.
"""

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

import redundancy as rd

ARMS = ("iiwa14", "pa10", "panda", "ur5e")
QUESTIONS = (
    ["reachable"],
    ["margin"],
    ["reachable", "margin", "swivel_measure"],
    ["reachable", "margin", "swivel_measure", "manipulability"],
    ["margin", "proven"],
)
COUNT = 20_000


def drawn(chain: rd.Chain, count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    poses = chain.forward(rng.uniform(chain.lower, chain.upper, (count, chain.dof)))
    poses[count // 2 :, :3, 3] = rng.uniform((-0.9, -0.9, -0.5), (0.9, 0.9, 1.2), (count - count // 2, 3))
    return poses


def core() -> None:
    for name in ARMS:
        chain = rd.catalog.load(name)
        for question in QUESTIONS:
            count = COUNT if "proven" not in question else COUNT // 20
            poses = drawn(chain, count)
            seconds = []
            for _ in range(3):
                begin = time.process_time()
                found = rd.maps.metrics(chain, poses, question)
                seconds.append(time.process_time() - begin)
            cost = sorted(seconds)[1] / count * 1e6
            share = f", proven {found['proven'].mean():.3f}" if "proven" in found else ""
            print(f"{name:8} {'+'.join(question):55} {cost:8.2f} core-s per million poses{share}")


def dask() -> None:
    from distributed import Client, LocalCluster  # noqa: PLC0415 - an extra

    chain = rd.catalog.load("iiwa14")
    options = {"spacing": 0.05, "directions": 20, "metrics": ("reachable", "margin")}
    region = ((-0.8, 0.8), (-0.8, 0.8), (-0.2, 1.0))
    for workers in (1, 2):
        with (
            tempfile.TemporaryDirectory() as folder,
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            for k in range(3):
                alone = rd.maps.capability(
                    chain, Path(folder) / f"a{k}.zarr", region=region, threads=workers, **options
                )
                through = rd.maps.capability(
                    chain, Path(folder) / f"d{k}.zarr", region=region, client=client, **options
                )
                poses = alone.open().poses(alone.chunks // 2)
                begin = time.perf_counter()
                rd.maps.metrics(chain, poses, options["metrics"], threads=workers)
                bare = len(poses) / (time.perf_counter() - begin)
                memory = [
                    m // 1024
                    for m in client.run(lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss).values()
                ]
                size = sum(f.stat().st_size for f in Path(folder, f"d{k}.zarr").rglob("*") if f.is_file())
                print(
                    f"{workers} workers: {through.poses} poses, alone {alone.rate:,.0f}/s, Dask {through.rate:,.0f}/s, "
                    f"ratio {through.rate / alone.rate:.2f}; one chunk of the bare core {bare:,.0f}/s; "
                    f"workers {memory} MiB; {size / through.poses:.2f} bytes per pose"
                )


if __name__ == "__main__":
    core()
    dask()
