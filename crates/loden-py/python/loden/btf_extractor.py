"""The interface of the package ``btf_extractor`` on top of ``loden``, for programs that were written for it.

Replace ``from btf_extractor import Ubo2003, Ubo2014`` by ``from loden.btf_extractor import Ubo2003, Ubo2014``. As there, angles
are those of the light first, channels are in the order blue, green, red, and numbers are as stored. New programs are better served
by ``loden.open``: red, green, blue, linear light, and values between the measured directions.
"""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._loden import Btf
from ._loden import open as _open

__all__ = ["AtriumHdr", "Ubo2003", "Ubo2014"]

Angles = tuple[float, float, float, float]


class _Extractor:
    """Images of a BTF by their angles."""

    #: Shape of each image: (rows, columns, 3).
    img_shape: tuple[int, int, int]
    #: Angles (light polar, light azimuth, view polar, view azimuth) of all images, in degrees.
    angles_set: frozenset[Angles]

    def __init__(self, path: str | PathLike[str]) -> None:
        btf = _open(path)
        if not isinstance(btf, Btf):
            raise ValueError(f"{path}: holds a material without texture")
        self._btf = btf
        self.img_shape = btf.shape[2:]
        lights = {self._angles(angles): light for light, angles in enumerate(btf.lights)}
        views = {self._angles(angles): view for view, angles in enumerate(btf.views)}
        missing = set(btf.missing)
        self._pairs = {
            light + view: (v, i) for view, v in views.items() for light, i in lights.items() if (v, i) not in missing
        }
        self.angles_set = frozenset(self._pairs)

    @staticmethod
    def _angles(angles: NDArray[np.float64]) -> tuple[float, float]:
        theta, phi = (round(float(angle), 6) for angle in angles)
        return theta, phi

    def angles_to_image(self, tl: float, pl: float, tv: float, pv: float) -> NDArray[Any]:
        """The image for a light (``tl``, ``pl``) and a view (``tv``, ``pv``), polar angle and azimuth in degrees.

        Shape (rows, columns, 3): blue, green, red. Raises ``ValueError`` for angles that were not measured.
        """
        key = tuple(round(float(angle), 6) for angle in (tl, pl, tv, pv))
        if key not in self._pairs:
            raise ValueError(f"tl:{tl}, pl:{pl}, tv:{tv}, pv:{pv} not found in {self._btf.path}")
        view, light = self._pairs[key]
        return self._btf.stored(view, light)[:, :, ::-1]


class Ubo2003(_Extractor):
    """A zip of JPEG pictures, such as UBO_CORDUROY256.zip: uint8."""


class AtriumHdr(_Extractor):
    """A zip of Radiance pictures, such as CEILING_HDR.zip: float32."""


class Ubo2014(_Extractor):
    """A .btf file, such as carpet01_resampled_W400xH400_L151xV151.btf: float16 or float32."""
