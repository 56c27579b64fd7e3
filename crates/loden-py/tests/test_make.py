"""New materials: samples, larger ones, exchanged and edited ones, parts as arrays, codecs and importers in Python."""

import pathlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import loden
from loden.btf_extractor import Ubo2003


@pytest.fixture(scope="session")
def clustered(folder: pathlib.Path, archive: pathlib.Path) -> pathlib.Path:
    path = folder / "clustered.loden"
    loden.compress(archive, path, method="kmeans", clusters=12, precision="f32")
    return path


def test_a_sample_of_maps_needs_its_picture(tmp_path: pathlib.Path) -> None:
    with pytest.raises(loden.ParameterError, match="height"):
        loden.acquire("maps", tmp_path / "maps.zip")
    with pytest.raises(loden.ParameterError, match="gravel"):
        loden.acquire("graavel", tmp_path / "maps.zip")
    assert list(tmp_path.iterdir()) == []


def test_parts_are_stored_again_bit_for_bit(tmp_path: pathlib.Path, compressed: pathlib.Path, clustered: pathlib.Path) -> None:
    for path in (compressed, clustered):
        again = tmp_path / path.name
        parts = loden.open(path).parts()
        assert loden.store_parts(parts, again) == again.stat().st_size
        assert again.read_bytes() == path.read_bytes()


def test_changed_parts_change_the_material(tmp_path: pathlib.Path, clustered: pathlib.Path) -> None:
    parts = loden.open(clustered).parts()
    [(name, rows)] = parts["planes"].items()
    assert rows.shape == (16, 16) and rows.dtype == np.uint16 and rows.max() < 12
    parts["planes"][name] = rows[:, ::-1]
    del parts["provenance"]
    loden.store_parts(parts, tmp_path / "mirrored.loden")
    before, after = (loden.open(path).image(3, 5) for path in (clustered, tmp_path / "mirrored.loden"))
    assert np.array_equal(after, before[:, ::-1])


def test_wrong_parts_are_named(tmp_path: pathlib.Path, archive: pathlib.Path, clustered: pathlib.Path) -> None:
    with pytest.raises(loden.UnsupportedError, match="not compressed"):
        loden.open(archive).parts()
    output = tmp_path / "never.loden"
    parts = loden.open(clustered).parts()
    [name] = parts["planes"]
    for wrong, problem in ((np.full((16, 16), 12, np.uint16), "row 12"), (np.zeros((16, 8), np.uint16), "shape"), (np.zeros((16, 16)), "float64")):
        with pytest.raises(loden.ParameterError, match=problem) as found:
            loden.store_parts({**parts, "planes": {name: wrong}}, output)
        assert found.value.field == name
    for missing in ("btf", "recipe", "planes", "tables"):
        with pytest.raises(loden.ParameterError, match=missing):
            loden.store_parts({key: value for key, value in parts.items() if key != missing}, output)
    assert not output.exists()


def test_a_larger_material_is_rearranged_texels(tmp_path: pathlib.Path, compressed: pathlib.Path) -> None:
    output, map_file = tmp_path / "large.loden", tmp_path / "map.exr"
    found = loden.synthesize(compressed, output, size=(40, 24), method="tiling", map=map_file, seed=3)
    assert (found["width"], found["height"], found["method"]) == (40, 24, "tiling")
    assert loden.open(output).shape == (81, 81, 24, 40, 3)
    small, large = (loden.open(path).image(0, 0) for path in (compressed, output))
    texels = {texel.tobytes() for texel in small.reshape(-1, 3)}
    assert {texel.tobytes() for texel in large.reshape(-1, 3)} <= texels
    again = tmp_path / "again.loden"
    loden.synthesize(compressed, again, size=(40, 24), method="tiling", seed=3, threads=1)
    assert again.read_bytes() == output.read_bytes()
    with pytest.raises(loden.ParameterError, match="store"):
        loden.synthesize(compressed, tmp_path / "x.loden", size=(40, 24), store="nothing")  # type: ignore[arg-type]


