# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import os
from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAlias

__all__ = ["Scene", "Job", "main", "matrix", "Sky", "Rendering", "version"]

_Floats: TypeAlias = NDArray[np.float64]
_Points: TypeAlias = tuple[_Floats, _Floats, str]
_Mesh: TypeAlias = tuple[
    _Floats,
    NDArray[np.int64],
    NDArray[np.int64] | None,
    NDArray[np.uint32] | None,
]

version: str

def main(words: Sequence[str | os.PathLike[str]]) -> int: ...
def matrix(
    rendering: Rendering, closes: bool
) -> (
    tuple[
        list[NDArray[np.int64]],
        list[_Floats],
        list[list[str]],
        list[float] | None,
    ]
    | None
): ...

@final
class Sky:
    @staticmethod
    def read(path: str | os.PathLike[str]) -> Sky: ...
    @property
    def patches(self) -> int: ...
    @property
    def steps(self) -> int: ...
    def lux(self, /, rendering: Rendering) -> list[_Floats]: ...
    def year(
        self,
        /,
        rendering: Rendering,
        steps: Sequence[int],
        enough: float,
        useful: tuple[float, float],
        part: float,
    ) -> tuple[_Floats, list[float]]: ...

@final
class Scene:
    @staticmethod
    def open(
        words: Sequence[str],
        mesh: _Mesh | None,
        albedos: _Floats | None,
        sha256: str,
    ) -> tuple[Scene, list[str]]: ...
    def start(self, /, words: Sequence[str], points: _Points | None) -> Job: ...
    def restore(
        self,
        /,
        words: Sequence[str],
        points: _Points | None,
        states: Sequence[bytes],
    ) -> Rendering: ...
    def hits(
        self, /, words: Sequence[str], origins: _Floats, directions: _Floats
    ) -> tuple[NDArray[np.int64], _Floats]: ...
    def arrays(self, /) -> _Mesh: ...

@final
class Job:
    def wait(self, /, seconds: float) -> bool: ...
    def progress(self, /) -> tuple[float, str]: ...
    def partial(self, /, asks: bool) -> Rendering | None: ...
    def cancel(self, /) -> None: ...
    def warnings(self, /) -> list[str]: ...
    def result(self, /) -> Rendering: ...

@final
class Rendering:
    def values(self, /) -> list[_Floats]: ...
    def filtered(self, /) -> list[_Floats] | None: ...
    def blocks(self, /) -> tuple[_Floats, _Floats]: ...
    def state(self, /) -> bytes: ...
    def save(self, /, words: Sequence[str]) -> None: ...
    def facts(self, /) -> dict[str, Any]: ...
