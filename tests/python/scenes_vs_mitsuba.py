"""Compares scenes rendered by us and by Mitsuba 3: a z-test of the means of blocks, and a bound on their variance.

Usage: python scenes_vs_mitsuba.py [LODEN], the path of the built program.

Each renderer makes several independent pictures of every scene; noise needs no tolerance. The scenes have every kind of
light, all quadrics (those that Mitsuba lacks as triangles computed here, from the formulas of the RenderMan
Interface), meshes, cameras, an environment and three or more BRDFs. LODEN_DATA, if set, is a folder with
`rgl_epfl/paper_white_rgb.bsdf`, which is compared too. Such a table is not exactly reciprocal. A path tracer
evaluates it from the side of the viewer: Mitsuba uses the viewer as the incident direction, we use the light, as in the
measurement. So Mitsuba's evaluation is called with exchanged directions; its sampling is unchanged.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
T = mi.ScalarTransform4f

SIZE, RUNS, SPP, DEPTH, BLOCK = 48, 14, 16, 4, 4

CAMERA = 'position = [0, 1.2, 5]\ntarget = [0, 0.2, 0]\n'
SENSOR = T().look_at([0, 1.2, 5], [0, 0.2, 0], [0, 1, 0])
FLOOR = """
[[shape]]
kind = "quad"
corners = [[-4, -1, 4], [4, -1, 4], [4, -1, -4], [-4, -1, -4]]
material = "floor"
"""
DIFFUSE = '[material.floor]\nmodel = "lambert"\nkd = [0.6, 0.5, 0.4]\n[material.m]\nmodel = "lambert"\nkd = 0.7\n'
SPHERE = '\n[[shape]]\nkind = "sphere"\nmaterial = "m"\ntransform = [{ rotate = [-90, 1, 0, 0] }]\n'
SPOT = '[[light]]\nkind = "spot"\nposition = [1, 4, 2]\ntarget = [0, 0, 0]\nintensity = 40\nangle = 20\n'
SUN = '[[light]]\nkind = "directional"\ndirection = [1, 2, 2]\nirradiance = 2\n'
SKY = "[environment]\nradiance = 0.3\n"
LAMP = '[[light]]\nkind = "rectangle"\ncentre = [0.5, 3, 1]\nx = [0.8, 0, 0]\ny = [0, 0, 0.6]\nradiance = [8, 7, 6]\n'


def rgb(value):
    return {"type": "rgb", "value": value}


def diffuse(value):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(value)}}


def floor():
    plane = T().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4)
    return {"type": "rectangle", "to_world": plane, "bsdf": diffuse([0.6, 0.5, 0.4])}


def sphere(bsdf=None):
    turned = T().rotate([1, 0, 0], -90)
    return {"type": "sphere", "to_world": turned, "bsdf": bsdf or diffuse(0.7)}


def emitter(kind, to_world, radiance):
    return {"type": kind, "to_world": to_world, "bsdf": diffuse(0.0), "emitter": {"type": "area", "radiance": rgb(radiance)}}


def sun():
    return {"type": "directional", "direction": list(-np.array([1, 2, 2]) / 3), "irradiance": 2.0}


def sky():
    return {"type": "constant", "radiance": 0.3}


def lamp():
    down = T().translate([0.5, 3, 1]).rotate([1, 0, 0], 90).scale([0.8, 0.6, 1])
    return emitter("rectangle", down, [8, 7, 6])


def spot():
    # an edge as sharp as ours
    to_world = T().look_at([1, 4, 2], [0, 0, 0], [0, 1, 0])
    return {"type": "spot", "to_world": to_world, "intensity": 40.0, "cutoff_angle": 20.0, "beam_width": 19.999}


def surface(folder, name, function, steps=192, turned=False):
    """A mesh of a parametric surface (u, v) -> (x, y, z), written as PLY with exact positions and its normals.

    The faces are wound against the normals if turned.
    """
    u, v = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1))
    inside = lambda x: x + 1e-4 * (0.5 - x)
    step = 1e-5
    along_u = function(inside(u) + step, inside(v)) - function(inside(u) - step, inside(v))
    along_v = function(inside(u), inside(v) + step) - function(inside(u), inside(v) - step)
    normals = np.cross(along_u, along_v)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    vertices = np.concatenate([function(u, v), normals], -1).reshape(-1, 6)
    at = np.arange((steps + 1) ** 2).reshape(steps + 1, steps + 1)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    faces = faces[:, ::-1] if turned else faces
    path = os.path.join(folder, name + ".ply")
    with open(path, "wb") as file:
        names = "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz"))
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{names}"
        file.write(f"{head}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        file.write(vertices.astype("<f4").tobytes())
        rows = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
        rows["n"], rows["i"] = 3, faces
        file.write(rows.tobytes())
    return path


def around(u, r, z):
    phi = 2 * np.pi * u
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)


def wave(u, v):
    return np.stack([2 * u - 1, 2 * v - 1, 0.2 * np.sin(7 * u) * np.cos(5 * v)], -1)


UP = "{ rotate = [-90, 1, 0, 0] }"
QUADRICS = {
    "cone": ('kind = "cone"\nheight = 1.6\nradius = 1\n', lambda u, v: around(u, 1 - v, 1.6 * v), -0.9),
    "paraboloid": (
        'kind = "paraboloid"\nradius = 1\nz-min = 0.01\nz-max = 1.5\n',
        lambda u, v: around(u, np.sqrt((0.01 + 1.49 * v) / 1.5), 0.01 + 1.49 * v),
        -0.8,
    ),
    "hyperboloid": (
        'kind = "hyperboloid"\nfrom = [1, 0, -0.9]\nto = [0.2, 0.9, 0.9]\n',
        lambda u, v: np.stack(
            [
                np.cos(2 * np.pi * u) * (1 - 0.8 * v) - np.sin(2 * np.pi * u) * 0.9 * v,
                np.sin(2 * np.pi * u) * (1 - 0.8 * v) + np.cos(2 * np.pi * u) * 0.9 * v,
                -0.9 + 1.8 * v,
            ],
            -1,
        ),
        0.0,
    ),
    "torus": (
        'kind = "torus"\nmajor-radius = 0.9\nminor-radius = 0.4\n',
        lambda u, v: around(u, 0.9 + 0.4 * np.cos(2 * np.pi * v), 0.4 * np.sin(2 * np.pi * v)),
        -0.3,
    ),
}

GGX = '[material.floor]\nmodel = "lambert"\nkd = [0.6, 0.5, 0.4]\n[material.m]\nmodel = "{name}"\nkd = 0\nks = 1\n{extra}'
METAL = "n = [0.2, 0.43, 1.38]\nk = [3.3, 2.45, 1.9]\nalpha-x = {0}\nalpha-y = {1}\n"


def conductor(distribution, alpha_u, alpha_v):
    return {
        "type": "roughconductor",
        "distribution": distribution,
        "alpha_u": alpha_u,
        "alpha_v": alpha_v,
        "sample_visible": distribution == "ggx",
        "eta": rgb([0.2, 0.43, 1.38]),
        "k": rgb([3.3, 2.45, 1.9]),
    }


class Exchanged(mi.BSDF):
    """Mitsuba's `measured` with the light as the incident direction of the table."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.table = mi.load_dict({"type": "measured", "filename": props["filename"]})
        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
        self.m_components, self.m_flags = [flags], flags

    def sample(self, context, si, sample1, sample2, active=True):
        drawn, _ = self.table.sample(context, si, sample1, sample2, active)
        weight = self.eval(context, si, drawn.wo) / drawn.pdf if drawn.pdf > 0 else mi.Color3f(0)
        return drawn, weight

    def eval(self, context, si, wo, active=True):
        viewer = mi.Vector3f(si.wi)
        if viewer.z <= 0 or wo.z <= 0:
            return mi.Color3f(0)
        turned = mi.SurfaceInteraction3f(si)
        turned.wi = wo
        # the value of the plug-in contains the cosine of its outgoing direction
        value = self.table.eval(context, turned, viewer, active) * (wo.z / viewer.z)
        return mi.Color3f(*(max(0.0, float(v)) for v in value))

    def pdf(self, context, si, wo, active=True):
        return self.table.pdf(context, si, wo, active)

    def eval_pdf(self, context, si, wo, active=True):
        return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)


