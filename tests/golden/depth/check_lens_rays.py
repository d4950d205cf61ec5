#!/usr/bin/env python3
"""Films of the program against rays through its built-in Double Gauss: `check_lens_rays.py LENSCUBE [FOLDER]`, three minutes of CPU; FOLDER keeps lens packs.

NumPy and zarr. 587.56 nm, focus 2 m, the film as far from the paraxial image as in the design. The program traces the lens near the distances of the
scenes only, and the packs are put together: no surface lies between the groups of nodes. The truth (lens_rays.py) uses nothing of the program: 1e5
rays a film point, occlusion by geometry. Film pixels of 8 um for the ball, of 32 um for textures: rays have no diffraction, which takes 1 to 3 %
of the contrast of a texture of 8 px at 8 um, and a quarter of that at 32 um (row "parallel plane").

Where two textured surfaces are out of focus a product of two means over the pupil is not the mean of the product: its error, from the same rays, stands beside
the film's. The lens has spherical aberration, 60 um at the pupil's rim on the paraxial film, balanced at the film of the design: a ball's shadow is not the
overlap of two discs by up to 1 %, and what is "in focus" still has a blur of a pixel.
"""
import sys
import tempfile
from pathlib import Path

import numpy as np

import lens_pack
from closed_forms import overlap
from double_gauss import DoubleGauss
from lens_rays import Ball, LensRays, Plane, light
from program import Program
from rows import Table

UM, FOCUS, FILM, CHART = 0.5875618, 0.5, 401, 601
BALL, BALL_AT = 0.005, 1.0                                  # radius and distance of the black ball, m
DISC_PX = 40.2                                              # radius of the near disc
SLOPE, MIDDLE_PX, REACH_PX = 0.02, 4.5, 60                  # slanted plane: change of blur radius per px, blur on the axis, half width
HALF = 1e-4                                                 # half width of a group of nodes about one distance, 1/m

program = Program(sys.argv[1])
scratch = tempfile.TemporaryDirectory()
folder = Path(sys.argv[2] if len(sys.argv) > 2 else scratch.name)
designed = DoubleGauss(0.0)
rays = LensRays(FOCUS, UM, designed.gaps[-1] - designed.film_gap)
table = Table("depth: films of the program against rays through the Double Gauss")
index = np.arange(CHART) - CHART // 2
y, x = np.meshgrid(index, index, indexing="ij")             # chart pixels from the axis
white = np.ones(y.shape)


