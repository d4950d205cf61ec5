#!/usr/bin/env python3
"""Makes the golden scenes: python3 make_scene_golden.py [FOLDER] [--full]

A file per scene, arrays in the format of numpy.save one after another:
  settings f8 (pitch mm, focal length mm, size px, sheets, gap 1/m, solids, vergence of the background or NaN, its three weights),
  materials f4 (three weights, two-sided, alpha, mode, cutoff), vertices f4 (camera frame), triangles u2 (three vertices, material),
  and for 1, 4 and 16 samples per pixel: digests u8 (bands of 8 rows; surfaces, coverage, number of sheets), values f4 (pixels; row, column, per sheet
  coverage, distance, three weights). With --full the values of all pixels.
Digest of 64-bit words w: the polynomial of the words at 0x9e3779b97f4a7c15, modulo 2^64. Words of a sample: number of surfaces, bits of each vergence and its triangle.
Made with NumPy 2.4.
"""

import sys
from pathlib import Path

import numpy as np

import scene_reference as s
from scene_reference import Material, Mesh

SIZE = 64
RED, GREEN, BLUE = (0.8, 0.1, 0.05), (0.1, 0.7, 0.2), (0.0, 0.25, 0.9)
COLOURS = [Material(RED), Material(GREEN), Material(BLUE)]
MULTIPLIER = 0x9E3779B97F4A7C15
PIXELS = 40


def digest(words):
    """Polynomial of 64-bit words."""
    words = np.asarray(words, np.uint64)
    powers = np.full(len(words), MULTIPLIER, np.uint64)
    powers[:1] = 1
    return int((np.cumprod(powers)[::-1] * words).sum(dtype=np.uint64)) if len(words) else 0


def quad(o, u, v):
    o, u, v = (np.asarray(p, float) for p in (o, u, v))
    return np.array([o, o + u, o + u + v, o + v]), np.array([[0, 1, 2], [0, 2, 3]])


def wall(z, half=3.0):
    return quad((-half, -half, z), (2 * half, 0, 0), (0, 2 * half, 0))


def box(low, high):
    v = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)], float)
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return v, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])


def ball(centre, radius, level):
    """An octahedron whose faces are divided into 4^level, on a sphere."""
    v = [np.array(p, float) for p in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))]
    f = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    for _ in range(level):
        middle, divided = {}, []
        for t in f:
            m = []
            for a, b in zip(t, t[1:] + t[:1]):
                key = (min(a, b), max(a, b))
                if key not in middle:
                    p = v[a] + v[b]
                    middle[key] = len(v)
                    v.append(p / np.sqrt(p @ p))
                m.append(middle[key])
            divided += [(t[0], m[0], m[2]), (t[1], m[1], m[0]), (t[2], m[2], m[1]), tuple(m)]
        f = divided
    return np.array(v) * radius + np.array(centre, float), np.array(f)


def flip(shape):
    return shape[0], shape[1][:, ::-1]


def join(*parts, materials=COLOURS, solids=True):
    v, t, m, at = [], [], [], 0
    for (vertices, triangles), material in parts:
        v.append(vertices)
        t.append(triangles + at)
        m += [material] * len(triangles)
        at += len(vertices)
    return Mesh(np.concatenate(v), np.concatenate(t), np.array(m), materials, solids)


def random_triangles():
    rng = np.random.default_rng(12)
    v = rng.normal(0, 1, (360, 3)) * [0.03, 0.03, 0.3] + [0, 0, 1.0]
    v[:60] = rng.normal(0, 0.5, (60, 3))  # some about the camera
    materials = [Material(RED), Material(GREEN, two_sided=False), Material(BLUE, alpha=0.4, mode=2)]
    return Mesh(v, np.arange(360).reshape(120, 3), rng.integers(0, 3, 120), materials)


def grid(n=8):
    """A plane z = 1 whose vertices, edges and diagonals hold samples."""
    v = np.array([(i / n, j / n, 1.0) for j in range(-n, n + 1) for i in range(-n, n + 1)])
    w = 2 * n + 1
    t = [q for j in range(2 * n) for i in range(2 * n) for a in [j * w + i] for q in ((a, a + 1, a + w), (a + 1, a + w + 1, a + w))]
    return v, np.array(t)


