"""Means over rings of the tails of PSFs, by rays and sums in Python: the rows of ../tail_rings.csv.

    for lens in double-gauss-28 phone macro-70 mirror-500 mirrorless-50; do lenscube lens convert $lens $lens.zmx; done
    python make_tail_rings.py > ../tail_rings.csv

Python 3.11, numpy 2.4.6, finufft 2.5.1. rays.py traces (spheres, even aspheres, mirrors, obscurations), psf.py sums the wavelets of the whole pupil
with its exact edges up to ten half windows, and has the constant C of the far tail in closed form.
"""
import math
import numpy as np
from rays import Design, Tracer
from psf import Pupil
def sellmeier(b1, b2, b3, c1, c2, c3):
    return lambda um: math.sqrt(1 + um * um * (b1 / (um * um - c1) + b2 / (um * um - c2) + b3 / (um * um - c3)))


# Schott's catalogue.
GLASSES = {
    'N-SK2': sellmeier(1.28189012, .257738258, .96818604, .0072719164, .0242823527, 110.377773),
    'N-SK16': sellmeier(1.34317774, .241144399, .994317969, .00704687339, .0229005, 92.7508526),
    'F5': sellmeier(1.3104463, .19603426, .96612977, .00958633048, .0457627627, 115.011883),
}

QS = (1, 1.5, 2, 3, 5, 8)
CASES = [('double-gauss-28', .5876, 0, (.55, .65), (0, 22), 42, 8), ('double-gauss-28', .5876, 0, (.45,), (0, 12), 60, 8),
         ('phone', .546, 1, (.45, .55, .65), (0, 2.2), 42, 8), ('macro-70', .58756, 1, (.45, .55, .65), (0, 10), 42, 8),
         ('mirror-500', .587562, 1, (.45, .55, .65), (0, 10), 90, 8), ('mirrorless-50', .58756, 1, (.45, .55, .65), (0, 10), 90, 3)]
print('lens,um,height_mm,half_um,c_um,blur_um,' + ','.join('r%g' % q for q in QS))
for name, prim, lim, ums, hs, half_um, last in CASES:
    d = Design(name + '.zmx', GLASSES)
    for um in ums:
        tr = Tracer(d, um, prim, lim)
        for h in hs:
            t = tr.field_of(h)
            probe = Pupil(tr, t, 0.01)
            pitch, hw = 0.9 * um / (2 * probe.na) * 1e-3, half_um * 1e-3
            half = int(1.26 * last * hw / pitch)
            pu = Pupil(tr, t, half * pitch, per_cycle=2.3)
            im, c = pu.image(half, pitch), pu.tail_constant()
            rr = np.hypot(*(np.indices(im.shape) - half)) * pitch
            row = []
            for q in QS:
                m = (rr >= 0.8 * q * hw) & (rr < 1.25 * q * hw)
                row.append('%.5g' % (1e3 * (im[m] * rr[m] ** 3).mean() / pitch ** 2) if q <= last else '')
            print(f'{name},{um},{h},{half_um},{1e3*c:.5g},{1e3*probe.blur:.3g},' + ','.join(row), flush=True)
