#!/usr/bin/env python3
"""Renders the images of the gallery and writes its page: python docs/gallery/make.py [--draft] [--loden FILE] [NAME ...]

The samples are measured with the virtual goniometer and compressed into target/gallery, once. The images are stored as
JPEG next to this file, and README.md is written with the measured sizes and errors. `make gallery` builds the program
first. --draft renders small, noisy images into target/gallery. With names, only these images are rendered, without the
page. Needs NumPy and Pillow.
"""

import argparse
import dataclasses
import json
import pathlib
import subprocess
import time

import numpy as np
from PIL import Image

import scenes

HERE = pathlib.Path(__file__).resolve().parent
WORK = scenes.ROOT / "target" / "gallery"

YARN = ["--size", "128", "--spp", "4", "--depth", "3"]

SAMPLES = {
    "leather": ["leather", "--cells", "10", "--size", "144"],
    "denim": ["twill", "--colors", "denim", "--yarns", "16", "--size", "144"],
    "gravel": ["gravel", "--size", "128"],
    "lacquer": ["lacquer", "--size", "48"],
    "twill-yarns": ["yarn", "--weave", "twill", *YARN],
    "satin-yarns": ["yarn", "--weave", "satin", "--yarns", "16", "--warp", "0.45,0.02,0.03", "--weft", "0.3,0.02,0.05",
                    "--specular", "0.08", "--roughness-along", "0.15", "--roughness-across", "0.5", "--fuzz", "0", *YARN],
    "linen-yarns": ["yarn", "--weave", "plain", "--yarns", "8", "--plies", "1", "--width", "0.85", "--warp", "0.5,0.42,0.3", "--weft", "0.55,0.47,0.34",
                    "--fuzz", "8", *YARN],
    "basket-yarns": ["yarn", "--weave", "basket", "--plies", "3", "--warp", "0.05,0.2,0.12", "--weft", "0.5,0.45,0.2", *YARN],
    "mail": ["mesh", "--object", "mail.obj", "--periodic", "--tile", "4", "--specular", "0.6", "--roughness", "0.25", "--size", "96", "--spp", "4", "--depth", "3"],
    "steel": ["lacquer", "--base", "steel", "--slope", "0.5", "--roughness", "0.1", "--size", "48"],
}

HAMMERED = ["maps", "--height", "hammered.png", "--height-scale", "0.03", "--specular", "0.1", "--roughness", "0.2", "--grid", "256", "--size", "64"]
SAMPLES["yellow"] = [*HAMMERED, "--albedo", "yellow.png"]
SAMPLES["red"] = [*HAMMERED, "--albedo", "red.png"]

# linear colours of the hammered samples
PAINTS = {"yellow": (0.6, 0.42, 0.05), "red": (0.55, 0.06, 0.05)}

# pattern and reflectance
EXCHANGED = ("denim", "leather", "gravel")

EDITS = {
    "hue": ["--recolor", "hue=90"], "sharp": ["--gloss", "2"], "dull": ["--gloss", "0.5"], "flat": ["--contrast", "0"],
    "deep": ["--contrast", "1.6"], "warm": ["--tint", "ffd0a0"], "grey": ["--desaturate", "1"],
}

# materials that are made of others: the command, without its output
MADE = {
    **{f"rows-{name}": ["compress", f"{name}.zip", "--method", "kmeans", "--precision", "f16"] for name in (*EXCHANGED, *PAINTS)},
    **{f"{a}-{b}-{by}": ["generate", "exchange", "--structure", f"rows-{a}.loden", "--reflectance", f"rows-{b}.loden", "--match", by]
       for by in ("index", "transport") for a in EXCHANGED for b in EXCHANGED},
    **{f"leather-{name}": ["edit", "rows-leather.loden", *words] for name, words in EDITS.items()},
    "painted": ["edit", "rows-yellow.loden", "--recolor", "from=cbad3f,to=c4453f"],
    "tinted": ["edit", "rows-yellow.loden", "--tint", "f56aff"],
}

