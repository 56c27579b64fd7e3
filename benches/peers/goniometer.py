"""The same measurement with Mitsuba 3 (llvm, Embree): python goniometer.py FOLDER, where the benchmark wrote its field
(LODEN_BENCH_FIELD=FOLDER). Prints one JSON line per finish and run.

The path integrator traces the rays of all views at once, one light after the other, in wavefronts of a million paths,
where Mitsuba is fastest. Compilation is not counted, and lights are changed without compiling again.
"""

import glob
import json
import os
import pathlib
import sys
import time

if "DRJIT_LIBLLVM_PATH" not in os.environ:
    found = sorted(glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*"))
    if found:
        os.environ["DRJIT_LIBLLVM_PATH"] = found[-1]

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

SIZE, SPP, DEPTH, RUNS = 256, 8, 4, 3
VIEWS = [(0, 0), (60, 54)]
LIGHTS = [(0, 0), (30, 60), (45, 160), (60, 270), (75, 15)]


def unit(theta, phi):
    theta, phi = np.radians(theta), np.radians(phi)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def mesh(heights, albedo, bsdf):
    """One period with two triangles per cell, split like ours."""
    n = len(heights)
    x, y = np.meshgrid(*[(np.arange(n + 1) + 0.5) / n] * 2)
    around = ((0, 1), (0, 1))
    vertices = np.stack([x, y, np.pad(heights, around, mode="wrap")], -1).reshape(-1, 3)
    colors = np.pad(albedo, (*around, (0, 0)), mode="wrap").reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    a = (j * (n + 1) + i).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n + 1], -1), np.stack([a + 1, a + n + 2, a + n + 1], -1)])
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    properties["face_normals"] = True
    out = mi.Mesh("field", len(vertices), len(faces), props=properties)
    out.add_attribute("vertex_color", 3, colors.astype(np.float32).ravel())
    parameters = mi.traverse(out)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return out


def rays(reference, top):
    """Rays to jittered points in the texels of every view."""
    count = SIZE * SIZE * SPP
    random = np.random.default_rng(1)
    origins, directions = [], []
    for view in VIEWS:
        wo = unit(*view)
        cell = np.arange(count) // SPP
        place = (np.stack([cell % SIZE, cell // SIZE], -1) + random.random((count, 2))) / SIZE
        start = np.column_stack([place, np.full(count, reference)]) + wo * ((top - reference) / wo[2] + 1e-3)
        # wrap points that leave the period on the way to the viewer
        start[:, :2] = (start[:, :2] - 0.5 / len(heights)) % 1 + 0.5 / len(heights)
        origins.append(start)
        directions.append(np.broadcast_to(-wo, start.shape))
    return [mi.Point3f(np.concatenate(part).astype(np.float32).T) for part in (origins, directions)]


folder = pathlib.Path(sys.argv[1])
heights = np.fromfile(folder / "heights.f32", "<f4")
heights = heights.reshape([int(len(heights) ** 0.5)] * 2)
albedo = np.fromfile(folder / "finish.f32", "<f4").reshape(*heights.shape, 8)[..., :3]
color = {"type": "mesh_attribute", "name": "vertex_color"}
FINISHES = {
    "matt": {"type": "diffuse", "reflectance": color},
    # this plug-in takes no mesh attribute: a single colour, which is less work
    "coated": {
        "type": "roughplastic",
        "distribution": "ggx",
        "alpha": 0.5,
        "diffuse_reflectance": {"type": "rgb", "value": albedo.mean((0, 1)).tolist()},
    },
}
origin, direction = rays(float(heights.mean()), float(heights.max()))
for finish, bsdf in FINISHES.items():
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEPTH + 1, "rr_depth": DEPTH},
        "field": mesh(heights, albedo, bsdf),
        "sun": {"type": "directional", "direction": [0, 0, -1], "irradiance": 1.0},
    })
    sun = mi.traverse(scene)
    key = next(k for k in sun.keys() if k.endswith("to_world"))

    @dr.freeze
    def trace(scene, origin, direction, seed):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, dr.width(origin))
        light, _, _ = scene.integrator().sample(scene, sampler, mi.RayDifferential3f(origin, direction))
        return light

    def render(light, seed):
        target, up = mi.Point3f(*map(float, -unit(*light))), mi.Vector3f(0.6, 0.8, 0.01)
        sun[key] = mi.Transform4f().look_at(mi.Point3f(0), target, up)
        sun.update()
        radiance = trace(scene, origin, direction, mi.UInt32(seed))
        dr.eval(radiance)
        dr.sync_thread()
        return radiance

    for warm_up in range(2):
        render(LIGHTS[warm_up], warm_up)
    for run in range(RUNS):
        start = time.perf_counter()
        images = [render(light, 10 + run * len(LIGHTS) + k) for k, light in enumerate(LIGHTS)]
        seconds = time.perf_counter() - start
        paths = len(LIGHTS) * len(VIEWS) * SIZE * SIZE * SPP
        mean = np.pi * float(np.mean([np.array(image).mean() for image in images]))
        line = {"bench": "goniometer", "finish": finish, "seconds": round(seconds, 3)}
        print(json.dumps({**line, "paths_per_s": round(paths / seconds), "mean": round(mean, 5)}), flush=True)
