"""The scenes of the gallery in the TOML format of `loden render --scene` (docs/scenes.md)."""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent

STUDIO = """
background = {background}
depth = 6
[environment]
file = "studio.hdr"
rotation = {turn}

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
DARK, LIGHT, SLATE = [0.27, 0.265, 0.26], [0.42, 0.41, 0.39], [0.10, 0.12, 0.14]

UPRIGHT = "{ rotate = [-90, 1, 0, 0] }"


def studio(position, target, fov, floor=DARK, turn=-20):
    return STUDIO.format(position=position, target=target, fov=fov, floor=floor, turn=turn, background=[0.05, 0.05, 0.055])


def btf(name):
    return f'\n[material.{name}]\nfile = "{name}.loden"\n'


def metal(name, word, alpha):
    return f'\n[material.{name}]\nmodel = "ggx"\nkd = 0\nks = 1\nmetal = "{word}"\nalpha-x = {alpha[0]}\nalpha-y = {alpha[1]}\n'


def shape(kind, material, steps, rest=""):
    return f'\n[[shape]]\nkind = "{kind}"\nmaterial = "{material}"\n{rest}\ntransform = [{", ".join(steps)}]\n'


def moved(x, y, z):
    return f"{{ translate = [{x}, {y}, {z}] }}"


def turned(degrees):
    return f"{{ rotate = [{degrees}, 0, 1, 0] }}"


def teapot(sample="leather"):
    text = studio([0.4, 2.35, 5.0], [0, 0.52, 0], 24) + btf(sample)
    return text + shape("object", sample, ["{ scale = 1.3 }", turned(-18), moved(0, 0.5712, 0)], 'name = "teapot"\nuv-scale = 5')


def cloth(sample="denim", repeats=7):
    text = studio([0.0, 1.9, 3.4], [0, 0.36, 0], 35) + btf(sample)
    return text + shape("object", sample, [turned(25)], f'name = "cloth"\nuv-scale = {repeats}')


def row():
    text = studio([0, 3.4, 8.0], [0, 0.62, 0], 20, LIGHT)
    text += metal("gold", "gold", (0.18, 0.18)) + metal("copper", "copper", (0.08, 0.35)) + btf("lacquer")
    text += '\n[material.clay]\nmodel = "oren-nayar"\nkd = [0.55, 0.3, 0.2]\n'
    for k, name in enumerate(("clay", "lacquer", "copper", "gold")):
        text += shape("sphere", name, [UPRIGHT, moved(1.75 * k - 2.625, 0.75, 0)], "radius = 0.75\nuv-scale = 2")
    return text


LAMP = """
[[light]]
kind = "directional"
direction = [-0.5, 1.4, 1.6]
irradiance = 3
radius = 4
"""


def brushed():
    """Three balls of the same steel under one lamp; only the direction of the grooves differs."""
    text = studio([0, 2.6, 7.6], [0, 0.8, 0], 20, DARK).replace('file = "studio.hdr"\nrotation = 20', "radiance = [0.3, 0.32, 0.35]") + LAMP + btf("steel")
    for k, degrees in enumerate((0, 45, 90)):
        rest = f"radius = 0.9\nuv-scale = 3\nuv-rotation = {degrees}"
        text += shape("sphere", "steel", [UPRIGHT, turned(20), moved(2.1 * k - 2.1, 0.9, 0)], rest)
    return text


def still_life():
    """Quadrics: a bowl (paraboloid) with two balls, a vase (hyperboloid), a ring (torus), a cone."""
    text = studio([0.5, 2.7, 6.4], [0.05, 0.62, 0], 25, SLATE, 40)
    text += "".join(map(btf, ("gravel", "lacquer", "denim", "leather"))) + metal("gold", "gold", (0.15, 0.15)) + metal("copper", "copper", (0.25, 0.25))
    text += shape("paraboloid", "gravel", [UPRIGHT, moved(0.35, 0, 0.5)], 'radius = 0.85\nz-min = 0\nz-max = 0.6\nuv-scale = 1\nmapping = { kind = "triplanar", origin = [0, 0, 0], size = 0.9 }')
    text += shape("sphere", "denim", [UPRIGHT, turned(30), moved(0.13, 0.58, 0.42)], "radius = 0.36\nuv-scale = 2")
    text += shape("sphere", "gold", [UPRIGHT, moved(0.66, 0.55, 0.6)], "radius = 0.24")
    vase = "from = [0.44, 0, 0]\nto = [-0.12, 0.40, 1.75]\nuv-scale = 2\nmapping = { kind = \"cylinder\", centre = [-1.15, 0, -0.35], axis = [0, 1.15, 0] }"
    text += shape("hyperboloid", "lacquer", [UPRIGHT, moved(-1.15, 0, -0.35)], vase)
    text += shape("torus", "copper", [UPRIGHT, moved(-0.95, 0.13, 0.95)], "major-radius = 0.4\nminor-radius = 0.13")
    text += shape("cone", "leather", [UPRIGHT, moved(1.45, 0, -0.55)], 'height = 1.35\nradius = 0.55\nuv-scale = 2\nmapping = { kind = "cylinder", centre = [1.45, 0, -0.55], axis = [0, 0.9, 0] }')
    return text


def flat(name):
    """The photograph from above as a plain texture: a material with one view and one light."""
    return f'\n[material.{name}-flat]\nfile = "{name}-flat.toml"\n'


BRASS = """
[material.brass]
model = "ggx"
kd = 0
ks = [0.75, 0.55, 0.27]
alpha-x = 0.25
alpha-y = 0.25

