"""Compares height fields measured by our virtual goniometer and by Mitsuba 3, in blocks of 2 x 2 texels, by a z-test.

Usage: python acquire_vs_mitsuba.py [DUMP_ACQUIRE], the path of the built program `dump_acquire`.

Both trace a woven sample, diffuse and as rough metal, for several pairs of directions with four reflections. The mean
and variance per block of several independent measurements are compared, so noise needs no tolerance. Mitsuba's mesh
has 9 x 9 periods; rays that leave it have left our periodic field as well, except for the flattest.
"""

import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

import variants

# many short runs: the variances of few runs are so uncertain that z-scores spread without any difference
RUNS, SIZE, BLOCK, GRID, SPP, DEPTH, PERIODS = 32, 12, 2, 32, 32, 4, 9
DIRECTIONS = [(0, 0), (40, 70), (65, 200)]
FINISHES = {
    "matt": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}},
    "metal:0.3": {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": 0.3},
}


def unit(theta, phi):
    theta, phi = np.radians(theta), np.radians(phi)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def ours(program, folder, finish):
    text = " ".join(f"{theta},{phi}" for theta, phi in DIRECTIONS)
    images = []
    for seed in range(RUNS):
        keys = [f"grid={GRID}", f"size={SIZE}", f"spp={SPP}", f"depth={DEPTH}", "yarns=4", f"finish={finish}"]
        # the seed also generates the sample: measure the same sample with another seed for the paths
        keys += [f"views={text}", f"lights={text}", "seed=0", f"paths-seed={seed}"]
        subprocess.run([program, folder, *keys], check=True, stdout=subprocess.DEVNULL)
        images.append(np.fromfile(folder / "images.f32", "<f4"))
    heights = np.fromfile(folder / "heights.f32", "<f4").reshape(GRID, GRID)
    albedo = np.fromfile(folder / "finish.f32", "<f4").reshape(GRID, GRID, 8)[..., :3]
    count = len(DIRECTIONS)
    return heights, albedo, np.stack(images).reshape(RUNS, count, count, SIZE, SIZE, 3)


def mesh(folder, heights, albedo, bsdf):
    """Two triangles per cell, split from the lower right to the upper left corner, with the period in the middle."""
    side = GRID * PERIODS + 1
    index = np.arange(side)
    x, y = np.meshgrid(*[(index + 0.5) / GRID - PERIODS // 2] * 2)
    wrapped = np.ix_(index % GRID, index % GRID)
    vertices = np.stack([x, y, heights[wrapped]], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(side - 1), np.arange(side - 1))
    a = (j * side + i).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + side], -1), np.stack([a + 1, a + side + 1, a + side], -1)])
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    properties["face_normals"] = True
    out = mi.Mesh("field", len(vertices), len(faces), props=properties)
    out.add_attribute("vertex_color", 3, albedo[wrapped].astype(np.float32).ravel())
    parameters = mi.traverse(out)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return out


def trace(scene, origin, direction, seed):
    """Radiance along rays."""
    if mi.variant().startswith("scalar"):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed)
        one = lambda o: scene.integrator().sample(scene, sampler, mi.RayDifferential3f(list(o), list(direction)))[0]
        return np.array([np.array(one(o)) for o in origin])
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(origin))
    ray = mi.RayDifferential3f(mi.Point3f(origin.astype(np.float32).T), mi.Vector3f(*map(float, direction)))
    return np.array(scene.integrator().sample(scene, sampler, ray)[0]).T


def theirs(folder, heights, albedo, bsdf, spp):
    count = SIZE * SIZE * spp
    texel = np.arange(count) // spp
    images = np.zeros((RUNS, len(DIRECTIONS), len(DIRECTIONS), SIZE, SIZE, 3))
    shape = mesh(folder, heights, albedo, bsdf)
    for l, light in enumerate(DIRECTIONS):
        scene = mi.load_dict({
            "type": "scene",
            "integrator": {"type": "path", "max_depth": DEPTH + 1, "rr_depth": 1000},
            "field": shape,
            "sun": {"type": "directional", "direction": (-unit(*light)).tolist(), "irradiance": 1.0},
        })
        for v, view in enumerate(DIRECTIONS):
            for run in range(RUNS):
                seed = 1 + (l * len(DIRECTIONS) + v) * RUNS + run
                random = np.random.default_rng(seed)
                place = np.stack([texel % SIZE, SIZE - 1 - texel // SIZE], -1) + random.random((count, 2))
                start = np.column_stack([place / SIZE, np.full(count, heights.mean(dtype=np.float64))])
                start += unit(*view) * ((heights.max() - heights.mean()) / unit(*view)[2] + 0.01)
                radiance = trace(scene, start, -unit(*view), seed).reshape(SIZE, SIZE, spp, 3)
                images[run, v, l] = np.pi * radiance.mean(2)
    return images


def compare(name, a, b):
    """z-scores per block must be distributed as Student's t, and the means over each image must agree."""
    # single texels of few paths are far from normally distributed
    side = SIZE // BLOCK
    a, b = (x.reshape(RUNS, *x.shape[1:3], side, BLOCK, side, BLOCK, 3).mean((4, 6)) for x in (a, b))
    difference = a.mean(0) - b.mean(0)
    # the floor allows for rounding where nothing is random
    variance = (a.var(0, ddof=1) + b.var(0, ddof=1)) / RUNS
    floor = (1e-4 * b.mean((0, 3, 4), keepdims=True)[0]) ** 2
    z = difference / np.sqrt(variance + floor)
    rms, worst = np.sqrt((z**2).mean()), np.abs(z).max()
    bias = difference.mean((2, 3))
    error = np.sqrt(variance.mean((2, 3))) / side
    score = np.abs(bias / (error + 1e-4 * b.mean((0, 3, 4)))).max()
    print(f"{name}: mean {a.mean():.5f} and {b.mean():.5f}, z rms {rms:.3f}, worst {worst:.1f}, images {score:.2f}")
    # t with at least 31 degrees of freedom has a standard deviation of at most 1.03; .04 is that of the rms of 324 blocks
    assert rms < 1.2, f"{name}: blocks differ by more than noise"
    # 27 means of images and channels
    assert score < 4.5, f"{name}: the mean of an image differs by more than noise"


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    program = sys.argv[1] if len(sys.argv) > 1 else root / "target/release/examples/dump_acquire"
    # the scalar variant takes one ray at a time and so gets fewer samples
    spp = {"llvm_ad_rgb": 2 * SPP, "scalar_rgb": 12}[variants.choose()]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for finish, bsdf in FINISHES.items():
            heights, albedo, images = ours(program, folder, finish)
            compare(finish, images, theirs(folder, heights, albedo, bsdf, spp))
    print("agrees with Mitsuba")


if __name__ == "__main__":
    main()
