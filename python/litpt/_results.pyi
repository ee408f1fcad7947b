# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import os
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
import xarray
from numpy.typing import ArrayLike, DTypeLike, NDArray
from typing_extensions import Self, TypeAlias

from . import Scene, _core

_Real: TypeAlias = np.floating[Any] | np.integer[Any] | np.bool_
# No Estimate is one of these.
_Numbers: TypeAlias = float | _Real | NDArray[_Real] | Sequence[float | _Real]

class Estimate:
    __array_ufunc__: None
    value: NDArray[np.float64]
    stderr: NDArray[np.float64]
    def __init__(
        self, value: NDArray[np.float64], stderr: NDArray[np.float64]
    ) -> None: ...
    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[np.float64]: ...
    def __mul__(self, factor: _Numbers) -> Estimate: ...
    def __rmul__(self, factor: _Numbers) -> Estimate: ...
    def __truediv__(self, number: _Numbers) -> Estimate: ...
    def __getitem__(self, index: Any, /) -> Estimate: ...
    def __format__(self, form: str) -> str: ...

def rounded(value: float, stderr: float) -> str: ...

def named(path: str | os.PathLike[str]) -> str: ...

class Run:
    samples: NDArray[np.int64]
    method: Literal["reference", "sobol", "gather"]
    stopped: Literal["samples", "time", "error", "interrupt", "not yet"]
    seconds: float
    constant: int
    def __init__(
        self,
        scene: Scene,
        shape: tuple[int, ...],
        words: Sequence[str],
        points: tuple[NDArray[np.float64], NDArray[np.float64], str] | None,
        core: _core.Rendering,
        states: Iterable[bytes] = (),
    ) -> None: ...
    @property
    def command(self) -> str | None: ...
    def __getstate__(self) -> dict[str, Any]: ...
    def __add__(self, other: Self | Literal[0]) -> Self: ...
    # 0, with which sum() begins.
    def __radd__(self, other: int) -> Self: ...

class Result(Run, Estimate):
    unit: str
    @property
    def derivative(self) -> Estimate | None: ...
    @property
    def filtered(self) -> NDArray[np.float64] | None: ...
    @property
    def filtered_stderr(self) -> NDArray[np.float64] | None: ...
    def weighted_sum(self, weights: ArrayLike) -> Estimate: ...
    def weighted_mean(self, weights: ArrayLike) -> Estimate: ...
    def save(
        self,
        path: str | os.PathLike[str],
        exposure: float | Literal["auto"] | None = None,
    ) -> None: ...
    def to_xarray(self) -> xarray.Dataset: ...
