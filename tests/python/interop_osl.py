"""Compares materials exported to Open Shading Language, drawn by Blender's Cycles, with our own pictures.

Usage: python interop_osl.py [LODEN], the path of the built program, with a Python that has bpy: `make test-interop` installs it (Python
3.11: pip install bpy==5.0.1, 374 MB) into target/bpy and runs this.

A ball under one distant light, at three angles, is drawn by both programs and compared pixel by pixel away from the silhouette. Then files
are damaged: the ball must become magenta, and Blender must live.
"""

import importlib
import pathlib
import subprocess
import sys
import tempfile

import bpy
import numpy as np

SIZE, SAMPLES = 192, 64
LIGHTS = [15, 45, 75]
METHODS = {"pvmf": [], "klt": [], "median-cut": []}
WARD = "ward:alpha-x=0.2:alpha-y=0.5:kd=0.2,0.1,0.05:ks=0.2"
# mean absolute difference, as a fraction of full scale
TOLERANCE = 0.004
EYE = np.array([0, -5.0, 2.0])


def sun(angle):
    """A direction at an angle from that of the camera."""
    forward = EYE / np.linalg.norm(EYE)
    side = np.array([0.9, 0.0, 0.0]) + 0.4 * np.cross([1, 0, 0], forward)
    side /= np.linalg.norm(side)
    return np.cos(np.radians(angle)) * forward + np.sin(np.radians(angle)) * side


def pixels(path):
    """An EXR file as linear RGB, row 0 at the bottom."""
    image = bpy.data.images.load(str(path))
    found = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], -1)[..., :3]
    bpy.data.images.remove(image)
    return found


def ours(program, folder, material, angle):
    text = f"""
[camera]
position = {EYE.tolist()}
target = [0, 0, 0]
up = [0, 0, 1]
field-of-view = 28
[material.m]
file = "{material}"
[[light]]
kind = "directional"
direction = {sun(angle).tolist()}
irradiance = 3.14159265
[[shape]]
kind = "sphere"
material = "m"
uv-scale = 4
mapping = {{ kind = "sphere", centre = [0, 0, 0], axis = [0, 0, 1] }}
"""
    (folder / "scene.toml").write_text(text)
    command = [program, "render", "--scene", folder / "scene.toml", "-o", folder / "ours.exr", "--size", f"{SIZE}x{SIZE}", "--spp", "64", "--force", "-q"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return pixels(folder / "ours.exr")


def theirs(exported, folder, angle):
    """The picture of the exported scene; Blender keeps nothing of the material before it."""
    sys.path.insert(0, str(exported))
    for name in ("loden_material", "scene"):
        sys.modules.pop(name, None)
    importlib.import_module("scene").render(folder / "theirs.exr", sun(angle).tolist(), SIZE, SAMPLES)
    sys.path.pop(0)
    return pixels(folder / "theirs.exr")


def inside():
    """The pixels of the ball but for its silhouette."""
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    radius = np.hypot(x - SIZE / 2, y - SIZE / 2) / (SIZE / 2)
    return radius < 0.85 * np.tan(np.arcsin(1 / np.linalg.norm(EYE))) / np.tan(np.radians(14))


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/loden"
    run = lambda *words: subprocess.run([program, *words, "-q"], check=True, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run("acquire", "twill", "--size", "24", "--spp", "4", "-o", folder / "twill.zip")
        for name, few in METHODS.items():
            run("compress", folder / "twill.zip", "--method", name, *few, "-o", folder / f"{name}.loden")
            run("export", folder / f"{name}.loden", "--to", "osl", "-o", folder / name)
            compare(program, folder, name, folder / name, f"{name}.loden")
        run("export", WARD, "--to", "osl", "-o", folder / "ward")
        compare(program, folder, "ward", folder / "ward", "ward/material.loden")
        check_damage(folder)


def compare(program, folder, name, exported, material):
    for angle in LIGHTS:
        a, b = ours(program, folder, material, angle)[inside()], theirs(exported, folder, angle)[inside()]
        difference = np.abs(a - b).mean()
        print(f"{name}, light at {angle} degrees: mean {a.mean():.4f}, mean difference {difference:.5f}, bias {(b - a).mean():+.5f}", flush=True)
        assert a.mean() > 0.01 and difference < TOLERANCE


def check_damage(folder):
    """A texture that is missing or another picture, one after the other."""
    texture = folder / "klt" / "numbers.exr"
    whole = texture.read_bytes()
    for name, content in (("missing", None), ("another picture", (folder / "theirs.exr").read_bytes())):
        texture.unlink()
        if content is not None:
            texture.write_bytes(content)
        mean = theirs(folder / "klt", folder, 15)[inside()].mean(0)
        print(f"texture {name}: the ball is {np.round(mean, 3)}")
        assert np.abs(mean - [1, 0, 1]).max() < 0.01
        texture.write_bytes(whole)


main()
