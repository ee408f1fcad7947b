"""First hits of rays, decided without rounding errors.

Each triangle is tested for each ray in double precision, with a bound on the
errors. Where the bound leaves a doubt, fractions decide.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
from fractions import Fraction

import numpy as np

# A bound on the relative errors of what follows, far larger than their sum:
# a side is a sum of six products of factors with up to four roundings each,
# less than 16 roundings of 2^-53 in all; a height and a slope have fewer.
ERROR = 64 * 2.0**-53


def cross(u, v):
    """The cross product of vectors, also of fractions."""
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0]]


def dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def fractions(rows):
    """Rows of numbers as fractions, exactly."""
    return [[Fraction(float(x)) for x in row] for row in rows]


def minus(u, v):
    return [x - y for x, y in zip(u, v)]


def meets(corners, origin, direction):
    """How a line meets a triangle, exactly: the parameter and the three edge
    functions; None if it misses the triangle or is parallel to its plane."""
    a, b, c = (minus(p, origin) for p in corners)
    sides = [dot(direction, cross(p, q)) for p, q in ((b, c), (c, a), (a, b))]
    if min(sides) < 0 < max(sides) or not any(sides):
        return None
    return dot(a, cross(minus(b, a), minus(c, a))) / sum(sides), sides


class Hits:
    """The right answers for rays: `first`, the number of the first triangle or
    -1, and `others`, a dictionary of rays with several right answers."""

    def __init__(self, vertices, triangles, origins, directions):
        self.corners = np.asarray(vertices, float)[np.asarray(triangles)]
        self.triangles = np.asarray(triangles)
        self.first = np.full(len(origins), -1)
        self.others, self.exact = {}, 0
        # Directions of a length near 1; a power of two rounds nothing
        _, exponents = np.frexp(np.abs(directions).max(axis=1))
        scaled = np.ldexp(directions, -exponents[:, None])
        for start in range(0, len(origins), 20_000):
            part = slice(start, start + 20_000)
            self._search(start, origins[part], scaled[part])

    def are(self, answers):
        """Which answers are right, of the first rays or of all."""
        right = answers == self.first[:len(answers)]
        for ray, some in self.others.items():
            if ray < len(answers):
                right[ray] = answers[ray] in some
        return right

    def of_faces(self, owners):
        """The same for faces that have several triangles."""
        owners = np.append(owners, -1)
        self.first = owners[self.first]
        self.others = {ray: {owners[i] for i in some}
                       for ray, some in self.others.items()}
        return self

    def _search(self, start, origins, directions):
        rays, triangles, sure = self._candidates(origins, directions)
        # Where each line meets the plane of each triangle it may meet
        o, d = origins[rays], directions[rays]
        a, b, c = self.corners[triangles].swapaxes(0, 1)
        normal, away = np.cross(b - a, c - a), a - o
        size = ERROR * np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1)
        slope, slope_error = (normal * d).sum(1), size * np.linalg.norm(d, axis=1)
        height, height_error = (normal * away).sum(1), size * np.linalg.norm(away, axis=1)
        sure &= (abs(slope) > slope_error) & (abs(height) > height_error)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = np.where(sure, height / slope, -np.inf)
            slack = 2 * (slope_error / abs(slope) + height_error / abs(height))
        kept = ~sure | (at > 0)
        rays, triangles, sure, at, slack = (
            x[kept] for x in (rays, triangles, sure, at, slack))
        # Order what each ray meets; doubts come first
        order = np.lexsort((at, rays))
        rays, triangles, sure, at, slack = (
            x[order] for x in (rays, triangles, sure, at, slack))
        firsts = np.flatnonzero(np.diff(rays, prepend=-1))
        doubtful = ~sure[firsts]
        next_ = np.minimum(firsts + 1, len(rays) - 1)
        follows = (next_ > firsts) & (rays[next_] == rays[firsts])
        # Slacks grow with distance by no more than this
        most = np.zeros(len(origins))
        np.maximum.at(most, rays[sure], slack[sure])
        margin = 2 * most[rays[firsts]]
        doubtful |= follows & ~(at[next_] * (1 - margin) > at[firsts] * (1 + margin))
        self.first[start + rays[firsts]] = triangles[firsts]
        ends = np.append(firsts[1:], len(rays))
        for k in np.flatnonzero(doubtful):
            ray, some = rays[firsts[k]], triangles[firsts[k]:ends[k]]
            self._decide(start + ray, some, origins[ray], directions[ray])

    def _candidates(self, origins, directions):
        """Pairs of rays and triangles that may meet, and which surely do, if
        not behind the origin."""
        ends = np.sort(self.triangles[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2))
        edges, index = np.unique(ends, axis=0, return_inverse=True)
        index = index.reshape(-1, 3)
        forward = (self.triangles[:, [1, 2, 0]] == edges[index][:, :, 0])
        place = np.zeros((self.triangles.max() + 1, 3))
        place[self.triangles] = self.corners
        p, q = place[edges].swapaxes(0, 1)
        moments = np.cross(origins, directions)
        # direction . (p x q) + (q - p) . (origin x direction), for all pairs
        values = np.hstack([np.cross(p, q), q - p]) @ np.hstack([directions, moments]).T
        length = np.linalg.norm(directions, axis=1)
        far = np.linalg.norm(place, axis=1).max()
        bound = ERROR * length * (
            far**2 + np.linalg.norm(origins, axis=1) * np.linalg.norm(q - p, axis=1).max())
        left, right = values > bound, values < -bound
        pairs = []
        for number, (three, ways) in enumerate(zip(index, forward)):
            one = [left[e] if way else right[e] for e, way in zip(three, ways)]
            two = [right[e] if way else left[e] for e, way in zip(three, ways)]
            beside = (one[0] | one[1] | one[2]) & (two[0] | two[1] | two[2])
            rays = np.flatnonzero(~beside)
            sure = (one[0] & one[1] & one[2]) | (two[0] & two[1] & two[2])
            pairs.append((rays, np.full(len(rays), number), sure[rays]))
        return [np.concatenate(column) for column in zip(*pairs)]

    def _decide(self, ray, candidates, origin, direction):
        """Decides a ray by fractions."""
        self.exact += 1
        [o], [d] = fractions([origin]), fractions([direction])
        met = []
        for number in candidates:
            hit = meets(fractions(self.corners[number]), o, d)
            if hit and hit[0] >= 0:
                met.append((hit[0], int(number), all(hit[1])))
        some = {-1}
        for at in sorted({hit[0] for hit in met}):
            group = [hit for hit in met if hit[0] == at]
            some |= {number for _, number, _ in group}
            # What lies behind is hidden, unless the ray may slip past an edge
            if at > 0 and (any(inner for *_, inner in group) or self._is_sealed(
                    [number for _, number, _ in group], o, d)):
                some.discard(-1)
                break
        self.first[ray] = min(some)
        if len(some) > 1:
            self.others[ray] = some
        elif some:
            [self.first[ray]] = some

    def _is_sealed(self, numbers, origin, direction):
        """Whether two triangles share the edge that a ray meets, and lie on
        different sides of it, as the ray sees them."""
        seen = {}
        for number in numbers:
            _, sides = meets(fractions(self.corners[number]), origin, direction)
            zeros = [k for k in range(3) if sides[k] == 0]
            if len(zeros) == 1:
                k = zeros[0]
                p, q = (self.triangles[number][(k + j) % 3] for j in (1, 2))
                side = (sum(sides) > 0) == (p < q)
                if seen.setdefault(frozenset((p, q)), side) != side:
                    return True
        return False
