"""Image shift of small errors by paraxial rays: the signs that any tracer of built lenses must have.

A tilted or decentred surface whose normal at the axis leans by the slope b (b = c d for a decentre d along +x) bends a ray that runs along the axis:
    u' = (n u - (y c - b) (n' - n)) / n'
An element tilted by +a about y (right-handed: +z towards +x) about a pivot: a vertex s behind the pivot moves by a s along +x, and the surface turns,
b = a (1 + c s).  About x (right-handed: +y towards +z): the same along -y.
"""


def shift(curvatures, indices, gaps, leans):
    """Height on the film of the ray along the axis; `leans[i]` = b of surface i, `indices[i]` behind surface i, `gaps[i]` behind it."""
    y = u = 0.0
    n = 1.0
    for c, after, gap, b in zip(curvatures, indices, gaps, leans, strict=True):
        u = (n * u - (y * c - b) * (after - n)) / after
        n, y = after, y + gap * u
    return y


def element_shift(lens, first, last, decentre=0.0, tilt=0.0):
    """Shift along +x of a decentre [mm] along +x, or of a tilt [rad] about +y, of surfaces first..last about the first vertex.

    For a decentre along +y: the same along +y; for a tilt about +x: the opposite along +y.
    """
    d = lens.design
    c = [1 / r for r in d.radius[:-1]]
    gaps = [b - a for a, b in zip(d.z, d.z[1:], strict=False)]
    inside = lambda k: first <= k <= last
    lean = [(c[k - 1] * decentre + tilt * (1 + c[k - 1] * (d.z[k - 1] - d.z[first - 1]))) if inside(k) else 0.0 for k in range(1, len(c) + 1)]
    return shift(c, lens.index[:-1], gaps, lean)
