"""First hits of rays: by litpt, by trimesh's own intersector, and exactly.

For a ray that passes exactly through an edge or a corner, each triangle there
is a right answer, and of several triangles at one distance each.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
from fractions import Fraction

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_triangle import RayMeshIntersector

import exact
import litpt

RAYS = 1_000_000


def blob(rng):
    """A closed mesh of 320 triangles that is not convex, and 60 triangles that
    pass through it and through each other."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    dents = rng.uniform(0.6, 1, (len(ball.vertices), 1))
    some = rng.uniform(-1, 1, (60, 1, 3)) + rng.uniform(-0.3, 0.3, (60, 3, 3))
    vertices = np.vstack([ball.vertices * dents, some.reshape(-1, 3)])
    more = np.arange(180).reshape(-1, 3) + len(ball.vertices)
    return vertices, np.vstack([ball.faces, more])


def random_rays(rng, count, reach=1.5):
    """Rays from a box in all directions."""
    return rng.uniform(-reach, reach, (count, 3)), rng.normal(size=(count, 3))


def by_trimesh(vertices, faces, origins, directions):
    """The answers of trimesh, in parts, since it needs much memory."""
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    assert len(mesh.faces) == len(faces)
    ray = RayMeshIntersector(mesh)
    parts = [slice(i, i + 20_000) for i in range(0, len(origins), 20_000)]
    return np.concatenate(
        [ray.intersects_first(origins[part], directions[part]) for part in parts])


def by_fractions(vertices, faces, origins, directions):
    """The answers by fractions alone, for few rays that pass no edge."""
    corners = [exact.fractions(triangle) for triangle in vertices[faces]]
    for o, d in zip(exact.fractions(origins), exact.fractions(directions)):
        hits = [exact.meets(three, o, d) for three in corners]
        hits = [(hit[0], i) for i, hit in enumerate(hits) if hit and hit[0] > 0]
        yield min(hits, default=(0, -1))[1]


# ---- the judge

def test_the_judge_agrees_with_fractions():
    rng = np.random.default_rng(1)
    vertices, faces = blob(rng)
    origins, directions = random_rays(rng, 40)
    judge = exact.Hits(vertices, faces, origins, directions)
    assert judge.first.tolist() == list(
        by_fractions(vertices, faces, origins, directions))
    assert judge.are(judge.first).all()
    assert not judge.are(np.where(judge.first < 0, 0, -1)).any()


def test_the_judge_knows_edges_and_corners():
    # A square of four triangles around its middle, and one below it
    vertices = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 0],
                [-3, -3, -1], [3, -3, -1], [0, 6, -1]]
    faces = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [5, 6, 7]]
    places = [[0.25, 0.25], [0.5, 0], [0, 0], [0.5, 0.5], [9, 9]]
    origins = np.column_stack([places, np.ones(5)])
    judge = exact.Hits(vertices, faces, origins, np.tile([0., 0, -1], (5, 1)))
    right = [{0}, {0, 3}, {0, 1, 2, 3, 4}, {0, 4}, {-1}]
    for answer in range(-1, 5):
        expected = [answer in some for some in right]
        assert judge.are(np.full(5, answer)).tolist() == expected


# ---- many rays

@pytest.mark.parametrize("scale", [1e-8, 1e-4, 1, 1e4, 1e8])
def test_random_rays(scale):
    rng = np.random.default_rng(2)
    vertices, faces = blob(rng)
    origins, directions = random_rays(rng, RAYS)
    vertices, origins = vertices * scale, origins * scale
    ours = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    judge = exact.Hits(vertices, faces, origins, directions)
    we = judge.are(ours)
    count = RAYS if scale == 1 else RAYS // 10
    theirs = by_trimesh(vertices, faces, origins[:count], directions[:count])
    they, we_too = judge.are(theirs), we[:count]
    disputed = theirs != ours[:count]
    print(f"\nscale {scale:g}: {RAYS} rays, {(ours >= 0).sum()} hits, "
          f"{(~we).sum()} answers wrong, {judge.exact} in doubt until fractions decide; "
          f"trimesh, {count} rays: {disputed.sum()} disputes, both right in "
          f"{(disputed & we_too & they).sum()}, litpt in "
          f"{(disputed & we_too & ~they).sum()}, trimesh in "
          f"{(disputed & ~we_too & they).sum()}, none in "
          f"{(disputed & ~we_too & ~they).sum()}")
    some = np.flatnonzero(disputed)[:20]
    assert judge.first[some].tolist() == list(
        by_fractions(vertices, faces, origins[some], directions[some]))
    # Both meet and miss often, from inside and from outside
    assert 0.1 < (ours >= 0).mean() < 0.9
    assert not (disputed & ~we_too & they).any()
    assert we.all()


