"""The built-in Double Gauss at any focus: first-order data, real rays and light, for object points at any vergence (NumPy, float64).

Lengths in mm, z along the light from the first vertex; vergence V [1/m] of an object point from the centre of the paraxial entrance pupil; t = tan of
its chief ray's field angle. The field point's image is on +x. Spherical surfaces only. Prescription and glasses are the project's own data.
Source: Welford, Aberrations of Optical Systems, chapters 3 and 4 (exact ray trace).
"""
import csv
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
PRIMARY_UM = 0.5875618


def read():
    """(curvatures [1/mm], thicknesses behind each surface [mm], glass names, index of the stop, entrance pupil diameter [mm])."""
    curvature, thickness, glass, stop, diameter = [], [], [], None, None
    for words in (line.split() for line in (ROOT / "formats/data/lenses/double-gauss-28.zmx").read_text().splitlines() if line.strip()):
        if words[0] == "SURF":
            glass.append("")
        elif words[0] == "ENPD":
            diameter = float(words[1])
        elif words[0] == "STOP":
            stop = len(glass) - 1
        elif words[0] == "CURV":
            curvature.append(float(words[1]))
        elif words[0] == "DISZ":
            thickness.append(float(words[1]))
        elif words[0] == "GLAS":
            glass[-1] = words[1]
    return np.array(curvature[1:]), np.array(thickness[1:]), glass[1:], stop - 1, diameter


def index(name, um):
    """Refractive index by Sellmeier's formula with the coefficients of Schott."""
    if not name:
        return 1.0
    with (ROOT / "pipeline/data/glasses.csv").open() as file:
        row = next(r for r in csv.DictReader(file) if r["name"] == name and r["vendor"] == "SCHOTT")
    assert row["formula"] == "2", f"{name} has formula {row['formula']}, Sellmeier's (2) is known here"
    v = [float(x) for x in row["coefficients"].split()]
    return np.sqrt(1 + sum(b * um * um / (um * um - c) for b, c in zip(v[::2], v[1::2])))


