"""Sheets of a triangle mesh as a pinhole at the entrance pupil sees it, in float64: the model of the golden scenes.

NumPy only, brute force: every triangle is tested against every ray. Camera frame: x right, y down, z into the scene, metres; the direction of
a ray is (x, y, 1) and the vergence of a hit 1/z.
"""

from dataclasses import dataclass, field

import numpy as np

NOT_SOLID = -1


def pattern(n):
    """Places (dx, dy) of n samples about the centre of a pixel."""
    g = {1: 1, 4: 2, 16: 4, 64: 18}[n]
    i = np.arange(n)
    return np.stack([(i + 0.5) / n - 0.5, (g * (i + 1) % (n + 1) - 0.5) / n - 0.5], 1)


def along_axis(position, size, pitch_mm, focal_mm):
    """Component of the direction of a column or row of a centred chart of scale 1."""
    return ((position - (size - 1.0) / 2.0) * pitch_mm * 1.0 + 0.0) / focal_mm


@dataclass
class Material:
    weights: tuple
    two_sided: bool = True
    alpha: float = 1.0
    mode: int = 0  # 0 opaque, 1 mask, 2 blend
    cutoff: float = 0.5


@dataclass
class Mesh:
    """Triangles keep their numbers; degenerate ones are not hit."""

    vertices: np.ndarray
    triangles: np.ndarray
    material_of: np.ndarray
    materials: list
    use_solids: bool = True
    valid: np.ndarray = field(init=False)
    solid: np.ndarray = field(init=False)
    around: dict = field(init=False)

    def __post_init__(self):
        self.vertices = np.asarray(self.vertices, np.float32) + np.float32(0)
        corners = self.vertices[self.triangles]
        same = lambda a, b: (corners[:, a] == corners[:, b]).all(1)
        self.valid = ~(same(0, 1) | same(1, 2) | same(2, 0))
        self.corners = corners.astype(np.float64)
        self.solid = self.find_solids()
        self.around = {c: self.contains_origin(self.corners[self.solid == c]) for c in set(self.solid.tolist()) - {NOT_SOLID}}

    def find_solids(self):
        """A component connected by edges is solid if each edge has one triangle in each direction and all materials are opaque."""
        number = {}
        place = [number.setdefault(v.tobytes(), len(number)) for v in self.vertices]
        edges = {}
        for t in np.flatnonzero(self.valid):
            w = [place[v] for v in self.triangles[t]]
            for a, b in zip(w, w[1:] + w[:1]):
                edges.setdefault((min(a, b), max(a, b)), ([], []))[a < b].append(int(t))
        neighbours = {int(t): [] for t in np.flatnonzero(self.valid)}
        is_open = set()
        for down, up in edges.values():
            all_ = down + up
            for t in all_:
                neighbours[t] += all_
            if len(down) != 1 or len(up) != 1:
                is_open.update(all_)
        solid = np.full(len(self.triangles), NOT_SOLID)
        seen = set()
        for start in neighbours:
            if start in seen:
                continue
            component, todo = [], [start]
            seen.add(start)
            while todo:
                t = todo.pop()
                component.append(t)
                for u in neighbours[t]:
                    if u not in seen:
                        seen.add(u)
                        todo.append(u)
            opaque = all(self.materials[self.material_of[t]].mode == 0 for t in component)
            if self.use_solids and opaque and not is_open.intersection(component):
                solid[component] = start
        return solid

    @staticmethod
    def contains_origin(corners):
        """Winding number by the solid angles of the triangles (Van Oosterom and Strackee 1983)."""
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        la, lb, lc = (np.sqrt((p * p).sum(1)) for p in (a, b, c))
        volume = (a * np.cross(b, c)).sum(1)
        real = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        return abs(np.arctan2(volume, real).sum() / (2 * np.pi)) > 0.5


def product(a, b):
    """a x b with one rounding of each component for float32 values."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def is_positive(n, x, y):
    """Sign of the edge function; 0 has the sign of the first component that is not 0. None: no ray is inside."""
    nonzero = [v for v in n if v != 0]
    if not nonzero:
        return None
    e = (n[0] * x + n[1] * y) + n[2]
    return (e > 0) | ((e == 0) & (nonzero[0] > 0))


def all_hits(mesh, x, y):
    """Hits of rays: arrays (ray, vergence, triangle, front), sorted by ray, vergence descending, triangle."""
    found = []
    for t in np.flatnonzero(mesh.valid):
        a, b, c = (tuple(float(v) for v in p) for p in mesh.corners[t])
        signs = [is_positive(product(p, q), x, y) for p, q in ((b, c), (c, a), (a, b))]
        if any(s is None for s in signs):
            continue
        n = product(tuple(q - p for p, q in zip(a, b)), tuple(q - p for p, q in zip(a, c)))
        offset = (n[0] * a[0] + n[1] * a[1]) + n[2] * a[2]
        if offset == 0:
            continue
        v = ((n[0] * x + n[1] * y) + n[2]) / offset
        inside = ((signs[0] == signs[1]) & (signs[1] == signs[2]) & (v > 0) & np.isfinite(v)).nonzero()[0]
        found.append((inside, v[inside], np.full(len(inside), t), np.full(len(inside), offset < 0)))
    ray, v, t, front = (np.concatenate([f[k] for f in found]) for k in range(4))
    order = np.lexsort((t, -v, ray))
    return ray[order], v[order], t[order], front[order]


def surfaces(mesh, hits, sample, samples):
    """Those of the sorted hits (vergence, triangle, front) of a ray that are surfaces."""
    crossings = {}
    for _, t, _ in hits:
        crossings[mesh.solid[t]] = crossings.get(mesh.solid[t], 0) + 1
    inside, out = set(), []
    for v, t, front in hits:
        number = int(mesh.material_of[t])
        material, solid = mesh.materials[number], int(mesh.solid[t])
        is_visible = not inside
        if solid != NOT_SOLID and crossings[solid] % 2 == int(mesh.around[solid]):
            inside ^= {solid}
        elif not (material.two_sided or front):
            continue
        if material.mode == 1 and material.alpha < material.cutoff:
            continue
        if material.mode == 2 and material.alpha <= ((sample + 0.5) / samples + number * 0.6180339887498949) % 1.0:
            continue
        if is_visible:
            out.append((v, t))
    return out


def sheets_of(samples, sheets, gap):
    """Sheets of a pixel from the (vergence, triangle) of each sample's surfaces: (vergence, coverage, triangles whose weights are averaged)."""
    n = len(samples)
    rest = [list(s) for s in samples]
    unseen = {i for i in range(n) if samples[i]}
    left, out, before = n, [], n
    while len(out) < sheets and any(rest):
        near_first = sorted((-s[0][0], i) for i, s in enumerate(rest) if s)
        members = [near_first[0][1]]
        for minus_v, i in near_first[1:]:
            if rest[members[-1]][0][0] + minus_v > gap:
                break
            members.append(i)
        taken = {i: rest[i][0] for i in sorted(members)}
        for i, (v, _) in taken.items():
            while rest[i] and v - rest[i][0][0] <= gap:
                rest[i].pop(0)
        first = [i for i in taken if i in unseen]
        if left and not first:
            continue
        of = first or list(taken)
        before = left
        out.append([sum(taken[i][0] for i in of) / len(of), len(first) / left if left else len(taken) / n, [taken[i][1] for i in of]])
        unseen -= set(first)
        left -= len(first)
    if unseen:
        late = [samples[i][0][1] for i in sorted(unseen)]
        out[-1][2] = out[-1][2] + late
        out[-1][1] = len(out[-1][2]) / before
    return out, len(unseen)
