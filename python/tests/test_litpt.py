# The package, as a user of numpy meets it.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
import csv
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pytest

import litpt
from conftest import ROOM

UP = (0, 0, 1)
METHODS = ["reference", "sobol", "gather", "auto"]


def same(a, b):
    """Whether two results have the same bits."""
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True)
               for name in ["value", "stderr", "samples"])


def table(path):
    """Values and errors of a table of pt, which are in single precision."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return np.array([[row["value"], row["stderr"]] for row in rows], np.float32)


def pfm(path):
    """The pixels of an image in single precision."""
    data = path.read_bytes().split(b"\n", 3)
    width, height = map(int, data[1].split())
    return np.frombuffer(data[3], "<f4").reshape(height, width)[::-1]


# ---- the bits of pt


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("threads", [1, 2])
def test_points_have_the_bits_of_pt(pt, points, method, threads):
    room = litpt.Scene(ROOM, albedo="materials", sky="overcast", ground=0.2)
    ours = room.irradiance(points, UP, samples=64, method=method, threads=threads)
    text = "\n".join(" ".join(map(repr, map(float, p))) + " 0 0 1" for p in points)
    folder = pt("pt -h").joinpath("grid.txt")
    folder.write_text(text)
    pt(f"pt {ROOM} --points grid.txt --materials --sky overcast --ground 0.2 "
       f"-n 64 --integrator {method} -o a.csv")
    theirs = table(folder.parent / "a.csv")
    assert np.array_equal(np.float32([ours.value, ours.stderr]).T, theirs)
    assert ours.value.dtype == np.float64 and ours.samples.dtype == np.int64


def test_sun_and_glass_are_those_of_the_command(pt):
    glazed = ROOM.parent / "glazed.obj"
    light = dict(sky="cie:12", sun=(265, 20), direct=4)
    room = litpt.Scene(glazed, albedo="materials", glass={"pane": 0.88},
                       transmit={"ceiling": (0.2, 0.3)}, **light)
    ours = room.face_irradiance("both", samples=64)
    folder = pt(ours.command)
    theirs = table(folder / "values.csv")
    assert np.array_equal(np.float32(ours.value.ravel()), theirs[:, 0], equal_nan=True)
    closed = litpt.Scene(glazed, albedo="materials", **light)
    assert np.nansum(closed.face_irradiance(samples=64).value) == 0
    with pytest.raises(ValueError, match="window"):
        litpt.Scene(glazed, glass={"window": 0.5}).face_irradiance(samples=1)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("method", METHODS)
def test_the_command_gives_the_same_bits(pt, method, threads):
    room = litpt.Scene(ROOM, albedo={None: 0.3, "walls": 0}, zenith=(0, 0.5, 1),
                       sky="cie:12", sun=(180, 40), ground_glow=0.2)
    limits = dict(samples=32, method=method, seed=7, threads=threads)
    both = room.face_irradiance("both", **limits)
    folder = pt(both.command)
    theirs = table(folder / "values.csv")
    assert both.value.shape == (len(theirs) // 2, 2)
    assert np.array_equal(np.float32(both.value.ravel()), theirs[:, 0], equal_nan=True)
    image = room.render(view="front,20,10", size=(40, 30), **limits)
    pt(image.command.replace(".exr", ".pfm"))
    assert np.array_equal(np.float32(image.value), pfm(folder / "image.pfm"))
    image.save(folder / "ours.png")
    pt(image.command + " -o image.png")
    assert (folder / "ours.png").read_bytes() == (folder / "image.png").read_bytes()


def test_an_error_stops_a_run_where_pt_stops(pt):
    room = litpt.Scene(ROOM, albedo=0.6)
    ours = room.vertex_irradiance(error=0.01, norm="max")
    assert ours.stopped == "error" and (ours.stderr <= 0.01).all()
    theirs = table(pt(ours.command) / "values.csv")
    assert np.array_equal(np.float32(ours.value), theirs[:, 0], equal_nan=True)


def test_only_a_line_that_gives_the_same_bits_is_a_command(box, points):
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    assert room.irradiance(points, UP, samples=16).command is None
    assert room.face_irradiance(time=0.1, method="sobol").command is None
    assert litpt.Scene(box).face_irradiance(samples=16).command is None
    each = litpt.Scene(ROOM, albedo=np.full(9, 0.5))
    assert each.face_irradiance(samples=16).command is None


# ---- arrays


def test_a_mesh_of_arrays_is_that_of_a_file(tmp_path, box):
    vertices, quads = box
    text = "".join("v " + " ".join(map(repr, map(float, v))) + "\n" for v in vertices)
    text += "".join("f " + " ".join(str(i + 1) for i in q) + "\n" for q in quads)
    (tmp_path / "box.obj").write_text(text)
    file = litpt.Scene(tmp_path / "box.obj", albedo=0.5)
    whole = file.face_irradiance(samples=64)
    assert same(litpt.Scene(box, albedo=0.5).face_irradiance(samples=64), whole)
    each = litpt.Scene(tmp_path / "box.obj", albedo=[0.5] * 5)
    assert same(each.face_irradiance(samples=64), whole)


def variants(array, kinds):
    """The same numbers in other layouts and types."""
    array = np.asarray(array)
    wide = np.zeros((2 * len(array), 5), array.dtype)
    wide[::2, 1:1 + array.shape[1]] = array
    yield wide[::2, 1:1 + array.shape[1]]
    yield np.asfortranarray(array)
    yield array[::-1].copy()[::-1]
    yield array.tolist()
    frozen = array.copy()
    frozen.flags.writeable = False
    yield frozen
    raw = np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype)
    raw = raw.reshape(array.shape)
    raw[...] = array
    yield raw
    yield array.astype(array.dtype.newbyteorder())
    for kind in kinds:
        yield array.astype(kind)


def test_arrays_of_any_layout_and_type_have_the_same_bits(box):
    vertices, quads = box
    points, normals = np.array([[1, 1, 1], [2, 2, 3]]), np.array([[0, 0, 1], [1, 0, 0]])
    expected = litpt.Scene(box, albedo=0.5).irradiance(points, normals, samples=32)
    integers = ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]
    for v in variants(vertices, ["f4", "f2", "i4", "u8"]):
        scene = litpt.Scene((v, quads), albedo=0.5)
        assert same(scene.irradiance(points, normals, samples=32), expected)
    for q in variants(quads, integers):
        scene = litpt.Scene((vertices, q), albedo=0.5)
        assert same(scene.irradiance(points, normals, samples=32), expected)
    scene = litpt.Scene(box, albedo=0.5)
    for p in variants(points.astype(float), ["f4", "i2"]):
        assert same(scene.irradiance(p, normals, samples=32), expected)
    for n in variants(normals * 1e-3, ["f8"]):
        assert same(scene.irradiance(points, n, samples=32), expected)


def test_arrays_are_copied(box):
    vertices, quads = box
    scene = litpt.Scene((vertices, quads), albedo=0.5)
    vertices[:], quads[:] = 7, 0
    points = np.array([[1.0, 1, 1]])
    assert 0 < scene.irradiance(points, UP, samples=32).value[0] < 1


def test_arrays_are_copied_for_a_pickle_too(box, points):
    """What is saved after a pickle has the places of the run."""
    albedos, places = np.full(5, 0.5), points.copy()
    scene = litpt.Scene(box, albedo=albedos)
    result = scene.irradiance(places, UP, samples=32)
    albedos[:], places[:] = 0, 1
    again = pickle.loads(pickle.dumps(result))
    assert same(again, result) and np.array_equal(again._points[0], points)
    assert same(again._scene.irradiance(points, UP, samples=32), result)


def test_a_result_is_not_mixed_with_another_scene(tmp_path):
    """The file of a scene has changed, or is gone, when a result is unpickled."""
    path = tmp_path / "a.obj"
    path.write_text(ROOM.read_text().replace("mtllib", "#"))
    result = litpt.Scene(path).face_irradiance(samples=16)
    saved = pickle.dumps(result)
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(ValueError, match="no longer that of the result"):
        pickle.loads(saved).save(tmp_path / "a.csv")
    path.unlink()
    assert same(pickle.loads(saved), result)
    with pytest.raises(FileNotFoundError):
        pickle.loads(saved).save(tmp_path / "a.csv")


def test_polygons_of_different_sizes():
    outline = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0], [0, 4, 0], [0, 0, 1], [4, 0, 1]]
    scene = litpt.Scene((outline, [[0, 1, 2, 3, 4], [0, 1, 6, 5]]), albedo=0)
    down = [(3.5, 3, 5), (2, 3, 5), (2, 0.5, 5)]
    faces = scene.intersects_first(down, np.tile([0, 0, -1], (3, 1)))
    assert faces.tolist() == [0, -1, 0]
    assert scene.intersects_first([[2, 5, 0.5]], [[0, -1, 0]]).tolist() == [1]
    again = pickle.loads(pickle.dumps(scene))
    assert same(again.face_irradiance(samples=8), scene.face_irradiance(samples=8))


def test_objects_of_other_libraries(box):
    vertices, quads = box
    flat = np.insert(quads, 0, 4, axis=1).ravel()
    meshes = [types.SimpleNamespace(points=vertices, faces=flat, n_strips=0),
              types.SimpleNamespace(vertices=vertices, faces=quads)]
    meshes.append(types.SimpleNamespace(to_mesh=lambda: meshes[1]))
    expected = litpt.Scene(box, albedo=0.5).face_irradiance(samples=16)
    for mesh in meshes:
        assert same(litpt.Scene(mesh, albedo=0.5).face_irradiance(samples=16), expected)


def test_a_list_of_albedos_is_by_face(box):
    vertices, quads = box
    dark = litpt.Scene(box, albedo=[0.9, 0, 0, 0, 0])
    light = dark.face_irradiance("both", samples=4096)
    black = litpt.Scene(box, albedo=0).face_irradiance("both", samples=4096)
    more = light.value - black.value - 5 * np.hypot(light.stderr, black.stderr)
    assert abs(light.value[0] - black.value[0]).max() < 0.1 < black.value[0].max()
    assert (more[1:].max(axis=1) > 0).all()  # each wall sees a bright floor
    many = litpt.Scene(box, albedo=np.linspace(0, 1, 5))
    assert many.face_irradiance(samples=16).value.shape == (5,)


# ---- results


def test_values_and_errors_of_a_closed_form():
    """A point below a square of side 2 at the height 1: four corners of
    (X / sqrt(1 + X^2) atan(Y / sqrt(1 + X^2)) + ...) / (2 pi) with X = Y = 1."""
    roof = [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
    scene = litpt.Scene((roof, [[0, 1, 2, 3]]), albedo=0)
    truth = 1 - 4 / np.pi * np.sqrt(0.5) * np.arctan(np.sqrt(0.5))
    for method in METHODS[:2]:
        result = scene.irradiance([[0, 0, 0]], UP, samples=1 << 14, method=method)
        assert abs(result.value[0] - truth) < 5 * result.stderr[0] < 0.05


def test_parts_add_up_to_the_bits_of_the_whole(points):
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    for kind, places in [("irradiance", (points, UP)), ("render", ())]:
        make = getattr(room, kind)
        more = dict(size=(32, 24)) if kind == "render" else {}
        whole = make(*places, samples=192, method="sobol", **more)
        cuts = [slice(0, 64), slice(64, 128), slice(128, 192)]
        parts = [make(*places, samples=c, of=192, method="sobol", **more) for c in cuts]
        added = sum(pickle.loads(pickle.dumps(parts)))
        assert same(added, whole) and added.command == whole.command
        assert same(parts[2] + parts[0] + parts[1], whole)
        with pytest.raises(ValueError, match="both hold"):
            parts[0] + parts[0]
    other = litpt.Scene(ROOM, albedo=0.6).irradiance(
        points, UP, samples=slice(0, 64), of=192, method="sobol")
    first = room.irradiance(points, UP, samples=slice(64, 192), of=192, method="sobol")
    with pytest.raises(ValueError, match="not of one run"):
        other + first


def test_sums_by_weights_have_the_error_that_repeated_runs_show(points):
    """Twenty-four runs: the sum of squares of their errors, each over what it
    states, lies within the 0.9999 interval of a chi square with as many
    degrees, widened for the six blocks of a stated error (Student)."""
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    weights = np.stack([np.ones(40), np.arange(40.0)])
    means = [room.irradiance(points, UP, samples=512, seed=seed, method=method)
             .weighted_mean(weights) for method in ["sobol", "gather"] for seed in range(12)]
    values = np.array([m.value for m in means]).reshape(2, 12, 2)
    stated = np.array([m.stderr for m in means]).reshape(2, 12, 2)
    ratio = values.var(axis=1, ddof=1) / (stated ** 2).mean(axis=1)
    # The quantiles 1e-4 / 8 and 1 - 1e-4 / 8 of F(11, 12 x 5): four ratios.
    assert (0.0649 < ratio).all() and (ratio < 5.147).all(), ratio
    plain = room.irradiance(points, UP, samples=512)
    assert plain.weighted_mean(np.ones(40)).value == pytest.approx(plain.value.mean(), rel=1e-12)


def test_arithmetic_keeps_errors_or_is_refused(points):
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    result = room.irradiance(points, UP, samples=64)
    lux = 10000 * result
    assert np.array_equal(lux.value, 10000 * result.value)
    assert np.array_equal(lux.stderr, 10000 * result.stderr)
    assert np.array_equal((result / -2).stderr, result.stderr / 2)
    assert np.array_equal((np.arange(40) * result).stderr, np.arange(40) * result.stderr)
    assert f"{result.weighted_mean(np.ones(40)):.3f}" == f"{result.value.mean():.3f}"
    assert np.array_equal(np.asarray(result), result.value)
    assert (result[3].value, lux[3:5].stderr[1]) == (result.value[3], lux.stderr[4])
    for refused in [lambda: result - result, lambda: result * result, lambda: result + 1, lambda: result / result,
                    lambda: result * None, lambda: result + np.zeros(40), lambda: np.sqrt(result)]:
        with pytest.raises(TypeError):
            refused()
    with pytest.raises(ValueError, match="weights"):
        result.weighted_sum(np.ones(3))
    with pytest.raises(ValueError, match="blocks"):
        room.render(size=(8, 6), samples=16).weighted_sum(np.ones((6, 8)))


def test_files_by_extension(tmp_path, points, capfd):
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    image = room.render(size=(32, 24), samples=16)
    for name in ["a.png", "a.exr", "a.pfm", "a.pgm", "a.html", "a.json", "a.litpt"]:
        image.save(tmp_path / name)
        image.save(tmp_path / name)  # in place of the first
        assert (tmp_path / name).stat().st_size > 100
    values = room.irradiance(points, UP, samples=16)
    for name in ["a.csv", "a.ply", "b.json", "b.litpt"]:
        values.save(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 100
    room.vertex_irradiance(samples=16).save(tmp_path / "a.obj")
    assert np.array_equal(table(tmp_path / "a.csv")[:, 0], np.float32(values.value))
    before = (tmp_path / "a.csv").read_bytes()
    again = pickle.loads(pickle.dumps(values))
    again.save(tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_bytes() == before
    assert capfd.readouterr() == ("", "")
    with pytest.raises(ValueError, match="a.tiff"):
        image.save(tmp_path / "a.tiff")
    with pytest.raises(OSError, match="nowhere"):
        image.save(tmp_path / "nowhere/a.png")


def test_images(tmp_path):
    room = litpt.Scene(ROOM, albedo=0.5, ground=0.3)
    image = room.render(position=(1, 1, 1.5), target=(5, 3, 1), size=(40, 30), samples=64)
    assert image.value.shape == image.samples.shape == (30, 40)
    assert image.filtered.shape == image.filtered_stderr.shape == (30, 40)
    assert not np.array_equal(image.filtered, image.value)
    again = pickle.loads(pickle.dumps(image))
    assert same(again, image) and np.array_equal(again.filtered, image.filtered)
    assert image._repr_png_().startswith(b"\x89PNG")
    dark = room.render(size=(8, 6), samples=1)
    assert dark.filtered is None and dark.filtered_stderr is None
    flat = litpt.Scene(QUAD).render(size=(8, 6), samples=8, background=0.25)
    assert flat.value[0, 0] == 0.25


def test_what_a_notebook_shows(points):
    result = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2}).irradiance(points, UP, samples=64)
    shown = result._repr_html_()
    assert f"{result.value[0]:.3f} ± {result.stderr[0]:.3f}" in shown
    assert "stopped by samples" in shown and "40 in all" in shown
    assert "stopped by samples" in repr(result)


def test_xarray(points):
    pytest.importorskip("xarray")
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    data = room.irradiance(points, UP, samples=16).to_xarray()
    assert data.value.dims == ("place",) and "irradiance" in data.attrs["unit"]
    assert room.face_irradiance("both", samples=16).to_xarray().stderr.dims == ("place", "side")
    assert room.render(size=(8, 6), samples=4).to_xarray().value.dims == ("y", "x")


# ---- view factors


def entries(path):
    """The value and the error of each row and column of a matrix of pt."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))[1:]
    return {(row, column): (float(value), float(error)) for row, column, value, error in rows}


