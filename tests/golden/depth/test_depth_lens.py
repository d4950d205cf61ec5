"""Checks focus, breathing, light and depth nodes of the built-in Double Gauss, and nodes.json: `python tests/golden/depth/test_depth_lens.py`.

NumPy; a minute. Expected figures: first-order optics of the prescription, and ideal pupils.
"""
import json
from pathlib import Path

import numpy as np

import depth_nodes as nodes
from double_gauss import DoubleGauss
from make_nodes import figures
from rows import Table

table = Table("depth: the lens")
PITCH_MM = 2e-3


def focus():
    for v, rho, f_d in ((0.0, 829.1, 99.501), (0.5, 868.8, 104.269), (1.0, 912.6, 109.518)):
        lens = DoubleGauss(v)
        table.near(f"focus {v:g} 1/m: distortion focal length, mm", f_d, lens.f_d, 1e-3)
        table.near(f"focus {v:g} 1/m: blur per dioptre, px of 2 um", rho, lens.diameter / 2 * lens.f_d * 1e-3 / PITCH_MM, 0.1)
        table.near(f"focus {v:g} 1/m: slope of real chief rays near the axis, mm", lens.f_d, lens.chief([1e-4])[0][0] / 1e-4, 1e-4)
        for at in (0.0, 1.3):
            start, d, _ = lens.launch(0.0, at, np.array([1e-3]), np.zeros(1))
            found = lens.run(start, d)[0][0, 0] / 1e-3
            table.near(f"focus {v:g} 1/m: blur of a ray near the axis from {at:g} 1/m over f_D (V - V_f)", lens.f_d * (at - v) * 1e-3, found, 1e-6)
    table.near("entrance pupil behind the first vertex, mm", 58.9398, DoubleGauss(0.5).pupil_z, 1e-4)


def pupil_shift():
    real, paraxial = DoubleGauss(0.5, real_aiming=True), DoubleGauss(0.5)
    t = np.linspace(0.01, 0.26, 26)
    height, delta = real.chief(t)
    for r, px in ((14.61, 4.51), (20.88, 13.44), (25.72, 25.66)):
        found = np.interp(r, height, real.f_d * t * delta * 1e-3 / PITCH_MM)
        table.near(f"real aiming: ideal height of the film point at {r} mm, px per dioptre", px, found, 0.05)
    table.below("paraxial aiming: pupil shift, mm", abs(paraxial.chief(t)[1]).max(), 1e-12)
    # A chief ray is one line: objects on it at 0.5 m and at infinity have the same film point.
    for i in (12, 24):
        h = t[i] * (1 + delta[i] * 2.0 * 1e-3)               # tan seen from the pupil's centre for an object at V = 2
        x = real.pupil_points(t[i], 0.0, np.zeros(1), np.zeros(1))[0]
        at = real.run(*real.launch(h, 2.0, x, np.zeros(1))[:2])[0][0, 0]
        table.below(f"real aiming: film points of one chief ray at V = 0 and 2, mm, tan {t[i]:.2f}", abs(at - height[i]), 1e-9)


def light():
    lens, t = DoubleGauss(0.5), np.array([1e-3, 0.1, 0.2])
    at_focus = lens.light(t, 0.5)
    for v, limit in ((0.0, 1.5e-4), (1.0, 3e-4), (2.0, 1.2e-3)):
        table.below(f"light at V = {v:g} against focus, object side: largest change", abs(lens.light(t, v) / at_focus - 1).max(), limit)
    for v, stated in ((0.0, 1.098), (1.0, 0.906)):
        ratio = lens.solid_angle(1e-9, v) / lens.solid_angle(1e-9, 0.5)
        table.near(f"solid angle of the bundle at V = {v:g} against focus, axis (not the light)", stated, ratio, 1e-3)
    # White walls: film = R G (1 - div c), c the centroid of the PSF from the chief ray; it must not depend on V.
    fine = np.linspace(0.0, 0.205, 42)
    films = []
    for v in (0.0, 0.5, 1.0):
        heights, _ = lens.chief(fine)
        c = np.array([(b[1] * b[2][:, 0]).sum() for b in (lens.bundle(x, v) for x in fine)])
        inner = heights[1:-1]
        divergence = np.gradient(heights * c, heights)[1:-1] / inner
        g = lens.light(fine[1:-1], v)
        films.append(g * (1 - divergence))
    for v, film in ((0.0, films[0]), (1.0, films[2])):
        table.below(f"white wall at {v:g} 1/m against 0.5 1/m, R on: largest difference of the films", abs(film / films[1] - 1).max(), 1e-3)


