#!/usr/bin/env python3
"""Compression on Dask: against `dask.array.linalg.svd_compressed`, against one process, and what a larger BTF would need.

usage: clusters.py RAW.toml [--workers 1,2,4] [--components 4] [--skip-peer]

RAW.toml is a raw array of bytes (`loden convert wool.zip wool.toml`). Prints JSON lines, and a table of what is predicted for
larger measurements from the measured rates. Needs the Python packages of benches/requirements.txt and the wheel of `make wheel`.
"""
import argparse
import json
import os
import pathlib
import tempfile
import threading
import time
import tomllib

import numpy as np
from distributed import Client, LocalCluster

import loden
import loden.distributed


def peak(client):
    """Peak resident bytes of every worker since it started."""

    def of_worker():
        text = pathlib.Path("/proc/self/status").read_text()
        return int(text.split("VmHWM:")[1].split()[0]) * 1024

    return max(client.run(of_worker).values())


def array_of(path):
    """The raw numbers, shape (view, light, y, x, rgb), mapped."""
    description = tomllib.loads(path.read_text())
    return np.memmap(path.with_name(description["data"]), np.uint8, "r", shape=tuple(description["shape"]))


def factor_view(data, shape, view, components, iterations):
    """What labs write: dask.array.linalg on one view; returns the squared error."""
    import dask.array as da

    values = np.memmap(data, np.uint8, "r", shape=shape)[view]
    lights, height, width, _ = values.shape
    matrix = da.from_array(values, chunks=(lights, max(height // 4, 1), width, 3)).astype(np.float32) / 255
    matrix = matrix.transpose(1, 2, 0, 3).reshape(height * width, lights * 3)
    mean = matrix.mean(0)
    centred = matrix - mean
    u, s, v = da.linalg.svd_compressed(centred, components, n_power_iter=iterations, seed=0)
    return (abs(centred - (u * s) @ v)).mean()


def peer(client, path, components, iterations):
    """PVMF by svd_compressed, view by view."""
    raw = array_of(path)
    start = time.perf_counter()
    errors = [float(factor_view(raw.filename, raw.shape, view, components, iterations).compute()) for view in range(raw.shape[0])]
    return {"seconds": time.perf_counter() - start, "mean_abs_error": float(np.mean(errors)), "peak_bytes": peak(client)}


def ours(client, path, folder, method, **params):
    watcher = Traffic(folder)
    start = time.perf_counter()
    report = loden.distributed.compress(path, folder / "a.loden", client=client, method=method, show=False, overwrite=True, **params)
    seconds = time.perf_counter() - start
    error = report["error"] or {}
    return {"seconds": seconds, "mean_abs_error": error.get("mean_abs_error"), "peak_bytes": peak(client), **watcher.stop()}


class Traffic:
    """Watches the largest size of what processes exchange through the folder of a job."""

    def __init__(self, folder):
        self.folder, self.largest, self.files, self.running = folder, 0, 0, True
        self.thread = threading.Thread(target=self.watch)
        self.thread.start()

    def watch(self):
        while self.running:
            sizes = []
            for root, _, names in os.walk(self.folder):
                if ".job" in root:
                    for name in names:
                        try:
                            sizes.append(os.path.getsize(os.path.join(root, name)))
                        except OSError:
                            pass
            self.largest, self.files = max(self.largest, sum(sizes)), max(self.files, len(sizes))
            time.sleep(0.2)

    def stop(self):
        self.running = False
        self.thread.join()
        return {"folder_bytes": self.largest, "folder_files": self.files}


def overhead(client, count=200):
    """Seconds that the scheduler takes for a task that does nothing."""
    start = time.perf_counter()
    client.gather([client.submit(int, i, pure=False) for i in range(count)])
    return (time.perf_counter() - start) / count


def predict(bytes_per_second, per_task, workers, passes):
    """Time for larger measurements, and the size of a task at which the scheduler takes a tenth of it."""
    print("| data | workers | tasks a pass | seconds a pass | of them scheduler |")
    print("|---|---|---|---|---|")
    for name, size in (("12 GB", 12e9), ("2.3 TB", 2.3e12), ("100 x 12 GB", 1.2e12)):
        for count in (workers, 16, 256):
            tasks = max(4 * count, int(size / 256e6))
            seconds = size / bytes_per_second / count
            print(f"| {name} | {count} | {tasks} | {seconds + tasks * per_task:.0f} | {100 * tasks * per_task / (seconds + tasks * per_task):.1f} % |")
    least = 10 * per_task * bytes_per_second
    print(f"with 256 workers, tasks of at least {256 * least / 1e6:.0f} MB keep the scheduler below a tenth")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=pathlib.Path)
    parser.add_argument("--workers", default="1,2,4")
    parser.add_argument("--components", type=int, default=4)
    parser.add_argument("--skip-peer", action="store_true")
    options = parser.parse_args()
    size = array_of(options.source).nbytes
    with tempfile.TemporaryDirectory(dir=options.source.absolute().parent) as folder:
        folder = pathlib.Path(folder)
        for method, params in (("klt", {}), ("pvmf", {"components": options.components})):
            start = time.perf_counter()
            loden.compress(options.source, folder / "b.loden", method=method, overwrite=True, **params)
            print(json.dumps({"what": f"{method}, one process", "seconds": time.perf_counter() - start}), flush=True)
        rate, per_task, most = 0.0, 0.0, 1
        for most in map(int, options.workers.split(",")):
            with LocalCluster(n_workers=most, threads_per_worker=1, dashboard_address=":0") as cluster, Client(cluster) as client:
                per_task = overhead(client)
                for method, params in (("klt", {}), ("pvmf", {"components": options.components})):
                    row = ours(client, options.source, folder, method, **params)
                    print(json.dumps({"what": f"{method}, {most} workers", **row, "task_seconds": per_task}), flush=True)
                # pvmf reads the source once, and once for the error
                rate = 2 * size / row["seconds"] / most
            if most == 2 and not options.skip_peer:
                for iterations in (0, 2):
                    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster, Client(cluster) as client:
                        row = peer(client, options.source, options.components, iterations)
                        print(json.dumps({"what": f"svd_compressed, n_power_iter={iterations}, 2 workers", **row}), flush=True)
        predict(rate, per_task, most, 2)


if __name__ == "__main__":
    main()
