#!/usr/bin/env python3
"""Time of the paper's job, and of a hundred such charts, against nodes: where more of them stop helping, and why.

Reads measured.json (units of the paper's job, measured on this machine) and prints tables.

    unit   one band x a number of shard rows; a worker does it in  start-up + compute / its cores
    job    ceil(units / workers) rounds of units, but never less than bytes / bandwidth, for the store and for each node's link
    cut    of the cuts into 7, 4, 2 or 1 shard rows a unit the one with the least time; finer cuts compute tiles twice

GPU columns are ASSUMED: no GPU was at hand. What they share with the measured ones: bytes, codecs on the node's cores, cuts.
"""

import json
import math
import pathlib
import sys

HERE = pathlib.Path(__file__).parent
MEASURED = json.loads((HERE / "measured.json").read_text())

BANDS = 31
PIXELS = 14141**2
NODES = [1, 2, 4, 8, 16, 32, 64, 128]

# A node as clusters have them, and what it reaches the store by.
NODE_CORES = 32
LINK_GB_S = 3.0  # 25 GbE
STORES_GB_S = {"one NVMe server, 5 GB/s": 5.0, "parallel file system, 50 GB/s": 50.0}

# ASSUMED, per GPU: kernels at 10 Gpx/s, PCIe 4 x16 both ways at once at 20 GB/s; a CUDA context and its kernels to open.
GPU_PX_S = 10e9
GPU_LINK_GB_S = 20.0
GPU_START_S = 0.5
GPUS = 4


def again(rows):
    """Share of the tiles computed twice when a unit has `rows` of the 7 shard rows of a band."""
    return MEASURED["tiles_again_by_rows"][str(rows)]


def unit_cpu(rows):
    """Seconds of a unit on a node that gives it all its cores: start-up (one thread), then all stages."""
    share = min(rows, 7) / 7
    core_s = MEASURED["unit"]["core_s"] * share * (1 + again(rows))
    return MEASURED["unit"]["startup_s"] + core_s / NODE_CORES


def unit_gpu(rows):
    """ASSUMED. Codecs and reading stay on the cores, a quarter of the node's to each GPU; kernels and transfers overlap them."""
    share = min(rows, 7) / 7
    codec = MEASURED["unit"]["codec_core_s"] * share * (1 + again(rows)) / (NODE_CORES / GPUS)
    kernels = PIXELS * share * (1 + again(rows)) / GPU_PX_S
    transfer = 4e-9 * PIXELS * share * (1 + again(rows)) / GPU_LINK_GB_S
    return MEASURED["unit"]["startup_s"] + GPU_START_S + max(codec, kernels, transfer)


def job(charts, nodes, workers_a_node, unit_s, store_gb_s):
    """Seconds, the cut, and what bounds it."""
    moved_gb = charts * BANDS * (MEASURED["unit"]["read_gb"] + MEASURED["unit"]["written_gb"])
    best = None
    for rows in (7, 4, 2, 1):
        units = charts * BANDS * math.ceil(7 / rows)
        workers = nodes * workers_a_node
        bounds = {
            "computing": units / workers * unit_s(rows),
            "last round": math.ceil(units / workers) * unit_s(rows),
            "links": moved_gb / (nodes * LINK_GB_S),
            "store": moved_gb / store_gb_s,
        }
        seconds = max(bounds.values())
        # Where rounding up to whole rounds costs less than a tenth, it is the computing that counts.
        if bounds["last round"] < 1.1 * bounds["computing"]:
            del bounds["last round"]
        why = max(bounds, key=bounds.get)
        if best is None or seconds < 0.98 * best[0]:
            best = (seconds, rows, why)
    return best


def table(charts, store_gb_s):
    kinds = [
        (f"measured: {NODE_CORES} cores a node", 1, unit_cpu),
        ("ASSUMED: 1 GPU, 8 cores a node", 1, unit_gpu),
        (f"ASSUMED: {GPUS} GPUs, 32 cores a node", GPUS, unit_gpu),
    ]
    print(f"{'nodes':>5}  " + "  ".join(f"{name:^38}" for name, _, _ in kinds))
    for nodes in NODES:
        cells = []
        for _, workers, unit_s in kinds:
            seconds, rows, why = job(charts, nodes, workers, unit_s, store_gb_s)
            one = job(charts, 1, workers, unit_s, store_gb_s)[0]
            cells.append(f"{seconds:9.1f} s  x{one / seconds:5.1f}  {rows} rows  {why:<10}")
        print(f"{nodes:>5}  " + "  ".join(f"{c:^38}" for c in cells))


def main():
    unit = MEASURED["unit"]
    print(
        f"a unit (one band of 14141 x 14141 px), mean of {MEASURED['units']}: {unit['core_s']:.2f} core s (of them reading, decoding,"
        f" encoding, writing {unit['codec_core_s']:.2f}), start-up {unit['startup_s']:.3f} s, read {unit['read_gb']:.3f} GB,"
        f" written {unit['written_gb']:.3f} GB"
    )
    shares = ", ".join(f"{rows}: {100 * again(rows):.1f} %" for rows in (7, 4, 2, 1))
    print(f"tiles computed twice, by shard rows a unit: {shares}\n")
    for name, gb_s in STORES_GB_S.items():
        for charts in (1, 100):
            print(f"{charts} chart{'s' if charts > 1 else ''} of 200 Mpx x {BANDS}, {name}, links of {LINK_GB_S:g} GB/s")
            table(charts, gb_s)
            print()


if __name__ == "__main__":
    sys.exit(main())