@pytest.mark.parametrize("exponent", [-500, -60, 60, 500])
def test_scales_that_round_nothing_change_nothing(exponent):
    rng = np.random.default_rng(3)
    vertices, faces = blob(rng)
    origins, directions = random_rays(rng, 100_000)
    first = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    vertices, origins = np.ldexp(vertices, exponent), np.ldexp(origins, exponent)
    scene = litpt.Scene((vertices, faces))
    assert (scene.intersects_first(origins, directions) == first).all()


# ---- special rays

def test_from_far_away():
    """From a million sizes away. A unit vector has an error of 2^-53 in each
    component, so a ray arrives 10^-10 beside its line; of 10^5 rays a
    thousandth comes that close to an edge."""
    rng = np.random.default_rng(4)
    vertices, faces = blob(rng)
    targets, away = random_rays(rng, 100_000, 1)
    origins = 1e6 * away / np.linalg.norm(away, axis=1)[:, None]
    directions = targets - origins
    ours = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    judge = exact.Hits(vertices, faces, origins, directions)
    assert (ours >= 0).mean() > 0.3
    assert judge.are(ours).all()


FROM_FARTHER = pytest.mark.xfail(strict=True, reason=(
    "from more than 10^12 sizes a ray may enter behind the first triangles"))


@pytest.mark.parametrize("far", [
    1e6, 1e11, *(pytest.param(far, marks=FROM_FARTHER)
                 for far in (1e100, 1e300))])
def test_along_the_axes_from_far_away(far):
    rng = np.random.default_rng(5)
    vertices, faces = blob(rng)
    origins = rng.uniform(-1, 1, (3000, 3))
    directions = np.zeros((3000, 3))
    axes, signs = np.arange(3000) % 3, rng.choice([-1., 1], 3000)
    directions[np.arange(3000), axes] = signs
    origins[np.arange(3000), axes] = -4 * signs
    judge = exact.Hits(vertices, faces, origins, directions)
    origins[np.arange(3000), axes] = -far * signs
    ours = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    assert judge.are(ours).all()


def test_along_the_axes():
    rng = np.random.default_rng(6)
    vertices, faces = blob(rng)
    origins = random_rays(rng, 60_000)[0]
    axes = np.arange(60_000) % 3
    # Also negative zeros, and numbers next to zero
    directions = rng.choice([0., -0., 5e-324, -1e-310], (60_000, 3))
    directions[np.arange(60_000), axes] = rng.choice([-1., 1], 60_000)
    ours = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    judge = exact.Hits(vertices, faces, origins, directions)
    assert judge.are(ours).all()


@pytest.mark.parametrize("length", [1e-300, 1e300, 5e-324 * 2**20])
def test_lengths_of_directions(length):
    rng = np.random.default_rng(7)
    vertices, faces = blob(rng)
    origins, directions = random_rays(rng, 100_000)
    scene = litpt.Scene((vertices, faces))
    ours = scene.intersects_first(origins, directions * length)
    judge = exact.Hits(vertices, faces, origins, directions * length)
    assert judge.are(ours).all()
    # A power of two rounds nothing
    exponent = round(np.log2(length))
    if abs(exponent) < 1000:
        powers = np.ldexp(directions, exponent)
        expected = scene.intersects_location(origins, directions)
        for found, right in zip(scene.intersects_location(origins, powers), expected):
            assert (found == right).all()


# ---- edges and corners

def around(faces):
    """The faces around each corner and each edge."""
    stars = {}
    for number, face in enumerate(faces):
        for k in range(3):
            p, q = int(face[k]), int(face[k - 1])
            stars.setdefault(p, set()).add(number)
            stars.setdefault(frozenset((p, q)), set()).add(number)
    return stars


@pytest.mark.parametrize("scale", [1e-8, 1, 1e8])
@pytest.mark.parametrize("outside", [False, True])
def test_edges_and_corners_of_a_ball(scale, outside):
    """Each ray aims at an edge or a corner, and must not slip through."""
    rng = np.random.default_rng(8)
    ball = trimesh.creation.icosphere(subdivisions=2)
    vertices, faces = np.array(ball.vertices) * scale, np.array(ball.faces)
    stars = around(faces)
    places = list(stars)
    chosen = rng.integers(0, len(places), 100_000)
    ends = np.array([[p, p] if isinstance(p, int) else sorted(p) for p in places])
    parts = rng.uniform(0, 1, (len(chosen), 1))
    p, q = vertices[ends[chosen]].swapaxes(0, 1)
    targets = np.where(p == q, p, p + (q - p) * parts)
    if outside:
        # From where all faces around are seen from the front: at this distance
        # from the plane through a corner the planes of its faces are below
        origins = targets * 3 + rng.uniform(-0.5, 0.5, targets.shape) * scale
    else:
        origins = rng.uniform(-0.5, 0.5, targets.shape) * scale
    normals, anchors = ball.face_normals, vertices[faces[:, 0]]
    ours = litpt.Scene((vertices, faces)).intersects_first(
        origins, targets - origins)
    for number, place in enumerate(places):
        rays = np.flatnonzero(chosen == number)
        some = list(stars[place])
        heights = [((origins[rays] - anchors[i]) @ normals[i]) for i in some]
        assert (np.array(heights) * (1 if outside else -1) > 0.1 * scale).all()
        assert np.isin(ours[rays], some).all()


