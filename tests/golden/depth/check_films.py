#!/usr/bin/env python3
"""Films of the program before a thin lens against closed forms and rays: `check_films.py LENSCUBE`, a minute.

NumPy and zarr. The lens is a pack whose nodes are discs of blur |V - V_f|, integrated exactly over film pixels; so the program has what the float64 model
has in test_depth_reference.py, and the same limits apply. The truth is closed_forms.py and the rays of ray_integral.py, which know no slabs.
"""
import sys
import tempfile
from pathlib import Path

import numpy as np

import lens_pack
import scenes
from closed_forms import disc_area, disc_kernel, edge_profile, overlap
from program import Program
from rows import Table

program = Program(sys.argv[1])
tmp = tempfile.TemporaryDirectory()
table = Table("depth: films of the program, thin lens")
BLUR, FOCUS = scenes.BLUR, scenes.FOCUS
PITCH_UM, REACH_MM, NM = 2.0, 1.5, 500.0
GOLDEN = Path(__file__).parent / "packs" / "six-slabs.lens.zip"


def thin_lens(nodes, blur=BLUR, focus=FOCUS):
    """Pack of a thin lens without distortion and fall-off."""
    h = np.linspace(0, REACH_MM, 2)
    kernels = [np.stack([disc_kernel(blur * abs(v - focus))] * 2).astype(np.float32) for v in nodes]
    band = dict(h_real=h, h_ideal=h, ri=np.ones(2), delta_mm=np.zeros(2), ratio=np.ones((len(nodes), 2)), vergence=np.asarray(nodes, float), kernels=kernels)
    out = Path(tmp.name) / "thin.lens.zip"
    lens_pack.write(out, [band], h, focus, blur, PITCH_UM)
    return out


def film(nodes, sheets, shape, *flags, blur=BLUR, focus=FOCUS, **kw):
    return program.film(thin_lens(nodes, blur, focus), NM, sheets, PITCH_UM, shape, *flags, **kw)


def half_plane():
    """Near half plane of blur 20 px, its edge at column -1/2, before black and before a texture in focus."""
    nodes = [FOCUS, FOCUS + 0.01, FOCUS + 0.2, FOCUS + 0.21]
    columns = np.arange(-80, 81)
    texture = np.random.default_rng(3).random((81, 161)).astype(np.float32).astype(float)
    near = np.broadcast_to(columns >= 0, texture.shape)
    v = np.where(near, FOCUS + 0.2, FOCUS)
    behind = lambda chart: (chart, np.full(chart.shape, FOCUS))
    tau = (np.arange(-30, 31) + 0.5) / 20
    profile = edge_profile(tau)
    found = film(nodes, [(near * 1.0, v), behind(0 * texture)], (21, 61))
    for at in (0, 0.25, 0.5, 0.75):
        table.near(f"white half plane of 20 px blur before black, x = {at} rho", edge_profile(at), np.interp(at, tau, found[10]), 1e-3)
    table.below("the same, every column against A((x + 1/2)/rho)", abs(found - profile).max(), 2e-6)
    found = film(nodes, [(np.where(near, 1.0, texture), v), behind(texture)], (21, 61))
    table.below("the same before a texture in focus: A + texture (1 - A)", abs(found - profile - (1 - profile) * texture[30:51, 50:111]).max(), 2e-6)
    found = film(nodes, [(near * 1.0, v)], (21, 61), invented=True)
    table.below("the same, black behind the edge invented", abs(found - profile).max(), 2e-6)
    between = [FOCUS, FOCUS + 0.01, FOCUS + 0.195, FOCUS + 0.205]
    found = film(between, [(near * 1.0, v), behind(0 * texture)], (21, 61))
    table.below("half-way between nodes 1 px apart", abs(found - profile).max(), 1e-3)


def chart_of_ones():
    """Complete sheets of ones through kernels without symmetry: between the least and the greatest 1 * P_d of the pixel's nodes."""
    shape, rng = (150, 160), np.random.default_rng(2)
    blocks = lambda low, high: np.kron(rng.uniform(low, high, (20, 20)), np.ones((9, 9)))[:176, :176]
    nodes = np.array([0.0, 0.2, 0.5, 0.93, 1.3, 1.6, 2.0])
    ones = np.ones((176, 176))
    alone = [program.film(GOLDEN, NM, [(ones, np.full(ones.shape, v))], PITCH_UM, shape, stages="svpsf") for v in nodes]
    low, high = np.min(alone, axis=0), np.max(alone, axis=0)
    far = 0.25 * ones
    holes = [(ones, blocks(1, 2), blocks(0, 1)), (ones, blocks(0.3, 0.9), blocks(0, 1)), (ones, far)]
    tilted = [(ones, 1 + 0.01 * (np.arange(176) - 88) * ones), (ones, far * 0)]
    maps = (("random blocks", [(ones, blocks(0, 2)), (ones, far * 0)]), ("sheets with holes", holes), ("tilted plane", tilted))
    for name, sheets in maps:
        found = program.film(GOLDEN, NM, sheets, PITCH_UM, shape, stages="svpsf")
        outside = max((low - found).max(), (found - high).max(), 0)
        table.below(f"chart of ones, {name}: outside the range of 1 * P ({low.min():.4f} to {high.max():.4f})", outside, 2e-6)


def black_ball():
    """The ball of DEPTH as a disc 1 m from a thin lens of the Double Gauss's pupil and focal length, pixels of 8 um."""
    f, aperture = 104.27 / 8e-3, 33.33e-3 / 2
    blur = f * aperture
    radius, pupil = 5e-3 * f, blur * 0.5
    t = np.array([0.0, 173, 260.7, 338.9, 434.4, 520, 695]) / 4
    expected = [1 - overlap(radius, pupil, at) / (np.pi * pupil ** 2) for at in t]
    y, x = np.mgrid[-180:181, -290:291]
    wall = (np.ones(x.shape), np.full(x.shape, 0.5))
    ball = (np.zeros(x.shape), np.ones(x.shape), np.clip(disc_area(radius, y, x), 0, 1))
    found = film([0.5, 0.505, 1.0, 1.001], [ball, wall], (41, 361), blur=blur, focus=0.5)[20, 180:]
    for at, e in zip(t, expected):
        table.near(f"black ball as a disc, {4 * at:g} px of 2 um from its image", e, np.interp(at, np.arange(181), found), 2e-4)


def against_rays():
    for name, limits, scene in scenes.two_planes() + scenes.slanted_planes() + scenes.post_and_ball() + scenes.shallow_ball() + scenes.three_surfaces():
        sheets = [(q.chart, q.vergence) if q.coverage is None else (q.chart, q.vergence, q.coverage) for q in scene.sheets]
        scenes.rows(table, name, limits, scene, film(scene.nodes, sheets, (scene.size, scene.size), invented=scene.invented))


for check in (half_plane, chart_of_ones, black_ball, against_rays):
    check()
table.end()
