"""Irradiance in a room with a window, beside that of Mitsuba 3.

Mitsuba gets the same triangles, matt on both sides, under an emitter of
radiance 1 all around, and a large black plate that hides its lower half. Its
irradiance over pi is in litpt's unit. It measures on black squares of a
millimetre at the points, which hide less than 10^-5 of the room. The variant
without a compiler runs on every machine, and the same paths everywhere.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import numpy as np
import pytest

import litpt

mi = pytest.importorskip("mitsuba")

# Passes with seeds of their own, from which the errors are found.
PASSES, SAMPLES = 64, 1024


def room():
    """Vertices, triangles and their albedos: a room of 6 by 4 by 3 metres, a
    window in its wall y = 0, and a cupboard in it."""
    vertices, faces, albedos = [], [], []

    def rectangle(p, u, v, albedo):
        p, u, v = np.array([p, u, v], float)
        first = len(vertices)
        vertices.extend([p, p + u, p + u + v, p + v])
        for corners in ((0, 1, 2), (0, 2, 3)):
            faces.append([first + corner for corner in corners])
            albedos.append(albedo)

    rectangle([0, 0, 0], [6, 0, 0], [0, 4, 0], 0.2)         # floor
    rectangle([0, 0, 3], [6, 0, 0], [0, 4, 0], 0.8)         # ceiling
    rectangle([0, 0, 0], [0, 4, 0], [0, 0, 3], 0.6)         # walls
    rectangle([6, 0, 0], [0, 4, 0], [0, 0, 3], 0.5)
    rectangle([0, 4, 0], [6, 0, 0], [0, 0, 3], 0.7)
    rectangle([0, 0, 0], [6, 0, 0], [0, 0, 1], 0.5)         # around the window
    rectangle([0, 0, 2.5], [6, 0, 0], [0, 0, 0.5], 0.4)
    rectangle([0, 0, 1], [1, 0, 0], [0, 0, 1.5], 0.3)
    rectangle([5, 0, 1], [1, 0, 0], [0, 0, 1.5], 0.35)
    rectangle([0.2, 3, 0.5], [1, 0, 0], [0, 0, 2], 0.45)    # cupboard
    rectangle([1.2, 3, 0.5], [0, 0.8, 0], [0, 0, 2], 0.9)
    rectangle([0.2, 3, 0.5], [1, 0, 0], [0, 0.8, 0], 0.1)
    rectangle([0.2, 3, 2.5], [1, 0, 0], [0, 0.8, 0], 0.1)
    return np.array(vertices), np.array(faces), np.array(albedos)


def points():
    """A hundred points in the plane z = 0.3, below the cupboard too."""
    x, y = np.meshgrid(np.linspace(0.35, 5.65, 10), np.linspace(0.3, 3.7, 10))
    return np.column_stack([x.ravel(), y.ravel(), np.full(100, 0.3)])


def mesh(name, vertices, faces, albedo):
    """A matt mesh of Mitsuba, on both sides."""
    matt = mi.load_dict({"type": "twosided", "bsdf": {
        "type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}})
    properties = mi.Properties()
    properties["bsdf"] = matt
    shape = mi.Mesh(name, len(vertices), len(faces), props=properties)
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = np.ravel(vertices).astype(np.float32)
    parameters["faces"] = np.ravel(faces).astype(np.uint32)
    parameters.update()
    return shape


def by_mitsuba(vertices, faces, albedos, places):
    """The irradiance at places with upward normals, and its standard error."""
    mi.set_variant("scalar_rgb")
    scene = {"type": "scene", "sky": {"type": "constant", "radiance": 1.0}}
    for albedo in np.unique(albedos):
        used, corners = np.unique(faces[albedos == albedo], return_inverse=True)
        name = f"matt{len(scene)}"
        scene[name] = mesh(name, vertices[used], corners.reshape(-1, 3), albedo)
    far = 1e5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    scene["plate"] = mesh("plate", far - [0, 0, 0.01], [[0, 1, 2], [0, 2, 3]], 0.0)
    box = {"type": "box"}
    for number, place in enumerate(places):
        scene[f"place{number}"] = mi.load_dict({
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().translate(place).scale(0.0005),
            "matt": {"type": "diffuse", "reflectance": 0.0},
            "meter": {"type": "irradiancemeter", "film": {
                "type": "hdrfilm", "width": 1, "height": 1, "rfilter": box}}})
    scene = mi.load_dict(scene)
    meters = {f"meter{n:03}": meter for n, meter in enumerate(scene.sensors())}
    assert len(meters) == len(places)
    batch = mi.load_dict({
        "type": "batch", **meters, "sampler": {"type": "independent"},
        "film": {"type": "hdrfilm", "width": len(places), "height": 1,
                 "pixel_format": "luminance", "rfilter": box}})
    # What is left after 200 reflections is below 0.9^200 = 10^-9; ending paths
    # by chance before, with more weight for the others, has no bias
    path = mi.load_dict({"type": "path", "max_depth": 200})
    passes = np.array([
        mi.render(scene, sensor=batch, integrator=path, spp=SAMPLES, seed=seed)
        for seed in range(PASSES)], float).reshape(PASSES, -1) / np.pi
    return passes.mean(axis=0), passes.std(axis=0, ddof=1) / np.sqrt(PASSES)


def test_room_with_a_window():
    """Of a hundred values, one may be off by more than three errors: if all
    are right, 0.3 to 0.4 are expected, as the errors are known from 64 passes,
    and two or more have a chance of 6 % at most; seeds are fixed. The mean of
    all must be within three errors as well."""
    vertices, faces, albedos = room()
    places = points()
    scene = litpt.Scene((vertices, faces), albedo=albedos)
    ours = scene.irradiance(places, [0, 0, 1], error="0.5%", seed=1)
    assert ours.stopped == "error"
    means, errors = by_mitsuba(vertices, faces, albedos, places)
    z = (ours.value - means) / np.hypot(ours.stderr, errors)
    mean = ours.weighted_mean(np.ones(100))
    mean_error = np.sqrt((errors**2).sum()) / 100
    mean_z = (mean.value - means.mean()) / np.hypot(mean.stderr, mean_error)
    print(f"\nlitpt by {ours.method}, {ours.samples.max()} samples, "
          f"{ours.seconds:.1f} s; values {means.min():.4f} to {means.max():.4f}; "
          f"relative errors up to {(ours.stderr / ours.value).max():.4f} and "
          f"{(errors / means).max():.4f}; |z| up to {abs(z).max():.2f}, "
          f"{(abs(z) > 3).sum()} above 3, root mean square "
          f"{np.sqrt((z**2).mean()):.2f}; means {mean} and {means.mean():.6f} ± "
          f"{mean_error:.2g}, z = {mean_z:.2f}")
    # A path has a relative deviation of 2.9 at the median of the points, and
    # 65536 paths one of 1.1 %
    assert np.median(errors / means) < 0.015
    assert (abs(z) <= 3).sum() >= 99
    assert abs(mean_z) <= 3
