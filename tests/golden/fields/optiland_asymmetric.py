"""Designs without rotational symmetry in Optiland, and real rays of their field points on the film.

LENS FRAME  Optiland's own: x right, y up, z along the light. FILM FRAME  X = x, Y = -y of the frame of the image surface. Field slopes t = (L/N, M/N).
Chief rays pass through the centre of the stop surface's frame; objects at infinity.
"""
import json
import tempfile
import warnings
from pathlib import Path

import numpy as np
from optiland.fileio import load_optiland_file
from optiland.optic import Optic
from optiland.physical_apertures import RectangularAperture
from optiland.physical_apertures.offset_radial import OffsetRadialAperture
from optiland.rays import RealRays

UM = 0.55
AIR = "air"
NEWTON_MM = 1e-14


def optic(epd_mm, surfaces):
    """Optiland's lens of these surfaces, by the arguments of `add_surface`; the last is the film."""
    lens = Optic()
    lens.add_surface(index=0, radius=np.inf, z=-np.inf)
    for i, arguments in enumerate(surfaces, 1):
        lens.add_surface(index=i, **arguments)
    lens.set_aperture("EPD", epd_mm)
    lens.set_field_type("angle")
    lens.add_field(y=0)
    lens.add_wavelength(UM, is_primary=True)
    for surface in lens.surface_group.surfaces:
        if hasattr(surface.geometry, "tol"):
            surface.geometry.tol = NEWTON_MM
    return lens


def place(x=0.0, y=0.0, z=0.0, rx=0.0, ry=0.0):
    """Where a surface is: mm, degrees."""
    return dict(x=x, y=y, z=z, rx=np.radians(rx), ry=np.radians(ry))


def reflected(d, rx, ry):
    """The direction of a ray along `d` behind a plane mirror tilted by rx, ry degrees."""
    a, b = np.radians([rx, ry])
    n = np.array([np.sin(b) * np.cos(a), -np.sin(a), np.cos(b) * np.cos(a)])
    return d - 2 * (d @ n) * n


def tilted_mirror():
    """A spherical mirror tilted about two axes; the film across the reflected axis, refocused roughly."""
    tilt = (4.0, -3.0)
    d = reflected(np.array([0.0, 0.0, 1.0]), *tilt)
    at = np.array([0.0, 0.0, 60.0]) + 100.0 * d
    film = dict(rx=float(np.degrees(np.arctan2(d[1], -d[2]))), ry=float(np.degrees(-np.arcsin(d[0]))))
    return optic(10, [
        dict(radius=np.inf, is_stop=True, **place()),
        dict(radius=-200, material="mirror", **place(z=60, rx=tilt[0], ry=tilt[1])),
        dict(radius=np.inf, **place(*at, **film)),
    ]), 6.0


def off_axis_parabola():
    """A piece of a paraboloid of f = 100 mm, 40 mm off its axis, with the aperture of the piece; the film about the focus."""
    piece = OffsetRadialAperture(r_max=12, r_min=0, offset_x=0, offset_y=40)
    return optic(16, [
        dict(radius=np.inf, is_stop=True, **place(y=40, z=0)),
        dict(radius=-200, conic=-1.0, material="mirror", aperture=piece, **place(z=120)),
        dict(radius=np.inf, **place(z=20, rx=-22.0)),
    ]), 3.0


def anamorphic():
    """A biconic and a toroidal surface of two lenses, a rectangular stop."""
    return optic(6, [
        dict(surface_type="biconic", radius_x=80, radius_y=60, conic_x=-0.5, conic_y=0.8, material="N-BK7", **place()),
        dict(radius=-300, material=AIR, **place(z=4)),
        dict(radius=np.inf, is_stop=True, aperture=RectangularAperture(-4, 4, -3, 3), **place(z=8)),
        dict(surface_type="toroidal", radius_x=70, radius_y=100, conic=-1.2, toroidal_coeffs_poly_y=[0.0, 2e-7], material="N-BK7", **place(z=12)),
        dict(radius=-90, material=AIR, **place(z=15)),
        dict(radius=np.inf, **place(z=58)),
    ]), 8.0


def freeform_mirror():
    """A tilted mirror with XY terms."""
    terms = np.zeros((5, 5))
    for (i, j), c in {(2, 0): 5e-6, (0, 2): -4e-6, (2, 1): 4e-7, (0, 3): -3e-7, (4, 0): 2e-9, (2, 2): 5e-9}.items():
        terms[i, j] = c
    d = reflected(np.array([0.0, 0.0, 1.0]), 15.0, 0.0)
    at = np.array([0.0, 0.0, 50.0]) + 98.0 * d
    return optic(8, [
        dict(radius=np.inf, is_stop=True, **place()),
        dict(surface_type="polynomial", radius=-200, conic=-0.3, coefficients=terms, material="mirror", **place(z=50, rx=15)),
        dict(radius=np.inf, **place(*at, rx=float(np.degrees(np.arctan2(d[1], -d[2]))))),
    ]), 6.0


