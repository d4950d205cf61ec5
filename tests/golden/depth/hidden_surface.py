"""Extrapolation of a surface behind a nearer one: means over ever wider surroundings, the nearest known pixels first.

Weight w in 0 .. 1 and value x of a film pixel; level 0: the known pixels; B_l: filter [1 2 1]/4 of rows and of columns, taps 2^l px apart:
    w_l+1 = min(1, GAIN (B_l * w_l)),   x_l+1 = (B_l * (w_l x_l))/(B_l * w_l)         a pixel of weight 0 has no value
    value = sum_l T_l w_l x_l / sum_l T_l w_l,   T_l = prod_{k<l} (1 - w_k)
Every level has all pixels of the film (no lattice), so the values of a surface that is shifted by whole pixels are shifted with it, wherever the film
begins and ends. With L = ceil(log2(reach + 1)) levels every pixel within `reach` rows and columns of a known one has a value, which depends on pixels at
most 2^L - 1 away.

Sources: Knutsson and Westin, "Normalized and differential convolution", CVPR 1993; Shensa, "The discrete wavelet transform: wedding the a trous and
Mallat algorithms", IEEE Transactions on Signal Processing 40, 1992.
"""
import numpy as np


def grown_box(mask, reach):
    """True where a pixel of `mask` lies within `reach` rows and columns."""
    for axis in (0, 1):
        count = np.concatenate([np.zeros_like(mask.take([0], axis), int), mask.cumsum(axis)], axis)
        n = mask.shape[axis]
        first, end = np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach + 1, n)
        mask = count.take(end, axis) > count.take(first, axis)
    return mask


GAIN = 4.0          # of the weights from level to level


def levels(reach):
    return int(np.ceil(np.log2(max(reach, 1) + 1)))


def support(reach):
    """Rows and columns from a pixel to those that an extrapolation over `reach` depends on, at most."""
    return 2 ** levels(reach) - 1


def smooth(v, step):
    """v (..., h, w) filtered by [1 2 1]/4, taps `step` px apart; 0 beyond the array."""
    for axis in (-2, -1):
        pad = [(0, 0)] * v.ndim
        pad[axis] = (step, step)
        n, padded = v.shape[axis], np.pad(v, pad)
        before, after = padded.take(range(n), axis), padded.take(range(2 * step, 2 * step + n), axis)
        v = v / 2 + (before + after) / 4
    return v


def extrapolate(a, c, v, reach):
    """(light, vergence, found) from shares a, c = a x light, v = a x vergence; exact at least `support` px from the ends of the array."""
    w = np.minimum(a, 1.0)
    x = np.stack([c, v]) * np.divide(w, a, out=np.zeros_like(a), where=a > 0)
    passing, weight, sums = 1 - w, w, x
    for level in range(levels(reach)):
        mean, x = smooth(w, 2 ** level), smooth(x, 2 ** level)
        w = np.minimum(1, GAIN * mean)
        x = x * np.divide(w, mean, out=np.zeros_like(w), where=mean > 0)
        weight, sums, passing = weight + passing * w, sums + passing * x, passing * (1 - w)
    value = np.divide(sums, weight, out=np.zeros_like(sums), where=weight > 0)
    return value[0], value[1], weight > 0