# the compressed forms on the sheet: description and options
FORMS = {
    "klt": ("`klt`, 64 components, step 1.3", ["--method", "klt", "--components", "64", "--step", "1.3"]),
    "pvmf": ("`pvmf`, 9 components", ["--method", "pvmf", "--components", "9"]),
    "median-cut": ("`median-cut`, 256 boxes", ["--method", "median-cut"]),
}


@dataclasses.dataclass
class Picture:
    """An image of one or more scenes side by side, and its caption, where {name} is the file size of that sample."""

    alt: str
    caption: str
    scenes: list
    size: tuple
    spp: int
    columns: int = 1


# the materials on bulbs, and how often they repeat
BULBS = {"leather": 3, "twill-yarns": 3, "gravel": 2, "lacquer": 4}

# the BRDFs that are factored: models of scenes.py as `loden factor` takes them
FACTORED = {
    "satin": "ward:kd=0.25,0.03,0.03:ks=0.25:alpha-x=0.15:alpha-y=0.5",
    "pearl": "cook-torrance:kd=0.35,0.33,0.3:ks=1:m=0.3",
}

PICTURES = {
    "teapot": Picture(
        "A teapot of brown leather",
        "Leather: 144 x 144 texels, 81 x 81 pairs of directions, compressed with `pvmf`, nine components per view: {leather}.",
        [scenes.teapot], (960, 672), 256),
    "still-life": Picture(
        "A stone bowl with balls of denim and gold, a red vase, a copper ring and a cone of leather",
        "Quadrics with four compressed BTFs (`pvmf`, nine components): gravel of 128 x 128 texels ({gravel}) by triplanar projection, red lacquer of "
        "48 x 48 ({lacquer}) and leather of 144 x 144 ({leather}) by cylindrical projection, and twill of 144 x 144 ({denim}) in the texture coordinates of "
        "the ball. Gold and copper are GGX.",
        [scenes.still_life], (960, 672), 512),
    "cloth": Picture(
        "A cloth of blue and white twill over a ball",
        "Twill of 144 x 144 texels, `pvmf` with nine components, {denim}. The highlights follow the folds because directions are relative to the cloth.",
        [scenes.cloth], (960, 672), 256),
    "samples": Picture(
        "Four cloths: brown leather, blue twill, gravel, brushed steel",
        "The four built-in samples on the same draped cloth, `pvmf` with nine components: leather ({leather}) and twill ({denim}) of 144 x 144 "
        "texels, gravel ({gravel}) of 128 x 128, and the bare metal of the lacquer sample ({steel}) of 48 x 48.",
        [lambda: scenes.cloth("leather", 4), lambda: scenes.cloth("denim", 4), lambda: scenes.cloth("gravel", 3), lambda: scenes.cloth("steel", 3)],
        (480, 336), 256, 2),
    "brushed": Picture(
        "Three balls of brushed steel with differently oriented highlights",
        "One BTF of brushed steel, 48 x 48 texels, `pvmf` with nine components, {steel}. It is rotated by 0, 45 and 90 degrees (`uv-rotation`), and the "
        "highlight rotates with the grooves.",
        [scenes.brushed], (960, 384), 512),
    "row": Picture(
        "Balls of clay, red lacquer, brushed copper and gold",
        "From the left: clay (Oren-Nayar); a compressed lacquer of 48 x 48 texels ({lacquer}); copper (GGX, roughness 0.35 along the meridians and 0.08 along "
        "the parallels); gold (GGX, roughness 0.18).",
        [scenes.row], (960, 400), 512),
    "yarns": Picture(
        "Four cloths woven of plied yarns: twill, satin, linen, basket weave",
        "Yarns built as geometry (`loden acquire yarn`), 128 x 128 texels, `pvmf` with nine components: a blue and white twill of three plies ({twill-yarns}), "
        "a red satin ({satin-yarns}), single-ply linen in plain weave ({linen-yarns}) and a basket weave of three plies ({basket-yarns}).",
        [lambda: scenes.cloth("twill-yarns", 4), lambda: scenes.cloth("satin-yarns", 3), lambda: scenes.cloth("linen-yarns", 4), lambda: scenes.cloth("basket-yarns", 4)],
        (480, 336), 256, 2),
    "mail": Picture(
        "A cloth of chain mail",
        "Rings of a mesh file, linked with their neighbours and with holes between them (`loden acquire mesh`), 96 x 96 texels, `pvmf` with nine "
        "components, {mail}. What is seen through holes is black.",
        [lambda: scenes.cloth("mail", 4)], (960, 672), 256),
    "bulbs": Picture(
        "Six light bulbs: three with a plain texture at different scales, three with a BTF at different rotations",
        "The bulb wears a cloth of yarns. Above, a plain texture, the photograph from above, repeated at the scales 1, 0.4 and 0.2 (`uv-scale`); below, the BTF "
        "at the scale 1, and rotated about the normal by -90 and 135 degrees (`uv-rotation`).",
        [lambda: scenes.textured_bulb("twill-yarns", 2), lambda: scenes.textured_bulb("twill-yarns", 5), lambda: scenes.textured_bulb("twill-yarns", 10),
         lambda: scenes.dressed_bulb("twill-yarns", 2), lambda: scenes.dressed_bulb("twill-yarns", 2, -90), lambda: scenes.dressed_bulb("twill-yarns", 2, 135)],
        (320, 360), 96, 3),
    "bulb-materials": Picture(
        "Light bulbs of leather, cloth, gravel and red lacquer, as plain textures and as BTFs",
        "Four materials: above as plain textures, below as BTFs. Textures have no highlights of their own, no parallax and no shadows that move with the light.",
        [*(lambda name=name, scale=scale: scenes.textured_bulb(name, scale) for name, scale in BULBS.items()),
         *(lambda name=name, scale=scale: scenes.dressed_bulb(name, scale) for name, scale in BULBS.items())],
        (240, 270), 96, 4),
    "factored": Picture(
        "Four teapots: two BRDF models and their homomorphic factorisations",
        "Above, two models: Ward's, anisotropic, and Cook and Torrance's. Below, what three factors make of them (`loden factor --method hf --resolution 32`): two "
        "tables of 32 x 32, one for light and view and one for the half vector.",
        [lambda: scenes.model_teapot("satin", False), lambda: scenes.model_teapot("pearl", False),
         lambda: scenes.model_teapot("satin", True), lambda: scenes.model_teapot("pearl", True)],
        (480, 336), 256, 2),
    "exchanged": Picture(
        "Two grids of nine cloths: patterns of twill, leather and gravel with the reflectance of each",
        "`loden generate exchange`: from the top the patterns of twill, leather and gravel, from the left the reflectances of the same three, so the diagonal has the "
        "materials themselves. On the left, rows are matched by number: the grain of leather falls to pieces. On the right they are matched by "
        "optimal transport, which keeps threads, grains and stones.",
        [lambda a=a, b=b, by=by: scenes.cloth(f"{a}-{b}-{by}", 3) for a in EXCHANGED for by in ("index", "transport") for b in EXCHANGED],
        (240, 200), 64, 6),
    "recoloured": Picture(
        "Four teapots of hammered paint: yellow, two that were made red, and one that was measured red",
        "Hammered yellow paint of 64 x 64 texels as it was measured; made red by `loden edit --recolor`, whose highlights stay white; made red by multiplying all values by "
        "a colour, highlights too; and red paint as it was measured on the same relief.",
        [lambda name=name: scenes.teapot(name) for name in ("rows-yellow", "painted", "tinted", "rows-red")], (480, 336), 64, 2),
    "edited": Picture(
        "Eight cloths of leather: as measured, and after seven edits",
        "`loden edit`: leather as measured; `--recolor hue=90`; `--gloss 2`; `--gloss 0.5`; below `--contrast 0`, `--contrast 1.6`, `--tint ffd0a0` and `--desaturate 1`.",
        [lambda name=name: scenes.cloth(name, 3) for name in ("rows-leather", *(f"leather-{edit}" for edit in EDITS))], (300, 260), 64, 4),
    "light-bulb": Picture(
        "Two light bulbs, one of them lit",
        "[`scenes/light-bulb.toml`](../../scenes/light-bulb.toml): quadrics and analytic BRDFs, lit by the bulb that is switched on.",
        [lambda: scenes.shipped("light-bulb")], (880, 660), 1024),
    "cornell-box": Picture(
        "The Cornell box",
        "[`scenes/cornell-box.toml`](../../scenes/cornell-box.toml): with paths of up to eight segments, the walls cast their red and green onto the blocks.",
        [lambda: scenes.shipped("cornell-box")], (640, 640), 1024),
}

