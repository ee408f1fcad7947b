# Tangled from chapters/python.nw; edit there.
# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Values with errors."""
import functools
import html
import os
import re
import shlex
import tempfile

import numpy as np

from . import _core


# Options of `pt` that have other names here.
_NAMES = {"spp": "samples", "resolution": "size", "integrator": "method",
          "error-norm": "norm", "faces": "side", "output": "path",
          "input": "mesh", "view-factors": "columns",
          "sky-patches": "sky_patches"}


def _call(function, *arguments):
    """Calls the compiled half; its faults name arguments, not options."""
    try:
        return function(*arguments)
    except ValueError as fault:
        text = str(fault).removesuffix(" (see pt --help)")
    text = re.sub("^the following .*: (--[a-z]+).*", r"\1 is missing", text)
    text = re.sub("^invalid value '(.*?)' for '(--[a-z-]+)[^']*'", r"\2 = \1",
                  text)
    name = lambda match: _NAMES.get(match[1], match[1])
    raise ValueError(re.sub(r"(?<![\w-])--([a-z-]+)", name, text))


def named(path):
    """The path of a file as text."""
    path = os.fsdecode(path)
    if path in ("", "-"):
        raise ValueError(f"path = {path!r}: names no file")
    return path


class Estimate:
    """Estimated numbers `value` with standard errors `stderr`: float64 arrays
    of one shape. It may be multiplied and divided by numbers."""

    __array_ufunc__ = None  # numpy's functions need value

    def __init__(self, value, stderr):
        self.value, self.stderr = np.asarray(value), np.asarray(stderr)

    def __array__(self, dtype=None, copy=None):
        array = np.asarray(self.value, dtype)
        return array if copy is False else array.copy()

    def __mul__(self, factor):
        factor = np.asarray(factor) if _is_number(factor) else None
        if factor is None:
            return NotImplemented
        return Estimate(self.value * factor, self.stderr * abs(factor))

    __rmul__ = __mul__

    def __truediv__(self, number):
        is_number = _is_number(number)
        return self * (1 / np.asarray(number)) if is_number else NotImplemented

    def __getitem__(self, index):
        return Estimate(self.value[index], self.stderr[index])

    def __format__(self, form):
        return format(self.value, form) if form else repr(self)

    def __repr__(self):
        if not self.value.shape:
            return rounded(self.value, self.stderr)
        with np.printoptions(threshold=12):
            return f"value: {self.value}\nstderr: {self.stderr}"


def _is_number(value):
    """Whether a value is a number, or an array of numbers."""
    is_own = isinstance(value, Estimate)
    return not is_own and np.asarray(value).dtype.kind in "fiu"


def rounded(value, stderr):
    """A value with the digits for which its error has two."""
    if not 0 < stderr < np.inf:
        return f"{value:.6g} ± {stderr:.2g}"
    places = min(12, max(0, 1 - int(np.floor(np.log10(stderr)))))
    return f"{value:.{places}f} ± {stderr:.{places}f}"


class Run:
    """What each result of a run has, and how parts of a run are added."""

    def __init__(self, scene, shape, words, points, core, states=()):
        self._scene, self._shape, self._points = scene, shape, points
        self._words, self._core, self._states = words, core, list(states)
        numbers = [array.reshape(shape) for array in core.values()]
        self._numbers(*numbers[:2])
        self.samples = np.nan_to_num(numbers[2]).astype(np.int64)
        self.method, self.stopped, self.seconds, self.constant = core.facts()

    def _numbers(self, value, stderr):
        """Keeps the sums of rows, if they are of use."""

    @property
    def command(self):
        is_whole = self.stopped in ("samples", "error")
        if self._scene._digest or self._points or not is_whole:
            return None
        name = "image.exr" if self._is_image else "values.csv"
        return shlex.join(["pt", *self._words, "-o", name])

    @property
    def _is_image(self):
        return self._shape[0] > 0

    def _rendering(self):
        """The compiled half, which is made again after a pickle."""
        self._core = self._core or _call(
            self._scene._core.restore, self._words, self._points, self._states)
        return self._core

    def _parts(self):
        return self._states or [bytes(self._rendering().state())]

    def __getstate__(self):
        self._blocks, self._entries
        return {**self.__dict__, "_states": self._parts(), "_core": None}

    def __add__(self, other):
        if not isinstance(other, type(self)):
            is_zero = isinstance(other, int) and other == 0  # as sum adds
            return self if is_zero else NotImplemented
        words = [word for word in self._words if "--samples=" not in word]
        whole = self._restored(words, self._parts() + other._parts())
        blocks = zip(self._blocks, other._blocks)
        whole._blocks = tuple(np.concatenate(pair) for pair in blocks)
        return whole

    __radd__ = __add__

    def _restored(self, words, states):
        """The result of these words whose parts have these states."""
        core = _call(self._scene._core.restore, words, self._points, states)
        return type(self)(self._scene, self._shape, words, self._points, core,
                          states)

    @functools.cached_property
    def _blocks(self):
        """How many samples each block has, and the means of its own."""
        counts, means = self._rendering().blocks()
        means = means.reshape(-1, *self.samples.shape)
        sizes = np.diff(counts, prepend=0)
        sums = np.diff((counts * means.T).T, axis=0, prepend=0)
        return sizes, (sums.T / sizes).T

    @functools.cached_property
    def _entries(self):
        """The matrix of a tally: where rows begin, and columns; values and
        errors; names of rows and of columns; and moves. None without."""
        closes = "--closed" in self._words
        return _call(_core.matrix, self._rendering(), closes)

    def _dense(self):
        """Values and errors of a tally; a row is nan if it has no value."""
        (starts, columns), numbers, names, _ = self._entries
        rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        both = np.zeros((2, *map(len, names)))
        both[:, rows, columns] = numbers
        both[:, np.isnan(both[0, :, -1])] = np.nan
        return both

    def _facts(self):
        hidden = f", {self.constant} saw one value" if self.constant else ""
        return (f"{self.unit}; {self.method}, {self.samples.max()} samples, "
                f"{self.seconds:.2f} s, stopped by {self.stopped}{hidden}")