[material.black]
model = "lambert"
kd = 0.03
"""


def bulb(material, rest):
    """A bulb on its contact, of quadrics; its glass wears a material in the coordinates of a sphere around it."""
    text = studio([0, 2.5, 6.2], [0, 1.17, 0], 25.5, DARK, 30) + BRASS
    text += shape("cylinder", "brass", [UPRIGHT], "radius = 0.12\nz-min = 0.0\nz-max = 0.06")
    text += shape("hyperboloid", "black", [UPRIGHT], "from = [0.12, 0, 0.06]\nto = [0.3, 0, 0.16]")
    text += shape("cylinder", "brass", [UPRIGHT], "radius = 0.3\nz-min = 0.16\nz-max = 0.58")
    for height in (0.22, 0.31, 0.40, 0.49):
        text += shape("torus", "brass", [moved(0, 0, height), UPRIGHT], "major-radius = 0.3\nminor-radius = 0.045")
    text += shape("hyperboloid", "brass", [UPRIGHT], "from = [0.3, 0, 0.58]\nto = [0.36, 0, 0.66]")
    glass = rest + '\ntexture-samples = 8\nmapping = { kind = "sphere", centre = [0, 1.6, 0], axis = [0, 1, 0] }'
    text += shape("hyperboloid", material, [UPRIGHT], "from = [0.36, 0, 0.66]\nto = [0.6671, 0, 1.2572]\n" + glass)
    return text + shape("sphere", material, [UPRIGHT, moved(0, 1.6, 0)], "radius = 0.75\nz-min = -0.3428\nz-max = 0.75\n" + glass)


def textured_bulb(name, scale):
    return bulb(f"{name}-flat", f"uv-scale = {scale}") + flat(name)


def dressed_bulb(name, scale, rotation=0):
    return bulb(name, f"uv-scale = {scale}\nuv-rotation = {rotation}") + btf(name)


MODELS = {
    "satin": 'model = "ward"\nkd = [0.25, 0.03, 0.03]\nks = 0.25\nalpha-x = 0.15\nalpha-y = 0.5\n',
    "pearl": 'model = "cook-torrance"\nkd = [0.35, 0.33, 0.3]\nks = 1\nm = 0.3\n',
}


def model_teapot(name, factored):
    """A teapot with an analytic BRDF, or with its factorisation."""
    text = studio([0.4, 2.35, 5.0], [0, 0.52, 0], 24)
    source = f'file = "factored-{name}/factored.loden"\n' if factored else MODELS[name]
    text += f"\n[material.{name}]\n{source}"
    return text + shape("object", name, ["{ scale = 1.3 }", turned(-18), moved(0, 0.5712, 0)], 'name = "teapot"')


def shipped(name):
    """A scene of `scenes/`, with absolute paths to its files."""
    return (ROOT / "scenes" / f"{name}.toml").read_text().replace('file = "cube.ply"', f'file = "{ROOT / "scenes" / "cube.ply"}"')
