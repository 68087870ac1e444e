"""Many verdicts through Dask: killed and resumed, compared with a store that was left alone, with rate and memory.

    python benches/python/maps_dask.py [poses]        # 1e6 by default, 1e8 for the full size

1. A store is filled through Dask (a scheduler and two workers of one thread, as processes) while a worker and then the
   client are killed with SIGKILL; the same call is made again and goes on.
2. Another store is filled by one call of the bare core, two threads, without interruption. Both run in turns of some
   seconds (the other one is stopped), so that other work on the machine slows both alike.
3. The files of both are compared byte by byte; rates and the peak memory of all processes are printed.
"""

import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import redundancy as rd

REGION = ((-0.85, 0.85), (-0.85, 0.85), (-0.45, 1.25))
DIRECTIONS = 100
WORKERS = 2


def options(poses: int) -> dict[str, Any]:
    """A grid over a cube around the arm with about so many poses."""
    per_axis = max(2, round((poses / DIRECTIONS) ** (1 / 3)))
    return {
        "spacing": 1.7 / (per_axis - 1) * (1 - 1e-12),
        "directions": DIRECTIONS,
        "metrics": ("reachable",),
        "region": REGION,
    }


def fill(folder: str, settings: str, address: str) -> None:
    """One call in a process of its own; prints what it did."""
    given = json.loads(settings)
    client = None
    if address:
        from redundancy.maps._dask import connect  # noqa: PLC0415 - an extra

        client = connect(address)
    job = rd.maps.capability(rd.catalog.load("iiwa14"), folder, client=client, threads=WORKERS, **given)
    print(
        json.dumps(
            {"status": str(job.status), "computed": job.computed, "poses": job.poses, "seconds": job.seconds}
        )
    )


class Memory:
    """The largest resident memory of processes while it runs, MiB."""

    def __init__(self) -> None:
        self.peaks: dict[str, int] = {}
        self.processes: dict[str, int] = {}
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def _watch(self) -> None:
        while not self.stop.wait(0.05):
            for name, process in list(self.processes.items()):
                try:
                    status = Path(f"/proc/{process}/status").read_text()
                except OSError:
                    continue
                for line in status.splitlines():
                    if line.startswith("VmHWM"):
                        self.peaks[name] = max(self.peaks.get(name, 0), int(line.split()[1]) // 1024)


class Cluster:
    """A scheduler and workers as processes of their own, which can be killed one by one."""

    def __init__(self, folder: Path, memory: Memory) -> None:
        self.folder, self.memory, self.workers = folder, memory, []  # type: ignore[var-annotated]
        self.file = folder / "scheduler.json"
        # A second of a busy machine must not look like a dead worker.
        self.env = {**os.environ, "OMP_NUM_THREADS": "1", "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "60s"}
        self.scheduler = self._start(
            "scheduler", ["scheduler", "--scheduler-file", str(self.file), "--port", "0", "--no-dashboard"]
        )
        while not self.file.exists():
            time.sleep(0.1)
        self.address: str = json.loads(self.file.read_text())["address"]
        for _ in range(WORKERS):
            self.add()

    def _start(self, name: str, arguments: list[str]) -> subprocess.Popen[bytes]:
        log = (self.folder / f"{name}.log").open("wb")
        process = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]],
            env=self.env,
            stdout=log,
            stderr=log,
        )
        self.memory.processes[name] = process.pid
        return process

    def add(self) -> None:
        """One more worker."""
        name = f"worker {len(self.workers)}"
        self.workers.append(
            self._start(
                name,
                [
                    "worker",
                    self.address,
                    "--nthreads",
                    "1",
                    "--no-nanny",
                    "--no-dashboard",
                    "--local-directory",
                    str(self.folder),
                ],
            )
        )

    def close(self) -> None:
        """Ends what is left."""
        for process in [*self.workers, self.scheduler]:
            if process.poll() is None:
                process.terminate()
        for process in [*self.workers, self.scheduler]:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def call(
    name: str, memory: Memory, folder: Path, settings: dict[str, Any], address: str
) -> subprocess.Popen[str]:
    """Starts a call in a process of its own."""
    process = subprocess.Popen(
        [sys.executable, __file__, "fill", str(folder), json.dumps(settings), address],
        stdout=subprocess.PIPE,
        text=True,
    )
    memory.processes[name] = process.pid
    return process


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    """What a call printed."""
    out = process.communicate()[0]
    if process.returncode:
        raise SystemExit(f"a call ended with {process.returncode}")
    found: dict[str, Any] = json.loads(out)
    return found


def chunks_done(folder: Path) -> int:
    """Number of chunks that are done."""
    return sum(1 for _ in (folder / "done" / "c").glob("*"))


def await_chunks(process: subprocess.Popen[str], folder: Path, count: int) -> None:
    """Waits until a running call has done so many chunks."""
    while chunks_done(folder) < count:
        if process.poll() is not None:
            raise SystemExit(f"the call ended with {process.returncode} before it was interrupted")
        time.sleep(0.01)


