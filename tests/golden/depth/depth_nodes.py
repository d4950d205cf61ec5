"""Depth nodes of a lens by error, float64 (NumPy).

Between two nodes V - h and V + h the PSF is interpolated linearly; its error half-way,
    e(V, h) = |(P(V - h) + P(V + h))/2 - P(V)|, as L1 (sum over film pixels) or as the largest error of the edge spread function,
is C(V) h^2: the second derivative of P by V. C is measured at probing distances, the largest over the field points; the spacing allowed there is
    2 min(sqrt(tolerance_L1/C_L1), sqrt(tolerance_ESF/C_ESF))
and nodes are placed so that the integral of 1/spacing between neighbours is the same, at most 1. Every mid-cell is then computed. If one
fails, all of them become probes and the nodes are placed anew; cells that fail after ROUNDS of that are halved.
A defocus is an optical path, so the PSF of a field point follows from one pupil function:
    U(X, Y) = integral of A exp(2 pi i/wavelength (W + L X + M Y)) dL dM,   P = |U|^2 integrated over film pixels
over the open pupil in direction cosines (L, M), W the path, even in M.
"""
import numpy as np

from double_gauss import DoubleGauss

PER_PIXEL = 4           # Gauss-Legendre nodes per film pixel and direction; spacing below half of Nyquist's pitch
ROUNDS = 4
MARGIN = 0.95           # of a tolerance, for placing
TERMS = 12              # degree of the polynomials in (L, M) that represent traced rays


class IdealPupil:
    """f/N lens without aberrations, focused at V_f: uniform in direction cosines; defocus by `blur_px` film pixels per dioptre at the rim."""

    def __init__(self, f_number, um, pitch_um, blur_px, focus=0.0):
        self.um, self.pitch, self.focus, self.blur_px = um, pitch_um, focus, blur_px
        self.na = np.sin(np.arctan(0.5 / f_number))

    def function(self, vergence, count):
        """Grid (L, M >= 0), shares of the pupil, W [um] of every cell; the pitch of the grid is that of `axis`."""
        axis = (np.arange(-count, count) + 0.5) * self.na / count
        l, m = np.meshgrid(axis, axis[count:], indexing="ij")
        s2 = l * l + m * m
        shift = self.blur_px * (vergence - self.focus) * self.pitch / np.tan(np.arcsin(self.na))      # um along the axis
        return axis, axis[count:], rim_share(s2, self.na, axis[1] - axis[0]), shift * (1 - np.sqrt(np.maximum(1 - s2, 0)))


class TracedPupil:
    """A field point t of the Double Gauss; W and the pupil's rim as polynomials in (L, M), fitted to rays."""

    def __init__(self, lens, t, pitch_um):
        self.lens, self.t, self.um, self.pitch = lens, t, lens.um, pitch_um
        self.blur_px, self.focus = lens.diameter / 2 * lens.f_d / pitch_um, lens.focus

    def function(self, vergence, count):
        pq, _, offset, d, path = self.lens.bundle(self.t, vergence, 16, 40)
        l, m = d[:, 0], d[:, 1]
        w = (path - l * offset[:, 0] - m * offset[:, 1]) * 1e3
        middle, size = (l.max() + l.min()) / 2, 1.02 * max((l.max() - l.min()) / 2, m.max())
        powers = [(i, j) for i in range(TERMS + 1) for j in range(0, TERMS + 1 - i, 2)]
        known = np.stack([((l - middle) / size) ** i * (m / size) ** j for i, j in powers], -1)
        radius2 = (pq ** 2).sum(1)
        fit = np.linalg.lstsq(known, np.stack([w, radius2], 1), rcond=None)[0]
        self.residual_um = abs(known @ fit[:, 0] - w).max()
        axis = (np.arange(-count, count) + 0.5) / count
        table = np.zeros((2, TERMS + 1, TERMS + 1))
        for (i, j), c in zip(powers, fit):
            table[:, i, j] = c
        values = axis[:, None] ** np.arange(TERMS + 1) @ table @ (axis[count:, None] ** np.arange(TERMS + 1)).T
        far = np.hypot(axis[:, None], axis[count:]) > 1.1                                # polynomials mean nothing there
        axis = axis * size
        # The rim is radius2 = 1; its gradient converts the distance to it into direction cosines.
        slope = np.hypot(*np.gradient(values[1], axis[1] - axis[0]))
        share = np.clip(0.5 + (1 - values[1]) / np.maximum(slope, 1e-9) / (axis[1] - axis[0]), 0, 1)
        return axis, axis[count:], np.where(far, 0.0, share), values[0]


