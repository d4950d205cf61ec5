#!/usr/bin/env python3
"""Wall time of the paper's job, store to store, by codec: max(disk, core seconds / cores), from the rates of measured.txt.

    forecast.py measured.txt

24.8 GB of chart are decoded and as many of film encoded. The other stages take 114 core seconds on the machine of measured.txt
(scripts/bench/README.md, 2026-11-21-traced-job: 205.8 less 45.9 for reading and 45.9 for encoding). Disks are given by one rate for
reading and writing.
"""

import sys

GB = 31 * 14141**2 * 4e-9
OTHER_CORE_S = 205.8 - 45.9 - 45.9
MACHINES = [("2 cores, 0.35 GB/s", 2, 0.35), ("2 cores, 2 GB/s", 2, 2.0), ("16 cores, 2 GB/s", 16, 2.0), ("16 cores, 6 GB/s", 16, 6.0)]


def main():
    print(f"{'film, bits, codec':<34} {'share':>6}" + "".join(f"{name:>20}" for name, *_ in MACHINES))
    for line in open(sys.argv[1]):
        name, figures = line.rsplit(":", 1)
        if name.startswith("film, "):
            continue
        share, encode, decode = map(float, figures.split(","))
        core_s = OTHER_CORE_S + GB * 1e3 * (1 / encode + 1 / decode)
        walls = [max(2 * GB * share / disk, core_s / cores) for _, cores, disk in MACHINES]
        print(f"{name:<34} {share:>6.3f}" + "".join(f"{wall:>18.0f} s" for wall in walls))


main()
