"""Uses the page of `loden studio` in a headless Chromium and compares what it shows with what the program writes.

Usage: python studio_vs_loden.py [LODEN], the path of the built program.

Images of a measurement must be equal byte for byte; pictures of the 3D view, by WebGL2 and by WebGPU, agree with `loden render` of the
scene file that the page copies. The page in the program must be what its sources give.
"""

import base64
import filecmp
import json
import pathlib
import shlex
import socket
import subprocess
import sys
import tempfile
import tomllib
import zipfile
import zlib

import numpy as np
from PIL import Image

import browser

PAGE = pathlib.Path("crates/loden-studio/page")
# mean absolute difference of pictures in linear light, away from the silhouette
PICTURE_TOLERANCE = 0.02
# compressed bytes of the page's scripts
LARGEST = 700_000


def run(*command, **options):
    return subprocess.run([str(word) for word in command], check=True, **options)


def check_build(folder):
    """The page is what a fresh build gives."""
    run("npx", "tsc", "--noEmit", cwd=PAGE)
    fresh = folder / "dist"
    run("npx", "vite", "build", "--outDir", fresh, "--emptyOutDir", "--logLevel", "error", cwd=PAGE)
    names = sorted(path.name for path in fresh.iterdir())
    assert names == sorted(path.name for path in (PAGE / "dist").iterdir()), names
    different = [name for name in names if not filecmp.cmp(fresh / name, PAGE / "dist" / name, shallow=False)]
    assert not different, f"{different} are not what the sources give: make page"
    run("node", "--test", "--test-reporter=dot", "test/unit.mjs", cwd=PAGE, stdout=subprocess.DEVNULL)
    size = sum(len(zlib.compress(path.read_bytes(), 9)) for path in fresh.glob("*.js"))
    print(f"the page: {len(names)} files as built, scripts of {size} bytes compressed")
    assert size < LARGEST


def raw_images(program, folder):
    """All stored values of the measurement, shape (view, light, y, x, rgb)."""
    run(program, "convert", folder / "data" / "twill.zip", folder / "twill.toml", "-q", stdout=subprocess.DEVNULL)
    description = tomllib.loads((folder / "twill.toml").read_text())
    assert description["type"] == "u8", description
    return np.fromfile(folder / description["data"], np.uint8).reshape(description["shape"])


def bytes_of(text):
    return np.frombuffer(base64.b64decode(text), np.uint8)


def check_images(result, images):
    for one in result["images"]:
        shown = bytes_of(one["rgb"]).reshape(images.shape[2:])
        assert np.array_equal(shown, images[one["v"], one["l"]]), (one["v"], one["l"])
    pairs = [(one["v"], one["l"]) for one in result["images"]]
    # a step by keyboard, a drag, undone, reloaded
    assert len(set(pairs[:3])) == 3 and pairs[1] == pairs[3] == pairs[4], pairs
    texel = result["texel"]
    stored = images[int(texel["v"]), int(texel["l"]), int(texel["y"]), int(texel["x"])] / 255
    assert np.allclose([float(word) for word in texel["text"].split()], stored, atol=6e-5), texel
    compared = result["compared"]
    assert compared["dots"] == 81 and compared["pins"] == f"{texel['x']},{texel['y']}", compared
    print(f"images: {len(pairs)} equal to the stored bytes, a texel's values {stored.round(4)}")


def picture(path):
    return np.asarray(Image.open(path).convert("RGB"))


def check_decoded(program, folder, result):
    pvmf = folder / "data" / "pvmf.loden"
    run(program, "decompress", pvmf, "--light", "33,45", "--view", "20,100", "-o", folder / "between.png", "-q", stdout=subprocess.DEVNULL)
    expected = picture(folder / "between.png")
    assert np.array_equal(bytes_of(result["between"]).reshape(expected.shape), expected)
    assert result["pointsBefore"] == 3 and len(result["points"]) == 4, result["points"]
    assert any("klt" in label for label in result["points"]) and "mean 0.0" in result["caption"], result
    print(f"compression: {result['points']}; this image: {result['caption']}")


