"""Checks the float64 model of depth against closed forms and rays: `python tests/golden/depth/test_depth_reference.py` (NumPy; a minute).

Films of ones, of black and white and of checkers of contrast 1, so errors are shares of the peak.
"""
import numpy as np

import depth_reference as depth
import ray_integral as rays
import scenes
from closed_forms import disc_area, disc_kernel, edge_profile, overlap, thin_lens
from depth_reference import Sheet, ref
from hidden_surface import extrapolate, support
from rows import Table
from scenes import BLUR, FOCUS

table = Table("depth: the float64 model")


def random_lens(rng, windows=(7, 11, 15, 9)):
    """Kernels without symmetry, distortion, fall-off; four nodes."""
    t, grid = np.linspace(0, 0.25, 200), []
    for n in windows:
        k = rng.random((4, n, n)) ** 3
        grid.append(ref.quarter_rotations(k / k.sum((1, 2), keepdims=True)))
    r_grid = [np.array([0, 0.05, 0.11, 0.25])] * len(windows)
    return depth.Lens(t * (1 + 0.1 * t), t, 1 - t, np.array([0.0, 0.4, 0.7, 1.0]), r_grid, grid, 20.0, 0.4)


def constant_depth():
    rng = np.random.default_rng(1)
    lens, chart = random_lens(rng), rng.random((90, 101))
    flat = [ref.film(chart, (48, 57), 2e-3, lens.h_ideal, lens.h_real, lens.ri, lens.r_grid[0], g, (20.5, 31.0)) for g in lens.grid]
    at = lambda v, **kw: depth.film([Sheet(chart, np.full(chart.shape, v))], lens, (48, 57), 2e-3, (20.5, 31.0), **kw).light
    table.below("constant depth at a node: the flat film by brute force", abs(at(0.4) - flat[1]).max(), 1e-13)
    table.below("constant depth between nodes: the mean of two flat films", abs(at(0.52) - 0.6 * flat[1] - 0.4 * flat[2]).max(), 1e-13)
    table.below("constant depth, surfaces behind depth edges invented: the same", abs(at(0.52, invented=True) - at(0.52)).max(), 1e-15)
    small = ref.film(chart, (48, 57), 2e-3, lens.h_ideal, lens.h_real, lens.ri, lens.r_grid[0], lens.grid[2], scale=(0.7, 0.55))
    found = depth.film([Sheet(chart, np.full(chart.shape, 0.7))], lens, (48, 57), 2e-3, scale=(0.7, 0.55)).light
    table.below("constant depth at scale 0.7, 0.55", abs(found - small).max(), 1e-12)


def chart_of_ones():
    rng = np.random.default_rng(2)
    shape, ones, block = (60, 70), np.ones((120, 130)), np.kron(rng.random((12, 13)), np.ones((10, 10)))
    near, far = np.where(block > 0.6, 0.75 + 0.2 * rng.random(block.shape), 0.3 * block), np.full(block.shape, 0.1)
    sheets = [Sheet(ones, near, 0.5 + 0.5 * np.kron(rng.random((12, 13)) > 0.2, np.ones((10, 10)))), Sheet(ones, far + 0.2, block), Sheet(ones, far)]
    lens = random_lens(rng)
    flat = depth.Lens(lens.h_real, lens.h_real, np.ones(200), lens.vergence, lens.r_grid, lens.grid, lens.blur_px, lens.focus)
    alone = [Sheet(ones, near)]
    for name, some, invented in (("three sheets", sheets, False), ("sheet 0 alone", alone, False), ("invented sheet", alone, True)):
        film = depth.film(some, flat, shape, 2e-3, invented=invented)
        spread = [depth.Spread(shape, 7, 2e-3, (29.5, 34.5), r, g, "error")(np.ones((74, 84))) for r, g in zip(flat.r_grid, flat.grid)]
        complete = some is sheets
        out = max(np.min(spread) - film.light.min() if complete else 0.0, film.light.max() - np.max(spread), 0.0)
        table.below(f"chart of ones, any PSF, {name}: {'outside' if complete else 'above'} the range of 1 ∗ P", out, 1e-13)
        worst = max(max((w - u).max(), (u - np.maximum(w, 1)).max(), -w.min(), 0.0) for _, _, w, u in film.slabs)
        table.below(f"0 <= w <= U <= max(1, w), {name}: outside", worst, 1e-13)
        nodes = thin_lens([0.0, 0.05, 0.4, 0.7, 0.8, 1.0], 20.0, 0.4)
        light = depth.film(some, nodes, shape, 1.0, invented=invented).light
        off = abs(light - 1).max() if complete else light.max() - 1
        table.below(f"chart of ones, discs, {name}: {'from' if complete else 'above'} 1", off, 1e-12)


