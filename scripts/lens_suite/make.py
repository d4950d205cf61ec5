#!/usr/bin/env python3
"""Figures of the lens suite by a ray tracer in NumPy, written to pipeline/tests/data/lens_suite.txt; with --optiland also compared with Optiland.

    python3 -m venv v && v/bin/pip install numpy==2.4.6 optiland==0.6.3 && v/bin/python scripts/lens_suite/make.py --optiland

First-order figures by paraxial rays; chief rays by the secant method on the height in the stop, followed from the axis in steps of the
angle; relative illumination from the outline of the bundle: 64 rays through the rim of the stop, their area on the object side (in the plane
of the first vertex, or in direction cosines) by the trapezoidal rule along the closed outline, times the chief-ray Jacobian by differences. No
code and no formula of the pupil is shared with the program. Aiming: at the real stop; its radius is that of the real axial marginal ray.
Mirrors: z stays that of the first surface, so that rays run along -z behind a mirror. Central obscurations: the outline of the hole, found by
bisection from the rim of the stop inwards. PSF of the second field point at 0.5876 um: a Huygens sum of plane wavelets over rays at polar
nodes of the stop, between the two outlines, with Jacobians by differences; on the axis-side half plane y >= 0 of a square about the chief ray.
"""

import sys
from pathlib import Path

import numpy as np

from lenses import GLASSES, LENSES, OBSCURED

UM = (0.4861, 0.5876, 0.6563)
OUT = Path(__file__).resolve().parents[2] / "pipeline/tests/data/lens_suite.txt"


HALF = 16
# Rings and spokes of the PSF's rays; lenses with aberrations of many wavelengths need more.
RAYS, MANY_RAYS = (48, 96), (160, 320)
ABERRATED = ("front-stop-singlet", "telephoto")


def dispersion(glass):
    """A, B of n^2 = A + B/lambda^2."""
    if glass == "MIRROR":
        return None
    if not glass:
        return 1.0, 0.0
    n, v = GLASSES[glass]
    b = 2 * n * (n - 1) / v / (1 / 0.4861327**2 - 1 / 0.6562725**2)
    return n * n - b / 0.5875618**2, b


