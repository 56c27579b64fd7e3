#!/usr/bin/env python3
"""Makes the pictures of the gallery: python docs/gallery/make.py [--draft] [--loden FILE] [NAME ...]

Samples are measured by the virtual goniometer and compressed, once, into target/gallery; then the pictures are rendered
and stored as JPEG beside this file. `make gallery` builds the program first. --draft is small and noisy and goes to
target/gallery. Needs NumPy and Pillow.
"""

import argparse
import os
import pathlib
import subprocess

import numpy as np
from PIL import Image

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
WORK = ROOT / "target" / "gallery"

SAMPLES = {
    "leather": ["leather", "--cells", "10", "--size", "96"],
    "denim": ["twill", "--colors", "denim", "--yarns", "16", "--size", "96"],
    "lacquer": ["lacquer", "--size", "48"],
}

STUDIO = """
background = [0.05, 0.05, 0.055]
depth = 6
[environment]
file = "studio.hdr"
rotation = 20

[camera]
position = {position}
target = {target}
field-of-view = {fov}

[material.floor]
model = "lambert"
kd = {floor}

[[shape]]
kind = "disk"
radius = 60
material = "floor"
transform = [{{ rotate = [-90, 1, 0, 0] }}]
"""

# floors
DARK, LIGHT = [0.27, 0.265, 0.26], [0.42, 0.41, 0.39]

UPRIGHT = "{ rotate = [-90, 1, 0, 0] }"


def btf(name):
    return f'\n[material.{name}]\nfile = "{name}.loden"\n'


def metal(name, word, alpha):
    return f'\n[material.{name}]\nmodel = "ggx"\nkd = 0\nks = 1\nmetal = "{word}"\nalpha-x = {alpha[0]}\nalpha-y = {alpha[1]}\n'


def shape(kind, material, steps, rest=""):
    return f'\n[[shape]]\nkind = "{kind}"\nmaterial = "{material}"\n{rest}\ntransform = [{", ".join(steps)}]\n'


def teapot():
    text = STUDIO.format(position=[0.4, 2.35, 5.0], target=[0, 0.52, 0], fov=24, floor=DARK) + btf("leather")
    steps = ["{ scale = 1.3 }", "{ rotate = [-18, 0, 1, 0] }", "{ translate = [0, 0.5712, 0] }"]
    return text + shape("object", "leather", steps, 'name = "teapot"\nuv-scale = 5')


def cloth():
    text = STUDIO.format(position=[0.0, 1.9, 3.4], target=[0, 0.36, 0], fov=35, floor=DARK) + btf("denim")
    return text + shape("object", "denim", ["{ rotate = [25, 0, 1, 0] }"], 'name = "cloth"\nuv-scale = 7')


def row():
    text = STUDIO.format(position=[0, 3.4, 8.0], target=[0, 0.62, 0], fov=20, floor=LIGHT)
    text += metal("gold", "gold", (0.18, 0.18)) + metal("copper", "copper", (0.08, 0.35)) + btf("lacquer")
    text += '\n[material.clay]\nmodel = "oren-nayar"\nkd = [0.55, 0.3, 0.2]\n'
    for k, name in enumerate(("clay", "lacquer", "copper", "gold")):
        steps = [UPRIGHT, f"{{ translate = [{1.75 * k - 2.625}, 0.75, 0] }}"]
        text += shape("sphere", name, steps, "radius = 0.75\nuv-scale = 2")
    return text


# the scene, pixels, samples per pixel
PICTURES = {
    "teapot": (teapot, (560, 392), 64),
    "cloth": (cloth, (560, 392), 64),
    "row": (row, (560, 234), 64),
}


class Maker:
    def __init__(self, program, draft):
        self.program, self.draft = program.resolve(), draft
        self.folder = WORK if draft else HERE

    def run(self, *words):
        print("$ loden", *words, flush=True)
        line = [self.program, *map(str, words), "--quiet"]
        subprocess.run(line, check=True, cwd=WORK, preexec_fn=lambda: os.nice(10))

    def compressed(self, name):
        if not (WORK / f"{name}.zip").exists():
            self.run("acquire", *SAMPLES[name], "--spp", 8, "--exr", "-o", f"{name}.zip")
        if not (WORK / f"{name}.loden").exists():
            self.run("compress", f"{name}.zip", "--components", 9, "-o", f"{name}.loden")

    def picture(self, name):
        source, (width, height), spp = PICTURES[name]
        if self.draft:
            width, height, spp = width // 2, height // 2, 16
        quality = ["--size", f"{width}x{height}", "--spp", spp, "-o", f"{name}.png"]
        text = source()
        for sample in SAMPLES:
            if f'"{sample}.loden"' in text:
                self.compressed(sample)
        (WORK / f"{name}.toml").write_text(text)
        self.run("render", "--scene", f"{name}.toml", *quality)
        Image.open(WORK / f"{name}.png").convert("RGB").save(self.folder / f"{name}.jpg", quality=88, optimize=True)


def studio():
    """A grey room with a large lamp, a window and a strip, as Radiance HDR without run lengths."""
    width, height = 512, 256
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    # azimuth and height above the horizon, degrees
    azimuth, elevation = 360 * u, 90 - 180 * v

    def edge(x, half, soft):
        return 1 / (1 + np.exp((np.abs(x) - half) / soft * 4))

    def panel(at, up, wide, high, soft=4.0):
        turn = (azimuth - at + 180) % 360 - 180
        return (edge(turn, wide, soft) * edge(elevation - up, high, soft))[..., None]

    base = 0.16 + 0.2 * np.clip(elevation / 90, 0, 1)
    light = base[..., None] * [0.95, 1, 1.08]
    light = light + panel(60, 48, 34, 18) * np.array([6.2, 6.0, 5.6])
    light = light + panel(215, 28, 16, 22) * np.array([3.6, 4.2, 5.2])
    light = light + panel(310, 20, 5, 14, 2) * np.array([5.5, 4.6, 3.4])
    exponent = np.ceil(np.log2(light.max(-1)))
    mantissa = np.clip(light * (256 / 2**exponent)[..., None], 0, 255)
    pixels = np.concatenate([mantissa, (exponent + 128)[..., None]], -1)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    (WORK / "studio.hdr").write_bytes(head.encode() + pixels.astype(np.uint8).tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draft", action="store_true")
    parser.add_argument("--loden", type=pathlib.Path, default=ROOT / "target" / "release" / "loden")
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    studio()
    maker = Maker(arguments.loden, arguments.draft)
    for name in arguments.names or PICTURES:
        maker.picture(name)


if __name__ == "__main__":
    main()
