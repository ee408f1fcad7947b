# Tangled from chapters/python.nw; edit there.
# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light arrives at places, each value with its error.

>>> import litpt
>>> corners = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
>>> scene = litpt.Scene((corners, [[0, 1, 2], [0, 2, 3]]), albedo=0.5)
>>> scene.irradiance([[1, 2, 0.85]], [0, 0, 1], samples=64).value
array([1.])

A value is an irradiance in units of that of a horizontal surface in the open,
or a radiance in units of that of the uniform sky. Every result has the bits
that `pt` gives it, on any machine and any number of threads.
"""
import inspect
import os
import re
import signal
import sys
import time as clock
import warnings
from collections.abc import Mapping

import numpy as np

from . import _arrays, _core
from ._results import Estimate, Result

__all__ = ["Estimate", "Result", "Scene", "pt"]
__version__ = _core.version


def pt():
    """Runs the command `pt` with the words of this process, and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_core.main(["pt", *sys.argv[1:]]))


def _text(value):
    """A value as `pt` reads it."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value).replace(" %", "%")
    if isinstance(value, (list, tuple, np.ndarray)):
        return ",".join(map(_text, value))
    is_whole = isinstance(value, (int, np.integer))
    return str(int(value)) if is_whole else repr(float(value))


def _words(**options):
    """The options that are given, as words of `pt`."""
    words = []
    for name, value in options.items():
        try:
            text = None if value is None else _text(value)
        except TypeError:
            raise ValueError(f"{name} = {value!r}: not a number") from None
        words += [] if text is None else [f"--{name.replace('_', '-')}={text}"]
    return words


# Options of `pt` that have other names here.
_NAMES = {"spp": "samples", "resolution": "size", "integrator": "method",
          "error-norm": "norm", "faces": "side"}


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
    raise ValueError(re.sub("--([a-z-]+)", name, text))


def _limits(samples=None, of=None, time=None, error=None, norm=None,
            seed=None, method=None, threads=None):
    part, is_part = None, isinstance(samples, slice)
    is_whole = is_part and (samples.stop is None or samples.step)
    if is_part != (of is not None) or is_whole:
        raise ValueError(f"samples = {samples}, of = {of}: a part of all "
                         "samples is samples=slice(0, 512), of=2048")
    if is_part:
        part, samples = f"{samples.start or 0}..{samples.stop}", of
    return _words(spp=samples, samples=part, time=time, error=error,
                  error_norm=norm, seed=seed, integrator=method,
                  threads=threads)


_LIMITS = _limits.__code__.co_varnames[:_limits.__code__.co_argcount]


_interrupted = -np.inf


def _wait(job, progress):
    """Waits for a run. An interrupt ends it, and what was sampled is returned;
    a second one is raised."""
    global _interrupted
    try:
        while not job.wait(0.05):
            if progress:
                progress(*job.progress())
    except BaseException as cause:
        job.cancel()
        pause = 10 if hasattr(sys, "ps1") else np.inf
        is_first = clock.monotonic() - _interrupted >= pause
        if not isinstance(cause, KeyboardInterrupt) or not is_first:
            raise
        if not job.wait(10 if job.progress()[0] else 0.2):
            raise
        _interrupted = clock.monotonic()
    return job.result()


def _show(part, text):
    """Shows progress in a line on standard error."""
    print(f"\r{part:4.0%} {text:50}", end="\r", file=sys.stderr, flush=True)


def _warn(texts, level):
    """Warns, with numbers of places that count from 0."""
    lower = lambda match: f"{match[1]}{int(match[2]) - 1}"
    for text in texts:
        text = text.replace("--materials", "albedo='materials'")
        text = re.sub(r"^points: (.* the first )in line ", r"\1", text)
        text = re.sub(r"( the first (?:the back of )?)(\d+)$", lower, text)
        warnings.warn(text, stacklevel=level + 1)


class Scene:
    """A scene of matt, grey surfaces under a sky.

    mesh
        The path of a Wavefront OBJ, also .gz or .zst; or `(vertices, faces)`:
        (n, 3), and whole numbers (m, 3) or polygons, lists of any length; or
        an object with `vertices` and `faces`, as of trimesh, or with `points`
        and `faces`, as of pyvista. Arrays are copied.
    albedo
        A number from 0 to 1; an array of them, (m,), one a face; a dictionary
        by material, group or object, with None for all others; or "materials"
        for those of the file. As in `pt`, it is 1 if it is not given.
    sky
        "uniform", "overcast", or "sphere", which is uniform below the horizon
        as well; each gives 1 to a horizontal surface in the open.
    ground
        The albedo of an endless ground below the scene; None for no ground.
    zenith
        The direction to the middle of the sky.

    What is wrong is a ValueError, IndexError or OSError, which names it.
    """

    def __init__(self, mesh, albedo=None, sky="uniform", ground=None,
                 zenith=(0, 0, 1)):
        is_file, each = isinstance(mesh, (str, os.PathLike)), None
        words = [os.fspath(mesh)] if is_file else []
        mesh = None if is_file else (*_arrays.mesh(mesh), None)
        words += _words(sky=sky, ground=ground, zenith=zenith)
        if isinstance(albedo, Mapping):
            for name, number in albedo.items():
                name = "" if name is None else f"{name}="
                words.append(f"--albedo={name}{_text(number)}")
        elif np.ndim(albedo):
            each = _arrays.numbers("albedo", albedo, (None,))
        else:
            is_name = isinstance(albedo, str) and albedo == "materials"
            words += ["--materials"] if is_name else _words(albedo=albedo)
        digest = _arrays.sha256(*(mesh or ())[:3], each)
        self._open(words, mesh, each, digest)

    def _open(self, *state):
        self._words, mesh, self._each, self._digest = state
        self._is_array = mesh is not None
        self._core, odd = _call(_core.Scene.open, *state)
        _warn(odd, 3)

    def __getstate__(self):
        mesh = self._core.arrays() if self._is_array else None
        return self._words, mesh, self._each, self._digest

    def __setstate__(self, state):
        self._open(*state)

    def irradiance(self, points, normals, progress=None, **limits):
        """The irradiance at points, (n, 3), on the side of their normals,
        (n, 3) or one for all, of any length but 0.

        Limits, the first of which to be reached ends the run:
        samples
            How many a value, 1024 if there is no limit; or a part of them,
            slice(a, b), with their number `of`. Parts can be added.
        time
            Seconds.
        error
            The standard error to reach: the root mean square over all values,
            or with norm="max" the worst; "1%" is relative to each value.
        Besides, `seed`; `method`, "auto", "reference", "sobol" or "gather";
        and `threads`, on which no value depends. `progress` is True, or a
        function of the part that is done and a text.
        """
        return self._run("irradiance", dict(points=points, normals=normals),
                         limits, progress)

    def face_irradiance(self, side="front", progress=None, **limits):
        """The irradiance of each face on its "front" or "back", (m,), or on
        "both", (m, 2). Limits as for `irradiance`."""
        return self._run("face_irradiance", dict(side=side), limits, progress)

    def vertex_irradiance(self, progress=None, **limits):
        """The irradiance at each vertex, with the mean normal of the faces
        around it, (n,). Limits as for `irradiance`."""
        return self._run("vertex_irradiance", {}, limits, progress)

    def render(self, position=None, target=None, up=None, fov=70,
               size=(320, 240), view=None, background=None, exposure=None,
               progress=None, **limits):
        """The radiance through each pixel of a camera, (height, width).

        The camera stands at `position` and looks at `target`, `fov` degrees
        high; or it stands outside, on the side `view`: "front", "back",
        "left", "right", "top" or "iso", then degrees to turn and to raise it,
        as in "front,20,10". `background` is a radiance in place of the sky's;
        `exposure` brightens pictures by stops, or "auto". Limits as for
        `irradiance`, but 64 samples if there is no limit.
        """
        camera = dict(position=position, target=target, up=up, fov=fov,
                      size=size, view=view, background=background,
                      exposure=exposure)
        return self._run("render", camera, limits, progress)

    def steps(self, quantity, *places, every=0.5, **options):
        """Iterates over partial results of the method `quantity`, one in
        `every` seconds at most; the last is whole. `places` are points and
        normals, or the side; `options` those of the method."""
        method = inspect.signature(getattr(self, quantity))
        options = method.bind(*places, **options).arguments
        options.pop("progress", None)
        limits = options.pop("limits", {})
        make, job = self._begin(quantity, options, limits)
        due = clock.monotonic() + every
        try:
            while not job.wait(0.02):
                if partial := job.partial(clock.monotonic() > due):
                    yield make(partial)
                    due = clock.monotonic() + every
            yield make(_call(job.result))
        finally:
            job.cancel()
            _warn(job.warnings(), 2)

    def _begin(self, quantity, options, limits):
        """Begins a run; returns how to make our results from its own, too."""
        for name in limits.keys() - set(_LIMITS):
            raise TypeError(f"{quantity}() has no argument {name!r}")
        is_open = not {"samples", "time", "error"} & limits.keys()
        limits, points, shape = _limits(**limits), None, (-1,)
        if quantity == "irradiance":
            points = _arrays.pairs("points", options["points"], "normals",
                                   options["normals"])
            points, words = (*points, _arrays.sha256(*points)), ["--points=points"]
        elif quantity == "face_irradiance":
            side = options.get("side", "front")
            words = _words(faces=side)
            shape = (-1, 2) if side == "both" else shape
        elif quantity == "vertex_irradiance":
            words = ["--vertices"]
        else:
            size = tuple(options.pop("size", (320, 240)))
            words = _words(resolution="x".join(map(_text, size)), **options)
            shape = tuple(map(int, size[::-1]))
            words += ["--spp=64"] if is_open else []
        words = [*self._words, *words, *limits]
        make = lambda core: Result(self, shape, words, points, core)
        return make, _call(self._core.start, words, points)

    def _run(self, quantity, options, limits, progress):
        make, job = self._begin(quantity, options, limits)
        progress = _show if progress is True else progress
        try:
            return make(_call(_wait, job, progress))
        finally:
            _warn(job.warnings(), 3)

    def intersects_first(self, ray_origins, ray_directions):
        """The face that each ray meets first, from 0, or -1: (n,). Directions
        have any length but 0. The ground is no face."""
        return self._hits(ray_origins, ray_directions)[0]

    def intersects_any(self, ray_origins, ray_directions):
        """Whether each ray meets a face: (n,)."""
        return self.intersects_first(ray_origins, ray_directions) >= 0

    def intersects_location(self, ray_origins, ray_directions,
                            multiple_hits=False):
        """Places of first hits, (k, 3), and the numbers of their rays and of
        their faces, (k,). No other hits are found."""
        if multiple_hits:
            raise ValueError("multiple_hits = True: only first hits are found")
        faces, places = self._hits(ray_origins, ray_directions)
        rays = np.flatnonzero(faces >= 0)
        return places[rays], rays, faces[rays]

    def _hits(self, origins, directions):
        rays = _arrays.pairs("ray_origins", origins,
                             "ray_directions", directions)
        return _call(self._core.hits, self._words, *rays)