def lattice(n):
    """The surface of a cube from -n to n in squares of two triangles, with
    corners that are whole numbers."""
    faces, numbers, corners = [], {}, []
    def number(corner):
        if corner not in numbers:
            numbers[corner] = len(corners)
            corners.append(corner)
        return numbers[corner]
    for axis in range(3):
        for side in (-n, n):
            for i in range(-n, n):
                for j in range(-n, n):
                    square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    square = [list(pair) for pair in square]
                    for pair in square:
                        pair.insert(axis, side)
                    a, b, c, d = (number(tuple(pair)) for pair in square)
                    faces += [[a, b, c], [a, c, d]]
    return np.array(corners, float), np.array(faces)


def test_edges_and_corners_hit_exactly():
    """Rays in a cube with whole numbers, so that many pass exactly through
    edges and corners."""
    rng = np.random.default_rng(9)
    vertices, faces = lattice(4)
    origins = rng.integers(-7, 8, (3000, 3)) / 2
    directions = rng.integers(-2, 3, (3000, 3)).astype(float)
    directions[~directions.any(axis=1)] = [0, 0, 1]
    ours = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    judge = exact.Hits(vertices, faces, origins, directions)
    assert len(judge.others) > 1000
    assert (ours >= 0).all()
    assert judge.are(ours).all()


# ---- special meshes

def test_triangles_without_area():
    rng = np.random.default_rng(10)
    vertices, faces = blob(rng)
    origins, directions = random_rays(rng, 100_000)
    # A segment, a corner, a point, and the middle of an edge
    middle = vertices[faces[:100, :2]].mean(axis=1)
    more = np.arange(100) + len(vertices)
    flat = np.concatenate([
        faces[:100][:, [0, 1, 0]], faces[:100][:, [2, 2, 2]],
        np.column_stack([faces[:100, 0], more, faces[:100, 1]]),
        [[len(vertices) + 100] * 3]])
    all_vertices = np.vstack([vertices, middle, [[0, 0, 0]]])
    mixed = rng.permutation(len(faces) + len(flat))
    numbers = np.append(np.argsort(mixed)[:len(faces)], -1)
    scene = litpt.Scene((all_vertices, np.vstack([faces, flat])[mixed]))
    expected = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    ours = scene.intersects_first(origins, directions)
    assert exact.Hits(vertices, faces, origins, directions).are(expected).all()
    # The middle of an edge is rounded; a triangle there may have an area of
    # some units in the last place, which no random ray meets
    assert (ours == numbers[expected]).all()


def test_only_triangles_without_area():
    scene = litpt.Scene(([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 0, 1]]))
    rays = np.array([[1., 0, 1], [1, 5, 0]]), np.array([[0., 0, -1], [0, -1, 0]])
    assert scene.intersects_first(*rays).tolist() == [-1, -1]


