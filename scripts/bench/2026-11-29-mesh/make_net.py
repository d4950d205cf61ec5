"""A wavy net of 2·ACROSS·DOWN triangles of 2.8 x 2.8 m, 10 m before a camera, as .glb: python make_net.py OUT.glb ACROSS DOWN"""
import json
import struct
import sys

import numpy as np

HALF_M = 1.4
out, across, down = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
vertices, triangles = (across + 1) * (down + 1), 2 * across * down
positions, indices = 12 * vertices, 12 * triangles
document = {
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
    "nodes": [{"mesh": 0, "name": "ground"}, {"camera": 0, "name": "Cam"}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.28, "znear": 0.1}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
    "buffers": [{"byteLength": positions + indices}],
    "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": positions}, {"buffer": 0, "byteOffset": positions, "byteLength": indices}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3"},
                  {"bufferView": 1, "componentType": 5125, "count": 3 * triangles, "type": "SCALAR"}],
}
text = json.dumps(document).encode()
text += b" " * (-len(text) % 4)
with open(out, "wb") as f:
    f.write(struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + positions + indices, len(text), 0x4E4F534A) + text)
    f.write(struct.pack("<II", positions + indices, 0x004E4942))
    x = np.linspace(-HALF_M, HALF_M, across + 1)
    for row in range(down + 1):
        y = -HALF_M + 2 * HALF_M * row / down
        z = -10 + 0.3 * np.sin(12 * x) * np.cos(2 * y) + 0.01 * np.sin(200 * x + 170 * y)
        f.write(np.stack([x, np.full_like(x, y), z], 1).astype("<f4").tobytes())
    column = np.arange(across, dtype="<u4")
    for row in range(down):
        a = row * (across + 1) + column
        b, c, d = a + 1, a + across + 2, a + across + 1
        f.write(np.stack([a, b, c, a, c, d], 1).astype("<u4").tobytes())
