"""What importers and codecs that are written in Python look like, and how a codec takes part in a sweep.

>>> class Mean:
...     name = "mean"
...     def encode(self, btf):
...         mean = btf.to_numpy().mean((0, 1))
...         return Constant(btf, mean)              # an object with the attributes of `Images`
>>> loden.sweep("wool.zip", "swept", methods=["pvmf"], codecs=[Mean()])      # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from time import perf_counter
from typing import Any, Protocol

from numpy.typing import ArrayLike

from ._loden import Btf, compare
from ._loden import open as _open
from ._loden import sweep as _sweep

__all__ = ["Codec", "Images", "sweep"]

_Path = str | PathLike[str]


class Images(Protocol):
    """A BTF whose images a Python object gives: an importer of one's own, or the result of a codec.

    It may also have ``encoding``, how its numbers encode light ("linear" unless stated), ``cosine``, whether they include
    the light's cosine ("included" unless stated), and ``nbytes``, the size of its file.
    """

    @property
    def views(self) -> ArrayLike:
        """Polar and azimuth angles of the views in degrees, shape (views, 2)."""

    @property
    def lights(self) -> ArrayLike:
        """Polar and azimuth angles of the lights in degrees, shape (lights, 2)."""

    def image(self, view: int, light: int) -> ArrayLike:
        """Numbers of the shape (rows, columns, 3)."""


class Codec(Protocol):
    """A codec that is written in Python."""

    @property
    def name(self) -> str:
        """What the rows of a table call it."""

    def encode(self, btf: Btf) -> Images:
        """The BTF as it is after compression; ``nbytes`` of the result should be the size of the compressed data."""


def sweep(
    source: _Path,
    output: _Path,
    *,
    methods: Sequence[str] | None = None,
    codecs: Sequence[Codec] = (),
    progress: Callable[[str, int, int], object] | None = None,
    threads: int | None = None,
) -> list[dict[str, Any]]:
    """Compresses a BTF by every method at several settings into the folder ``output``, and compares each with it.

    ``methods`` are names of built-in codecs, all of them by default; ``codecs`` are codecs written in Python. Settings that
    do not suit the measurement are skipped with a warning. Returns a dictionary for each file, as ``loden sweep
    --json`` prints it: method, bytes, mean_abs_error, psnr_db, encode_s and more. Rows of codecs in Python have no file.
    """
    rows: list[dict[str, Any]] = []
    if methods is None or methods or not codecs:
        names = None if methods is None else list(methods)
        rows += _sweep(source, output, methods=names, progress=progress, threads=threads)
    for codec in codecs:
        btf = _open(source)
        start = perf_counter()
        made = codec.encode(btf)
        seconds = perf_counter() - start
        (row,) = compare(btf, made, progress=progress, threads=threads)
        rows.append({**row, "method": codec.name, "encode_s": seconds})
    return rows