def linear(values):
    values = values / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def check_view(program, folder, name):
    shown = picture(folder / f"{name}.png")
    size = f"{shown.shape[1]}x{shown.shape[0]}"
    run(program, "render", "--scene", folder / f"{name}.toml", "--size", size, "--spp", "16", "-o", folder / f"{name}-ours.png", "--denoise", "false", "-q", stdout=subprocess.DEVNULL)
    ours = picture(folder / f"{name}-ours.png")
    background = np.abs(ours.astype(int) - 42).max(-1) <= 2
    # away from the silhouette: no background within two pixels
    near = background.copy()
    for axis in (0, 1):
        for step in (-2, -1, 1, 2):
            near |= np.roll(background, step, axis)
    difference = np.abs(linear(shown) - linear(ours))[~near]
    assert 0.05 < np.mean(~near) < 0.9 and linear(ours)[~near].mean() > 0.02
    print(f"3D view by {name}: mean difference {difference.mean():.4f} over {np.mean(~near):.0%} of {size} pixels")
    assert difference.mean() < PICTURE_TOLERANCE, name
    assert np.array_equal(shown[5, 5], ours[5, 5]), "the backgrounds differ"


def check_surroundings(program, folder):
    """A few lights in the browser against all of the picture in the path tracer, the backdrop included."""
    shown = picture(folder / "around.png")
    size = f"{shown.shape[1]}x{shown.shape[0]}"
    run(program, "render", "--scene", folder / "around.toml", "--size", size, "--spp", "16", "-o", folder / "around-ours.png", "--denoise", "false", "-q", stdout=subprocess.DEVNULL)
    difference = np.abs(linear(shown) - linear(picture(folder / "around-ours.png")))
    turned = np.abs(linear(shown) - linear(picture(folder / "around-ours.png"))[:, ::-1])
    print(f"a mesh within surroundings: mean difference {difference.mean():.4f} of {size} pixels, mirrored {turned.mean():.4f}")
    assert difference.mean() < 0.2 * turned.mean()


def check_made(program, folder, result):
    """What the page made is what its command lines make."""
    assert result["slid"] and result["preview"] == result["edited"], "the preview is not what the file shows"
    names = sorted(one["title"] for one in result["made"])
    assert names == ["rows-edited.loden", "rows-exchanged.loden", "rows-large.loden", "rows-mixed.loden"], names
    for one in result["made"]:
        words = shlex.split(one["command"])
        assert words[0] == "loden" and words[-2] == "-o", words
        ours = folder / one["title"]
        run(program, *words[1:-1], ours, "-q", stdout=subprocess.DEVNULL)
        assert filecmp.cmp(ours, words[-1], shallow=False), one["command"]
    large = next(one for one in result["made"] if one["title"] == "rows-large.loden")
    assert large["pictures"] >= 1, large
    print(f"new materials: {len(names)} files equal to those of their command lines; {large['pictures']} pictures of a synthesis")


def check_restart(program, folder):
    """The page goes on after a server that was killed, and no half-written file stays."""
    data = folder / "restarted"
    data.mkdir()
    (data / "twill.zip").write_bytes((folder / "data" / "twill.zip").read_bytes())
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    done = run("node", PAGE / "test" / "restart.mjs", program, data, port, stdout=subprocess.PIPE, text=True, timeout=300)
    left = json.loads(done.stdout)
    assert [name for name in left if not name.startswith(".")] == ["twill-klt.loden", "twill.zip"], left
    print(f"killed and started again, the page goes on; in the folder: {', '.join(left)}")


def check_exports(folder):
    """The archive holds what `loden export` writes, and the page of one file shows the material."""
    with zipfile.ZipFile(folder / "export.zip") as archive:
        assert archive.testzip() is None
        names = {pathlib.PurePath(name).name for name in archive.namelist()}
    written = {path.name for path in (folder / "glsl").iterdir()}
    assert names == written, names ^ written
    shown = linear(picture(folder / "single.png"))
    lit = shown.max(-1) > 0.05
    print(f"an export of {len(names)} files; the page of one file: {lit.mean():.0%} of its pixels are lit, with a deviation of {shown[lit].std():.3f}")
    assert 0.05 < lit.mean() < 0.9 and shown[lit].std() > 0.02


