# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal, NoReturn, Protocol, type_check_only

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypeAlias, TypedDict, Unpack

from ._matrices import (
    Daylight,
    DaylightCoefficients,
    Interval,
    ViewFactors,
    read_sky,
)
from ._results import Estimate, Result

__all__ = [
    "Daylight",
    "DaylightCoefficients",
    "Estimate",
    "Interval",
    "Result",
    "Scene",
    "ViewFactors",
    "pt",
    "read_sky",
]
__version__: str

def pt() -> NoReturn: ...

_Whole: TypeAlias = int | np.integer[Any]
_Number: TypeAlias = float | np.floating[Any] | np.integer[Any]
_Numbers: TypeAlias = (
    Sequence[_Number] | NDArray[np.floating[Any] | np.integer[Any]]
)
_Direction: TypeAlias = _Numbers | Literal["x", "y", "z"]
_Side: TypeAlias = Literal["front", "back", "both"]
# Names, which editors offer, or a name with degrees, as "front,20,10".
_View: TypeAlias = Literal["front", "back", "left", "right", "top", "iso"] | str
_Exposure: TypeAlias = _Number | Literal["auto"]
_Progress: TypeAlias = bool | Callable[[float, str], object] | None

class _Array(Protocol):
    """Of xarray, pandas or others."""

    def __array__(self) -> NDArray[Any]: ...

class _Triangles(Protocol):
    """Of trimesh or others."""

    @property
    def vertices(self) -> ArrayLike: ...
    @property
    def faces(self) -> ArrayLike: ...

class _Polygons(Protocol):
    """Of pyvista."""

    @property
    def points(self) -> ArrayLike: ...
    @property
    def faces(self) -> ArrayLike: ...

@type_check_only
class Limits(TypedDict, total=False):
    samples: _Whole | slice | None
    of: _Whole | None
    time: _Number | None
    error: _Number | str | None
    norm: Literal["rms", "max"] | None
    seed: _Whole
    method: Literal["auto", "reference", "sobol", "gather"] | None
    threads: _Whole | None

@type_check_only
class Derived(Limits, total=False):
    derivative: str | None

@type_check_only
class _Options(Derived, total=False):
    """Of all methods."""

    points: ArrayLike
    normals: ArrayLike
    side: _Side
    position: _Numbers | None
    target: _Numbers | None
    up: _Direction | None
    fov: _Number
    size: tuple[_Whole, _Whole]
    view: _View | None
    background: _Number | None
    exposure: _Exposure | None

class Scene:
    def __init__(
        self,
        mesh: (
            str
            | os.PathLike[str]
            | tuple[ArrayLike, ArrayLike]
            | _Triangles
            | _Polygons
        ),
        albedo: (
            _Number
            | _Numbers
            | _Array
            | Mapping[str, _Number]
            | Mapping[str | None, _Number]
            | Literal["materials"]
            | None
        ) = None,
        sky: str = "uniform",
        ground: _Number | None = None,
        zenith: _Direction = (0, 0, 1),
        sun: _Numbers | None = None,
        ground_glow: _Number | None = None,
    ) -> None: ...
    def __getstate__(self) -> tuple[Any, ...]: ...
    def __setstate__(self, state: tuple[Any, ...]) -> None: ...
    def irradiance(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        progress: _Progress = None,
        **limits: Unpack[Derived],
    ) -> Result: ...
    def face_irradiance(
        self,
        side: _Side = "front",
        progress: _Progress = None,
        **limits: Unpack[Derived],
    ) -> Result: ...
    def vertex_irradiance(
        self, progress: _Progress = None, **limits: Unpack[Derived]
    ) -> Result: ...
    def view_factors(
        self,
        columns: Literal["faces", "materials", "objects", "groups"] = "faces",
        *,
        points: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        side: _Side = "front",
        progress: _Progress = None,
        **limits: Unpack[Limits],
    ) -> ViewFactors: ...
    def daylight_coefficients(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        sky_patches: Literal[1, 2, 4] = 1,
        progress: _Progress = None,
        **limits: Unpack[Limits],
    ) -> DaylightCoefficients: ...
    def render(
        self,
        position: _Numbers | None = None,
        target: _Numbers | None = None,
        up: _Direction | None = None,
        fov: _Number = 70,
        size: tuple[_Whole, _Whole] = (320, 240),
        view: _View | None = None,
        background: _Number | None = None,
        exposure: _Exposure | None = None,
        progress: _Progress = None,
        **limits: Unpack[Limits],
    ) -> Result: ...
    def steps(
        self,
        quantity: Literal[
            "irradiance", "face_irradiance", "vertex_irradiance", "render"
        ],
        *places: ArrayLike,
        every: float = 0.5,
        **options: Unpack[_Options],
    ) -> Iterator[Result]: ...
    def intersects_first(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike
    ) -> NDArray[np.int64]: ...
    def intersects_any(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike
    ) -> NDArray[np.bool_]: ...
    def intersects_location(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: Literal[False] = False,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]: ...