SHEET = """![Four cloths and their difference images](sheet.jpg)

The denim on a draped cloth: on the left the original, then the compressed materials in the order of the table. Below are the
differences of displayed values, magnified eight times. The original has 144 x 144 texels and 81 x 81 pairs of directions, {raw}
as 8-bit values. The mean error is that of all values, as a fraction of white (`loden info`); FLIP compares the images of the
sheet (`loden render --sheet`).

| method | size | fraction of raw | mean error | FLIP |
|---|---|---|---|---|
{rows}
"""

PAGE = """# Gallery

`make gallery` renders these images and writes this page. It measures samples with the virtual goniometer, compresses them and
renders the scenes of [scenes.py](scenes.py) with [make.py](make.py), which also paints the studio that lights most of them.
`python docs/gallery/make.py teapot` renders one image; `--draft` makes small, noisy ones. Sizes are those of the compressed
files.

{pictures}
{sheet}
![Leather and eleven variants in other colours](family.jpg)

Leather, and the variants that `loden generate family rows-leather.loden -n 11` makes of it.

![One image of a twill, and what 2 to 30 components make of it](components.jpg)

The twill of yarns, view 15, 60 and light 60, 342 degrees: the original and what `pvmf` makes of it with c components; below, the errors,
magnified eight times. `loden sweep` writes this picture.
"""


