#!/usr/bin/env python3
"""NumPy peer of `loden compress --method pca`: components of all views together, by a randomised range finder.

usage: python benches/peers/pca.py FILE COMPONENTS    (FILE: u8 [81][81][256][256][3])

The array is read view by view, twice. Prints a JSON line with seconds, peak memory and the mean error of display values over every tenth view.
"""
import json
import resource
import sys
import time

import numpy as np

from pvmf import LIGHTS, TEXELS, VIEWS, rows

EXTRA = 8


def factors(path, components):
    """Basis over texels (components, texel) and coefficients (view, row, components)."""
    basis = np.random.default_rng(1).standard_normal((TEXELS, components + EXTRA), np.float32)
    gathered = np.zeros_like(basis)
    for view in range(VIEWS):
        m, _ = rows(path, view)
        gathered += m.T @ (m @ basis)
    basis = np.linalg.qr(gathered)[0]
    coefficients = np.stack([rows(path, view)[0] @ basis for view in range(VIEWS)])
    left, values, right = np.linalg.svd(coefficients.reshape(-1, components + EXTRA), full_matrices=False)
    coefficients = (left[:, :components] * values[:components]).reshape(VIEWS, 3 * LIGHTS, components)
    return right[:components] @ basis.T, coefficients


def main():
    path, components = sys.argv[1], int(sys.argv[2])
    start = time.perf_counter()
    basis, coefficients = factors(path, components)
    seconds = time.perf_counter() - start
    rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    total, some = 0.0, range(0, VIEWS, 10)
    for view in some:
        m, mean = rows(path, view)
        value = np.clip(coefficients[view] @ basis + mean[:, None], 0, 1)
        total += np.abs(np.rint(255 * value) / 255 - (m + mean[:, None])).mean() / len(some)
    print(json.dumps({"work": f"pca c = {components}", "seconds": seconds, "peak_rss_bytes": rss,
                      "mean_abs_error_of_some": float(total)}), flush=True)


if __name__ == "__main__":
    main()
