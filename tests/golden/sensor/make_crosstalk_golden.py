#!/usr/bin/env python3
"""Makes pipeline/tests/data/crosstalk.csv: shares of diffusing charge, and signals of a sensor with crosstalk.

    python3 -m venv v && v/bin/pip install numpy==2.4.6
    v/bin/python tests/golden/sensor/make_crosstalk_golden.py [FILE]

Float64 models of pipeline/src/sensor/diffusion.rs and crosstalk.rs by other means. Diffusion: Gauss's quadrature over depth and both coordinates of the flux into the depleted layer of a point of charge at the depth z below
it (charge and its image in the plane of the layer), h(r) = z/(2 pi s^3) (1 + s/L) e^(-s/L), s^2 = r^2 + z^2, without transfer functions and times. Signals: every step of 0.05 nm and every share of every pixel by itself. The sensor and its
film stand in the test that reads the file as well (sensor/crosstalk/tests.rs).
"""
import sys
from pathlib import Path

import numpy as np

OUT = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[3] / "pipeline/tests/data/crosstalk.csv"
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def panels(ends):
    """Nodes and weights of Gauss's rule between consecutive ends."""
    ends = np.unique(ends)
    low, high = ends[:-1], ends[1:]
    x = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * NODES
    return x.ravel(), ((high - low)[:, None] / 2 * WEIGHTS).ravel()


def share(alpha, length, depletion, pitch, aperture, i, j):
    below = np.exp(-alpha * depletion)
    zs, wz = panels(np.concatenate([[0], np.geomspace(1e-7, 60 / (alpha + 1 / length), 40)]))
    total = 0.0
    for z, weight in zip(zs, wz):
        def axis(d):
            middle, outer, inner = d * pitch, (pitch + aperture) / 2, (pitch - aperture) / 2
            ends = [middle - outer, middle - inner, middle + inner, middle + outer]
            graded = z * 2.0 ** np.arange(-2, 40)
            graded = np.concatenate([-graded, [0], graded])
            x, w = panels(np.concatenate([ends, graded[(graded > ends[0]) & (graded < ends[3])]]))
            overlap = np.minimum(x + aperture / 2, middle + pitch / 2) - np.maximum(x - aperture / 2, middle - pitch / 2)
            return x, w * overlap / aperture
        (x, wx), (y, wy) = axis(j), axis(i)
        s = np.sqrt(x[None, :] ** 2 + y[:, None] ** 2 + z * z)
        flux = z / (2 * np.pi * s ** 3) * (1 + s / length) * np.exp(-s / length)
        total += weight * alpha * np.exp(-alpha * z) * (wy @ flux @ wx)
    collected = 1 - below / (1 + alpha * length)
    own = 1 - below if i == j == 0 else 0.0
    return (below * total + own) / collected


def film(height, width, bands):
    state, values = 1, []
    for _ in range(height * width * bands):
        state = (state * 6364136223846793005 + 1442695040888963407) % 2 ** 64
        values.append((state >> 40) / 2 ** 24)
    return np.array(values).reshape(bands, height, width)


HC = 6.62607015e-34 * 299792458.0
SIZE, BANDS_NM, PITCH_UM = (9, 11), np.array([450.0, 500.0, 560.0, 650.0]), 2.0
CURVES = {"R": ([400.0, 560.0, 620.0, 700.0], [0.02, 0.1, 0.6, 0.5]), "G": ([400.0, 530.0, 600.0, 700.0], [0.1, 0.65, 0.3, 0.1]),
          "B": ([400.0, 460.0, 520.0, 700.0], [0.4, 0.7, 0.2, 0.03])}
PATTERN = ["RG", "GB"]
# Shares of the pixels (down, right) over wavelength.
KERNELS = {
    "near": ([430.0, 550.0, 680.0], {(0, 1): [0.01, 0.02, 0.05], (0, -1): [0.015, 0.02, 0.04], (1, 0): [0.01, 0.03, 0.06], (-1, 0): [0.02, 0.02, 0.03], (1, 1): [0.001, 0.004, 0.02]}),
    "far": ([500.0, 600.0], {(0, 3): [0.0, 0.04], (-2, 1): [0.03, 0.0], (2, -3): [0.002, 0.01]}),
}


def signal(case):
    nodes, shares = KERNELS[case]
    height, width = SIZE
    cube = film(height, width, len(BANDS_NM))
    step = 0.05
    first, last = BANDS_NM[0] - (BANDS_NM[1] - BANDS_NM[0]) / 2, BANDS_NM[-1] + (BANDS_NM[-1] - BANDS_NM[-2]) / 2
    out = np.zeros(SIZE)
    names = np.array([[PATTERN[y % 2][x % 2] for x in range(width)] for y in range(height)])
    for nm in np.arange(first + step / 2, last, step):
        hats = np.array([np.interp(nm, BANDS_NM, np.eye(4)[b]) for b in range(4)])
        light = np.tensordot(hats, cube, 1)
        response = np.zeros(SIZE)
        for name, curve in CURVES.items():
            response[names == name] = np.interp(nm, *curve, left=0, right=0) * nm * 1e-9 / HC
        made = (PITCH_UM * 1e-6) ** 2 * light * response * step
        left = made.copy()
        for (dy, dx), values in shares.items():
            k = np.interp(nm, nodes, values)
            ys = slice(max(0, -dy), min(height, height - dy))
            xs = slice(max(0, -dx), min(width, width - dx))
            moved = k * made[ys, xs]
            left[ys, xs] -= moved
            out[ys.start + dy:ys.stop + dy, xs.start + dx:xs.stop + dx] += moved
        out += left
    return out


lines = ["what,a,b,c,d,e,row,column,value"]
for alpha, length, depletion, pitch, aperture in ((0.64, 5.0, 1.0, 2.0, 2.0), (0.2, 20.0, 2.0, 3.0, 2.0), (0.085, 40.0, 3.0, 5.5, 5.5), (6.0, 1.0, 0.1, 1.4, 1.0)):
    for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (3, 1), (3, 3)):
        value = share(alpha, length, depletion, pitch, aperture, i, j)
        lines.append(f"diffusion,{alpha},{length},{depletion},{pitch},{aperture},{i},{j},{value:.12g}")
for case in KERNELS:
    for row, line in enumerate(signal(case)):
        lines += [f"{case},0,0,0,0,0,{row},{column},{value:.9g}" for column, value in enumerate(line)]
OUT.write_text("\n".join(lines) + "\n")
