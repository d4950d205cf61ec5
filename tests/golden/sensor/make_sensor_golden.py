#!/usr/bin/env python3
"""Makes cases.json and signal.bin: signals and raws that the float64 model (sensor_reference.py) computes of small films.

    python3 -m venv v && v/bin/pip install numpy==2.4.6
    v/bin/python tests/golden/sensor/make_sensor_golden.py [FOLDER]       default: beside this file; a second

A film is noise by splitmix64 (tests/common: `Noise`), band after band, times 1e-3 W m^-2 nm^-1. signal.bin holds the cases' signals in f32, one
after the other; cases.json what they were made with, and the crc32 of the raw of each signal with all noises.
"""
import json
import sys
import zlib
from pathlib import Path

import numpy as np

import sensor_reference as R

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if len(sys.argv) > 1 else HERE)
SENSORS = HERE.parents[2] / "formats" / "data" / "sensors"
BANDS_NM = [450.0, 500.0, 560.0, 650.0]
MASK = (1 << 64) - 1


def noise(seed, count):
    out = np.empty(count, np.float32)
    for i in range(count):
        seed = (seed + 0x9E3779B97F4A7C15) & MASK
        z = seed
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
        out[i] = np.float32((z ^ (z >> 31)) >> 40) / np.float32(1 << 24)
    return out


cases, signals = [], []
for seed, (name, film, pitch, size, centre, method) in enumerate((
        ("example-2um", (37, 41), 2.0, (37, 41), (0.0, 0.0), "cubic"),
        ("example-2um", (40, 44), 1.0, (19, 21), (0.5, -0.3), "cubic"),
        ("cmv12000-rgb", (60, 70), 2.0, (20, 24), (1.5, -2.0), "cubic"),
        ("cmv12000-mono", (60, 70), 2.0, (21, 25), (0.0, 0.0), "area"),
        ("mt9v024-mono", (45, 48), 2.0, (14, 15), (0.0, 1.0), "cubic"),
        ("sony-a7r2", (50, 52), 2.0, (20, 22), (0.3, 0.7), "cubic"),
        ("ideal-mono", (16, 18), 2.0, (16, 18), (0.0, 0.0), "cubic"),
), 1):
    s = R.load_sensor(str(SENSORS / (name + ".toml")), pitch)
    n = film[0] * film[1]
    cube = (noise(seed, 4 * n) * np.float32(1e-3)).reshape(4, *film)
    sig = R.signal(cube, BANDS_NM, pitch, s, size, centre, method)
    seconds = 0.4 * R.saturation_e(s) / float(sig.mean())
    raw = R.expose(sig, s, seconds, gain=s["adc"]["gains"][0] if s["adc"]["gains"] else 2.0, seed=seed << 33 | 7, die=seed, frame=seed % 3)
    cases.append(dict(sensor=name, film=film, film_pitch_um=pitch, seed=seed, size=size, centre_um=centre, resample=method, seconds=seconds,
                      gain=s["adc"]["gains"][0] if s["adc"]["gains"] else 2.0, noise_seed=seed << 33 | 7, die=seed, frame=seed % 3,
                      raw_crc32=f"{zlib.crc32(raw.astype('<u2').tobytes()):08x}"))
    signals.append(sig.astype("<f4").ravel())

OUT.mkdir(exist_ok=True)
np.concatenate(signals).tofile(OUT / "signal.bin")
(OUT / "cases.json").write_text(json.dumps(dict(bands_nm=BANDS_NM, cases=cases), indent=1) + "\n")
print(len(cases), "cases,", sum(map(len, signals)), "pixels")
