#!/usr/bin/env python3
"""Lens packs of drawn lenses, `lenscube lens trace --tolerances`, against Optiland: `check_built.py LENSCUBE [FOLDER]`; FOLDER keeps the packs.

numpy, zarr, scipy, optiland. The errors are read from the attribute `errors` of each pack, with pivots and figures from the description; the film is
moved as `compensators` says. Optiland then traces the lens (optiland_built.py).

column      what                                                                                        bound
chief       chief ray of the field that the map gives for 25 film places, from the place                1e-6 mm
R           relative illumination of the map there                                                      2e-5
PSF         kernel at its samples against a Huygens sum over Optiland's rays, L1                        0.01 %
centroid    of the geometric spot against that of the PSF, from the chief ray                           0.15 um + 12 %: the centroids of rays and of diffraction
                                                                                                        are equal, but the window cuts light off that is far away
One at a time: the last element decentred by +20 um along x, y or tilted by +1' about x, y, the film fixed.
boresight   the film place whose ideal point is 0 against Optiland's chief ray of t = 0                 1e-6 mm, sign and 5e-3 of first order
coma        centroid of the PSF on the axis against the spot's                                          its sign where above 0.05 um; as above
"""
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import zarr
from scipy.interpolate import BSpline, make_interp_spline

import tolerances
from first_order import element_shift
from optiland_built import Built, Design, Spot, quadrature
from optiland_psf import centroid_um, psf

CHIEF_MM, LIGHT, KERNEL = 1e-6, 2e-5, 1e-4
DATA = Path(__file__).resolve().parents[3] / "formats/data/lenses"
ALL = """
[[element]]
surfaces = [{first}, {last}]
decentre_um = {um}
tilt_arcmin = {arcmin}
wedge_arcmin = 1
[[element]]
surfaces = [{second}, {second_last}]
decentre_um = {um}
tilt_arcmin = {arcmin}
pivot = {second_last}
[[surface]]
surface = {second}
radius_percent = 0.05
irregularity_fringes = 0.5
tilt_arcmin = 0.5
[[gap]]
after = {second_last}
thickness_um = {um}
[[glass]]
after = {second}
index = 2e-4
abbe_percent = 0.5
[[film]]
tilt_arcmin = 3
decentre_um = 5
shift_um = 2
[criterion]
kind = "rms-spot"
fields = [[0, 0], [{field}, 0], [0, {field}], [-{field}, 0], [0, -{field}]]
"""
# Design, wavelength, film pitch, reach (mm) and the numbers of ALL; the last element is first..last.
LENSES = {
    "double-gauss-28": ("double-gauss-28", 550, 2, 14, dict(first=10, last=11, second=7, second_last=9, um=20, arcmin=1, field=8)),
    "phone": (DATA / "phone.csv", 550, 1.12, 2.0, dict(first=6, last=9, second=2, second_last=3, um=3, arcmin=1, field=1.2)),
    "triplet": (DATA / "triplet.csv", 588, 4, 12, dict(first=5, last=6, second=1, second_last=2, um=20, arcmin=1, field=8)),
}
SAMPLES = (0, 3)
ONE = "[[element]]\nsurfaces = [{first}, {last}]\n{key} = [{value}, {value}]\n[compensate]\nfocus = false\n"
SINGLE = (("decentre +x", "decentre_x_um", 20, (1, 0)), ("decentre +y", "decentre_y_um", 20, (0, -1)), ("tilt +x", "tilt_x_arcmin", 1, (0, 1)),
          ("tilt +y", "tilt_y_arcmin", 1, (1, 0)))