def half_plane():
    """Near half plane of blur 20 px, edge at column -1/2, before black and before a texture in focus."""
    lens = thin_lens([FOCUS, FOCUS + 0.01, FOCUS + 0.2, FOCUS + 0.21], BLUR, FOCUS)
    rng, columns = np.random.default_rng(3), np.arange(-80, 81)
    texture = rng.random((81, 161))
    near = np.broadcast_to(columns >= 0, texture.shape)
    v = np.where(near, FOCUS + 0.2, FOCUS)
    behind = lambda chart: Sheet(chart, np.full(chart.shape, FOCUS))
    profile = edge_profile((np.arange(-30, 31) + 0.5) / 20)
    film = lambda sheets, **kw: depth.film(sheets, lens, (21, 61), 1.0, **kw).light
    found = film([Sheet(near * 1.0, v), behind(0 * texture)])
    for tau in (0, 0.25, 0.5, 0.75):
        at = np.interp(tau, (np.arange(-30, 31) + 0.5) / 20, found[10])
        table.near(f"white half plane of 20 px blur before black, x = {tau} rho", edge_profile(tau), at, 1e-3)
    table.below("the same, every column against A((x + 1/2)/rho)", abs(found - profile).max(), 1e-12)
    found = film([Sheet(np.where(near, 1.0, texture), v), behind(texture)])
    expected = profile + (1 - profile) * texture[30:51, 50:111]
    table.below("the same before a texture in focus: A + texture (1 - A)", abs(found - expected).max(), 1e-12)
    # Two chart pixels per film pixel; the edge is half-way across film column 0.
    fine = np.broadcast_to(np.arange(-160, 162) >= 1, (162, 322))
    found = film([Sheet(fine * 1.0, np.where(fine, FOCUS + 0.2, FOCUS)), behind(np.zeros(fine.shape))], scale=(0.5, 0.5))
    expected = (profile + edge_profile((np.arange(-30, 31) - 0.5) / 20)) / 2
    table.below("scale 0.5, edge inside a film pixel: mean of two profiles", abs(found - expected).max(), 1e-12)
    slab = thin_lens([FOCUS, FOCUS + 0.01, FOCUS + 0.195, FOCUS + 0.205], BLUR, FOCUS)
    found = depth.film([Sheet(near * 1.0, v), behind(0 * texture)], slab, (21, 61), 1.0).light
    table.below("half-way between nodes 1 px apart, bare discs", abs(found - profile).max(), 1e-3)


