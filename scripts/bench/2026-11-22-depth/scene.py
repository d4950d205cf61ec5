#!/usr/bin/env python3
"""Depth array of a phone picture: floor from 0.9 m, wall at 4 m with a window to infinity, near discs at 0.5 and 0.8 m. scene.py OUT.npy WIDTH HEIGHT"""
import sys

import numpy as np

out, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
y, x = np.mgrid[:height, :width] / height
depth = np.full(y.shape, 4.0, np.float32)
depth[(abs(x - 0.95) < 0.18) & (abs(y - 0.25) < 0.15)] = np.inf
floor = y > 0.55
depth[floor] = np.minimum(4.0, 0.9 / np.maximum(1e-3, (y[floor] - 0.55) / 0.45 + 0.2))
for cy, cx, radius, z in ((0.55, 0.35, 0.14, 0.8), (0.8, 1.1, 0.17, 0.5), (0.3, 0.2, 0.05, 1.5), (0.6, 0.75, 0.08, 1.0)):
    depth[np.hypot(y - cy, x - cx) < radius] = z
np.save(out, depth)
