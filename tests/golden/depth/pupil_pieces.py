"""What the product of means leaves out where two surfaces are both out of focus (NumPy, float64): pieces of the pupil, geometric.

    film += (sum_p f_p O(a_p, c_p) - O(sum_p f_p a_p, sum_p f_p c_p)) max(0, 1 - D)       not below 0, in cells of CELL x CELL film pixels that `edges` reach
    O     = C sum_s T_s g_s c_s/U_s,   T_s = prod_{j>s} max(0, 1 - g_j a_j/U_j),   U_s = max(1 - sum_near a_j, a_s, FLOOR)
    C     = 1/(1 - T behind all slabs) where the composite leaves nothing open, 1 where it leaves OPEN or more: what is known stands for all
    g_s   = max(1, max(1 - sum_near w_j, FLOOR)/U_s of the composite);   D = max_s (g_s - 1) min(1, T_s w_s/FEW): nothing where less than half is known
    a_p   = planes of a slab as piece p sees them: max(0, mean of a (1 + d_p grad rho/rho_w) over a disc of radius R |q| about x - q d_p), q = rho_s/rho_w;
            c_p = 0 where a_p is; in the means without grad rho
rho: signed blur radius.  f_p, d_p, R: energy, centroid, and radius of what is left of the second moment, of the pieces of the kernel of the node w that is
farthest from focus, at the middle of the cell.  A slab whose t varies within reach is two surfaces, at its nodes.  grad rho: slope of the surface (`slope`):
the pupil point -d/rho_w sees pixel q at x = q + d rho(q)/rho_w, so a pixel covers 1 + d grad rho/rho_w of the film.
"""
import numpy as np

RINGS = (4, 12, 18, 22)     # pieces of equal area of a uniform disc, from the middle
CELL = 64                   # film pixels
PSF_CELLS = 64              # cells of a PSF in a row, at most
POINTS = np.array([-1, 0, 1]) / 3   # points that a cell is spread over, in cells from its centroid
IN_FOCUS = 0.1              # blur radii below this are in focus, px
LEAST_WIDE = 2.0            # a kernel of less blur does not show the pupil, px
FEW = 0.01                  # shares of the light below count less for what is unknown behind them
OPEN = 0.05                 # where the composite leaves this share of the light open, what lies there is no surface
PRESENT = 1e-3              # shares of the light below are none, above 1 - this all
SEEN = 1e-5                 # and below this not seen
ONE_POSITION = 1e-4         # positions t that differ by less are one
LEAST_STEP = 0.01           # blur radii of one surface differ less from pixel to pixel, px
STEEPEST = 4.0              # slopes above are this, px per px
LEAST_SLOPE = 1e-4          # below: 0


