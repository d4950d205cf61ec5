"""Built lenses in Optiland: a design of the program with errors of its surfaces, real rays of its field points on the film.

Design: what `lenscube lens convert DESIGN OUT.json` writes. Glasses: named ones by Optiland's catalogue, model glasses by Conrady's formula (below);
each lens here is for one wavelength, its media have one index. Objects at infinity.

LENS FRAME  right-handed, x right, y up, z along the light, mm from the first vertex. FILM FRAME  X right, Y DOWN: X = x, Y = -y of the film as built.
Field slopes t = (L/N, M/N). Pupil coordinates (p, q) along x and y of the lens frame:
  paraxial aiming   (p, q) * radius of the NOMINAL entrance pupil, in its plane (Optiland's EPL, EPD at the primary wavelength)
  real aiming       (p, q) * radius of the stop, in the frame of the stop AS BUILT; the radius is that of the real marginal ray of the axis point
Errors are nested coordinate systems of Optiland: each motion is a decentre with a tilt about x, then one about y in its frame, from its pivot, then the
way back; no matrix is made here. Surfaces count from 1, the film is the last.
"""
import json
import math
import subprocess
import tempfile
import warnings
from pathlib import Path

import numpy as np
from optiland.coordinate_system import CoordinateSystem
from optiland.geometries import EvenAsphere, Plane, PolynomialGeometry, StandardGeometry
from optiland.materials import IdealMaterial, Material
from optiland.optic import Optic
from optiland.rays import RealRays
from optiland.surfaces.standard_surface import Surface

from tolerances import Errors

NEWTON_MM = 1e-14
LINES_UM = {"F": 0.4861327, "d": 0.5875618, "C": 0.6562725, "g": 0.4358343}


def model_index(n_d, v_d, um, delta_p_gf=0.0):
    """n = n0 + A/w + B/w^3.5 (Conrady) through n_d, V_d and P_gF = 0.6438 - 0.001682 V_d (normal glasses, Schott TIE-29)."""
    rows = lambda w: np.array([1 / w, w ** -3.5])
    f, d, c, g = (rows(LINES_UM[k]) for k in "FdCg")
    main = (n_d - 1) / v_d
    a = np.linalg.solve([f - c, g - f], [main, (0.6438 - 0.001682 * v_d + delta_p_gf) * main])
    return float(n_d + a @ (rows(um) - d))


class Design:
    """A prescription: radius, conic, even aspheric terms, vertex z and medium of each surface."""

    def __init__(self, data):
        self.data = data
        surfaces = data["surface_group"]["surfaces"]
        if np.isfinite(float(surfaces[0]["geometry"]["cs"]["z"])):
            raise ValueError("objects at infinity only")
        self.rows = surfaces[1:]
        geometry = [s["geometry"] for s in self.rows]
        self.radius = [float(g["radius"]) for g in geometry]
        self.conic = [float(g.get("conic", 0.0)) for g in geometry]
        self.asphere = [[float(v) for v in g.get("coefficients", [])] for g in geometry]
        self.z = [float(g["cs"]["z"]) for g in geometry]
        self.stop = 1 + next(i for i, s in enumerate(self.rows) if s["is_stop"])
        self.semi_diameters_mm = data["lenscube"]["semi_diameters_mm"]
        self.is_real_aiming = data["ray_aiming"]["mode"] != "paraxial"
        waves = data["wavelengths"]["wavelengths"]
        self.wavelengths_um = [w["value"] for w in waves]
        self.primary_um = next(w["value"] for w in waves if w["is_primary"])
        nominal = Built(self, self.primary_um)
        self.pupil_z, self.pupil_radius = nominal.paraxial_pupil()
        edge, _ = nominal.to_surface(self.stop, self.pupil_radius, 0.0, (0.0, 0.0))
        near, _ = nominal.to_surface(self.stop, 1e-6 * self.pupil_radius, 0.0, (0.0, 0.0))
        self.stop_radius = float(abs(edge[0, 0]) * np.sign(near[0, 0]))
        # Slope of the paraxial chief ray: two real ones near the axis, Richardson's extrapolation; paraxial aiming.
        at = lambda t: float(nominal.trace(*nominal.launch((t, 0.0), 0.0, 0.0))[0][0, 0]) / t
        self.focal_mm = (4 * at(5e-4) - at(1e-3)) / 3

    @staticmethod
    def of_program(lenscube, design):
        with tempfile.TemporaryDirectory() as tmp:
            out = Path(tmp) / "design.json"
            subprocess.run([lenscube, "lens", "convert", design, out], check=True, capture_output=True)
            return Design(json.loads(out.read_text()))

    def index(self, surface, um):
        """Index behind a surface."""
        m = self.rows[surface - 1].get("material_post") or {"type": "IdealMaterial", "index": 1.0}
        if m["type"] == "IdealMaterial":
            return float(m["index"])
        if m["type"] == "AbbeMaterial":
            return model_index(m["index"], m["abbe"], um, m.get("dP_gF", 0.0))
        return float(np.ravel(Material(m["name"], reference=m["reference"]).n(um))[0])


