"""Compares golden data written anew with those of the tree: `python compare_golden.py NEW TREE`.

Files must be the same set.  Where the bytes differ (another processor may round sin, pow or atan2 differently, another codec
library may compress differently), the decoded arrays must have the same type and shape and differ by at most 2^-23 of their
largest value: one last bit of float32, in which they are stored.  Integers and text must be equal, `peak` within 1e-12 of itself.
"""
import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import zarr

FOLDERS = ("charts", "packs", "cases")
LAST_BIT = 2.0 ** -23


def files(root):
    return {p.relative_to(root).as_posix(): p for f in FOLDERS for p in (root / f).rglob("*") if p.is_file()}


def stores(root):
    """The outermost Zarr nodes: charts, expected films, lens packs."""
    return sorted(p.relative_to(root).as_posix() for f in FOLDERS for p in (root / f).rglob("*") if p.suffix == ".zarr" or p.name.endswith(".zip"))


def arrays(path):
    """Every array of a store, by its path in it, and the attributes of its groups."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as z:
            group = z.namelist()[0].split("/")[0]
        path, group = zarr.storage.ZipStore(path, mode="r"), group
    else:
        group = ""
    node = zarr.open(path, path=group, mode="r")
    if isinstance(node, zarr.Array):
        return {"": node}, {}
    members = dict(node.members(max_depth=None))
    groups = {"": node} | {k: v for k, v in members.items() if isinstance(v, zarr.Group)}
    return {k: v for k, v in members.items() if isinstance(v, zarr.Array)}, {k: dict(g.attrs) for k, g in groups.items()}


def difference(new, old, where):
    """Largest difference over the largest value; what must be equal is checked."""
    assert (new.shape, new.dtype, dict(new.attrs)) == (old.shape, old.dtype, dict(old.attrs)), f"{where}: other type, shape or attributes"
    new, old = new[...], old[...]
    if old.dtype.kind != "f":
        assert (new == old).all(), f"{where}: other values"
        return 0.0
    assert (np.isnan(new) == np.isnan(old)).all(), f"{where}: NaN in other places"
    new, old = np.nan_to_num(new.astype(float)), np.nan_to_num(old.astype(float))
    return abs(new - old).max() / abs(old).max()


def main():
    new, tree = Path(sys.argv[1]), Path(sys.argv[2])
    a, b = files(new), files(tree)
    assert a.keys() == b.keys(), f"files only in one of the two: {sorted(a.keys() ^ b.keys())[:10]}"
    other = sorted(k for k in a if a[k].read_bytes() != b[k].read_bytes())
    worst, count = (0.0, ""), 0
    for store in stores(tree) if other else []:
        (x, attributes_x), (y, attributes_y) = arrays(new / store), arrays(tree / store)
        assert x.keys() == y.keys() and attributes_x == attributes_y, f"{store}: other arrays or attributes"
        count += len(x)
        worst = max([worst, *((difference(x[k], y[k], f"{store}/{k}"), f"{store}/{k}") for k in x)])
    for name in (k for k in other if k.endswith("case.json")):
        x, y = json.loads(a[name].read_text()), json.loads(b[name].read_text())
        peaks = np.array(x.pop("peak")), np.array(y.pop("peak"))
        assert x == y and np.allclose(*peaks, rtol=1e-12, atol=0), f"{name} differs"
    assert worst[0] <= LAST_BIT, f"{worst[1]} differs by {worst[0]:.1e} of its largest value, allowed {LAST_BIT:.1e}"
    if other:
        print(f"golden data: {len(a)} files, {len(other)} with other bytes; {count} arrays within {worst[0]:.1e} of their largest value")
    else:
        print(f"golden data: {len(a)} files, the same bytes")


main()