class Lens:
    def __init__(self, name):
        self.name = name
        _, self.stop, self.diameter, self.object, self.tans, rows = LENSES[name]
        rows = [(*row, *(0.0, ())[len(row) - 3 :]) for row in rows] + [(0.0, 0.0, "", 0.0, ())]
        self.rows = [(c, t, dispersion(g), k, tuple(a)) for c, t, g, k, a in rows]
        self.mirrors = [g == "MIRROR" for _, _, g, _, _ in rows]
        self.hidden = OBSCURED.get(name)

    def indices(self, um):
        n = [1.0]
        for _, _, ab, _, _ in self.rows:
            n.append(n[-1] if ab is None else np.sqrt(ab[0] + ab[1] / um**2))
        return n

    def trace(self, um, x, y, l, m, last):
        return self.trace_path(um, x, y, l, m, last)[:4]

    def trace_path(self, um, x, y, l, m, last):
        """Rays from the plane of the first vertex to surface `last`, with n_z and their optical path."""
        n = self.indices(um)
        x, y, l, m = (np.asarray(v, dtype=float) for v in (x, y, l, m))
        z, nz = np.zeros_like(x + y), np.sqrt(1 - l * l - m * m)
        path = np.zeros_like(x + y)
        for i, (c, t, _, k, a) in enumerate(self.rows):
            s = -z / nz
            travelled = s
            x, y, z = x + s * l, y + s * m, 0 * z
            # Newton on z - sag(x, y), from the plane; for spheres started at the closed form.
            f = c * (x * x + y * y)
            g = nz - c * (x * l + y * m)
            root = g * g - c * (1 + k * nz * nz) * f
            s = f / (g + np.sign(nz) * np.sqrt(root))
            travelled = travelled + s
            x, y, z = x + s * l, y + s * m, z + s * nz
            for _ in range(30 if a else 0):
                sag, slope = self.sag(i, x, y)
                s = (sag - z) / (nz - slope * (x * l + y * m))
                travelled = travelled + s
                x, y, z = x + s * l, y + s * m, z + s * nz
            path = path + n[i] * travelled
            if i == last:
                return x, y, l, m, nz, path
            _, slope = self.sag(i, x, y)
            size = np.sqrt(1 + slope**2 * (x * x + y * y))
            nx, ny, nn = -slope * x / size, -slope * y / size, 1 / size
            mu = n[i] / n[i + 1]
            cos1 = l * nx + m * ny + nz * nn
            if self.mirrors[i]:
                l, m, nz = l - 2 * cos1 * nx, m - 2 * cos1 * ny, nz - 2 * cos1 * nn
                z = z - t
                continue
            # The normal points along the ray.
            side = np.sign(cos1)
            nx, ny, nn, cos1 = side * nx, side * ny, side * nn, side * cos1
            gamma = np.sqrt(1 - mu * mu * (1 - cos1 * cos1)) - mu * cos1
            l, m, nz = mu * l + gamma * nx, mu * m + gamma * ny, mu * nz + gamma * nn
            z = z - t

    def sag(self, i, x, y):
        c, _, _, k, a = self.rows[i]
        r2 = x * x + y * y
        root = np.sqrt(1 - (1 + k) * c * c * r2)
        sag, slope = c * r2 / (1 + root), c / root
        for j, v in enumerate(a):
            sag, slope = sag + v * r2 ** (j + 2), slope + 2 * (j + 2) * v * r2 ** (j + 1)
        return sag, slope

    def paraxial(self, um):
        n = self.indices(um)
        y, u, at_stop, last, way = np.array([1.0, 0.0]), np.array([0.0, 1.0]), None, None, 1.0
        for i, (c, t, _, _, _) in enumerate(self.rows):
            if i == self.stop:
                at_stop = y.copy()
            if i == len(self.rows) - 1:
                break
            # Indices are negative where light runs along -z.
            before, after = way * n[i], way * n[i + 1]
            if self.mirrors[i]:
                way, after = -way, -after
            u = (before * u - y * c * (after - before)) / after
            last = y.copy()
            y = y + t * u
        pupil = at_stop[1] / at_stop[0]
        # Along the light.
        u = way * u
        efl, bfl = -1 / u[0], -last[0] / u[0]
        chief = lambda v: v[1] - pupil * v[0]
        exit_position = -chief(y) / chief(u)
        exit_radius = self.diameter / 2 * abs(y[0] + exit_position * u[0])
        return efl, bfl, abs(efl) / self.diameter, pupil, exit_position, exit_radius, chief(y)

    def direction(self, tan, x, y, pupil):
        """Direction cosines of the ray of the field point through (x, y) of the first vertex plane; tan > 0 on the side of +x."""
        if self.object is None:
            l = tan / np.sqrt(1 + tan * tan)
            return l + 0 * x, 0 * x
        dx = x + tan * (self.object + pupil)
        size = np.sqrt(dx * dx + y * y + self.object**2)
        return dx / size, y / size

    def chief(self, um, tan, pupil, sign, start=None):
        """Point of the chief ray in the first vertex plane and its height in the image plane, for the field angle whose tangent is `tan`."""

        def miss(x, t):
            l, m = self.direction(sign * t, np.float64(x), np.float64(0.0), pupil)
            return self.trace(um, x, 0.0, l, m, self.stop)[0]

        angles = np.linspace(0, np.arctan(tan), max(3, int(np.degrees(np.arctan(tan)) * 2)))[1:] if tan else [0.0]
        x, before = 0.0, []
        for angle in angles:
            t = np.tan(angle)
            if before:
                # The crossing with the axis is extrapolated in the square of the angle.
                shifts = [(a * a, -b / np.tan(a) / sign) for a, b in before[-3:]]
                x = -sign * t * sum(
                    v * np.prod([(angle**2 - q) / (p - q) for j, (q, _) in enumerate(shifts) if j != i]) for i, (p, v) in enumerate(shifts)
                )
            else:
                x = -sign * t * pupil
            a, b = x, x + 1e-4 * self.diameter
            fa, fb = miss(a, t), miss(b, t)
            for _ in range(60):
                if fb == fa:
                    break
                a, fa, b = b, fb, b - fb * (b - a) / (fb - fa)
                fb = miss(b, t)
                if abs(b - a) < 1e-14 * max(1.0, abs(b)):
                    break
            x = b
            before.append((angle, x))
        l, m = self.direction(sign * tan, np.float64(x), np.float64(0.0), pupil)
        return x, float(self.trace(um, x, 0.0, l, m, len(self.rows) - 1)[0])

    def at_stop(self, um, tan, pupil, sign, tx, ty, start):
        """Points of the first vertex plane whose rays cross the stop at (tx, ty), by Newton's method from `start`, and their directions."""
        x, y = start
        for _ in range(30):
            def hit(x, y):
                l, m = self.direction(sign * tan, x, y, pupil)
                return self.trace(um, x, y, l, m, self.stop)[:2]
            e = 1e-6 * self.diameter
            (hx, hy), (ax, ay), (bx, by) = hit(x, y), hit(x + e, y), hit(x, y + e)
            a, b, c, d = (ax - hx) / e, (bx - hx) / e, (ay - hy) / e, (by - hy) / e
            det = a * d - b * c
            dx, dy = (d * (tx - hx) - b * (ty - hy)) / det, (a * (ty - hy) - c * (tx - hx)) / det
            x, y = x + dx, y + dy
            if np.abs(dx).max() + np.abs(dy).max() < 1e-13 * self.diameter:
                break
        return x, y

    def outline(self, um, tan, pupil, sign, stop_radius, phi):
        """Points of the first vertex plane whose rays go through the rim of the stop at the angles phi."""
        x0, _ = self.chief(um, tan, pupil, sign)
        x, y = x0 + 1e-9 * np.cos(phi), 1e-9 * np.sin(phi)
        for part in np.linspace(0.1, 1, 10):
            x, y = self.at_stop(um, tan, pupil, sign, part * stop_radius * np.cos(phi), part * stop_radius * np.sin(phi), (x, y))
        return x, y

    def hole(self, um, tan, pupil, sign, stop_radius, phi):
        """Share of the stop's radius at the angles phi within which rays are hidden."""
        if self.hidden is None:
            return 0 * phi
        surface, radius = self.hidden
        low, high = 0 * phi, 1 + 0 * phi
        start = self.outline(um, tan, pupil, sign, 1e-6 * stop_radius, phi)
        for _ in range(45):
            middle = (low + high) / 2
            x, y = self.at_stop(um, tan, pupil, sign, middle * stop_radius * np.cos(phi), middle * stop_radius * np.sin(phi), start)
            l, m = self.direction(sign * tan, x, y, pupil)
            hx, hy = self.trace(um, x, y, l, m, surface)[:2]
            inside = np.hypot(hx, hy) < radius
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return (low + high) / 2

    def flux(self, um, tan, pupil, sign, stop_radius):
        """Area of the bundle on the object side: of (x, y) for an object at infinity, of (L, M) at a finite object."""
        phi = np.arange(64) * 2 * np.pi / 64

        def area(share):
            x0, _ = self.chief(um, tan, pupil, sign)
            x, y = x0 + 1e-9 * np.cos(phi), 1e-9 * np.sin(phi)
            for part in np.linspace(0.1, 1, 10):
                r = part * share * stop_radius
                x, y = self.at_stop(um, tan, pupil, sign, r * np.cos(phi), r * np.sin(phi), (x, y))
            if self.object is not None:
                x, y = self.direction(sign * tan, x, y, pupil)
            # Area inside a smooth closed outline: derivatives by the FFT.
            k = np.fft.fftfreq(64, 1 / 64)
            k[32] = 0
            slope = lambda v: np.fft.ifft(1j * k * np.fft.fft(v)).real
            return abs(0.5 * np.sum(x * slope(y) - y * slope(x)) * 2 * np.pi / 64)

        if self.hidden is None:
            return area(1 + 0 * phi)
        return area(1 + 0 * phi) - area(self.hole(um, tan, pupil, sign, stop_radius, phi))

    def psf(self, um, tan, pupil, sign, stop_radius):
        """Pitch in um and samples of the PSF about the chief ray, rows y from 0 up, columns x; peak 1."""
        rings, spokes = MANY_RAYS if self.name in ABERRATED else RAYS
        nodes, weights = np.polynomial.legendre.leggauss(rings)
        phi = (np.arange(spokes) + 0.5) * 2 * np.pi / spokes
        inner = self.hole(um, tan, pupil, sign, stop_radius, phi)
        rho = inner + (1 - inner) * (nodes[:, None] + 1) / 2
        area = rho * (1 - inner) * weights[:, None] * stop_radius**2
        tx, ty = rho * stop_radius * np.cos(phi), rho * stop_radius * np.sin(phi)
        x0, y0 = self.chief(um, tan, pupil, sign)
        x, y = x0 + 1e-6 * tx, 1e-6 * ty
        for part in np.linspace(0.1, 1, 10):
            x, y = self.at_stop(um, tan, pupil, sign, part * tx, part * ty, (x, y))

        def image(tx, ty):
            px, py = self.at_stop(um, tan, pupil, sign, tx, ty, (x, y))
            l, m = self.direction(sign * tan, px, py, pupil)
            start = l * px + m * py if self.object is None else np.sqrt((px + sign * tan * (self.object + pupil)) ** 2 + py**2 + self.object**2)
            out = self.trace_path(um, px, py, l, m, len(self.rows) - 1)
            source = (px, py) if self.object is None else (l, m)
            return (*out[:5], out[5] + start, *source)

        def jacobian(i, k):
            e = 1e-4 * stop_radius
            a, b = image(tx + e, ty), image(tx - e, ty)
            c, d = image(tx, ty + e), image(tx, ty - e)
            return np.abs((a[i] - b[i]) * (c[k] - d[k]) - (c[i] - d[i]) * (a[k] - b[k])) / (2 * e) ** 2

        hx, hy, l, m, nz, path, *_ = image(tx, ty)
        amplitude = np.sqrt(jacobian(6, 7) * jacobian(2, 3) / np.abs(nz)) * area
        k = 2 * np.pi / um
        w = (path - path.mean() - l * (hx - y0) - m * hy) * 1e3
        # 0.9 of the Nyquist pitch.
        pitch = float(f"{0.9 * um / (2 * max(np.ptp(l), np.ptp(m))):.6g}")
        at = pitch * np.arange(-HALF, HALF + 1)
        c = (amplitude * np.exp(1j * k * w)).ravel()
        across = np.exp(1j * k * at[:, None] * l.ravel())
        up = np.exp(1j * k * at[HALF:, None] * m.ravel())
        u = (up * c) @ across.T
        psf = np.abs(u) ** 2
        return pitch, psf / psf.max()

    def light(self, um, tan, pupil, sign, stop_radius):
        """Irradiance of the film over radiance of the object, sr."""
        step = 2e-4
        height = lambda t: self.chief(um, t, pupil, sign)[1] if t > 0 else -height(-t) if t < 0 else 0.0
        slope = (height(tan - 2 * step) - 8 * height(tan - step) + 8 * height(tan + step) - height(tan + 2 * step)) / (12 * step)
        per_tan = tan / (height(tan) * slope) if tan else slope**-2
        field = (1 + tan * tan) ** -2 if self.object is None else (self.object + pupil) ** 2
        return self.flux(um, tan, pupil, sign, stop_radius) * abs(per_tan) * field


