"""Scenes before a thin lens with rays as truth: sheets of the model and the same surfaces for rays. Charts in px, contrast 1: errors are shares of the peak."""
from dataclasses import dataclass

import numpy as np

import ray_integral as rays
from closed_forms import disc_area
from depth_reference import Sheet

BLUR, FOCUS = 100.0, 2.0                                    # px per dioptre, 1/m


@dataclass
class Scene:
    sheets: list                                            # of the model, on a grid of odd sides about 0
    surfaces: list                                          # of the rays, the nearest first
    nodes: np.ndarray                                       # vergences of the lens's depth nodes
    points: np.ndarray                                      # film points (N, 2), px from the centre
    size: int                                               # side of the film, px
    invented: bool = False
    line: int = 0                                           # first row and column of a cell of the correction where `seams` are looked for; 0: none

    def errors(self, film):
        """(largest, rms) difference of a film centred on 0 from rays."""
        truth = rays.film_points(self.points, self.surfaces, BLUR, FOCUS)
        e = film[self.points[:, 0] + self.size // 2, self.points[:, 1] + self.size // 2] - truth
        return abs(e).max(), np.sqrt((e ** 2).mean())


def seams(film, line):
    """Largest difference of the steps into row and column `line` of a film from those around them."""
    step = lambda f: f[line] - f[line - 1] - (f[line - 1] - f[line - 4] + f[line + 3] - f[line]) / 6
    return max(abs(step(f)).max() for f in (film, film.T))


def rows(table, name, limits, scene, film):
    """Rows of a film of `scene`; limits: (largest error [%], figure to compare it with), (rms, figure) or less."""
    for kind, value, (limit, stated) in zip(("max", "rms"), scene.errors(film), limits):
        table.below(f"{name}: {kind}, %", 100 * value, limit, stated)
    if scene.line:
        table.below(f"{name}: step at row and column {scene.line}, %", 100 * seams(film, scene.line), 0.5)


def two_planes():
    """A black disc of 40 px radius before a checker; points within 20 px of its edge."""
    y, x = np.mgrid[-180:181, -180:181]
    disc = lambda y, x: np.floor(y + 0.5) ** 2 + np.floor(x + 0.5) ** 2 <= 1600
    zone = np.argwhere(abs(np.hypot(y, x)[100:261, 100:261] - 40) <= 20) - 80
    points = zone[np.random.default_rng(5).permutation(len(zone))[:120]]
    cases = (("rho 20 and 10, uniform rear", 20, 10, 0, 2, (0.0, 0.0)),
             ("near in focus, rear 15, checker 32", 0, -15, 32, 2, (0.0, 0.0)),
             ("rear in focus, near 20, checker 32", 20, 0, 32, 2, (0.0, 0.0)), ("rho 20 and 10, checker 8", 20, 10, 8, 2, (0.83, 0.30)),
             ("rho 20 and 10, checker 32", 20, 10, 32, 2, (0.97, 0.25)), ("rho 20 and -20, checker 32", 20, -20, 32, 2, (0.71, 0.26)),
             ("rho 10 and -6.5, checker 8", 10, -6.5, 8, 2, (1.2, 0.3)), ("rho 20 and -2, checker 32", 20, -2, 32, 2, (1.2, 0.2)),
             ("rho 3 and -1.6, checker 8", 3, -1.6, 8, 2, (2.0, 0.3)), ("rho 20 and 0.24, checker 32", 20, 0.24, 32, 2, (2.4, 0.45)),
             ("rear in focus, near 20, checker 32, sheet 0 alone", 20, 0, 32, 1, (53.8, 13.7)),
             ("the same with an invented sheet", 20, 0, 32, 0, (45.1, 9.1)), ("invented sheet, uniform rear in focus", 20, 0, 0, 0, (0.0, 0.0)))
    out = []
    for name, near, far, side, sheets, stated in cases:
        low, high = FOCUS + far / BLUR, FOCUS + near / BLUR
        pattern = rays.checker(side) if side else lambda y, x: np.ones(np.shape(x))
        inside = disc(y, x)
        front = Sheet(np.where(inside, 0.0, pattern(y, x)), np.where(inside, high, low))
        wall = Sheet(pattern(y, x), np.full(x.shape, low))
        surfaces = [rays.Plane(high, lambda y, x: np.zeros(len(x)), disc), rays.Plane(low, pattern)]
        limits = [0.3, 0.1] if stated[0] == 0 else [1.2 * stated[0], 1.2 * stated[1]]
        scene = Scene([front, wall] if sheets == 2 else [front], surfaces, np.array([low, low + 0.01, high - 0.005, high + 0.005]), points, 161, sheets == 0)
        out.append((f"two planes, {name}", tuple(zip(limits, stated)), scene))
    return out


def slanted_planes():
    """A plane tilted so that its blur radius changes by 0.02 and 0.1 px per px."""
    y, x = np.mgrid[-170:171, -170:171]
    points = np.random.default_rng(6).integers(-45, 46, (120, 2))
    out = []
    for slope, limit in ((0.02, 0.25), (0.1, 0.25)):
        v = FOCUS + 0.2 + slope / BLUR * x
        near = int(v.min() > FOCUS + 0.01)                  # the plane lies before the wall everywhere
        nodes = np.append([FOCUS] * near, np.arange((v.min() if near else FOCUS) - 0.003, v.max() + 0.01, 0.01))
        checker = rays.checker(8)
        plane = Sheet(0.5 * checker(y, x), np.maximum(v, FOCUS))
        surface = [rays.Plane(FOCUS + 0.2, lambda y, x: 0.5 * checker(y, x), slope=slope / BLUR)]
        wall = Sheet(np.ones(x.shape), np.full(x.shape, FOCUS))
        for name, sheets in (("nothing known behind it", [plane]), ("a white wall hidden behind it", [plane, wall])):
            out.append((f"slanted plane, checker 8, d rho/dx {slope}, {name}", ((limit, 0.2),), Scene(sheets, surface, nodes, points, 91)))
    return out


def post_and_ball():
    """A black post of 7 px (rho 30) and a grey ball whose front spans 10 px of blur (rho 20 to 30) before a checker out of focus."""
    y, x = np.mgrid[-170:171, -170:171]
    rng, out = np.random.default_rng(8), []
    pattern = rays.checker(32)
    post = lambda y, x: abs(np.floor(x + 0.5)) <= 3
    points = np.stack([rng.integers(-60, 61, 120), rng.integers(-40, 41, 120)], 1)
    near, far = FOCUS + 0.3, FOCUS - 0.25
    wall = Sheet(pattern(y, x), np.full(x.shape, far))
    front = Sheet(np.where(post(y, x), 0.0, pattern(y, x)), np.where(post(y, x), near, far))
    surfaces = [rays.Plane(near, lambda y, x: np.zeros(len(x)), post), rays.Plane(far, pattern)]
    nodes = np.array([far, far + 0.01, near - 0.005, near + 0.005])
    out.append(("post of 7 px, rho 30, before a checker of 32 px, rho -25", ((2.4, 2.0), (0.8, None)), Scene([front, wall], surfaces, nodes, points, 121)))
    distance, last = 1 / (FOCUS + 0.2), 1 / (FOCUS + 0.3)
    radius = distance - last
    f = 35.0 / np.tan(np.arcsin(radius / distance))             # px; the silhouette has a radius of 35 px
    s2 = (x ** 2 + y ** 2) / f ** 2
    root = 1 - (1 + s2) * (1 - (radius / distance) ** 2)
    v, cover = (1 + s2) / (distance * (1 - np.sqrt(np.maximum(root, 0)))), np.clip(disc_area(35.0, y, x), 0, 1)
    points = np.stack([rng.integers(-60, 61, 160), rng.integers(-60, 61, 160)], 1)
    for at in (-25, 15):
        low = FOCUS + at / BLUR
        wall = Sheet(pattern(y, x), np.full(x.shape, low))
        front = Sheet(np.full(x.shape, 0.3), v, cover)
        surfaces = [rays.Ball(radius, distance, 0.3, f, BLUR / f), rays.Plane(low, pattern)]
        nodes = np.concatenate([[low, low + 0.01], np.arange(v[cover > 0].min() - 0.001, v.max() + 0.01, 0.01)])
        out.append((f"ball, rho 20 to 30, before a checker of 32 px, rho {at}", ((3.0, 2.0), (0.8, None)), Scene([front, wall], surfaces, nodes, points, 121)))
    return out


def shallow_ball():
    """A black ball whose front spans 6.5 px of blur (rho 20.5 to 27) before a checker of rho 20: slabs of its rim are not apart from those of the wall."""
    y, x = np.mgrid[-145:146, -145:146]
    rim, last, low = FOCUS + 0.205, FOCUS + 0.27, FOCUS + 0.2
    distance = 1 / rim
    radius = distance - 1 / last
    f = 35.0 / np.tan(np.arcsin(radius / distance))
    s2 = (x ** 2 + y ** 2) / f ** 2
    root = 1 - (1 + s2) * (1 - (radius / distance) ** 2)
    v, cover = (1 + s2) / (distance * (1 - np.sqrt(np.maximum(root, 0)))), np.clip(disc_area(35.0, y, x), 0, 1)
    pattern = rays.checker(24)
    sheets = [Sheet(np.zeros(x.shape), np.where(cover > 0, v, low), cover), Sheet(pattern(y, x), np.full(x.shape, low))]
    rng = np.random.default_rng(11)
    random, border = rng.integers(-60, 61, (120, 2)), np.stack([rng.integers(-40, 41, 60), rng.integers(45, 49, 60)], 1)
    surfaces = [rays.Ball(radius, distance, 0.0, f, BLUR / f), rays.Plane(low, pattern)]
    nodes = np.arange(low - 0.002, v[cover > 0].max() + 0.01, 0.01)
    scene = Scene(sheets, surfaces, nodes, np.concatenate([random, border, border[:, ::-1]]), 163, line=128)
    return [("ball, rho 20.5 to 27, before a checker of 24 px, rho 20", ((3.0, 2.0), (0.8, None)), scene)]


def three_surfaces():
    """A near disc (rho 20), a disc behind it (rho 10) and a slanted plane (rho 0 to 3), checkers of 8 px on all."""
    y, x = np.mgrid[-150:151, -150:151]
    near = lambda y, x: (np.floor(y + 0.5) + 15) ** 2 + (np.floor(x + 0.5) + 15) ** 2 <= 900
    middle = lambda y, x: (np.floor(y + 0.5) - 15) ** 2 + (np.floor(x + 0.5) - 10) ** 2 <= 900
    c = rays.checker(8)
    tilt, at = 0.02 / BLUR, FOCUS + 0.015
    v = np.clip(at + tilt * x, FOCUS - 0.05, None)
    top = np.where(near(y, x), FOCUS + 0.2, np.where(middle(y, x), FOCUS + 0.1, v))
    sheets = [Sheet(c(y, x), top), Sheet(c(y, x), np.where(middle(y, x), FOCUS + 0.1, v), near(y, x) * 1.0),
              Sheet(c(y, x), v, (near(y, x) | middle(y, x)) * 1.0)]
    surfaces = [rays.Plane(FOCUS + 0.2, c, near), rays.Plane(FOCUS + 0.1, c, middle), rays.Plane(at, c, slope=tilt)]
    nodes = np.concatenate([np.arange(FOCUS - 0.05, FOCUS + 0.055, 0.01), FOCUS + np.array([0.095, 0.105, 0.195, 0.205])])
    points = np.random.default_rng(7).integers(-55, 56, (200, 2))
    return [("near disc, middle disc, slanted plane, checker 8", ((18.0, 13.1), (5.0, None)), Scene(sheets, surfaces, nodes, points, 121))]
