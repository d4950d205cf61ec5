#!/usr/bin/env python3
"""Executable specification of one band with a distance per chart pixel: sheets -> slabs -> film (NumPy, float64).

Pinhole mapping, relative illumination, distortion and the spatially variant sum (written ∗) are those of ../reference.py.

CONVENTIONS (those of ../reference.py, and)
  V       vergence 1/z [1/m], z from the centre of the entrance pupil along the axis; 0 is infinity, larger is nearer.
  node d  vergence V_d (ascending) with a polar PSF grid (r_grid [mm], kernels) and a window n_d of its own.
  slab s  the interval [V_s, V_s+1), the last one closed; slab 0 is the farthest.
  sheet   chart, vergence and coverage, each (Hc, Wc).  Sheet 0 is what the pinhole at the entrance pupil sees, the others are hidden
          behind it.  What no sheet covers is a black surface behind everything.
  planes  of slab s on the film grown by half the widest window:  a share of a pixel's area that lies in the slab,
          c light (chart x share x R),  m = a t = sum of share x (V - V_s)/(V_s+1 - V_s),  i the part of c that is invented.

DEFINITION
  share_q   = [V_q in slab] cov_q prod_{p<q, same slab} (1 - cov_p)        per chart pixel ("over" in sheet order within a slab)
  a, c, m   = share_q, chart_q share_q R, share_q t_q  at the film pixel, summed over q.  Scale >= 1: chart by interpolation within one surface
              (surface_value), share and V of the nearest chart pixel (a distance is never interpolated).  Scale < 1: means over the film pixel.
              Where cov_q is 0 neither chart nor V count.
              Map and R at the slab's middle vergence:  h(r, V) = h(r, 0) + shift(r) V,  R(r) G(r, V)/G(r, V_f), G the mean of the two nodes
  b_s       = min(1, sum_{k<s} a_k + uncovered)                              covered behind the slab
  e_d       = 1 ∗ P_d                                                        a chart of ones through one node: 1 - div(centroid)
  light_s   = ((1 - t) c) ∗ P_s + (t c) ∗ P_s+1
  w_s       = (((1 - t) a) ∗ P_s)/e_s + ((t a) ∗ P_s+1)/e_s+1                share of the pupil that the slab covers
  near_s    = slabs j > s with j = s + 1 or V_j - V_s+1 < gap_s              the same surface further on, as far as one can know
  gap_s     = max(EDGE_PX, EDGE_SHARE * blur of the slab) / blur per dioptre
  o_s       = max(0, 1 - a_s - sum_{near} a_j),   f_s = min(b_s, o_s)        neither the slab nor that surface; of it, known behind the slab
  K = f_s ∗ P, M = (o_s - f_s) ∗ P                                           known and missing behind the slab; P of its node farther from focus
  U_s       = max(w_s + min(2 K, max(0, 1 - w_s - sum_{near} w_j) K/(K + M)), FLOOR)      share of the pupil of which anything is known
  film      = sum_s T_s light_s/U_s,   T_s = prod_{j>s} (1 - w_j/U_j)         near to far; T is the share of light that passes slabs j > s
WHY.  A ray that has passed slab s + 1 of a surface meets slab s of it: there U_s = 1 - w_s+1, and the two lights simply add, whatever is
hidden behind ("over" of two shares 1/2 would let 1/4 of the background through). Surfaces apart by more than the gap cover the pupil
independently: U_s = 1. Where nothing else is known in reach K = 0 and U_s = w_s: the light of what is known stands for all. The bound 2 K
makes U continuous where K fades out.
PROPERTIES.  w_s <= U_s <= max(1, w_s), so with complete hidden sheets a chart of ones gives a convex mean of the e_d.  At constant depth
w = U = 1 and film = light: the flat model's sum.
CORRECTION.  Shares multiply: exact where one of two surfaces is in focus or the rear one uniform, else the product of means stands for the mean of a
product; pupil_pieces.py adds what it leaves out.
LIMITS.  Where one surface is in focus a pixel of a tilted surface spreads as one of a surface parallel to the film: the factor
1 - (u - x) grad V/(V - V_f) is left out (0.5 % of a ball's shadow if its depths are those of its front).  The gap is a guess: a surface so steep that it runs through more
than EDGE_SHARE of its own blur within a window lets through light of what is hidden behind it.

HIDDEN SURFACES.  Given as sheets, or invented (hidden_surface.py): pixels near a depth edge receive light and vergence extrapolated from all
surfaces that are farther by more than the gap. They lie in slabs that the scene has: between two surfaces, in the nearer one of the two. What is known
beyond the film counts, as far as the extrapolation reaches.
"""
import sys
from collections import namedtuple
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import reference as ref  # noqa: E402
import pupil_pieces  # noqa: E402
from hidden_surface import extrapolate, grown_box, support  # noqa: E402

