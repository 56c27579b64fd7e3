#!/usr/bin/env python3
"""NumPy peer of `loden compress --method pca`: components of all views together, by a randomised range finder.

usage: python benches/peers/pca.py FILE COMPONENTS    (FILE: u8 [81][81][256][256][3])

The array is read view by view, twice (once more with each power iteration); rows are (light, rgb) of a view, columns are
texels. Prints a JSON line with seconds, peak memory and the mean error of display values over every tenth view.
"""
import json
import resource
import sys
import time

import numpy as np

VIEWS, LIGHTS, TEXELS = 81, 81, 256 * 256
EXTRA = 8


def block(path, view):
    """A view's rows, less their means, and the means."""
    size = LIGHTS * TEXELS * 3
    images = np.memmap(path, np.uint8, "r", offset=view * size, shape=(LIGHTS, TEXELS, 3))
    m = np.empty((LIGHTS, 3, TEXELS), np.float32)
    for channel in range(3):
        m[:, channel] = images[:, :, channel]
    m = m.reshape(3 * LIGHTS, TEXELS)
    m *= np.float32(1 / 255)
    mean = m.mean(1)
    m -= mean[:, None]
    return m, mean


def factors(path, components, powers):
    """Basis over texels (components, texel) and coefficients (view, row, components)."""
    basis = np.random.default_rng(1).standard_normal((TEXELS, components + EXTRA), np.float32)
    for _ in range(1 + powers):
        gathered = np.zeros_like(basis)
        for view in range(VIEWS):
            m, _ = block(path, view)
            gathered += m.T @ (m @ basis)
        basis = np.linalg.qr(gathered)[0]
    coefficients = np.stack([block(path, view)[0] @ basis for view in range(VIEWS)])
    left, values, right = np.linalg.svd(coefficients.reshape(-1, components + EXTRA), full_matrices=False)
    coefficients = (left[:, :components] * values[:components]).reshape(VIEWS, 3 * LIGHTS, components)
    return right[:components] @ basis.T, coefficients


def main():
    path, components = sys.argv[1], int(sys.argv[2])
    start = time.perf_counter()
    basis, coefficients = factors(path, components, 0)
    seconds = time.perf_counter() - start
    rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    total, some = 0.0, range(0, VIEWS, 10)
    for view in some:
        m, mean = block(path, view)
        value = np.clip(coefficients[view] @ basis + mean[:, None], 0, 1)
        total += np.abs(np.rint(255 * value) / 255 - (m + mean[:, None])).mean() / len(some)
    print(json.dumps({"work": f"pca c = {components}", "seconds": seconds, "peak_rss_bytes": rss,
                      "mean_abs_error_of_some": float(total)}), flush=True)


main()
