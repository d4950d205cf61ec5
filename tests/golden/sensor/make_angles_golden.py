#!/usr/bin/env python3
"""Makes pipeline/tests/data/angles.csv: weights of bands over a sensor whose response depends on the angle of incidence, over those for perpendicular light.

    python3 -m venv v && v/bin/pip install numpy==2.4.6
    v/bin/python tests/golden/sensor/make_angles_golden.py [FILE]

Float64 model of pipeline/src/sensor/angle.rs by other means: sums over 400 x 256 directions of each cone, of 0.02 nm in wavelength, at each pixel by itself, without tables between places,
sines or wavelengths. The sensor, its cones and cases stand in the test that reads the file as well (sensor/field_weights/tests.rs).
"""
import sys
from pathlib import Path

import numpy as np

OUT = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[3] / "pipeline/tests/data/angles.csv"
BANDS_NM = np.array([500.0, 600.0, 640.0, 660.0])
SIZE, PITCH_MM, CENTRE_MM = (60, 80), 0.1, (1.0, 2.0)
QE = {"A": ([400.0, 700.0], [0.3, 0.7]), "B": ([400.0, 700.0], [0.8, 0.2])}
PIXELS = [(0, 0), (0, 79), (59, 79), (30, 40), (17, 61), (59, 3), (20, 19), (20, 20)]
EDGE = ("interference", 1.8, [400.0, 630.0, 660.0, 700.0], [0.9, 0.9, 0.05, 0.0])
GLASS = ("absorbing", 1.52, [400.0, 550.0, 700.0], [0.95, 0.9, 0.3])
ANGLES = np.arange(-40.0, 41.0, 10.0)
HORIZONTAL = np.array([0.2, 0.4, 0.7, 0.95, 1.25, 1.2, 0.8, 0.5, 0.3])
VERTICAL = np.array([0.1, 0.3, 0.6, 0.9, 1.0, 0.85, 0.6, 0.35, 0.15])


def cone(h):
    return 0.05 * h - 2e-4 * h ** 3, 0.048 * h, 0.2 - 1e-3 * h * h, 0.2 - 5e-4 * h * h


def slope(s, n):
    return s / np.sqrt(n * n - s * s)


def plate(kind, index, nodes, values, nm, s):
    cosine = np.sqrt(1 - s * s / index ** 2)
    if kind == "interference":
        return np.interp(nm / cosine, nodes, values, left=0, right=0)
    value, top = np.interp(nm, nodes, values, left=0, right=0), max(values)
    return np.where(value > 0, top * (np.maximum(value, 1e-300) / top) ** (1 / cosine), 0)


def weights(channel, plates, s, shares=None):
    """w_cb at the sines s: (sine, band), up to a factor; times shares over wavelength, (wavelengths, values)."""
    nm = np.arange(400.0, 720.0, 0.02) + 0.01
    response = nm * np.interp(nm, *QE[channel], left=0, right=0)
    response = response * (np.interp(nm, *shares) if shares else 1.0)
    first, last = BANDS_NM[0] - (BANDS_NM[1] - BANDS_NM[0]) / 2, BANDS_NM[-1] + (BANDS_NM[-1] - BANDS_NM[-2]) / 2
    hats = np.array([np.interp(nm, BANDS_NM, np.eye(4)[b]) for b in range(4)]) * ((nm >= first) & (nm <= last))
    out = []
    for sine in np.atleast_1d(s):
        through = np.prod([plate(*p, nm, sine) for p in plates], axis=0) if plates else 1.0
        out.append(hats @ (response * through))
    return np.array(out)


def model(half_deg, exponent):
    return lambda right, down, n: 2.0 ** -((np.hypot(right, down) / slope(np.sin(np.radians(half_deg)), n)) ** exponent)


def separable(right, down, n):
    slopes = slope(np.sin(np.radians(ANGLES)), n)
    along = lambda v, table: np.interp(v, slopes, table) / np.interp(0.0, slopes, table)
    return along(right, HORIZONTAL) * along(down, VERTICAL)


def spectral(halves_deg):
    """A Gaussian of the sine in steps of 4 degrees at three wavelengths, linear between."""
    steps = np.sin(np.radians(np.arange(0.0, 41.0, 4.0)))
    at = lambda v, n, half: np.interp(v, slope(steps, n), 2.0 ** -((steps / np.sin(np.radians(half))) ** 2))
    return lambda right, down, n: np.array([at(np.hypot(right, down), n, half) for half in halves_deg])


SPECTRAL_NM = [520.0, 610.0, 650.0]
CASES = {
    "spectral": (1.5, None, {"A": spectral([30.0, 22.0, 15.0]), "B": spectral([15.0, 25.0, 40.0])}, [EDGE]),
    "model": (1.5, None, {"A": model(25.0, 2), "B": model(18.0, 4)}, []),
    "plates": (1.0, None, None, [EDGE, GLASS]),
    "table": (1.4, [(0.0, 0.0), (4.0, 10.0), (8.0, 16.0)], {"A": separable, "B": separable}, [EDGE]),
}

lines = ["case,channel,band_nm,row,column,ratio"]
rho = np.sqrt((np.arange(400) + 0.5) / 400)
psi = 2 * np.pi * (np.arange(256) + 0.5) / 256
along, across = (rho[:, None] * np.cos(psi)).ravel(), (rho[:, None] * np.sin(psi)).ravel()
for case, (n, shifts, responses, plates) in CASES.items():
    for channel in QE:
        # Weights by the sine, on a grid finer than anything that depends on it.
        sines = np.linspace(0, 0.8, 1601)
        by_sine = weights(channel, plates, sines if plates else [0.0])
        if case == "spectral":
            shares = [weights(channel, plates, sines, (SPECTRAL_NM, row)) for row in np.eye(3)]
        normal = weights(channel, plates, [0.0])[0]
        for row, column in PIXELS:
            y = (row + 0.5 - SIZE[0] / 2) * PITCH_MM + CENTRE_MM[0]
            x = (column + 0.5 - SIZE[1] / 2) * PITCH_MM + CENTRE_MM[1]
            h = np.hypot(x, y)
            ex, ey = x / h, y / h
            chief, centre, a, b = cone(h)
            l, m = centre + a * along, b * across
            right, down = l * ex - m * ey, l * ey + m * ex
            s = np.hypot(l, m)
            response = 1.0
            if responses:
                shift = 0.0
                if shifts:
                    heights, degrees = np.array(shifts).T
                    shift = slope(np.interp(h, heights, np.sin(np.radians(degrees))), n)
                per = 1 / np.sqrt(n * n - s * s)
                response = responses[channel](right * per - shift * ex, down * per - shift * ey, n)
            for band in range(4):
                if case == "spectral":
                    product = sum(r * np.interp(s, sines, of[:, band]) for r, of in zip(response, shares))
                else:
                    product = response * (np.interp(s, sines, by_sine[:, band]) if plates else normal[band])
                ratio = np.mean(product) / normal[band]
                lines.append(f"{case},{channel},{BANDS_NM[band]:g},{row},{column},{ratio:.9f}")
OUT.write_text("\n".join(lines) + "\n")