def listed(names, columns, values, errors):
    """The same of ours, sparse or not."""
    values, errors = (a.toarray() if hasattr(a, "toarray") else a for a in (values, errors))
    seen = np.argwhere(values > 0)
    return {(names[i], columns[j]): (values[i, j], errors[i, j]) for i, j in seen}


def numbered(result):
    return listed(result.rows, result.columns, result.matrix, result.stderr)


@pytest.mark.parametrize("columns, side", [("faces", "both"), ("faces", "front"), ("materials", "back"), ("groups", "both")])
def test_view_factors_have_the_numbers_of_pt(pt, columns, side):
    room = litpt.Scene(ROOM, albedo="materials", ground=0.2)
    ours = room.view_factors(columns, side=side, samples=256, seed=3)
    theirs = entries(pt(ours.command) / "values.csv")
    assert numbered(ours) == theirs and len(theirs) > 10
    assert ours.columns[-2:] == ["sky", "ground"] and ours.moves is None
    assert abs(ours.matrix.sum(axis=1) - 1).max() < 1e-9
    assert ours.matrix.shape == (len(ours.rows), len(ours.columns))
    assert ours.samples.shape == ((9, 2) if side == "both" else (9,))


def test_files_of_view_factors_have_the_bytes_of_pt(pt, tmp_path):
    ours = litpt.Scene(ROOM, albedo="materials").view_factors(samples=256)
    for one in [ours, ours.closed(), pickle.loads(pickle.dumps(ours.closed()))]:
        for ending in ["csv", "vf", "svf", "json"]:
            one.save(tmp_path / f"ours.{ending}")
            pt(one.command + f" -f -o theirs.{ending}")
            assert (tmp_path / f"ours.{ending}").read_bytes() == (tmp_path / f"theirs.{ending}").read_bytes()
    with pytest.raises(ValueError, match="a.ply: view factors"):
        ours.save(tmp_path / "a.ply")


