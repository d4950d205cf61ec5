#!/usr/bin/env python3
"""Scenes of meshes and their films, through the program, against closed forms and drawn charts: `check_scene_films.py LENSCUBE [FOLDER [CHECK…]]`, four
minutes; FOLDER keeps meshes, packs and films.

NumPy and zarr. Camera frame: x right, y down, z along the axis, m; V = 1/z in 1/m. A pinhole of focal length f_D mm sees at column c and row r of a chart of
W x H pixels of p mm the direction ((c - (W-1)/2) p/f_D, (r - (H-1)/2) p/f_D, 1), so that V of the plane n X = k is n d/k, linear in column and row; the mean
over a pixel is that of its centre. A matt surface of reflectance rho in light of E lx has the weight rho E cos/E_v, E_v lx being --illuminance.
Light of sheets with coverages c_q: sum of c_q (1 - c_0) ... (1 - c_q-1) light_q. Films are without fall-off of light (--stages distortion,svpsf).
"""
import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import zarr

import lens_pack
from closed_forms import disc_area
from double_gauss import DoubleGauss
from lens_rays import Ball, LensRays, Plane, light
from meshes import BLACK, colour, glb, icosphere, png, quad, wall
from program import Program
from rows import Table
from views import Files, Sheets, View

program = Program(sys.argv[1])
scratch = tempfile.TemporaryDirectory()
folder = Path(sys.argv[2] if len(sys.argv) > 2 else scratch.name)
folder.mkdir(parents=True, exist_ok=True)
table = Table("scenes of meshes and their films")
files = Files(program, folder)
View = partial(View, files)
exported, plain_group, measured, white = files.exported, files.plain_group, files.measured, files.white
TURN = [0.36, -0.48, 0.64, 0.48]                            # a rotation as a quaternion x, y, z, w of length 1