def size(path):
    return f"{path.stat().st_size / 1e6:.2f} MB"


class Maker:
    def __init__(self, program, draft):
        self.program, self.draft = program.resolve(), draft
        self.folder = WORK if draft else HERE

    def run(self, *words):
        print("$ loden", *words, flush=True)
        line = [self.program, *map(str, words), "--quiet", "--json", "--force"]
        done = subprocess.run(line, check=True, cwd=WORK, stdout=subprocess.PIPE, text=True)
        return json.loads(done.stdout)

    def measured(self, name):
        if name == "mail":
            mail()
        if name in PAINTS:
            hammered()
        if not (WORK / f"{name}.zip").exists():
            spp = [] if "--spp" in SAMPLES[name] else ["--spp", 8]
            self.run("acquire", *SAMPLES[name], *spp, "--exr", "-o", f"{name}.zip")

    def made(self, name):
        """A material of MADE, after those that it is made of."""
        if (WORK / f"{name}.loden").exists():
            return
        for source in map(pathlib.Path, MADE[name]):
            if source.suffix == ".zip":
                self.measured(source.stem)
            if source.suffix == ".loden":
                self.made(source.stem)
        self.run(*MADE[name], "-o", f"{name}.loden")

    def compressed(self, name):
        self.measured(name)
        if not (WORK / f"{name}.loden").exists():
            self.run("compress", f"{name}.zip", "--method", "pvmf", "--components", 9, "-o", f"{name}.loden")

    def flattened(self, name):
        """The photograph from above as a set of one picture."""
        if not (WORK / f"{name}-flat.toml").exists():
            self.compressed(name)
            self.run("decompress", f"{name}.loden", "--light", "0,0", "--view", "0,0", "-o", f"{name}-flat.png")
            text = f'loden_images = 1\nfiles = "{name}-flat.png"\nviews = [[0, 0]]\nlights = [[0, 0]]\n'
            (WORK / f"{name}-flat.toml").write_text(text)

    def factored(self, name):
        if not (WORK / f"factored-{name}").exists():
            self.run("factor", FACTORED[name], "--method", "hf", "--resolution", "32", "-o", f"factored-{name}")

    def store(self, picture, name):
        picture.save(self.folder / f"{name}.jpg", quality=88, optimize=True)

    def picture(self, name):
        wanted = PICTURES[name]
        (width, height), spp = wanted.size, wanted.spp
        if self.draft:
            width, height, spp = width // 2, height // 2, 16
        rows = -(-len(wanted.scenes) // wanted.columns)
        whole = Image.new("RGB", (width * wanted.columns, height * rows))
        for k, source in enumerate(wanted.scenes):
            text = source()
            for sample in SAMPLES:
                if f'"{sample}.loden"' in text:
                    self.compressed(sample)
                if f'"{sample}-flat.toml"' in text:
                    self.flattened(sample)
            for made in MADE:
                if f'"{made}.loden"' in text:
                    self.made(made)
            for name_of in FACTORED:
                if f"factored-{name_of}/" in text:
                    self.factored(name_of)
            part = WORK / f"{name}-{k}.toml"
            part.write_text(text)
            self.run("render", "--scene", part.name, "--size", f"{width}x{height}", "--spp", spp, "-o", part.with_suffix(".png"))
            whole.paste(Image.open(part.with_suffix(".png")).convert("RGB"), (k % wanted.columns * width, k // wanted.columns * height))
        self.store(whole, name)

    def sheet(self):
        """Renders the sheet of the original and compressed denim; keeps the rows of the table."""
        self.compressed("denim")
        files = [f"form-{name}.loden" for name in FORMS]
        for file, (_, flags) in zip(files, FORMS.values()):
            if not (WORK / file).exists():
                self.run("compress", "denim.zip", *flags, "-o", file)
        look = ["--object", "cloth", "--uv-scale", 4, "--size", "104x96" if self.draft else "240x224", "--spp", 16 if self.draft else 256]
        found = self.run("render", "--sheet", "denim.zip", *files, *look, "-o", "sheet.png")
        (WORK / "sheet.json").write_text(json.dumps(found))
        self.store(Image.open(WORK / "sheet.png").convert("RGB"), "sheet")

    def components(self):
        """One image of the yarns for every number of components, from a sweep."""
        self.compressed("twill-yarns")
        self.run("sweep", "twill-yarns.zip", "--methods", "pvmf", "--draft", "-o", "swept")
        self.store(Image.open(WORK / "swept" / "components.png").convert("RGB"), "components")

    def family(self):
        """Leather and eleven variants."""
        self.made("rows-leather")
        self.run("generate", "family", "rows-leather.loden", "-n", 11, "-o", "family")
        self.store(Image.open(WORK / "family" / "sheet.png").convert("RGB"), "family")

    def page(self):
        sizes = {name: size(WORK / f"{name}.loden") for name in SAMPLES if (WORK / f"{name}.loden").exists()}
        pictures = [f"![{p.alt}]({name}.jpg)\n\n{p.caption.format(**sizes)}\n" for name, p in PICTURES.items()]
        raw = 144 * 144 * 81 * 81 * 3
        shown = json.loads((WORK / "sheet.json").read_text())
        rows = []
        for (name, (words, _)), row in zip(FORMS.items(), shown):
            file = WORK / f"form-{name}.loden"
            error, flip = self.run("info", file.name)["mean_abs_error"], row["flip"]
            rows.append(f"| {words} | {size(file)} | 1/{raw / file.stat().st_size:.0f} | {error:.4f} | {flip:.3f} |")
        sheet = SHEET.format(raw=f"{raw / 1e6:.0f} MB", rows="\n".join(rows))
        (self.folder / "README.md").write_text(PAGE.format(pictures="\n".join(pictures), sheet=sheet).rstrip() + "\n")


def mail():
    """Chain mail as an OBJ file, y up: rings that lean alternately and pass through four neighbours each; 4 x 4 units repeat."""
    if (WORK / "mail.obj").exists():
        return
    around, section, radius, wire = 48, 14, 0.62, 0.1
    a, b = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(section) * 2 * np.pi / section, indexing="ij")
    outward = np.stack([np.cos(a), np.sin(a), 0 * a], -1)
    normals = outward * np.cos(b)[..., None] + np.array([0, 0, 1]) * np.sin(b)[..., None]
    points = outward * radius + wire * normals
    k, j = np.meshgrid(np.arange(around), np.arange(section), indexing="ij")
    at = lambda k, j: (k % around) * section + j % section
    faces = np.stack([at(k, j), at(k + 1, j), at(k + 1, j + 1), at(k, j + 1)], -1).reshape(-1, 4)
    lines, count = [], 0
    for row in range(8):
        # every other row leans the other way and lies half a ring aside
        lean = np.radians(38 if row % 2 else -38)
        turn = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]])
        for column in range(4):
            x, y, z = (turn @ points.reshape(-1, 3).T) + np.array([[column + 0.5 * (row % 2)], [0.5 * row], [0]])
            nx, ny, nz = turn @ normals.reshape(-1, 3).T
            lines += [f"v {p:.6f} {r:.6f} {-q:.6f}" for p, q, r in zip(x, y, z)]
            lines += [f"vn {p:.5f} {r:.5f} {-q:.5f}" for p, q, r in zip(nx, ny, nz)]
            lines += ["f " + " ".join(f"{i + count + 1}//{i + count + 1}" for i in face) for face in faces]
            count += around * section
    (WORK / "mail.obj").write_text("\n".join(lines) + "\n")


