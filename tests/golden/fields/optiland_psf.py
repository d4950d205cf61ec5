"""PSF of a field point by a Huygens sum over Optiland's rays: plane wavelets, amplitude sqrt(Phi J/N), phase W of the path.

    W = path - path0 - L (X - X0) - M (Y - Y0)        of the chief ray 0;  E(x, y) = sum a exp(i k (W + L x + M y)),  PSF = |E|^2
J = |d(L, M)/d(p, q)|, Phi light per dp dq, L, M optical direction cosines on the film (film frame), N along its normal.
"""
import warnings

import numpy as np
from optiland.rays import RealRays

from optiland_built import quadrature


def film_rays(lens, t, p, q):
    """(X, Y), (L, M, N), optical path and light per dp dq."""
    x, y, area = lens.aim(t, p, q)
    o, d = lens.launch(t, x, y)
    rays = RealRays(*o, *d, np.ones(o.shape[1]), np.full(o.shape[1], lens.um))
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for surface in lens.surfaces:
            rays = surface.trace(rays, record=False)
        lens.surfaces[-1].geometry.localize(rays)
    n = lens.index[-2]
    return np.array([rays.x, -rays.y]), n * np.array([rays.L, -rays.M, rays.N]), np.ravel(rays.opd) + d[0] * x + d[1] * y, area


def psf(lens, t, n, pitch_um, turn=0.0, rings=48, spokes=192, h=1e-4):
    """n x n point samples, row down, sum 1, the chief ray at the centre; in the frame turned by `turn` (from X towards Y). `lens` has the methods
    `aim` and `launch`, and `um`, `surfaces` and `index` of optiland_built.Built or of optiland_asymmetric.Rays."""
    p, q, w = quadrature(rings, spokes)
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, s], [-s, c]])                           # film frame -> turned frame
    at, cosines, path, light = film_rays(lens, t, p, q)
    at0, _, path0, _ = film_rays(lens, t, [0.0], [0.0])
    a, b, e, f = (film_rays(lens, t, *v)[1] for v in ((p + h, q), (p - h, q), (p, q + h), (p, q - h)))
    by_p, by_q = (a - b) / (2 * h), (e - f) / (2 * h)
    J = np.abs(by_p[0] * by_q[1] - by_p[1] * by_q[0])
    W = path - path0 - (cosines[:2] * (at - at0)).sum(0)
    L, M = R @ cosines[:2]
    k = 2e3 * np.pi / lens.um
    wave = w * np.sqrt(light * J / np.abs(cosines[2])) * np.exp(1j * k * W)
    grid = (np.arange(n) - n // 2) * pitch_um * 1e-3
    across, down = np.exp(1j * k * np.outer(L, grid)), np.exp(1j * k * np.outer(M, grid))
    I = np.abs(down.T @ (wave[:, None] * across)) ** 2
    return I / I.sum()


def centroid_um(kernel, pitch_um):
    """(x, y) of a PSF from its central sample."""
    at = (np.arange(kernel.shape[0]) - kernel.shape[0] // 2) * pitch_um
    return np.array([kernel.sum(0) @ at, kernel.sum(1) @ at]) / kernel.sum()