def test_view_factors_of_points(pt, points):
    room = litpt.Scene(ROOM, albedo="materials")
    ours = room.view_factors("materials", points=points, normals=UP, samples=128)
    text = "\n".join(" ".join(map(repr, map(float, p))) + " 0 0 1" for p in points)
    folder = pt("pt -h")
    (folder / "grid.txt").write_text(text)
    pt(f"pt {ROOM} --materials --points grid.txt --view-factors materials -n 128 -o a.csv")
    assert numbered(ours) == entries(folder / "a.csv")
    assert ours.rows == [str(n) for n in range(1, 41)]


def test_closed_view_factors_are_reciprocal(box):
    """Inside a box, two faces exchange the same, and rows sum to 1."""
    found = litpt.Scene(box, albedo=0.5).view_factors(side="back", samples=1024)
    closed = found.closed()
    dense = closed.matrix.toarray() if hasattr(closed.matrix, "toarray") else closed.matrix
    areas = np.array([12, 8, 8, 6, 6])
    assert abs(dense.sum(axis=1) - 1).max() < 1e-9
    flow = areas[:, None] * dense[:, :5]
    assert abs(flow - flow.T).max() < 1e-9 < abs(dense[:, :5] - dense[:, :5].T).max()
    assert 0 < closed.moves[1] < closed.moves[0] < 6
    again = pickle.loads(pickle.dumps(closed))
    assert again.moves == closed.moves and numbered(again) == numbered(closed)
    assert numbered(closed.closed()) == numbered(closed) != numbered(found)
    # A square sees the back of another, which does not see it
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    awning = litpt.Scene(([*square, *(square + [0, 0, 1])], [[0, 1, 2, 3], [4, 5, 6, 7]]))
    with pytest.warns(UserWarning, match="back of another"):
        awning.view_factors(samples=1024).closed()


