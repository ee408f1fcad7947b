# The scenes and programs of the tests.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
import os
import pathlib
import shlex
import shutil
import subprocess

import numpy as np
import pytest

ROOM = pathlib.Path(__file__).parents[2] / "doc/examples/room.obj"


@pytest.fixture
def pt(tmp_path):
    """Runs a line of `pt`, or of `ptimg` beside it, in a folder of its own."""
    program = os.environ.get("PT") or shutil.which("pt")

    def run(line):
        name, *words = shlex.split(line)
        words = [pathlib.Path(program).with_name(name), *words]
        if not words[0].exists():
            pytest.skip(f"there is no {name}")
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return tmp_path
    return run


@pytest.fixture
def points():
    """Forty points of the room, above its desks."""
    rng = np.random.default_rng(1)
    return rng.uniform([0.3, 0.3, 0.85], [5.7, 3.7, 0.85], (40, 3))


@pytest.fixture
def box():
    """An open box of six quadrilaterals without a lid, as arrays."""
    corners = np.array([[x, y, z] for z in (0, 2) for y in (0, 3) for x in (0, 4)])
    quads = [[0, 2, 3, 1], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return corners.astype(float), np.array(quads)


@pytest.fixture
def sky(tmp_path):
    """The path of a sky matrix of four days: any radiances, dark at night."""
    steps = np.arange(96)
    light = np.maximum(np.sin((steps % 24 - 6) / 12 * np.pi), 0) * (1 + steps / 96)
    rng = np.random.default_rng(4)
    radiances = (rng.gamma(1, 12, (146, 1, 3)) * light[:, None]).astype("<f4")
    head = "#?RADIANCE\nNROWS=146\nNCOLS=96\nNCOMP=3\nFORMAT=float\n\n"
    path = tmp_path / "sky.smx"
    path.write_bytes(head.encode() + radiances.tobytes())
    return path
