"""Float64 model of one band: relative illumination and distortion (the remapped image), then the spatially variant PSF.

Written from the equations below, independently of the Rust code, as direct sums.  NumPy only.  make_golden.py computes the
golden films with it; test_reference.py checks it.
Method: Maeda, Catrysse, Wandell, "Integrating lens design with digital camera simulation", Proc. SPIE 5678 (2005), as in
ISETCam (rtGeometry, rtPrecomputePSF, rtPrecomputePSFApply); no code or approximation of theirs is used.

CONVENTIONS
  film    (H, W); row y grows DOWN, column x grows RIGHT; upright, as the viewer sees it.  Pixel centres are integers.
  axis    optical axis (cy, cx) in film pixels, default ((H-1)/2, (W-1)/2).   pitch  film pixel pitch [mm].
          X = (x-cx)*pitch, Y = (y-cy)*pitch; r = hypot(X, Y) [mm] is the REAL (distorted) image height;
          theta = atan2(Y, X) in [0, 2 pi): 0 on +x, 90 deg on +y = DOWN; theta = 0 on the axis.
  chart   (Hc, Wc) on the ideal (undistorted) image plane: `scale` = (sy, sx) film pixels per chart pixel; the chart's
          centre ((Hc-1)/2, (Wc-1)/2) lies at `center` = (Y, X) mm.  A scale below 1 averages the chart over the film pixel.
  tables  h_ideal, h_real, ri (M,): field points, ascending from 0 [mm, mm, 1]; linear in between (dense by contract).
  kernel  (n, n), n odd, centre c = (n-1)/2 = chief ray; kernel[c+dy, c+dx] = share of the light of pixel (y, x) that lands
          on pixel (y+dy, x+dx); sum 1.
  grid    list of K arrays (J_k, n, n): kernels for real height r_grid[k] [mm] (ascending from 0) and azimuth
          theta_j = 2 pi j / J_k: the kernel of a field point on +x, rotated by theta_j.  On the axis J_0 = 1.

DEFINITION (values, never flux: no Jacobian, so a uniform chart gives a remapped image of exactly R)
  remapped[y, x] = R(r) * chart at ideal position (X, Y) * h(r)/r       on the film GROWN by n//2 pixels on every side
  film[y+dy, x+dx] += remapped[y, x] * P(r, theta)[dy, dx]                                                  (scatter)
  P = (1-u) P_k + u P_{k+1},  u = (r-r_k)/(r_{k+1}-r_k);   P_k = (1-v) G_k[j] + v G_k[j+1],  v = theta J_k/(2 pi) - j, j+1 wraps
"""
import numpy as np


def fetch(img, y, x, surround):
    """img at integer (y, x); outside: 'black' 0, 'edge' nearest pixel, 'mirror' about the outer edge of the last pixel."""
    h, w = img.shape
    if surround == "mirror":
        y, x = np.mod(y, 2 * h), np.mod(x, 2 * w)
        y, x = np.minimum(y, 2 * h - 1 - y), np.minimum(x, 2 * w - 1 - x)
    v = img[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]
    return np.where((y >= 0) & (y < h) & (x >= 0) & (x < w), v, 0.0) if surround == "black" else v


def taps(f, method):
    """Weights of the 2 (bilinear) or 4 (bicubic: Catmull-Rom, Keys a = -1/2) neighbours at fraction f; first offset."""
    if method == "bilinear":
        return [1 - f, f], 0
    return [((2 - f) * f - 1) * f / 2, ((3 * f - 5) * f * f + 2) / 2, ((4 - 3 * f) * f + 1) * f / 2, (f - 1) * f * f / 2], -1


def sample(img, y, x, method="bicubic", surround="edge"):
    """img (H, W) at float (y, x)."""
    y0, x0 = np.floor(y).astype(np.int64), np.floor(x).astype(np.int64)
    (wy, o), (wx, _) = taps(y - y0, method), taps(x - x0, method)
    return sum(a * b * fetch(img, y0 + o + i, x0 + o + k, surround) for i, a in enumerate(wy) for k, b in enumerate(wx))


def box_mean(img, y, x, by, bx, surround="edge"):
    """Mean of img, taken as constant squares, over boxes of by x bx image pixels centred on float (y, x)."""
    beyond = (by - y.min(), y.max() + by - img.shape[0], bx - x.min(), x.max() + bx - img.shape[1])
    m = int(max(*np.ceil(beyond), 0)) + 2
    yy, xx = np.meshgrid(np.arange(-m, img.shape[0] + m), np.arange(-m, img.shape[1] + m), indexing="ij")
    s = np.zeros((yy.shape[0] + 1, yy.shape[1] + 1))
    s[1:, 1:] = fetch(img, yy, xx, surround).cumsum(0).cumsum(1)          # summed area; index = pixel edge
    e = lambda v, w: sample(s, v + .5 + m, w + .5 + m, "bilinear")
    y1, y2, x1, x2 = y - by / 2, y + by / 2, x - bx / 2, x + bx / 2
    return (e(y2, x2) - e(y1, x2) - e(y2, x1) + e(y1, x1)) / (by * bx)


def polar(shape, pitch, axis):
    """(r [mm], theta [rad], Y [mm], X [mm]) of every pixel of `shape` with the optical axis at (cy, cx)."""
    y, x = np.meshgrid((np.arange(shape[0]) - axis[0]) * pitch, (np.arange(shape[1]) - axis[1]) * pitch, indexing="ij")
    return np.hypot(x, y), np.mod(np.arctan2(y, x), 2 * np.pi), y, x


def covered(r, last, outside, what):
    if outside == "error" and r.max() > last * (1 + 1e-9):
        raise ValueError(f"film and margin reach {r.max():.6g} mm, {what} ends at {last:.6g} mm")