def test_view_factors_without_scipy(box, monkeypatch):
    scene = litpt.Scene(box, albedo=0.5)
    sparse = scene.view_factors(samples=64)
    expected = numbered(sparse)
    monkeypatch.setitem(sys.modules, "scipy.sparse", None)
    dense = scene.view_factors(samples=64)
    assert isinstance(dense.matrix, np.ndarray) and numbered(dense) == expected


def test_parts_of_matrices_add_up(points, box):
    scene = litpt.Scene(box, albedo=0.5)
    both = [lambda **some: scene.view_factors(**some),
            lambda **some: scene.daylight_coefficients(points / 2, UP, **some)]
    for make in both:
        parts = [make(samples=slice(a, a + 256), of=512) for a in (256, 0)]
        whole, added = make(samples=512), sum(pickle.loads(pickle.dumps(parts)))
        assert added._entries[2:] == whole._entries[2:]
        for ours, theirs in zip(added._entries[0] + added._entries[1], whole._entries[0] + whole._entries[1]):
            assert np.array_equal(ours, theirs)


def test_rows_without_a_value_are_not_numbers():
    scene = litpt.Scene(QUAD, albedo=0)
    with pytest.warns(UserWarning, match="no value for 1 of 2 points"):
        found = scene.view_factors(points=[[0.5, 0.5, 0], [0.5, 0.5, 1]], normals=[1, 0, 0], samples=64)
    sums = np.asarray(found.matrix.sum(axis=1)).ravel()
    assert np.isnan(sums).tolist() == [True, False] and sums[1] == pytest.approx(1)
    assert (found.samples == 0).tolist() == [True, False]


def test_a_derivative_has_the_numbers_of_pt(pt):
    room = litpt.Scene(ROOM, albedo="materials")
    ours = room.face_irradiance("both", derivative="walls", samples=256)
    with open(pt(ours.command) / "values.csv", newline="") as file:
        theirs = [[row["d_value"], row["d_stderr"]] for row in csv.DictReader(file)]
    theirs = np.array(theirs, np.float32).T.reshape(2, -1, 2)
    for result in [ours, pickle.loads(pickle.dumps(ours))]:
        slope = np.float32([result.derivative.value, result.derivative.stderr])
        assert np.array_equal(slope, theirs, equal_nan=True) and slope.max() > 0
    assert room.face_irradiance(samples=16).derivative is None
    *_, last = room.steps("face_irradiance", derivative="walls", samples=16)
    assert last.derivative.value.shape == last.value.shape