mi.register_bsdf("exchanged", Exchanged)


def environment(folder):
    """The same smooth sky for both renderers, whose environment maps differ in orientation and row positions."""

    def radiance(d):
        lobe = np.exp(12 * ((d[..., 0] + 2 * d[..., 1] + 2 * d[..., 2]) / 3 - 1))
        return np.stack([0.3 + 0.2 * d[..., 0] + 5 * lobe, 0.3 + 0.2 * d[..., 1] + 4 * lobe, 0.4 + 3 * lobe], -1)

    def directions(u, v):
        phi, theta = 2 * np.pi * (u - 0.5), np.pi * v
        return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], -1)

    u, v = np.meshgrid((np.arange(512) + 0.5) / 512, (np.arange(256) + 0.5) / 256)
    path = os.path.join(folder, "sky.exr")
    mi.Bitmap(radiance(directions(u, v)).astype(np.float32)).write(path)
    u, v = np.meshgrid((np.arange(512) + 0.5) / 512, np.arange(257) / 256)
    image = radiance(directions(u, v) * [-1, 1, -1]).astype(np.float32)
    return '[environment]\nfile = "sky.exr"\n', {"type": "envmap", "bitmap": mi.Bitmap(image)}


def scenes(folder):
    """Name, our scene (without camera), Mitsuba's scene, and differences of the cameras."""
    plain = DIFFUSE + FLOOR + SPHERE
    theirs = {"floor": floor(), "sphere": sphere()}
    point = {"type": "point", "position": [1, 3, 2], "intensity": 20.0}
    yield "directional", SUN + SKY + plain, {**theirs, "sun": sun(), "sky": sky()}, {}
    ours = '[[light]]\nkind = "point"\nposition = [1, 3, 2]\nintensity = 20\n'
    yield "point", ours + plain, {**theirs, "light": point}, {}
    yield "spot", SPOT + plain, {**theirs, "light": spot()}, {}
    yield "rectangle", LAMP + plain, {**theirs, "light": lamp()}, {}
    ours = '[[light]]\nkind = "disk"\ncentre = [0.5, 2.5, 1]\nx = [0.7, 0, 0]\ny = [0, 0, 0.7]\nradiance = 9\n'
    down = T().translate([0.5, 2.5, 1]).rotate([1, 0, 0], 90).scale(0.7)
    yield "disk", ours + plain, {**theirs, "light": emitter("disk", down, 9.0)}, {}
    ours = '[[light]]\nkind = "sphere"\ncentre = [1.1, 1.5, 1]\nradius = 0.5\nradiance = 9\n'
    light = emitter("sphere", T().translate([1.1, 1.5, 1]).scale(0.5), 9.0)
    yield "sphere light", ours + plain, {**theirs, "light": light}, {}
    ours, light = environment(folder)
    yield "environment", ours + plain, {**theirs, "environment": light}, {}
    ours = LAMP + DIFFUSE + FLOOR
    for k, text in enumerate(['kind = "cylinder"\nradius = 0.5\nz-min = -1\nz-max = 0.4\n', 'kind = "disk"\nradius = 0.5\nheight = 0.4\n']):
        ours += f'\n[[shape]]\n{text}material = "m"\ntransform = [{UP}]\n'
    turned = T().rotate([1, 0, 0], -90)
    shapes = {
        "cylinder": {"type": "cylinder", "p0": [0, 0, -1], "p1": [0, 0, 0.4], "radius": 0.5, "to_world": turned},
        "disk": {"type": "disk", "to_world": turned.translate([0, 0, 0.4]).scale(0.5)},
    }
    shapes = {name: {**shape, "bsdf": diffuse(0.7)} for name, shape in shapes.items()}
    yield "cylinder and disk", ours, {"floor": floor(), **shapes, "light": lamp()}, {}
    for name, (text, function, height) in QUADRICS.items():
        ours = f'{LAMP}{DIFFUSE}{FLOOR}\n[[shape]]\n{text}material = "m"\ntransform = [{UP}, {{ translate = [0, {height}, 0] }}]\n'
        to_world = T().translate([0, height, 0]).rotate([1, 0, 0], -90)
        shape = {"type": "ply", "filename": surface(folder, name, function), "to_world": to_world, "bsdf": diffuse(0.7)}
        yield name, ours, {"floor": floor(), "shape": shape, "light": lamp()}, {}
    path = surface(folder, "wave", wave, 96)
    ours = f'\n[[shape]]\nkind = "mesh"\nfile = "wave.ply"\nmaterial = "m"\n{LOWERED}'
    yield "mesh", LAMP + DIFFUSE + FLOOR + ours, {"floor": floor(), "shape": mesh(path, diffuse(0.7)), "light": lamp()}, {}
    for name, alpha in (("ggx", (0.3, 0.3)), ("beckmann", (0.25, 0.25))):
        extra = METAL.format(*alpha) + ('shadowing = "separable"\n' if name == "ggx" else "")
        ours = LAMP + SKY + GGX.format(name=name, extra=extra) + FLOOR + SPHERE
        yield name, ours, {"floor": floor(), "sphere": sphere(conductor(name, *alpha)), "light": lamp(), "sky": sky()}, {}
    for path in sorted(pathlib.Path(os.environ.get("LODEN_DATA", "/nowhere")).glob("rgl_epfl/paper_white_rgb.bsdf")):
        ours = f'[material.floor]\nmodel = "lambert"\nkd = [0.6, 0.5, 0.4]\n[material.m]\nfile = "{path}"\n'
        bsdf = {"type": "exchanged", "filename": str(path)}
        yield "measured", LAMP + SKY + ours + FLOOR + SPHERE, {"floor": floor(), "sphere": sphere(bsdf), "light": lamp(), "sky": sky()}, {}
    yield "orthographic", SUN + plain, {**theirs, "sun": sun()}, {"orthographic": 4.0}
    yield "lens", SUN + plain, {**theirs, "sun": sun()}, {"lens": (0.2, 4.0)}