class Setting:
    """Film of `pitch_um`, the lens traced for `groups` (lowest, highest) of vergence up to `height_mm` off the axis."""

    def __init__(self, pitch_um, height_mm, groups):
        self.pitch_um, self.pitch, self.blur = pitch_um, pitch_um * 1e-3, rays.lens.diameter / 2 * rays.f_d / pitch_um
        parts = []
        for i, (low, high) in enumerate(groups(self)):
            parts.append(folder / f"{pitch_um}-{i}.lens.zarr")
            if not parts[-1].exists():
                depths = f"{1 / high:.9f}:{1 / low:.9f}"
                program.run("lens", "trace", "double-gauss-28", parts[-1], "--focus-m", 1 / FOCUS, "--depths-m", depths, "--wavelengths", UM * 1e3,
                            "--film-pitch-um", pitch_um, "--max-height-mm", height_mm, "--heights", f"0,{height_mm / 2},{height_mm}",
                            "--energy", 0.999, "--max-nodes", 64000)
        self.lens = folder / f"{pitch_um}.lens.zarr"
        nodes = lens_pack.join(self.lens, parts)
        print(f"  pixels of {pitch_um} um, depth nodes at a blur radius of {', '.join(f'{self.blur * (v - FOCUS):.2f}' for v in nodes)} px")

    def at(self, px):
        """Vergence of the blur radius `px`."""
        return FOCUS + px / self.blur

    def film(self, points, sheets):
        """Film at `points` (N, 2), px (y, x) from the axis."""
        first = points.min(0) + FILM // 2
        found = program.film(self.lens, UM * 1e3, sheets, self.pitch_um, (FILM, FILM), roi=(*first, *(np.ptp(points, axis=0) + 1)))
        return found[tuple((points + FILM // 2 - first).T)]

    def truth(self, points, scenes):
        """(truth, product of means) of each of `scenes` at every film point: (scenes, points, 2)."""
        bundles = (rays.bundle(column * self.pitch, row * self.pitch) for row, column in points)
        return np.array([[light(surfaces, *bundle) for surfaces in scenes] for bundle in bundles]).swapaxes(0, 1)

    def plane(self, v0, value, slope=0.0, inside=None):
        """Plane whose value and outline are functions of px."""
        of_px = lambda f: None if f is None else lambda y, x: f(y / self.pitch, x / self.pitch)
        return Plane(rays.f_d, v0, of_px(value), slope / self.pitch, of_px(inside))


def squares(side):
    """Checker of squares of `side` px, 0 and 1, as a function of px."""
    return lambda y, x: ((np.floor((y + 0.5) / side) + np.floor((x + 0.5) / side)) % 2 == 0) * 1.0


def figures(name, difference, limit, stated=None):
    table.below(f"{name}: max, %", 100 * abs(difference).max(), limit, stated)
    table.below("    rms, %", 100 * np.sqrt((difference ** 2).mean()), limit / 2)


def ball():
    film = Setting(8, 2.4, lambda s: [(FOCUS - HALF, FOCUS + HALF), (1 / BALL_AT, 1.0001 / (BALL_AT - BALL))])
    t = np.array([0.0, 173, 260.7, 338.9, 434.4, 520, 695]) / 4              # px of 8 um
    points = np.stack([np.zeros(7, int), np.round(t).astype(int)], 1)
    tan2 = (x ** 2 + y ** 2) * (film.pitch / rays.f_d) ** 2
    a, root = 1 + tan2, BALL_AT ** 2 - (1 + tan2) * (BALL_AT ** 2 - BALL ** 2)
    seen = root > 0
    front = np.where(seen, a / (BALL_AT - np.sqrt(np.maximum(root, 0))), FOCUS)
    found = film.film(points, [(np.where(seen, 0, white), front), (white, FOCUS * white)])
    surfaces = [Ball(BALL, BALL_AT), film.plane(FOCUS, lambda y, x: np.ones_like(x))]
    expected = film.truth(points, [surfaces])[0, :, 0]
    radius, pupil = BALL * rays.f_d / film.pitch, film.blur / 2
    for (_, column), e, value in zip(points, expected, found):
        discs = 1 - overlap(radius, pupil, float(column)) / (np.pi * pupil ** 2)
        table.near(f"black ball, {4 * column} px of 2 um from its image (overlap of two discs: {discs:.4f})", e, value, 5e-3)
    share = lambda r: 1 - (r.open_radius(BALL, BALL_AT) / (r.lens.diameter / 2)) ** 2
    table.near("  on the axis: rays forwards, rays backwards", share(rays), expected[0], 2e-4)
    paraxial = LensRays(FOCUS, UM)
    table.near("  the same with the film in the paraxial image", share(paraxial), light(surfaces, *paraxial.bundle(0.0, 0.0))[0], 3e-4)


def textures():
    reach = SLOPE * REACH_PX
    film = Setting(32, 3, lambda s: [(s.at(px) - HALF, s.at(px) + HALF) for px in (-20, 0)] + [(s.at(MIDDLE_PX - reach), s.at(MIDDLE_PX + reach))]
                   + [(s.at(px) - HALF, s.at(px) + HALF) for px in (10, 20)])
    two_planes(film)
    points = np.random.default_rng(6).integers(-45, 46, (40, 2))
    checker, middle, slope = squares(8), film.at(MIDDLE_PX), SLOPE / film.blur
    scenes = [[film.plane(middle, checker)], [film.plane(middle, checker, slope)]]
    expected = film.truth(points, scenes)[:, :, 0]
    for name, v, e in (("parallel", middle * white, expected[0]), ("slanted", middle + slope * np.clip(x, -REACH_PX, REACH_PX), expected[1])):
        figures(f"{name} plane, blur {MIDDLE_PX} px on the axis, checker 8: film", film.film(points, [(checker(y, x), v)]) - e, 2.0)


def two_planes(film):
    """A black disc of 40 px radius before a checker; points within 20 px of its edge."""
    zone = np.argwhere(abs(np.hypot(y, x) - DISC_PX) <= 20) - CHART // 2
    points = zone[np.random.default_rng(5).permutation(len(zone))[:40]]
    hidden = np.hypot(y, x) < DISC_PX
    disc = lambda y, x: np.hypot(np.floor(y + 0.5), np.floor(x + 0.5)) < DISC_PX   # of whole chart pixels
    cases = (("near in focus, far 20 px, checker 32", 0, -20, 32), ("far in focus, near 20 px, checker 32", 20, 0, 32),
             ("near 20 px, far 10 px, uniform", 20, 10, 0), ("near 20 px, far 10 px, checker 8", 20, 10, 8),
             ("near 20 px, far 10 px, checker 32", 20, 10, 32), ("near 20 px, far -20 px, checker 32", 20, -20, 32))
    films, scenes = [], []
    for _, near, far, side in cases:
        pattern, low, high = squares(side) if side else lambda y, x: np.ones(np.shape(x)), film.at(far), film.at(near)
        rear = pattern(y, x)
        films.append(film.film(points, [(np.where(hidden, 0.0, rear), np.where(hidden, high, low)), (rear, low * white)]))
        scenes.append([film.plane(high, lambda y, x: np.zeros(np.shape(x)), inside=disc), film.plane(low, pattern)])
    for (name, near, *_), found, (expected, product) in zip(cases, films, film.truth(points, scenes).transpose(0, 2, 1)):
        # The correction does not know the blur that the lens has in focus.
        figures(f"two planes, {name}, product of means {100 * abs(product - expected).max():.1f} %: film", found - expected, 2.0 if near else 6.0)


for check in (ball, textures):
    check()
table.end()
