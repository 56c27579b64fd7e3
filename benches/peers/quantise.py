#!/usr/bin/env python3
"""Peers of crates/loden/benches/quantise.rs: median cut by NumPy, k-means by faiss, or by scikit-learn in batches.

usage: python benches/peers/quantise.py FILE [median-cut] [kmeans] [minibatch]    (FILE: u8 [81][81][256][256][3])

Prints a JSON line per measurement with the keys of the Rust benchmark. Seconds include loading, which is also given alone;
the mean error is over every eightieth image.
"""
import json
import resource
import sys
import time

import numpy as np

PAIRS, TEXELS, CLUSTERS = 81 * 81, 256 * 256, 256


def load(path, dtype):
    """(texel, value): transposed in strips of three-byte texels, the fastest of several ways tried."""
    images = np.memmap(path, np.uint8, "r", shape=(PAIRS, TEXELS, 3))
    matrix = np.empty((TEXELS, PAIRS), "V3")
    for first in range(0, TEXELS, 1024):
        strip = np.ascontiguousarray(images[:, first:first + 1024]).view("V3").reshape(PAIRS, 1024)
        matrix[first:first + 1024] = strip.T
    return matrix.view(np.uint8).reshape(TEXELS, -1).astype(dtype, copy=False)


def median_cut(matrix, rule):
    """Median cut by longest edge, by population x longest edge, or level by level."""
    def node(rows, level):
        values = matrix[rows]
        size = values.max(0) - values.min(0)
        cut = int(size.argmax())
        edge = float(size[cut])
        return {"balanced": -level, "population": len(rows) * edge}.get(rule, edge), rows, cut, level

    leaves = [node(np.arange(TEXELS), 0)]
    while len(leaves) < CLUSTERS:
        _, rows, cut, level = leaves.pop(max(range(len(leaves)), key=lambda i: leaves[i][0]))
        order = rows[np.argpartition(matrix[rows, cut], len(rows) // 2)]
        leaves += [node(half, level + 1) for half in (order[:len(order) // 2], order[len(order) // 2:])]
    means = np.stack([matrix[rows].mean(0, dtype=np.float32) for _, rows, _, _ in leaves])
    index = np.empty(TEXELS, int)
    for k, leaf in enumerate(leaves):
        index[leaf[1]] = k
    return index, means


def error(path, index):
    images = np.memmap(path, np.uint8, "r", shape=(PAIRS, TEXELS, 3))
    total, count = 0.0, np.bincount(index, minlength=CLUSTERS)[:, None]
    some = range(0, PAIRS, 80)
    for pair in some:
        image = images[pair].astype(np.float64)
        mean = np.stack([np.bincount(index, image[:, c], CLUSTERS) for c in range(3)], 1) / np.maximum(count, 1)
        total += np.abs(np.rint(mean)[index] - image).mean() / 255
    return total / len(some)


class Clock:
    """Elapsed and processor seconds since creation."""

    def __init__(self):
        self.start = time.perf_counter(), time.process_time()

    def read(self):
        return time.perf_counter() - self.start[0], time.process_time() - self.start[1]


def row(work, clock, loading, path, index):
    seconds, processor = (a + b for a, b in zip(clock.read(), loading))
    rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps({"work": work, "seconds": seconds, "processor_seconds": processor, "loading_seconds": loading[0],
                      "loading_processor_seconds": loading[1], "peak_rss_bytes": rss,
                      "mean_abs_error_of_some": error(path, index)}), flush=True)


def main():
    path, wanted = sys.argv[1], sys.argv[2:] or ["median-cut", "minibatch", "kmeans"]
    clock = Clock()
    matrix = load(path, np.float32 if wanted == ["kmeans"] else np.uint8)
    loading = clock.read()
    if "median-cut" in wanted:
        for rule in ("balanced", "longest-edge", "population"):
            clock = Clock()
            index, _ = median_cut(matrix, rule)
            row(f"median-cut {rule}", clock, loading, path, index)
    if "minibatch" in wanted:
        from sklearn.cluster import MiniBatchKMeans
        clock = Clock()
        model = MiniBatchKMeans(CLUSTERS, batch_size=4096, n_init=1, max_iter=3, random_state=0)
        for first in list(range(0, TEXELS, 4096)) * 3:
            model.partial_fit(matrix[first:first + 4096].astype(np.float32))
        parts = [model.predict(matrix[first:first + 4096].astype(np.float32)) for first in range(0, TEXELS, 4096)]
        row("kmeans in batches", clock, loading, path, np.concatenate(parts))
    if "kmeans" in wanted:
        import faiss
        faiss.omp_set_num_threads(2)
        clock = Clock()
        model = faiss.Kmeans(matrix.shape[1], CLUSTERS, niter=20, seed=1, max_points_per_centroid=TEXELS)
        model.train(matrix.astype(np.float32, copy=False))
        index = model.index.search(matrix.astype(np.float32, copy=False), 1)[1][:, 0]
        row("kmeans", clock, loading, path, index)


main()
