#!/usr/bin/env python3
"""Designs without rotational symmetry, `lenscube lens trace`, against Optiland: `check_asymmetric.py LENSCUBE [FOLDER]`; FOLDER keeps the designs and packs.

numpy, zarr, scipy, optiland. Five designs are built in Optiland (optiland_asymmetric.py) and saved as its JSON, which the program traces to a pack of PSFs. The
map of the pack gives the ideal points of 25 film places between its nodes; the ideal plane is made of Optiland's rays:

    I = f O ((tx, -ty) - (tx, -ty)_centre)      f = sqrt|det J|, J = d(X, Y)/d(tx, -ty) at the film's centre, O the flip or quarter turn with the largest tr(O' J)

column      what                                                                                        bound
chief       chief ray of the field of the ideal point, through the centre of the stop, from the place   1e-6 mm
focal       f of the pack against that of Optiland's rays, relative                                     1e-6
PSF         four PSFs of the pack, near the centre, a corner and two sides, at their samples against    1e-5
            a Huygens sum over Optiland's rays (optiland_psf.py), L1
"""
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import zarr
from optiland.fileio import save_optiland_file
from scipy.interpolate import BSpline, make_interp_spline

from optiland_asymmetric import DESIGNS, UM, Rays
from optiland_psf import psf

CHIEF_MM, FOCAL, KERNEL = 1e-6, 1e-6, 1e-5
PITCH_UM = 5
FLIPS = [np.array(m, float) for a in (1, -1) for b in (1, -1) for m in ([[a, 0], [0, b]], [[0, a], [b, 0]])]


class Pack:
    """The map of a pack of one band."""

    def __init__(self, path):
        g = zarr.open_group(path, mode="r")
        self.attributes = dict(g.attrs)
        assert self.attributes["schema"] == "lenscube/lens-pack/4" and self.attributes["psf_field"] == "grid", self.attributes
        known = lambda v: v[np.isfinite(v)]
        self.x, self.y = (known(np.ravel(g[key][:])[:g[key].shape[-1]]) for key in ("map_x", "map_y"))
        cut = lambda key: g[key][0][:len(self.y), :len(self.x)]
        # C2 bicubic, not-a-knot: coefficients by x, then by y.
        self.splines = [make_interp_spline(self.y, make_interp_spline(self.x, cut(f"map_ideal_{axis}").T).c.T).c for axis in "xy"]
        self.knots = make_interp_spline(self.y, self.y).t, make_interp_spline(self.x, self.x).t
        self.nodes = [known(g[key][0]) for key in ("psf_x", "psf_y")]
        self.kernels, self.pitch_um = g["psf/0"], float(g["psf_pitch"][0])
        assert self.attributes.get("psf_sample", "point") == "point", "integrated samples"

    def psfs(self):
        """Places (x, y) and kernels near the centre, a corner and two sides."""
        nx, ny = (len(axis) for axis in self.nodes)
        for i, j in ((nx // 2, ny // 2), (1, 1), (nx - 2, ny // 3), (nx // 4, ny - 2)):
            yield (self.nodes[0][i], self.nodes[1][j]), np.asarray(self.kernels[j * nx + i], float)

    def ideal(self, place):
        """Ideal point of a film place."""
        row = [BSpline(self.knots[0], c, 3)(place[1]) for c in self.splines]
        return np.array([float(BSpline(self.knots[1], r, 3)(place[0])) for r in row])


class IdealPlane:
    """f O and the field at the film's centre, of rays."""

    def __init__(self, rays):
        self.centre = rays.field_of((0.0, 0.0))
        j = rays.by_slopes(self.centre) * [1, -1]
        self.focal_mm = np.sqrt(abs(np.linalg.det(j)))
        self.matrix = self.focal_mm * max(FLIPS, key=lambda o: np.trace(o.T @ j))

    def slopes(self, ideal):
        return self.centre + np.linalg.solve(self.matrix, ideal) * [1, -1]


def compare_psfs(pack, rays, optic, focal_mm):
    """Largest L1 of the kernels."""
    worst = 0.0
    for place, kernel in pack.psfs():
        n = len(kernel)
        # Waves between the rim's wavelets over the window.
        spokes = 64 + 4 * math.ceil((n // 2) * pack.pitch_um * 2 * optic.aperture.value / focal_mm / UM)
        exact = psf(rays, rays.field_of(np.array(place)), n, pack.pitch_um, rings=spokes // 4, spokes=spokes)
        worst = max(worst, np.abs(kernel - exact).sum())
    return worst


def check(lenscube, folder, name):
    """One line of the table; whether a bound is violated."""
    optic, size_mm = DESIGNS[name]()
    design, out = folder / f"{name}.json", folder / f"{name}.lens.zarr"
    save_optiland_file(optic, str(design))
    if not out.exists():
        words = [lenscube, "lens", "trace", design, out, "--wavelengths", round(1e3 * UM), "--film-size", round(1e3 * size_mm / PITCH_UM), "--film-pitch-um", PITCH_UM,
                 "--store", "psfs"]
        done = subprocess.run([*map(str, words)], capture_output=True, text=True)
        if done.returncode:
            print(f"{name:20} `{' '.join(map(str, words))}`: exit {done.returncode}: {done.stderr.strip()}  FAIL")
            return True
    pack, rays = Pack(out), Rays(optic)
    plane = IdealPlane(rays)
    half = 0.5 * size_mm
    places = [(x, y) for y in np.linspace(-0.93 * half, 0.95 * half, 5) for x in np.linspace(-0.91 * half, 0.96 * half, 5)]
    worst = max(np.abs(rays.chief(plane.slopes(pack.ideal(p))) - p).max() for p in places)
    focal = abs(pack.attributes["distortion_focal_length_mm"] / plane.focal_mm - 1)
    kernel = compare_psfs(pack, rays, optic, plane.focal_mm)
    bad = not (worst <= CHIEF_MM and focal <= FOCAL and kernel <= KERNEL)
    print(f"{name:20} {size_mm:8.1f} {plane.focal_mm:10.4f} {worst:10.1e} {focal:10.1e} {kernel:10.1e}" + ("  FAIL" if bad else ""), flush=True)
    return bad


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(sys.argv[2] if len(sys.argv) == 3 else scratch).resolve()
        place.mkdir(parents=True, exist_ok=True)
        print(f"{'design':20} {'film, mm':>8} {'f, mm':>10} {'chief, mm':>10} {'focal':>10} {'PSF, L1':>10}")
        count = sum(check(sys.argv[1], place, name) for name in DESIGNS)
    print(f"\n{count} designs violate a bound")
    sys.exit(int(count > 0))
