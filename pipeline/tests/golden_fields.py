"""Golden numbers of psf_fields.rs: films of a polar and a Cartesian field by the NumPy reference, whose folder is the argument."""
import sys
sys.path.insert(0, sys.argv[1])
from fields_reference import *

N, PITCH, SHAPE, AXIS, GROWN = 25, 2e-3, (24, 26), (10.25, 11.5), 12


def spot(cx, cy, a, b):
    at = np.arange(N) - N // 2
    x, y = np.meshgrid(at, at)
    k = np.exp(-((x - cx) ** 2 / (2 * a * a) + (y - cy) ** 2 / (2 * b * b)))
    return (k / k.sum()).astype(np.float32).astype(float)


def ramp(h, w):
    return ((np.arange(h * w) * 7919 % 1009) / 1009.0).reshape(h, w)


image = ramp(SHAPE[0] + 2 * GROWN, SHAPE[1] + 2 * GROWN)
height = np.array([0.0, 0.017, 0.04])
samples = [1, 5, 8]
Q = [np.array([spot(0.9 * np.cos(a) + 0.2 * k, 0.7 * np.sin(2.0 * a + k), 1.0 + 0.1 * a / A, 1.3 - 0.1 * k) for a in range(A)]) for k, A in enumerate(samples)]
polar = PolarField(height, [1, 8, 12], Q)
gx, gy = np.array([-0.02, 0.0, 0.02]), np.array([-0.015, 0.0, 0.015, 0.03])
grid = GridField(gx, gy, np.array([[spot(0.5 * i - 0.4 * j, 0.6 * j - 0.3 * i, 1.0 + 0.1 * j, 1.3 - 0.1 * i) for i in range(3)] for j in range(4)]))
for name, f in (("polar", polar), ("grid", grid)):
    film = spread(image, f, PITCH, SHAPE, GROWN, AXIS)
    print(name, film.max(), film.sum(), [float(film[y, x]) for y, x in ((0, 0), (3, 20), (10, 11), (11, 12), (14, 2), (17, 25), (23, 0), (23, 25))])