# ---- daylight


def test_a_year_has_the_numbers_of_ptimg(pt, points, sky):
    room, folder = litpt.Scene(ROOM, albedo="materials", ground=0.2), sky.parent
    ours = room.daylight_coefficients(points, UP, samples=1024, seed=5)
    text = "\n".join(" ".join(map(repr, map(float, p))) + " 0 0 1" for p in points)
    (folder / "grid.txt").write_text(text)
    pt(f"pt {ROOM} --points grid.txt --materials --ground 0.2 -n 1024 --seed 5 "
       "--sky-patches 1 -o D.mtx -o D.csv -o D.litpt")
    assert listed(ours.rows, ours.columns, ours.value, ours.stderr) == entries(folder / "D.csv")
    for ending in ["mtx", "csv"]:
        ours.save(folder / f"ours.{ending}")
        assert (folder / f"ours.{ending}").read_bytes() == (folder / f"D.{ending}").read_bytes()
    ours.save(folder / "ours.litpt")
    assert ours.value.shape == ours.stderr.shape == (40, 146)
    light = pickle.loads(pickle.dumps(ours)) @ litpt.read_sky(sky)
    (folder / "hours.txt").write_text(" ".join("01"[h % 24 in (11, 12)] for h in range(96)))
    for state, hours, mask in [("D", "8..18", None), ("ours", "hours.txt", np.isin(np.arange(96) % 24, [11, 12]))]:
        pt(f"ptimg daylight {state}.litpt sky.smx --enough 200 --part 0.4 --useful 50..500 "
           f"--hours {hours} -f -o year.csv --illuminance lux.csv")
        year = np.loadtxt(folder / "year.csv", delimiter=",", skiprows=1)
        da, udi = light.autonomy(200, hours=mask), light.useful(50, 500, hours=mask)
        assert np.array_equal(np.column_stack([da.value, da.low, da.high]), year[:, 1:4])
        assert np.array_equal(np.column_stack([udi.value, udi.low, udi.high]), year[:, 4:])
        assert da.value.min() < da.value.max() and (da.low < da.high).any()
        lux = np.loadtxt(folder / "lux.csv", delimiter=",", skiprows=1)
        sensor, step = lux[:, 0].astype(int) - 1, lux[:, 1].astype(int)
        assert abs(light.value[sensor, step] - lux[:, 2]).max() < 5.1e-5
        assert abs(light.stderr[sensor, step] - lux[:, 3]).max() < 5.1e-5
    sda = light.sda(200, 0.4)
    passed = (light.autonomy(200).value >= 0.4).mean()
    assert sda.low <= sda.value == passed <= sda.high and sda.value.shape == ()
    assert light.value.shape == (40, 96) and light.value[:, :6].max() == 0


def test_coefficients_sum_to_the_irradiance_of_a_uniform_sky(points):
    """A radiance of 1 / pi of all patches, but not of the ground, is that sky."""
    room = litpt.Scene(ROOM, albedo="materials")
    found = room.daylight_coefficients(points, UP, samples=2048)
    plain = room.irradiance(points, UP, samples=2048, seed=1)
    apart = found.value[:, 1:].sum(axis=1) / np.pi - plain.value
    errors = np.hypot(np.linalg.norm(found.stderr[:, 1:], axis=1) / np.pi, plain.stderr)
    assert (abs(apart) < 5 * errors).all() and errors.max() < 0.02


def test_sensors_without_a_value_are_not_numbers(sky):
    scene = litpt.Scene(QUAD, albedo=0)
    with pytest.warns(UserWarning, match="no value for 1 of 2 points"):
        found = scene.daylight_coefficients([[0.5, 0.5, 0], [0.5, 0.5, 1]], [1, 0, 0])
    light = found @ litpt.read_sky(sky)
    for numbers in [found.value, found.stderr, light.value, light.stderr]:
        assert np.isnan(numbers).tolist() == [[True] * len(numbers[0]), [False] * len(numbers[0])]
    assert np.isnan(light.autonomy().value).tolist() == [True, False]
    assert light.sda(1, 0.1).value == 1  # of the sensors that have one


def refused_sky(tmp_path, **head):
    """Reads a sky matrix with these entries of its header."""
    head = dict(NROWS=2, NCOLS=24, NCOMP=3, FORMAT="ascii") | head
    text = "#?RADIANCE\n" + "".join(f"{a}={b}\n" for a, b in head.items()) + "\n"
    path = tmp_path / "a.smx"
    path.write_text(text + "1 " * 144)
    return litpt.read_sky(path)


def test_faults_of_a_year(tmp_path, sky, points):
    with pytest.raises(FileNotFoundError, match="nowhere.smx"):
        litpt.read_sky("nowhere.smx")
    with pytest.raises(ValueError, match="a.smx: its FORMAT is 32-bit"):
        refused_sky(tmp_path, FORMAT="32-bit")
    small, whole = refused_sky(tmp_path), litpt.read_sky(sky)
    assert (small.patches, small.steps, whole.patches, whole.steps) == (2, 24, 146, 96)
    found = litpt.Scene(QUAD).daylight_coefficients(points, UP, samples=32)
    few = litpt.Scene(QUAD).daylight_coefficients(points, UP, samples=8)
    light = found @ whole
    with pytest.raises(TypeError):
        found @ found.value.T
    for text, fault in [
            ("the sky has 2 patches, and the coefficients have 146", lambda: found @ small),
            ("replicates of the coefficients are too few", lambda: (few @ whole).autonomy()),
            ("hours: expected shape", lambda: light.sda(hours=[True] * 95)),
            ("hours: holds int64, not bool", lambda: light.sda(hours=[1] * 96)),
            ("hours: no step counts", lambda: light.sda(hours=[False] * 96)),
            ("enough.* nan", lambda: light.sda(np.nan)),
            ("least = 5.0: more than most = 4", lambda: light.useful(5, 4))]:
        with pytest.raises(ValueError, match=text):
            fault()


