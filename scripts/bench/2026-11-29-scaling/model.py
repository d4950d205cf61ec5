#!/usr/bin/env python3
"""The paper's job (31 bands of 14141 x 14141 px) on 64 cores, and on 8 hosts of 64 cores with the chart and the film on one object store: what bounds it.

    model.py [measured.json]

A job on n cores takes  start + first preparation + max(bounds) + end  with the bounds

    cores        (core seconds of tiles and of preparation) / (0.97 n)     0.97: 64 workers of the scheduler (2026-11-21-scheduler)
    preparation  bands * (s + l / n): one thread prepares bands one ahead; s is what it does alone, l what its threads share
    disk         bytes read and written / rate

s and l follow from the wall time on one thread and on two of preparations with nothing beside (Amdahl), as does what a trace does on one thread. Measured: core seconds,
bytes, preparation, start, end (measured.json, measure.py, on two cores). Assumed: perfect scaling of tiles but for the 0.97; rates of disks, links
and the store; 30 ms for a request. Nothing here was run on more than two cores.
"""

import json
import math
import pathlib
import sys

BANDS = 31
SCHEDULER = 0.97
SIDE = 14141
DISKS_GB_S = [2.0, 8.0, 24.0]
HOSTS, HOST_CORES = 8, 64
LINK_GB_S = 12.5  # 100 GbE a host
STORES_GB_S = [10.0, 50.0]
REQUEST_S = 0.03
CONCURRENT = 64  # requests in flight of a host
CHUNK, SHARD = 512, 2048  # px, of charts and films


def amdahl(one, two):
    """What one thread does alone, and what is shared, of times on one thread and two."""
    alone = min(max(2 * two - one, 0.0), one)
    return alone, one - alone


def main():
    path = sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).with_name("measured.json")
    measured = json.loads(pathlib.Path(path).read_text())
    count = len(measured["bands"].split(","))
    trace = amdahl(*(t["wall_s"] / count for t in measured["traces"]))
    print(f"a band's trace: {trace[0]:.2f} s on one thread, {trace[1]:.2f} core s on all")

    def of(kind, source, tails, threads):
        is_it = lambda f: f["source"].startswith(source) and f["tails"] == tails and f["threads"] == threads
        return next(filter(is_it, measured[kind]))

    for source in ("gen:", "chart"):
        for tails in ("off", "on"):
            two = of("films", source, tails, 2)
            tiles = {k: v / count for k, v in two["core_s"].items() if k != "prepare"}
            alone, shared = amdahl(*(of("prepared", source, tails, threads)["thread_s"]["prepare"] / count for threads in (1, 2)))
            gb = ((two["bytes_read"] or 0) + two["bytes_written"]) * 1e-9 / count
            start, end = two["startup_s"], max(two["process_s"] - two["startup_s"] - two["wall_s"], 0.0)
            tiles_s = sum(tiles.values())
            print(f"\n{'drawn' if source == 'gen:' else 'store to store'}, tails {tails}; a band: tiles {tiles_s:.2f} core s ("
                  + ", ".join(f"{k} {v:.2f}" for k, v in tiles.items())
                  + f"), preparation {alone:.3f} s on one thread and {shared:.3f} core s on all, {gb:.2f} GB; start {start:.2f}, end {end:.2f} s")
            for cores in (2, 8, 16, 64):
                cpu = BANDS * (tiles_s + alone + shared) / (SCHEDULER * cores)
                prepare = BANDS * (alone + shared / cores)
                first = alone + shared / cores
                cells = []
                for disk in DISKS_GB_S:
                    bounds = {"cores": cpu, "preparation": prepare, "disk": BANDS * gb / disk}
                    bound = max(bounds, key=bounds.get)
                    cells.append(f"{start + first + bounds[bound] + end:6.1f} s ({bound})")
                traced = BANDS * (trace[0] + trace[1] / cores)
                print(f"  {cores:>2} cores; disks of {', '.join(f'{d:g}' for d in DISKS_GB_S)} GB/s: {'; '.join(cells)}; traces before it, once: {traced:.1f} s")
            if source == "chart":
                hosts(two, count, tiles_s + alone + shared, (alone, shared), start + end)


def hosts(film, count, core_s, preparation, fixed_s):
    """A unit is a band, whole or cut into parts of its rows of shards; of 31 bands on 8 hosts the last round leaves hosts idle."""
    read, written = (film["bytes_read"] * 1e-9 / count, film["bytes_written"] * 1e-9 / count)
    chunks, shards = math.ceil(SIDE / CHUNK) ** 2, math.ceil(SIDE / SHARD) ** 2
    # Of a band: a chunk each, an index a shard of the chart; for a shard of the film a PUT and the group's metadata.
    requests = chunks + shards + 2 * shards
    print(f"  {HOSTS} hosts of {HOST_CORES} cores, chart and film on one store: {BANDS * read:.1f} GB read, {BANDS * written:.1f} GB written, {BANDS * requests} requests")
    for store in STORES_GB_S:
        cells = []
        for parts, again in ((1, 0.0), (2, 0.041), (4, 0.134)):
            units = BANDS * parts
            rounds = math.ceil(units / HOSTS)
            of_unit = (1 + again) / parts
            prepare = preparation[0] + preparation[1] / HOST_CORES
            bounds = {
                "cores": rounds * core_s * of_unit / (SCHEDULER * HOST_CORES),
                "preparation": rounds * prepare,
                "links": rounds * (read * of_unit + written / parts) / LINK_GB_S,
                "store": BANDS * (read * (1 + again) + written) / store,
                "requests": BANDS * requests * (1 + again) / HOSTS * REQUEST_S / CONCURRENT,
            }
            bound = max(bounds, key=bounds.get)
            cells.append(f"{parts} part{'s' if parts > 1 else ''} a band {fixed_s + prepare + bounds[bound]:.1f} s ({bound})")
        print(f"    store of {store:g} GB/s: {'; '.join(cells)}")


main()