def black_ball():
    """A ball of 5 mm, 1 m from the pupil, before a white wall in focus at 2 m: the built-in Double Gauss (D 33.33 mm, f_D 104.27 mm, 2 um)."""
    f, aperture = 104.27 / 2e-3, 33.33e-3 / 2
    blur = f * aperture
    radius_px, pupil_px = 5e-3 * f, blur * 0.5
    at = np.array([0.0, 173, 260.7, 338.9, 434.4, 520, 695])
    expected = np.array([1 - overlap(radius_px, pupil_px, t) / (np.pi * pupil_px ** 2) for t in at])
    for t, stated, e in zip(at, (0.6399, 0.6399, 0.6934, 0.7603, 0.8431, 0.9108, 1.0), expected):
        table.near(f"black ball, closed form at {t:g} px", stated, e, 5e-4)
    points = np.stack([np.zeros(7), at], 1)
    ball = rays.Ball(5e-3, 1.0, 0.0, f, aperture)
    wall = rays.Plane(0.5, lambda y, x: np.ones(len(x)))
    truth = rays.film_points(points, [ball, wall], blur, 0.5)
    table.below("black ball: rays against the closed form", abs(truth - expected).max(), 1e-3, 7e-4)
    reach = 264
    y, x = np.mgrid[-reach - 436:reach + 437, -reach - 436:701 + 436]
    wall = Sheet(np.ones(x.shape), np.full(x.shape, 0.5))
    cover = disc_area(radius_px, y, x)
    frame = dict(shape=(1, 700), pitch=1.0, axis=(0.0, 0.0), center=((y[0, 0] + y[-1, 0]) / 2, (x[0, 0] + x[0, -1]) / 2))
    flat = depth.film([Sheet(np.zeros(x.shape), np.ones(x.shape), cover), wall], thin_lens([0.5, 0.505, 1.0, 1.001], blur, 0.5), **frame).light[0]
    found = np.interp(at, np.arange(700), flat)
    table.below("black ball as a disc at 1 m: the model against the closed form", abs(found - expected).max(), 1e-4)
    # Its front: 1/z = (1 - sqrt(1 - q))/..., nearer than the silhouette by up to 1.005 D: the slope of the surface is left out by the model.
    s2 = np.minimum((x ** 2 + y ** 2) / f ** 2, 0.999 * 5e-3 ** 2)
    front = (1 - np.sqrt(1 - (1 + s2) * (1 - 5e-3 ** 2))) / (1 + s2)
    nodes = [0.5, 0.505, 0.999, 1.0015, 1.004, 1.0065]
    round_ = depth.film([Sheet(np.zeros(x.shape), 1 / front, cover), wall], thin_lens(nodes, blur, 0.5), **frame).light[0]
    table.below("black ball with the depths of its front: against rays", abs(np.interp(at, np.arange(700), round_) - truth).max(), 1e-2)


def against_rays():
    for name, limits, scene in scenes.two_planes() + scenes.slanted_planes() + scenes.post_and_ball() + scenes.shallow_ball() + scenes.three_surfaces():
        film = depth.film(scene.sheets, thin_lens(scene.nodes, BLUR, FOCUS), (scene.size, scene.size), 1.0, invented=scene.invented).light
        scenes.rows(table, name, limits, scene, film)


def tilted_panel():
    """A black panel tilted through eight slabs before a white wall in focus: the invented sheet stands for the given one behind all of it.

    Where the panel's own farther part is beyond the gap, some of it is extrapolated as well: hence the limit.
    """
    y, x = np.mgrid[-50:110, -50:110]
    panel, wall = (abs(x - 30) < 16) & (abs(y - 30) < 26), np.full(x.shape, FOCUS)
    v = np.where(panel, FOCUS + 0.2 + 0.0025 * (x - 30), wall)
    lens = thin_lens(np.append([FOCUS, FOCUS + 0.01], np.arange(FOCUS + 0.155, FOCUS + 0.25, 0.01)), BLUR, FOCUS)
    front, rear = Sheet(np.where(panel, 0.0, 1.0), v), Sheet(np.ones(x.shape), wall)
    given = depth.film([front, rear], lens, (60, 60), 1.0).light
    invented = depth.film([front], lens, (60, 60), 1.0, invented=True).light
    table.below("tilted panel before a uniform wall: invented sheet against the given one", abs(invented - given).max(), 0.05)