class Built:
    """A lens with errors at one wavelength."""

    def __init__(self, design, um, errors=None):
        self.design, self.um = design, um
        errors = errors or Errors()
        self.index = []
        for k in range(1, len(design.rows) + 1):
            n = design.index(k, um)
            added, abbe = errors.glass.get(k, (0.0, 0.0))
            if abbe:
                n_p = design.index(k, design.primary_um)
                n = n_p + (n - n_p) / (1 + abbe)
            self.index.append(n + added)
        self.surfaces, before = [], Surface(None, IdealMaterial(1.0), Plane(CoordinateSystem(z=-np.inf)))
        self.first = before
        for k, n in enumerate(self.index, 1):
            surface = Surface(before, IdealMaterial(n), self.geometry(k, errors), is_stop=k == design.stop)
            self.surfaces.append(surface)
            before = surface

    def geometry(self, k, errors):
        place = self.place(k, errors.motions)
        d, figure = self.design, errors.figure.get(k)
        c = 1 / d.radius[k - 1] + errors.curvature.get(k, 0.0)
        radius, conic, asphere = (1 / c if c else np.inf), d.conic[k - 1] + errors.conic.get(k, 0.0), d.asphere[k - 1]
        if figure:
            size = 1 + max([2 * len(asphere)] + [max(i, j) for i, j in figure])
            table = np.zeros((size, size))
            for i, a in enumerate(asphere, 1):                # a (x^2 + y^2)^i
                for m in range(i + 1):
                    table[2 * (i - m), 2 * m] += a * math.comb(i, m)
            for (i, j), a in figure.items():
                table[i, j] += a
            return PolynomialGeometry(place, radius, conic, NEWTON_MM, 100, table)
        if any(asphere):
            return EvenAsphere(place, radius, conic, NEWTON_MM, 100, asphere)
        return StandardGeometry(place, radius, conic) if c else Plane(place)

    def place(self, k, motions):
        """Nested coordinate systems, the outermost first."""
        frame, z = None, 0.0
        for first, last, pivot, offset, (dx, dy, dz), (ax, ay, az) in motions:
            if not first <= k <= last:
                continue
            at = self.design.z[pivot - 1] + offset
            frame = CoordinateSystem(x=dx, y=dy, z=z + at + dz, rx=ax, reference_cs=frame)
            for angle in ({"ry": ay}, {"rz": az}):
                if any(angle.values()):
                    frame = CoordinateSystem(**angle, reference_cs=frame)
            z = -at
        return CoordinateSystem(z=z + self.design.z[k - 1], reference_cs=frame)

    def paraxial_pupil(self):
        """Place of the entrance pupil and its radius, by Optiland's paraxial rays."""
        data = json.loads(json.dumps(self.design.data))
        data.pop("lenscube")
        for s, n in zip(data["surface_group"]["surfaces"][1:], self.index, strict=True):
            s["material_post"] = IdealMaterial(n).to_dict()
        for s, before in zip(data["surface_group"]["surfaces"][1:], [1.0, *self.index], strict=False):
            s["material_pre"] = IdealMaterial(before).to_dict()
        for g in (s["geometry"] for s in data["surface_group"]["surfaces"]):
            if g["type"] == "EvenAsphere":                   # paraxial rays see the term of r^2 only, which is 0
                assert not g["coefficients"][0]
        optic = Optic.from_dict(data)
        one = lambda v: float(np.ravel(v)[0])
        return one(optic.paraxial.EPL()) + self.design.z[0], one(optic.paraxial.EPD()) / 2

    def launch(self, t, x, y, z=None):
        """Rays of the field of slopes t at (x, y) of the nominal entrance pupil plane."""
        x, y = np.broadcast_arrays(np.atleast_1d(np.asarray(x, float)), np.asarray(y, float))
        n = 1 / np.sqrt(1 + t[0] ** 2 + t[1] ** 2)
        z = np.full(x.shape, getattr(self.design, "pupil_z", 0.0) if z is None else z)
        return np.array([x, y, z]), np.tile(np.array([[t[0] * n], [t[1] * n], [n]]), (1, x.size))

    def run(self, o, d, last):
        rays = RealRays(*o, *d, np.ones(o.shape[1]), np.full(o.shape[1], self.um))
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            for surface in self.surfaces[:last]:
                rays = surface.trace(rays, record=False)
            self.surfaces[last - 1].geometry.localize(rays)
        return np.array([rays.x, rays.y, rays.z]), np.array([rays.L, rays.M, rays.N])

    def to_surface(self, k, x, y, t):
        """Where rays cross surface k, in its frame as built."""
        at, d = self.run(*self.launch(t, x, y), k)
        return at, d

    def trace(self, o, d):
        """(X, Y) of rays on the film and their slopes there, film frame."""
        at, d = self.run(o, d, len(self.surfaces))
        return np.array([at[0], -at[1]]), np.array([d[0], -d[1]]) / d[2]

    def aim(self, t, p, q):
        """Points (x, y) of the nominal entrance pupil plane, and the area there per dp dq."""
        d = self.design
        x, y = (d.pupil_radius * np.atleast_1d(np.asarray(v, float)) for v in (p, q))
        x, y = (v.copy() for v in np.broadcast_arrays(x, y))
        if not d.is_real_aiming:
            return x, y, np.full(x.shape, d.pupil_radius ** 2)
        want, h = d.stop_radius * np.array([p, q], float).reshape(2, -1), 1e-4 * d.pupil_radius
        at = lambda x, y: self.to_surface(d.stop, x, y, t)[0][:2]
        before = np.inf
        for _ in range(40):
            many = at(np.concatenate([x, x + h, x - h, x, x]), np.concatenate([y, y, y, y + h, y - h])).reshape(2, 5, x.size)
            e, fx, fy = want - many[:, 0], (many[:, 1] - many[:, 2]) / (2 * h), (many[:, 3] - many[:, 4]) / (2 * h)
            det, worst = fx[0] * fy[1] - fx[1] * fy[0], np.nanmax(np.abs(e))
            if worst < 1e-14 * d.pupil_radius or (worst < 1e-11 * d.pupil_radius and worst > 0.3 * before):
                break
            x, y = x + (fy[1] * e[0] - fy[0] * e[1]) / det, y + (fx[0] * e[1] - fx[1] * e[0]) / det
            before = worst
        return x, y, d.stop_radius ** 2 / np.abs(det)

    def rays(self, t, p, q):
        """(X, Y), slopes on the film and light per dp dq of the rays of pupil coordinates (p, q)."""
        x, y, area = self.aim(t, p, q)
        return *self.trace(*self.launch(t, x, y)), area

    def chief(self, t):
        """(X, Y) of the chief ray, mm."""
        return self.rays(t, [0.0], [0.0])[0][:, 0]

    def field_of(self, place):
        """Slopes of the field point imaged at (X, Y)."""
        want, f = np.asarray(place, float), self.design.focal_mm
        t, h = want * [1, -1] / f, 1e-5
        for _ in range(20):
            e = want - self.chief(t)
            if np.abs(e).max() < 1e-11:
                break
            by = np.array([(self.chief(t + v) - self.chief(t - v)) / (2 * h) for v in np.eye(2) * h]).T
            t = t + np.linalg.solve(by, e)
        return t