def rim_share(s2, radius, step):
    """Share of every grid cell inside the circle of `radius`: linear across the rim."""
    return np.clip(0.5 + (radius - np.sqrt(s2)) / step, 0, 1)


def kernel(pupil, vergence, half_px):
    """P over (2 half_px + 1)^2 film pixels about the chief ray, sum 1."""
    n = (2 * half_px + 1) * PER_PIXEL
    at, weight = np.polynomial.legendre.leggauss(PER_PIXEL)
    x = (np.arange(-half_px, half_px + 1)[:, None] + at / 2).ravel() * pupil.pitch
    extent = 0.36 if not isinstance(pupil, IdealPupil) else 2 * pupil.na
    count = int(np.ceil(1.25 * extent * x[-1] / pupil.um)) + 16
    l, m, share, w = pupil.function(vergence, count)
    k = 2j * np.pi / pupil.um
    u = np.exp(k * np.outer(x, l)) @ (share * np.exp(k * w)) @ (2 * np.cos(2 * np.pi / pupil.um * np.outer(m, x[n // 2:])))
    p = np.abs(u) ** 2
    p = np.concatenate([p[:, ::-1], p], 1)                                              # even in y
    p = weight @ p.reshape(2 * half_px + 1, PER_PIXEL, -1, PER_PIXEL).transpose(0, 2, 1, 3) @ weight
    return p / p.sum()


def errors(pupil, v, h, cache=None):
    """(L1, largest ESF error) of the interpolation half-way between nodes v - h and v + h; `cache`: kernels by vergence and window."""
    half_px = max(window(pupil, v - h), window(pupil, v + h))
    cache = {} if cache is None else cache
    for x in (v - h, v, v + h):
        if (x, half_px) not in cache:
            cache[x, half_px] = kernel(pupil, x, half_px)
    e = (cache[v - h, half_px] + cache[v + h, half_px]) / 2 - cache[v, half_px]
    return np.array([abs(e).sum(), max(abs(e.sum(axis).cumsum()).max() for axis in (0, 1))])


def window(pupil, v):
    """Half a window that holds a blur of vergence v with its rim, px; a multiple of 8, so that neighbours share kernels."""
    return 8 * int(np.ceil((1.2 * abs(v - pupil.focus) * pupil.blur_px + 12) / 8))


def place(pupils, first, last, l1, esf=np.inf, probes=9):
    """Nodes from `first` to `last` [1/m] for these tolerances: (nodes, largest mid-cell L1, largest mid-cell ESF error)."""
    blur, focus, allowed = pupils[0].blur_px, pupils[0].focus, np.array([l1, esf])
    caches = [{} for _ in pupils]
    error = lambda v, h: np.max([errors(p, v, h, c) for p, c in zip(pupils, caches)], axis=0)
    # Probes are closer to each other near focus, where C changes most.
    reach = max(abs(first - focus), abs(last - focus)) * blur
    side = np.concatenate([[0.0], np.geomspace(1.0, max(reach, 2.0), probes - 1)]) / blur
    at = np.unique(np.clip(np.concatenate([focus - side, focus + side]), first, last))
    c = {v: error(v, 0.5 / blur) * (2 * blur) ** 2 for v in at}
    fine = np.linspace(first, last, 20001)
    for _ in range(ROUNDS):
        at = sorted(c)
        per_dioptre = [np.sqrt(c[v] / (MARGIN * allowed)).max() / 2 for v in at]
        density = np.interp(fine, at, per_dioptre)
        count = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])
        cells = max(int(np.ceil(count[-1])), 1)
        nodes = np.interp(np.arange(cells + 1) * count[-1] / cells, count, fine)
        middle, h = (nodes[1:] + nodes[:-1]) / 2, np.diff(nodes) / 2
        found = np.array([error(*x) for x in zip(middle, h)])
        if (found <= allowed).all():
            break
        c.update({v: e / x ** 2 for v, x, e in zip(middle, h, found)})
    while (found > allowed).any():
        nodes = np.sort(np.concatenate([nodes, middle[(found > allowed).any(1)]]))
        middle, h = (nodes[1:] + nodes[:-1]) / 2, np.diff(nodes) / 2
        found = np.array([error(*x) for x in zip(middle, h)])
    return nodes, found[:, 0].max(), found[:, 1].max()


def double_gauss_pupils(focus=0.5, um=0.55, pitch_um=2.0, degrees=(0.0, 10.0)):
    """The field points of section 3, on the film focused at `focus`; blur in film pixels."""
    lens = DoubleGauss(focus, um)
    return [TracedPupil(lens, max(np.tan(np.radians(a)), 1e-9), pitch_um) for a in degrees]
