"""Opening, images, arrays, pickles, errors."""

import concurrent.futures
import io
import multiprocessing
import pathlib
import pickle
import re
import zipfile

import numpy as np
import pytest
from PIL import Image

import loden


def test_an_archive_gives_the_values_of_its_pictures(archive: pathlib.Path) -> None:
    btf = loden.open(archive)
    assert btf.shape == (81, 81, 16, 16, 3)
    assert (btf.encoding, btf.cosine, btf.dtype, btf.method) == ("srgb", "included", "uint8", None)
    assert btf.views.shape == btf.lights.shape == (81, 2)
    # an independent decoder, and the curve of IEC 61966-2-1 written out
    names = {}
    with zipfile.ZipFile(archive) as files:
        for name in files.namelist():
            if name.endswith(".jpg"):
                angles = re.search(r"tl(\d+) pl(\d+) tv(\d+) pv(\d+)", name)
                assert angles
                names[tuple(map(float, angles.groups()))] = name
        view, light = 40, 17
        key = (*btf.lights[light], *btf.views[view])
        [name] = [name for angles, name in names.items() if np.allclose(angles, key, atol=0.6)]
        picture = np.asarray(Image.open(io.BytesIO(files.read(name))).convert("RGB"))
    assert np.abs(btf.stored(view, light).astype(int) - picture).max() <= 2
    encoded = btf.stored(view, light) / np.float32(255)
    assert np.allclose(btf.image(view, light, linear=False), encoded)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    assert np.allclose(btf.image(view, light), linear, atol=1e-6)


def test_parts_of_the_images(archive: pathlib.Path) -> None:
    btf = loden.open(archive)
    part = btf.to_numpy(views=[3, 5], lights=slice(10, 20, 5), region=(4, 2, 8, 3))
    assert part.shape == (2, 2, 3, 8, 3) and part.dtype == np.float32
    assert np.array_equal(part[1, 1], btf.image(5, 15)[2:5, 4:12])
    assert np.array_equal(btf.to_numpy(views=-1, lights=-2)[0, 0], btf.image(80, 79))
    assert btf.to_numpy(views=[], lights=0).shape == (0, 1, 16, 16, 3)
    assert np.array_equal(btf.to_numpy(views=7, threads=1), btf.to_numpy(views=7, threads=2))
    with pytest.raises(loden.ParameterError, match="view"):
        btf.image(81, 0)
    with pytest.raises(loden.ParameterError, match="rect"):
        btf.to_numpy(region=(10, 0, 7, 1))
    with pytest.raises(loden.ParameterError):
        btf.to_numpy(views=81)


def test_arrays_become_materials_and_keep_their_values() -> None:
    random = np.random.default_rng(1)
    views, lights = [[0, 0], [60, 90]], [[0, 0], [30, 0], [60, 180]]
    for values in [
        random.integers(0, 256, size=(2, 3, 4, 5, 3), dtype=np.uint8),
        random.random((2, 3, 4, 5, 3)).astype(np.float16),
        random.random((2, 3, 4, 5, 3), dtype=np.float32),
        # strides of every kind
        np.asfortranarray(random.random((2, 3, 4, 5, 3), dtype=np.float32)),
        random.random((2, 3, 4, 10, 3), dtype=np.float32)[:, :, ::-1, ::2],
    ]:
        btf = loden.from_numpy(values, views, lights)
        assert btf.shape == values.shape and btf.dtype == values.dtype
        assert all(np.array_equal(btf.stored(v, l), values[v, l]) for v in range(2) for l in range(3))
        again = pickle.loads(pickle.dumps(btf))
        assert again.encoding == btf.encoding and np.array_equal(again.stored(1, 2), values[1, 2])
    with pytest.raises(loden.ParameterError, match="values"):
        loden.from_numpy(np.zeros((2, 3, 4, 5), np.float32), views, lights)
    with pytest.raises(loden.ParameterError, match="float64"):
        loden.from_numpy(np.zeros((2, 3, 4, 5, 3)), views, lights)
    with pytest.raises(loden.ParameterError, match="lights"):
        loden.from_numpy(np.zeros((2, 3, 4, 5, 3), np.float32), views, views)
    with pytest.raises(loden.ParameterError, match="polar angle"):
        loden.from_numpy(np.zeros((2, 3, 4, 5, 3), np.float32), [[0, 0], [95, 0]], lights)


def test_errors_name_file_and_field(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    with pytest.raises(loden.MissingFileError) as missing:
        loden.open(tmp_path / "no.zip")
    assert isinstance(missing.value, FileNotFoundError) and missing.value.path == str(tmp_path / "no.zip")
    damaged = tmp_path / "damaged.loden"
    damaged.write_bytes(b"\x20\0\0\0\0\0\0\0{}")
    with pytest.raises(loden.Error) as error:
        loden.open(damaged)
    assert error.value.path == str(damaged)
    with pytest.raises(loden.ParameterError) as wrong:
        loden.open(archive, encoding="purple")
    assert wrong.value.field == "encoding" and isinstance(wrong.value, ValueError)
    with pytest.raises(loden.OutputExistsError):
        loden.compress(archive, damaged)
    copy = pickle.loads(pickle.dumps(wrong.value))
    assert (str(copy), copy.field) == (str(wrong.value), "encoding")
    with pytest.raises(TypeError):
        loden.open(3)


def value(btf: "loden.Btf") -> np.ndarray:
    return btf.eval([0.3, 0.6], loden.directions([20, 40]), loden.directions([50, 10]))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_handles_travel_to_other_processes(method: str, compressed: pathlib.Path) -> None:
    btf = loden.open(compressed)
    # threads have run in this process before it forks
    here = value(btf)
    loden.render(compressed, size=(16, 16), spp=4)
    context = multiprocessing.get_context(method)
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
        there = list(pool.map(value, [btf] * 4, timeout=60))
    assert all(np.array_equal(here, found) for found in there)


def test_a_notebook_shows_the_material(compressed: pathlib.Path) -> None:
    picture = np.asarray(Image.open(io.BytesIO(loden.open(compressed)._repr_png_())))
    assert picture.shape[:2] == (192, 192) and picture.std() > 10
    assert "81 views" in repr(loden.open(compressed))
