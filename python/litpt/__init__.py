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
from ._matrices import (Daylight, DaylightCoefficients, Interval, ViewFactors,
                        read_sky)
from ._results import Estimate, Result, _call

__all__ = ["Daylight", "DaylightCoefficients", "Estimate", "Interval",
           "Result", "Scene", "ViewFactors", "pt", "read_sky"]
__version__ = _core.version


def pt():
    """Runs the command `pt` with the words of this process, and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_core.main(["pt", *sys.argv[1:]]))


def _text(name, value):
    """A value as `pt` reads it."""
    if isinstance(value, (str, bytes, os.PathLike)):
        return os.fsdecode(value).replace(" %", "%")
    if np.ndim(value) == 1:
        return ",".join(_text(name, part) for part in value)
    try:
        number = np.asarray(value)[()]
        is_whole = isinstance(number, np.integer)
        return str(int(number)) if is_whole else repr(float(number))
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {value!r}: not a number") from None


def _words(**options):
    """The options that are given, as words of `pt`."""
    given = [pair for pair in options.items() if pair[1] is not None]
    return [f"--{name.replace('_', '-')}={_text(name, value)}"
            for name, value in given]


def _limits(samples=None, of=None, time=None, error=None, norm=None,
            seed=None, method=None, threads=None, derivative=None):
    part, is_part = None, isinstance(samples, slice)
    is_empty = is_part and of is not None and not (
        (samples.start or 0) < (samples.stop or 0) <= of and not samples.step)
    if is_part != (of is not None) or is_empty:
        raise ValueError(f"samples = {samples}, of = {of}: a part of all "
                         "samples is samples=slice(0, 512), of=2048")
    if is_part:
        part, samples = f"{samples.start or 0}..{samples.stop}", of
    return _words(spp=samples, samples=part, time=time, error=error,
                  error_norm=norm, seed=seed, integrator=method,
                  threads=threads, derivative=derivative)


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
        if progress:
            progress(1.0, job.progress()[1])
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
        "uniform", "overcast", "cie:1" to "cie:16", the types of ISO 15469,
        "perez:E,D", of a clearness and a brightness, "sphere", which is
        uniform below the horizon as well, or "FILE.smx:COLUMN", a column, from
        1, of a sky matrix of gendaymtx, without its ground; each gives 1 to a
        horizontal surface in the open.
    ground
        The albedo of an endless ground below the scene; None for no ground.
    zenith
        The direction to the middle of the sky.
    sun
        The direction to the sun, or its azimuth, from +y towards +x where z is
        up, and its altitude, in degrees; needed by skies that are brighter
        around it.
    ground_glow
        The albedo of a ground in the open that is seen below the horizon where
        nothing else is.
    direct
        The irradiance that the sun adds on a surface that faces it, if the sky
        alone gives 1 to a horizontal one; needs `sun`.
    glass
        A dictionary by material, group or object: the transmittance of a clear
        pane for light that falls on it straight; or "materials" for all that
        are transparent in the file.
    transmit
        A dictionary by material, group or object: the parts of the light that
        a thin sheet reflects and transmits, both diffusely.

    What is wrong is a ValueError, IndexError or OSError, which names it.
    """

    def __init__(self, mesh, albedo=None, sky="uniform", ground=None,
                 zenith=(0, 0, 1), sun=None, ground_glow=None, direct=None,
                 glass=None, transmit=None):
        is_file, each = isinstance(mesh, (str, bytes, os.PathLike)), None
        words = [os.fsdecode(mesh) if is_file else "mesh"]
        if words[0].startswith("-"):
            words = [os.path.join(".", words[0])]
        mesh = None if is_file else (*_arrays.mesh(mesh), None)
        words += _words(sky=sky, ground=ground, zenith=zenith, sun=sun,
                        ground_glow=ground_glow, direct=direct)
        for option, given in ("glass", glass), ("transmit", transmit):
            if isinstance(given, Mapping):
                words += [f"--{option}={name}={_text(option, value)}"
                          for name, value in given.items()]
            else:
                words += _words(**{option: given})
        if isinstance(albedo, Mapping):
            for name, number in albedo.items():
                name = "" if name is None else f"{name}="
                words.append(f"--albedo={name}{_text('albedo', number)}")
        elif np.ndim(albedo):
            each = _arrays.numbers("albedo", albedo, (None,)).copy()
            if not each.size:
                raise ValueError("albedo: has no number")
        elif is_file and isinstance(albedo, str) and albedo == "materials":
            words.append("--materials")
        else:
            words += _words(albedo=albedo)
        digest = _arrays.sha256(*(mesh or ())[:3], each)
        self.__setstate__((words, mesh, each, digest))
        self._core

    def __getattr__(self, name):
        """Opens the scene when it is needed: the file of one that was pickled may
        be gone."""
        if name != "_core" or "_mesh" not in self.__dict__:
            raise AttributeError(name)
        state = self.__getstate__()
        self._core, odd = _call(_core.Scene.open, *state)
        self._is_array = self.__dict__.pop("_mesh") is not None
        _warn(odd, 4)
        return self._core

    def __getstate__(self):
        mesh = self.__dict__.get("_mesh")
        if "_mesh" not in self.__dict__ and self._is_array:
            mesh = self._core.arrays()
        return self._words, mesh, self._each, self._digest

    def __setstate__(self, state):
        self._words, self._mesh, self._each, self._digest = state

    def irradiance(self, points, normals, progress=None, **limits):
        """The irradiance at points, (n, 3), on the side of their normals,
        (n, 3) or one for all, of any length but 0.

        Limits, the first of which to be reached ends the run:
        samples
            How many a value, 1024 if there is no limit; methods with groups of
            samples may round that. Or a part of them, slice(a, b), with their
            number `of`; parts can be added.
        time
            Seconds.
        error
            The standard error to reach: the root mean square over all values,
            or with norm="max" the worst; "1%" is relative to each value.
        Besides, `seed`; `method`, "auto", "reference", "sobol" or "gather";
        and `threads`, on which no value depends. `progress` is True, or a
        function of the part that is done and a text.

        With `derivative`, the name of a material, group or object, the result
        has also the derivative of its values by the albedo of that.
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

    def view_factors(self, columns="faces", *, points=None, normals=None,
                     side="front", progress=None, **limits):
        """View factors, as ViewFactors: of all light that a face would send
        out diffusely, or of all that could arrive at a point, the parts that
        go to each face; or to the faces of each material, object or group, if
        `columns` is "materials", "objects" or "groups"; then to the sky and
        to the ground.

        Rows are faces on the `side` "front", "back" or "both", or `points`
        with `normals`, (n, 3). The sky of the scene must be "uniform". Limits
        as for `irradiance`; an `error` is that of the worst factor of each row.
        """
        places = dict(side=side)
        if points is not None or normals is not None:
            places = dict(points=points, normals=normals)
            if side != "front":
                raise ValueError(f"side = {side!r}: points have no side")
        words = [f"--view-factors={_text('columns', columns)}"]
        options = dict(places, tally=(ViewFactors, words))
        return self._run("view_factors", options, limits, progress)

    def daylight_coefficients(self, points, normals, sky_patches=1,
                              progress=None, **limits):
        """What light from each part of the sky does at points, (n, 3), on the
        side of their normals, (n, 3) or one for all, as DaylightCoefficients.
        The parts are the ground and the patches of Reinhart's sky, 146 with
        `sky_patches` 1, 578 with 2, 2306 with 4. The sky of the scene must be
        "uniform". Limits as for `irradiance`."""
        words = [f"--sky-patches={_text('sky_patches', sky_patches)}"]
        options = dict(points=points, normals=normals,
                       tally=(DaylightCoefficients, words))
        return self._run("daylight_coefficients", options, limits, progress)

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
        normals, or the side; `options` those of the method. An interrupt is
        raised, and ends the run."""
        if quantity not in ("irradiance", "face_irradiance",
                            "vertex_irradiance", "render"):
            raise ValueError(f"quantity = {quantity!r}: no method with steps")
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
        names = set(_LIMITS)
        if not quantity.endswith("irradiance"):
            names.remove("derivative")
        for name in limits.keys() - names:
            raise TypeError(f"{quantity}() has no argument {name!r}")
        is_open = not {"samples", "time", "error"} & limits.keys()
        limits, points, shape = _limits(**limits), None, (-1,)
        kind, tally = options.pop("tally", (Result, []))
        if "points" in options:
            points = _arrays.pairs("points", options["points"], "normals",
                                   options["normals"])
            points = [array.copy() for array in points]
            points = *points, _arrays.sha256(*points)
            words = ["--points=points"]
        elif quantity in ("face_irradiance", "view_factors"):
            side = options.get("side", "front")
            words = [f"--faces={side}"]
            shape = (-1, 2) if side == "both" else shape
        elif quantity == "vertex_irradiance":
            words = ["--vertices"]
        else:
            size = options.pop("size", (320, 240))
            words = _words(resolution=_text("size", size).replace(",", "x"))
            words += _words(**options)
            shape = tuple(int(n) for n in words[0][13:].split("x")[::-1]
                          if n.isdigit())
            words += ["--spp=64"] if is_open else []
        words = [*self._words, *words, *tally, *limits]
        make = lambda core: kind(self, shape, words, points, core)
        return make, _call(self._core.start, words, points)

    def _run(self, quantity, options, limits, progress):
        if not (progress in (None, False, True) or callable(progress)):
            raise ValueError(f"progress = {progress!r}: no function")
        make, job = self._begin(quantity, options, limits)
        shows = progress is True
        try:
            return make(_call(_wait, job, _show if shows else progress))
        finally:
            if shows:
                print("\r" + " " * 56, end="\r", file=sys.stderr, flush=True)
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
