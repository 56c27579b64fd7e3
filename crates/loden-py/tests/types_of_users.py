"""What users write, for `mypy --strict`; it is not run."""

import numpy as np

import loden


def brightest(path: str) -> tuple[int, int]:
    btf = loden.open(path)
    assert isinstance(btf, loden.Btf)
    views, lights, _, _, _ = btf.shape
    means = btf.to_numpy(region=(0, 0, 1, 1)).reshape(views, lights, 3).mean(axis=-1)
    view, light = np.unravel_index(int(means.argmax()), means.shape)
    return int(view), int(light)


def train(path: str, steps: int) -> float:
    btf = loden.open(path, interpolation="rings")
    assert isinstance(btf, loden.Btf)
    total = 0.0
    for step, (uv, wi, wo, values) in enumerate(btf.batches(8192, seed=1)):
        if step == steps:
            break
        total += float(np.abs(btf.eval(uv, wi, wo) - values).mean())
    return total


def smaller(path: str) -> float | None:
    try:
        found = loden.compress(path, "small.loden", quality=50, progress=lambda name, done, total: print(name, done, total))
    except loden.InvalidFileError as error:
        print(error.path, error.field)
        return None
    return float(found["ratio_raw8"])
