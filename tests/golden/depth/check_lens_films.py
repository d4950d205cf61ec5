#!/usr/bin/env python3
"""Traced lenses with depth nodes, through the program: `check_lens_films.py LENSCUBE`, about two minutes.

NumPy and zarr. White walls through the built-in Double Gauss, its pupil shift with real ray aiming, and kernels half-way between depth nodes of the
built-in phone lens against kernels traced there.
"""
import sys
import tempfile
from pathlib import Path

import numpy as np
import zarr

from program import Program
from rows import Table

program = Program(sys.argv[1])
scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
table = Table("depth: traced lenses")


def trace(name, lens, *flags):
    out = folder / f"{name}.lens.zarr"
    program.run("lens", "trace", lens, out, *flags)
    return out


def walls():
    """A white wall has the same film at any distance: what a bundle gains in solid angle it loses in the area that it comes from.

    Not to 1.4e-4, as rays give (test_depth_lens.py): PSFs are energy densities |U|^2, in which a ray has the weight 1/N of its direction cosine N. Over
    a bundle out of focus by 0.9 mm that moves the centroid by 0.4 um at 1 mm from the axis, and the film by up to 1.3e-3.
    """
    ends, films = ((5000, np.inf), (1.9998, 2.0002), (0.99995, 1.00005)), []
    for near, far in ends:
        pack = trace(f"wall-{near}", "double-gauss-28", "--focus-m", 2, "--depths-m", f"{near}:{far}", "--wavelengths", 587.5618, "--film-pitch-um", 32,
                     "--max-height-mm", 7.5, "--heights", "0:7.5:2.5", "--energy", 0.999, "--max-nodes", 64000)
        v = 0.0 if far == np.inf else 2 / (near + far)
        white = np.ones((101, 601))
        films.append(program.film(pack, 587.5618, [(white, v * white)], 32, (101, 601), stages="ri,distortion,svpsf", roi=(50, 120, 1, 361))[0])
    for distance, film in zip(("infinity", "1 m"), (films[0], films[2])):
        table.below(f"white wall at {distance} against 2 m, R on, to 5.8 mm: largest difference", abs(film / films[1] - 1).max(), 1.5e-3)


def pupil_shift():
    traced = trace("real", "double-gauss-28", "--focus-m", 2, "--image-plane", "paraxial", "--aiming", "real", "--depths-m", "1.999:2.001",
                   "--wavelengths", 587.5618, "--max-height-mm", 25.8, "--heights", "0,25.8", "--energy", 0.3, "--depth-tolerance", 0.2)
    pack = zarr.open_group(traced, mode="r")
    height = pack["image_height"][0]
    per_dioptre = pack["ideal_height"][0] * pack["pupil_shift"][0] * 1e-3 / 2e-3
    for r, px in ((14.61, 4.51), (20.88, 13.44), (25.72, 25.66)):
        table.near(f"Double Gauss, real aiming: ideal height of the film point at {r} mm, px per dioptre", px, np.interp(r, height, per_dioptre), 0.1)


def half_way():
    """Kernels at four places of the field, in the middle of three cells of depth nodes: the widest blur, the middle, focus."""
    bands, focus, tolerance, pitch, reach_mm = (450, 550, 650), 1.0, 0.02, 1.0, 2.0
    flags = ("--focus-m", 1 / focus, "--film-pitch-um", pitch, "--max-height-mm", reach_mm + 0.3)
    pack = trace("phone", "phone", *flags, "--depths-m", "0.5:inf", "--wavelengths", "450,550,650", "--depth-tolerance", tolerance)
    arrays = zarr.open_group(pack, mode="r")
    side, places = 101, ((0.0, 0.0), (1.0, 22.5), (1.6, 70.0), (2.0, 10.0))     # height mm, azimuth in degrees
    chart = np.zeros((side, side), np.float32)
    chart[side // 2, side // 2] = 1

    def kernel(pack, nm, v, height, azimuth):
        x, y = height * np.cos(np.radians(azimuth)), height * np.sin(np.radians(azimuth))
        axis = [(side - 1) / 2 - w * 1e3 / pitch for w in (x, y)]
        where = f"--axis={axis[0]:.9f},{axis[1]:.9f}", f"--center={x:.9f},{y:.9f}"
        return program.film(pack, nm, [(chart, np.full(chart.shape, v))], pitch, chart.shape, *where, stages="svpsf")
    for band, nm in enumerate(bands):
        nodes = arrays["vergence"][band][:int(arrays["vergence_count"][band])]
        for name, cell in (("farthest cell", 0), ("cell at focus", int(np.searchsorted(nodes, focus))), ("nearest cell", len(nodes) - 2)):
            v = nodes[cell:cell + 2].mean()
            own = trace(f"{nm}-{cell}", "phone", *flags, "--depths-m", f"{1 / (v + 1e-5):.9f}:{1 / (v - 1e-5):.9f}", "--wavelengths", nm)
            l1 = esf = 0.0
            for place in places:
                a, b = (kernel(p, nm, v, *place) for p in (pack, own))
                l1 = max(l1, abs(a - b).sum() / b.sum())
                esf = max(esf, *(abs(np.cumsum((a - b).sum(k))).max() / b.sum() for k in (0, 1)))
            table.below(f"phone, {nm} nm, half-way between nodes, {name} at {v:.3f} 1/m: L1 of kernels, %", 100 * l1, 100 * tolerance + 1.5)
            table.below("  largest ESF error, %", 100 * esf, 0.15)


for check in (walls, pupil_shift, half_way):
    check()
table.end()