def mesh(path, bsdf):
    lowered = T().translate([0, -0.5, 0]).rotate([1, 0, 0], -90)
    return {"type": "ply", "filename": path, "to_world": lowered, "bsdf": bsdf}


LOWERED = f"transform = [{UP}, {{ translate = [0, -0.5, 0] }}]\n"


def variants(folder):
    """Each scene; its mirror image, whose shapes have transforms that mirror; and instead of its sphere, a wave whose faces are
    wound against its normals, and a saddle."""
    upright = surface(folder, "upright", wave, 96)
    surface(folder, "turned", wave, 96, True)
    bend = lambda u, v: np.stack([2 * u - 1, 2 * v - 1, 0.5 * (2 * u - 1) * (2 * v - 1)], -1)
    saddle = surface(folder, "saddle", bend, 96)
    for name, text, description, camera in scenes(folder):
        yield name, text, description, camera
        # all shapes but the meshes are symmetric
        mirrored = text.replace(" }]\n", " }, { scale = [-1, 1, 1] }]\n")
        flip = lambda shape: {**shape, "to_world": T().scale([-1, 1, 1]) @ shape["to_world"]} if shape["type"] == "ply" else shape
        yield f"{name}, mirrored", mirrored, {key: flip(shape) for key, shape in description.items()}, camera
        # the measured table has no back, of which a saddle shows some
        if SPHERE in text and name != "measured":
            bsdf = description["sphere"]["bsdf"]
            bsdf = bsdf if bsdf["type"] == "twosided" else {"type": "twosided", "bsdf": bsdf}
            turned = '\n[[shape]]\nkind = "mesh"\nfile = "turned.ply"\nmaterial = "m"\n' + LOWERED
            yield f"{name}, turned", text.replace(SPHERE, turned), {**description, "sphere": mesh(upright, bsdf)}, camera
            # the same mesh for both: bilinear patches are cut into 8 x 8 cells, which shows at this noise
            bent = '\n[[shape]]\nkind = "mesh"\nfile = "saddle.ply"\nmaterial = "m"\n' + LOWERED
            yield f"{name}, saddle", text.replace(SPHERE, bent), {**description, "sphere": mesh(saddle, bsdf)}, camera


