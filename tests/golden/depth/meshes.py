"""Meshes as glTF files: walls, balls and their materials; corners in the camera frame, x right, y down, z along the axis, m."""
import json
import struct
import zlib

import numpy as np


def png(rgba):
    h, w, _ = rgba.shape
    chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    rows = b"".join(b"\0" + rgba[i].astype(np.uint8).tobytes() for i in range(h))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 6, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def glb(path, parts, materials=None, image=None, **root):
    """Parts (material, corners in the camera frame, triangles[, texture coordinates]) and a camera, below one node with the transform `root`."""
    blob, views, accessors, meshes = b"", [], [], []

    def view(data):
        nonlocal blob
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob += data + bytes(-len(data) % 4)
        return len(views) - 1

    def accessor(array, kind, component):
        bounds = {"min": array.min(0).tolist(), "max": array.max(0).tolist()} if kind == "VEC3" else {}
        accessors.append({"bufferView": view(array.tobytes()), "componentType": component, "type": kind, "count": len(array), **bounds})
        return len(accessors) - 1
    names = list(dict.fromkeys(part[0] for part in parts))
    for name, corners, triangles, *uv in parts:
        attributes = {"POSITION": accessor((np.asarray(corners) * [1, -1, -1]).astype(np.float32), "VEC3", 5126)}
        if uv:
            attributes["TEXCOORD_0"] = accessor(np.asarray(uv[0], np.float32), "VEC2", 5126)
        indices = accessor(np.asarray(triangles, np.uint32).reshape(-1), "SCALAR", 5125)
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": names.index(name)}]})
    n = len(meshes)
    nodes = [{"mesh": i} for i in range(n)] + [{"name": "Cam", "camera": 0}, {"name": "Root", "children": list(range(n + 1)), **root}]
    default = lambda name: {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}
    doc = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [n + 1]}], "nodes": nodes, "meshes": meshes, "accessors": accessors,
           "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.001}}],
           "materials": [{"name": m, "doubleSided": True, **(materials or {}).get(m, default(m))} for m in names]}
    if image is not None:
        doc |= {"images": [{"mimeType": "image/png", "bufferView": view(image)}], "samplers": [{"magFilter": 9728, "minFilter": 9728}],
                "textures": [{"source": 0, "sampler": 0}]}
    doc |= {"bufferViews": views, "buffers": [{"byteLength": len(blob)}]}
    text = json.dumps(doc).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob))
    path.write_bytes(head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob)
    return path


def colour(r, g, b, alpha=1, **more):
    return {"pbrMetallicRoughness": {"baseColorFactor": [r, g, b, alpha]}, **more}


BLACK = colour(0, 0, 0)


def quad(material, *corners):
    return material, np.array(corners, float), [(0, 1, 2), (0, 2, 3)]


def wall(material, z, half):
    return quad(material, (-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z))


def icosphere(material, centre, radius, level):
    g = (1 + 5 ** 0.5) / 2
    v = [np.array(p) / np.hypot(1, g) for s in (1, -1) for t in (g, -g) for p in ((s, t, 0), (0, s, t), (t, 0, s))]
    near = lambda a, b: abs(np.linalg.norm(v[a] - v[b]) - 2 / np.hypot(1, g)) < 1e-9
    f = [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near(a, b) and near(b, c) and near(a, c)]
    f = [t if np.linalg.det([v[k] for k in t]) > 0 else t[::-1] for t in f]
    for _ in range(level):
        middles = {}

        def middle(a, b):
            if (a, b) not in middles:
                v.append((v[a] + v[b]) / np.linalg.norm(v[a] + v[b]))
                middles[a, b] = middles[b, a] = len(v) - 1
            return middles[a, b]
        f = [t for a, b, c in f for ab, bc, ca in [(middle(a, b), middle(b, c), middle(c, a))] for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    return material, np.asarray(centre) + radius * np.array(v), f