def figures(name):
    lens = Lens(name)
    efl, bfl, number, pupil, exit_position, exit_radius, f = lens.paraxial(UM[1])
    sign = np.sign(f)
    # Real axial marginal ray through the rim of the paraxial pupil.
    radius = lens.diameter / 2
    if lens.object is None:
        x, l = radius, 0.0
    else:
        x, l = radius * lens.object / (lens.object + pupil), radius / np.hypot(radius, lens.object + pupil)
    stop_radius = abs(float(lens.trace(UM[1], x, 0.0, l, 0.0, lens.stop)[0]))
    axis = lens.light(UM[1], 0.0, pupil, sign, stop_radius)
    lines = [f"lens {name}", f"object {'inf' if lens.object is None else lens.object}", f"stop {lens.stop}", f"diameter {lens.diameter}"]
    for c, t, ab, k, asphere in lens.rows[:-1]:
        # A = 0: a mirror.
        a, b = ab or (0.0, 0.0)
        lines.append("surface " + " ".join(repr(float(v)) for v in (c, t, a, b, k, *asphere)))
    if lens.hidden:
        lines.append(f"obscuration {lens.hidden[0]} {lens.hidden[1]}")
    lines.append("paraxial " + " ".join(f"{v:.12g}" for v in (efl, bfl, number, pupil, exit_position, exit_radius)))
    for tan in lens.tans:
        heights = [lens.chief(um, tan, pupil, sign)[1] for um in UM]
        ri = lens.light(UM[1], tan, pupil, sign, stop_radius) / axis
        lines.append(f"field {tan!r} " + " ".join(f"{h:.12g}" for h in heights) + f" {ri:.10g}")
    tan = lens.tans[1]
    pitch, psf = lens.psf(UM[1], tan, pupil, sign, stop_radius)
    lines.append(f"psf {tan!r} {pitch!r}")
    lines += ["row " + " ".join(f"{v:.5f}" for v in row) for row in psf]
    return lens, lines