def extrapolation():
    rng = np.random.default_rng(8)
    a = (rng.random((90, 100)) > 0.9) * 1.0
    values = [rng.random(a.shape) * a, rng.random(a.shape) * a]
    light, vergence, found = extrapolate(a, *values, 9)
    # Weights that leave the array are lost: pixels that depend on it alone are compared.
    moved = extrapolate(np.pad(a, ((5, 0), (3, 0))), *(np.pad(v, ((5, 0), (3, 0))) for v in values), 9)
    inside = np.s_[support(9):-support(9), support(9):-support(9)]
    shifted = max(abs(m[5:, 3:] - v)[inside].max() for m, v in zip(moved, (light, vergence)))
    table.below("extrapolation: another first pixel of the array", shifted, 1e-15)
    table.below("extrapolation: known pixels keep their value", abs((light - values[0])[a == 1]).max(), 1e-15)
    table.below("extrapolation of ones: from 1", abs(extrapolate(a, a, a, 9)[0][found] - 1).max(), 1e-14)


def noise_behind_discs():
    """Two near discs, one at the corner of the smaller film, before noise in focus: film, larger film, film that begins elsewhere."""
    y, x = np.mgrid[:220, :220]
    near = (np.hypot(y - 110.2, x - 104.7) < 24) | (np.hypot(y - 60, x - 57) < 20)
    sheet = Sheet(np.random.default_rng(9).random(y.shape), np.where(near, FOCUS + 0.2, FOCUS))
    lens = thin_lens([FOCUS, FOCUS + 0.01, FOCUS + 0.195, FOCUS + 0.205], BLUR, FOCUS)
    film = lambda size, axis: depth.film([sheet], lens, (size, size), 1.0, (axis, axis), invented=True)
    small, large, moved = film(100, 49.5), film(131, 62.5), film(101, 50.5)
    table.below("invented surfaces: a film of another size", abs(large.light[13:113, 13:113] - small.light).max(), 1e-12)
    table.below("invented surfaces: a film that begins elsewhere", abs(moved.light[1:, 1:] - small.light).max(), 1e-12)


def uncovered_pixels():
    """A noisy disc in a sheet with coverage before a wall, at places between pixels: what is stored where the coverage is 0 does not matter."""
    rng = np.random.default_rng(10)
    y, x = np.mgrid[-60:61, -60:61]
    cover, light = np.clip(20.5 - np.hypot(y - 0.3, x + 0.2), 0, 1), rng.random(y.shape)
    lens = thin_lens([FOCUS, FOCUS + 0.01, FOCUS + 0.195, FOCUS + 0.205], BLUR, FOCUS)
    wall = Sheet(np.ones(y.shape), np.full(y.shape, FOCUS))
    film = lambda light, v, **kw: depth.film([Sheet(light, v, cover), wall], lens, (51, 51), 1.0, (25.4, 24.9), **kw).light
    near = np.full(y.shape, FOCUS + 0.2)
    for name, kw in (("bicubic", {}), ("bilinear", dict(method="bilinear")), ("scale 0.7", dict(scale=(0.7, 0.7)))):
        plain = film(light, near, **kw)
        changed = film(np.where(cover > 0, light, 1e9), np.where(cover > 0, near, np.nan), **kw)
        table.below(f"light and distances where the coverage is 0, {name}: change of the film", abs(changed - plain).max(), 0.0)
    # In one sheet without coverage: a white disc on a black wall has the film of a white sheet with coverage.
    white, inside = np.ones(y.shape), cover >= 0.5
    both = [Sheet(np.where(inside, 1.0, 0.0), np.where(inside, near, FOCUS)), Sheet(0 * white, np.full(y.shape, FOCUS))]
    alone = [Sheet(white, near, inside * 1.0), Sheet(0 * white, np.full(y.shape, FOCUS))]
    a, b = (depth.film(s, lens, (51, 51), 1.0, (25.4, 24.9)).light for s in (both, alone))
    table.below("a surface beside another one in a sheet: as in a sheet of its own", abs(a - b).max(), 1e-14)


assert abs(disc_kernel(7.3).sum() - 1) < 1e-14
for check in (constant_depth, chart_of_ones, half_plane, black_ball, against_rays, tilted_panel, extrapolation, noise_behind_discs,
              uncovered_pixels):
    check()
table.end()