def scheimpflug():
    """A Double Gauss with a film tilted about two axes."""
    from optiland.samples.objectives import DoubleGauss

    base = DoubleGauss()
    rows = []
    for surface in base.surface_group.surfaces[1:]:
        g = surface.geometry
        row = dict(radius=float(np.ravel(g.radius)[0]), is_stop=bool(surface.is_stop), **place(z=float(np.ravel(g.cs.z)[0])))
        index = float(np.ravel(surface.material_post.n(UM))[0])
        rows.append((row, index))
    from optiland.materials import IdealMaterial

    surfaces = [dict(material=IdealMaterial(n), **row) for row, n in rows]
    surfaces[-1].update(rx=np.radians(4.0), ry=np.radians(-2.5))
    return optic(20, surfaces), 16.0


DESIGNS = {"tilted-mirror": tilted_mirror, "off-axis-parabola": off_axis_parabola, "anamorphic": anamorphic, "freeform-mirror": freeform_mirror, "scheimpflug": scheimpflug}


class Rays:
    """Real rays of a design as it is saved."""

    def __init__(self, lens):
        self.surfaces = lens.surface_group.surfaces[1:]
        self.stop = next(i for i, s in enumerate(self.surfaces) if s.is_stop)
        first = self.surfaces[0].geometry.cs
        # Rays start in a plane before the first surface.
        self.z = float(np.ravel(first.z)[0]) - 50.0
        self.um, self.index = UM, [1.0] * len(self.surfaces)
        # The real ray from the edge of the entrance pupil, along y, of the field of the axis of the stop.
        cs = self.surfaces[self.stop].geometry.cs
        x, y = (float(np.ravel(v)[0]) for v in (cs.x, cs.y))
        self.stop_radius = abs(self.run(x, y + lens.aperture.value / 2, (0.0, 0.0), self.stop)[1, 0])

    def launch(self, t, x, y):
        """Rays of the field of slopes t at (x, y) of the plane where they start."""
        n = 1 / np.sqrt(1 + t[0] ** 2 + t[1] ** 2)
        return np.array([x, y, np.full(np.shape(x), self.z)]), np.tile(np.array([[t[0] * n], [t[1] * n], [n]]), (1, np.size(x)))

    def aim(self, t, p, q, h=1e-4):
        """Where rays start that cross the stop at (p, q) times its radius, by Newton's method, and the area there per dp dq."""
        want = self.stop_radius * np.array([np.broadcast_to(v, np.shape(p)) for v in (p, q)], float)
        at = self.stop_centre(t)[:, None] + want
        for _ in range(40):
            x, y = at
            many = self.run(np.concatenate([x, x + h, x - h, x, x]), np.concatenate([y, y, y, y + h, y - h]), t, self.stop).reshape(2, 5, -1)
            e, by_x, by_y = want - many[:, 0], (many[:, 1] - many[:, 2]) / (2 * h), (many[:, 3] - many[:, 4]) / (2 * h)
            det = by_x[0] * by_y[1] - by_x[1] * by_y[0]
            if np.abs(e).max() < 1e-11:
                break
            at = at + np.array([by_y[1] * e[0] - by_y[0] * e[1], by_x[0] * e[1] - by_x[1] * e[0]]) / det
        return *at, self.stop_radius ** 2 / np.abs(det)

    def stop_centre(self, t):
        """Where a straight line along the field to the centre of the stop starts."""
        cs = self.surfaces[self.stop].geometry.cs
        x, y, z = (float(np.ravel(v)[0]) for v in (cs.x, cs.y, cs.z))
        return np.array([x - t[0] * (z - self.z), y - t[1] * (z - self.z)])

    def run(self, x, y, t, last):
        """Where rays from (x, y) cross surface `last`, in its frame."""
        one = np.ones(np.size(x))
        o, d = self.launch(t, np.atleast_1d(x), np.atleast_1d(y))
        rays = RealRays(*o, *d, one, UM * one)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            for surface in self.surfaces[:last + 1]:
                rays = surface.trace(rays)
            self.surfaces[last].geometry.localize(rays)
        return np.array([np.ravel(rays.x), np.ravel(rays.y)])

    def chief(self, t):
        """(X, Y) of the chief ray, mm."""
        x, y, _ = self.aim(t, np.zeros(1), np.zeros(1))
        return self.run(x, y, t, len(self.surfaces) - 1)[:, 0] * [1, -1]

    def by_slopes(self, t, h=1e-4):
        """d(X, Y)/d(tx, ty) of the chief ray: differences over h and 2 h, extrapolated."""
        at = lambda h: np.array([(self.chief(t + v) - self.chief(t - v)) / (2 * h) for v in np.eye(2) * h]).T
        return (4 * at(h) - at(2 * h)) / 3

    def field_of(self, place):
        """Slopes of the field whose chief ray reaches (X, Y); from the slopes around 0 that lead nearest."""
        grid = [np.array([a, b]) for a in np.linspace(-0.4, 0.4, 9) for b in np.linspace(-0.4, 0.4, 9)]
        miss = lambda t: np.nan_to_num(np.abs(self.chief(t) - place).max(), nan=np.inf)
        t = min(grid, key=miss)
        for _ in range(30):
            e = place - self.chief(t)
            if np.abs(e).max() < 1e-11:
                break
            t = t + np.linalg.solve(self.by_slopes(t), e)
        return t
