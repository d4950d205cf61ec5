#!/usr/bin/env python3
"""Host work of a GPU queue for a band of 14141 x 14141 px, written to measured.json for model.py.

    measure.py LENSCUBE EMULATED_DRIVER_DIR

The emulated driver (pipeline/tests/emulated_cuda; the tests build it below target/tmp/emulated-cuda) runs with kernels and copies that do
nothing, since a GPU does them beside the host, so the launching thread only calls the driver; the emulated driver's own time in those
calls is included. Times are CPU seconds of the launching thread and of the workers, from the run's record. The planning thread's are wall
seconds with one thread of rayon, the least of three runs, since they include what other programs take. The figures are a tenth of those of
a run of ten bands, allocations included.

Not measured here: reading and decoding a chart with 1 % noise, encoding and writing, by the store-to-store job of 2026-11-22-full-job
(31 bands, idle machine); rates of lz4 by 2026-11-21-codec; warp instructions a pixel by 2026-11-21-cuda-counted.
"""

import glob
import json
import os
import pathlib
import subprocess
import sys
import tempfile

# Lens: window, block of the partition, warp instructions a pixel (of 151 px for 147), side of a tile.
LENSES = {"double-gauss-28-npz": (51, 78, 16.2, 468), "double-gauss-28": (147, 110, 38.4, 440)}
STORE_TO_STORE = {"read, decode": 50.0 / 31, "encode": 22.3 / 31, "write": 4.4 / 31, "prepare": 2.0 / 31}


def run(lenscube, driver, lens, wavelengths, place):
    """Record of a run."""
    film = f"{place}/film.zarr"
    settings = {"WORK": "none", "STREAMS": "deferred", "MEMORY": str(6 << 30)}
    env = os.environ | {f"EMULATED_CUDA_{name}": value for name, value in settings.items()}
    env |= {"LD_LIBRARY_PATH": driver, "RAYON_NUM_THREADS": "1"}
    command = [lenscube, "run", f"gen:composite?size=14141&wavelengths={wavelengths}", film, "--lens", lens]
    command += ["--device", "cuda:0", "--memory", "3GiB", "--no-fsync", "-q"]
    subprocess.run(command, env=env, check=True)
    with open(glob.glob(f"{film}/runs/*.json")[0]) as f:
        return json.load(f)


def flat(value):
    """Numbers of a record of a queue and of the workers, by name."""
    did, core = value["devices"][0]["did"], value["core_s"]
    numbers = {k: v for k, v in did.items() if isinstance(v, (int, float))}
    return numbers | did["host"] | {"launch": did["launch"]["core_s"], "fill": core["remap"], "place": core["add"]}


def main():
    lenscube, driver = sys.argv[1:]
    cases, of_workers = {}, {}
    for lens, (window, block, instructions, tile) in LENSES.items():
        def figures(wavelengths, bands):
            with tempfile.TemporaryDirectory() as place:
                record = run(lenscube, driver, lens, wavelengths, place)
            return {name: value / bands for name, value in flat(record).items()}

        band, *others = [figures("500:590:10", 10) for _ in range(3)]
        planning = {name: min(one[name] for one in [band, *others]) for name in ("descriptors_s", "base_kernels_s")}
        cases[f"{window} px"] = {
            "launch_s": band["launch"],
            "descriptors_core_s": planning["descriptors_s"],
            "base_kernels_core_s": planning["base_kernels_s"],
            "batches": band["batches"],
            "tiles": band["tiles"],
            "chart_overlap": band["bytes_up"] / (4 * 14141**2),
            "tail_overlap": ((tile + window - 1) / tile) ** 2,
            "block_px": block,
            "warp_instructions_px": instructions,
            "fill": band["pixels"] / (band["tiles"] * tile**2),
        }
        of_workers = {"chart to page-locked memory": band["fill"], "film rows to shards": band["place"]}
    measured = {
        "cases": cases,
        "core_s": STORE_TO_STORE | of_workers,
        "read_gb": 19.30 / 31,
        "written_gb": 14.63 / 31,
        "encode_mb_per_s": 923,
        "decode_mb_per_s": 1068,
        "share": 0.606,
    }
    path = pathlib.Path(__file__).with_name("measured.json")
    path.write_text(json.dumps(measured, indent=1) + "\n")
    print(path.read_text())


main()
