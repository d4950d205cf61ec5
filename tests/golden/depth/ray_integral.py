"""The truth that the layered model is compared with: rays from film points through a thin lens into the scene (NumPy, float64).

A ray of the film point x [px, (y, x)] through the pupil point p (unit disc) meets the surface of vergence V at the pinhole coordinates
    u(V) = x + p rho' (V - V_f)      [px]      rho' = blur radius per dioptre [px m], V_f vergence in focus
exact for a thin lens: the ray passes the plane z at p D/2 (1 - z/z_f) + x z/f_D. The first surface that it meets, from the lens on, gives its
light; the film is the mean over the pupil. A chart pixel is a square of constant value, as it is for the model, whose kernels are integrated
over the film pixel; so both describe the same scene, and film points are pixel centres.
"""
import numpy as np


def pupil(count=100_000):
    """Evenly spread points of the unit disc (count, 2) by the golden angle: relative error of a disc's share about 1e-4 at 1e5 points."""
    i = np.arange(count)
    r, angle = np.sqrt((i + 0.5) / count), i * np.pi * (3 - np.sqrt(5))
    return np.stack([r * np.sin(angle), r * np.cos(angle)], 1)


class Plane:
    """Surface of vergence V = v0 + slope u_x (every plane in space has this form), `value(u_y, u_x)`, within `inside(u_y, u_x)`."""

    def __init__(self, v0, value, inside=None, slope=0.0):
        self.v0, self.value, self.inside, self.slope = v0, value, inside, slope

    def hit(self, x, p, blur, focus):
        """(whether the rays meet it, its value there)."""
        uy_x = (x[1] + p[:, 1] * blur * (self.v0 - focus)) / (1 - p[:, 1] * blur * self.slope)
        uy = x[0] + p[:, 0] * blur * (self.v0 + self.slope * uy_x - focus)
        inside = np.ones(len(p), bool) if self.inside is None else self.inside(uy, uy_x)
        return inside, self.value(uy, uy_x)


class Ball:
    """Sphere of radius `radius` [m] and uniform value, its centre on the axis at `distance` [m] from a pupil of radius `aperture` [m].

    Film coordinates are f px long per unit of tan(angle): f = f_D / pitch.
    """

    def __init__(self, radius, distance, value, f, aperture):
        self.radius, self.distance, self.v, self.f, self.aperture = radius, distance, value, f, aperture

    def hit(self, x, p, blur, focus):
        # Points of the ray: pupil point + s (point in focus - pupil point), s > 0.
        start = np.concatenate([p * self.aperture, np.zeros((len(p), 1))], 1)
        end = np.array([x[0] / self.f / focus, x[1] / self.f / focus, 1 / focus])
        along = end - start
        to = np.array([0, 0, self.distance]) - start
        near = (to * along).sum(1) / (along ** 2).sum(1)
        miss = ((to - near[:, None] * along) ** 2).sum(1)
        return miss <= self.radius ** 2, np.full(len(p), float(self.v))


def film_points(points, surfaces, blur, focus, rays=100_000):
    """Film at `points` (N, 2) of `surfaces`, the nearest first."""
    p, out = pupil(rays), np.zeros(len(points))
    for i, x in enumerate(points):
        open_ = np.ones(len(p), bool)
        for surface in surfaces:
            hit, value = surface.hit(x, p, blur, focus)
            out[i] += value[open_ & hit].sum()
            open_ &= ~hit
    return out / len(p)


def checker(side):
    """Chart of squares of `side` px, 0 and 1; chart pixel i covers i - 1/2 .. i + 1/2."""
    return lambda y, x: (((np.floor(y + 0.5) // side + np.floor(x + 0.5) // side) % 2) == 0).astype(float)
