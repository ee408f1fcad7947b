#!/usr/bin/env python3
"""Measures how fast the package answers, beside pt and other programs.

usage: python/tests/full/rates.py [--pt build/pt] [--rounds 7] [-o FILE.csv]

Prints a table: rays per second of intersects_first, the time from arrays to
the first value, the most memory, and what a second thread of Python keeps of
its rate. Each number is a median of rounds, in which the contenders take turns,
each in a process of its own. The mesh is a ring with bumps of 300 304
triangles.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import argparse
import csv
import datetime
import functools
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np

RAYS = 1_000_000

# Prints the most memory of a command in bytes, from a process that is small,
# because a child counts what its parent had.
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(peak if sys.platform == "darwin" else peak * 1024)
"""


# ---- what is measured

def ring(around=548, across=274):
    """The vertices and the triangles of a ring with bumps."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    thick = 0.35 + 0.05 * np.sin(9 * a) * np.cos(5 * b)
    wide = 1 + thick * np.cos(b)
    vertices = np.stack([wide * np.cos(a), wide * np.sin(a), thick * np.sin(b)], -1)
    number = lambda i, j: (i % around) * across + j % across
    p, q, r, s = (number(u + i, v + j) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.stack([p, q, r, p, r, s], -1).reshape(-1, 3)
    return vertices.reshape(-1, 3), faces


def in_the_box(vertices, faces, rng):
    """Rays from random places in the box, in all directions."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return rng.uniform(low, high, (RAYS, 3)), rng.normal(size=(RAYS, 3))


