"""Measured materials: BTFs and BRDFs, opened, evaluated, compressed and rendered.

A BTF (bidirectional texture function) is a material measured as photographs of a flat sample, one per pair of light and
view direction; a BRDF is its texture-less special case.

>>> import loden
>>> btf = loden.open("wool.zip")                  # doctest: +SKIP
>>> btf.image(view=0, light=3).shape              # doctest: +SKIP
(256, 256, 3)
>>> wi = loden.directions([30, 0])
>>> wo = loden.directions([45, 90])
>>> btf.eval([0.5, 0.5], wi, wo)                  # doctest: +SKIP
array([0.21, 0.18, 0.16], dtype=float32)

Start with ``help(loden.open)`` and ``help(loden.Btf)``.
"""

from __future__ import annotations

from typing import Any, Callable

from ._loden import (
    Batches,
    Brdf,
    Btf,
    __version__,
    acquire,
    apply_map,
    blend,
    compare,
    compress,
    convert,
    directions,
    edit,
    exchange,
    export,
    factor,
    family,
    fit,
    from_numpy,
    info,
    open,
    rectify,
    render,
    store_parts,
    synthesize,
    synthesize_on,
)
from .codecs import Codec, Images, sweep
from .errors import (
    CancelledError,
    Error,
    FileError,
    InvalidFileError,
    LimitError,
    MissingFileError,
    NotConvergedError,
    NotFiniteError,
    OutputExistsError,
    ParameterError,
    UnsupportedError,
)

__all__ = [
    "Batches",
    "Brdf",
    "Btf",
    "CancelledError",
    "Codec",
    "Error",
    "FileError",
    "Images",
    "InvalidFileError",
    "LimitError",
    "MissingFileError",
    "NotConvergedError",
    "NotFiniteError",
    "OutputExistsError",
    "ParameterError",
    "UnsupportedError",
    "__version__",
    "acquire",
    "apply_map",
    "blend",
    "compare",
    "compress",
    "convert",
    "directions",
    "edit",
    "exchange",
    "export",
    "factor",
    "family",
    "fit",
    "from_numpy",
    "info",
    "open",
    "rectify",
    "render",
    "store_parts",
    "sweep",
    "synthesize",
    "synthesize_on",
]


def _reopen(function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
    """Makes a pickled object again."""
    return function(*arguments, **options)