def in_turns(
    groups: list[list[int]],
    jobs: list[subprocess.Popen[str]],
    stores: list[Path],
    chunks: int,
    seconds: float,
) -> tuple[list[float], list[float]]:
    """Lets two jobs run in turns until both are done: chunks per second of each, and the ratio in each turn."""
    wake(groups[1], signal.SIGSTOP)
    counts, times, ratios = [0, 0], [0.0, 0.0], []
    for turn in (0, 1):  # their start does not count
        wake(groups[turn], signal.SIGCONT)
        await_chunks(jobs[turn], stores[turn], chunks_done(stores[turn]) + 2)
        wake(groups[turn], signal.SIGSTOP)
    while all(chunks_done(store) < chunks for store in stores):
        pair = []
        for turn in (0, 1):
            before, begin = chunks_done(stores[turn]), time.perf_counter()
            wake(groups[turn], signal.SIGCONT)
            while time.perf_counter() - begin < seconds and chunks_done(stores[turn]) < chunks:
                time.sleep(0.02)
            wake(groups[turn], signal.SIGSTOP)
            done, spent = chunks_done(stores[turn]) - before, time.perf_counter() - begin
            counts[turn] += done
            times[turn] += spent
            pair.append(done / spent)
        ratios.append(pair[0] / pair[1] if pair[1] else float("inf"))
    for group in groups:
        wake(group, signal.SIGCONT)
    return [count / spent for count, spent in zip(counts, times, strict=True)], ratios


def wake(group: list[int], how: signal.Signals) -> None:
    """Stops processes or lets them go on; those that have ended do not matter."""
    for process in group:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, how)


def contents(store: Path) -> dict[str, str]:
    """Every file of a store by its checksum, but the lock, and what zarr was writing when its process was killed."""
    files = (
        f for f in sorted(store.rglob("*")) if f.is_file() and f.name != "lock" and f.suffix != ".partial"
    )
    return {str(f.relative_to(store)): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


def measure(poses: int) -> bool:
    """Fills both stores in turns; True when all that is asked for holds."""
    settings = options(poses)
    memory = Memory()
    with tempfile.TemporaryDirectory(prefix="maps-") as name:
        folder = Path(name)
        through, alone = folder / "dask.zarr", folder / "alone.zarr"
        cluster = Cluster(folder, memory)
        try:
            # A worker that is killed, and the client that is killed: the same call goes on.
            chunks = rd.maps.capability(
                rd.catalog.load("iiwa14"), folder / "empty.zarr", time_limit=0.0, **settings
            ).chunks
            print(f"{chunks} chunks, load {os.getloadavg()[0]:.1f}")
            job = call("client 0", memory, through, settings, cluster.address)
            await_chunks(job, through, max(1, chunks // 20))
            cluster.workers[0].send_signal(signal.SIGKILL)
            at_worker = chunks_done(through)
            cluster.add()
            await_chunks(job, through, max(at_worker + 1, chunks // 10))
            job.send_signal(signal.SIGKILL)
            job.wait()
            at_client = chunks_done(through)
            print(f"worker killed at {at_worker} chunks, client at {at_client}")
            # The rest through Dask, and all of it by the bare core, in turns: one is stopped while the other one runs.
            rest = call("client", memory, through, settings, cluster.address)
            bare = call("alone", memory, alone, settings, "")
            rates, ratios = in_turns(
                [
                    [rest.pid, *(w.pid for w in cluster.workers if w.poll() is None), cluster.scheduler.pid],
                    [bare.pid],
                ],
                [rest, bare],
                [through, alone],
                chunks,
                max(1.0, min(5.0, poses / 4e6)),
            )
            for process in (rest, bare):
                print(json.dumps(result(process)))
            per_chunk = rd.maps.open(alone).poses(0).shape[0]
            print(
                f"through Dask {rates[0] * per_chunk:,.0f} poses/s, bare core {rates[1] * per_chunk:,.0f}/s, "
                f"ratio {rates[0] / rates[1]:.3f}"
            )
            print(f"{len(ratios)} turns, median ratio {np.median(ratios):.3f}, load {os.getloadavg()[0]:.1f}")
        finally:
            cluster.close()
            memory.stop.set()
        equal = contents(through) == contents(alone)
        found = rd.maps.open(through)
        count = found.settings["grid"]["shape"]
        total = count[0] * count[1] * count[2] * DIRECTIONS
        size = sum(f.stat().st_size for f in through.rglob("*") if f.is_file())
        print(
            f"{total} verdicts, {size / total:.3f} bytes each, stores {'bit-equal' if equal else 'DIFFER'}, "
            f"all done {bool(found.done.all())}"
        )
        print("peak resident memory, MiB:", memory.peaks)
        small = all(
            peak < 1024
            for process, peak in memory.peaks.items()
            if not process.startswith(("client", "alone"))
        )
        return equal and small and bool(found.done.all())


if __name__ == "__main__":
    if sys.argv[1:2] == ["fill"]:
        fill(*sys.argv[2:])
    else:
        sys.exit(0 if measure(round(float(sys.argv[1] if len(sys.argv) > 1 else 1e6))) else 1)