# ---- rays


def test_rays():
    scene = litpt.Scene(ROOM, ground=0.2)
    rng = np.random.default_rng(2)
    origins = rng.uniform([0.1, 0.1, 0.1], [5.9, 3.9, 2.9], (5000, 3))
    directions = rng.normal(size=(5000, 3))
    faces = scene.intersects_first(origins, directions)
    places, rays, hit = scene.intersects_location(origins, directions, multiple_hits=False)
    assert np.array_equal(faces[rays], hit) and (hit >= 0).all()
    assert np.array_equal(np.flatnonzero(faces >= 0), rays)
    assert np.array_equal(scene.intersects_any(origins, directions), faces >= 0)
    along = places - origins[rays]
    sines = np.linalg.norm(np.cross(along, directions[rays]), axis=1)
    sines /= np.linalg.norm(along, axis=1) * np.linalg.norm(directions[rays], axis=1)
    assert sines.max() < 1e-9
    assert np.array_equal(scene.intersects_first(origins, 1e200 * directions), faces)
    down = scene.intersects_first([[100, 100, 5]], [[0, 0, -1]])
    assert down.tolist() == [-1]  # the ground is no face
    assert scene.intersects_first(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)
    with pytest.raises(ValueError, match="multiple_hits"):
        scene.intersects_location(origins, directions, multiple_hits=True)


# ---- runs


def test_progress_and_steps(points):
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    told = []
    room.irradiance(points, UP, time=0.6, method="sobol",
                    progress=lambda part, text: told.append((part, text)))
    parts = [part for part, _ in told]
    assert parts == sorted(parts) and parts[-1] > 0.5 and "samples" in told[-1][1]
    before = 0
    for step in room.steps("irradiance", points, UP, time=0.8, every=0.1, method="sobol"):
        assert step.samples.min() >= before
        before = step.samples.min()
    assert step.stopped == "time"
    limits = dict(samples=4096, method="reference")
    *_, last = room.steps("face_irradiance", every=0.05, **limits)
    assert same(last, room.face_irradiance(**limits))
    assert room.render(size=(8, 6), seed=3).samples.min() == 64
    for kind, wrong in [(TypeError, dict(sampels=3)), (TypeError, dict(fov=3))]:
        with pytest.raises(kind):
            next(room.steps("vertex_irradiance", **wrong))
    with pytest.raises(TypeError, match="normals"):
        next(room.steps("irradiance", points))
    with pytest.raises(ZeroDivisionError):
        room.irradiance(points, UP, time=60, progress=lambda *_: 1 / 0)
    alone()


def alone():
    """Waits until no thread of a run is left; ten seconds at most."""
    def names():
        for task in os.listdir("/proc/self/task"):
            try:
                with open(f"/proc/self/task/{task}/comm") as file:
                    yield file.read()
            except (FileNotFoundError, ProcessLookupError):
                pass
    end = time.monotonic() + 10
    while any("litpt" in name for name in names()):
        assert time.monotonic() < end, list(names())
        time.sleep(0.01)


INTERRUPTED = """
import litpt, os, signal, sys, threading, time
import numpy as np
room = litpt.Scene(sys.argv[1], albedo="materials")
points = np.random.default_rng(1).uniform([.3, .3, .85], [5.7, 3.7, .85], (500, 3))
def press(*times):
    def go():
        for t in times:
            time.sleep(t)
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)
    threading.Thread(target=go, daemon=True).start()
sent = []
"""