class Pack:
    """The arrays of a pack of one band."""

    def __init__(self, path):
        g = zarr.open_group(path, mode="r")
        self.attributes = dict(g.attrs)
        assert self.attributes["schema"] == "lenscube/lens-pack/4" and self.attributes["psf_field"] == "polar", self.attributes["schema"]
        assert self.attributes.get("psf_sample", "point") == "point", "integrated samples"
        self.um = float(g["wavelength"][0]) / 1e3
        known = lambda v: v[np.isfinite(v)]
        self.x, self.y = (known(g[key][0]) for key in ("map_x", "map_y"))
        cut = lambda key: g[key][0][:len(self.y), :len(self.x)]
        splines = [cut(f"map_{key}") for key in ("ideal_x", "ideal_y", "relative_illumination")]
        # C2 bicubic, not-a-knot: coefficients by x, then by y.
        self.splines = [make_interp_spline(self.y, make_interp_spline(self.x, v.T).c.T).c for v in splines]
        self.knots = make_interp_spline(self.y, self.y).t, make_interp_spline(self.x, self.x).t
        self.height = known(g["psf_height"][0])
        self.samples = g["psf_azimuths"][0][:len(self.height)].astype(int)
        self.psf, self.pitch_um = g["psf/0"], float(g["psf_pitch"][0])
        self.energy = g["psf_energy"][0][:self.samples.sum()]

    def at(self, place):
        """Ideal x, y and R of a film place."""
        out = []
        for c in self.splines:
            row = BSpline(self.knots[0], c, 3)(place[1])
            out.append(float(BSpline(self.knots[1], row, 3)(place[0])))
        return np.array(out)

    def place_of(self, ideal):
        """Film place of an ideal point."""
        at, h = np.asarray(ideal, float), 1e-4
        for _ in range(20):
            e = np.asarray(ideal) - self.at(at)[:2]
            if np.abs(e).max() < 1e-12:
                break
            by = np.array([(self.at(at + v)[:2] - self.at(at - v)[:2]) / (2 * h) for v in np.eye(2) * h]).T
            at = at + np.linalg.solve(by, e)
        return at

    def rows(self):
        """(height, azimuth, row) of every PSF."""
        starts = np.cumsum([0, *self.samples])
        return [(r, 2 * math.pi * a / count, start + a) for r, count, start in zip(self.height, self.samples, starts, strict=False) for a in range(count)]


