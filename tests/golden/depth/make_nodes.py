#!/usr/bin/env python3
"""Makes nodes.json: first-order data, light, errors of kernels and depth nodes of the built-in Double Gauss, float64.

    python3 -m venv v && v/bin/pip install numpy==2.4.6
    v/bin/python tests/golden/depth/make_nodes.py [FILE]       default: nodes.json beside this file; half a minute

    focus       per vergence in focus [1/m]: distortion focal length [mm], film behind the last vertex [mm], blur per dioptre [um]
    chief       real aiming, focus 0.5 1/m: tan of the field angle, height on the film [mm], shift of the pupil [mm]
    light       focus 0.5 1/m, paraxial aiming: G(V)/G(0.5) at `tan`, of the object side
    errors      550 nm, focus 0.5 1/m, film pixel 2 um, at 0 and 10 degrees and at `blur_px` on either side of focus (negative: farther): L1 and
                largest ESF error half-way between nodes one pixel of blur apart
    placement   nodes [1/m] for a tolerance, and the largest errors half-way
"""
import json
import sys
from pathlib import Path

import numpy as np

import depth_nodes as nodes
from double_gauss import DoubleGauss


def figures():
    out = {"focus": [], "chief": [], "light": [], "errors": [], "placement": []}
    for v in (0.0, 0.5, 1.0):
        lens = DoubleGauss(v)
        out["focus"].append(dict(vergence=v, distortion_focal_length_mm=lens.f_d, film_mm=lens.film_gap,
                                 blur_per_dioptre_um=lens.diameter / 2 * lens.f_d, entrance_pupil_mm=lens.pupil_z))
    tan = [0.05, 0.1, 0.15, 0.2, 0.25]
    height, delta = DoubleGauss(0.5, real_aiming=True).chief(tan)
    out["chief"] = [dict(tan=t, height_mm=h, pupil_shift_mm=d) for t, h, d in zip(tan, height.tolist(), delta.tolist())]
    lens, tan = DoubleGauss(0.5), [1e-3, 0.1, 0.2]
    at_focus = lens.light(np.array(tan), 0.5)
    out["light"] = [dict(vergence=v, tan=tan, etendue_ratio=(lens.light(np.array(tan), v) / at_focus).tolist()) for v in (0.0, 1.0, 2.0)]
    pupils = nodes.double_gauss_pupils()
    for degrees, pupil in zip((0, 10), pupils):
        for blur in (-16, -8, -4, 0, 4, 8, 16):
            v = pupil.focus + blur / pupil.blur_px
            l1, esf = nodes.errors(pupil, v, 0.5 / pupil.blur_px).tolist()
            out["errors"].append(dict(degrees=degrees, blur_px=blur, l1=l1, esf=esf))
    reach = 12 / pupils[0].blur_px
    found, l1, esf = nodes.place(pupils, 0.5 - reach, 0.5 + reach, 0.02, 1e-3)
    out["placement"].append(dict(first=0.5 - reach, last=0.5 + reach, l1_tolerance=0.02, esf_tolerance=1e-3, l1=l1, esf=esf,
                                 vergence=found.tolist()))
    return out


if __name__ == "__main__":
    to = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "nodes.json"
    text = json.dumps(figures(), indent=1, default=float)
    to.write_text(text + "\n")
    print(to, len(text), "bytes")
