"""Rays from film points backwards through the built-in Double Gauss into a scene: an independent truth for films of the program (NumPy, float64).

Rays start at a film point with direction cosines L, M on an even grid over the exit pupil, go backwards through all surfaces, and are kept if they
meet the paraxial entrance pupil, by which the lens is traced. Irradiance is radiance times dL dM, so the film is the mean of the radiance that these
rays meet, relative to a uniform scene of 1. In front of the lens a ray is a straight line; the first surface of the scene that it meets gives its light.
No pupil is averaged apart from another, no depth is divided into nodes, no PSF is made. Left out: diffraction.

Coordinates of the scene: X, Y and z in m from the centre of the entrance pupil, upright as on the film; chart mm = f_D X/z; vergence V = 1/z.
"""
import numpy as np

from double_gauss import DoubleGauss


class LensRays:
    """Focused on an object at vergence `focus`; the film `defocus_mm` behind its paraxial image."""

    def __init__(self, focus, um, defocus_mm=0.0):
        self.lens = DoubleGauss(focus, um)
        self.lens.film_gap += defocus_mm
        self.vertices = np.concatenate([[0], np.cumsum(self.lens.gaps[:len(self.lens.c) - 2])])
        self.film_z = self.vertices[-1] + self.lens.film_gap
        y, u = self.lens._paraxial(-self.lens.pupil_z, 1.0)          # as DoubleGauss.f_d, at this film
        self.f_d = abs(y + self.lens.film_gap * u)

    def backwards(self, x, y, lm):
        """Rays (N, 2) of the film point (x, y) mm, in front of the lens: (points (N, 3), directions away from it, whether they meet the pupil)."""
        lens = self.lens
        d = np.concatenate([lm, -np.sqrt(1 - (lm ** 2).sum(1))[:, None]], 1)
        p, inside = np.broadcast_to([x, y, self.film_z], d.shape).copy(), np.ones(len(d), bool)
        for i in reversed(range(len(lens.c) - 1)):
            rel, c = p - [0, 0, self.vertices[i]], lens.c[i]
            # c |rel + s d|^2 = 2 z, the root near the vertex.
            f = c * (rel ** 2).sum(1) - 2 * rel[:, 2]
            g = c * (rel * d).sum(1) - d[:, 2]
            root = g * g - c * f
            inside &= root >= 0
            s = f / (-g + np.where(g > 0, -1, 1) * np.sqrt(np.maximum(root, 0)))
            p = p + s[:, None] * d
            normal = np.stack([c * p[:, 0], c * p[:, 1], -1 + c * (p[:, 2] - self.vertices[i])], 1)
            ratio = lens.n[i + 1] / lens.n[i]
            cos = (d * normal).sum(1)
            normal, cos = np.where(cos[:, None] < 0, -normal, normal), abs(cos)
            inner = 1 - ratio ** 2 * (1 - cos ** 2)
            inside &= inner >= 0
            d = ratio * d + (np.sqrt(np.maximum(inner, 0)) - ratio * cos)[:, None] * normal
        at = p + ((lens.pupil_z - p[:, 2]) / d[:, 2])[:, None] * d
        return p, d, inside & (at[:, 0] ** 2 + at[:, 1] ** 2 <= (lens.diameter / 2) ** 2)

    def bundle(self, x, y, rays=100_000):
        """At least `rays` rays of the film point (x, y) mm: (points, directions), m from the centre of the entrance pupil, upright."""
        side = int(np.sqrt(rays * 1.35))
        coarse = np.linspace(-0.3, 0.3, 121)                         # where the pupil is
        grid = np.stack(np.meshgrid(coarse, coarse, indexing="ij"), -1).reshape(-1, 2)
        ok = grid[self.backwards(x, y, grid)[2]]
        low, high = ok.min(0) - 0.005, ok.max(0) + 0.005
        axes = [a + (b - a) * (np.arange(side) + 0.5) / side for a, b in zip(low, high)]
        p, d, inside = self.backwards(x, y, np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2))
        assert inside.sum() >= rays, f"{inside.sum()} rays"
        # The picture is turned by 180 degrees; z grows away from the lens.
        return (p[inside] - [0, 0, self.lens.pupil_z]) * -1e-3, -d[inside]

    def open_radius(self, radius, distance):
        """Pupil height [mm] of the ray between the film's axial point and the rim of a ball on the axis, m; by rays traced forwards."""
        lens, focus_mm = self.lens, 1e3 / self.lens.focus

        def passes(h):                                               # least distance of the ray from the ball's centre, mm
            x = np.zeros(1)
            for _ in range(20):                                      # the object point at the focus distance whose ray through h meets the axial film point
                at = lambda x: lens.run(*lens.launch(-lens.sign * x[0] / focus_mm, lens.focus, np.array([h]), np.zeros(1))[:2])[0][0, 0]
                slope = (at(x + 1e-3) - at(x)) / 1e-3
                x = x - at(x) / slope
            slope = (x[0] - h) / focus_mm
            return abs(h + slope * distance * 1e3) / np.hypot(1, slope)
        low, high = 0.0, lens.diameter / 2
        for _ in range(50):
            middle = (low + high) / 2
            low, high = (middle, high) if passes(middle) < radius * 1e3 else (low, middle)
        return low


class Plane:
    """Surface of vergence V = v0 + slope u, u the chart's x in mm, of `value(y, x)` at chart mm, within `inside(y, x)`."""

    def __init__(self, f_d, v0, value, slope=0.0, inside=None):
        self.f_d, self.v0, self.value, self.slope, self.inside = f_d, v0, value, slope, inside

    def hit(self, p, d):
        """(whether the rays meet it, its value there)."""
        # z V = 1 and u = f_D X/z: the plane v0 z + slope f_D X = 1.
        at = lambda v: self.v0 * v[:, 2] + self.slope * self.f_d * v[:, 0]
        q = p + ((1 - at(p)) / at(d))[:, None] * d
        y, x = self.f_d * q[:, 1] / q[:, 2], self.f_d * q[:, 0] / q[:, 2]
        inside = np.ones(len(p), bool) if self.inside is None else self.inside(y, x)
        return inside, self.value(y, x)


class Ball:
    """Black sphere of `radius` about (0, 0, `distance`), m."""

    def __init__(self, radius, distance):
        self.radius, self.distance = radius, distance

    def hit(self, p, d):
        to = np.array([0, 0, self.distance]) - p
        near = (to * d).sum(1) / (d ** 2).sum(1)
        return ((to - near[:, None] * d) ** 2).sum(1) <= self.radius ** 2, np.zeros(len(p))


def light(surfaces, p, d):
    """(mean light of the first of `surfaces`, the nearest first, that each ray meets; the same if each surface were hidden by a mean share of the rays).

    The second figure is what a model can know that has the share of the pupil that each surface covers, but not which part.
    """
    truth, share, product = np.zeros(len(p)), 1.0, 0.0
    open_ = np.ones(len(p), bool)
    for surface in surfaces:
        hit, value = surface.hit(p, d)
        truth[open_ & hit] = value[open_ & hit]
        open_ &= ~hit
        product += share * (hit * value).mean()
        share *= 1 - hit.mean()
    return truth.mean(), product
