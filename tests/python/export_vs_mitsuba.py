"""Compares materials exported to Mitsuba 3 with our own evaluation, sampling and pictures.

Usage: python export_vs_mitsuba.py [LODEN], the path of the built program.

The plug-in's values are compared with those of `loden eval` at random points and directions, for every codec that can be
exported. Mitsuba's chi-square test compares its sampling with its density. A ball under one distant light, at three
angles, is rendered by both programs and compared pixel by pixel away from the silhouette.
"""

import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

import exports
import variants

VARIANT = variants.choose()
REFUSED = {"analytic": "analytic BRDF", "neural": "neural network"}
POINTS, SIZE, SPP, REPEATS = 3000, 96, 64, 4
LIGHTS = [15, 45, 75]
# mean absolute difference of pictures, as a fraction of full scale
TOLERANCE = 0.002


def unit(theta, phi):
    theta, phi = np.radians(theta.astype(np.float64)), np.radians(phi.astype(np.float64))
    return mi.Vector3f(*(np.float32(v) for v in (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))))


def apparent(material, points):
    """Values of the plug-in; one by one in scalar variants."""
    if VARIANT.startswith("scalar"):
        one = lambda p: material.apparent(mi.Point2f(float(p[4]), float(p[5])), unit(p[0], p[1]), unit(p[2], p[3]))
        return np.array([np.array(one(p)).ravel() for p in points])
    uv = mi.Point2f(points[:, 4].copy(), points[:, 5].copy())
    value = material.apparent(uv, unit(points[:, 0], points[:, 1]), unit(points[:, 2], points[:, 3]))
    return np.array(value).T


def ball(path):
    """A ball with texture coordinates and normals, for both programs."""
    u, v = np.meshgrid(np.linspace(0, 1, 257), np.linspace(0.02, 0.98, 129))
    phi, theta = 2 * np.pi * u, np.pi * (1 - v)
    points = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    vertices = np.concatenate([points, points, np.stack([2 * u, v], -1)], -1).reshape(-1, 8)
    at = np.arange(len(vertices)).reshape(u.shape)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{names}"
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    rows["n"], rows["i"] = 3, faces
    with open(path, "wb") as file:
        file.write(f"{head}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        file.write(vertices.astype("<f4").tobytes() + rows.tobytes())


def sun(angle):
    angle = np.radians(angle)
    return np.array([np.sin(angle), 0.3 * np.sin(angle), np.cos(angle)])


def ours(program, folder, name, angle):
    text = f"""
[camera]
position = [0, 0, 6]
target = [0, 0, 0]
field-of-view = 24
[material.m]
file = "{name}.loden"
[[light]]
kind = "directional"
direction = {sun(angle).tolist()}
irradiance = 3.0
[[shape]]
kind = "mesh"
file = "ball.ply"
material = "m"
"""
    (folder / "scene.toml").write_text(text)
    size, out = f"{SIZE}x{SIZE}", folder / "ours.exr"
    subprocess.run([program, "render", "--scene", folder / "scene.toml", "-o", out, "--size", size, "--spp", str(4 * SPP), "--force", "-q"], check=True, stdout=subprocess.DEVNULL)
    return np.array(mi.Bitmap(str(out)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))


def theirs(folder, name, angle):
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "perspective",
            "fov": 24,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 6], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            "sampler": {"type": "stratified", "sample_count": SPP},
        },
        "light": {"type": "directional", "direction": (-sun(angle)).tolist(), "irradiance": {"type": "rgb", "value": 3.0}},
        "ball": {"type": "ply", "filename": str(folder / "ball.ply"), "bsdf": {"type": "loden_btf", "folder": str(folder / name)}},
    })
    return np.mean([np.array(mi.render(scene, seed=seed)) for seed in range(REPEATS)], 0)


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/loden"
    run = lambda *words: subprocess.run([program, *words, "-q"], check=True, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run("acquire", "twill", "--size", "24", "--spp", "4", "-o", folder / "twill.zip")
        points = exports.random_points(POINTS if VARIANT.startswith("llvm") else 100, 1)
        loaded = {}
        for name in exports.methods(program):
            run("compress", folder / "twill.zip", "--method", name, *exports.QUICK.get(name, []), "-o", folder / f"{name}.loden")
            export = [program, "export", folder / f"{name}.loden", "--to", "mitsuba", "-o", folder / name]
            done = subprocess.run(export, capture_output=True, text=True)
            if name in REFUSED:
                assert done.returncode == 1 and REFUSED[name] in done.stderr, done.stderr
                print(f"{name}: refused, as documented")
                continue
            assert done.returncode == 0, done.stderr
            if not loaded:
                sys.path.insert(0, str(folder / name))
                import loden_btf
            loaded[name] = loden_btf.Material(folder / name)
            # klt is evaluated with 16-bit coefficients by us
            check_values(program, folder, name, loaded[name], f"{name}.loden", points, 4e-3 if name == "klt" else 2e-4)
        run("export", exports.WARD, "--to", "mitsuba", "-o", folder / "ward")
        table = loden_btf.Material(folder / "ward")
        check_values(program, folder, "ward, as a table", table, "ward/material.loden", points, 2e-4)
        if VARIANT.startswith("scalar"):
            print("skipped: sampling and pictures of exported materials, as Mitsuba has no variant with LLVM here")
            return
        check_sampling(folder)
        check_pictures(program, folder)


def check_values(program, folder, name, exported, material, points, tolerance):
    values = exports.values_of(program, folder, material, points)
    error = np.abs(apparent(exported, points) - values)
    print(f"{name}: largest difference {error.max():.1e} of values up to {values.max():.2f}")
    assert error.max() < tolerance * max(1, values.max()), name


def check_sampling(folder):
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    xml = f'<string name="folder" value="{folder / "pvmf"}"/>'
    # the level of significance for three tests together is 1 %
    for wi in ([0, 0, 1], [0.5, 0.3, 0.6], [-0.8, 0.2, 0.3]):
        wi = [float(x) for x in np.array(wi) / np.linalg.norm(wi)]
        sample, pdf = BSDFAdapter("loden_btf", xml, wi=wi)
        test = ChiSquareTest(SphericalDomain(), sample, pdf, sample_dim=3, sample_count=400_000, ires=32)
        test.run()
        mass = float(np.sum(test.pdf))
        print(f"sampling from {np.round(wi, 2)}: density integrates to {mass / test.sample_count:.4f}, p = {test.p_value:.3f}")
        assert abs(mass / test.sample_count - 1) < 0.01 and test.p_value > 0.01 / 3


def check_pictures(program, folder):
    ball(folder / "ball.ply")
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    radius = np.hypot(x - SIZE / 2, y - SIZE / 2) / (SIZE / 2)
    inside = radius < 0.85 * np.tan(np.arcsin(1 / 6)) / np.tan(np.radians(12))
    for name in ("pvmf", "klt", "median-cut"):
        for angle in LIGHTS:
            a, b = ours(program, folder, name, angle)[inside], theirs(folder, name, angle)[inside]
            difference = np.abs(a - b).mean()
            print(f"{name}, light at {angle} degrees: mean {a.mean():.4f}, mean difference {difference:.5f}, bias {(b - a).mean():+.5f}")
            assert a.mean() > 0.01 and difference < TOLERANCE


main()