def parts(psf):
    """Cells of a PSF (n, n) of sum 1 with the field point on +x: energy, y, x [px from the chief ray]."""
    n = len(psf)
    step = -(-n // PSF_CELLS)
    y, x = np.mgrid[:n, :n] - n // 2
    starts = np.arange(0, n, step)
    e, ey, ex = (np.add.reduceat(np.add.reduceat(v, starts, 0), starts, 1).ravel() for v in (psf, psf * y, psf * x))
    keep = e > 0
    e, ey, ex = e[keep], ey[keep], ex[keep]
    return e / e.sum(), ey / e, ex / e


def piece(y, x):
    """Index of the piece at (y, x) of the unit disc."""
    edges = np.cumsum(RINGS)
    ring = np.searchsorted(edges[:-1], (y * y + x * x) * edges[-1], side="right")
    n = np.array(RINGS)[ring]
    turns = np.arctan2(y, x) / (2 * np.pi) + (ring + 0.37) / (2 * n)
    return edges[ring] - n + np.floor(turns * n).astype(int) % n


def pieces(heights, psfs, dy, dx):
    """(f, d, R) at the film place (dy, dx) [px] of PSFs (K, n, n) at `heights` [px]."""
    r = min(np.hypot(dy, dx), heights[-1])
    k = int(np.clip(np.searchsorted(heights, r, side="right"), 1, len(heights) - 1))
    share = (r - heights[k - 1]) / (heights[k] - heights[k - 1])
    cos, sin = (dx, dy) / np.hypot(dy, dx) if dy or dx else (1.0, 0.0)
    both = []
    for psf, weight in ((psfs[k - 1], 1 - share), (psfs[k], share)):
        e, *at = parts(psf)
        step = -(-len(psf) // PSF_CELLS)
        y, x = (v[:, None] + d.ravel() * step for v, d in zip(at, np.meshgrid(POINTS, POINTS, indexing="ij")))
        both.append((np.repeat(e * weight / 9, 9), (y * cos + x * sin).ravel(), (x * cos - y * sin).ravel()))
    e, y, x = np.concatenate(both, axis=1)
    my, mx, second = (e * y).sum(), (e * x).sum(), (e * (y * y + x * x)).sum()
    scale = np.sqrt(2 * (second - my * my - mx * mx))
    index = piece((y - my) / scale, (x - mx) / scale)
    f, fy, fx = (np.bincount(index, v, sum(RINGS)) for v in (e, e * y, e * x))
    lit = f > 0
    f, d = f[lit], np.stack([fy[lit] / f[lit], fx[lit] / f[lit]], 1)
    return f, d, np.sqrt(2 * (second - (f * (d ** 2).sum(1)).sum()))


def disc(radius):
    """Weights of a disc of `radius` together with linear interpolation, 1/6 px^2 of variance in each direction on average."""
    soft = np.sqrt(max(0.0, radius * radius - 2 / 3))
    reach = int(np.ceil(soft + 0.5)) - 1
    y, x = np.mgrid[-reach:reach + 1, -reach:reach + 1]
    k = np.clip(soft + 0.5 - np.hypot(y, x), 0, 1)
    return k / k.sum()


def seen(plane, rho, cell, margin, shape_of):
    """`plane` (film grown by `margin`) of blur radius `rho` on `cell` (y, x, h, w) as every piece sees it: (P, h, w)."""
    (f, d, radius), rho_w = shape_of
    q = rho / rho_w
    k = disc(radius * abs(q))
    m = len(k) // 2
    most = max(0.0, margin - m - 1)
    offset = np.clip(-q * d, -most, most)
    pad = m + 1
    y0, x0, h, w = cell
    # The planes from `margin` and `pad` before the cell on.
    size = (h + 2 * margin + 2 * pad, w + 2 * margin + 2 * pad)
    rows, cols = (np.clip(at - pad + np.arange(n), 0, s - 1) for at, n, s in zip((y0, x0), size, plane.shape))
    v = plane[np.ix_(rows, cols)]
    placed = np.zeros(v.shape)
    placed[:len(k), :len(k)] = k
    mean = np.fft.irfft2(np.fft.rfft2(v) * np.fft.rfft2(np.roll(placed, (-m, -m), (0, 1))), v.shape)
    out = np.empty((len(d), h, w))
    for p, o in enumerate(offset):
        (i, j), (a, b) = np.floor(o).astype(int) + margin + pad, o - np.floor(o)
        at = lambda r, c: mean[i + r:i + r + h, j + c:j + c + w]
        out[p] = (1 - a) * ((1 - b) * at(0, 0) + b * at(0, 1)) + a * ((1 - b) * at(1, 0) + b * at(1, 1))
    return out


def slope(planes, s, lens):
    """Change of the blur radius of slab s from one film pixel to the next (2, h, w): central differences of the vergence; neighbours are of the slab nearest
    to s that is not apart from it, on one side alone where the other pixel is of another surface, 0 where a is 0."""
    nodes, n = lens.vergence, len(planes)
    surface = sorted((k for k in range(n) if not lens.separate(min(s, k), max(s, k))), key=lambda k: (abs(k - s), -k))
    rho = np.full(planes.shape[2:], np.nan)
    for k in reversed(surface):
        (low, high), (a, _, m) = lens.slabs()[k], planes[k]
        on = a > 0
        rho[on] = lens.blur_px * (nodes[low] + m[on] / a[on] * (nodes[high] - nodes[low]) - lens.focus)
    low, high = (nodes[d] for d in lens.slabs()[s])
    a, _, m = planes[s]
    here = np.where(a > 0, lens.blur_px * (low + np.divide(m, a, out=np.zeros_like(m), where=a > 0) * (high - low) - lens.focus), np.nan)
    out = []
    for axis in (0, 1):
        pad = [(1, 1) if k == axis else (0, 0) for k in (0, 1)]
        wide = np.pad(rho, pad, constant_values=np.nan)
        before, after = (np.take(wide, np.arange(rho.shape[axis]) + k, axis) for k in (0, 2))
        both = (after - before) / 2
        one = np.where(np.isnan(before), after - here, here - before)
        out.append(np.nan_to_num(np.where(np.isnan(both), one, both)))
    steep = np.hypot(*out)
    limit = np.where(steep < LEAST_SLOPE, 0, np.minimum(1, STEEPEST / np.maximum(steep, 1e-300)))
    return np.where(a > 0, np.array(out) * limit, 0)


def edges(planes, lens, margin):
    """Where one surface ends before another one: row and column on the film, and the larger of the two blur radii, of pixels of `planes` (film grown by `margin`)
    whose first surface is more than LEAST_STEP of blur from that of a neighbour, or does not cover the pixel and is so far from the next one.

    Without an edge in reach the correction is 0 but for the slope of the surface, 0.2 times of its contrast.
    """
    shape = planes.shape[2:]
    first, last, cover, blur = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape), np.zeros(shape)
    for s in reversed(range(len(planes))):
        (low, high), (a, _, m) = (lens.vergence[d] for d in lens.slabs()[s]), planes[s]
        on = (a > 0) & (cover < 1 - PRESENT)
        rho = lens.blur_px * (low + np.divide(m, a, out=np.zeros_like(m), where=on) * (high - low) - lens.focus)
        step = on & (last - rho > LEAST_STEP)
        blur[step] = np.maximum(blur, np.maximum(abs(rho), abs(last)))[step]
        first, last, cover = np.where(on & np.isnan(first), rho, first), np.where(on, rho, last), cover + np.where(on, a, 0)
    for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        step = abs(first[here] - first[there]) > LEAST_STEP
        blur[here] = np.where(step, np.maximum(blur[here], np.maximum(abs(first[here]), abs(first[there]))), blur[here])
    y, x = np.nonzero(blur)
    return y - margin, x - margin, blur[y, x]


def reached(edges, cell, shape_of):
    """Whether pieces see one of `edges` from a pixel of `cell` (y, x, h, w)."""
    (_, d, radius), rho_w = shape_of
    beyond = lambda at, first, n: np.maximum(np.maximum(first - at, at - (first + n - 1)), 0)
    y, x, blur = edges
    return (np.maximum(beyond(y, cell[0], cell[2]), beyond(x, cell[1], cell[3])) <= blur * (abs(d).max() + radius) / abs(rho_w) + 1).any()


def add(film, planes, margin, lens, axis, pitch, floor, used):
    """Adds the correction to `film` (a depth_reference.Film, changed in place) of `planes` (S, 3, film grown by `margin`); `used`: nodes of the slabs that occur."""
    rho = lambda v: lens.blur_px * (v - lens.focus)
    wide = max(used, key=lambda d: abs(rho(lens.vergence[d])))
    rho_w = rho(lens.vergence[wide])
    if abs(rho_w) < LEAST_WIDE:
        return
    heights, psfs = np.asarray(lens.r_grid[wide]) / pitch, [k[0] for k in lens.grid[wide]]
    ends = lambda s: [lens.vergence[d] for d in lens.slabs()[s]]
    blurred = lambda s: max(abs(rho(v)) for v in ends(s)) > IN_FOCUS
    h, w = film.light.shape
    at_edges = edges(planes, lens, margin)
    slopes = {s: slope(planes, s, lens) for s, *_ in film.slabs}
    for y0 in range(0, h, CELL):
        for x0 in range(0, w, CELL):
            cell = (y0, x0, min(CELL, h - y0), min(CELL, w - x0))
            on = np.s_[y0:y0 + cell[2], x0:x0 + cell[3]]
            slabs = [(s, share[on], u[on], passing[on] * share[on]) for s, passing, share, u in film.slabs]
            slabs = [of for of in slabs if (of[3] > SEEN).any()]
            if not any(blurred(s) and ((visible > PRESENT) & (share < 1 - PRESENT)).any() and
                       any(blurred(k) and (other > PRESENT).any() for k, _, _, other in slabs[i + 1:])
                       for i, (s, share, _, visible) in enumerate(slabs)):
                continue
            middle = [at + (CELL - 1) / 2 - c for at, c in zip((y0, x0), axis)]
            shape_of = pieces(heights, psfs, *middle), rho_w
            if not reached(at_edges, cell, shape_of):
                continue
            f = shape_of[0][0]
            passing, light, shares, doubt = {}, {}, {}, np.zeros(cell[2:])
            for s, share, u, visible in slabs:
                (a, c, m), (low, high) = planes[s], ends(s)
                t = np.divide(m, a, out=np.zeros_like(m), where=a > 0)
                # What a cell can see of the slab.
                scale = max(abs(rho(v)) for v in (low, high)) / abs(rho_w)
                reach = int(np.ceil(abs(shape_of[0][1]).max() * scale)) + 1 + len(disc(shape_of[0][2] * scale)) // 2
                part = tuple(np.s_[max(0, at + margin - reach):at + margin + n + reach] for at, n in zip(cell[:2], cell[2:]))
                there = t[part][a[part] > 0]
                if not there.size:
                    continue
                if np.ptp(there) < ONE_POSITION:
                    terms = [(rho(low + there.min() * (high - low)), np.ones_like(t))]
                else:
                    terms = [(rho(low), 1 - t), (rho(high), t)]
                see = lambda v: sum(seen(v * weight, r, cell, margin, shape_of) for r, weight in terms)
                near = [j for j in shares if not lens.separate(s, j)]
                before = sum((other for k, other, *_ in slabs if k in near), np.zeros(share.shape))
                gain = np.maximum(1, np.maximum(1 - before, floor) / u)
                doubt = np.maximum(doubt, (gain - 1) * np.clip(visible / FEW, 0, 1))
                a_p, c_p = see(a), see(c)
                a_mean, c_mean = (np.einsum("p,pyx->yx", f, v)[None] for v in (a_p, c_p))
                for g, along in zip(slopes[s], shape_of[0][1].T):
                    if g.any():
                        a_p, c_p = (v + (along / rho_w)[:, None, None] * see(of * g) for v, of in ((a_p, a), (c_p, c)))
                a_p, c_p = np.maximum(a_p, 0), np.where(a_p > 0, c_p, 0)
                for key, of_a, of_c in (("pieces", a_p, c_p), ("means", a_mean, c_mean)):
                    infront = sum((shares[j][key] for j in near), np.zeros(of_a.shape))
                    share_of = np.maximum(np.maximum(1 - infront, of_a), floor)
                    go = passing.get(key, 1.0) * gain / share_of
                    more = go * of_a > passing.get(key, 1.0)
                    go = np.where(more, np.divide(passing.get(key, 1.0) + 0 * of_a, of_a, out=np.zeros_like(of_a), where=more), go)
                    light[key] = light.get(key, 0.0) + go * of_c
                    passing[key] = np.maximum(0, passing.get(key, 1.0) - go * of_a)
                shares[s] = {"pieces": a_p, "means": a_mean}
            if light:
                s, passes, share, u = film.slabs[-1]
                known = np.clip(1 - (passes * (1 - share / u))[on] / OPEN, 0, 1)
                light["means"] = light["means"] * (1 + known * passing["means"] / np.maximum(1 - passing["means"], FEW))
                # A piece that sees next to nothing gets the mean.
                light["pieces"] = light["pieces"] + known * passing["pieces"] * (light["pieces"] + FEW * light["means"]) / (1 - passing["pieces"] + FEW)
                change = (np.einsum("p,pyx->yx", f, light["pieces"]) - light["means"][0]) * np.maximum(0, 1 - doubt)
                film.light[on] = np.maximum(film.light[on] + change, np.minimum(film.light[on], 0))