def surroundings():
    """A bright spot and four colours, no two directions alike."""
    sky = np.zeros((64, 128, 3))
    sky[..., 0] = np.linspace(0.1, 0.5, 128)
    sky[..., 1] = np.linspace(0.5, 0.1, 64)[:, None]
    sky[..., 2] = 0.2
    sky[12:20, 30:40] = 1
    return Image.fromarray((255 * sky).round().astype(np.uint8))


SOLID = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 0.5 1\nf 1/1 5/3 2/2\nf 2/1 5/3 3/2\nf 3/1 5/3 4/2\nf 4/1 5/3 1/2\nf 1/1 2/2 3/3\nf 1/1 3/2 4/3\n"


def main():
    program = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "target/release/loden").absolute()
    if not browser.found():
        print("skipped: the page of the studio, as there is no Chromium")
        return
    if not (PAGE / "node_modules" / "playwright-core").is_dir():
        print(f"skipped: the page of the studio, as there is no {PAGE}/node_modules (make page installs it)")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        data = folder / "data"
        data.mkdir()
        check_build(folder)
        run(program, "acquire", "twill", "--size", "24", "--spp", "2", "-o", data / "twill.zip", "-q", stdout=subprocess.DEVNULL)
        for method, components in (("pvmf", 4), ("pca", 8)):
            run(program, "compress", data / "twill.zip", "--method", method, "--components", components, "-o", data / f"{method}.loden", "-q", stdout=subprocess.DEVNULL)
        run(program, "acquire", "leather", "--size", "24", "--spp", "1", "-o", folder / "leather.zip", "-q", stdout=subprocess.DEVNULL)
        for source, name in ((data / "twill.zip", "rows"), (folder / "leather.zip", "leather")):
            run(program, "compress", source, "--method", "kmeans", "--clusters", "8", "-o", data / f"{name}.loden", "-q", stdout=subprocess.DEVNULL)
        surroundings().save(data / "sky.png")
        (data / "solid.obj").write_text(SOLID)
        images = raw_images(program, folder)
        command = [program, "studio", data, "--no-open", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as studio:
            text = ""
            while not text.rstrip().endswith("}"):
                line = studio.stdout.readline()
                assert line, f"the studio ended: {text}"
                text += line
            address = json.loads(text)["address"]
            try:
                driven = run("node", PAGE / "test" / "drive.mjs", address, folder, stdout=subprocess.PIPE, text=True, timeout=900)
            finally:
                studio.terminate()
        result = json.loads(driven.stdout)
        assert not result["elsewhere"], f"the page asked other machines: {result['elsewhere']}"
        assert not result["problems"], result["problems"]
        assert sorted(result["cards"]) == ["leather.loden", "pca.loden", "pvmf.loden", "rows.loden", "twill.zip"], result["cards"]
        print(f"the first picture after {result['firstPicture']} ms; no request to another machine, no error of the page")
        check_images(result, images)
        check_decoded(program, folder, result)
        assert "Cancelled" in result["cancelled"] and not list(data.glob("*-2.zip")), result["cancelled"]
        assert "damaged.zip" in result["damaged"] and not (data / "damaged.zip").exists(), result["damaged"]
        print(f"a cancelled job leaves nothing; a damaged file: {result['damaged']}")
        assert "WebGL2" in result["views"]["webgl"] and "WebGPU" in result["views"]["webgpu"], result["views"]
        for view in ("webgl", "webgpu"):
            check_view(program, folder, view)
        assert "surroundings by" in result["views"]["around"], result["views"]
        check_surroundings(program, folder)
        check_made(program, folder, result)
        check_restart(program, folder)
        assert "<title>pvmf" in (folder / "single.html").read_text(), "the page of one file has another title"
        run(program, "export", data / "pvmf.loden", "--to", "glsl", "-o", folder / "glsl", "-q", stdout=subprocess.DEVNULL)
        check_exports(folder)
        assert not result["violations"], "\n".join(result["violations"])
        print("axe-core finds no serious violation")


main()
