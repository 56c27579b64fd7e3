#!/usr/bin/env python3
"""Measures the Python package beside what laboratories write by hand, in turn, and prints a Markdown table.

usage: python benches/python.py ARCHIVE.zip COMPRESSED.loden

Needs the package installed (`make wheel`), numba, Pillow and SciPy; `torch` is used for its row if it is installed. ARCHIVE.zip
holds JPEGs of a BTF on the Bonn directions, COMPRESSED.loden is the same compressed. Every figure comes from a process of its own,
with two threads; the memory is its peak resident memory, less that of the process before it opened the file.
"""
import itertools
import json
import os
import pathlib
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
POINTS, BATCH, REUSE, KEPT, BATCHES = 1_000_000, 8192, 128, 16, 20


def memory(field="VmHWM"):
    """Peak resident memory in MB."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(field)) / 1024


def fastest(work, repeat=3):
    """Seconds of the fastest run after a first one."""
    work()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def queries():
    import numpy as np

    random = np.random.default_rng(0)

    def cosine():
        p = random.random((POINTS, 2))
        r, phi = np.sqrt(p[:, 0]), 2 * np.pi * p[:, 1]
        return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - p[:, 0])], 1).astype(np.float32)

    return random.random((POINTS, 2), np.float32), cosine(), cosine()


def ours(path):
    """`eval` of the package, of an archive or a compressed file."""
    import loden

    uv, wi, wo = queries()
    before = memory("VmRSS")
    btf = loden.open(path)
    seconds = fastest(lambda: btf.eval(uv, wi, wo))
    return {"seconds": seconds, "mb": memory() - before, "mean": float(btf.eval(uv, wi, wo).mean())}


def decoded(path):
    """All images as stored, (view, light, y, x, rgb)."""
    import loden
    import numpy as np

    btf = loden.open(path)
    shape = btf.shape
    values = np.empty(shape, np.uint8)
    for view in range(shape[0]):
        for light in range(shape[1]):
            values[view, light] = btf.stored(view, light)
    curve = np.arange(256, dtype=np.float32) / 255
    curve = np.where(curve <= 0.04045, curve / 12.92, ((curve + 0.055) / 1.055) ** 2.4).astype(np.float32)
    if btf.encoding.startswith("gamma"):
        curve = (np.arange(256) / 255.0) ** float(btf.encoding[5:])
    return btf, values, curve.astype(np.float32)


def with_numba(path):
    """Triangles of directions and four texels, in a loop that numba compiles for two threads, over the decoded array."""
    import numba
    import numpy as np

    sys.path.insert(0, str(ROOT / "benches" / "peers"))
    from evaluate import directions, stencil, tables

    @numba.njit(fastmath=True, parallel=True)
    def evaluate(uv, wi, wo, values, curve, mesh, out):
        triangles, neighbours, inverse, start, hull, hull_phi, points = mesh
        height, width = values.shape[2], values.shape[3]
        for part in numba.prange(64):
            li, vi = np.empty(3, np.int32), np.empty(3, np.int32)
            lw, vw = np.empty(3, np.float32), np.empty(3, np.float32)
            for q in range(part * uv.shape[0] // 64, (part + 1) * uv.shape[0] // 64):
                fade = stencil(wi[q, 0], wi[q, 1], wi[q, 2], triangles, neighbours, inverse, start, hull, hull_phi, points, li, lw)
                stencil(wo[q, 0], wo[q, 1], wo[q, 2], triangles, neighbours, inverse, start, hull, hull_phi, points, vi, vw)
                x, y = uv[q, 0] * width - np.float32(0.5), (1 - uv[q, 1]) * height - np.float32(0.5)
                x0, y0 = int(np.floor(x)), int(np.floor(y))
                fx, fy = x - x0, y - y0
                r = g = b = np.float32(0)
                for i in range(3):
                    for j in range(3):
                        for k in range(4):
                            tx, ty = (x0 + k % 2) % width, (y0 + k // 2) % height
                            wx, wy = (fx if k % 2 else 1 - fx), (fy if k // 2 else 1 - fy)
                            w = vw[i] * lw[j] * wx * wy
                            texel = values[vi[i], li[j], ty, tx]
                            r += w * curve[texel[0]]
                            g += w * curve[texel[1]]
                            b += w * curve[texel[2]]
                out[q, 0], out[q, 1], out[q, 2] = fade * r, fade * g, fade * b

    uv, wi, wo = queries()
    before = memory("VmRSS")
    _, values, curve = decoded(path)
    mesh = tables(directions())
    out = np.empty((POINTS, 3), np.float32)
    numba.set_num_threads(min(2, os.cpu_count()))
    seconds = fastest(lambda: evaluate(uv, wi, wo, values, curve, mesh, out))
    return {"seconds": seconds, "mb": memory() - before, "mean": float(out.mean())}


def with_cdist(path):
    """The four nearest measured pairs by `cdist` and `topk`, weights of distance^-4, nearest texel: torch, or SciPy without it."""
    import numpy as np

    uv, wi, wo = queries()
    before = memory("VmRSS")
    btf, values, curve = decoded(path)
    import loden

    views, lights = loden.directions(btf.views), loden.directions(btf.lights)
    pairs = np.concatenate([np.repeat(views, len(lights), 0), np.tile(lights, (len(views), 1))], 1)
    flat = values.reshape(-1, *values.shape[2:])
    height, width = values.shape[2:4]
    x, y = (uv[:, 0] * width).astype(int) % width, ((1 - uv[:, 1]) * height).astype(int) % height
    try:
        import torch

        torch.set_num_threads(2)
        tensor, name = torch.from_numpy(pairs), "torch"

        def nearest(wanted):
            found = torch.topk(torch.cdist(torch.from_numpy(wanted), tensor), 4, largest=False)
            return found.values.numpy(), found.indices.numpy()
    except ImportError:
        from scipy.spatial.distance import cdist

        name = "SciPy"

        def nearest(wanted):
            distance = cdist(wanted, pairs)
            index = np.argpartition(distance, 4, axis=1)[:, :4]
            return np.take_along_axis(distance, index, 1), index

    # the whole million takes minutes: a part of it, scaled
    part = POINTS // 20

    def work():
        for first in range(0, part, BATCH):
            rows = slice(first, min(first + BATCH, part))
            distance, index = nearest(np.concatenate([wo[rows], wi[rows]], 1))
            weight = 1 / np.maximum(distance, 1e-6) ** 4
            weight /= weight.sum(1, keepdims=True)
            (curve[flat[index, y[rows, None], x[rows, None]]] * weight[..., None]).sum(1)

    return {"seconds": fastest(work, 1) * POINTS / part, "mb": memory() - before, "with": name}


def our_batches(path):
    """`Btf.batches`."""
    import loden

    before = memory("VmRSS")
    source = loden.open(path).batches(BATCH, seed=1, reuse=REUSE)
    work = lambda: sum(1 for _ in itertools.islice(source, BATCHES))
    return {"seconds": fastest(work) / BATCHES, "mb": memory() - before}


def loader(path):
    """A data set as laboratories write it: images decoded by Pillow inside two workers, 16 kept, 128 texels of each at a time."""
    import concurrent.futures
    import functools
    import io
    import re
    import zipfile

    import numpy as np
    from PIL import Image

    before = memory("VmRSS")
    archive = zipfile.ZipFile(path)
    names = [name for name in archive.namelist() if name.lower().endswith((".jpg", ".jpeg"))]
    angles = [tuple(map(float, re.findall(r"\d+", pathlib.PurePath(name).name)[:4])) for name in names]
    data = {name: archive.read(name) for name in names}
    curve = ((np.arange(256) / 255.0) ** 2.2).astype(np.float32)

    @functools.lru_cache(KEPT)
    def image(index):
        return np.asarray(Image.open(io.BytesIO(data[names[index]])))

    def vector(theta, phi):
        theta, phi = np.radians(theta), np.radians(phi)
        return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], np.float32)

    def part(seed):
        random = np.random.default_rng(seed)
        index = int(random.integers(len(names)))
        texels = image(index)
        height, width = texels.shape[:2]
        x, y = random.integers(width, size=REUSE), random.integers(height, size=REUSE)
        uv = np.stack([(x + 0.5) / width, 1 - (y + 0.5) / height], 1).astype(np.float32)
        tl, pl, tv, pv = angles[index]
        wi, wo = np.broadcast_to(vector(tl, pl), (REUSE, 3)), np.broadcast_to(vector(tv, pv), (REUSE, 3))
        return uv, wi, wo, curve[texels[y, x]]

    seeds = itertools.count()
    with concurrent.futures.ThreadPoolExecutor(2) as workers:

        def work():
            for _ in range(BATCHES):
                parts = list(workers.map(part, itertools.islice(seeds, BATCH // REUSE)))
                [np.concatenate(column) for column in zip(*parts)]

        return {"seconds": fastest(work) / BATCHES, "mb": memory() - before}


def imported(name):
    """Importing a module in a fresh process, less the interpreter's own start; the fastest of ten."""
    run = lambda code: min(timed([sys.executable, "-c", code]) for _ in range(10))
    return {"seconds": run(f"import {name}") - run("pass")}