def render_ours(program, folder, text, camera, seed):
    path, out = os.path.join(folder, "scene.toml"), os.path.join(folder, "out.exr")
    extra = "field-of-view = 35\n"
    if "orthographic" in camera:
        extra = f"orthographic = {camera['orthographic']}\n"
    if "lens" in camera:
        extra += "lens-radius = {}\nfocus = {}\n".format(*camera["lens"])
    with open(path, "w") as file:
        file.write(f"depth = {DEPTH}\nbackground = 0\n[camera]\n{CAMERA}{extra}{text}")
    line = [program, "render", "--scene", path, "-o", out, "--size", str(SIZE), "--spp", str(SPP), "--seed", str(seed), "--force"]
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
    return np.array(mi.Bitmap(out).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))


def load_theirs(description, camera):
    sensor = {"type": "perspective", "fov": 35, "fov_axis": "smaller", "to_world": SENSOR}
    if "orthographic" in camera:
        half = camera["orthographic"] / 2
        sensor = {"type": "orthographic", "to_world": SENSOR.scale([half, half, 1])}
    if "lens" in camera:
        radius, focus = camera["lens"]
        sensor |= {"type": "thinlens", "aperture_radius": radius, "focus_distance": focus}
    sensor["film"] = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "tent"}, "component_format": "float32"}
    sensor["sampler"] = {"type": "independent", "sample_count": SPP}
    # our background is black, so their sky must not be seen either
    hide = any(name in description for name in ("sky", "environment"))
    integrator = {"type": "path", "max_depth": DEPTH, "rr_depth": 100, "hide_emitters": hide}
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **description})


