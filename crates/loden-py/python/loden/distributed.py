"""Compression and other jobs as tasks on a cluster, by Dask (``pip install "loden[dask]"``).

>>> from dask.distributed import Client
>>> import loden.distributed
>>> client = Client(n_workers=4, threads_per_worker=1)                       # doctest: +SKIP
>>> loden.distributed.compress("wool.btf", "wool.loden", method="pvmf", client=client)  # doctest: +SKIP

`compress` writes the same file as `loden.compress`, byte for byte, for any number of workers, also if some of them are
killed. It works in a folder beside the output, which all workers and the client must share, and so must they the source.
Through Dask travel only the numbers of tasks.

`run_task` is what a worker does. It knows nothing of Dask: an array of batch jobs can call it, and ``loden shard`` is the
same on the command line. The other functions run one call of the function of the same name of `loden` for each task.
"""

from __future__ import annotations

import os
import pathlib
import shutil
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from typing import Any, TypeAlias

import loden

from ._loden import _Job, _plan

__all__ = ["acquire", "compare", "compress", "render", "run_task", "sweep", "synthesize"]

_Path = str | PathLike[str]

_Call: TypeAlias = Mapping[str, Any]

#: Seconds between looks at the tasks of a stage.
_PAUSE = 0.02

#: How often a task is run again after its worker has raised an exception. Dask itself repeats those of killed workers.
_RETRIES = 2

_opened: dict[str, tuple[tuple[int, int], _Job]] = {}
_lock = threading.Lock()


def _job(folder: str) -> _Job:
    """The job of a folder; a process opens the source once for all tasks."""
    found = os.stat(os.path.join(folder, "plan.json"))
    key = (found.st_ino, found.st_mtime_ns)
    with _lock:
        if folder not in _opened or _opened[folder][0] != key:
            _opened.clear()
            _opened[folder] = (key, _Job(folder))
        return _opened[folder][1]


def run_task(folder: str, stage: int, task: int, threads: int = 1) -> int:
    """Run task `task` of stage `stage` of the job in `folder`, write its result there, and return `task`.

    A task may run on any machine that sees the folder and the source, and more than once; a result that is there is kept.
    """
    _job(folder).run(stage, task, threads=threads)
    return task


def compress(
    source: _Path,
    output: _Path,
    *,
    client: Any = None,
    method: str = "klt",
    tasks: int | None = None,
    memory: int | str | None = None,
    threads: int = 1,
    folder: _Path | None = None,
    overwrite: bool = False,
    progress: Callable[[str, int, int], object] | None = None,
    show: bool = True,
    **options: Any,
) -> dict[str, Any]:
    """Compress a BTF on the workers of a Dask cluster, with the same bytes as `loden.compress`.

    `client` is a ``dask.distributed.Client``, by default the current one. `tasks` is the largest number of tasks of a stage,
    by default four for each thread of all workers. `memory` limits a worker process, in bytes or as "2G": all the tasks that it
    runs at the same time stay within it together. `threads` is the number of threads of a task. The job's `folder`, new and on
    shared storage, is beside the output by default, and removed in the end, whatever happens. With `show`, the address of
    the dashboard is printed.

    `method` and the other options are those of `loden.compress`: ``quality``, ``max_error``, ``max_bytes``, ``lossless``,
    ``measure``, and the parameters of the method. Returns what it returns.
    """
    client = _client(client)
    output = pathlib.Path(output).absolute()
    folder = pathlib.Path(folder or output.with_name(f".{output.name}.{uuid.uuid4().hex[:8]}.job")).absolute()
    slots = list(client.nthreads().values()) or [1]
    limit = None if memory is None else _bytes(memory) // max(slots)
    if show:
        print(f"loden: {len(slots)} workers, dashboard at {client.dashboard_link}", file=sys.stderr)
    running: dict[int, list[Any]] = {}

    def wait(stage: int, kernel: str, missing: list[int]) -> bool:
        if stage not in running:
            running[stage] = [
                client.submit(
                    run_task, str(folder), stage, task, threads, key=f"{kernel}-{folder.name}-{stage}-{task}", pure=False, retries=_RETRIES
                )
                for task in missing
            ]
        return _all_done(running[stage])

    if folder.exists():
        raise loden.OutputExistsError(f"{folder} exists already", str(folder), None)
    try:
        _plan(
            source,
            output,
            folder,
            tasks=tasks or 4 * sum(slots),
            method=method,
            memory=limit,
            overwrite=overwrite,
            **options,
        )
        done: dict[str, Any] = _Job(folder).compress(wait, progress=progress)
        return done
    finally:
        unfinished = [future for futures in running.values() for future in futures if not future.done()]
        client.cancel(unfinished, force=True)
        _remove(folder)


