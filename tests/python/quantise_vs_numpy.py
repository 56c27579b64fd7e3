#!/usr/bin/env python3
"""Checks k-means, median cut and local PCA against scikit-learn and NumPy.

usage: python tests/python/quantise_vs_numpy.py

The texels are those of twill.zip (LODEN_DATA), or of the simulated sample twill, 64 x 64.
Files are decoded here by NumPy and safetensors alone, as docs/format.md describes.

- k-means: scikit-learn from the same regular start, in all dimensions of 12 x 12 of the directions: squared errors equal to 1e-4.
- Median cut, every rule, on all 19683 values of a texel: the same boxes as a transcription, the same means to half a
  step of 8 bits.
- PCMF: within each cluster no more squared error than 3 % above that of NumPy's own components of its texels.

Exits with 1 if a check fails.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from safetensors import safe_open
from sklearn.cluster import KMeans

LODEN = "target/release/loden"
SIDE, DIRECTIONS, CLUSTERS = 64, 81, 64


def loden(*arguments):
    done = subprocess.run([LODEN, *map(str, arguments), "--json", "--force"], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def tensors(path):
    """The tensors of a file, with the index as integers."""
    with safe_open(path, "numpy") as file:
        t = {name: file.get_tensor(name) for name in file.keys()}
    t["index"] = sum(t["index"][..., i].astype(int) << (8 * i) for i in range(t["index"].shape[-1])).ravel()
    return t


def report(**row):
    print(json.dumps(row), flush=True)
    return row["holds"]


def compress(source, folder, method, *parameters):
    file = folder / f"{method}.loden"
    loden("compress", source, "--method", method, "-o", file, *parameters)
    return tensors(file)


def squared_error(matrix, index):
    """The squared error of the best block for a partition."""
    clusters = [matrix[index == k].astype(np.float64) for k in np.unique(index)]
    return sum(((c - c.mean(0)) ** 2).sum() for c in clusters)


def check_kmeans(images, folder):
    """`images`: (pair, texel, rgb) for all directions, some of which are used."""
    some = np.arange(0, DIRECTIONS, 7)
    part = images.reshape(DIRECTIONS, DIRECTIONS, -1)[some][:, some]
    part.tofile(folder / "part.u8")
    degrees = [[round(float(t), 3), round(float(p), 3)] for t, p in zip(np.linspace(0, 75, len(some)), 40.0 * np.arange(len(some)) % 360)]
    (folder / "part.toml").write_text(
        f'loden_raw = 1\ndata = "part.u8"\ntype = "u8"\nshape = [{len(some)}, {len(some)}, {SIDE}, {SIDE}, 3]\n'
        f'views = {degrees}\nlights = {degrees}\nencoding = "srgb"\ncosine = "included"\n')
    matrix = part.reshape(-1, SIDE * SIDE, 3).transpose(1, 0, 2).reshape(SIDE * SIDE, -1) / np.float64(255)
    ours = compress(folder / "part.toml", folder, "kmeans", "--clusters", CLUSTERS, "--start", "regular",
                    "--dimensions", matrix.shape[1], "--iterations", 300)["index"]
    start = matrix[[(2 * i + 1) * len(matrix) // (2 * CLUSTERS) for i in range(CLUSTERS)]]
    theirs = KMeans(CLUSTERS, init=start, n_init=1, max_iter=300, tol=0, algorithm="lloyd").fit(matrix)
    a, b = squared_error(matrix, ours), squared_error(matrix, theirs.labels_)
    return report(method="kmeans", squared_error=a, scikit_learn=b, holds=bool(abs(a - b) <= 1e-4 * b))


def median_cut(matrix, count, rule):
    """The boxes, as lists of rows, lower halves first."""
    def node(rows, level):
        values = matrix[rows]
        if rule == "variance":
            wide = values.astype(np.int64)
            size = ((wide ** 2).sum(0) - wide.sum(0) ** 2 / len(rows)).astype(np.float32)
        else:
            size = values.max(0).astype(int) - values.min(0)
        dimension = int(size.argmax())
        edge = float(size[dimension])
        priority = {"balanced": -level, "longest-edge": edge, "variance": edge, "population": edge * len(rows)}[rule]
        return {"rows": rows, "level": level, "cut": dimension, "priority": priority, "whole": edge == 0}

    leaves, tree = [node(np.arange(len(matrix)), 0)], {}
    oldest = [0]
    while len(leaves) < count:
        ready = [i for i, leaf in enumerate(leaves) if not leaf["whole"]]
        if not ready:
            break
        best = max(ready, key=lambda i: (leaves[i]["priority"], -oldest[i]))
        leaf, _ = leaves.pop(best), oldest.pop(best)
        order = leaf["rows"][np.argsort(matrix[leaf["rows"], leaf["cut"]], kind="stable")]
        halves = [np.sort(order[:len(order) // 2]), np.sort(order[len(order) // 2:])]
        # low and high replace their box
        age = 2 * len(tree) + 1
        tree[len(tree)] = True
        leaves[best:best] = [node(half, leaf["level"] + 1) for half in halves]
        oldest[best:best] = [age, age + 1]
    return [leaf["rows"] for leaf in leaves]


def check_median_cut(source, matrix, folder, rule):
    t = compress(source, folder, "median-cut", "--clusters", CLUSTERS, "--split", rule)
    boxes = median_cut(matrix, CLUSTERS, rule)
    index = np.empty(len(matrix), int)
    for k, rows in enumerate(boxes):
        index[rows] = k
    means = np.array([matrix[rows].mean(0) for rows in boxes])
    block = t["block"].reshape(len(t["block"]), -1)
    off = float(np.abs(block - means).max()) if block.shape == means.shape else None
    return report(method="median-cut", rule=rule, same_boxes=bool((index == t["index"]).all()), largest_difference=off,
                  holds=bool((index == t["index"]).all() and off < 0.5001))


def check_pcmf(source, matrix, folder):
    c = 4
    t = compress(source, folder, "pcmf", "--clusters", 8, "--components", c, "--precision", "f32")
    values = matrix.astype(np.float32) / 255
    block = t["block"].reshape(len(t["block"]), -1)
    ours, numpys = 0.0, 0.0
    for k in range(len(block)):
        rows = t["index"] == k
        decoded = block[k] + t["coefficients"].reshape(-1, c)[rows] @ t["components"][k].reshape(c, -1)
        ours += ((decoded - values[rows]) ** 2).sum(dtype=np.float64)
        centred = values[rows] - values[rows].mean(0)
        spectrum = np.linalg.eigvalsh((centred @ centred.T).astype(np.float64))
        numpys += spectrum[:-c].clip(0).sum()
    return report(method="pcmf", squared_error=ours, numpy=numpys, holds=bool(numpys * 0.9999 <= ours <= 1.03 * numpys))


def main():
    with tempfile.TemporaryDirectory() as name:
        folder, data = pathlib.Path(name), os.environ.get("LODEN_DATA")
        archive = pathlib.Path(data, "btf", "twill.zip") if data else folder / "twill.zip"
        if not data:
            loden("acquire", "twill", "--size", SIDE, "--spp", 1, "-o", archive)
        source = folder / "twill.toml"
        loden("convert", archive, source)
        images = np.fromfile(folder / "twill.u8", np.uint8).reshape(DIRECTIONS ** 2, SIDE * SIDE, 3)
        matrix = np.ascontiguousarray(images.transpose(1, 0, 2).reshape(SIDE * SIDE, -1))
        results = [check_kmeans(images, folder)]
        rules = ["balanced", "longest-edge", "population", "variance"]
        results += [check_median_cut(source, matrix, folder, rule) for rule in rules]
        results.append(check_pcmf(source, matrix, folder))
    sys.exit(0 if all(results) else 1)


main()
