from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .codecs import Images

_Path: TypeAlias = str | PathLike[str]
_Floats: TypeAlias = NDArray[np.float32]
_Index: TypeAlias = int | slice | Sequence[int] | NDArray[np.integer[Any]] | None
_Progress: TypeAlias = Callable[[str, int, int], object] | None
_Features: TypeAlias = Literal["appearance", "height", "both"]
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
    def parts(self) -> dict[str, Any]: ...
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
    grid: int = 512,
    height: _Path | None = None,
    object: _Path | None = None,
    albedo: _Path | None = None,
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
    source: _Path | Btf | Images, *others: _Path | Btf | Images, progress: _Progress = None, threads: int | None = None
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
def rectify(
    manifest: _Path,
    output: _Path,
    *,
    size: int = 256,
    max_error: float = 0.5,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
    **options: Any,
) -> dict[str, Any]: ...
def synthesize(
    source: _Path,
    output: _Path,
    *,
    others: Sequence[tuple[_Path, float]] = ...,
    size: tuple[int, int] | None = None,
    method: str = "optimise",
    picture: bool = False,
    tileable: bool = False,
    seed: int = 0,
    periodic: bool = False,
    mask: _Path | None = None,
    guide: _Path | None = None,
    guide_weight: float = 10.0,
    compare: _Features = "appearance",
    channels: int = 8,
    store: Literal["map", "planes"] = "map",
    map: _Path | None = None,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
    **params: Any,
) -> dict[str, Any]: ...
def synthesize_on(
    source: _Path,
    mesh: str,
    output: _Path,
    *,
    size: int,
    seed: int = 0,
    strokes: Sequence[tuple[float, float, float, float, float, float]] = ...,
    compare: _Features = "appearance",
    channels: int = 8,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
) -> dict[str, Any]: ...
def apply_map(map: _Path, picture: _Path, output: _Path, *, overwrite: bool = False) -> None: ...
def exchange(
    structure: _Path,
    reflectance: _Path,
    output: _Path,
    *,
    match: Literal["transport", "assignment", "brightness", "index"] = "transport",
    regularise: float | None = None,
    split: bool = False,
    keep: Literal["nothing", "shading"] = "nothing",
    clusters: int = 256,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
) -> dict[str, Any]: ...
def blend(
    first: _Path,
    second: _Path,
    output: _Path,
    *,
    amount: float = 0.5,
    mask: _Path | None = None,
    clusters: int = 256,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
) -> dict[str, Any]: ...
def edit(
    source: _Path,
    output: _Path,
    *,
    recolor: str | dict[str, Any] | None = None,
    gloss: float = 1.0,
    highlights: float = 1.0,
    contrast: float = 1.0,
    tint: str = "ffffff",
    exposure: float = 0.0,
    desaturate: float = 0.0,
    rows: Sequence[int] | None = None,
    colors: tuple[str, float] | None = None,
    mask: _Path | None = None,
    grow: tuple[int, int] | None = None,
    similar: float = 10.0,
    clusters: int = 256,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
) -> dict[str, Any]: ...
def family(
    source: _Path,
    output: _Path,
    *,
    count: int = 12,
    seed: int = 0,
    spread: float = 1.0,
    object: str = "cloth",
    clusters: int = 256,
    overwrite: bool = False,
    progress: _Progress = None,
    threads: int | None = None,
) -> dict[str, Any]: ...
def store_parts(parts: dict[str, Any], output: _Path, *, overwrite: bool = False) -> int: ...
def sweep(
    source: _Path,
    output: _Path,
    *,
    methods: Sequence[str] | None = None,
    progress: _Progress = None,
    threads: int | None = None,
) -> list[dict[str, Any]]: ...
def _plan(
    source: _Path,
    output: _Path,
    job: _Path,
    *,
    tasks: int,
    method: str,
    quality: int | None = None,
    max_error: float | None = None,
    max_bytes: int | None = None,
    lossless: str | None = None,
    measure: bool = True,
    memory: int | str | None = None,
    overwrite: bool = False,
    **params: Any,
) -> None: ...

@final
class _Job:
    def __new__(cls, folder: _Path) -> _Job: ...
    def run(self, stage: int, task: int, *, threads: int | None = None) -> None: ...
    def compress(
        self,
        wait: Callable[[int, str, list[int]], bool],
        *,
        progress: _Progress = None,
        threads: int | None = None,
    ) -> dict[str, Any]: ...