def quadrature(rings, spokes):
    """(p, q, weight) over the unit disc: Gauss-Legendre in r^2, equal angles."""
    g, w = np.polynomial.legendre.leggauss(rings)
    r, w = np.sqrt((g + 1) / 2), w / 4
    th = (np.arange(spokes) + 0.5) * 2 * np.pi / spokes
    return np.outer(r, np.cos(th)).ravel(), np.outer(r, np.sin(th)).ravel(), np.outer(w, np.full(spokes, 2 * np.pi / spokes)).ravel()


class Spot:
    """Rays of a field at one or several wavelengths on the film: `lights` are pairs (built lens, weight of the wavelength)."""

    def __init__(self, lights, t, rings=12, spokes=36):
        p, q, w = quadrature(rings, spokes)
        parts = [(*lens.rays(t, p, q), share) for lens, share in lights]
        self.at, self.slope = (np.concatenate([part[i] for part in parts], axis=1) for i in (0, 1))
        light = np.concatenate([share * w * part[2] / (w * part[2]).sum() for *part, share in parts])
        ok = np.isfinite(self.at).all(0) & np.isfinite(light)
        if not ok.all():
            raise ValueError(f"{(~ok).sum()} rays of the field {t} do not reach the film")
        self.light = light / light.sum()

    def mean(self, v):
        return (v * self.light).sum(-1)

    @property
    def centroid(self):
        return self.mean(self.at)

    @property
    def moments(self):
        """2 x 2 tensor of second moments about the centroid, mm^2."""
        v = self.at - self.centroid[:, None]
        return (v * self.light) @ v.T

    @property
    def rms(self):
        """RMS radius about the centroid, mm."""
        return float(np.sqrt(np.trace(self.moments)))

    def focus_sums(self):
        """(sum of (rho - mean)(s - mean), sum of |s - mean|^2), light as weights."""
        s, at = self.slope - self.mean(self.slope)[:, None], self.at - self.centroid[:, None]
        return float(self.mean((s * at).sum(0))), float(self.mean((s * s).sum(0)))
