"""Maps: margins against bisection, stores that survive what befalls them, placements against exhaustive search."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import redundancy as rd

FULL = os.environ.get("REDUNDANCY_TEST_FULL") == "1"
ARMS = ("iiwa14", "pa10", "panda")


def poses(chain: rd.Chain, count: int, seed: int = 0) -> NDArray[np.float64]:
    """Poses of the arm with joints up to a fifth beyond their limits."""
    rng = np.random.default_rng(seed)
    return chain.forward(1.2 * rng.uniform(chain.lower, chain.upper, (count, chain.dof)))


def margin_by_bisection(chain: rd.Chain, pose: NDArray[np.float64]) -> float:
    """Where the intervals of all pieces end; negative where there are none without a margin."""
    pieces = rd.solutions(chain, pose).pieces
    low, high = 0.0, 4.0
    if not any(len(piece.intervals(0.0)) for piece in pieces):
        return -1.0
    while high - low > 1e-11:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if any(len(p.intervals(middle)) for p in pieces) else (low, middle)
    return low


@pytest.mark.parametrize("name", ARMS)
def test_best_margin_is_where_the_intervals_end(name: str) -> None:
    chain = rd.catalog.load(name)
    given = poses(chain, 300 if FULL else 25)
    margins = rd.maps.best_margin(chain, given)
    for pose, margin in zip(given, margins, strict=True):
        bisected = margin_by_bisection(chain, pose)
        assert (margin < 0) if bisected < 0 else abs(margin - bisected) < 1e-9
    assert (margins > 0).sum() > 5


def test_a_margin_fills_the_array_that_is_given_and_threads_do_not_change_it() -> None:
    chain = rd.catalog.load("iiwa14")
    given = poses(chain, 200)
    out = np.zeros(200)
    assert rd.maps.best_margin(chain, given, out=out, threads=1) is out
    assert np.array_equal(out, rd.maps.best_margin(rd.SrsArm(chain), given, threads=3))
    with pytest.raises(rd.RedundancyError, match=r"out for 'margin' must be a writable .* shape \(200,\)"):
        rd.maps.best_margin(chain, given, out=np.zeros(199))
    with pytest.raises(rd.RedundancyError, match="swivel_measure"):
        rd.maps.metrics(chain, given, ["swivel"])


def test_what_is_out_of_reach_or_outside_the_limits() -> None:
    chain = rd.catalog.load("iiwa14")
    far = chain.forward(np.zeros(7)) + np.pad([[3.0]], ((0, 3), (3, 0)))
    bent = chain.forward([0.0, 0.3, 0.0, 2.6, 0.0, 0.4, 0.0])
    found = rd.maps.metrics(chain, [far, bent], ["reachable", "margin", "proven", "swivel_measure"])
    assert found["margin"][0] == -np.inf
    assert found["margin"][1] == pytest.approx(chain.upper[3] - 2.6, abs=1e-9)
    assert not found["reachable"].any()
    assert found["proven"].all()
    assert not found["swivel_measure"].any()


def test_a_free_spin_is_never_worse_and_not_proven() -> None:
    chain = rd.catalog.load("ur5e")
    given = poses(chain, 5)
    fixed = rd.maps.best_margin(chain, given)
    free = rd.maps.metrics(
        chain, given, ["margin", "proven", "spin_share"], rd.ToolFreedom(spin="free"), threads=2
    )
    assert (free["margin"] >= fixed).all()
    assert not free["proven"].any()
    # Every tenth of a degree.
    for pose, share in zip(given[:2], free["spin_share"][:2], strict=True):
        angle = np.deg2rad(np.arange(0.0, 360.0, 0.5))
        turned = np.tile(pose, (len(angle), 1, 1))
        spin = np.zeros((len(angle), 3, 3))
        spin[:, 0, 0] = spin[:, 1, 1] = np.cos(angle)
        spin[:, 1, 0], spin[:, 0, 1], spin[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
        turned[:, :3, :3] = pose[:3, :3] @ spin
        counted = rd.maps.metrics(chain, turned, ["reachable"])["reachable"].mean()
        assert share == pytest.approx(counted, abs=0.02)


def test_clearance_is_that_of_the_scene() -> None:
    chain = rd.catalog.load("panda")
    given = poses(chain, 5, seed=3)
    scene = rd.Scene([rd.Sphere((3.0, 0.0, 0.0), 0.5)])
    found = rd.maps.metrics(chain, given, ["margin", "clearance"], scene=scene)
    assert ((found["clearance"] > 0.5) == np.isfinite(found["margin"])).all()
    with pytest.raises(rd.RedundancyError, match="needs a scene"):
        rd.maps.metrics(chain, given, ["clearance"])


def test_the_package_imports_neither_zarr_nor_dask() -> None:
    code = "import sys, redundancy; sys.exit(any(m in sys.modules for m in ('zarr', 'dask', 'distributed', 'rich')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- stores -----------------------------------------------------------------------------------------------

SMALL: dict[str, Any] = {"spacing": 0.4, "directions": 6, "chunk_poses": 60}


def contents(store: Path) -> dict[str, str]:
    """Every file of a store by its checksum, but the lock, and what zarr was writing when its process was killed."""
    files = (
        f for f in sorted(store.rglob("*")) if f.is_file() and f.name != "lock" and f.suffix != ".partial"
    )
    return {str(f.relative_to(store)): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that was filled without Dask in one go."""
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    path = tmp_path_factory.mktemp("maps") / "map.zarr"
    job = rd.maps.capability(rd.catalog.load("iiwa14"), path, **SMALL)
    assert (job.status, job.computed, job.kept) == (rd.Status.CONVERGED, job.chunks, 0)
    return path


