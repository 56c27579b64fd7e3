from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import CancelledError as CancelledError
from .errors import Error as Error
from .errors import FileError as FileError
from .errors import InvalidFileError as InvalidFileError
from .errors import LimitError as LimitError
from .errors import MissingFileError as MissingFileError
from .errors import NotConvergedError as NotConvergedError
from .errors import NotFiniteError as NotFiniteError
from .errors import OutputExistsError as OutputExistsError
from .errors import ParameterError as ParameterError
from .errors import UnsupportedError as UnsupportedError

_Path: TypeAlias = str | PathLike[str]
_Floats: TypeAlias = NDArray[np.float32]
_Index: TypeAlias = int | slice | Sequence[int] | NDArray[np.integer[Any]] | None
_Progress: TypeAlias = Callable[[str, int, int], object] | None
_Scheme: TypeAlias = Literal["triangles", "rings"]
_Blending: TypeAlias = Literal["auto", "linear", "stored"]

__version__: str

@final
class Btf:
    @property
    def path(self) -> Any: ...
    @property
    def kind(self) -> str: ...
    @property
    def shape(self) -> tuple[int, int, int, int, int]: ...
    @property
    def views(self) -> NDArray[np.float64]: ...
    @property
    def lights(self) -> NDArray[np.float64]: ...
    @property
    def encoding(self) -> str: ...
    @property
    def cosine(self) -> str: ...
    @property
    def dtype(self) -> str: ...
    @property
    def method(self) -> str | None: ...
    @property
    def params(self) -> dict[str, Any]: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def missing(self) -> list[tuple[int, int]]: ...
    @property
    def facts(self) -> dict[str, str]: ...
    def image(self, view: int, light: int, *, linear: bool = True) -> _Floats: ...
    def stored(self, view: int, light: int) -> NDArray[Any]: ...
    def to_numpy(
        self,
        *,
        views: _Index = None,
        lights: _Index = None,
        region: tuple[int, int, int, int] | None = None,
        linear: bool = True,
        threads: int | None = None,
    ) -> _Floats: ...
    def eval(self, uv: ArrayLike, wi: ArrayLike, wo: ArrayLike, *, threads: int | None = None) -> _Floats: ...
    def sample(
        self, uv: ArrayLike, wo: ArrayLike, random: ArrayLike, *, threads: int | None = None
    ) -> tuple[_Floats, _Floats]: ...
    def pdf(self, uv: ArrayLike, wi: ArrayLike, wo: ArrayLike, *, threads: int | None = None) -> _Floats: ...
    def batches(self, n: int, seed: int = 0, *, reuse: int = 128, threads: int | None = None) -> Batches: ...
    def _repr_png_(self) -> bytes: ...

@final
class Brdf:
    @property
    def path(self) -> Any: ...
    @property
    def kind(self) -> str: ...
    @property
    def wavelengths(self) -> _Floats: ...
    @property
    def isotropic(self) -> bool: ...
    @property
    def reciprocal(self) -> bool: ...
    @property
    def facts(self) -> dict[str, str]: ...
    def samples(self) -> tuple[_Floats, _Floats, _Floats]: ...
    def eval(self, wi: ArrayLike, wo: ArrayLike, *, threads: int | None = None) -> _Floats: ...
    def spectrum(self, wi: ArrayLike, wo: ArrayLike, *, threads: int | None = None) -> _Floats: ...
    def sample(self, wo: ArrayLike, random: ArrayLike, *, threads: int | None = None) -> tuple[_Floats, _Floats]: ...
    def pdf(self, wi: ArrayLike, wo: ArrayLike, *, threads: int | None = None) -> _Floats: ...
    def _repr_png_(self) -> bytes: ...

@final
class Batches:
    def __iter__(self) -> Batches: ...
    def __next__(self) -> list[_Floats]: ...

def open(path: _Path, /, *, interpolation: _Scheme = "triangles", blending: _Blending = "auto", **options: Any) -> Any: ...
def from_numpy(
    values: NDArray[Any],
    views: ArrayLike,
    lights: ArrayLike,
    *,
    encoding: str | None = None,
    cosine: Literal["included", "excluded"] = "included",
    interpolation: _Scheme = "triangles",
    blending: _Blending = "auto",
) -> Btf: ...
def directions(degrees: ArrayLike, /) -> _Floats: ...
def info(path: _Path, /, **options: Any) -> dict[str, Any]: ...
def acquire(
    sample: str,
    output: _Path,
    *,
    size: int = 64,
    spp: int = 32,
    depth: int = 4,
    seed: int = 0,
    directions: str = "bonn81",
    object: _Path | None = None,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
    **params: Any,
) -> None: ...
def compress(
    source: _Path,
    output: _Path,
    *,
    method: str = "klt",
    quality: int | None = None,
    max_error: float | None = None,
    max_bytes: int | None = None,
    lossless: str | None = None,
    measure: bool = True,
    memory: int | str | None = None,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
    **params: Any,
) -> dict[str, Any]: ...
def compare(
    source: _Path, *others: _Path, progress: _Progress = None, threads: int | None = None
) -> list[dict[str, Any]]: ...
def convert(
    source: _Path,
    output: _Path,
    *,
    format: str | None = None,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
    **options: Any,
) -> dict[str, Any]: ...
def fit(
    source: _Path,
    *,
    model: str | None = None,
    lobes: int = 1,
    anisotropic: bool | None = None,
    progress: _Progress = None,
    threads: int | None = None,
) -> dict[str, Any]: ...
def factor(
    source: _Path,
    output: _Path,
    *,
    method: str = "hf",
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
    **params: Any,
) -> dict[str, Any]: ...
def render(
    subject: _Path,
    *,
    object: str = "sphere",
    scene: bool = False,
    size: tuple[int, int] = ...,
    spp: int = 64,
    depth: int | None = None,
    seed: int = 0,
    uv_scale: float = 4.0,
    uv_rotation: float = 0.0,
    light: tuple[float, float] | None = None,
    denoise: bool = False,
    interpolation: _Scheme = "triangles",
    blending: _Blending = "auto",
    progress: _Progress = None,
    threads: int | None = None,
) -> _Floats: ...
def export(source: _Path, renderer: str, output: _Path, *, progress: _Progress = None) -> dict[str, Any]: ...