def blocks(pictures):
    n = SIZE // BLOCK
    means = pictures.reshape(len(pictures), n, BLOCK, n, BLOCK, 3).mean((2, 4))
    # at the edge of the picture, Mitsuba has no samples of outer pixels to filter
    return means[:, 1:-1, 1:-1].reshape(len(pictures), -1, 3)


def compare(name, a, b):
    """z-scores must be distributed as Student's t; our variance, summed over the blocks, may be at most 1.5 times theirs."""
    a, b = blocks(a), blocks(b)
    variance = (a.var(0, ddof=1) + b.var(0, ddof=1)) / RUNS
    # rounding, and the triangulation of curved shapes
    floor = (1e-3 * (1e-3 + b.mean(0))) ** 2
    z = (a.mean(0) - b.mean(0)) / np.sqrt(variance + floor)
    lit = b.mean(0).sum(-1) > 1e-3
    rms, worst = np.sqrt((z[lit] ** 2).mean()), np.abs(z[lit]).max()
    error = np.sqrt((variance + floor).sum(0)) / len(z)
    bias = (a.mean(0) - b.mean(0)).mean(0)
    ratio = a.var(0, ddof=1)[lit].sum() / b.var(0, ddof=1)[lit].sum()
    line = f"{name}: mean {b.mean():.4f}, bias {np.abs(bias).max():.1e} of error {error.max():.1e}, z rms {rms:.2f}"
    print(f"{line}, worst {worst:.1f}, variance ours / theirs {ratio:.2f}", flush=True)
    # t with 13 to 26 degrees of freedom has a standard deviation of 1.09 to 1.04; a hundred blocks, three channels
    assert rms < 1.3 and worst < 7, f"{name}: blocks differ by more than noise"
    assert np.all(np.abs(bias) < 4 * error + 2e-4 * b.mean()), f"{name}: the mean differs by more than noise"
    assert ratio < 1.5, f"{name}: our variance is larger"


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    program = str(pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else root / "target/release/loden").resolve())
    only = sys.argv[2:]
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        for name, text, description, camera in variants(folder):
            if only and name not in only:
                continue
            ours = np.stack([render_ours(program, folder, text, camera, seed) for seed in range(RUNS)])
            scene = load_theirs(description, camera)
            theirs = np.stack([np.array(mi.render(scene, seed=100 + k)) for k in range(RUNS)])
            try:
                compare(name, ours, theirs)
            except AssertionError as error:
                print(f"FAILED {error}")
                failed.append(name)
    assert not failed, failed
    print("agrees with Mitsuba")


if __name__ == "__main__":
    main()
