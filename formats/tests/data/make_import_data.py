#!/usr/bin/env python3
"""Makes the import tests' data: formats/data/tables-example/ and double-gauss-28-550nm.npz.

    python3 make_import_data.py TABLES.npz        (numpy 2; TABLES.npz as formats/data/SOURCES.md describes it)

tables-example  an invented lens: f = 50 mm, 2 % barrel distortion and cos^4 at 10 mm, PSFs of 8 x 8 samples of 0.5 um with the
                chief ray between the four middle samples (even_window shift), top row first, field point downwards.
550 nm          one of the 31 bands of TABLES.npz, as it is.
"""
import sys
from pathlib import Path

import numpy as np

here = Path(__file__).resolve().parent
out = here.parent.parent / "data/tables-example"
out.mkdir(exist_ok=True)
F = 50.0
(out / "lens.csv").write_text(
    "key,value\nname,invented 50 mm\nprogram,make_import_data.py\ndistortion_focal_length_mm,50\neffective_focal_length_mm,50\nf_number,4\n"
    "primary_wavelength_nm,550\nobject_distance_mm,infinity\npsf_sample,point\npsf_outward,down\neven_window,shift\n")
ideal = [0.0, 2.5, 5.0, 7.5, 10.0]
real = {nm: [h * (1 - 0.0002 * h * h) * (1 + (nm - 550) * 1e-6) for h in ideal] for nm in (500, 550)}
rows = ["wavelength_nm,ideal_height_mm,image_height_mm,relative_illumination"]
for nm in real:
    rows += [f"{nm},{h},{r:.9f},{np.cos(np.arctan(h / F)) ** 4:.9f}" for h, r in zip(ideal, real[nm])]
(out / "heights.csv").write_text("\n".join(rows) + "\n")
rows = ["wavelength_nm,image_height_mm,psf_pitch_um,psf_energy,file,index   # three heights a wavelength"]
y, x = np.mgrid[:8, :8] - 3.5
for nm in real:
    stack = []
    for k, i in enumerate((0, 2, 4)):
        tail = 0.1 * i  # the centroid moves outward, here down
        p = np.exp(-(x * x + (y - tail) ** 2) / 2.4)
        stack.append(p / p.sum())
        rows.append(f"{nm},{real[nm][i]:.9f},0.5,{0.99 - 0.01 * k},psf_{nm}.npy,{k}")
    np.save(out / f"psf_{nm}.npy", np.array(stack, dtype="<f4"))
(out / "psf.csv").write_text("\n".join(rows) + "\n")

t = np.load(sys.argv[1])
keep = {"wavelength_um": t["wavelength_um"][15:16]}
for name in ("ideal_height_mm", "efl_mm", "pixel_um"):
    keep[name] = t[name]
for name in ("real_height_mm", "ri", "psf", "energy_in_window"):
    keep[name] = t[name][15:16]
np.savez_compressed(here / "double-gauss-28-550nm.npz", **keep)
