"""Writes small valid files into fuzz/corpus, from which the targets of binary formats start.

Usage: python3 fuzz/seeds.py [LODEN], the path of the built program, which writes the `.btf` files.
"""

import pathlib
import struct
import subprocess
import sys
import tempfile

CORPUS = pathlib.Path(__file__).resolve().parent / "corpus"
# the numbers by which a tensor file names its types
TYPES = {"B": 1, "f": 10, "d": 11}


def tensor_file(fields):
    """A tensor file of (name, type, shape, numbers)."""
    size = 18 + sum(2 + len(name) + 2 + 1 + 8 + 8 * len(shape) for name, _, shape, _ in fields)
    records, data = b"", b""
    for name, kind, shape, numbers in fields:
        data += bytes(-(size + len(data)) % 8)
        records += struct.pack(f"<H{len(name)}sHBQ", len(name), name.encode(), len(shape), TYPES[kind], size + len(data))
        records += struct.pack(f"<{len(shape)}Q", *shape)
        data += struct.pack(f"<{len(numbers)}{kind}", *numbers)
    return b"tensor_file\0\x01\0" + struct.pack("<I", len(fields)) + records + data


def even(low, high, count):
    return [low + (high - low) * i / max(count - 1, 1) for i in range(count)]


def ones(name, *shape):
    count = 1
    for n in shape:
        count *= n
    return (name, "f", shape, [1.0] * count)


def rgl(azimuths, spectral):
    polar, n = 3, 4
    phi = even(-3.1415927, 3.1415927, azimuths) if azimuths > 1 else [0.0]
    bands = [("wavelengths", "f", [2], [450.0, 650.0]), ones("spectra", azimuths, polar, 2, n, n)]
    return tensor_file(
        [
            ("description", "B", [4], b"seed"),
            ("jacobian", "B", [1], [1]),
            ("theta_i", "f", [polar], even(0.0, 1.3, polar)),
            ("phi_i", "f", [azimuths], phi),
            ones("ndf", n, n),
            ones("sigma", n, n),
            ones("vndf", azimuths, polar, n, n),
            ones("luminance", azimuths, polar, n, n),
        ]
        + (bands if spectral else [ones("rgb", azimuths, polar, 3, n, n)])
    )


def kaist(axes):
    n, bands = 3, 2
    axis = lambda name, end: (name, "f", [n if axes else 0], even(0.0, end, n) if axes else [])
    return tensor_file(
        [
            ("wvls", "f", [bands], [450.0, 650.0]),
            axis("phi_d", 6.2831853),
            axis("theta_d", 1.5707963),
            axis("theta_h", 1.5707963),
            ones("M", n, n, n, bands, 4, 4),
        ]
    )


def curet_images():
    """The table of directions, a zero, and a picture of 2 x 2 pixels of 24 bits."""
    table = "".join(f"{pair} {0.1 + pair % 12 / 10:.1f} 0 {0.1 + pair // 12 / 20:.2f} 1\n" for pair in range(1, 206))
    pixels = bytes(range(6)) + bytes(2) + bytes(range(6, 12)) + bytes(2)
    header = struct.pack("<2sIHHI", b"BM", 54 + len(pixels), 0, 0, 54)
    header += struct.pack("<IiiHHIIiiII", 40, 2, 2, 1, 24, 0, len(pixels), 2835, 2835, 0, 0)
    return table.encode() + b"\0" + header + pixels


def raw(folder):
    """A raw array of 2 x 2 texels and 5 x 5 directions."""
    directions = "[[0, 0], [60, 0], [60, 90], [60, 180], [60, 270]]"
    (folder / "x.f32").write_bytes(struct.pack("<300f", *(0.1 + i % 7 / 10 for i in range(300))))
    (folder / "x.toml").write_text(
        'loden_raw = 1\ndata = "x.f32"\ntype = "f32"\nshape = [5, 5, 2, 2, 3]\n'
        f'views = {directions}\nlights = {directions}\nencoding = "linear"\ncosine = "included"\n'
    )


def carrier(program, folder):
    """The raw array as an index image and a block image."""
    run = lambda *words: subprocess.run([program, *words, "--quiet"], check=True, cwd=folder, stdout=subprocess.DEVNULL)
    run("compress", "x.toml", "--method", "kmeans", "--clusters", "2", "-o", "x.loden")
    run("export", "x.loden", "--to", "renderman", "--textures", "carrier", "-o", "x")
    pictures = [(folder / "x" / f"loden_x_{name}.tif").read_bytes() for name in ("index", "block")]
    length = max(map(len, pictures))
    manifest = (folder / "x" / "carrier.json").read_bytes()
    return manifest + b"\0" + b"".join(picture.ljust(length, b"\0") for picture in pictures)


def btf(program, folder):
    """`.btf` files of the raw array, without the signature that the target puts there."""
    # the first byte chooses the signature that the target writes: !DFMF08FC, !FMF12FCE, !BDIF06R2!
    few = ["--components", "2"]
    for kind, name, options in [(0, "dfmf", few), (0, "dfmf", [*few, "--single"]), (2, "fmf", few), (5, "bdi", [])]:
        line = [program, "convert", "x.toml", "x.btf", "--to", name, "--quiet", "--force", *options]
        subprocess.run(line, check=True, cwd=folder, stdout=subprocess.DEVNULL)
        yield bytes([kind]) + (folder / "x.btf").read_bytes()[10 if kind == 5 else 9 :]


# the endings of the files that a target of meshes reads
MESHES = {"obj": "obj", "ply": "ply", "gltf": "gltf glb"}


def test_data(root, kind, endings):
    """The content of the test files of a kind."""
    for path in sorted((root / "crates/loden/tests/data" / kind).iterdir()):
        if path.suffix[1:] in endings.split():
            yield path.read_bytes()


def main():
    root = CORPUS.parents[1]
    program = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else root / "target/release/loden").resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        raw(folder)
        seeds = {
            # the target writes the first 14 bytes itself
            "rgl": [rgl(azimuths, spectral)[14:] for azimuths in (1, 3) for spectral in (False, True)],
            "kaist": [kaist(axes)[14:] for axes in (True, False)],
            "curet_images": [curet_images()],
            "carrier": [carrier(program, folder)],
            "ubo2014": list(btf(program, folder)),
            "picture": list(test_data(root, "pictures", "bmp exr hdr jpg png tif")),
            **{target: list(test_data(root, "meshes", endings)) for target, endings in MESHES.items()},
        }
    for target, contents in seeds.items():
        (CORPUS / target).mkdir(parents=True, exist_ok=True)
        for i, content in enumerate(contents):
            (CORPUS / target / f"seed{i}").write_bytes(content)
    print(f"wrote {sum(map(len, seeds.values()))} files into {CORPUS}")


if __name__ == "__main__":
    main()
