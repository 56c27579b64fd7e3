"""Evaluation, sampling and batches."""

import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import loden

PHONG = "blinn-phong:kd=0.2,0.3,0.4:ks=0.5:exponent=20"


def test_measured_pairs_are_reproduced(archive: pathlib.Path, compressed: pathlib.Path) -> None:
    x, y, view, light = 5, 9, 30, 61
    uv = [(x + 0.5) / 16, 1 - (y + 0.5) / 16]
    for path in [archive, compressed]:
        btf = loden.open(path)
        wi, wo = loden.directions(btf.lights[light]), loden.directions(btf.views[view])
        # negative light of a compressed material becomes 0
        expected = np.maximum(btf.image(view, light)[y, x], 0)
        assert np.allclose(btf.eval(uv, wi, wo), expected, atol=2e-5)


@settings(max_examples=40, deadline=None)
@given(hnp.mutually_broadcastable_shapes(num_shapes=3, max_dims=3, max_side=4), st.integers(0, 2**32 - 1))
def test_queries_broadcast_as_numpy_does(shapes: hnp.BroadcastableShapes, seed: int) -> None:
    btf = constant()
    random = np.random.default_rng(seed)
    uv = random.random((*shapes.input_shapes[0], 2))
    wi, wo = (loden.directions([75, 360] * random.random((*shape, 2))) for shape in shapes.input_shapes[1:])
    found = btf.eval(uv, wi, wo)
    assert found.shape == (*shapes.result_shape, 3) and found.dtype == np.float32
    assert np.allclose(found, 0.25, atol=1e-4)
    assert btf.pdf(uv, wi, wo).shape == shapes.result_shape


def constant() -> "loden.Btf":
    ring = [[0, 0], *([80, 30 * k] for k in range(12))]
    return loden.from_numpy(np.full((13, 13, 4, 4, 3), 0.25, np.float32), ring, ring)


def test_strides_types_and_threads_do_not_matter(compressed: pathlib.Path) -> None:
    btf = loden.open(compressed)
    random = np.random.default_rng(2)
    n = 20_000
    uv, degrees = random.random((n, 2)), random.random((n, 4)) * [80, 360, 80, 360]
    wi, wo = loden.directions(degrees[:, :2]), loden.directions(degrees[:, 2:])
    found = btf.eval(uv, wi, wo)
    assert found.shape == (n, 3) and found.min() >= 0 and found.max() > 0.1
    assert np.array_equal(found, btf.eval(uv.astype(np.float32), wi.astype(np.float64), wo, threads=1))
    assert np.array_equal(found[::-1], btf.eval(uv[::-1], wi[::-1], wo[::-1]))
    assert np.array_equal(found, btf.eval(np.asfortranarray(uv), np.asfortranarray(wi), wo))
    assert np.array_equal(found[7], btf.eval(uv[7], wi[7], wo[7]))
    assert btf.eval(uv[:0], wi[:0], wo[:0]).shape == (0, 3)
    below = btf.eval(uv, wi * [1, 1, -1], wo)
    assert not below.any()


class Dlpack:
    """An array of another library."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def __dlpack__(self, **options: object) -> object:
        return self.array.__dlpack__()

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.array.__dlpack_device__()


def test_arrays_of_other_libraries_are_taken(compressed: pathlib.Path) -> None:
    btf = loden.open(compressed)
    uv, w = np.full((5, 2), 0.4, np.float32), loden.directions([[10.0, 20.0]] * 5)
    assert np.array_equal(btf.eval(Dlpack(uv), Dlpack(w), w), btf.eval(uv, w, w))


def test_wrong_arrays_are_named(compressed: pathlib.Path) -> None:
    btf, w = loden.open(compressed), loden.directions([10, 20])
    with pytest.raises(loden.ParameterError, match=r"uv: found the shape \[3\]"):
        btf.eval([1, 2, 3], w, w)
    with pytest.raises(loden.ParameterError, match="broadcast"):
        btf.eval(np.zeros((4, 2)), np.zeros((3, 3)), w)
    with pytest.raises(TypeError, match="wi"):
        btf.eval([0, 0], ["a", "b", "c"], w)
    with pytest.raises(TypeError, match="complex"):
        btf.eval([0, 0], w * 1j, w)


def test_a_brdf_is_what_its_formula_says() -> None:
    brdf = loden.open("lambert:kd=0.6,0.3,0.1")
    wi, wo = loden.directions([[10, 0], [80, 50]]), loden.directions([20, 20])
    assert np.allclose(brdf.eval(wi, wo), np.array([0.6, 0.3, 0.1]) / np.pi, rtol=1e-5)
    assert brdf.isotropic and brdf.reciprocal and brdf.kind == "lambert"
    wi, wo, values = brdf.samples()
    assert wi.shape == wo.shape == values.shape and len(wi) > 100
    assert np.allclose(np.linalg.norm(wi, axis=1), 1, atol=1e-5)
    with pytest.raises(loden.ParameterError, match="spectra"):
        brdf.spectrum(wi, wo)
    with pytest.raises(loden.ParameterError):
        loden.open("lambert:kd=2")


def test_samples_have_the_density_that_pdf_states() -> None:
    brdf = loden.open(PHONG)
    random = np.random.default_rng(3)
    wo = loden.directions([40, 30])
    wi, pdf = brdf.sample(wo, random.random((200_000, 2)))
    drawn = pdf > 0
    assert drawn.mean() > 0.5
    assert np.allclose(brdf.pdf(wi[drawn], wo), pdf[drawn], rtol=1e-3)
    # the share of a cone equals the integral of the density over it
    axis = loden.directions([40, 210])
    uniform = random.random((400_000, 2))
    z = uniform[:, 0]
    radius = np.sqrt(1 - z**2)
    around = np.stack([radius * np.cos(2 * np.pi * uniform[:, 1]), radius * np.sin(2 * np.pi * uniform[:, 1]), z], -1)
    inside = around @ axis > 0.9
    expected = 2 * np.pi * np.where(inside, brdf.pdf(around, wo), 0).mean()
    assert abs((wi[drawn] @ axis > 0.9).sum() / len(wi) - expected) < 0.02 * expected + 0.002


def test_batches_hold_measured_values_and_repeat_by_seed(archive: pathlib.Path) -> None:
    btf = loden.open(archive)
    first, second = (next(btf.batches(1000, seed=5, threads=threads)) for threads in (1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(first, second))
    uv, wi, wo, values = first
    assert (uv.shape, wi.shape, wo.shape, values.shape) == ((1000, 2), (1000, 3), (1000, 3), (1000, 3))
    assert np.allclose(btf.eval(uv, wi, wo), values, atol=1e-4)
    batches = btf.batches(300, seed=5, reuse=10)
    several = [next(batches) for _ in range(20)]
    assert len({tuple(batch[1][0]) for batch in several}) > 10
    # all texels and directions are drawn
    texels = np.concatenate([batch[0] for batch in several])
    assert len(np.unique(texels.round(4), axis=0)) == 256
    assert not np.array_equal(next(btf.batches(10, seed=6))[3], next(btf.batches(10, seed=5))[3])
    with pytest.raises(loden.ParameterError, match="n: found 0"):
        btf.batches(0)
