# Tangled from chapters/python.nw; edit there.
# Copyright (C) 2026 litpt contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""From what users have to arrays that the compiled half can read."""
import hashlib

import numpy as np


def numbers(name, values, shape, kinds="fiu", dtype=np.float64):
    """An aligned array of `dtype` in C order; None in `shape` is any size."""
    if np.ma.is_masked(values):
        raise ValueError(f"{name}: has masked values")
    try:
        array = np.asarray(values)
    except ValueError:
        raise ValueError(f"{name}: has rows of different lengths") from None
    if array.dtype.kind not in kinds and array.size:
        wanted = {"fiu": "numbers", "iu": "whole numbers", "b": "bool"}[kinds]
        raise ValueError(f"{name}: holds {array.dtype}, not {wanted}")
    if len(shape) != array.ndim or any(
            n not in (None, m) for n, m in zip(shape, array.shape)):
        wanted = str(shape).replace("None", "n")
        raise ValueError(f"{name}: expected shape {wanted}, not {array.shape}")
    if dtype is np.int64 and array.size and array.max() > np.iinfo(dtype).max:
        raise IndexError(f"{name}: has the number {array.max()}")
    array = np.require(array, dtype, "CA")
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0][0]
        raise ValueError(f"{name}[{at}] = {array[at]}: not finite")
    return array


def pairs(name, values, other, more):
    """As many vectors of two names; one of the second may serve for all."""
    values = numbers(name, values, (None, 3))
    if np.ndim(more) == 1:
        more = np.broadcast_to(numbers(other, more, (3,)), values.shape)
    more = numbers(other, more, (None, 3))
    if len(more) != len(values):
        raise ValueError(f"{other}: {len(more)}, but {name}: {len(values)}")
    if not (there := more.any(axis=1)).all():
        at = there.argmin()
        raise ValueError(f"{other}[{at}] = {more[at]}: has no direction")
    return values, more


def mesh(source):
    """Vertices, the corners of all faces, and their sizes if not all are 3."""
    if hasattr(source, "to_mesh"):
        source = source.to_mesh()
    if isinstance(source, tuple) and len(source) == 2:
        points, polygons = source
    elif hasattr(source, "vertices") and hasattr(source, "faces"):
        points, polygons = source.vertices, source.faces
    elif hasattr(source, "points") and hasattr(source, "faces"):
        points, polygons = source.points, counted(source)
    else:
        raise ValueError(
            "mesh: expected a path, (vertices, faces), or an object with "
            f"both, not {type(source)}; of pyvista pass extract_surface(), "
            "of meshio (mesh.points, mesh.cells_dict['triangle'])")
    return numbers("vertices", points, (None, 3)), *faces(polygons)


def counted(source):
    """The polygons of pyvista, before each of which its size stands."""
    if getattr(source, "n_strips", 0):
        raise ValueError("mesh: has strips; pass mesh.triangulate()")
    flat, at, polygons = np.asarray(source.faces), 0, []
    if flat.ndim == 2:
        return flat
    while at < len(flat):
        if flat[at] < 1:
            raise ValueError(f"faces: a face of {flat[at]} corners")
        polygons.append(flat[at + 1:at + 1 + flat[at]])
        at += 1 + flat[at]
    return polygons


def faces(polygons):
    """The corners of all faces, and their sizes if not all are 3."""
    try:
        is_even = np.asarray(polygons).dtype.kind != "O"
    except ValueError:
        is_even = False
    if is_even and not np.size(polygons):
        raise ValueError("faces: there is none")
    if is_even:
        corners = numbers("faces", polygons, (None, None), "iu", np.int64)
        sizes, corners = np.full(len(corners), corners.shape[1]), corners.ravel()
    else:
        each = [numbers(f"faces[{i}]", face, (None,), "iu", np.int64)
                for i, face in enumerate(polygons)]
        sizes, corners = np.array(list(map(len, each))), np.concatenate(each)
    if sizes.min() < 3:
        at = sizes.argmin()
        raise ValueError(f"faces[{at}]: {sizes[at]} corners; it needs three")
    return corners, None if (sizes == 3).all() else sizes


def sha256(*arrays):
    """A hash of arrays, in hexadecimal digits; none if there is none."""
    given = [array for array in arrays if array is not None]
    digest = hashlib.sha256(str([array.shape for array in given]).encode())
    for array in given:
        digest.update(array)
    return digest.hexdigest() if given else ""
