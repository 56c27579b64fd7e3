"""Compares `.bsdf` files written by loden with Mitsuba 3's `measured`, which loads and evaluates them.

Usage: python rgl_vs_mitsuba.py [LODEN], the path of the built program.

A glossy isotropic and a brushed anisotropic BRDF in closed form become a MERL and a UTIA table, both become `.bsdf`
files by `loden convert`, and `loden eval` and Mitsuba evaluate these at the same directions. With LODEN_DATA set, shared
measurements of Cornell and of the laboratory itself are converted and compared, too; the latter also as they are.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

COUNT = 2000


def unit(theta, phi):
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def glossy(wi, wo, along, across):
    """Gaussian slopes over a diffuse base."""
    h = wi + wo
    slope = (h[..., 0] / h[..., 2] / along) ** 2 + (h[..., 1] / h[..., 2] / across) ** 2
    lobe = np.exp(-slope) / (np.pi * along * across)
    return np.array([0.1, 0.08, 0.05]) + np.array([0.9, 0.7, 0.4]) * lobe[..., None]


def merl(path):
    theta_h = ((np.arange(90) + 0.5) / 90) ** 2 * np.pi / 2
    theta_d, phi_d = np.radians(np.arange(90) + 0.5), np.radians(np.arange(180) + 0.5)
    h, d, p = np.meshgrid(theta_h, theta_d, phi_d, indexing="ij")
    turn = lambda w: np.stack(
        [w[..., 0] * np.cos(h) + w[..., 2] * np.sin(h), w[..., 1], w[..., 2] * np.cos(h) - w[..., 0] * np.sin(h)], -1
    )
    wi, wo = turn(unit(d, p)), turn(unit(d, p + np.pi))
    above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
    value = np.where(above[..., None], glossy(wi, wo, 0.3, 0.3), -1)
    scale = np.array([1, 1.15, 1.66]) / 1500
    with open(path, "wb") as f:
        np.array([90, 90, 180], "<i4").tofile(f)
        for c in range(3):
            np.where(above, value[..., c] / scale[c], -1).astype("<f8").tofile(f)


def utia(path):
    theta, phi = np.radians(np.arange(6) * 15), np.radians(np.arange(48) * 7.5)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    w = unit(t.ravel(), p.ravel())
    value = glossy(w[:, None], w[None, :], 0.6, 0.4)
    np.moveaxis(value, -1, 0).astype("<f8").tofile(path)


def queries(folder):
    random = np.random.default_rng(7)
    theta = np.degrees(np.arccos(np.sqrt(random.uniform(0.05, 1, (COUNT, 2)))))
    phi = random.uniform(0, 360, (COUNT, 2))
    # half of them near the mirror direction
    near = COUNT // 2
    theta[:near, 1] = np.clip(theta[:near, 0] + random.normal(0, 5, near), 0, 80)
    phi[:near, 1] = phi[:near, 0] + 180 + random.normal(0, 10, near)
    rows = np.column_stack([theta[:, 0], phi[:, 0] % 360, theta[:, 1], phi[:, 1] % 360])
    np.savetxt(folder / "q.csv", rows, delimiter=",", header="theta_i,phi_i,theta_o,phi_o", comments="")
    return np.radians(np.loadtxt(folder / "q.csv", delimiter=",", skiprows=1))


def ours(program, folder, path):
    out = folder / "out.csv"
    command = [program, "eval", path, "--queries", folder / "q.csv", "-o", out, "--quiet", "--force"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return np.loadtxt(out, delimiter=",", skiprows=1)[:, 4:7]


def theirs(path, rows):
    """Mitsuba's value, which contains the cosine of the outgoing direction."""
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    context, out = mi.BSDFContext(), []
    for wi, wo in zip(unit(rows[:, 0], rows[:, 1]), unit(rows[:, 2], rows[:, 3])):
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f(*map(float, wi))
        out.append(np.array(bsdf.eval(context, si, mi.Vector3f(*map(float, wo)))) / wo[2])
    # colours outside the gamut have negative components, which we clip and Mitsuba keeps
    return np.maximum(out, 0)


def compare(name, a, b):
    """Errors relative to the value, or to a thousandth of the largest value if that is more."""
    error = np.abs(a - b) / np.maximum(b.max(1, keepdims=True), 1e-3 * b.max())
    print(f"{name}: largest relative difference {error.max():.5f}, mean {error.mean():.6f}")
    assert error.max() < 0.01, f"{name}: differs from Mitsuba"


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    program = sys.argv[1] if len(sys.argv) > 1 else root / "target/release/loden"
    mi.set_variant("scalar_rgb")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        rows = queries(folder)
        merl(folder / "glossy.binary")
        utia(folder / "brushed.bin")
        files = [folder / "glossy.binary", folder / "brushed.bin"]
        data = os.environ.get("LODEN_DATA")
        if data:
            files += sorted(pathlib.Path(data).glob("cornell_pbrt_v2/*.brdf"))
            files += sorted(pathlib.Path(data).glob("rgl_epfl/*.bsdf"))
        else:
            print("skipped: shared measurements, as LODEN_DATA is not set")
        for source in files:
            path = folder / "written.bsdf"
            command = [program, "convert", source, path, "--quiet", "--no-check", "--force"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            compare(source.name, ours(program, folder, path), theirs(path, rows))
            if source.suffix == ".bsdf":
                compare(f"{source.name} as it is", ours(program, folder, source), theirs(source, rows))
    print("agrees with Mitsuba")


if __name__ == "__main__":
    main()
