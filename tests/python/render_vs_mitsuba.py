"""Compares a diffuse sphere rendered by us and by Mitsuba 3, pixel by pixel, by a z-test.

Usage: python render_vs_mitsuba.py [DUMP_SPHERE], the path of the built program `dump_sphere`.

The mean and variance per pixel of several independent pictures are compared, so noise needs no
tolerance. Two scenes: a directional light under a constant sky, and a smooth environment map.
"""

import os
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

SIZE, RUNS, SPP, ALBEDO = 128, 8, 32, 0.7


def sky(direction):
    """A smooth radiance for unit vectors (..., 3), different in every direction."""
    x, y, z = np.moveaxis(direction, -1, 0)
    lobe = np.exp(6 * ((x + 2 * y + 2 * z) / 3 - 1))
    return np.stack([0.3 + 0.2 * x + 3 * lobe, 0.3 + 0.2 * y + 2 * lobe, 0.3 + 0.2 * z + lobe], -1)


def directions(u, v):
    """Unit vectors of our latitude-longitude layout: v = 0 is +y, u = 1/2 is -z, growing towards +x."""
    phi, theta = 2 * np.pi * (u - 0.5), np.pi * v
    return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], -1)


def ours(program, folder, scene):
    arguments = []
    if scene == "map":
        u, v = np.meshgrid((np.arange(512) + 0.5) / 512, (np.arange(256) + 0.5) / 256)
        path = os.path.join(folder, "map.exr")
        mi.Bitmap(sky(directions(u, v)).astype(np.float32)).write(path)
        arguments = [path]
    pictures = []
    for seed in range(RUNS):
        path = os.path.join(folder, f"{scene}{seed}.exr")
        subprocess.run([program, path, str(ALBEDO), str(SPP), str(seed), scene, *arguments], check=True)
        pictures.append(np.array(mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32)))
    return np.stack(pictures)


def mitsuba_map():
    """The same sky on Mitsuba's grid, whose first and last rows are at the poles."""
    width, height = 512, 257
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, np.arange(height) / (height - 1))
    # Mitsuba mirrors the picture: its middle column is +z
    image = sky(directions(u, v) * [-1, 1, -1])
    return {"type": "envmap", "bitmap": mi.Bitmap(image.astype(np.float32)), "scale": 1.0}


def theirs(scene):
    description = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6, "rr_depth": 100},
        "sensor": {
            "type": "perspective",
            "fov": 30,
            "fov_axis": "smaller",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": SIZE,
                "height": SIZE,
                "rfilter": {"type": "tent"},
                "component_format": "float32",
            },
            "sampler": {"type": "independent", "sample_count": 4 * SPP},
        },
        "sphere": {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO}}},
    }
    if scene == "map":
        description["sky"] = mitsuba_map()
    else:
        description["sky"] = {"type": "constant", "radiance": 0.3}
        towards = np.array([1, 2, 2]) / 3
        description["sun"] = {"type": "directional", "direction": list(-towards), "irradiance": 2.0}
    loaded = mi.load_dict(description)
    return np.stack([np.array(mi.render(loaded, seed=100 + k)) for k in range(RUNS)])


def compare(name, a, b):
    """z-scores per pixel must be distributed as Student's t, and the mean over the picture must agree."""
    difference = a.mean(0) - b.mean(0)
    # averaging neighbouring pixels smooths the variance estimate of few runs; the silhouette varies most
    variance = (a.var(0, ddof=1) + b.var(0, ddof=1)) / RUNS
    floor = (1e-4 * (1e-3 + b.mean(0))) ** 2
    z = difference / np.sqrt(variance + floor)
    luminous = b.mean(0).sum(-1) > 1e-4
    rms, worst = np.sqrt((z[luminous] ** 2).mean()), np.abs(z[luminous]).max()
    error = np.sqrt(variance.mean((0, 1)) / (SIZE * SIZE))
    mean = b.mean((0, 1, 2))
    bias = difference.mean((0, 1))
    print(f"{name}: mean {mean}, bias {bias}, its error {error}, z rms {rms:.3f}, worst {worst:.1f}")
    # t with 14 degrees of freedom has a standard deviation of 1.08
    assert rms < 1.2, f"{name}: pixels differ by more than noise"
    assert np.all(np.abs(bias) < 4 * error + 1e-4 * mean), f"{name}: the mean differs by more than noise"


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/examples/dump_sphere"
    with tempfile.TemporaryDirectory() as folder:
        for scene in ("directional", "map"):
            compare(scene, ours(program, folder, scene), theirs(scene))
    print("agrees with Mitsuba")


if __name__ == "__main__":
    main()