def interrupted(script):
    """What a script prints in a process of its own."""
    words = [sys.executable, "-c", INTERRUPTED + script, str(ROOM)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert not done.stderr, done.stderr
    return done.stdout.split()


def test_an_interrupt_gives_what_was_sampled():
    script = """
press(1)
result = room.irradiance(points, [0, 0, 1], samples=1 << 40, method="reference")
late = time.monotonic() - sent[0]
print(result.stopped, result.samples.max() > 0, late)
"""
    stopped, has, late = interrupted(script)
    assert (stopped, has) == ("interrupt", "True")
    assert float(late) < 0.3 * float(os.environ.get("SLOW", 1))


def test_a_second_interrupt_ends_a_loop_of_runs():
    script = """
press(1, 1)
n = 0
try:
    while True:
        room.irradiance(points, [0, 0, 1], time=0.3, method="sobol")
        n += 1
except KeyboardInterrupt:
    print(n, time.monotonic() - sent[-1], len(sent))
"""
    n, late, count = interrupted(script)
    assert 3 < int(n) and float(late) < 0.5 and count == "2"


def test_an_interrupt_without_samples_is_raised():
    script = """
n = 400000
corners = np.random.default_rng(2).random((n, 3, 3)).reshape(-1, 3)
scene = litpt.Scene((corners, np.arange(3 * n).reshape(n, 3)))
press(0.1)
try:
    scene.irradiance(points, [0, 0, 1], samples=1 << 20, method="gather")
    print("whole")
except KeyboardInterrupt:
    print(time.monotonic() - sent[-1])
"""
    [late] = interrupted(script)
    assert float(late) < 0.5


def test_nothing_is_printed_and_no_thread_is_left(capfd, points):
    room = litpt.Scene(ROOM, albedo="materials")
    room.irradiance(points, UP, samples=64)
    room.render(size=(8, 6), samples=4)
    room.intersects_first(points, points)
    alone()
    assert capfd.readouterr() == ("", "")


def test_scenes_that_are_dropped_leave_no_memory():
    rss = lambda: int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    rng = np.random.default_rng(3)
    corners = rng.random((6000, 3))
    def many(count):
        for _ in range(count):
            scene = litpt.Scene((corners, np.arange(6000).reshape(-1, 3)))
            scene.irradiance([[0.5, 0.5, 2]], UP, samples=1)
    many(100)
    before = rss()
    many(400)
    # A tenth of a mesh of 216 kB kept of each scene would be more.
    assert rss() - before < 400 * 0.1 * 216e3


def work(job):
    scene, seed = job
    return scene.irradiance([[1, 1, 1]], UP, samples=64, seed=seed)


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_processes(start, box):
    scene = litpt.Scene(box, albedo=0.5)
    own = [work((scene, seed)) for seed in range(3)]
    with multiprocessing.get_context(start).Pool(2) as pool:
        theirs = pool.map(work, [(scene, seed) for seed in range(3)])
    assert all(same(a, b) for a, b in zip(own, theirs))


def test_threads_of_python_share_a_scene(points):
    room = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    expected, found = room.irradiance(points, UP, samples=64), []
    run = lambda: found.append(litpt.Scene.irradiance(shared, points, UP, samples=64))
    shared = litpt.Scene(ROOM, albedo={None: 0.5, "floor": 0.2})
    threads = [threading.Thread(target=run) for _ in range(4)]
    [thread.start() for thread in threads], [thread.join() for thread in threads]
    assert len(found) == 4 and all(same(one, expected) for one in found)


def test_the_command_pt(pt):
    help_ = pt("pt --help")
    words = [sys.executable, "-c", "import litpt; litpt.pt()"]
    done = subprocess.run([*words, "--version"], capture_output=True, text=True)
    assert done.stdout == f"pt {litpt.__version__}\n" and done.returncode == 0
    assert subprocess.run([*words, "-n", "x"], capture_output=True).returncode == 2


# ---- faults

QUAD = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
ROWS = np.array([[0.1, 0.2, 1.0], [0.3, 0.4, 1.0]])


@pytest.mark.parametrize("kind, text, fault", [
    (FileNotFoundError, "nowhere.obj", lambda: litpt.Scene("nowhere.obj")),
    (ValueError, "side = None", lambda: litpt.Scene(QUAD).face_irradiance(side=None)),
    (ValueError, "albedo: has no number", lambda: litpt.Scene(QUAD, albedo=[])),
    (ValueError, "albedo = materials", lambda: litpt.Scene(QUAD, albedo="materials")),
    (ValueError, "faces: has masked", lambda: litpt.Scene((QUAD[0], np.ma.masked_equal(QUAD[1], 3)))),
    (ValueError, "normals: has masked", lambda: litpt.Scene(QUAD).irradiance(ROWS, np.ma.masked_equal(UP, 0))),
    (ValueError, r"normals: expected shape \(3,\)", lambda: litpt.Scene(QUAD).irradiance(ROWS, [0, 1])),
    (FileNotFoundError, "./-x.obj", lambda: litpt.Scene("-x.obj")),
    (FileNotFoundError, "./-", lambda: litpt.Scene("-")),
    (ValueError, "progress = 5", lambda: litpt.Scene(QUAD).vertex_irradiance(progress=5)),
    (ValueError, "path = '-'", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=4).save("-")),
    (OSError, "cannot create", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=4).save("/proc/a.csv")),
    (ValueError, "quantity = 'intersects_first'", lambda: next(litpt.Scene(QUAD).steps("intersects_first", ROWS, ROWS))),
    (ValueError, r"faces\[1\]: expected shape", lambda: litpt.Scene((QUAD[0], [[0, 1, 2], 3]))),
    (ValueError, r"faces\[1\]: 0 corners", lambda: litpt.Scene((QUAD[0], [[0, 1, 2], []]))),
    (ValueError, "faces: a face of -1", lambda: litpt.Scene(types.SimpleNamespace(points=QUAD[0], faces=[-1, 0, 1, 2]))),
    (ValueError, "size = 8x6", lambda: litpt.Scene(QUAD).render(size="8x6.5")),
    (ValueError, "their sum is 0", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=64).weighted_mean(np.zeros(4))),
    (ValueError, "weights: has masked", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=64).weighted_mean(np.ma.masked_equal([1., 1, 1, 0], 0))),
    (OSError, "nowhere.obj", lambda: litpt.Scene("nowhere.obj")),
    (ValueError, "mesh: expected", lambda: litpt.Scene(7)),
    (ValueError, "faces: there is none", lambda: litpt.Scene((QUAD[0], []))),
    (ValueError, r"faces\[0\]: 2 corners", lambda: litpt.Scene((QUAD[0], [[0, 1]]))),
    (IndexError, r"faces\[1\] has vertex 4", lambda: litpt.Scene((QUAD[0], [[0, 1, 2], [0, 1, 4]]))),
    (IndexError, r"faces\[0\] has vertex -1", lambda: litpt.Scene((QUAD[0], [[0, 1, -1]]))),
    (IndexError, "faces", lambda: litpt.Scene((QUAD[0], np.array([[0, 1, 2**64 - 1]], "u8")))),
    (ValueError, "faces: holds float64", lambda: litpt.Scene((QUAD[0], [[0, 1, 2.5]]))),
    (ValueError, r"vertices\[1\] = \[ *0. +inf", lambda: litpt.Scene(([[0, 0, 0], [0, np.inf, 0], [1, 0, 0]], [[0, 1, 2]]))),
    (ValueError, r"vertices: expected shape \(n, 3\)", lambda: litpt.Scene((np.zeros((3, 2)), [[0, 1, 2]]))),
    (ValueError, "vertices: holds complex", lambda: litpt.Scene((np.full((3, 3), 1j), [[0, 1, 2]]))),
    (ValueError, "vertices: has masked", lambda: litpt.Scene((np.ma.masked_equal(QUAD[0], 1), QUAD[1]))),
    (ValueError, "albedo = 2", lambda: litpt.Scene(QUAD, albedo=2)),
    (ValueError, r"albedo\[0\] = -0.5", lambda: litpt.Scene(QUAD, albedo=[-0.5])),
    (ValueError, "albedo: 2 of them for 1 faces", lambda: litpt.Scene(QUAD, albedo=[0.5, 0.5])),
    (ValueError, "called roof", lambda: litpt.Scene(ROOM, albedo={"roof": 0.5})),
    (ValueError, "needs the direction to the sun", lambda: litpt.Scene(QUAD, sky="cie:9")),
    (ValueError, "sun = 1,2,3,4", lambda: litpt.Scene(QUAD, sun=(1, 2, 3, 4))),
    (ValueError, "sky = blue", lambda: litpt.Scene(QUAD, sky="blue")),
    (ValueError, "ground = 3", lambda: litpt.Scene(QUAD, ground=3)),
    (ValueError, "zenith = 0,0,0", lambda: litpt.Scene(QUAD, zenith=(0, 0, 0))),
    (ValueError, r"points\[1\] = \[0.3 0.4 nan", lambda: litpt.Scene(QUAD).irradiance(ROWS + [[0, 0, 0], [0, 0, np.nan]], UP)),
    (ValueError, r"normals\[0\] = \[0. 0. 0.\]", lambda: litpt.Scene(QUAD).irradiance(ROWS, (0, 0, 0))),
    (ValueError, "normals: 1, but points: 2", lambda: litpt.Scene(QUAD).irradiance(ROWS, [UP])),
    (ValueError, "side = top", lambda: litpt.Scene(QUAD).face_irradiance("top")),
    (ValueError, "samples = -4", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=-4)),
    (ValueError, "samples = slice", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=slice(0, 9), of=4)),
    (ValueError, "of = 4", lambda: litpt.Scene(QUAD).vertex_irradiance(samples=2, of=4)),
    (ValueError, "error = 0", lambda: litpt.Scene(QUAD).vertex_irradiance(error=0)),
    (ValueError, "error is missing", lambda: litpt.Scene(QUAD).vertex_irradiance(norm="max")),
    (ValueError, "norm = worst", lambda: litpt.Scene(QUAD).vertex_irradiance(error=1, norm="worst")),
    (ValueError, "method = best", lambda: litpt.Scene(QUAD).vertex_irradiance(method="best")),
    (ValueError, "threads = 0", lambda: litpt.Scene(QUAD).vertex_irradiance(threads=0)),
    (ValueError, "time = -1", lambda: litpt.Scene(QUAD).vertex_irradiance(time=-1)),
    (TypeError, "no argument 'sample'", lambda: litpt.Scene(QUAD).vertex_irradiance(sample=1)),
    (ValueError, "fov = 180", lambda: litpt.Scene(QUAD).render(fov=180)),
    (ValueError, "size = 0x4", lambda: litpt.Scene(QUAD).render(size=(0, 4))),
    (ValueError, "size = 8", lambda: litpt.Scene(QUAD).render(size=(8,))),
    (ValueError, "ground = <object", lambda: litpt.Scene(QUAD, ground=object())),
    (ValueError, "position = 0,0", lambda: litpt.Scene(QUAD).render(position=(0, 0))),
    (ValueError, "its own position", lambda: litpt.Scene(QUAD).render(position=(1, 0, 0), target=(1, 0, 0))),
    (ValueError, "view = inside", lambda: litpt.Scene(QUAD).render(view="inside")),
    (ValueError, r"ray_directions\[1\]", lambda: litpt.Scene(QUAD).intersects_any(ROWS, ROWS * [[1], [0]])),
    (ValueError, "columns = walls", lambda: litpt.Scene(QUAD).view_factors("walls")),
    (ValueError, "columns = None", lambda: litpt.Scene(QUAD).view_factors(None)),
    (ValueError, "side = 'back': points", lambda: litpt.Scene(QUAD).view_factors(points=ROWS, normals=UP, side="back")),
    (ValueError, "points: holds object", lambda: litpt.Scene(QUAD).view_factors(normals=UP)),
    (ValueError, "method.* sobol alone", lambda: litpt.Scene(QUAD).view_factors(method="gather")),
    (ValueError, "faces as rows and as columns", lambda: litpt.Scene(QUAD).view_factors("materials", samples=64).closed()),
    (TypeError, "no argument 'column'", lambda: litpt.Scene(QUAD).view_factors(column="faces")),
    (ValueError, "sky_patches 3: expected 1, 2 or 4", lambda: litpt.Scene(QUAD).daylight_coefficients(ROWS, UP, 3)),
    (ValueError, "needs the uniform sky", lambda: litpt.Scene(QUAD, sky="overcast").daylight_coefficients(ROWS, UP)),
    (ValueError, r"called roof \(derivative", lambda: litpt.Scene(ROOM, albedo={None: 0.5}).irradiance(ROWS, UP, derivative="roof")),
    (ValueError, "derivative", lambda: litpt.Scene(ROOM, albedo={None: 0}).irradiance(ROWS, UP, derivative="walls")),
    (TypeError, "no argument 'derivative'", lambda: litpt.Scene(QUAD).render(derivative="walls")),
    (ValueError, "none of the points", lambda: litpt.Scene(QUAD).irradiance([[0.5, 0.5, 0]], (1, 0, 0))),
])
def test_faults_name_what_is_wrong(kind, text, fault):
    with pytest.raises(kind) as told:
        fault()
    assert re.search(text, str(told.value)), told.value
    assert "--" not in str(told.value)


def test_a_path_with_hyphens_is_told_whole():
    with pytest.raises(OSError, match="^.Errno 2. a--spp-b.obj: cannot read"):
        litpt.Scene("a--spp-b.obj")


def test_warnings_are_python_s():
    scene = litpt.Scene(QUAD, albedo=0)
    with pytest.warns(UserWarning, match="no value for 1 of 2 points.* first 0$"):
        result = scene.irradiance([[0.5, 0.5, 0], [0.5, 0.5, 1]], [1, 0, 0], samples=16)
    assert np.isnan(result.value).tolist() == [True, False]
    with pytest.warns(UserWarning, match="albedo='materials'"):
        litpt.Scene(ROOM).face_irradiance(samples=1)
