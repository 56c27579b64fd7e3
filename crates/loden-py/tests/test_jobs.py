"""Jobs: compression, comparison, conversion, fits, pictures; progress and cancellation."""

import _thread
import pathlib
import signal
import threading
import time

import numpy as np
import pytest

import loden


def test_compression_reports_what_comparison_finds(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    output = tmp_path / "small.loden"
    steps: list[tuple[str, int, int]] = []
    found = loden.compress(archive, output, method="klt", components=32, step=1.5, progress=lambda *at: steps.append(at))
    assert found["bytes"] == output.stat().st_size == loden.open(output).nbytes
    assert steps and all(total > 0 for _, _, total in steps)
    [row] = loden.compare(archive, output)
    assert row["mean_abs_error"] == pytest.approx(found["error"]["mean_abs_error"], rel=1e-6)
    # the same error from the images
    one, two = (loden.open(path).to_numpy(linear=False) for path in (archive, output))
    assert np.abs(np.clip(one, 0, 1) - np.clip(two, 0, 1)).mean() == pytest.approx(row["mean_abs_error"], rel=1e-4)
    assert loden.open(output).method == "klt" and loden.open(output).params["components"] == 32
    assert loden.info(output)["method"] == "klt"


def test_goals_are_met(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    output = tmp_path / "goal.loden"
    found = loden.compress(archive, output, max_error=0.05)
    assert found["error"]["mean_abs_error"] <= 0.05 and found["trials"] > 1
    with pytest.raises(loden.ParameterError, match="one of"):
        loden.compress(archive, tmp_path / "x.loden", max_error=0.05, quality=3)
    with pytest.raises(loden.ParameterError, match="components"):
        loden.compress(archive, tmp_path / "x.loden", method="pvmf", components="many")
    with pytest.raises(loden.ParameterError):
        loden.compress(archive, tmp_path / "x.loden", method="zip")
    assert list(tmp_path.iterdir()) == [output]


def test_one_and_two_threads_give_the_same_bytes(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    files = [tmp_path / f"{threads}.loden" for threads in (1, 2)]
    for threads, file in zip((1, 2), files):
        loden.compress(archive, file, threads=threads)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_ctrl_c_cancels_and_leaves_nothing(tmp_path: pathlib.Path) -> None:
    output = tmp_path / "never.zip"
    # shells start programs in the background with this signal ignored
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.5, _thread.interrupt_main).start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        loden.acquire("gravel", output, size=256, spp=64)
    signal.signal(signal.SIGINT, before)
    assert time.monotonic() - begin < 30
    assert list(tmp_path.iterdir()) == []


def test_an_exception_of_the_progress_function_cancels(tmp_path: pathlib.Path) -> None:
    def stop(name: str, done: int, total: int) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        loden.acquire("gravel", tmp_path / "never.zip", size=256, spp=64, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_conversion_fit_and_factors(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    done = loden.convert(archive, tmp_path / "raw.toml")
    assert done["mean_error"] == 0 and loden.open(tmp_path / "raw.toml").shape == (81, 81, 16, 16, 3)
    fits = loden.fit("lambert:kd=0.5,0.25,0.1", model="lambert")["fits"]
    assert np.allclose(fits[0]["params"]["kd"], [0.5, 0.25, 0.1], atol=1e-3)
    found = loden.factor("blinn-phong", tmp_path / "tables", method="hf", resolution=16)
    brdf = loden.open(found["material"])
    assert isinstance(brdf, loden.Brdf) and brdf.eval([0, 0, 1], [0, 0, 1]).min() > 0


def test_a_picture_is_linear_light(tmp_path: pathlib.Path) -> None:
    picture = loden.render("lambert:kd=0.5", object="sphere", size=(48, 32), spp=16)
    assert picture.shape == (32, 48, 3) and picture.dtype == np.float32 and picture.max() > 0.1
    again = loden.render("lambert:kd=0.5", object="sphere", size=(48, 32), spp=16, threads=1)
    assert np.array_equal(picture, again)
    with pytest.raises(loden.ParameterError, match="interpolation"):
        loden.render("lambert:kd=0.5", interpolation="ring")


def test_warnings_are_python_warnings(tmp_path: pathlib.Path, archive: pathlib.Path) -> None:
    table = tmp_path / "grey.astm"
    table.write_text("VARS theta_i,theta_s,phi_s,R,G,B\n0.1,0.2,0.3,0.5,0.5,0.5\n0.2,0.3,0.4,0.5,0.5,0.5\n")
    with pytest.warns(UserWarning, match="phi_i"):
        loden.open(table)