FLOOR = 1e-3        # least U that is divided by
EDGE_PX = 2.0       # a depth edge: blur radii that differ by more than this
EDGE_SHARE = 0.25   # and than this share of the farther one's
ROUNDING = 1e-6     # extrapolated vergences below a node by less than this share of the nodes' range are those of the node
ROUNDED = 1e-9      # means over pixels below this are rounding of the summed areas
PRESENT = 1e-4      # least share of a pixel with which a surface makes an edge
NOTHING = 1e-9      # K + M below this is rounding
BLOCK_PX = 64       # side of the film blocks whose invented share is stored


# light (H, W); the invented part of it (H, W) or None; per slab that reaches the film, the nearest first, (s, T, w, U), each (H, W).
Film = namedtuple("Film", "light invented slabs")


@dataclass
class Lens:
    """One band of a lens with depth nodes; heights [mm], M field points, D nodes."""
    h_ideal: np.ndarray                     # (M) at V = 0
    h_real: np.ndarray                      # (M)
    ri: np.ndarray                          # (M)
    vergence: np.ndarray                    # (D) [1/m], ascending
    r_grid: list                            # D arrays (K) [mm]
    grid: list                              # D lists of K arrays (J, n, n)
    blur_px: float                          # blur radius per dioptre from focus [px m]: rho' / pitch
    focus: float                            # vergence in focus V_f [1/m]
    shift: np.ndarray = field(default=None)     # (M) change of h_ideal per dioptre [mm m]: f_D tan(theta) delta / 1000; None = 0
    etendue: np.ndarray = field(default=None)   # (D, M) G(r, V)/G(r, V_f); None = 1

    def window(self, d):
        return self.grid[d][0].shape[-1]

    def slabs(self):
        """(index of the node below, of the node above) of every slab; a lens with one node has one slab."""
        return [(s, s + 1) for s in range(len(self.vergence) - 1)] or [(0, 0)]

    def separate(self, far, near):
        """Whether slabs `near` > `far` are apart by more than the gap."""
        top = self.vergence[self.slabs()[far][1]]
        gap = max(EDGE_PX / self.blur_px, EDGE_SHARE * abs(top - self.focus))
        return near > far + 1 and self.vergence[near] - top >= gap


@dataclass
class Sheet:
    chart: np.ndarray                       # (Hc, Wc)
    vergence: np.ndarray                    # (Hc, Wc) [1/m]
    coverage: np.ndarray = field(default=None)  # (Hc, Wc) 0 .. 1; None = 1