def three():
    left = quad((-3, -3, 1.0), (3.0002, 0, 0), (0, 6, 0))
    top = quad((-3, -3, 1.5), (6, 0, 0), (0, 2.9998, 0))
    return join((left, 0), (top, 1), (wall(2.0), 2))


def behind():
    floor = quad((-2, 0.01, -1.0), (4, 0.003, 0), (0, 0.002, 60.0))
    side = (np.array([(0.02, -1.0, -0.5), (0.025, 1.0, -0.5), (0.03, 0.01, 3.0)]), np.array([[0, 1, 2]]))
    back = (np.array([(-1, -1, -1.0), (1, -1, -1.0), (0, 1, -2.0)]), np.array([[0, 1, 2]]))
    double = (np.array([(0, 0, 1.0), (0, 0, 1.0), (1, 0, 1.0)]), np.array([[0, 1, 2]]))
    return join((back, 0), (floor, 1), (double, 0), (side, 2))


def blend():
    materials = [Material(RED, alpha=0.5, mode=2), Material(GREEN, alpha=0.3, mode=2), Material(BLUE, alpha=0.4, mode=1), Material((1, 1, 0), alpha=0.6, mode=1),
                 Material((0.5, 0.5, 0.5))]
    tilted = quad((-0.02, -0.03, 1.2), (0.05, 0.01, 0.1), (0.01, 0.05, -0.1))
    return join((quad((-3, -0.01, 1.0), (6, 0, 0), (0, 3, 0)), 0), (tilted, 1), (quad((-0.01, -3, 1.4), (0.02, 0, 0), (0, 6, 0)), 2),
                (quad((0.005, -3, 1.6), (0.02, 0, 0), (0, 6, 0)), 3), (wall(2.0), 4), materials=materials)


def one_sided():
    single = [Material(m.weights, two_sided=False) for m in COLOURS]
    half = lambda shape: (shape[0], shape[1][::2])
    return join((half(ball((0.01, 0, 1.0), 0.015, 2)), 0), (flip(ball((-0.015, 0.005, 1.1), 0.012, 2)), 1), (flip(quad((-0.03, -0.03, 1.5), (0.04, 0, 0), (0, 0.05, 0))), 0),
                (quad((-0.01, -0.02, 1.6), (0.04, 0, 0), (0, 0.05, 0)), 1), (flip(wall(2.0)), 2), materials=single)


def room(turned):
    shape = box((-1, -1, -1), (1, 1, 4))
    return join((flip(shape) if turned else shape, 1), (ball((0, 0, 1.0), 0.01, 2), 0), (wall(6.0, 9.0), 2))


BOX = ((-0.01, -0.012, 1.0), (0.013, 0.01, 1.02))
BEFORE_WALL = ((ball((0.001, 0, 1.0), 0.012, 2), 0), (wall(2.0), 1))
# Name: mesh, sheets, gap, (vergence, weights) of the background, (pitch, focal length).
SCENES = {
    "ball-wall": (lambda: join(*BEFORE_WALL), 3, 0.01),
    "ball-wall-open": (lambda: join(*BEFORE_WALL, solids=False), 3, 0.01),
    "random": (random_triangles, 3, 0.01),
    "box-closed": (lambda: join((box(*BOX), 0), (wall(2.0), 1)), 3, 0.01),
    "box-open": (lambda: join((tuple([box(*BOX)[0], box(*BOX)[1][2:]]), 0), (wall(2.0), 1)), 3, 0.01),
    "box-in-ball": (lambda: join((ball((0, 0, 1.0), 0.03, 2), 0), (box((-0.01, -0.01, 0.99), (0.01, 0.01, 1.01)), 2), (wall(2.0), 1)), 3, 0.01),
    "room": (lambda: room(False), 3, 0.01),
    "room-turned": (lambda: room(True), 3, 0.01),
    "three-1": (three, 1, 0.01),
    "three-2": (three, 2, 0.01),
    "three-3": (three, 3, 0.01),
    "blend": (blend, 3, 0.01),
    "one-sided": (one_sided, 3, 0.01),
    "behind": (behind, 3, 0.01),
    "horizon": (lambda: join((quad((-5e5, 1.0, 0.5), (1e6, 0, 0), (0, 0, 1e6)), 0)), 2, 1e-4, (0.0, BLUE)),
    "grid": (lambda: join((grid(), 0), (wall(1.5), 1)), 3, 0.01, None, (1 / 64, 1.0)),
}


