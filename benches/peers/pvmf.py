#!/usr/bin/env python3
"""NumPy peer of crates/loden/benches/pvmf.rs: per-view PCA and decoding of views.

usage: python benches/peers/pvmf.py FILE [encode] [decode]    (FILE: u8 [81][81][256][256][3])

Prints a JSON line per measurement with the keys of the Rust benchmark. Takes NumPy's own number of threads.
"""
import json
import os
import resource
import sys
import time

import numpy as np

VIEWS, LIGHTS, SIDE, COMPONENTS = 81, 81, 256, 4
TEXELS = SIDE * SIDE


def rows(path, view):
    """A view minus its mean, and the mean. Rows are (light, rgb), columns are texels, which is faster than the transpose."""
    size = LIGHTS * TEXELS * 3
    images = np.memmap(path, np.uint8, "r", offset=view * size, shape=(LIGHTS, TEXELS, 3))
    m = np.empty((LIGHTS, 3, TEXELS), np.float32)
    for channel in range(3):
        m[:, channel] = images[:, :, channel]
    m = m.reshape(3 * LIGHTS, TEXELS)
    m *= np.float32(1 / 255)
    mean = m.mean(1)
    m -= mean[:, None]
    return m, mean


def encode_view(path, view):
    """Mean, basis and coefficients of a view."""
    m, mean = rows(path, view)
    values, vectors = np.linalg.eigh(m @ m.T)
    basis = np.ascontiguousarray(vectors[:, ::-1][:, :COMPONENTS])
    return mean, basis, m.T @ basis


def main():
    path, wanted = sys.argv[1], sys.argv[2:] or ["encode", "decode"]
    repeat = int(os.environ.get("LODEN_BENCH_REPEAT", "1"))
    factors = [encode_view(path, view) for view in range(2)]
    if "encode" in wanted:
        seconds = []
        for _ in range(repeat):
            start = time.perf_counter()
            for view in range(VIEWS):
                encode_view(path, view)
            seconds.append(time.perf_counter() - start)
        rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        print(json.dumps({"work": "pvmf encode", "precision": "f32", "seconds": min(seconds),
                          "peak_rss_bytes": rss}), flush=True)
    if "decode" in wanted:
        # rows are (light, rgb) and the mean is a component of ones: the fastest form in NumPy
        out = np.empty((3 * LIGHTS, TEXELS), np.float32)
        ones = np.ones((1, TEXELS), np.float32)
        factors = [(np.concatenate([basis, mean[:, None]], 1), np.concatenate([coefficients.T, ones]))
                   for mean, basis, coefficients in factors]
        seconds = []
        for _ in range(repeat * 5):
            start = time.perf_counter()
            for basis, coefficients in factors:
                np.matmul(basis, coefficients, out=out)
            seconds.append((time.perf_counter() - start) / 2)
        print(json.dumps({"work": "pvmf decode view", "precision": "f32",
                          "gtexel_per_second": LIGHTS * TEXELS / min(seconds) * 1e-9}), flush=True)


if __name__ == "__main__":
    main()