class Spread:
    """The spatially variant sum of one node: image on the film grown by `margin` -> film of `shape`; what it would lose beyond is not needed.

    The same sum as ref.svpsf, node by node in the Fourier domain; a circular transform of the grown film is enough, as margin >= n // 2.
    """

    def __init__(self, shape, margin, pitch, axis, r_grid, grid, outside):
        self.shape, self.margin = shape, margin
        size = (shape[0] + 2 * margin, shape[1] + 2 * margin)
        r, theta, _, _ = ref.polar(size, pitch, (axis[0] + margin, axis[1] + margin))
        ref.covered(r, r_grid[-1], outside, "the PSF grid")
        n = grid[0].shape[-1]
        assert n // 2 <= margin
        k = np.clip(np.searchsorted(r_grid, r, side="right") - 1, 0, len(r_grid) - 2)
        u = np.clip((r - r_grid[k]) / (r_grid[k + 1] - r_grid[k]), 0.0, 1.0)
        self.terms = []
        for i, kernels in enumerate(grid):
            radial = np.where(k == i, 1 - u, np.where(k + 1 == i, u, 0.0))
            turns = theta * len(kernels) / (2 * np.pi)
            for j, kernel in enumerate(kernels):
                away = np.abs(turns - j)
                w = radial * np.maximum(0, 1 - np.minimum(away, len(kernels) - away)) if len(kernels) > 1 else radial
                if w.any():
                    placed = np.zeros(size)
                    placed[:n, :n] = kernel
                    self.terms.append((w, np.fft.rfft2(np.roll(placed, (-(n // 2), -(n // 2)), (0, 1)))))

    def __call__(self, image):
        if not image.any():
            return np.zeros(self.shape)
        spectrum = sum(np.fft.rfft2(w * image) * kernel for w, kernel in self.terms)
        m = self.margin
        return np.fft.irfft2(spectrum, image.shape)[m:m + self.shape[0], m:m + self.shape[1]]


def slab_of(vergence, nodes):
    """Index of the slab of every vergence; it must lie within the nodes."""
    if vergence.min() < nodes[0] or vergence.max() > nodes[-1]:
        raise ValueError(f"vergences {vergence.min():.6g} .. {vergence.max():.6g} 1/m, the lens has {nodes[0]:.6g} .. {nodes[-1]:.6g}")
    return np.clip(np.searchsorted(nodes, vergence, side="right") - 1, 0, max(len(nodes) - 2, 0))


def position(vergence, nodes, s):
    """(V - V_s)/(V_s+1 - V_s); 0 for a lens with one node."""
    return (vergence - nodes[s]) / (nodes[s + 1] - nodes[s]) if len(nodes) > 1 else np.zeros_like(vergence)


def surface_value(chart, of_surface, cy, cx, method, surround):
    """Chart at float (cy, cx) from the pixels `of_surface` alone.

    mean = sum b v/sum b over those of the 2 x 2, b: bilinear weights.  Bicubic: sum w v + (1 - sum w) mean over those of the 4 x 4, w: bicubic weights,
    so that a pixel of another surface counts as the mean; with all pixels of the surface, bicubic interpolation.  Beyond a chart with black surround
    all pixels are of the surface.
    """
    y0, x0 = np.floor(cy).astype(np.int64), np.floor(cx).astype(np.int64)

    def sums(method):
        (wy, o), (wx, _) = ref.taps(cy - y0, method), ref.taps(cx - x0, method)
        weight, value = np.zeros(cy.shape), np.zeros(cy.shape)
        for i, a in enumerate(wy):
            for k, b in enumerate(wx):
                y, x = y0 + o + i, x0 + o + k
                other = ref.fetch(~of_surface * 1.0, y, x, surround)
                weight, value = weight + a * b * (1 - other), value + a * b * (1 - other) * ref.fetch(chart, y, x, surround)
        return weight, value
    weight, value = sums("bilinear")
    mean = np.divide(value, weight, out=np.zeros_like(value), where=weight > 0)
    if method == "bilinear":
        return mean
    weight, value = sums(method)
    return value + (1 - weight) * mean


def planes(sheets, lens, shape, pitch, axis, margin, scale=(1, 1), center=(0, 0), method="bicubic", surround="edge", outside="error"):
    """Planes (a, c, m) of every slab on the film grown by `margin`: (S, 3, H + 2 margin, W + 2 margin), and the uncovered share."""
    cover = [np.ones(q.chart.shape) if q.coverage is None else np.asarray(q.coverage, float) for q in sheets]
    charts = [np.where(c > 0, q.chart, 0.0) for c, q in zip(cover, sheets)]
    vergences = [np.where(c > 0, q.vergence, lens.vergence[0]) for c, q in zip(cover, sheets)]
    slab = [slab_of(v, lens.vergence) for v in vergences]
    area = min(scale) < 1
    box = [max(1 / v, 1) for v in scale]
    out = []
    for s, (low, high) in enumerate(lens.slabs()):
        middle = (lens.vergence[low] + lens.vergence[high]) / 2
        h = lens.h_ideal if lens.shift is None else lens.h_ideal + lens.shift * middle
        gain = lens.ri if lens.etendue is None else lens.ri * (lens.etendue[low] + lens.etendue[high]) / 2
        cy, cx, r = ref.places(charts[0].shape, shape, pitch, h, lens.h_real, axis, margin, scale, center, outside)
        gain = np.interp(r, lens.h_real, gain)
        nearest = lambda v: ref.fetch(v, np.floor(cy + 0.5).astype(int), np.floor(cx + 0.5).astype(int), surround)
        mean = lambda v: ref.box_mean(v, cy, cx, *box, surround)
        film, open_ = np.zeros((3, *r.shape)), np.ones(charts[0].shape)
        one_surface = np.array([not lens.separate(min(s, k), max(s, k)) for k in range(len(lens.slabs()))])
        for chart, coverage, index, v in zip(charts, cover, slab, vergences):
            share = np.where(index == s, coverage, 0.0) * open_
            open_ = open_ * np.where(index == s, 1 - coverage, 1.0)
            t = np.where(index == s, position(v, lens.vergence, s), 0.0)
            if area:
                of_sheet = np.array([mean(share), mean(share * chart) * gain, mean(share * t)])
                film += np.where(of_sheet[0] > ROUNDED, of_sheet, 0)
            else:
                a = nearest(share)
                value = surface_value(chart, (coverage > 0) & one_surface[index], cy, cx, method, surround)
                film += a, a * np.where(a > 0, value, 0.0) * gain, a * nearest(t)
        if s == 0:
            known = 1 - np.prod([1 - v for v in cover], axis=0)
            uncovered = 1 - (mean(known) if area else nearest(known))
        out.append(film)
    return np.array(out), uncovered


def behind(a, uncovered):
    """b of every slab: share of a pixel that is covered behind the slab."""
    return np.minimum(1, np.cumsum(a, axis=0) - a + uncovered)


def beyond(lens):
    """Pixels beyond the film with its margin that invented surfaces depend on."""
    reach = max(lens.window(d) for d in range(len(lens.vergence))) // 2
    return max(support(reach), reach + 1)


def invent(p, uncovered, lens):
    """Adds to planes p (S, 3, h, w) the surfaces hidden behind depth edges, extrapolated; returns the light added: (S, h, w)."""
    slabs, b = lens.slabs(), behind(p[:, 0], uncovered)
    added, given = np.zeros_like(p[:, 0]), p.copy()
    farther = [[k for k in range(s) if lens.separate(k, s)] for s in range(len(slabs))]
    share = [sum((given[k, 0] for k in donors), np.zeros_like(uncovered)) for donors in farther]
    present = [k for k in range(len(slabs)) if (given[k, 0] > PRESENT).any()]
    low, high = np.array([[lens.vergence[d] for d in slab] for slab in slabs]).T
    gap = lambda s, k: -1 if s == k else max(low[k] - high[s], low[s] - high[k])
    occupied = np.array([min(present, key=lambda k: gap(s, k)) for s in range(len(slabs))])     # the slab with surfaces nearest to a slab
    edge = np.any([(given[s, 0] > PRESENT) & grown_box(share[s] > PRESENT, 1) for s in range(len(slabs))], axis=0)
    for s, donors in enumerate(farther):
        reach = max(lens.window(d) for d in range(slabs[s][1] + 1)) // 2
        wanted = np.where(grown_box(edge, reach), np.minimum(given[s, 0], 1 - b[s]), 0.0)
        if not donors or not (wanted > 0).any():
            continue
        middle = lambda k: given[k, 0] * lens.vergence[slabs[k][0]] + given[k, 2] * (lens.vergence[slabs[k][1]] - lens.vergence[slabs[k][0]])
        light, vergence, found = extrapolate(share[s], sum(given[k, 1] for k in donors), sum(middle(k) for k in donors), reach)
        amount = np.where(found, np.maximum(wanted, 0.0), 0.0)
        rounding = ROUNDING * (lens.vergence[-1] - lens.vergence[0])
        index = slab_of(np.where(found, vergence, lens.vergence[0]) + rounding, lens.vergence)
        index = np.minimum(occupied[index], s - 1)
        for k in range(s):
            here = np.where(index == k, amount, 0.0)
            t = np.clip(position(np.where(index == k, vergence, lens.vergence[k]), lens.vergence, k), 0, 1)
            p[k] += here, here * light, here * t
            added[k] += here * light
    return added


def composite(p, uncovered, spread, lens, added=None):
    """Planes (S, 3, h, w) -> Film; `spread`: one Spread per node; `added` (S, h, w): the part of the light that is invented."""
    slabs, b = lens.slabs(), behind(p[:, 0], uncovered)
    film, invented, passing, record = np.zeros(spread[0].shape), np.zeros(spread[0].shape), np.ones(spread[0].shape), []
    e = [node(np.ones(p.shape[2:])) for node in spread]
    w = {}
    for s in reversed(range(len(slabs))):
        (low, high), (a, c, m) = slabs[s], p[s]
        t = np.divide(m, a, out=np.zeros_like(m), where=a > 0)
        both = lambda x: spread[low]((1 - t) * x) + spread[high](t * x)
        w[s] = spread[low]((1 - t) * a) / e[low] + spread[high](t * a) / e[high]
        if not w[s].any():
            continue
        near = [j for j in w if j > s and not lens.separate(s, j)]
        opened = np.maximum(0, 1 - a - sum(p[j, 0] for j in near))
        known = np.minimum(b[s], opened)
        wide = spread[max(low, high, key=lambda d: abs(lens.vergence[d] - lens.focus))]
        k, missing = wide(known), wide(opened - known)
        part = np.divide(k, k + missing, out=np.zeros_like(k), where=k + missing > NOTHING)
        rest = np.minimum(2 * k, np.maximum(0, 1 - w[s] - sum(w[j] for j in near)) * part)
        u = np.maximum(w[s] + np.maximum(rest, 0), FLOOR)
        film += passing * both(c) / u
        if added is not None:
            invented += passing * both(added[s]) / u
        record.append((s, passing, w[s], u))
        passing = passing * (1 - w[s] / u)
    return Film(film, None if added is None else invented, record)


def film(sheets, lens, shape, pitch, axis=None, invented=False, outside="error", **kw):
    """The whole band: sheets -> Film of `shape`; `invented`: surfaces behind depth edges are added.  kw as planes()."""
    axis = ((shape[0] - 1) / 2, (shape[1] - 1) / 2) if axis is None else axis
    margin = max(lens.window(d) for d in range(len(lens.vergence))) // 2
    p, uncovered = planes(sheets, lens, shape, pitch, axis, margin, outside=outside, **kw)
    added = None
    if invented:
        more = beyond(lens)
        p, uncovered = planes(sheets, lens, shape, pitch, axis, margin + more, outside="clamp", **kw)
        added = invent(p, uncovered, lens)
        p, uncovered, added = (v[..., more:-more, more:-more] for v in (p, uncovered, added))
    spread = [Spread(shape, margin, pitch, axis, np.asarray(r, float), g, outside) for r, g in zip(lens.r_grid, lens.grid)]
    out = composite(p, uncovered, spread, lens, added)
    used = {d for s, slab in enumerate(lens.slabs()) if p[s, 0].any() for d in slab}
    pupil_pieces.add(out, p, margin, lens, axis, pitch, FLOOR, used)
    return out


def invented_share(film, invented):
    """Share of the light of every BLOCK_PX x BLOCK_PX block of the film that is invented."""
    rows, cols = (np.arange(0, n, BLOCK_PX) for n in film.shape)
    total = lambda v: np.add.reduceat(np.add.reduceat(v, rows, axis=0), cols, axis=1)
    whole = total(film)
    return np.divide(total(invented), whole, out=np.zeros_like(whole), where=whole != 0)
