"""Closed forms of defocus by a uniform round pupil, and the thin lens as nodes of the model."""
import numpy as np

import depth_reference as depth


def disc_area(radius, y, x):
    """Share of every pixel (y, x) that a disc of `radius` px about 0 covers, exactly.

    F(x, y) = area of the disc within 0 .. x, 0 .. y; a pixel's share is the second difference of F at its corners.
    """
    def area(y, x):
        ax, ay = np.minimum(np.abs(x), radius), np.minimum(np.abs(y), radius)
        start = np.minimum(np.sqrt(np.maximum(radius ** 2 - ay ** 2, 0)), ax)
        below = lambda u: (u * np.sqrt(np.maximum(radius ** 2 - u ** 2, 0)) + radius ** 2 * np.arcsin(u / radius)) / 2
        return np.sign(x) * np.sign(y) * (ay * start + below(ax) - below(start))
    return area(y + 0.5, x + 0.5) - area(y - 0.5, x + 0.5) - area(y + 0.5, x - 0.5) + area(y - 0.5, x - 0.5)


def disc_kernel(radius):
    """Uniform disc of `radius` px integrated exactly over film pixels: (n, n), sum 1; a radius of 0 is a point."""
    if radius == 0:
        return np.ones((1, 1))
    c = int(np.ceil(radius - 0.5))
    y, x = np.mgrid[-c:c + 1, -c:c + 1]
    return disc_area(radius, y, x) / (np.pi * radius ** 2)


def edge_profile(tau):
    """Share of a disc on one side of a straight edge at tau radii from its centre."""
    tau = np.clip(tau, -1, 1)
    return 0.5 + (tau * np.sqrt(1 - tau ** 2) + np.arcsin(tau)) / np.pi


def overlap(a, b, d):
    """Area common to discs of radii a and b whose centres are d apart."""
    if d >= a + b:
        return 0.0
    if d <= abs(a - b):
        return np.pi * min(a, b) ** 2
    part = lambda r, o: r * r * np.arccos((d * d + r * r - o * o) / (2 * d * r))
    kite = 0.5 * np.sqrt((-d + a + b) * (d + a - b) * (d - a + b) * (d + a + b))
    return part(a, b) + part(b, a) - kite


def thin_lens(vergence, blur, focus, reach_mm=1e6):
    """A lens without distortion and fall-off whose node V has a disc of blur |V - focus| px at every height."""
    ends = np.array([0.0, reach_mm])
    kernels = [disc_kernel(blur * abs(v - focus)) for v in vergence]
    return depth.Lens(ends, ends, np.ones(2), np.asarray(vergence, float), [ends] * len(kernels), [[k[None], k[None]] for k in kernels], blur, focus)
