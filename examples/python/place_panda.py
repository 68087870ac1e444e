"""Where should a Panda stand to follow a raster, and from where can it not?"""

import tempfile
from pathlib import Path

import numpy as np

import redundancy as rd

try:
    import zarr  # noqa: F401 - the extra
except ModuleNotFoundError:
    raise SystemExit("this example needs zarr: pip install 'redundancy[maps]'") from None

chain = rd.catalog.load("panda")
down = np.diag([1.0, -1.0, -1.0])
raster = rd.paths.raster((0.35, -0.15, 0.25), 0.3, 0.1, 3, corner=0.05, orientation=down)
path = raster.resampled(raster.length / 99)

with tempfile.TemporaryDirectory() as folder:
    region = ((-0.3, 0.3), (-0.3, 0.3))
    job = rd.maps.place(chain, path, region, 0.3, 2, out=Path(folder) / "place.zarr", refine=1)

print(f"{len(job.placements)} placements, {job.planned} of them planned")
for placement in [*job.best[:3], job.placements[-1]]:
    x, y, _, yaw = placement.xyz_yaw
    print(
        f"base at ({x:+.3f}, {y:+.3f}), turned by {np.rad2deg(yaw):5.1f} degrees: {placement.status}, "
        f"margin {placement.margin:.3f} rad, {placement.travel:.2f} rad of motion {placement.reason}"
    )

best = job.best[0]
plan = rd.plan(chain.with_base(best.base), path)
assert plan.status is rd.Status.CONVERGED
assert abs(plan.margin.min() - best.margin) < 1e-9