def from_faces(vertices, faces, rng):
    """Rays from the middles of faces, as pt sends them for their irradiance:
    several of a face one after the other, with the density of the cosine."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    some = np.sort(rng.integers(0, len(faces), RAYS))
    on_ball = rng.normal(size=(RAYS, 3))
    on_ball /= np.linalg.norm(on_ball, axis=1)[:, None]
    middles = (a + b + c)[some] / 3
    return middles + 1e-6 * normals[some], normals[some] + on_ball


RAYS_OF = {"random in the box": in_the_box, "from faces": from_faces}


def load():
    return np.load("vertices.npy"), np.load("faces.npy")


def timed(work):
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


# ---- parts that run in processes of their own; each prints one number

def rays_of_litpt(kind):
    import litpt
    mesh = load()
    rays = RAYS_OF[kind](*mesh, np.random.default_rng(1))
    scene = litpt.Scene(mesh)
    scene.intersects_first(*rays)
    print(RAYS / min(timed(lambda: scene.intersects_first(*rays)) for _ in range(2)))


def rays_of_trimesh(kind, module, count):
    import importlib
    import trimesh
    mesh = load()
    rays = [x[:int(count)] for x in RAYS_OF[kind](*mesh, np.random.default_rng(1))]
    intersector = importlib.import_module(f"trimesh.ray.{module}").RayMeshIntersector(
        trimesh.Trimesh(*mesh, process=False, validate=False))
    intersector.intersects_first(*(x[:10] for x in rays))
    print(int(count) / min(timed(lambda: intersector.intersects_first(*rays))
                           for _ in range(2)))


def first_value():
    import litpt
    mesh = load()

    def work():
        scene = litpt.Scene(mesh, albedo=0.5)
        scene.irradiance([[0, 0, 0.1]], [0, 0, 1], samples=16).value
    print(timed(work))


def hold_arrays():
    import litpt
    mesh = load()
    print(litpt.__version__, mesh[0][-1] + mesh[1][-1])


def second_thread(threads, pt=None):
    """The rate of a loop beside a run, or beside a process of pt, over its
    rate alone."""
    import litpt
    scene = litpt.Scene(load(), albedo=0.5)
    place, limits = ([[0, 0, 0.1]], [0, 0, 1]), {}
    if threads != "default":
        limits["threads"] = int(threads)
    scene.irradiance(*place, samples=16)

    def run():
        if not pt:
            return scene.irradiance(*place, time=1, **limits)
        words = ["-j", threads] if limits else []
        return subprocess.run([pt, "mesh.obj", "--points", "point.txt", "-r", "0.5",
                               "--time", "1", "-q", "-f", "-o", "point.csv", *words],
                              check=True)
    counts, is_over = [0], threading.Event()

    def count():
        while not is_over.is_set():
            for _ in range(1000):
                counts[0] += 1
    thread = threading.Thread(target=count)
    thread.start()

    def rate(work):
        before, began = counts[0], time.perf_counter()
        work()
        return (counts[0] - before) / (time.perf_counter() - began)
    ratios = []
    for _ in range(3):
        alone = rate(lambda: time.sleep(1))
        beside = rate(run)
        ratios.append(beside / alone)
    is_over.set()
    thread.join()
    print(statistics.median(ratios))


PARTS = {part.__name__: part for part in (
    rays_of_litpt, rays_of_trimesh, first_value, hold_arrays, second_thread)}


# ---- the measurement

class Bench:
    """Runs parts and pt in a directory with the mesh."""

    def __init__(self, pt, place):
        self.pt, self.place = str(pathlib.Path(pt).resolve()), place
        vertices, faces = ring()
        self.mesh_bytes = vertices.nbytes + faces.nbytes
        np.save(place / "vertices.npy", vertices)
        np.save(place / "faces.npy", faces)
        with open(place / "mesh.obj", "w") as file:
            np.savetxt(file, vertices, "v %.17g %.17g %.17g")
            np.savetxt(file, faces + 1, "f %d %d %d")
        (place / "point.txt").write_text("0 0 0.1 0 0 1\n")

    def part(self, name, *words):
        return [sys.executable, str(pathlib.Path(__file__).resolve()), "--part",
                name, *map(str, words)]

    def run(self, command, threads=None):
        environment = dict(os.environ)
        if threads:
            environment["RAYON_NUM_THREADS"] = str(threads)
        done = subprocess.run(command, cwd=self.place, env=environment, check=True,
                              capture_output=True, text=True)
        return done.stdout

    def number(self, *words, threads=None):
        return float(self.run(self.part(*words), threads).split()[-1])

    def pt_rate(self, words, threads):
        words = [*words, "--integrator", "reference", "-r", "0.5", "-f",
                 "--report", "report.json"] + (["-j", str(threads)] if threads else [])
        self.run([self.pt, "mesh.obj", *words])
        report = json.loads((self.place / "report.json").read_text())
        return report["rays"] / report["render_seconds"]

    def point(self):
        return [self.pt, "mesh.obj", "--points", "point.txt", "-r", "0.5", "-n", "16",
                "-f", "-o", "point.csv"]

    def peak(self, command):
        return float(self.run([sys.executable, "-I", "-S", "-c", PEAK, *command]))

    def rows(self):
        """What is measured: a name, threads, a unit, and how."""
        for threads in (None, 1):
            for kind in RAYS_OF:
                yield f"first hits; rays {kind}", threads, "million rays/s", (
                    lambda k=kind, t=threads: self.number("rays_of_litpt", k, threads=t))
            for words in (["--faces", "-n", "4", "-o", "x.csv"],
                          ["-d", "640x480", "-n", "8", "-o", "x.pfm"]):
                kind = "faces" if "--faces" in words else "a camera"
                yield f"pt; paths from {kind}", threads, "million rays/s", (
                    lambda w=words, t=threads: self.pt_rate(w, t))
        for kind in RAYS_OF:
            yield f"embreex; rays {kind}", 1, "million rays/s", (
                lambda k=kind: self.number("rays_of_trimesh", k, "ray_pyembree", RAYS))
        # Once, since its tree alone takes many seconds
        yield "trimesh; 200 rays random in the box", 1, "million rays/s", functools.cache(
            lambda: self.number("rays_of_trimesh", "random in the box",
                                "ray_triangle", 200))
        yield "arrays to the first value", None, "s", lambda: self.number("first_value")
        yield "pt from a file to the first value", None, "s", (
            lambda: timed(lambda: self.run(self.point())))
        yield "peak memory of the package above numpy and arrays", None, "MB", (
            lambda: (self.peak(self.part("first_value"))
                     - self.peak(self.part("hold_arrays"))) / 1e6)
        yield "peak memory of pt and the size of the arrays", None, "MB", (
            lambda: (self.peak(self.point()) + self.mesh_bytes) / 1e6)
        for threads in (1, None):
            words = threads or "default"
            yield "share of its rate that a second thread keeps", threads, "", (
                lambda w=words: self.number("second_thread", w))
            yield "the same beside a process of pt", threads, "", (
                lambda w=words: self.number("second_thread", w, self.pt))


def machine():
    """As book/scripts/record names it."""
    values = {}
    try:
        for line in open("/proc/cpuinfo"):
            name, _, value = line.partition(":")
            values[name.strip()] = value.strip()
    except OSError:
        pass
    return (f"{values.get('model name', 'a processor')} "
            f"(family {values.get('cpu family')}, model {values.get('model')}), "
            f"{os.cpu_count()} cores, on {datetime.date.today()}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pt", default=os.environ.get("PT", "build/pt"))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("-o", "--output")
    parser.add_argument("--only", default="", help="rows whose names have this text")
    parser.add_argument("--part", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        return PARTS[options.part[0]](*options.part[1:])
    with tempfile.TemporaryDirectory() as place:
        bench = Bench(options.pt, pathlib.Path(place))
        rows = [row for row in bench.rows() if options.only in row[0]]
        found = {row[:3]: [] for row in rows}
        for number in range(options.rounds):
            for *key, work in rows:
                print(f"\rround {number + 1}: {key[0]:60}", end="", file=sys.stderr)
                part = 1e6 if key[2].startswith("million") else 1
                found[tuple(key)].append(work() / part)
        print("\r" + " " * 72 + "\r", end="", file=sys.stderr)
    table = [(name + (" on one thread" if threads else ""), unit,
              *(f"{f(values):.4g}" for f in (statistics.median, min, max)))
             for (name, threads, unit), values in found.items()]
    for name, unit, median, least, most in table:
        print(f"{name:62} {median:>8} {unit:14} ({least} to {most})")
    if options.output:
        with open(options.output, "w", newline="") as file:
            words = " ".join(sys.argv[1:])
            print(f"# {machine()}, by python/tests/full/rates.py {words}", file=file)
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["what", "unit", "median", "least", "most"])
            writer.writerows(table)


if __name__ == "__main__":
    main()
