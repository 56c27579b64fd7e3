#!/usr/bin/env python3
"""Checks files of `pca` and `svd` against scikit-learn's components of the same matrix (ARPACK, to machine precision).

usage: python tests/python/pca_vs_sklearn.py

The matrix is that of twill.zip (LODEN_DATA), or of the simulated samples gravel and twill, 64 x 64: a row per texel, 19683
columns. Files are decoded here by NumPy and safetensors alone, as docs/format.md describes.

- The squared error of 16 components exceeds that of scikit-learn by at most 0.1 %, and is not below it.
- The norms of the coefficients are the singular values to 0.1 %, largest first; components have length 1.

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
from sklearn.decomposition import PCA, TruncatedSVD

LODEN = "target/release/loden"
SIDE, DIRECTIONS, COMPONENTS = 64, 81, 16
TOLERANCE = 1e-3


def loden(*arguments):
    subprocess.run([LODEN, *map(str, arguments), "--json", "--force"], check=True, stdout=subprocess.PIPE)


def squared_error(matrix, mean, coefficients, basis):
    return float(((mean + coefficients @ basis - matrix) ** 2).sum(dtype=np.float64))


def check(method, source, matrix, folder):
    file = folder / f"{method}.loden"
    loden("compress", source, "--method", method, "--components", COMPONENTS, "--precision", "f32", "--domain", "display",
          "--no-error", "-o", file)
    with safe_open(file, "numpy") as stored:
        tensors = {name: stored.get_tensor(name) for name in stored.keys()}
    mean = tensors["mean"].reshape(1, -1) if "mean" in tensors else np.float32(0)
    basis = tensors["basis"].transpose(1, 0, 2, 3).reshape(COMPONENTS, -1)
    coefficients = tensors["coefficients"].reshape(-1, COMPONENTS)
    if method == "pca":
        model = PCA(COMPONENTS, svd_solver="arpack", random_state=0)
    else:
        model = TruncatedSVD(COMPONENTS, algorithm="arpack", random_state=0)
    theirs = model.fit_transform(matrix)
    order = np.argsort(-model.singular_values_)
    best = squared_error(matrix, getattr(model, "mean_", np.float32(0)), theirs, model.components_)
    ours = squared_error(matrix, mean, coefficients, basis)
    lengths = np.linalg.norm(coefficients.astype(np.float64), axis=0)
    off = float(np.abs(lengths / model.singular_values_[order] - 1).max())
    unit = float(np.abs(np.linalg.norm(basis.astype(np.float64), axis=1) - 1).max())
    holds = best * (1 - 1e-5) <= ours <= best * (1 + TOLERANCE) and off <= TOLERANCE and unit <= 1e-5
    print(json.dumps({"method": method, "squared_error": ours, "scikit_learn": best, "singular_values_off": off,
                      "holds": bool(holds)}), flush=True)
    return holds


def check_archive(archive, folder):
    source = folder / "raw.toml"
    loden("convert", archive, source)
    images = np.fromfile(folder / "raw.u8", np.uint8).reshape(DIRECTIONS ** 2, SIDE * SIDE, 3)
    matrix = images.transpose(1, 0, 2).reshape(SIDE * SIDE, -1).astype(np.float32) / 255
    return [check(method, source, matrix, folder) for method in ("pca", "svd")]


def main():
    results, data = [], os.environ.get("LODEN_DATA")
    for sample in ("twill",) if data else ("gravel", "twill"):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            archive = pathlib.Path(data, "btf", "twill.zip") if data else folder / f"{sample}.zip"
            if not data:
                loden("acquire", sample, "--size", SIDE, "--spp", 1, "-o", archive)
            results += check_archive(archive, folder)
    sys.exit(0 if all(results) else 1)


main()
