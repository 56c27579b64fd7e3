"""Races our path tracer against Mitsuba 3 (llvm) on a bumpy ball of 100 000 triangles with several materials.

Usage: python render_materials.py [LODEN] [--spp N] [--repeat N] [--btf FILE ...] [--photographs RAW.toml]. Prints a line of JSON for
each material: samples per second of both, each the fastest of its runs, which take turns. 512 x 512 pixels, depth 6, a
directional light and a constant sky. BTFs (FILE: anything that `loden render` reads) are also compared with our diffuse ball; their
peer is `btf_plugin.py` with the photographs they were compressed from. LODEN_DATA, if set, is the folder with
`rgl_epfl/satin_rosaline_rgb.bsdf`. If Mitsuba does not find LLVM, DRJIT_LIBLLVM_PATH is its path.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

import render as ball  # noqa: E402  the ball of the diffuse race

SCENE = """
depth = 6
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
field-of-view = 30
[environment]
radiance = 0.3
[[light]]
kind = "directional"
direction = [1, 2, 2]
irradiance = 2
[[shape]]
kind = "mesh"
file = "ball.obj"
material = "m"
uv-scale = 4
[material.m]
"""

GGX = 'model = "ggx"\nkd = 0\nks = 1\nalpha-x = 0.2\nalpha-y = 0.2\nn = [0.2, 0.43, 1.38]\nk = [3.3, 2.45, 1.9]\n'


def rgb(value):
    return {"type": "rgb", "value": value}


def materials(btfs):
    """Name, ours, Mitsuba's."""
    yield "diffuse", 'model = "lambert"\nkd = 0.8\n', {"type": "diffuse", "reflectance": rgb(0.8)}
    conductor = {"type": "roughconductor", "distribution": "ggx", "alpha": 0.2, "eta": rgb([0.2, 0.43, 1.38]), "k": rgb([3.3, 2.45, 1.9])}
    yield "rough conductor (GGX)", GGX, conductor
    for path in pathlib.Path(os.environ.get("LODEN_DATA", "/nowhere")).glob("rgl_epfl/satin_rosaline_rgb.bsdf"):
        yield "measured (`.bsdf`)", f'file = "{path}"\n', {"type": "measured", "filename": str(path)}
    for path in btfs:
        yield f"BTF, {path.name}", f'file = "{path.resolve()}"\n', None


def ours(program, folder, text, spp):
    scene = pathlib.Path(folder) / "scene.toml"
    scene.write_text(SCENE + text)
    line = [program, "render", "--scene", scene, "--spp", str(spp), "-o", scene.with_suffix(".exr"), "--json", "--quiet", "--force"]
    return json.loads(subprocess.run(line, check=True, capture_output=True, text=True).stdout)


def mitsuba(loaded, spp, repeat):
    start = time.perf_counter()
    np.array(mi.render(loaded, seed=repeat))
    return 512 * 512 * spp / (time.perf_counter() - start)


def plugin(photographs):
    """Runs the plug-in with few samples, as it is slow; its first run compiles the kernels."""
    line = [sys.executable, pathlib.Path(__file__).with_name("btf_plugin.py"), photographs, "--spp", "4", "--repeat", "2"]
    return json.loads(subprocess.run(line, check=True, capture_output=True, text=True).stdout)


def race(arguments, folder, path, material):
    """The row of a material."""
    name, text, bsdf = material
    loaded = ball.scene(path, bsdf, arguments.spp) if bsdf else None
    mine, other, row = [], [], {"material": name}
    if loaded:
        # the first run compiles
        mitsuba(loaded, arguments.spp, 0)
    for repeat in range(arguments.repeat):
        mine.append(ours(arguments.program, folder, text, arguments.spp))
        if loaded:
            other.append(mitsuba(loaded, arguments.spp, repeat + 1))
        elif arguments.photographs:
            found = plugin(arguments.photographs)
            other.append(found["samples_per_s"])
            row["peer_peak_rss_bytes"] = found["peak_rss_bytes"]
    row |= {"samples_per_s": max(run["samples_per_s"] for run in mine), "peak_rss_bytes": max(run["peak_rss_bytes"] for run in mine)}
    return row | ({"peer_samples_per_s": max(other)} if other else {})


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", nargs="?", default="target/release/loden")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--btf", type=pathlib.Path, nargs="*", default=[])
    parser.add_argument("--photographs", type=pathlib.Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "ball.obj")
        ball.write_ball(path)
        for material in materials(arguments.btf):
            print(json.dumps(race(arguments, folder, path, material)), flush=True)


if __name__ == "__main__":
    main()