def make(mesh, sheets, gap, background=None, scale=(0.05, 50.0), full=False):
    settings = [*scale, SIZE, sheets, gap, mesh.use_solids, *((background[0], *background[1]) if background else (np.nan, 0, 0, 0))]
    yield np.array(settings, "<f8")
    yield np.array([(*m.weights, m.two_sided, m.alpha, m.mode, m.cutoff) for m in mesh.materials], "<f4")
    yield mesh.vertices.astype("<f4")
    yield np.column_stack([mesh.triangles, mesh.material_of]).astype("<u2")
    weights = np.array([m.weights for m in mesh.materials], np.float32).astype(float)[mesh.material_of]
    behind = np.array(background[1] if background else (0, 0, 0), float)
    for n in (1, 4, 16):
        places = s.pattern(n)
        row, column, i = (k.ravel() for k in np.meshgrid(range(SIZE), range(SIZE), range(n), indexing="ij"))
        x, y = (s.along_axis(p + places[i, k], SIZE, *scale) for k, p in enumerate((column, row)))
        ray, v, t, front = s.all_hits(mesh, x, y)
        start = np.searchsorted(ray, np.arange(len(x) + 1))
        of = [s.surfaces(mesh, list(zip(v[a:b], t[a:b], front[a:b])), k % n, n) for k, (a, b) in enumerate(zip(start, start[1:]))]
        words = [[len(h)] + [w for v, t in h for w in (int(np.float64(v).view(np.uint64)), int(t))] for h in of]
        values = np.zeros((SIZE, SIZE, sheets, 5), np.float32)
        number = np.zeros((SIZE, SIZE), np.uint64)
        for p in range(SIZE * SIZE):
            samples = of[p * n : p * n + n]
            if background:
                samples = [h + [(background[0], -1)] for h in samples]
            got, _ = s.sheets_of(samples, sheets, gap)
            number.flat[p] = len(got)
            for q, (vergence, coverage, shown) in enumerate(got):
                mean = sum((weights[k] if k >= 0 else behind for k in shown), np.zeros(3)) / len(shown)
                values[p // SIZE, p % SIZE, q] = (coverage, 1 / vergence if vergence > 0 else np.inf, *mean)
        bands = []
        for r in range(0, SIZE, 8):
            coverage = np.ascontiguousarray(values[r : r + 8, :, :, 0]).view(np.uint32).ravel()
            band = sum(words[r * SIZE * n : (r + 8) * SIZE * n], [])
            bands.append((digest(band), digest(coverage), digest(number[r : r + 8].ravel())))
        yield np.array(bands, "<u8")
        places = np.stack(np.meshgrid(range(SIZE), range(SIZE), indexing="ij"), -1).reshape(-1, 2)
        partial = ((values[..., 0] > 0) & (values[..., 0] < 1)).any(-1).ravel()
        rng = np.random.default_rng(n)
        chosen = np.concatenate([rng.permutation(np.flatnonzero(partial))[: PIXELS // 2], rng.permutation(SIZE * SIZE)])[:PIXELS]
        chosen = np.arange(SIZE * SIZE) if full else chosen
        yield np.column_stack([places[chosen], values.reshape(SIZE * SIZE, -1)[chosen]]).astype("<f4")


if __name__ == "__main__":
    words = [a for a in sys.argv[1:] if a != "--full"]
    folder = Path(words[0]) if words else Path(__file__).parent / "scenes"
    folder.mkdir(parents=True, exist_ok=True)
    for name, (mesh, *rest) in SCENES.items():
        with open(folder / f"{name}.npy", "wb") as f:
            for array in make(mesh(), *rest, full="--full" in sys.argv):
                np.save(f, array)
        print(name, (folder / f"{name}.npy").stat().st_size)