def timed(command):
    start = time.perf_counter()
    subprocess.run(command, check=True)
    return time.perf_counter() - start


def apart(function, *arguments):
    """A function of this file in a process of its own."""
    env = {**os.environ, "RAYON_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}
    for name in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
        env.pop(name, None)
    command = [sys.executable, __file__, "--only", function, *map(str, arguments)]
    done = subprocess.run(command, env=env, stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    print(function, *arguments, found, file=sys.stderr, flush=True)
    return found


def main():
    archive, compressed = sys.argv[1:]
    rows = [
        ("eval, archive", apart("ours", archive)),
        ("eval, compressed", apart("ours", compressed)),
        ("numba over the decoded array", apart("with_numba", archive)),
        ("cdist and the four nearest", apart("with_cdist", archive)),
        ("batches of 8192", apart("our_batches", archive)),
        ("a loader with decoded images", apart("loader", archive)),
        ("import loden", apart("imported", "loden")),
        ("import numpy", apart("imported", "numpy")),
    ]
    print("| what | seconds | MB |\n|---|---|---|")
    for name, row in rows:
        print(f"| {name} | {row['seconds']:.3g} | {row.get('mb', 0):.0f} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--only"]:
        print(json.dumps(globals()[sys.argv[2]](*sys.argv[3:])))
    else:
        main()
