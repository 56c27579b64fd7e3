"""Compares solids measured by our virtual goniometer and by Mitsuba 3, in blocks of 2 x 2 texels, by a z-test.

Usage: python solids_vs_mitsuba.py [DUMP_ACQUIRE], the path of the built program `dump_acquire`.

Two samples, for three pairs of directions: a cloth of plied yarns, which repeats, diffuse and as anisotropic metal, and a mesh
file with an overhang, a hole and a thin bar, which does not. Mitsuba traces the same triangles with the same normals and
texture coordinates, 5 x 5 periods of the cloth; it also finds the plane of the texels by itself. What fraction of a texel is
covered is compared as well. The mean and variance per block of several independent measurements are compared, so noise needs
no tolerance.
"""

import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

import variants
from acquire_vs_mitsuba import trace, unit

# many short runs: the variances of few runs are so uncertain that z-scores spread without any difference
RUNS, SIZE, BLOCK, SPP, DEPTH, PERIODS = 32, 12, 2, 24, 4, 5
# (view, light)
PAIRS = [((0, 0), (40, 70)), ((45, 160), (25, 300)), ((65, 200), (55, 20))]
YARN = ["sample=yarn", "yarns=4", "points=14", "weave=twill", "seed=0"]
SAMPLES = {
    "yarn, matt": (YARN + ["finish=matt"], {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}),
    "yarn, metal": (
        YARN + ["finish=metal:0.2,0.5"],
        {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha_u": 0.2, "alpha_v": 0.5},
    ),
    "mesh": (["sample=mesh", "finish=matt"], {"type": "diffuse", "reflectance": 0.5}),
}

# a floor with a square hole, a tilted roof over part of it, and a thin bar across the hole; y is up
QUADS = [
    [(0, 0, 0), (1, 0, 0), (1, 0, -0.3), (0, 0, -0.3)],
    [(0, 0, -0.7), (1, 0, -0.7), (1, 0, -1), (0, 0, -1)],
    [(0, 0, -0.3), (0.35, 0, -0.3), (0.35, 0, -0.7), (0, 0, -0.7)],
    [(0.65, 0, -0.3), (1, 0, -0.3), (1, 0, -0.7), (0.65, 0, -0.7)],
    [(0.1, 0.12, -0.1), (0.6, 0.22, -0.1), (0.6, 0.25, -0.45), (0.1, 0.15, -0.45)],
    [(0.5, 0.02, -0.3), (0.505, 0.02, -0.3), (0.505, 0.02, -0.7), (0.5, 0.02, -0.7)],
    [(0.5, 0.02, -0.3), (0.5, 0.1, -0.3), (0.5, 0.1, -0.7), (0.5, 0.02, -0.7)],
]


def write_mesh(path):
    lines = [f"v {x} {y} {z}" for quad in QUADS for x, y, z in quad]
    lines += [f"f {4 * k + 1} {4 * k + 2} {4 * k + 3} {4 * k + 4}" for k in range(len(QUADS))]
    path.write_text("\n".join(lines) + "\n")


def ours(program, folder, keys):
    """The triangles, and images of shape (run, pair, y, x, rgb) with coverage (run, pair, y, x)."""
    images, covered = [], []
    views, lights = (" ".join(f"{theta},{phi}" for theta, phi in side) for side in zip(*PAIRS))
    words = [f"views={views}", f"lights={lights}", f"size={SIZE}", f"spp={SPP}", f"depth={DEPTH}"]
    for seed in range(RUNS):
        subprocess.run([program, folder, *keys, *words, f"paths-seed={seed}"], check=True, stdout=subprocess.DEVNULL)
        each = np.arange(len(PAIRS))
        # every view was measured with every light
        images.append(np.fromfile(folder / "images.f32", "<f4").reshape(len(PAIRS), len(PAIRS), SIZE, SIZE, 3)[each, each])
        covered.append(np.fromfile(folder / "coverage.f32", "<f4").reshape(len(PAIRS), SIZE, SIZE, 3)[..., 0])
    read = lambda name, width: np.fromfile(folder / f"{name}.f32", "<f4").reshape(-1, width)
    solid = {"positions": read("positions", 3), "normals": read("normals", 3), "uvs": read("uvs", 2), "albedo": read("albedo", 3)}
    solid["triangles"] = np.fromfile(folder / "triangles.u32", "<u4").reshape(-1, 3)
    return solid, np.array(images), np.array(covered)


def mesh(solid, bsdf, periods):
    """Copies of the triangles side by side, the first one in the middle."""
    shifts = [(i, j, 0) for i in range(-(periods // 2), periods // 2 + 1) for j in range(-(periods // 2), periods // 2 + 1)]
    count = len(solid["positions"])
    positions = np.concatenate([solid["positions"] + shift for shift in shifts])
    faces = np.concatenate([solid["triangles"] + k * count for k in range(len(shifts))])
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": bsdf})
    out = mi.Mesh("solid", len(positions), len(faces), props=properties, has_vertex_normals=True, has_vertex_texcoords=True)
    if len(solid["albedo"]):
        out.add_attribute("vertex_color", 3, np.tile(solid["albedo"], (len(shifts), 1)).astype(np.float32).ravel())
    parameters = mi.traverse(out)
    parameters["vertex_positions"] = positions.astype(np.float32).ravel()
    parameters["vertex_normals"] = np.tile(solid["normals"], (len(shifts), 1)).astype(np.float32).ravel()
    parameters["vertex_texcoords"] = np.tile(solid["uvs"], (len(shifts), 1)).astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    # an update replaces the normals
    parameters["vertex_normals"] = np.tile(solid["normals"], (len(shifts), 1)).astype(np.float32).ravel()
    return out


def hits(scene, origin, direction):
    """Where rays hit: whether they do, and the height."""
    if mi.variant().startswith("scalar"):
        found = [scene.ray_intersect(mi.Ray3f(list(o), list(direction))) for o in origin]
        return np.array([s.is_valid() for s in found]), np.array([s.p.z if s.is_valid() else 0.0 for s in found])
    found = scene.ray_intersect(mi.Ray3f(mi.Point3f(origin.astype(np.float32).T), mi.Vector3f(*map(float, direction))))
    return np.array(found.is_valid()), np.array(found.p.z)


def theirs(solid, bsdf, periods, spp):
    top = solid["positions"][:, 2].max() + 0.01
    shape = mesh(solid, bsdf, periods)
    integrator = {"type": "path", "max_depth": DEPTH + 1, "rr_depth": 1000}
    # the plane of the texels: the mean height seen from above
    place = (np.stack(np.meshgrid(np.arange(128), np.arange(128)), -1).reshape(-1, 2) + 0.5) / 128
    valid, height = hits(mi.load_dict({"type": "scene", "solid": shape}), np.column_stack([place, np.full(len(place), top)]), (0, 0, -1))
    plane = height[valid].mean()
    count = SIZE * SIZE * spp
    texel = np.arange(count) // spp
    images, covered = np.zeros((RUNS, len(PAIRS), SIZE, SIZE, 3)), np.zeros((RUNS, len(PAIRS), SIZE, SIZE))
    for k, (view, light) in enumerate(PAIRS):
        sun = {"type": "directional", "direction": (-unit(*light)).tolist(), "irradiance": 1.0}
        scene = mi.load_dict({"type": "scene", "integrator": integrator, "solid": shape, "sun": sun})
        for run in range(RUNS):
            seed = 1 + k * RUNS + run
            place = np.stack([texel % SIZE, SIZE - 1 - texel // SIZE], -1) + np.random.default_rng(seed).random((count, 2))
            start = np.column_stack([place / SIZE, np.full(count, plane)]) + unit(*view) * ((top - plane) / unit(*view)[2])
            covered[run, k] = hits(scene, start, -unit(*view))[0].reshape(SIZE, SIZE, spp).mean(2)
            images[run, k] = np.pi * trace(scene, start, -unit(*view), seed).reshape(SIZE, SIZE, spp, 3).mean(2)
    return images, covered


def compare(name, a, b):
    """z-scores per block must be distributed as Student's t, and the means over each image must agree."""
    side = SIZE // BLOCK
    a, b = (x.reshape(RUNS, len(PAIRS), side, BLOCK, side, BLOCK, -1).mean((3, 5)) for x in (a, b))
    difference = a.mean(0) - b.mean(0)
    variance = (a.var(0, ddof=1) + b.var(0, ddof=1)) / RUNS
    # the floor allows for rounding where nothing is random
    floor = 2e-4 * b.mean((0, 2, 3), keepdims=True)[0] + 1e-9
    z = difference / np.sqrt(variance + floor**2)
    rms, worst = np.sqrt((z**2).mean()), np.abs(z).max()
    error = np.sqrt(variance.mean((1, 2))) / side
    score = np.abs(difference.mean((1, 2)) / (error + floor[:, 0, 0])).max()
    print(f"{name}: mean {a.mean():.5f} and {b.mean():.5f}, z rms {rms:.3f}, worst {worst:.1f}, images {score:.2f}")
    # t with at least 31 degrees of freedom has a standard deviation of at most 1.03; .07 is that of the rms of 108 blocks
    assert rms < 1.2, f"{name}: blocks differ by more than noise"
    assert score < 4.0, f"{name}: the mean of an image differs by more than noise"


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    program = sys.argv[1] if len(sys.argv) > 1 else root / "target/release/examples/dump_acquire"
    # the scalar variant takes one ray at a time and so gets fewer samples
    spp = {"llvm_ad_rgb": 2 * SPP, "scalar_rgb": SPP // 2}[variants.choose()]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        write_mesh(folder / "mesh.obj")
        for sample, (keys, bsdf) in SAMPLES.items():
            keys = keys + ([f"object={folder / 'mesh.obj'}"] if sample == "mesh" else [])
            solid, images, covered = ours(program, folder, keys)
            expected, seen = theirs(solid, bsdf, 1 if sample == "mesh" else PERIODS, spp)
            compare(sample, images, expected)
            if sample != "yarn, metal":
                compare(f"{sample}, coverage", covered, seen)
    print("agrees with Mitsuba")


if __name__ == "__main__":
    main()