class Result(Run, Estimate):
    """What a run has found. Besides `value` and `stderr`:

    samples
        int64, of the same shape.
    filtered, filtered_stderr
        A picture with less noise and its error, float64; None for receivers
        and if there are too few samples.
    derivative
        That by an albedo, an Estimate of the same shape, if it was asked for;
        else None.
    method, stopped, seconds, unit
        How it was rendered; why that ended: by "samples", "time", "error", an
        "interrupt", or "not yet"; the seconds of rendering; and the unit.
    constant
        How many saw one value only, so that their error is 0, and hidden.
    command
        The line of `pt` that gives the same bits, or None.

    Two parts of one run add up to the bits of the whole.
    """

    def _numbers(self, value, stderr):
        Estimate.__init__(self, value, stderr)
        self.unit = ("radiance (uniform sky = 1)" if self._is_image else
                     "irradiance (horizontal in the open = 1)")

    @functools.cached_property
    def derivative(self):
        if self._entries is None:
            return None
        return Estimate(*(x.reshape(self._shape) for x in self._dense()))

    @functools.cached_property
    def _filtered(self):
        pair = self._rendering().filtered() or [None, None]
        return [x if x is None else x.reshape(self._shape) for x in pair]

    filtered = property(lambda self: self._filtered[0])
    filtered_stderr = property(lambda self: self._filtered[1])

    def weighted_sum(self, weights):
        """The sum of all values, each times its weight, as an Estimate: ().
        With weights of a shape (..., *value.shape), as many sums.

        Values vary together. The error is that which blocks of samples show;
        with k of them it is known to about one part in the root of 2 k - 2.
        """
        if np.ma.is_masked(weights):
            raise ValueError("weights: has masked values")
        weights, n = np.asarray(weights, float), self.value.ndim
        if weights.shape[weights.ndim - n:] != self.value.shape:
            raise ValueError(f"weights: expected shape {self.value.shape}, or "
                             f"more axes before, not {weights.shape}")
        sizes, means = self._blocks
        if len(sizes) < 4:
            raise ValueError("weights: pixels, and places with fewer than "
                             "four blocks of samples, have no error of a sum")
        axes = tuple(range(-n, 0))
        total = lambda values: np.where(weights, weights * values, 0).sum(axes)
        sums = np.array([total(block) for block in means])
        squares = (sums - np.tensordot(sizes, sums, 1) / sizes.sum()) ** 2
        square = np.tensordot(sizes, squares, 1) / (len(sizes) - 1)
        return Estimate(total(self.value), np.sqrt(square / sizes.sum()))

    def weighted_mean(self, weights):
        """The same, with weights that are divided by their sum."""
        if not np.ma.is_masked(weights):
            weights = np.asarray(weights, float)
        axes = tuple(range(-min(self.value.ndim, weights.ndim), 0))
        sums = weights.sum(axes, keepdims=True)
        if not np.all(sums):
            raise ValueError("weights: their sum is 0")
        return self.weighted_sum(weights / sums)

    def save(self, path, exposure=None):
        """Writes a file by its extension, in place of one that exists: places
        as .csv, .ply or, for vertices, .obj; pixels as .exr, .pfm, .png, .pgm
        or a page .html; the state of the run as .litpt; a report as .json."""
        path = named(path)
        is_report = path.endswith((".json", ".html"))
        words = [f"--{'report' if is_report else 'output'}={path}", "--force"]
        if exposure is not None:
            words.append(f"--exposure={exposure}")
        _call(self._rendering().save, [*self._words, *words])

    def to_xarray(self):
        """The arrays as a Dataset of xarray."""
        import xarray
        dims = ("y", "x") if self._is_image else ("place", "side")
        dims, facts = dims[:self.value.ndim], {"unit": self.unit}
        names = ["value", "stderr", "samples"]
        arrays = {name: (dims, getattr(self, name)) for name in names}
        return xarray.Dataset(arrays, attrs=facts)

    def __repr__(self):
        return f"{super().__repr__()}\n{self._facts()}"

    def _repr_html_(self):
        if self._is_image:
            return None
        pairs = list(zip(self.value.flat[:5], self.stderr.flat[:5]))
        rows = [f"<tr><td>{i}<td>{rounded(*p)}" for i, p in enumerate(pairs)]
        if self.value.size > 5:
            rows.append(f"<tr><td>...<td>{self.value.size} in all")
        facts = html.escape(self._facts())
        return f"<table><caption>{facts}</caption>{''.join(rows)}</table>"

    def _repr_png_(self):
        if not self._is_image:
            return None
        is_given = any(word.startswith("--exposure") for word in self._words)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "image.png")
            self.save(path, None if is_given else "auto")
            with open(path, "rb") as file:
                return file.read()