def acquire(calls: Iterable[_Call], *, client: Any = None) -> list[Any]:
    """Run `loden.acquire` for each of `calls`, dictionaries of its arguments; returns the results in the same order."""
    return _map("acquire", calls, client)


def compare(calls: Iterable[_Call], *, client: Any = None) -> list[Any]:
    """Run `loden.compare` for each of `calls`, dictionaries with ``source`` and ``others``, a list of files."""
    return _map("compare", calls, client)


def sweep(calls: Iterable[_Call], *, client: Any = None) -> list[Any]:
    """Run `loden.sweep` for each of `calls`, dictionaries of its arguments; returns the results in the same order."""
    return _map("sweep", calls, client)


def synthesize(calls: Iterable[_Call], *, client: Any = None) -> list[Any]:
    """Run `loden.synthesize` for each of `calls`, dictionaries of its arguments; returns the results in the same order."""
    return _map("synthesize", calls, client)


def render(calls: Iterable[_Call], *, client: Any = None) -> list[Any]:
    """Run `loden.render` for each of `calls`, dictionaries of its arguments; returns the pictures in the same order."""
    return _map("render", calls, client)


def call(function: str, arguments: _Call) -> Any:
    """Call a function of `loden` as one task; free of Dask's types, as `run_task` is."""
    arguments = dict(arguments)
    # `compare` takes its files by position
    files = [arguments.pop("source"), *arguments.pop("others")] if function == "compare" else []
    return getattr(loden, function)(*files, **arguments)


def _map(function: str, calls: Iterable[_Call], client: Any) -> list[Any]:
    client = _client(client)
    listed = [dict(arguments) for arguments in calls]
    for arguments in listed:
        output = arguments.get("output")
        if output is None:
            continue
        if os.path.exists(output) and not arguments.get("overwrite"):
            raise loden.OutputExistsError(f"{output} exists already", str(output), None)
        # a task may be run again after it has written its file
        if function in ("acquire", "synthesize"):
            arguments["overwrite"] = True
    futures = [
        client.submit(call, function, {"threads": 1, **arguments}, key=f"{function}-{uuid.uuid4().hex}", pure=False, retries=_RETRIES)
        for arguments in listed
    ]
    try:
        return list(client.gather(futures))
    finally:
        client.cancel([future for future in futures if not future.done()], force=True)


def _all_done(futures: list[Any]) -> bool:
    """Whether all futures are finished; waits a moment if not, and raises what one of them has raised.

    Drops those that are finished: their results are files, so it does not matter whether their workers live.
    """
    for future in list(futures):
        state = future.status
        if state == "error":
            raise future.exception()
        if state == "cancelled":
            raise loden.CancelledError("cancelled", None, None)
        if state == "finished":
            futures.remove(future)
    if futures:
        time.sleep(_PAUSE)
    return not futures


def _client(client: Any) -> Any:
    if client is not None:
        return client
    from distributed import get_client

    return get_client()


def _bytes(amount: int | str) -> int:
    """Bytes of an amount such as "512M"; K, M and G are powers of 1024."""
    if isinstance(amount, int):
        return amount
    factor = {"k": 1 << 10, "m": 1 << 20, "g": 1 << 30}.get(amount[-1:].lower())
    digits = amount[:-1] if factor else amount
    if not digits.isdigit():
        raise loden.ParameterError(f"memory: found {amount!r}, expected an amount such as 512M", None, "memory")
    return int(digits) * (factor or 1)


def _remove(folder: pathlib.Path) -> None:
    """Remove a job's folder, into which tasks that were cancelled may still be writing."""
    for _ in range(100):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.05)
