"""Races our path tracer against Mitsuba 3 (llvm) on a bumpy ball of 100 000 triangles; prints Msamples/s and the ratio.

Usage: python bench_render.py BENCH_RENDER [REPEATS], the path of the built program `bench_render`.
Needs the shared library of LLVM; DRJIT_LIBLLVM_PATH is its path if Mitsuba does not find it.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")


def write_ball(path, n=158):
    """Writes a ball of radius 1 around the origin, with bumps deep enough for interreflection, as OBJ."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(2 * n + 1), indexing="ij")
    theta, phi = np.pi * i / n, np.pi * j / n
    radius = 1 + 0.15 * np.sin(12 * theta) * np.cos(12 * phi) * np.sin(theta)
    p = radius[..., None] * np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    p = p.reshape(-1, 3)
    p -= 0.5 * (p.min(0) + p.max(0))
    p /= np.linalg.norm(p, axis=1).max()
    uv = np.stack([j / n, 1 - i / n], -1).reshape(-1, 2)
    at = (np.arange(n)[:, None] * (2 * n + 1) + np.arange(2 * n)).ravel() + 1
    a, b, c, d = at, at + 2 * n + 1, at + 2 * n + 2, at + 1
    with open(path, "w") as file:
        file.writelines(f"v {x:.7f} {y:.7f} {z:.7f}\n" for x, y, z in p)
        file.writelines(f"vt {u:.6f} {v:.6f}\n" for u, v in uv)
        for p, q, r in np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]):
            file.write(f"f {p}/{p} {q}/{q} {r}/{r}\n")


def scene(path, bsdf=None, spp=64):
    """The scene with the ball; diffuse unless another material is given."""
    towards = np.array([1, 2, 2]) / 3
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 6},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 512, "height": 512, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": spp},
            },
            "ball": {
                "type": "obj",
                "filename": path,
                "bsdf": bsdf or {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.8}},
            },
            "sky": {"type": "constant", "radiance": 0.3},
            "sun": {"type": "directional", "direction": list(-towards), "irradiance": 2.0},
        }
    )


def main():
    program, repeats = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 5
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "ball.obj")
        write_ball(path)
        loaded = scene(path)
        mine, theirs = [], []
        out = os.path.join(folder, "ours.exr")
        for repeat in range(repeats + 1):
            start = time.perf_counter()
            picture = np.array(mi.render(loaded, seed=repeat))
            seconds = time.perf_counter() - start
            printed = subprocess.run([program, path, out], check=True, capture_output=True, text=True).stdout
            if repeat > 0:  # the first run compiles Mitsuba's kernels
                theirs.append(512 * 512 * 64e-6 / seconds)
                mine.append(float(printed))
                print(f"ours {mine[-1]:.2f}, Mitsuba {theirs[-1]:.2f} Msamples/s")
        ours = np.array(mi.Bitmap(out).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))
        print(f"means {ours.mean():.4f} and {picture.mean():.4f}")
        assert abs(ours.mean() / picture.mean() - 1) < 0.01, "not the same picture"
    print(f"medians: ours {statistics.median(mine):.2f}, Mitsuba {statistics.median(theirs):.2f} Msamples/s, "
          f"ratio {statistics.median(m / t for m, t in zip(mine, theirs)):.2f}")


if __name__ == "__main__":
    main()
