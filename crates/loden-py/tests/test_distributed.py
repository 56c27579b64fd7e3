"""Compression on workers of Dask gives the bytes of `loden.compress`, whatever happens to the workers."""

import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import loden
import loden.distributed

distributed = pytest.importorskip("distributed")

METHODS: dict[str, dict[str, Any]] = {
    "pvmf": {"components": 2},
    "pca": {"components": 6},
    "klt": {},
    "kmeans": {"clusters": 12},
}


@pytest.fixture(scope="module")
def raw(folder: pathlib.Path, archive: pathlib.Path) -> pathlib.Path:
    """The measured twill as a raw array, which workers read by rows."""
    path = folder / "twill.toml"
    loden.convert(archive, path)
    return path


@pytest.fixture(scope="module")
def single(folder: pathlib.Path, raw: pathlib.Path) -> dict[str, bytes]:
    """The files that one process writes."""
    files = {}
    for method, params in METHODS.items():
        path = folder / f"single-{method}.loden"
        loden.compress(raw, path, method=method, **params)
        files[method] = path.read_bytes()
    return files


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    options = {"threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=2, processes=True, **options) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def client(cluster: Any) -> Iterator[Any]:
    with distributed.Client(cluster) as client:
        yield client


def hidden(folder: pathlib.Path) -> list[str]:
    return [entry.name for entry in folder.iterdir() if entry.name.startswith(".")]


@pytest.mark.parametrize("method", METHODS)
def test_bytes_of_two_workers(
    method: str, client: Any, raw: pathlib.Path, single: dict[str, bytes], tmp_path: pathlib.Path
) -> None:
    path = tmp_path / "a.loden"
    report = loden.distributed.compress(raw, path, client=client, method=method, show=False, **METHODS[method])
    assert path.read_bytes() == single[method]
    assert report["bytes"] == len(single[method])
    assert hidden(tmp_path) == []


def test_bytes_of_one_worker(raw: pathlib.Path, single: dict[str, bytes], tmp_path: pathlib.Path) -> None:
    path = tmp_path / "a.loden"
    with distributed.Client(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as client:
        loden.distributed.compress(raw, path, client=client, method="klt", tasks=3, show=False)
    assert path.read_bytes() == single["klt"]


@pytest.mark.parametrize("moment", [0, 1, 4])
def test_a_killed_worker_changes_nothing(
    moment: int, cluster: Any, client: Any, raw: pathlib.Path, single: dict[str, bytes], tmp_path: pathlib.Path
) -> None:
    """Kills a worker when it has work of the stage `moment`, by the process id that the cluster has started."""
    path = tmp_path / "a.loden"
    client.wait_for_workers(2)
    pids = client.run(os.getpid)
    killed = threading.Event()

    def kill() -> None:
        while not killed.is_set():
            busy = [name for name, keys in client.processing().items() if any(f"-{moment}-" in str(key) for key in keys)]
            if busy and busy[0] in pids:
                os.kill(pids[busy[0]], signal.SIGKILL)
                killed.set()
            time.sleep(0.001)

    watcher = threading.Thread(target=kill, daemon=True)
    watcher.start()
    loden.distributed.compress(raw, path, client=client, method="klt", tasks=12, show=False)
    done = killed.is_set()
    killed.set()
    watcher.join()
    assert path.read_bytes() == single["klt"]
    assert done, "the job was over before a worker could be killed"
    assert hidden(tmp_path) == []


def test_a_cancelled_job_leaves_nothing(client: Any, raw: pathlib.Path, tmp_path: pathlib.Path) -> None:
    class Stop(Exception):
        pass

    def progress(name: str, done: int, total: int) -> None:
        if done > 0:
            raise Stop

    with pytest.raises(Stop):
        loden.distributed.compress(raw, tmp_path / "a.loden", client=client, progress=progress, show=False)
    assert list(tmp_path.iterdir()) == []


def test_errors_are_those_of_the_library(client: Any, raw: pathlib.Path, tmp_path: pathlib.Path) -> None:
    def run(**options: Any) -> None:
        loden.distributed.compress(raw, tmp_path / "a.loden", client=client, show=False, **options)

    with pytest.raises(loden.ParameterError, match="cannot be distributed"):
        run(method="dfmf")
    with pytest.raises(loden.ParameterError, match="memory: found 30.0 MiB, expected at least"):
        run(method="pvmf", memory="30M")
    with pytest.raises(loden.ParameterError, match="memory: found 'much'"):
        run(memory="much")
    (tmp_path / "a.loden").write_bytes(b"")
    with pytest.raises(loden.OutputExistsError):
        run()


def test_a_worker_needs_no_dask(raw: pathlib.Path, single: dict[str, bytes], tmp_path: pathlib.Path) -> None:
    from loden._loden import _Job, _plan

    job, path = tmp_path / "job", tmp_path / "a.loden"
    _plan(raw, path, job, tasks=2, method="kmeans", **METHODS["kmeans"])

    def wait(stage: int, kernel: str, missing: list[int]) -> bool:
        assert sorted(loden.distributed.run_task(str(job), stage, task) for task in missing) == missing
        return True

    _Job(job).compress(wait)
    assert path.read_bytes() == single["kmeans"]


def test_memory_is_kept(raw: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """A task of a BTF of 80 MB stays within 75 MiB."""
    from loden._loden import _Job, _plan

    large, size, limit = tmp_path / "large.toml", 64, 75 << 20
    texels = np.arange(size * size, dtype=np.float32)
    waves = np.sin(texels[:, None] * np.array([0.11, 0.013, 0.37]) + np.arange(6561)[:, None, None] * 0.01)
    (100 + 60 * waves * np.cos(texels * 0.05)[:, None]).astype(np.uint8).tofile(large.with_suffix(".u8"))
    description = raw.read_text().replace('"twill.u8"', '"large.u8"')
    large.write_text(re.sub(r"shape = \[[^]]*\]", f"shape = [81, 81, {size}, {size}, 3]", description))
    job = tmp_path / "job"
    _plan(large, tmp_path / "a.loden", job, tasks=2, method="klt", memory=limit, components=16)
    worker = (
        "import pathlib, sys, loden.distributed as d\n"
        "def peak(): return int(pathlib.Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])\n"
        "before = peak()\n"
        "for task in sys.argv[3:]: d.run_task(sys.argv[1], int(sys.argv[2]), int(task))\n"
        "print((peak() - before) * 1024)\n"
    )
    peaks = {}

    def wait(stage: int, kernel: str, missing: list[int]) -> bool:
        command = [sys.executable, "-c", worker, str(job), str(stage), *map(str, missing)]
        peaks[stage, kernel] = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        return True

    _Job(job).compress(wait)
    assert max(peaks.values()) <= limit, peaks
    assert len(peaks) > 4


def test_many_materials(client: Any, raw: pathlib.Path, archive: pathlib.Path, tmp_path: pathlib.Path) -> None:
    samples = [{"sample": name, "output": tmp_path / f"{name}.zip", "size": 8, "spp": 1} for name in ("twill", "gravel")]
    loden.distributed.acquire(samples, client=client)
    assert all(loden.open(call["output"]).shape[-3:-1] == (8, 8) for call in samples)
    with pytest.raises(loden.OutputExistsError):
        loden.distributed.acquire(samples, client=client)
    compared = loden.distributed.compare([{"source": raw, "others": [archive]}] * 2, client=client)
    assert [rows[0]["mean_abs_error"] for rows in compared] == [0, 0]
    pictures = loden.distributed.render([{"subject": raw, "size": (12, 8), "spp": 2, "seed": seed} for seed in (1, 2)], client=client)
    assert np.array_equal(pictures[1], loden.render(raw, size=(12, 8), spp=2, seed=2))
