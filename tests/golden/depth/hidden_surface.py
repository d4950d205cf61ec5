"""Extrapolation of a surface behind a nearer one: push-pull over a pyramid that is aligned to the film.

Pull (fine to coarse), weight w in 0 .. 1 and value x of a sample, over its 2 x 2 samples:
    x' = sum(w x)/sum(w),   w' = min(1, sum(w))                       a sample of weight 0 has no value
Push (coarse to fine), from the coarsest level down:
    x <- w x + (1 - w) up(x'),   up = bilinear interpolation (weights 9/16, 3/16, 3/16, 1/16) of the coarse samples that have a value
Level l has one sample per 2^l x 2^l film pixels, the first one at film pixel 0, so the result does not depend on a division into tiles. With
L = ceil(log2(2 reach)) levels every pixel within `reach` of a known one is found: a value depends on pixels at most 2.5 * 2^L away.

Source: Gortler et al., "The lumigraph", SIGGRAPH 1996, section 3.4.2 (push-pull with saturated weights); Kraus and Strengert, "Pyramid filters based
on bilinear interpolation", GRAPP 2007 (the bilinear push, of which the limit is a biquadratic B-spline).
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


def pull(w, x):
    """Weights (h, w) and weighted values (q, h, w) of the next coarser level; h and w are even."""
    four = lambda v: v[..., ::2, ::2] + v[..., ::2, 1::2] + v[..., 1::2, ::2] + v[..., 1::2, 1::2]
    total, saturated = four(w), np.minimum(1, four(w))
    return saturated, four(x) * np.divide(saturated, total, out=np.zeros_like(total), where=total > 0)


def up(w, x):
    """Bilinear interpolation to twice the samples of weighted values x with weights w, renormalised: (value, has a value)."""
    def along(v, axis):
        n = v.shape[axis]
        low, high = v.take(np.maximum(np.arange(n) - 1, 0), axis), v.take(np.minimum(np.arange(n) + 1, n - 1), axis)
        fine = np.stack([(3 * v + low) / 4, (3 * v + high) / 4], axis + 1 if axis >= 0 else v.ndim + axis + 1)
        shape = list(v.shape)
        shape[axis] *= 2
        return fine.reshape(shape)
    known = (w > 0).astype(float)
    value = np.divide(x, w, out=np.zeros_like(x), where=w > 0)
    twice = lambda v: along(along(v, -2), -1)
    share = twice(known)
    return np.divide(twice(value * known), share, out=np.zeros((len(x), *share.shape)), where=share > 0), share > 0


def extrapolate(a, c, v, reach, margin):
    """(light, vergence, found) at every pixel, from shares a, c = a x light, v = a x vergence on the film grown by `margin`."""
    levels = int(np.ceil(np.log2(2 * max(reach, 1))))
    side = 2 ** levels
    before = -(-margin // side) * side - margin                 # whole blocks before film pixel 0
    after = [-(n + before) % side for n in a.shape]
    pad = ((before, after[0]), (before, after[1]))
    w = np.pad(np.minimum(a, 1.0), pad)
    scale = np.divide(np.minimum(a, 1.0), a, out=np.zeros_like(a), where=a > 0)
    x = np.stack([np.pad(c * scale, pad), np.pad(v * scale, pad)])
    pyramid = [(w, x)]
    for _ in range(levels):
        pyramid.append(pull(*pyramid[-1]))
    w, x = pyramid.pop()
    while pyramid:
        coarse, found = up(w, x)
        w, x = pyramid.pop()
        x = x + (1 - w) * np.where(found, coarse, 0.0)
        # A sample without a value above it keeps its own weight; all others now have a full value.
        w = np.where(found, 1.0, w)
    value = np.divide(x, w, out=np.zeros_like(x), where=w > 0)
    crop = np.s_[before:before + a.shape[0], before:before + a.shape[1]]
    return value[0][crop], value[1][crop], (w > 0)[crop]