def optiland_figures(lens):
    """EFL, and real chief-ray heights at paraxial aiming of the primary wavelength, by Optiland and by this tracer."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    optic = Optic()
    optic.add_surface(index=0, thickness=np.inf)
    n = lens.indices(UM[1])
    for i, (c, t, _, k, a) in enumerate(lens.rows):
        kind = dict(surface_type="even_asphere", coefficients=[0.0, *a]) if a else {}
        mirror = i < len(lens.mirrors) and lens.mirrors[i]
        material = "mirror" if mirror else IdealMaterial(n=float(n[i + 1]))
        optic.add_surface(index=i + 1, radius=1 / c if c else np.inf, thickness=t, material=material, conic=k, is_stop=i == lens.stop, **kind)
    optic.set_aperture(aperture_type="EPD", value=lens.diameter)
    optic.set_field_type(field_type="angle")
    optic.add_field(y=float(np.degrees(np.arctan(lens.tans[0]))))
    optic.add_wavelength(value=UM[1], is_primary=True)
    rays = optic.trace_generic(Hx=0, Hy=1, Px=0, Py=0, wavelength=UM[1])
    return float(optic.paraxial.f2()), float(np.ravel(rays.y)[0])


def main():
    text = ["# Made by scripts/lens_suite/make.py: prescriptions with n^2 = A + B/lambda^2 [um], figures by NumPy at 0.4861, 0.5876, 0.6563 um.",
            "# surface: curvature thickness A B conic r^4 r^6 ...; paraxial: EFL BFL F-number entrance-pupil exit-pupil exit-radius;",
            "# field: tangent, heights at the three wavelengths [mm], relative illumination at 0.5876 um; psf: tangent, pitch [um], then",
            "# rows y = 0, 1, ... of 33 samples along x, peak 1."]
    for name in LENSES:
        lens, lines = figures(name)
        text += lines
        print(name, lines[-2 - HALF])
        if "--optiland" in sys.argv and lens.object is None:
            efl, y = optiland_figures(lens)
            own = lens.paraxial(UM[1])
            tan = lens.tans[0]
            pupil = own[3]
            l = tan / np.hypot(1, tan)
            paraxial = float(lens.trace(UM[1], -tan * pupil, 0.0, l, 0.0, len(lens.rows) - 1)[0])
            print(f"  Optiland: EFL {efl - own[0]:.1e}, chief height (paraxial aiming) {abs(y) - abs(paraxial):.1e} mm")
    OUT.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()