class DoubleGauss:
    """Focused on an object at vergence `focus` by moving the film to its paraxial image at the primary wavelength; the iris stays."""

    def __init__(self, focus, um=PRIMARY_UM, real_aiming=False):
        self.c, gaps, self.glass, self.stop, self.diameter = read()
        self.gaps, self.um, self.real_aiming, self.focus = gaps[:-1], um, real_aiming, focus
        self.n = [1.0] + [index(g, um) for g in self.glass[:-1]]
        self.pupil_z = self._entrance_pupil()
        y, u = self._paraxial(0.0 if focus == 0 else self.diameter / 2 * (1 - self.pupil_z * focus * 1e-3), self.diameter / 2 * focus * 1e-3)
        if focus == 0:
            y, u = self._paraxial(self.diameter / 2, 0.0)
        self.film_gap = -y / u
        y, u = self._paraxial(-self.pupil_z, 1.0)                    # through the centre of the entrance pupil at tan = 1
        self.sign = -1.0 if y + self.film_gap * u < 0 else 1.0
        self.f_d = abs(y + self.film_gap * u)
        y, u = self._paraxial(self.diameter / 2, 0.0)
        self.efl = -self.diameter / 2 / u
        self.stop_radius = abs(self._paraxial(self.diameter / 2, 0.0, self.stop)[0])

    def _primary(self):
        return [1.0] + [index(g, PRIMARY_UM) for g in self.glass[:-1]]

    def _paraxial(self, y, u, last=None):
        """Height and slope behind the last surface, or at surface `last`."""
        n = self._primary()
        for i in range(len(self.c) - 1):
            if i == last:
                return y, u
            u = (n[i] * u - y * self.c[i] * (n[i + 1] - n[i])) / n[i + 1]
            if i + 2 < len(self.c):
                y = y + u * self.gaps[i]
        return y, u

    def _entrance_pupil(self):
        # The ray that meets the stop's centre is y = a ray_1 + b ray_2 of two independent ones.
        a, b = self._paraxial(1.0, 0.0, self.stop)[0], self._paraxial(0.0, 1.0, self.stop)[0]
        return b / a if a else 0.0

    def run(self, start, direction, end=None):
        """Rays (N, 3), (N, 3) from in front of the lens to the film, or to surface `end`: (points, directions, optical path)."""
        z, path, p, d = 0.0, np.zeros(len(start)), start.copy(), direction.copy()
        for i in range(len(self.c) - 1):
            rel = p - [0, 0, z]
            c = self.c[i]
            # c |r|^2 - 2 z = 0 along rel + s d.
            f = c * (rel ** 2).sum(1) - 2 * rel[:, 2]
            g = d[:, 2] - c * (rel * d).sum(1)
            s = f / (g + np.sqrt(g * g - c * f))
            p, path = p + s[:, None] * d, path + self.n[i] * s
            if i == end:
                return p, d, path
            normal = np.stack([-c * p[:, 0], -c * p[:, 1], 1 - c * (p[:, 2] - z)], 1)
            ratio = self.n[i] / self.n[i + 1]
            cos = (d * normal).sum(1)
            d = ratio * d + (np.sqrt(1 - ratio ** 2 * (1 - cos ** 2)) - ratio * cos)[:, None] * normal
            z += self.gaps[i] if i + 2 < len(self.c) else self.film_gap
        s = (z - p[:, 2]) / d[:, 2]
        return p + s[:, None] * d, d, path + s

    def launch(self, t, vergence, x, y):
        """Rays of the object point (t, vergence) through the points (x, y) of the entrance pupil plane: starts, directions, path to the start.

        The object lies at x = -sign t z, so that its image is on +x. Rays start on the plane z = -20 mm; the path is from the object
        point, or from a plane wave through the centre of the entrance pupil.
        """
        tan = -self.sign * t
        toward = np.stack([x * vergence * 1e-3 - tan, y * vergence * 1e-3, np.ones_like(x)], 1)       # (pupil point - object point)/z
        length = np.sqrt((toward ** 2).sum(1))
        d = toward / length[:, None]
        pupil = np.stack([x, y, np.full_like(x, self.pupil_z)], 1)
        back = (self.pupil_z + 20.0) / d[:, 2]
        if vergence == 0:
            return pupil - back[:, None] * d, d, (pupil - [0, 0, self.pupil_z]) @ d[0] - back
        # (length - chief length) z, without cancellation.
        chief = np.sqrt(1 + tan * tan)
        extra = (length ** 2 - chief ** 2) / (length + chief) / (vergence * 1e-3)
        return pupil - back[:, None] * d, d, extra - back

    def pupil_points(self, t, vergence, p, q):
        """Points of the entrance pupil plane for pupil coordinates (p, q) of the unit disc."""
        radius = self.diameter / 2
        x, y = p * radius, q * radius
        if not self.real_aiming:
            return x, y
        for _ in range(12):                                          # Newton with difference quotients: the ray meets the stop at (p, q)
            at = lambda x, y: self.run(*self.launch(t, vergence, x, y)[:2], end=self.stop)[0][:, :2]
            hit, h = at(x, y), 1e-4
            jx, jy = (at(x + h, y) - hit) / h, (at(x, y + h) - hit) / h
            sign = np.sign(jx[:, 0])
            miss = np.stack([sign * p, sign * q], 1) * self.stop_radius - hit
            det = jx[:, 0] * jy[:, 1] - jx[:, 1] * jy[:, 0]
            x = x + (miss[:, 0] * jy[:, 1] - miss[:, 1] * jy[:, 0]) / det
            y = y + (jx[:, 0] * miss[:, 1] - jx[:, 1] * miss[:, 0]) / det
        return x, y

    def bundle(self, t, vergence, rings=12, spokes=32):
        """Rays over the whole pupil: (pupil coordinates (N, 2), weights of the mean, film points from the chief ray's (N, 2),
        directions (N, 3), path - chief's).
        """
        nodes, weights = np.polynomial.legendre.leggauss(rings)
        r2 = (nodes + 1) / 2                                          # even in r: Gauss in r^2, trapezoid in angle
        angle = (np.arange(spokes) + 0.5) * 2 * np.pi / spokes
        p = np.append(np.outer(np.sqrt(r2), np.cos(angle)).ravel(), 0.0)
        q = np.append(np.outer(np.sqrt(r2), np.sin(angle)).ravel(), 0.0)
        start, d, before = self.launch(t, vergence, *self.pupil_points(t, vergence, p, q))
        point, out, path = self.run(start, d)
        path = path + before
        offset = point[:, :2] - point[-1, :2]
        return np.stack([p, q], 1)[:-1], np.repeat(weights / 2, spokes) / spokes, offset[:-1], out[:-1], path[:-1] - path[-1]

    def chief(self, t):
        """Heights on the film of chief rays, and where each crosses the axis in object space, mm behind the entrance pupil (delta)."""
        t, zero = np.atleast_1d(np.asarray(t, float)), np.zeros(1)
        height, delta = np.zeros(len(t)), np.zeros(len(t))
        for i, v in enumerate(t):
            x, y = self.pupil_points(v, 0.0, zero, zero)
            start, d, _ = self.launch(v, 0.0, x, y)
            height[i] = self.run(start, d)[0][0, 0]
            delta[i] = -x[0] / (self.sign * v) if v else 0.0
        return height, delta

    def light(self, t, vergence, rings=12, spokes=32):
        """G of field points t > 0: etendue of the bundle at the object per film area of the chief-ray map, sr; paraxial aiming.

        (bundle area in the pupil) x mean of d(L, M)/d(pupil) x z^2 t/(h h')
        """
        step = 1e-4
        out = np.zeros(len(t))
        for i, v in enumerate(t):
            below, at, above = self.chief([v - step, v, v + step])[0]
            pq, w, *_ = self.bundle(v, vergence, rings, spokes)
            a = pq * self.diameter / 2 * vergence * 1e-3
            mean = (w / ((a[:, 0] + self.sign * v) ** 2 + a[:, 1] ** 2 + 1) ** 2).sum()
            out[i] = np.pi * (self.diameter / 2) ** 2 * mean * v / (at * (above - below) / (2 * step))
        return out

    def solid_angle(self, t, vergence, h=1e-4):
        """Projected solid angle of the field point's bundle at the film, sr: the mean of |d(L, M)/d(p, q)| times pi."""
        nodes, weights = np.polynomial.legendre.leggauss(10)
        angle = (np.arange(24) + 0.5) * 2 * np.pi / 24
        radius = np.sqrt((nodes + 1) / 2)
        p, q = np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()
        lm = lambda p, q: self.run(*self.launch(t, vergence, *self.pupil_points(t, vergence, p, q))[:2])[1][:, :2]
        dp, dq = (lm(p + h, q) - lm(p - h, q)) / (2 * h), (lm(p, q + h) - lm(p, q - h)) / (2 * h)
        return np.pi * (np.repeat(weights / 2, 24) / 24 * np.abs(dp[:, 0] * dq[:, 1] - dp[:, 1] * dq[:, 0])).sum()