def drawn_scene():
    """The scene that `gen:depth-scene` draws, in triangles with the same corners in the picture: wall, floor, disc of 18 spokes, black ball (a closed surface)."""
    near, far, nm = 0.1, 0.3, 550
    view = View("phone", 0.18, (240, 300), 2, f"{near}:{far}")
    (h, w), m, short = view.shape, view.margin, 240
    drawn = f"gen:depth-scene?size=300x240&overscan={m}&near_m={near}&far_m={far}&wavelengths={nm}&pitch_um=2"
    chart, depth, coverage, hidden, _ = (exported(f"{drawn}&part={p}").reshape(h, w) for p in ("chart", "depth", "coverage", "hidden", "hidden-depth"))
    horizon = np.round(m + 0.45 * 240 + 0.5) - 0.5
    span, v_near, v_far = h - 1 - horizon, 1 / near, 1 / far
    parts = []

    def cell(material, *corners):
        parts.append(quad(material, *(view.place(*c) for c in corners)))
    side = short / 10
    for i in range(int(np.ceil((horizon + 0.5) / side))):
        for j in range(int(np.ceil(w / side))):
            x, y = side * j - 0.5, horizon - side * i
            cell("wall_light" if (i + j) % 2 else "wall_dark", (x, y - side, v_far), (x + side, y - side, v_far), (x + side, y, v_far), (x, y, v_far))
    step, rng = w / 12, v_near - v_far
    length = 0.5 * step * rng / (span * v_near ** 2)
    corner = lambda j, v: ((w - 1) / 2 + j * step * v / v_near, horizon + (v - v_far) / rng * span, v)
    for k in range(-1, 100):                                # row -1 lies below the chart's last row, and has its colour: the last row is near's
        high, low = (max(1 / (near + length * n), v_far) for n in (k, k + 1))
        if low >= high:
            break
        for j in range(-40, 40):
            material = "floor_light" if k < 0 or (j + k) % 2 else "floor_dark"
            cell(material, corner(j, low), corner(j + 1, low), corner(j + 1, high), corner(j, high))
    assert low <= v_far, "more than 100 rows of checks"
    # Disc: sectors of 20 chords. Ball: z = z_b (1 -+ 0.03 cos t) at sin t of its radius.
    at, radius = (m + 0.29 * 300, m + 0.46 * 240), 0.19 * short
    angles = (np.arange(721) - 10) * np.pi / 360
    rim = view.place(at[0] + radius * np.cos(angles), at[1] + radius * np.sin(angles), v_near)
    for k in range(36):
        fan = np.vstack([view.place(*at, v_near)[None], rim[20 * k:20 * k + 21]])
        parts.append(("paper" if k % 2 else "red", fan, [(0, i, i + 1) for i in range(1, 21)]))
    at, radius, n, rings = (m + 0.73 * 300, m + 0.42 * 240), 0.13 * short, 360, 24
    t, a = np.meshgrid(np.pi * np.arange(1, 2 * rings) / (2 * rings), 2 * np.pi * np.arange(n) / n, indexing="ij")
    z_b = 2 / (v_near + v_far)
    points = lambda t, a: view.place(at[0] + radius * np.sin(t) * np.cos(a), at[1] + radius * np.sin(t) * np.sin(a), 1 / (z_b * (1 - 0.03 * np.cos(t))))
    corners = np.vstack([points(t, a).reshape(-1, 3), points(0.0, 0.0)[None], points(np.pi, 0.0)[None]])
    front, back, f = len(corners) - 2, len(corners) - 1, []
    for j in range(n):
        k, last = (j + 1) % n, (2 * rings - 2) * n
        f += [(front, j, k), (back, last + k, last + j)]
        f += [q for i in range(0, last, n) for q in ((i + j, i + n + j, i + n + k), (i + j, i + n + k, i + k))]
    parts.append(("ball", corners, f))
    one, floor = white(nm), hidden[int(horizon) + 2:]       # of two colours, as the disc
    disc = chart[m + 90:m + 130, m + 67:m + 107]
    flags = measured(wall_light=0.7, wall_dark=0.08, floor_light=floor.max() / one, floor_dark=floor.min() / one, paper=0.9, red=disc.min() / one)
    scene = view.scene("drawn", glb(folder / "drawn.glb", parts, {"ball": BLACK}), "--samples-per-px", 64, *flags)
    sheets = Sheets(scene)
    (_, z, c), behind = sheets[0], exported(f"{drawn}&part=hidden-depth").reshape(h, w)
    object_, share = depth < behind - 1e-6, np.where(z < behind * (1 - 1e-3), c, 0)
    table.below("depth scene: share of disc and ball, largest difference", abs(np.where(object_, coverage, 0) - share).max(), 0.08)
    table.below("  sum of it over both, relative", abs(share.sum() / coverage[object_].sum() - 1), 1e-3)
    whole = (c == 1) & (coverage == 1)
    ball = abs(depth / z_b - 1) < 0.031
    table.below("  distances of wall, floor, disc: relative difference", abs(z / depth - 1)[whole & ~(ball & object_)].max(), 2e-6)
    table.below("  distances of the ball, of the mean of 1/z in a pixel", abs(z / depth - 1)[whole & ball & object_].max(), 3e-3)
    found, _ = view.film("drawn-mesh", scene, "--wavelengths", nm)
    expected, _ = view.film("drawn-chart", drawn)
    seen = (coverage * chart + (1 - coverage) * hidden)[m:-m, m:-m]
    shifted = [np.roll(seen, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    edge = np.ptp(shifted, axis=0) > 0.01 * seen.max()
    error = 100 * abs(found - expected)[0] / expected.max()
    table.below(f"  film, outside 1 px of edges ({100 * (~edge).mean():.0f} % of it): % of the peak", error[~edge].max(), 0.5)
    # A hidden surface has, in a pixel that is covered in part, the light of the samples that are left: beside texture in focus up to 4.2 % were found.
    table.below("  film, there: % of the peak", error[edge].max(), 5)


def black_ball():
    """Ball of radius 5 mm at 1 m before a white wall at 2 m in focus, film points t px of 2 um from its image on the axis.

    Through a thin lens of the Double Gauss's pupil and focal length: 1 - area common to two discs/area of one. Through the Double Gauss: rays, since its
    spherical aberration changes these figures by up to 0.01.
    """
    nm, at = 587.5618, np.array([0, 173, 260.7, 338.9, 434.4, 520, 695]) / 4
    parts = [icosphere("ball", (0, 0, 1.0), 5e-3, 5), wall("wall", 2.0, 1.0)]
    mesh, flags = glb(folder / "ball.glb", parts, {"ball": BLACK}), [*measured(wall=1.0), "--near-m", 0.9]     # ten focal lengths are 1.04 m
    designed, ones = DoubleGauss(0.0), lambda y, x: np.ones_like(x)
    rays = LensRays(0.5, nm * 1e-3, designed.gaps[-1] - designed.film_gap)
    surfaces = [Ball(5e-3, 1.0), Plane(rays.f_d, 0.5, ones)]
    truth = [float(light(surfaces, *rays.bundle(t * 8e-3, 0.0))[0]) for t in at]
    for lens, more, expected in (("thin lens", ["--image-plane", "paraxial"], [0.6399, 0.6399, 0.6934, 0.7603, 0.8431, 0.9108, 1]), ("Double Gauss", [], truth)):
        view = View("double-gauss-28", 2, (41, 361), 8, "0.99:2", *more)
        if lens == "thin lens":
            pack = files.thin_lens(view, nm, 33.33e-3, 0.5, [0.5, 0.505, 1.0, 1.0051])
        else:
            groups, pack = [(folder / "far.lens.zarr", "1.9996:2.0004"), (folder / "near.lens.zarr", "0.99497:1")], folder / "joined.lens.zarr"
            for out, depths in groups:
                if not out.exists():
                    program.run("lens", "trace", "double-gauss-28", out, "--focus-m", 2, "--depths-m", depths, "--wavelengths", nm, "--film-pitch-um", 8,
                                "--max-height-mm", 2.4, "--heights", "0,1.2,2.4", "--energy", 0.999, "--max-nodes", 64000)
            shutil.rmtree(pack, ignore_errors=True)
            lens_pack.join(pack, [out for out, _ in groups])
        film = lambda name, chart, *more: view.film(name, chart, *more, pack=pack)[0][0] / white(nm)
        found = film("ball", view.scene("ball", mesh, *flags), "--wavelengths", nm)
        for t, e in zip(at, expected):
            table.near(f"black ball, {lens}, {4 * t:g} px of 2 um from its image", e, np.interp(t, np.arange(181), found[20, 180:]), 5e-3)
        # The same drawn: distances of the sphere's front, exact shares of its outline, a circle of tan(asin(R/D)).
        x, y = view.direction()
        a = 1 + x ** 2 + y ** 2
        z = (1 - np.sqrt(np.maximum(1 - a * (1 - 25e-6), 0))) / a
        share = np.clip(disc_area(np.tan(np.arcsin(5e-3)) * view.focal_px, y * view.focal_px, x * view.focal_px), 0, 1)
        full = np.ones((1, *view.shape))
        expected = film("ball-drawn", plain_group("ball-drawn", [nm], 8, [(0 * full, z, share), (white(nm) * full, 2 * full[0], full[0])]))
        table.below("  film of the mesh against that of the drawn ball", abs(found - expected).max(), 1e-3)
        none = film("ball-none", view.scene("ball-none", mesh, "--solids", "none", *flags), "--wavelengths", nm)
        # Six times the limit above: 0.05 since surfaces that are both out of focus are computed with the part of the pupil that sees past the rim.
        table.below("  0.03 over the largest difference of the film with --solids none", 0.03 / abs(none - expected).max(), 1)


def planes_and_balls():
    view = View("phone", 1, (240, 300), 2, "0.5:4")
    x, y = view.direction()
    n, k = np.array([0.25, -0.5, 1.0]), 2.0
    corners = [(a, b, k - n[0] * a - n[1] * b) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]      # exact in f32
    z = Sheets(view.scene("tilted", glb(folder / "tilted.glb", [quad("plane", *corners)])))[0][1].astype(float)
    table.below("tilted plane: 1/z, relative", abs((n[0] * x + n[1] * y + n[2]) / k * z - 1).max(), 6e-8)
    centre, radius = np.array([0.004, -0.003, 1.0]), 0.03
    for level in (3, 4, 5):
        _, z, c = Sheets(view.scene("sphere", glb(folder / "sphere.glb", [icosphere("ball", centre, radius, level)])))[0]
        b, a = x * centre[0] + y * centre[1] + centre[2], x * x + y * y + 1
        root = b * b - a * (centre @ centre - radius ** 2)
        exact = (b - np.sqrt(np.maximum(root, 0))) / a
        inside = (c == 1) & (2 * np.sqrt(np.maximum(root, 0)) / a > radius)                            # slope up to 2
        table.below(f"sphere of {20 * 4 ** level} triangles, near side: error over R/4^level", abs(z - exact)[inside].max() / radius * 4 ** level, 0.8)
        exact = np.pi * radius ** 2 * view.focal_px ** 2 * np.sqrt(1 + (centre[0] ** 2 + centre[1] ** 2)) / (1 - radius ** 2) ** 1.5
        table.below("  area of its outline, relative", abs(c.sum() / exact - 1), 6e-3)
    floor = quad("floor", (-5e5, 1.0, -10), (5e5, 1.0, -10), (5e5, 1.0, 1e6), (-5e5, 1.0, 1e6))
    sheets = Sheets(view.scene("floor", glb(folder / "floor.glb", [floor])))
    first = view.shape[0] // 2
    z = sheets[0][1].astype(float)
    table.below("floor to the horizon: 1/z of the pixel's centre, relative", abs(z * y - 1)[first + 1:].max(), 1e-6)
    table.below("  coverage below the horizon: 1 - least", 1 - sheets[0][2][first + 1:].min(), 0)
    table.below("  pixels with a second surface", sum((q[2] > 0).sum() for q in sheets[1:]), 0)


def moved():
    """The same scene below a node that moves the camera as well, and in other units: distances and coverage."""
    view = View("phone", 1, (480, 640), 2, "0.5:4")
    rng = np.random.default_rng(4)
    parts = [wall("wall", 3.0, 2.0), icosphere("ball", (0.05, 0.03, 1.1), 0.06, 4), quad("floor", (-2, 0.13, 0.6), (2, 0.13, 0.6), (2, 0.13, 3), (-2, 0.13, 3))]
    for _ in range(150):
        c = rng.uniform((-0.2, -0.15, 0.9), (0.2, 0.15, 2.5))
        parts.append(("leaf", c + rng.uniform((-0.05, -0.05, -0.02), (0.05, 0.05, 0.02), (3, 3)), [(0, 1, 2)]))
    parts = [(m, np.asarray(v, np.float32).astype(float), f) for m, v, f in parts]
    gap = "--gap-px", 0.02                                  # finer than the distances between the surfaces, so that edges have coverages
    scene = lambda **root: Sheets(view.scene("moved", glb(folder / "moved.glb", parts, **root), *gap))
    obj = lambda scale: "".join(["".join(f"v {p[0]!r} {-p[1]!r} {-p[2]!r}\n" for p in (v * scale).tolist()) +
                                 "".join("f {} {} {}\n".format(*(i - len(v) for i in t)) for t in f) for _, v, f in parts])

    def from_obj(unit, scale):
        path = folder / f"moved-{unit}.obj"
        path.write_text(obj(scale))
        return Sheets(view.scene("moved", path, *gap, "--mesh-unit", unit, "--eye", "0,0,0", "--target=0,0,-1"))
    far, same = [5e6, -3e6, 4e6], scene()
    parts[1][1][:, 0] += 1e-4                               # the ball alone, 0.1 mm to the right
    table.below("1e-5 over the share of pixels of other coverage if the ball alone moves", 1e-5 / (scene()[0][2] != same[0][2]).mean(), 1)
    parts[1][1][:, 0] -= 1e-4
    parts[1] = (parts[1][0], parts[1][1].astype(np.float32).astype(float), parts[1][2])
    for name, other in (("root moved by 7e6 m", scene(translation=far)), ("root turned", scene(rotation=TURN)),
                        ("root moved and turned", scene(translation=far, rotation=TURN)), ("OBJ in m", from_obj("m", 1)), ("OBJ in cm", from_obj("cm", 100))):
        changed = np.any([a[2] != b[2] for a, b in zip(same, other)], axis=0)
        table.below(f"{name}: share of pixels of other coverage", changed.mean(), 1e-5)
        error = [abs(b[1][c] / a[1][c].astype(float) - 1).max() for a, b in zip(same, other) for c in [(a[2] > 0) & ~changed] if c.any()]
        table.below("  z, relative", max(error), 2e-7)


def sun_and_sky():
    """Camera 2 m above a flat floor, looking down, north up in the picture; a square casts the shadow of 10 x 10 px of the floor."""
    view = View("phone", 2, (120, 160), 2, "0.2:2")
    down = {"rotation": [-np.sqrt(0.5), 0, 0, np.sqrt(0.5)]}                   # camera x east, y south, z down
    (h, w), rho, px = view.shape, 0.5, 2 / view.focal_px
    scene = lambda parts, *flags, **root: Sheets(view.scene("lit", glb(folder / "lit.glb", parts, **{**down, **root}), "--samples-per-px", 1, *flags))[0]
    for azimuth, elevation in ((180, 60), (60, 60), (270, 30)):
        a, e = np.radians([azimuth, elevation])
        sun = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), -np.sin(e)])
        corners = [np.append(view.place(w // 2 + c - 0.5, h // 2 + r - 0.5, 0.5)[:2], 2.0) for c, r in ((-5, -5), (5, -5), (5, 5), (-5, 5))]
        height = 0.4                                                            # of the square above the floor, m
        blocker = quad("square", *(p + sun * height / -sun[2] for p in corners))
        weights, z, _ = scene([wall("floor", 2.0, 3.0), blocker], "--sun", f"{azimuth},{elevation},80000")
        floor = abs(z - 2) < 1e-3
        expected = rho * 80 * np.sin(e)
        lit = weights[0][floor]
        block = np.zeros((h, w), bool)
        block[h // 2 - 5:h // 2 + 5, w // 2 - 5:w // 2 + 5] = True
        table.near(f"sun from {azimuth} deg at {elevation} deg: pixels of the square's shadow on the floor", 100, ((weights[0] == 0) & floor & block).sum(), 0)
        table.near("  pixels in shadow elsewhere", 0, ((weights[0] == 0) & floor & ~block).sum(), 0)
        table.below("  lit floor against rho E sin(elevation), relative", abs(lit[lit > 0] / expected - 1).max(), 6e-8)
    sky = "--sky", 15000
    open_ = scene([wall("floor", 2.0, 1e3)], *sky)[0][0]
    table.near("open sky: least", rho * 15, open_.min(), 0)
    table.near("  greatest", rho * 15, open_.max(), 0)
    for turn in (0, 20, 45):                                 # walls whose foot runs through x = 0.02 m, degrees from north to west
        foot, along = np.array([0.02, 0, 2.0]), 1e3 * np.array([np.sin(np.radians(turn)), np.cos(np.radians(turn)), 0])
        side = quad("side", foot - along, foot + along, foot + along - [0, 0, 1e3], foot - along - [0, 0, 1e3])
        weights, *_ = scene([wall("floor", 2.0, 1e3), side], *sky)
        c, r = np.meshgrid(np.arange(w) + 1, np.arange(h))
        p = view.place(c, r, 0.5) - foot
        half = weights[0][p[..., 0] * along[1] < p[..., 1] * along[0]] / (rho * 15)                            # seen, not behind the wall
        table.below(f"floor beside a wall, turned by {turn} deg: half-open sky, largest error ({len(half)} px)", abs(half - 0.5).max(), 0.03)


def room():
    """Balls, a panel, a floor and a wall on the right half only: pixels without any surface, too."""
    parts = [quad("wall", (0, -1, 0.3), (1, -1, 0.3), (1, 1, 0.3), (0, 1, 0.3)), icosphere("ball", (-0.006, 0.002, 0.14), 0.006, 4),
             icosphere("ball", (0.002, 0.003, 0.2), 0.008, 4), quad("panel", (-0.004, -0.02, 0.11), (0.001, -0.02, 0.11), (0.003, 0.02, 0.11), (-0.002, 0.02, 0.11)),
             quad("floor", (-1, 0.0028, 0.12), (1, 0.0028, 0.12), (1, 0.008, 0.3), (-1, 0.008, 0.3))]
    materials = {"wall": colour(0.8, 0.75, 0.6), "ball": colour(0.8, 0.1, 0.08), "panel": colour(0.1, 0.3, 0.7), "floor": colour(0.3, 0.5, 0.3)}
    return glb(folder / "room.glb", parts, materials), ["--samples-per-px", 16]


def plain_groups():
    """A scene store against a group of charts: weights times spectra, and with any numbers where nothing is."""
    nm, bands = np.arange(400, 701, 20), "440,540,620"
    view = View("phone", 0.3, (150, 200), 2, "0.1:0.3")
    mesh, flags = room()
    scene = view.scene("room", mesh, *flags)
    run = ["--bands", bands]
    found, _ = view.film("room-scene", scene, "--wavelengths", "400:700:20", *run)
    (folder / "primaries.png").write_bytes(png(np.repeat(np.array([[[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]]]), 2, axis=0)))
    program.run("chart", "image", folder / "primaries.png", folder / "primaries.zarr", "--film-pitch-um", 2, "--wavelengths", "400:700:20", "--scale-to",
                1000 / np.pi, "--overwrite")
    spectra = zarr.open_group(folder / "primaries.zarr", mode="r")["chart"][:, 0, :].astype(float)                # (wavelength, basis)
    sheets = [(np.tensordot(spectra, w.astype(float), 1), z, c) for w, z, c in Sheets(scene)]
    group = plain_group("room-group", nm, 2, sheets)
    expected, bits = view.film("room-group", group, *run)
    table.below("film of a scene against that of the same sheets as charts, of the peak", (abs(found - expected).max((1, 2)) / expected.max((1, 2))).max(), 2e-6)
    rng, changed = np.random.default_rng(5), []
    for chart, z, c in sheets:
        chart, z, hole = chart.astype(np.float32), z.copy(), c == 0
        chart[:, hole] = rng.choice(np.array([1e30, -1e30, 1, -3, 1e-40, 0], np.float32), (len(nm), hole.sum()))
        z[hole] = rng.choice(np.array([np.nan, np.inf, -np.inf, 0, -1, 1e-30, 1e30, 0.11, 0.3], np.float32), hole.sum())
        changed.append((chart, z, c))
    empty = [100 * (c == 0).mean() for *_, c in sheets]
    print(f"  coverage 0 in {', '.join(f'{e:.0f}' for e in empty)} % of the sheets")
    same = view.film("room-any", plain_group("room-any", nm, 2, changed), *run)[1] == bits
    table.near("any numbers where the coverage is 0: same bytes of the film", 1, same, 0)
    alone = [view.film(f"room-first-{i}", plain_group(f"room-first-{i}", nm, 2, s[:1]), "--bands", "540")[1] for i, s in enumerate((sheets, changed))]
    table.near("  the same with hidden surfaces invented", 1, alone[0] == alone[1], 0)


def blend_and_mask():
    """Half transparent and cut-out panels in front of a wall, all in focus: the film is that of the picture that they compose."""
    nm = 550
    view = View("phone", 1, (128, 160), 2, "0.99:1.01")
    (h, w), area = view.shape, {"mask": (40, 40, 104, 104), "blend": (72, 60, 136, 92)}                        # x0, y0, x1, y1: borders of pixels
    alpha = np.where(np.add.outer(np.arange(8), np.arange(8)) % 2, 178, 77)                                    # 0.7 and 0.3
    image = np.full((8, 8, 4), 255)
    image[..., 3] = alpha
    panel = lambda name, v: quad(name, *(view.place(area[name][i] - 0.5, area[name][j] - 0.5, v) for i, j in ((0, 1), (2, 1), (2, 3), (0, 3))))
    texture = {"baseColorTexture": {"index": 0}}
    materials = {"mask": {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1], **texture}, "alphaMode": "MASK"},
                 "blend": colour(1, 1, 1, 0.5, alphaMode="BLEND")}
    one, value = white(nm), {"wall": 0.9, "mask": 0.2, "blend": 0.6}
    picture = np.full((h, w), value["wall"])
    x0, y0, x1, y1 = area["mask"]
    picture[y0:y1, x0:x1] = np.where(np.kron(alpha, np.ones((8, 8))) > 127.5, value["mask"], value["wall"])
    x0, y0, x1, y1 = area["blend"]
    picture[y0:y1, x0:x1] = 0.5 * value["blend"] + 0.5 * picture[y0:y1, x0:x1]
    ones = np.ones((h, w))
    expected, _ = view.film("blend-picture", plain_group("blend-picture", [nm], 2, [(one * picture[None], ones, ones)]))
    for gap, step, sheets, limit in ((1, 1e-4, 1, 5e-5), (0.01, 0.01, 3, 2e-3)):                               # step: 1/m between wall, mask, blend
        parts = [wall("wall", 1.0, 1.0), (*panel("mask", 1 + step), [(0, 0), (1, 0), (1, 1), (0, 1)]), panel("blend", 1 + 2 * step)]
        mesh = glb(folder / "blend.glb", parts, materials, png(image))
        scene = view.scene("blend", mesh, "--gap-px", gap, *measured(**value))
        table.near(f"blend and mask in focus, --gap-px {gap}: sheets with light", sheets, sum((c > 0).any() for *_, c in Sheets(scene)), 0)
        left, seen, of_basis = 1.0, 0.0, [b["reflectance"]["values"][0] if isinstance(b["reflectance"], dict) else 0 for b in Sheets(scene).group.attrs["bases"]]
        for weights, _, c in Sheets(scene):
            seen, left = seen + left * c * np.tensordot(of_basis, weights, 1), left * (1 - c)
        table.below("  stored sheets laid over each other against the picture", abs(seen - picture).max(), 3e-7)
        found, _ = view.film("blend", scene, "--wavelengths", nm)
        table.below("  film against that of the picture, of the peak", abs(found - expected).max() / expected.max(), limit)


for check in (drawn_scene, black_ball, planes_and_balls, moved, sun_and_sky, plain_groups, blend_and_mask):
    if not sys.argv[3:] or check.__name__ in sys.argv[3:]:
        check()
table.end()