def places(chart_shape, shape, pitch, h_ideal, h_real, axis=None, margin=0, scale=(1, 1), center=(0, 0), outside="error"):
    """(chart row, chart column, r [mm] clamped to the table) of every pixel of the film of `shape` grown by `margin`."""
    h_ideal, h_real = np.asarray(h_ideal, float), np.asarray(h_real, float)
    assert h_ideal[0] == 0 and h_real[0] == 0 and (np.diff(h_real) > 0).all() and (np.diff(h_ideal) > 0).all()
    axis = ((shape[0] - 1) / 2, (shape[1] - 1) / 2) if axis is None else axis
    r, _, y, x = polar((shape[0] + 2 * margin, shape[1] + 2 * margin), pitch, (axis[0] + margin, axis[1] + margin))
    covered(r, h_real[-1], outside, "the table")
    rc = np.minimum(r, h_real[-1])
    mag = np.where(rc > 0, np.interp(rc, h_real, h_ideal) / np.where(rc > 0, rc, 1), h_ideal[1] / h_real[1])
    cy = (chart_shape[0] - 1) / 2 + (y * mag - center[0]) / (pitch * scale[0])
    cx = (chart_shape[1] - 1) / 2 + (x * mag - center[1]) / (pitch * scale[1])
    return cy, cx, rc


def remap(chart, shape, pitch, h_ideal, h_real, ri, axis=None, margin=0, scale=(1, 1), center=(0, 0),
          method="bicubic", surround="edge", outside="error"):
    """Chart -> remapped image on the film of `shape` grown by `margin`: (H + 2 margin, W + 2 margin).

    outside='clamp': beyond the last field point, h/r and R of the last one.
    """
    chart = np.asarray(chart, float)
    cy, cx, rc = places(chart.shape, shape, pitch, h_ideal, h_real, axis, margin, scale, center, outside)
    if min(scale) < 1:
        v = box_mean(chart, cy, cx, max(1 / scale[0], 1), max(1 / scale[1], 1), surround)
    else:
        v = sample(chart, cy, cx, method, surround)
    return np.interp(rc, np.asarray(h_real, float), np.asarray(ri, float)) * v


def _scatter(img, k, u, j0, v0, j1, v1, first, count, ker, out):
    n = ker.shape[1]
    for y in range(img.shape[0]):
        for x in range(img.shape[1]):
            a, i = img[y, x], k[y, x]
            if a != 0.0:
                lo, hi, b, c = first[i], first[i + 1], j0[y, x], j1[y, x]
                below = (1 - v0[y, x]) * ker[lo + b] + v0[y, x] * ker[lo + (b + 1) % count[i]]
                above = (1 - v1[y, x]) * ker[hi + c] + v1[y, x] * ker[hi + (c + 1) % count[i + 1]]
                out[y:y + n, x:x + n] += a * ((1 - u[y, x]) * below + u[y, x] * above)


def svpsf(img, pitch, r_grid, grid, axis=None, outside="error"):
    """Scatter img (H, W) through the grid -> (H+n-1, W+n-1): no light lost, pixel (y, x) is at [y+c, x+c].

    outside='clamp': beyond r_grid[-1] the last height's kernels.  Cost H*W*n*n*4 multiply-adds.
    """
    r_grid = np.asarray(r_grid, float)
    n, count = grid[0].shape[-1], np.array([len(g) for g in grid])
    assert n % 2 == 1 and len(grid) == len(r_grid) >= 2 and r_grid[0] == 0 and (np.diff(r_grid) > 0).all()
    axis = ((img.shape[0] - 1) / 2, (img.shape[1] - 1) / 2) if axis is None else axis
    r, th, _, _ = polar(img.shape, pitch, axis)
    covered(r, r_grid[-1], outside, "the PSF grid")
    k = np.clip(np.searchsorted(r_grid, r, side="right") - 1, 0, len(r_grid) - 2)
    u = np.clip((r - r_grid[k]) / (r_grid[k + 1] - r_grid[k]), 0.0, 1.0)
    a0, a1 = th * count[k] / (2 * np.pi), th * count[k + 1] / (2 * np.pi)
    f0, f1 = np.floor(a0), np.floor(a1)
    out = np.zeros((img.shape[0] + n - 1, img.shape[1] + n - 1))
    j0, j1 = f0.astype(np.int64) % count[k], f1.astype(np.int64) % count[k + 1]
    _scatter(np.asarray(img, dtype=np.float64), k, u, j0, a0 - f0, j1, a1 - f1,
             np.concatenate([[0], np.cumsum(count)[:-1]]), count, np.concatenate(grid).astype(np.float64), out)
    return out


def film(chart, shape, pitch, h_ideal, h_real, ri, r_grid, grid, axis=None, outside="error", **kw):
    """The whole band: chart (Hc, Wc) -> film (H, W).  kw as remap()."""
    m = grid[0].shape[-1] // 2
    axis = ((shape[0] - 1) / 2, (shape[1] - 1) / 2) if axis is None else axis
    remapped = remap(chart, shape, pitch, h_ideal, h_real, ri, axis, m, outside=outside, **kw)
    spread = svpsf(remapped, pitch, r_grid, grid, (axis[0] + m, axis[1] + m), outside)
    return spread[2 * m:2 * m + shape[0], 2 * m:2 * m + shape[1]]


def quarter_rotations(base):
    """base (K, n, n) on the +x half meridian -> grid with J = 4 (J_0 = 1): exact, a blob on +x moves to +y (DOWN) for 90 deg."""
    return [np.asarray(b, float)[None] if k == 0 else np.array([np.rot90(b, -j) for j in range(4)], float)
            for k, b in enumerate(base)]
