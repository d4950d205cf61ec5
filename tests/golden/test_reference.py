"""Checks the float64 model against closed forms and identities: `python tests/golden/test_reference.py` (NumPy only)."""
import numpy as np
import reference as R

rng = np.random.default_rng(1)
n, c = 15, 7
y, x = np.mgrid[:n, :n] - c
base = np.array([np.exp(-((x - 0.6 * k) ** 2 / (2 * (1 + .3 * k) ** 2) + y ** 2 / 2)) for k in range(5)])
base /= base.sum((1, 2), keepdims=True)
g = R.quarter_rotations(base)
assert np.argmax(g[4][1].sum(1)) > c and abs((g[4][1] * x).sum()) < 1e-12          # +x blob points down at 90 deg
H, W, p = 61, 77, 0.01
rg = np.linspace(0, np.hypot(45, 53) * p, 5)
t = np.linspace(0, rg[-1] * 1.01, 400)
tab = (t, t * (1 - .02 * (t / t[-1]) ** 2), 1 - .3 * (t / t[-1]) ** 2)
for yy, xx in ((30, 38), (30, 70), (3, 38), (50, 10), (30, 2)):                    # a point gives its interpolated PSF
    im = np.zeros((H, W)); im[yy, xx] = 2.0
    o = R.svpsf(im, p, rg, g)
    X, Y = (xx - 38) * p, (yy - 30) * p
    r, th = np.hypot(X, Y), np.arctan2(Y, X) % (2 * np.pi)
    k = min(int(np.searchsorted(rg, r, side="right")) - 1, 3); u = (r - rg[k]) / (rg[k + 1] - rg[k])
    ring = lambda i: g[i][0] if len(g[i]) == 1 else (1 - th * 2 / np.pi % 1) * g[i][int(th * 2 / np.pi)] + (th * 2 / np.pi % 1) * g[i][(int(th * 2 / np.pi) + 1) % 4]
    assert np.allclose(o[yy:yy + n, xx:xx + n], 2 * ((1 - u) * ring(k) + u * ring(k + 1)), atol=1e-14) and abs(o.sum() - 2) < 1e-13
im = rng.random((H, W)); assert abs(R.svpsf(im, p, rg, g).sum() / im.sum() - 1) < 1e-13   # light is conserved
one = [np.repeat(base[2][None], 1, 0)] * 5                                          # shift-invariant: plain convolution
f = np.fft.irfft2(np.fft.rfft2(im, (H + n - 1, W + n - 1)) * np.fft.rfft2(base[2], (H + n - 1, W + n - 1)), (H + n - 1, W + n - 1))
assert np.allclose(R.svpsf(im, p, rg, one), f, atol=1e-12)
for method in ("bilinear", "bicubic"):                                              # a uniform chart gives exactly R
    s = R.remap(np.ones((H, W)), (H, W), p, *tab, margin=c, method=method)
    r = R.polar((H + 2 * c, W + 2 * c), p, (30 + c, 38 + c))[0]
    assert np.allclose(s, np.interp(r, tab[1], tab[2]), atol=1e-14)
ident = (t, t, np.ones_like(t))
assert np.allclose(R.remap(im, (H, W), p, *ident), im, atol=1e-11)                      # identity
lin = np.add.outer(np.arange(H) * .3, np.arange(W) * .7)                            # linear ramps survive magnification
s = R.remap(lin, (41, 41), p, t, t / 1.02, np.ones_like(t), surround="edge")
yy, xx = np.mgrid[:41, :41] - 20
assert np.allclose(s, 30 * .3 + 38 * .7 + 1.02 * (yy * .3 + xx * .7), atol=1e-9)
s = R.remap(lin, (15, 19), 4 * p, *ident, scale=(.25, .25))                          # reduction averages the film pixel
yy, xx = np.mgrid[:15, :19]
assert np.allclose(s[1:-1, 1:-1], (30 * .3 + 38 * .7 + 4 * ((yy - 7) * .3 + (xx - 9) * .7))[1:-1, 1:-1], atol=1e-9)
fm = R.film(im, (H, W), p, *tab, rg, g); assert fm.shape == (H, W) and np.isfinite(fm).all()
print(f"the float64 model passes its checks, peak of the film {fm.max():.6g}")