def hammered():
    """A height map of overlapping dents, which repeats, and pictures of the paints."""
    x, y = np.meshgrid(np.arange(256) / 256, np.arange(256) / 256)
    height = np.ones_like(x)
    for u, v, radius, depth in np.random.default_rng(5).uniform([0, 0, 0.05, 0.3], [1, 1, 0.11, 1], (160, 4)):
        away = np.hypot((x - u + 0.5) % 1 - 0.5, (y - v + 0.5) % 1 - 0.5) / radius
        height = np.minimum(height, 1 - depth * np.clip(1 - away**2, 0, 1))
    Image.fromarray((height * 65535).astype(np.uint16)).save(WORK / "hammered.png")
    for name, linear in PAINTS.items():
        shown = [12.92 * v if v < 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055 for v in linear]
        Image.new("RGB", (8, 8), tuple(round(255 * v) for v in shown)).save(WORK / f"{name}.png")


def studio():
    """A grey room with a large lamp, a window and a strip light, as Radiance HDR without run-length encoding."""
    width, height = 512, 256
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    # azimuth and height above the horizon, degrees
    azimuth, elevation = 360 * u, 90 - 180 * v

    def edge(x, half, soft):
        return 1 / (1 + np.exp((np.abs(x) - half) / soft * 4))

    def panel(at, up, wide, high, soft=4.0):
        turn = (azimuth - at + 180) % 360 - 180
        return (edge(turn, wide, soft) * edge(elevation - up, high, soft))[..., None]

    base = 0.09 + 0.13 * np.clip(elevation / 90, 0, 1)
    light = base[..., None] * [0.95, 1, 1.08]
    light = light + panel(60, 48, 30, 16) * np.array([11.5, 11.0, 10.1])
    light = light + panel(215, 28, 16, 22) * np.array([3.6, 4.2, 5.2])
    light = light + panel(310, 20, 5, 14, 2) * np.array([5.5, 4.6, 3.4])
    exponent = np.ceil(np.log2(light.max(-1)))
    mantissa = np.clip(light * (256 / 2**exponent)[..., None], 0, 255)
    pixels = np.concatenate([mantissa, (exponent + 128)[..., None]], -1)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    (WORK / "studio.hdr").write_bytes(head.encode() + pixels.astype(np.uint8).tobytes())


def main():
    others = ("sheet", "components", "family")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draft", action="store_true")
    parser.add_argument("--loden", type=pathlib.Path, default=scenes.ROOT / "target" / "release" / "loden")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join([*PICTURES, *others]))
    arguments = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    start = time.time()
    studio()
    maker = Maker(arguments.loden, arguments.draft)
    for name in arguments.names or [*PICTURES, *others]:
        getattr(maker, name)() if name in others else maker.picture(name)
    if not arguments.names:
        maker.page()
    print(f"{time.time() - start:.0f} s")


if __name__ == "__main__":
    main()
