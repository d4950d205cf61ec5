#!/usr/bin/env python3
"""Time of a band of 14141 x 14141 px on a GPU, store to store: each part of the pipeline alone, and which one is the bound.

    model.py [measured.json [SHARE]]        SHARE: of the bound by issue that the PSF kernel reaches [0.4]

The parts run beside each other (pipeline/src/executor/gpu_queue.rs), so a band takes as long as the longest of them. Core seconds of the
workers and times of the two threads of the queue are measured (measured.json, by measure.py); kernels are counted from machine code
(2026-11-21-cuda-counted) or by the bytes that they move; nothing was run on a GPU. Two cores are taken by the queue's threads.
"""

import json
import pathlib
import sys

PX = 14141**2
GB = PX * 4e-9
CORES = [4, 16, 64]
# An H200 with 132 multiprocessors of 4 schedulers at 1.755 GHz.
INSTRUCTIONS_PER_S = 132 * 4 * 1.755e9
SHARE_OF_ISSUE = float(sys.argv[2]) if len(sys.argv) > 2 else 0.4  # 35 to 50 % of the bound by issue is expected
MEMORY_GB_PER_S = 4800 * 0.7
LINK_GB_PER_S = {"PCIe 4": 22.0, "PCIe 5": 45.0}
DISKS_GB_PER_S = [2.0, 6.0, 24.0]


def kernels_s(case):
    """Seconds of the kernels of a band."""
    block, fill, overlap = case["block_px"], case["fill"], case["tail_overlap"]
    psf = case["warp_instructions_px"] / fill * PX / (INSTRUCTIONS_PER_S * SHARE_OF_ISSUE)
    # Bytes: chart read and remapped written; contributions written and read; film rows zeroed, read, written.
    remap = 8 * PX * case["chart_overlap"] / MEMORY_GB_PER_S / 1e9
    add = (8 * overlap + 12) * PX / MEMORY_GB_PER_S / 1e9
    return psf + remap + add


def main():
    path = sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).with_name("measured.json")
    with open(path) as f:
        measured = json.load(f)
    print("Milliseconds a band of 14141 x 14141 px, store to store; in brackets: the bound")
    for name, case in measured["cases"].items():
        planning_s = case["descriptors_core_s"] + case["base_kernels_core_s"]
        core_s = sum(measured["core_s"].values()) + planning_s
        print(f"\n{name}; workers {core_s:.2f} core s a band: " + ", ".join(f"{k} {v:.2f}" for k, v in measured["core_s"].items()) + f", planning {planning_s:.2f}")
        for link, rate in LINK_GB_PER_S.items():
            parts = {
                "kernels": kernels_s(case),
                "upload": GB * case["chart_overlap"] / rate,
                "download": GB / rate,
                "launching thread": case["launch_s"],
                "planning thread": None,
            }
            for cores in CORES:
                workers = max(1, cores - 2)
                parts["planning thread"] = planning_s / min(cores, 8)
                of_host = dict(parts, workers=core_s / workers)
                for disk in DISKS_GB_PER_S:
                    times = dict(of_host, disk=(measured["read_gb"] + measured["written_gb"]) / disk)
                    bound = max(times, key=times.get)
                    device = max(parts["kernels"], parts["upload"], parts["download"])
                    print(
                        f"  {link}, {cores:>2} cores, disk {disk:>4.0f} GB/s: {times[bound] * 1e3:>5.0f} ({bound}); 31 bands {31 * times[bound]:>5.1f} s;"
                        f" GPU busy {100 * parts['kernels'] / times[bound]:.0f} %, device and link alone {device * 1e3:.0f}"
                    )
        print(
            f"  parts: kernels {parts['kernels'] * 1e3:.0f}, download {parts['download'] * 1e3:.0f} (PCIe 5), launching {parts['launching thread'] * 1e3:.0f},"
            f" planning with 64 cores {parts['planning thread'] * 1e3:.0f}"
        )
    rate = GB / 0.1
    encode, decode = measured["encode_mb_per_s"] / 1e3, measured["decode_mb_per_s"] / 1e3
    print(
        f"\nA band in 100 ms is {rate:.1f} GB/s of f32 each way: {rate / encode:.1f} cores encode (lz4 with byte shuffle at {encode:.2f} GB/s a core),"
        f" {rate / decode:.1f} decode ({decode:.2f} GB/s); a disk of {rate * measured['share']:.1f} GB/s writes"
    )


main()
