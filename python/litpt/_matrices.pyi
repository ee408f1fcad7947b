# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAlias

from . import _core
from ._results import Estimate, Run

_Hours: TypeAlias = NDArray[np.bool_] | list[bool] | None

class Matrix(Run):
    unit: str
    @property
    def rows(self) -> list[str]: ...
    @property
    def columns(self) -> list[str]: ...
    def save(self, path: str | os.PathLike[str]) -> None: ...

class ViewFactors(Matrix):
    # A csr_array of scipy, or an array.
    @property
    def matrix(self) -> Any: ...
    @property
    def stderr(self) -> Any: ...
    @property
    def moves(self) -> list[float] | None: ...
    def closed(self) -> ViewFactors: ...

class DaylightCoefficients(Matrix, Estimate):
    @property
    def value(self) -> NDArray[np.float64]: ...  # type: ignore[override]
    @property
    def stderr(self) -> NDArray[np.float64]: ...  # type: ignore[override]
    def __matmul__(self, sky: _core.Sky) -> Daylight: ...

def read_sky(path: str | os.PathLike[str]) -> _core.Sky: ...

class Interval:
    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    def __init__(
        self,
        value: NDArray[np.float64],
        low: NDArray[np.float64],
        high: NDArray[np.float64],
    ) -> None: ...

class Daylight:
    def __init__(
        self, coefficients: DaylightCoefficients, sky: _core.Sky
    ) -> None: ...
    @property
    def value(self) -> NDArray[np.float64]: ...
    @property
    def stderr(self) -> NDArray[np.float64]: ...
    def autonomy(self, enough: float = 300, hours: _Hours = None) -> Interval: ...
    def useful(
        self, least: float = 100, most: float = 3000, hours: _Hours = None
    ) -> Interval: ...
    def sda(
        self, enough: float = 300, part: float = 0.5, hours: _Hours = None
    ) -> Interval: ...
