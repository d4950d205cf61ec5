#!/usr/bin/env python3
"""Makes pipeline/tests/data/range.csv: mean and variance of linearized numbers of sensors with companding and two conversion gains.

    python3 -m venv v && v/bin/pip install numpy==2.4.6
    v/bin/python tests/golden/sensor/make_range_golden.py [FILE]

Float64 model of pipeline/src/sensor/dual_gain.rs and companding.rs in closed form: sums over every charge of the Poisson distribution and every pair of numbers of both readings, with their probabilities; nothing is drawn.
The sensors stand in the test that reads the file as well (sensor/dual_gain/tests.rs).
"""
import sys
from math import erf, lgamma, log
from pathlib import Path

import numpy as np

OUT = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[3] / "pipeline/tests/data/range.csv"
BLACK, ADC_DN, READ_E = 256.0, 0.73, 1.5
normal = np.vectorize(lambda x: 0.5 * (1 + erf(x / 2 ** 0.5)))

CASES = {
    # DN/e-, bits of the raw, dual gain (ratio, bits, read noise e-, transition), knee points, mean charges e-
    "companding": (4.0, 12, None, ([0, 1024, 16384, 65535], [0, 1024, 2944, 4095]), [0, 20, 150, 190, 1000, 3900, 4100, 10000]),
    "dual": (2.0, 16, (8.0, 12, 5.0, (3000, 3000)), None, [0, 10, 1000, 1372, 1500, 5000, 12000]),
    "both": (8.0, 12, (64.0, 14, 20.0, (14000, 15500)), ([0, 1024, 32768, 1048575], [0, 1024, 2048, 4095]),
             [0, 50, 96, 1000, 1750, 3000, 4064, 50000, 110000]),
}


def reading(mean, sigma, bits):
    """Whole numbers of a reading within 8 standard deviations, and their probabilities; limits of the converter have what is beyond."""
    low, high = int(np.floor(mean - 8 * sigma)), int(np.ceil(mean + 8 * sigma))
    n = np.arange(low, high + 1)
    p = np.diff(normal((np.arange(low, high + 2) - 0.5 - mean) / sigma))
    return np.clip(n, 0, 2 ** bits - 1).astype(float), p / p.sum()


def moments(case, mean_e):
    k, bits, dual, curve, _ = CASES[case]
    first, last = max(0, int(mean_e - 9 * mean_e ** 0.5 - 1)), int(mean_e + 9 * mean_e ** 0.5 + 12)
    total = np.zeros(3)
    for charge in range(first, last + 1):
        weight = np.exp(charge * log(mean_e) - mean_e - lgamma(charge + 1)) if mean_e else float(charge == 0)
        sigma = np.hypot(k * READ_E, ADC_DN)
        if dual is None:
            # One quantizer, after the curve: cells of coded numbers.
            x, y = map(np.array, curve)
            edges = np.interp(np.arange(0, 2 ** bits - 1) + 0.5, y, x)
            p = np.diff(np.concatenate([[0], normal(np.clip((edges - BLACK - k * charge) / sigma, -9, 9)), [1]]))
            values = np.interp(np.arange(2 ** bits), y, x)
        else:
            ratio, own, read_low, (a, b) = dual
            high, p_high = reading(BLACK + k * charge, sigma, own)
            low, p_low = reading(BLACK + k * charge / ratio, np.hypot(k / ratio * read_low, ADC_DN), own)
            w = np.where(high <= a, 0.0, np.where(high >= b, 1.0, (high - a) / max(b - a, 1e-300)))[:, None]
            values = BLACK + (1 - w) * (high[:, None] - BLACK) + w * ratio * (low[None, :] - BLACK)
            if curve:
                x, y = map(np.array, curve)
                values = np.interp(np.clip(np.floor(np.interp(values, x, y) + 0.5), 0, 2 ** bits - 1), y, x)
            else:
                values = np.clip(np.floor(values + 0.5), 0, 2 ** bits - 1)
            p = p_high[:, None] * p_low[None, :]
        total += weight * np.array([p.sum(), (p * values).sum(), (p * values * values).sum()])
    mean = total[1] / total[0]
    return mean, total[2] / total[0] - mean * mean


lines = ["case,charge_e,mean_dn,variance_dn2"]
for case in CASES:
    for mean_e in CASES[case][4]:
        mean, variance = moments(case, mean_e)
        lines.append(f"{case},{mean_e},{mean:.6f},{variance:.6f}")
OUT.write_text("\n".join(lines) + "\n")