def trace(lenscube, folder, name, text, sample):
    """Pack of a drawn lens and the lens in Optiland."""
    design, nm, pitch_um, reach, _ = LENSES[name.split(" ")[0]]
    stem = name.replace(" ", "-").replace("+", "plus-")
    toml, out = folder / f"{stem}.toml", folder / f"{stem}-{sample}.lens.zarr"
    toml.write_text(text)
    if not out.exists():
        words = [lenscube, "lens", "trace", design, out, "--tolerances", toml, "--seed", 1, "--lens-sample", sample, "--wavelengths", nm,
                 "--film-pitch-um", pitch_um, "--max-height-mm", reach, "--energy", 0.995, "--store", "psfs"]
        done = subprocess.run([*map(str, words)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(map(str, words))}: exit {done.returncode}: {done.stderr}")
    pack, prescription = Pack(out), Design.of_program(lenscube, design)
    record, moved = pack.attributes["errors"], pack.attributes.get("compensators", {})
    assert (record["seed"], record["sample"]) == (1, sample), record
    errors = tolerances.errors(toml, record["values"], prescription.radius, prescription.semi_diameters_mm, moved)
    return pack, Built(prescription, pack.um, errors), errors


def illumination(lens, t, rings=8, spokes=24, h=2e-5):
    """G: light of a field element per film area of its chief rays."""
    p, q, w = quadrature(rings, spokes)
    by = np.array([(lens.chief(np.add(t, v)) - lens.chief(np.subtract(t, v))) / (2 * h) for v in np.eye(2) * h])
    return (w * lens.rays(t, p, q)[2]).sum() * (1 + t[0] ** 2 + t[1] ** 2) ** -2 / abs(np.linalg.det(by))


def compare_map(pack, lens, focal):
    """Largest errors of the chief rays and of R over 25 places between nodes of the map."""
    places = [(x, y) for y in np.linspace(0.93 * pack.y[0], 0.95 * pack.y[-1], 5) for x in np.linspace(0.91 * pack.x[0], 0.96 * pack.x[-1], 5)]
    slopes = lambda at: np.array([at[0], -at[1]]) / focal
    centre, worst = illumination(lens, slopes(pack.at((0.0, 0.0)))), np.zeros(2)
    for place in places:
        found = pack.at(place)
        t = slopes(found)
        worst = np.maximum(worst, [np.abs(lens.chief(t) - place).max(), abs(illumination(lens, t) / centre - found[2])])
    return worst


def compare_psf(pack, lens, row):
    """L1 against Huygens' sum; centroids (PSF, spot) in the frame of the PSF, um."""
    r, phi, index = row
    kernel = np.asarray(pack.psf[index], float)
    n, c, s = kernel.shape[0], math.cos(phi), math.sin(phi)
    t = lens.field_of((r * c, r * s))
    half_um = n // 2 * pack.pitch_um
    spokes = 64 + 4 * math.ceil(2 * half_um * 0.2 / lens.um)
    exact = psf(lens, t, n, pack.pitch_um, phi, rings=spokes // 4, spokes=spokes)
    spot = Spot([(lens, 1.0)], t, 20, 60)
    moved = 1e3 * np.array([[c, s], [-s, c]]) @ (spot.centroid - lens.chief(t))
    return np.abs(kernel - exact).sum(), centroid_um(kernel, pack.pitch_um), moved


def off(found, expected):
    """Distance of two centroids as a share of what is allowed."""
    return float(np.hypot(*(found - expected)) / (0.15 + 0.12 * np.hypot(*expected)))


def check_drawn(lenscube, folder):
    failed = 0
    print(f"{'lens':16} {'sample':>6} {'chief, mm':>10} {'R':>9} {'PSFs':>5} {'PSF L1, %':>10} {'centroid, of bound':>19} {'shift, um':>10}")
    for name, (*_, numbers) in LENSES.items():
        for sample in SAMPLES:
            pack, lens, _ = trace(lenscube, folder, name, ALL.format(**numbers), sample)
            chief, light = compare_map(pack, lens, pack.attributes["distortion_focal_length_mm"])
            rows = pack.rows()
            rows = rows[::max(1, len(rows) // 7)]
            kernel = centroid = 0.0
            for row in rows:
                l1, found, expected = compare_psf(pack, lens, row)
                kernel, centroid = max(kernel, l1), max(centroid, off(found, expected))
            bad = chief > CHIEF_MM or light > LIGHT or kernel > KERNEL or centroid > 1
            failed += bad
            moved = 1e3 * pack.attributes.get("compensators", {}).get("film_shift_mm", 0.0)
            print(f"{name:16} {sample:6} {chief:10.1e} {light:9.1e} {len(rows):5} {100 * kernel:10.3f} {centroid:19.2f} {moved:10.2f}"
                  + ("  FAIL" if bad else ""), flush=True)
    return failed


def check_signs(lenscube, folder):
    failed = 0
    print(f"\n{'lens':16} {'error':12} {'boresight X, Y, um':>22} {'from Optiland, mm':>18} {'first order, um':>16} {'coma of PSF, um':>18} {'of spot, um':>18}")
    for name, (*_, numbers) in LENSES.items():
        for what, key, value, direction in SINGLE:
            text = ONE.format(key=key, value=value, **numbers)
            pack, lens, _ = trace(lenscube, folder, f"{name} {what}", text, 0)
            nominal = Built(lens.design, lens.um)
            size = element_shift(nominal, numbers["first"], numbers["last"], **({"tilt": tolerances.ARCMIN * value} if "tilt" in key else {"decentre": value * 1e-3}))
            at, first = pack.place_of((0.0, 0.0)), size * np.array(direction)
            miss = np.abs(lens.chief((0.0, 0.0)) - at).max()
            _, found, expected, *_ = compare_psf(pack, lens, pack.rows()[0])
            wrong_sign = at @ first <= 0 or (np.hypot(*expected) > 0.05 and found @ expected <= 0)
            bad = miss > CHIEF_MM or np.abs(at - first).max() > 5e-3 * abs(size) + CHIEF_MM or wrong_sign or off(found, expected) > 1
            failed += bad
            print(f"{name:16} {what:12} {1e3 * at[0]:11.4f}{1e3 * at[1]:11.4f} {miss:18.1e} {1e3 * size:16.4f} {found[0]:9.3f}{found[1]:9.3f}"
                  f" {expected[0]:9.3f}{expected[1]:9.3f}" + ("  FAIL" if bad else ""), flush=True)
    return failed


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(sys.argv[2] if len(sys.argv) == 3 else scratch).resolve()
        place.mkdir(parents=True, exist_ok=True)
        count = check_drawn(sys.argv[1], place) + check_signs(sys.argv[1], place)
    print(f"\n{count} lenses violate a bound")
    sys.exit(int(count > 0))