def test_numbers_of_squares():
    """Squares, each two triangles: the numbers are those of squares."""
    rng = np.random.default_rng(11)
    vertices, faces = lattice(4)
    vertices = vertices + 0.0
    squares = np.column_stack([faces[::2], faces[1::2, 2]])
    origins, directions = random_rays(rng, 100_000, 6)
    ours = litpt.Scene((vertices, squares)).intersects_first(origins, directions)
    judge = exact.Hits(vertices, faces, origins, directions)
    judge.of_faces(np.arange(len(faces)) // 2)
    assert (ours >= 0).mean() > 0.3
    assert judge.are(ours).all()


def test_numbers_of_polygons():
    """A triangle, an L, a square with a repeated corner, and a pentagon, side
    by side and seen from both sides."""
    places = [[(0, 0), (1, 0), (0, 1)],
              [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
              [(0, 0), (1, 0), (1, 1), (0, 1), (0, 1)],
              [(0, 0), (2, 0), (3, 1), (1, 3), (-1, 1)]]
    vertices, faces = [], []
    for number, outline in enumerate(places):
        faces.append(list(range(len(vertices), len(vertices) + len(outline))))
        vertices += [(x + 10 * number, y, x / 2 + y) for x, y in outline]
    def inside(number, x, y):
        return [x >= 0 and y >= 0 and x + y <= 1,
                0 <= x <= 2 and 0 <= y <= 2 and (x <= 1 or y <= 1),
                0 <= x <= 1 and 0 <= y <= 1,
                y >= 0 and y >= x - 2 and x + y <= 4 and y <= x + 2 and x + y >= 0][number]
    rng = np.random.default_rng(12)
    numbers = rng.integers(0, 4, 50_000)
    x, y = rng.uniform(-1.5, 3.5, (2, 50_000))
    up = rng.choice([-1., 1], 50_000)
    origins = np.column_stack([x + 10 * numbers, y, -20 * up])
    directions = np.column_stack([0 * x, 0 * y, up])
    ours = litpt.Scene((vertices, faces)).intersects_first(origins, directions)
    expected = [n if inside(n, *at) else -1 for n, *at in zip(numbers, x, y)]
    assert set(expected) == {-1, 0, 1, 2, 3}
    assert (ours == expected).all()


# ---- the other two questions

def test_any_and_shapes():
    rng = np.random.default_rng(13)
    vertices, faces = blob(rng)
    scene = litpt.Scene((vertices, faces), ground=0.5)
    origins, directions = random_rays(rng, 50_000)
    first = scene.intersects_first(origins, directions)
    judge = exact.Hits(vertices, faces, origins, directions)
    assert judge.are(first).all()
    some = scene.intersects_any(origins, directions)
    assert some.dtype == bool and (some == (first >= 0)).all()
    places, rays, hit = scene.intersects_location(origins, directions)
    assert (rays == np.flatnonzero(first >= 0)).all()
    assert (hit == first[rays]).all() and places.shape == (len(rays), 3)
    none = np.empty((0, 3))
    assert scene.intersects_first(none, none).shape == (0,)
    assert scene.intersects_any(none, none).shape == (0,)
    assert [len(x) for x in scene.intersects_location(none, none)] == [0, 0, 0]


@pytest.mark.parametrize("scale", [1e-8, 1, 1e8])
@pytest.mark.parametrize("moved", [0, 1000])
def test_places(scale, moved):
    """How far a place is from the true hit, after chapter "Where the next ray
    starts".

    With u = 2^-53, R the largest difference of coordinates between the ray's
    origin and a corner, M the largest coordinate of the origin and
    s = 9/8 R + 1/8 M, a place is put 2^-47 s = 64us above the plane, on the
    side of the origin; the computed height is wrong by 32uR at most. The line
    of the ray is 15us off at most, and the triangle 6uR, so along a ray whose
    cosine with the normal is c the hit moves by 21us/c, and the distance has
    an error of 2^-48 R = 32uR. Together: us(64 + 32 + 15 + 32 + 21/c).
    A direction of length 1 is off by u, and the frame of the scene rounds
    places: as the origin is within 3 sizes B of the scene's box, and no
    coordinate is larger than M' in the file, 8u(3B + M')(1 + 1/c) are more
    than enough.
    """
    rng = np.random.default_rng(14)
    vertices, faces = blob(rng)
    origins, directions = random_rays(rng, 3000)
    vertices = (vertices + moved) * scale
    origins = (origins + moved) * scale
    scene = litpt.Scene((vertices, faces))
    places, rays, hit = scene.intersects_location(origins, directions)
    assert len(rays) > 500
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    box = float((high - low).max())
    largest = float(max(abs(vertices).max(), abs(origins).max()))
    u, worst = 2.0**-53, 0
    for place, ray, face in zip(places, rays, hit):
        [o], [d], [p] = (exact.fractions([x]) for x in
                         (origins[ray], directions[ray], place))
        corners = exact.fractions(vertices[faces[face]])
        at, _ = exact.meets(corners, o, d)
        true = [x + at * y for x, y in zip(o, d)]
        off = float(sum(x * x for x in exact.minus(p, true))) ** 0.5
        a, b, c = corners
        normal = exact.cross(exact.minus(b, a), exact.minus(c, a))
        length = float(exact.dot(normal, normal)) ** 0.5
        slope = float(exact.dot(normal, d)) / length / np.linalg.norm(directions[ray])
        cosine = abs(slope)
        # Rays from outside start where they enter the box
        size = 9 / 8 * box * 1.001 + 1 / 8 * largest * 1.001
        bound = u * size * (143 + 21 / cosine)
        bound += 8 * u * (3 * box + largest) * (1 + 1 / cosine)
        worst = max(worst, off / bound)
        assert off <= bound
        if not moved:
            # The place is on the side of the origin
            assert exact.dot(normal, exact.minus(p, a)) * Fraction(slope) < 0
    print(f"\nscale {scale:g}, moved by {moved}: the largest distance is "
          f"{worst:.2f} of the bound")
