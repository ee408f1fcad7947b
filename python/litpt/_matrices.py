# Tangled from chapters/python.nw; edit there.
# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""View factors, daylight coefficients, and a year of daylight."""
import functools
import os
import warnings

import numpy as np

from . import _arrays, _core
from ._results import Estimate, Run, _call, named


class Matrix(Run):
    """A matrix that a run has found."""

    # The names of rows and of columns.
    rows = property(lambda self: self._entries[2][0])
    columns = property(lambda self: self._entries[2][1])

    def save(self, path):
        """Writes a file by its extension, in place of one that exists, with
        the bytes of `pt`: a table, .csv; factors between faces as .vf of
        View3D, .svf of uDALES or .json of EnergyPlus; coefficients as .mtx of
        Radiance; or the state of the run, .litpt."""
        words = [*self._words, f"--output={named(path)}", "--force"]
        _call(self._rendering().save, words)

    def __repr__(self):
        n, m = map(len, self._entries[2])
        return f"{n} x {m} {self._facts()}"


class ViewFactors(Matrix):
    """View factors: parts of the light from faces, or at points. A row sums
    to 1. `rows` and `columns` are names, lists of text, as in a table of
    `pt`: numbers of faces or points from 1, or names; "sky" and "ground" are
    the last columns.

    matrix, stderr
        The factors and their standard errors, (rows, columns): each a
        csr_array of scipy.sparse, or an array if there is no scipy; float64.
        A row without a value has a nan in its last column, or in all of an
        array.
    moves
        None; of closed factors by how many standard errors entries were moved,
        at most and in the mean.

    Besides, there is what each run has: `samples`, one number a row, or two
    of both sides, `method`, `stopped`, `seconds` and `command`. Two parts of
    one run add up.
    """

    unit = "view factors"

    @functools.cached_property
    def _pair(self):
        (starts, columns), numbers, names, _ = self._entries
        shape = tuple(map(len, names))
        try:
            from scipy.sparse import csr_array
        except ImportError:
            return list(self._dense())
        return [csr_array((data, columns, starts), shape, copy=True)
                for data in numbers]

    matrix = property(lambda self: self._pair[0])
    stderr = property(lambda self: self._pair[1])
    moves = property(lambda self: self._entries[3])

    def closed(self):
        """The nearest factors that are reciprocal, area times factor, and
        whose rows sum to 1. Only of factors between faces."""
        words = [word for word in self._words if word != "--closed"]
        closed = self._restored([*words, "--closed"], self._parts())
        if closed._entries[3][1] > 2:
            warnings.warn("closing has moved view factors by many errors: do "
                          "faces cut each other, or does one see the back of "
                          "another (side='both')?", stacklevel=2)
        return closed


class DaylightCoefficients(Matrix, Estimate):
    """The irradiance at points for a radiance of 1 of parts of the sky.

    value, stderr
        Coefficients and their standard errors, (points, columns), in units
        of that radiance (sr): column 0 is the ground, the others are the
        patches of Reinhart's sky in the order of Radiance. Float64; a row
        without a value is nan.

    Besides, there is what each run has: `samples`, one number a row, `method`,
    `stopped`, `seconds` and `command`. Two parts of one run add up.
    `coefficients @ sky` is the Daylight under a sky of `read_sky`.
    """

    unit = "daylight coefficients"

    @functools.cached_property
    def _pair(self):
        return self._dense()

    value = property(lambda self: self._pair[0])
    stderr = property(lambda self: self._pair[1])

    def __matmul__(self, sky):
        is_sky = isinstance(sky, _core.Sky)
        return Daylight(self, sky) if is_sky else NotImplemented


def read_sky(path):
    """The radiances of a sky at the steps of a year, from a matrix of
    Radiance: a file of `gendaymtx -O0`, of text or of binary numbers. It has
    the numbers `patches`, with the ground, and `steps`."""
    return _call(_core.Sky.read, os.fsdecode(path))


class Interval:
    """Numbers `value`, with `low` and `high`, between which the truth lies in
    95 of 100 runs: float64 arrays of one shape."""

    def __init__(self, value, low, high):
        self.value, self.low, self.high = map(np.asarray, (value, low, high))

    def __repr__(self):
        with np.printoptions(threshold=12):
            return f"value: {self.value}\nlow: {self.low}\nhigh: {self.high}"


class Daylight:
    """The daylight at sensors through a year: coefficients times a sky.

    value, stderr
        The illuminance in lux and its standard error, (sensors, steps), as
        the spread of the replicates shows: float64.

    Hours are None, those from 8 to 18 of each day, or an array of bool, one
    for each step. What was computed for one call is kept for the next.
    """

    def __init__(self, coefficients, sky):
        self._coefficients, self._sky, self._years = coefficients, sky, {}
        patches = len(coefficients.columns)
        if sky.patches != patches:
            raise ValueError(f"the sky has {sky.patches} patches, and the "
                             f"coefficients have {patches}")

    @functools.cached_property
    def _lux(self):
        pair = _call(self._sky.lux, self._coefficients._rendering())
        return [array.reshape(-1, self._sky.steps) for array in pair]

    value = property(lambda self: self._lux[0])
    stderr = property(lambda self: self._lux[1])

    def autonomy(self, enough=300, hours=None):
        """The part of the hours in which each sensor has `enough` lux, an
        Interval: (sensors,)."""
        return Interval(*self._year(hours, enough=enough)[0][:, 0].T)

    def useful(self, least=100, most=3000, hours=None):
        """The part of the hours in which each sensor has from `least` to
        `most` lux, an Interval: (sensors,)."""
        return Interval(*self._year(hours, least=least, most=most)[0][:, 1].T)

    def sda(self, enough=300, part=0.5, hours=None):
        """The spatial daylight autonomy: the part of the sensors that have
        `enough` lux in this part of the hours or more, an Interval: ()."""
        return Interval(*self._year(hours, enough=enough, part=part)[1])

    def _year(self, hours, **demand):
        """Enough and useful light of sensors, and of all."""
        demand = dict(enough=300, least=100, most=3000, part=0.5) | demand
        enough, least, most, part = [
            _arrays.numbers(name, [number], (1,))[0]
            for name, number in demand.items()]
        if not least <= most:
            raise ValueError(f"least = {least}: more than most = {most}")
        count = self._sky.steps
        if hours is None and count % 24:
            raise ValueError(f"hours: the sky has {count} steps, and no whole "
                             "days: an array tells which of them count")
        if hours is None:
            hours = (np.arange(count) % 24 - 8) % 24 < 10
        hours = _arrays.numbers("hours", hours, (count,), "b", bool)
        if not hours.any():
            raise ValueError("hours: no step counts")
        key = enough, least, most, part, hours.tobytes()
        if key not in self._years:
            steps = np.flatnonzero(hours).tolist()
            sensors, spatial = _call(
                self._sky.year, self._coefficients._rendering(), steps,
                enough, (least, most), part)
            self._years[key] = sensors.reshape(-1, 2, 3), spatial
        return self._years[key]