def cells():
    """L1 [%] of the interpolation half-way between nodes 1 px of blur apart; measured before with other software of the same equations."""
    stated = {"f/1.8, 1 um": (5.2, 3.9, 3.2, 2.3, 1.6), "f/3, 2 um": (8.8, 5.6, 4.2, 2.7, 1.9)}
    for (name, row), (f_number, pitch) in zip(stated.items(), ((1.8, 1.0), (3.0, 2.0))):
        pupil = nodes.IdealPupil(f_number, 0.55, pitch, 100.0)
        for rho, figure in zip((0, 4, 8, 16, 32), row):
            v, h = rho / 100, 0.5 / 100
            e, half = (nodes.errors(pupil, v, x)[0] for x in (h, h / 2))
            table.near(f"ideal {name}, blur {rho} px: L1 half-way between nodes 1 px apart, %", figure, 100 * e, 0.2 * figure)
            table.near("  error over that of half the spacing", 4.0, e / half, 0.15)


def tables():
    """The tree's tables of the same lens at 550 nm, object at infinity, film as designed: rays by Optiland, a Huygens sum per PSF."""
    with np.load(Path(__file__).resolve().parents[3] / "formats/tests/data/double-gauss-28-550nm.npz") as file:
        ideal, real, psf, focal = file["ideal_height_mm"], file["real_height_mm"][0], file["psf"][0], float(file["efl_mm"])
    lens = DoubleGauss(0.0, 0.55)
    lens.film_gap = 57.314537905
    for i in (0, 10, 20):
        pupil = nodes.TracedPupil(lens, max(float(ideal[i]) / focal, 1e-9), 2.0)
        table.near(f"tables of other software, ideal height {ideal[i]:g} mm: real height, mm", real[i], lens.chief([pupil.t])[0][0], 1e-6)
        table.below("  PSF, L1", abs(nodes.kernel(pupil, 0.0, 25) - psf[i] / psf[i].sum()).sum(), 0.01)


def placement():
    reach = 40
    for name, pupil, stated in (("f/1.8, 1 um", nodes.IdealPupil(1.8, 0.55, 1.0, 100.0), (60, 35, 47)),
                                ("f/3, 2 um", nodes.IdealPupil(3.0, 0.55, 2.0, 100.0), (68, 39, 52))):
        for (l1, esf), count in zip(((0.01, np.inf), (0.03, np.inf), (0.02, 1e-3)), stated):
            found, worst, worst_esf = nodes.place([pupil], 0.0, reach / 100, l1, esf)
            table.near(f"ideal {name}, blur 0 to {reach} px, L1 <= {l1:g}, ESF <= {esf:g}: cells", count, len(found) - 1, 0.15 * count)
            table.below("  largest L1 half-way", worst, l1)
            if np.isfinite(esf):
                table.below("  largest ESF error half-way", worst_esf, esf)


def kept():
    """nodes.json is what make_nodes.py computes; another linear algebra library rounds the fit of a pupil otherwise (5e-8 seen)."""
    old, new = json.loads((Path(__file__).parent / "nodes.json").read_text()), figures()

    def compare(a, b, where):
        if isinstance(a, dict):
            assert a.keys() == b.keys(), f"{where}: other keys"
            return max((compare(a[k], b[k], f"{where}.{k}") for k in a), default=0.0)
        if isinstance(a, list):
            assert len(a) == len(b), f"{where}: {len(a)} entries, expected {len(b)}"
            return max((compare(x, y, where) for x, y in zip(a, b)), default=0.0)
        return abs(a - b) / max(abs(a), 1e-12) if isinstance(a, (int, float)) else float(a != b)
    table.below("nodes.json: largest relative difference", compare(old, new, "nodes.json"), 1e-5)


for check in (focus, pupil_shift, light, tables, cells, placement, kept):
    check()
table.end()