def test_exchange_blend_and_edit(tmp_path: pathlib.Path, clustered: pathlib.Path) -> None:
    same = loden.exchange(clustered, clustered, tmp_path / "same.loden")
    assert same["cost"] == 0 and (tmp_path / "same.loden").read_bytes() == clustered.read_bytes()
    loden.edit(clustered, tmp_path / "unchanged.loden")
    assert (tmp_path / "unchanged.loden").read_bytes() == clustered.read_bytes()
    loden.edit(clustered, tmp_path / "bright.loden", exposure=1.0)
    dark, bright = (loden.open(path).image(0, 0) for path in (clustered, tmp_path / "bright.loden"))
    assert bright.mean() == pytest.approx(2 * dark.mean(), rel=0.02)
    loden.edit(clustered, tmp_path / "red.loden", recolor={"hue": 90}, rows=[0, 1])
    mixed = loden.blend(clustered, tmp_path / "bright.loden", tmp_path / "mixed.loden", amount=0.0)
    assert mixed["amount"] == 0 and np.array_equal(loden.open(tmp_path / "mixed.loden").image(0, 0), dark)
    with pytest.raises(loden.ParameterError, match="one of rows, colors, mask and grow"):
        loden.edit(clustered, tmp_path / "x.loden", rows=[0], grow=(1, 1))
    with pytest.raises(loden.ParameterError, match="match"):
        loden.exchange(clustered, clustered, tmp_path / "x.loden", match="luck")  # type: ignore[arg-type]
    family = loden.family(clustered, tmp_path / "family", count=2, seed=1, object="sphere")
    assert len(family["variants"]) == 2 and (tmp_path / "family" / "sheet.png").exists()
    with pytest.raises(loden.ParameterError, match="split"):
        loden.exchange(clustered, clustered, tmp_path / "x.loden", match="index", split=True)
    with pytest.raises(loden.OutputExistsError):
        loden.edit(clustered, tmp_path / "red.loden")


class Mean:
    """One image for all pairs."""

    def __init__(self, btf: loden.Btf) -> None:
        self.views, self.lights = btf.views, btf.lights
        self.mean: NDArray[np.float32] = btf.to_numpy(linear=False).mean((0, 1))
        self.encoding, self.nbytes = btf.encoding, self.mean.nbytes

    def image(self, view: int, light: int) -> NDArray[np.float32]:
        return self.mean


class MeanCodec:
    name = "mean"

    def encode(self, btf: loden.Btf) -> Mean:
        return Mean(btf)


def test_a_codec_in_python_takes_part(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    rows = loden.sweep(archive, tmp_path / "swept", methods=["tsvq"], codecs=[MeanCodec()])
    assert {row["method"] for row in rows} == {"tsvq", "mean"}
    mean = rows[-1]
    values = loden.open(archive).to_numpy(linear=False)
    assert mean["mean_abs_error"] == pytest.approx(np.abs(values - values.mean((0, 1))).mean(), rel=1e-4)
    assert mean["bytes"] == 16 * 16 * 3 * 4 and mean["encode_s"] > 0 and mean["file"] == ""
    assert all(pathlib.Path(row["file"]).exists() for row in rows[:-1])


def test_an_importer_in_python_is_compared(archive: pathlib.Path, compressed: pathlib.Path) -> None:
    btf = loden.open(archive)

    class Linear:
        views, lights = btf.views, btf.lights

        def image(self, view: int, light: int) -> Any:
            return btf.image(view, light)

    same, other = loden.compare(Linear(), btf, compressed)
    assert same["mean_abs_error"] < 1e-4 and other["mean_abs_error"] > 1e-3
    assert other["mean_abs_error"] == pytest.approx(loden.compare(archive, compressed)[0]["mean_abs_error"], abs=2e-4)


def test_faults_of_an_importer_in_python_are_named(archive: pathlib.Path) -> None:
    btf = loden.open(archive)

    class Faulty(Mean):
        def image(self, view: int, light: int) -> NDArray[np.float32]:
            if (view, light) == (2, 7):
                raise KeyError("no such photograph")
            return self.mean

    with pytest.raises(loden.ParameterError, match="view 2, light 7.*no such photograph"):
        loden.compare(btf, Faulty(btf))
    turned = Mean(btf)
    turned.mean = np.zeros((8, 16, 3), np.float32)
    with pytest.raises(loden.ParameterError, match="image sizes differ"):
        loden.compare(btf, turned)


def test_the_interface_of_btf_extractor(archive: pathlib.Path) -> None:
    old, new = Ubo2003(archive), loden.open(archive)
    assert old.img_shape == (16, 16, 3) and len(old.angles_set) == 81 * 81
    view, light = 4, 9
    angles = (*new.lights[light], *new.views[view])
    image = old.angles_to_image(*angles)
    assert image.dtype == np.uint8 and np.array_equal(image, new.stored(view, light)[:, :, ::-1])
    with pytest.raises(ValueError, match="not found"):
        old.angles_to_image(1, 2, 3, 4)
