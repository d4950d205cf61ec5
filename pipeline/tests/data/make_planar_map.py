"""Golden values of a map without rotational symmetry, by the NumPy reference of FIELDS.md (`fields_reference.py`).

    PYTHONPATH=<folder of fields_reference.py> python make_planar_map.py > planar_map.txt      # Python 3.11, NumPy 2.4.6

The map is `sample` below on 9 x 11 nodes; `pipeline/src/lens/planar/tests.rs` has the same expressions. Lines: X, Y, ideal X, ideal Y (mm), R at 200 quasi-random
points; the place and value of the least det d(ideal)/d(film) on the grid three times as fine; 12 rows of 16 pixels of 1.7 mm of the remapped image, axis at row 5.3 and
column 7.6, of a chart of 40 x 50 px.
"""
import numpy as np
from fields_reference import Map, scene


def sample(x, y):
    r2 = x * x + y * y
    keystone = 1.0 / (1.0 + 1e-3 * x - 2e-3 * y)
    radial = 1.01 - 5e-5 * r2 + 4e-8 * r2 * r2
    vignetting = 1.0 + 2e-3 * r2
    return x * radial * keystone - 0.03, y * radial * keystone + 0.05, 1.0 / (vignetting * vignetting) + 1e-3 * x


xs, ys = -14.0 + 3.0 * np.arange(11), -13.0 + 3.125 * np.arange(9)
m = Map(xs, ys, *sample(*np.meshgrid(xs, ys)))
k = np.arange(200)
X, Y = -14.0 + 30.0 * (k * 0.7548776662466927 % 1.0), -13.0 + 25.0 * (k * 0.5698402909980532 % 1.0)
for row in zip(X, Y, *m.at(X, Y)[:3]):
    print(" ".join(repr(float(v)) for v in row))
X, Y = np.meshgrid(np.linspace(xs[0], xs[-1], 31), np.linspace(ys[0], ys[-1], 25))
det = m.at(X, Y)[3]
i = np.unravel_index(det.argmin(), det.shape)
print(" ".join(repr(float(v)) for v in (X[i], Y[i], det[i])))
y, x = np.mgrid[:40, :50]
for row in scene((y * 7919 + x * 104729) % 1009 / 1009.0, m, 1.7, (12, 16), 0, (5.3, 7.6)):
    print(" ".join(repr(float(v)) for v in row))