def test_a_map_holds_what_the_core_says(undisturbed: Path) -> None:
    found = rd.maps.open(undisturbed)
    assert found.done.all()
    assert found.damaged() == []
    for chunk in range(len(found.done)):
        given, stored = found.poses(chunk), found.chunk(chunk)
        query = found.query(given)
        assert np.array_equal(stored["reachable"].ravel(), query.reachable)
        assert np.array_equal(stored["margin"].ravel(), query.margin.astype(np.float32))
    assert found.share("reachable").shape == found.shape
    assert 0.0 < found.reach_share < 1.0


def test_a_map_answers_with_the_freedom_scene_and_links_that_it_was_made_with(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    chain = rd.catalog.load("ur5e")
    scene = rd.Scene(
        [rd.Sphere((0.1 + 0.2, 0.7, 1.0 / 3.0), 0.11, name="ball")], allowed=[("ball", chain.link_names[2])]
    )
    given: dict[str, Any] = {
        "freedom": rd.ToolFreedom(0.1, 0.3, (0.6, 0.0, 0.8)),
        "scene": scene,
        "links": rd.LinkGeometry(chain, 0.05),
    }
    region = ((-0.4, 0.4), (0.3, 0.3), (0.2, 0.6))
    names = ("reachable", "margin", "spin_share", "clearance")
    job = rd.maps.capability(
        chain, tmp_path / "map.zarr", 0.4, 3, region=region, metrics=names, chunk_poses=9, **given
    )
    found = job.open()
    for chunk in range(job.chunks):
        poses, stored = found.poses(chunk), found.chunk(chunk)
        query = found.query(poses)
        wanted = rd.maps.metrics(chain, poses, names, **given)
        for name in names:
            assert np.array_equal(getattr(query, name), wanted[name])
            assert np.array_equal(stored[name].ravel(), wanted[name].astype(stored[name].dtype))
    assert np.isfinite(found.best("clearance")).any()
    # Without them the answers are others: they do count.
    alone = rd.maps.metrics(chain, poses, names[:3])
    assert not np.array_equal(alone["margin"], query.margin)
    other = rd.Scene([rd.Sphere((0.3, 0.7, 0.3), 0.12, name="ball")])
    with pytest.raises(rd.RedundancyError, match="scene: "):
        rd.maps.capability(
            chain, tmp_path / "map.zarr", 0.4, 3, region=region, metrics=names, **{**given, "scene": other}
        )


def test_verdicts_agree_with_brute_force(undisturbed: Path) -> None:
    found = rd.maps.open(undisturbed)
    arm = rd.SrsArm(found.chain)
    rng = np.random.default_rng(5)
    chunks = rng.permutation(len(found.done))[: len(found.done) if FULL else 6]
    swivels = np.linspace(-np.pi, np.pi, 721)
    for chunk in chunks:
        given, stored = found.poses(chunk), found.chunk(chunk)
        scanned = np.zeros(len(given), bool)
        for swivel in swivels:
            scanned |= arm.solve_batch(given, swivel).valid.any(axis=1)
        # What a scan finds is true; what it does not find lies between two of its swivels.
        assert not (scanned & ~stored["reachable"].ravel()).any()
        only = stored["reachable"].ravel() & ~scanned
        assert (stored["swivel_measure"].ravel()[only] < 2 * np.pi / 720 * 8).all()


def test_a_store_of_another_arm_or_setting_is_refused(undisturbed: Path) -> None:
    chain = rd.catalog.load("iiwa14")
    with pytest.raises(rd.RedundancyError, match=r"spacing: 0\.4 in the store, 0\.3 now"):
        rd.maps.capability(chain, undisturbed, **{**SMALL, "spacing": 0.3})
    shorter = chain.with_limits(upper=np.minimum(chain.upper, 1.0))
    with pytest.raises(rd.RedundancyError, match=r"arm\.upper"):
        rd.maps.capability(shorter, undisturbed, **SMALL)
    with pytest.raises(rd.RedundancyError, match="not a store of a map"):
        rd.maps.open(undisturbed.parent)


def test_what_is_refused_leaves_no_store(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    chain, path = rd.catalog.load("iiwa14"), tmp_path / "map.zarr"
    with pytest.raises(rd.RedundancyError, match="needs a scene"):
        rd.maps.capability(chain, path, **SMALL, metrics=("clearance",))
    assert not path.exists()
    path.write_text("a file")
    with pytest.raises(rd.RedundancyError, match="is a file, expected the folder of a map"):
        rd.maps.capability(chain, path, **SMALL)
    with pytest.raises(rd.RedundancyError, match="is a file, expected a folder of placements"):
        rd.maps.place(chain, [np.eye(4)], ((0, 0), (0, 0)), 0.1, 1, out=path)


def test_a_stopped_call_goes_on_where_it_was(undisturbed: Path, tmp_path: Path) -> None:
    chain, path = rd.catalog.load("iiwa14"), tmp_path / "map.zarr"
    first = rd.maps.capability(chain, path, time_limit=0.0, **SMALL)
    assert (first.status, first.computed) == (rd.Status.TIME_LIMIT, 1)
    shares: list[float] = []

    def stop(share: float) -> None:
        shares.append(share)
        if len(shares) == 2:
            raise KeyboardInterrupt

    second = rd.maps.capability(chain, path, progress=stop, **SMALL)
    assert (second.status, second.computed, second.kept) == (rd.Status.CANCELLED, 2, 1)
    third = rd.maps.capability(chain, path, **SMALL)
    assert (third.computed, third.kept) == (third.chunks - 3, 3)
    assert contents(path) == contents(undisturbed)


def test_a_damaged_chunk_is_found_and_done_again(undisturbed: Path, tmp_path: Path) -> None:
    chain, path = rd.catalog.load("iiwa14"), tmp_path / "map.zarr"
    rd.maps.capability(chain, path, **SMALL)
    chunk = next(f for f in sorted((path / "margin" / "c").rglob("*")) if f.is_file())
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 0x40
    chunk.write_bytes(bytes(data))
    assert len(rd.maps.open(path).damaged()) == 1
    job = rd.maps.capability(chain, path, verify=True, **SMALL)
    assert (job.computed, job.kept) == (1, job.chunks - 1)
    assert contents(path) == contents(undisturbed)


def test_two_processes_do_not_fill_one_store(undisturbed: Path) -> None:
    from redundancy.maps._store import Store

    store = Store(undisturbed, write=True)
    code = (
        "import sys, redundancy as rd\n"
        f"try: rd.maps.capability(rd.catalog.load('iiwa14'), {str(undisturbed)!r}, **{SMALL!r})\n"
        "except rd.RedundancyError as error: sys.exit(str(error))\n"
    )
    with store.locked():
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert f"is being filled by another process (process {os.getpid()} on" in run.stderr
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_full_disk_keeps_what_is_done(undisturbed: Path, tmp_path: Path, monkeypatch: Any) -> None:
    from redundancy.maps._store import Store

    chain, path = rd.catalog.load("iiwa14"), tmp_path / "map.zarr"
    write, count = Store.write, 0

    def full(self: Store, chunk: int, data: Any) -> None:
        nonlocal count
        count += 1
        if count == 4:
            self.group = _Full(self.group)  # type: ignore[assignment]
        write(self, chunk, data)

    monkeypatch.setattr(Store, "write", full)
    with pytest.raises(rd.RedundancyError, match="is full: chunk 3 was not stored"):
        rd.maps.capability(chain, path, **SMALL)
    monkeypatch.undo()
    job = rd.maps.capability(chain, path, **SMALL)
    assert job.kept == 3
    assert contents(path) == contents(undisturbed)


class _Full:
    """A group whose arrays cannot be written."""

    def __init__(self, group: Any) -> None:
        self.group = group

    def __getitem__(self, name: str) -> Any:
        if name == "margin":
            return self
        return self.group[name]

    def __setitem__(self, key: Any, value: Any) -> None:
        raise OSError(28, "No space left on device")


FILLING = """
import sys, redundancy as rd
rd.maps.capability(rd.catalog.load("iiwa14"), sys.argv[1], spacing=0.4, directions=6, chunk_poses=60, threads=1)
"""


def test_a_killed_process_loses_nothing(undisturbed: Path, tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    with subprocess.Popen([sys.executable, "-c", FILLING, str(path)]) as process:
        while process.poll() is None and not list((path / "done" / "c").glob("*")):
            time.sleep(0.002)
        process.kill()
    job = rd.maps.capability(rd.catalog.load("iiwa14"), path, **SMALL)
    assert job.kept >= 1
    assert contents(path) == contents(undisturbed)


# --- Dask -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cluster() -> Any:
    """A scheduler with two processes."""
    distributed = pytest.importorskip("distributed", reason="needs the extra 'maps'")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.mark.filterwarnings("ignore")
def test_dask_makes_the_same_bits(cluster: Any, undisturbed: Path, tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    job = rd.maps.capability(rd.catalog.load("iiwa14"), path, client=cluster, **SMALL)
    assert (job.status, job.computed) == (rd.Status.CONVERGED, job.chunks)
    assert contents(path) == contents(undisturbed)


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_loses_nothing(cluster: Any, undisturbed: Path, tmp_path: Path) -> None:
    path, killed = tmp_path / "map.zarr", []

    def kill(share: float) -> None:
        if len(killed) < 2 and share > 0.25 * (1 + len(killed)):
            workers = cluster.run(os.getpid)
            killed.append(next(iter(workers.values())))
            os.kill(killed[-1], signal.SIGKILL)

    job = rd.maps.capability(rd.catalog.load("iiwa14"), path, client=cluster, progress=kill, **SMALL)
    assert (job.status, job.computed, len(killed)) == (rd.Status.CONVERGED, job.chunks, 2)
    assert contents(path) == contents(undisturbed)


@pytest.mark.filterwarnings("ignore")
def test_an_unreachable_scheduler_says_so() -> None:
    pytest.importorskip("distributed", reason="needs the extra 'maps'")
    from redundancy.maps._dask import connect

    with pytest.raises(rd.RedundancyError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:9'"):
        connect("tcp://127.0.0.1:9", timeout=0.5)


# --- placements -------------------------------------------------------------------------------------------


def raster() -> rd.Path:
    """Three strokes, tool down."""
    path = rd.paths.raster(
        (0.4, -0.1, 0.25), 0.2, 0.08, 3, corner=0.03, orientation=np.diag([1.0, -1.0, -1.0])
    )
    return path.resampled(path.length / 49)


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Placements of the iiwa14 for the raster."""
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    folder = tmp_path_factory.mktemp("place") / "place.zarr"
    chain = rd.catalog.load("iiwa14")
    return rd.maps.place(chain, raster(), ((-0.8, 0.4), (-0.3, 0.3)), 0.3, 1, out=folder, refine=0)


def test_placements_are_those_of_an_exhaustive_search(placed: Any) -> None:
    chain = rd.catalog.load("iiwa14")
    assert placed.best
    assert placed.planned < len(placed.placements) == 15
    for p in placed.placements:
        plan = rd.plan(chain.with_base(p.base), raster())
        if p.status is rd.Status.CONVERGED:
            assert plan.status is rd.Status.CONVERGED
            assert p.margin == pytest.approx(plan.margin.min(), abs=1e-9)
        elif p.status is None:
            assert plan.margin.min() <= p.margin + 1e-9
        else:
            assert plan.status is not rd.Status.CONVERGED
            assert p.reason


@pytest.mark.skipif(not FULL, reason="841 plans: needs REDUNDANCY_TEST_FULL=1")
@pytest.mark.parametrize("name", ["iiwa14_raster_pose", "panda_raster_pose"])
def test_the_best_placement_is_that_of_ten_times_as_many(name: str, tmp_path: Path) -> None:
    """The margin of the best of 841 placements is found with a tenth of the plans."""
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    folder = Path(__file__).parents[1] / "golden" / "plan_cases"
    case = next(c for c in json.loads((folder / "cases.json").read_text()) if c["name"] == name)
    chain = rd.Chain.from_urdf(folder / case["urdf"], base=case["base"], tip=case["tip"])
    path = rd.Path(rd.Path.from_csv(folder / case["path"]).poses[::20])
    area, options = ((-0.2, 0.2), (-0.2, 0.2)), {"self_collision": False}
    job = rd.maps.place(chain, path, area, 0.05, 1, out=tmp_path / "place.zarr", **options)
    steps = np.linspace(-0.2, 0.2, 29)
    best = -np.inf
    for x in steps:
        for y in steps:
            plan = rd.plan(chain.with_base(rd.pose((x, y, 0.0)) @ chain.base), path, **options)
            if plan.status is rd.Status.CONVERGED:
                best = max(best, float(plan.margin.min()))
    assert job.best[0].status is rd.Status.CONVERGED
    assert best > 0.0
    assert job.best[0].margin >= min(best - 0.01, 0.99 * best)
    assert job.planned <= len(steps) ** 2 / 10


def test_placements_are_kept(placed: Any) -> None:
    chain = rd.catalog.load("iiwa14")
    options: dict[str, Any] = {
        "region": ((-0.8, 0.4), (-0.3, 0.3)),
        "spacing": 0.3,
        "yaw_steps": 1,
        "out": placed.path,
    }
    again = rd.maps.place(chain, raster(), refine=1, **options)
    assert again.placements[0].margin >= placed.placements[0].margin
    with pytest.raises(rd.RedundancyError, match=r"settings\.path"):
        rd.maps.place(chain, raster().reversed(), refine=0, **options)


def test_placements_name_what_they_cannot_read(tmp_path: Path) -> None:
    chain, options = rd.catalog.load("panda"), {"out": tmp_path / "place.zarr"}
    area = ((-0.2, 0.2), (0.0, 0.0))
    with pytest.raises(TypeError, match="chain: expected a Chain or an arm with a closed form, got str"):
        rd.maps.place("panda", raster(), area, 0.2, 1, **options)
    with pytest.raises(TypeError, match=r"path: expected a Path or poses \(N, 4, 4\), got NoneType"):
        rd.maps.place(chain, None, area, 0.2, 1, **options)
    with pytest.raises(rd.RedundancyError, match=r"path has the shape \(3, 3\)"):
        rd.maps.place(chain, np.eye(3), area, 0.2, 1, **options)


def test_placements_for_single_poses(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    chain = rd.catalog.load("panda")
    given = raster().poses[::20]
    job = rd.maps.place(
        chain, given, ((-0.2, 0.2), (0.0, 0.0)), 0.2, 2, out=tmp_path / "place.zarr", refine=0
    )
    first = job.best[0]
    assert first.margin == pytest.approx(
        rd.maps.best_margin(chain.with_base(first.base), given).min(), abs=1e-9
    )


# --- command line -----------------------------------------------------------------------------------------


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("zarr", reason="needs the extra 'maps'")
    from redundancy import _commands

    out = str(tmp_path / "map.zarr")
    options = ["--spacing", "0.5", "--directions", "4", "--metrics", "reachable"]
    assert _commands.run(["map", "iiwa14", "--out", out, "--show", *options]) == 0
    assert "poses/s" in capsys.readouterr().out
    assert _commands.run(["map", "iiwa14", "--out", out, "--spacing", "0.4"]) == 2
    assert "another arm or setting" in capsys.readouterr().err
    raster().to_csv(tmp_path / "path.csv")
    arguments = [
        "place",
        str(tmp_path / "path.csv"),
        "--robot",
        "iiwa14",
        "--spacing",
        "0.4",
        "--refine",
        "0",
    ]
    out = str(tmp_path / "place.zarr")
    assert _commands.run([*arguments, "--region=-0.2:0.2,0:0", "--out", out]) == 0
    assert "converged" in capsys.readouterr().out
    out = str(tmp_path / "far.zarr")
    assert _commands.run([*arguments, "--region=5:5,5:5", "--out", out]) == 1
    assert "out of reach" in capsys.readouterr().err
