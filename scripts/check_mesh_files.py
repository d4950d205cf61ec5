#!/usr/bin/env python3
"""Mesh files of others and damaged ones: `check_mesh_files.py LENSCUBE MODELS [DAMAGED]`.

MODELS: the folder of Debian's package assimp-testmodels (usr/share/assimp: collected by Open Asset Import, each file under its own
licence). All glTF, OBJ and PLY files, and DAMAGED (default 300) copies of them that are cut or have bytes changed, become a complete scene of finite values,
or one error that names the file: never a panic, never more than 256 MiB + 64, never more than a minute.
"""
import collections
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import zarr

lenscube, models = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
damaged = int(sys.argv[3]) if len(sys.argv) > 3 else 300
ENDINGS = {".gltf", ".glb", ".obj", ".ply"}
LIMIT_MIB, SECONDS = 256 + 64, 60
VIEW = ["--lens", "phone", "--film-size", "64x48", "--film-pitch-um", "30", "--eye", "3,2,4", "--target", "0.1,0.2,0.1", "--near-m", "0.001", "--samples-per-px",
        "4", "--memory", "256MiB", "--no-fsync"]
failures, states, largest = [], collections.Counter(), 0


def limited():
    signal.alarm(SECONDS)                                   # survives exec


def scene(path, name):
    """Makes the scene of a file; notes what it must not do."""
    global largest
    with tempfile.TemporaryDirectory() as tmp:
        out = Path(tmp) / "scene.zarr"
        unit = [] if path.suffix.lower() in (".gltf", ".glb") else ["--mesh-unit", "m"]
        with open(Path(tmp) / "errors", "w+b") as errors:
            child = subprocess.Popen([lenscube, "scene", path, out, *VIEW, *unit], stdout=subprocess.DEVNULL, stderr=errors, preexec_fn=limited)
            _, status, usage = os.wait4(child.pid, 0)
            errors.seek(0)
            text = errors.read().decode(errors="replace")
        code = os.waitstatus_to_exitcode(status)
        child.returncode = code
        mib = usage.ru_maxrss / 1024
        largest = max(largest, mib)
        lines = [line for line in text.splitlines() if line.startswith("lenscube: ")]
        wrong = []
        if code == 0:
            group = zarr.open_group(out, mode="r")
            if not all(np.isfinite(group[k][:]).all() for k in ("weights", "coverage")):
                wrong.append("values that are not finite")
        elif code not in (1, 2):
            wrong.append(f"exit code {code}")
        elif len(lines) != 1 or path.name not in lines[0]:
            wrong.append("not one error that names the file")
        elif out.exists():
            wrong.append("an output beside an error")
        if mib > LIMIT_MIB:
            wrong.append(f"{mib:.0f} MiB")
        states["scene" if code == 0 else "error"] += 1
        if wrong:
            failures.append(name)
            print(f"! {name}: {'; '.join(wrong)}\n    {text.strip()[-400:]}", flush=True)
        elif "-v" in sys.argv:
            print(f"  {name}: {'scene' if code == 0 else lines[0]}", flush=True)


files = sorted(p for p in models.rglob("*") if p.suffix.lower() in ENDINGS and p.is_file())
assert len(files) >= 80, f"{len(files)} files below {models}"
for path in files:
    scene(path, path.relative_to(models))
print(f"{len(files)} files: {states['scene']} scenes, {states['error']} errors")
states.clear()
rng = random.Random(7)
small = [p for p in files if p.stat().st_size < 1_000_000]
for case in range(damaged):
    path = rng.choice(small)
    data = bytearray(path.read_bytes())
    with tempfile.TemporaryDirectory() as tmp:
        folder = Path(tmp) / "models"
        shutil.copytree(path.parent, folder, ignore=lambda at, names: [n for n in names if (Path(at) / n).is_dir() or (Path(at) / n).stat().st_size > 4_000_000])
        if rng.random() < 0.3:
            del data[rng.randrange(len(data) + 1):]
        for _ in range(rng.choice((1, 3, 20)) if data else 0):
            at = rng.randrange(min(len(data), rng.choice((200, len(data)))))
            data[at:at + 1] = rng.choice((bytes([rng.randrange(256)]), b"9", b"-", b"", b"99999999", b"\0", b"1e30"))
        (folder / path.name).write_bytes(data)
        scene(folder / path.name, f"case {case} of {path.relative_to(models)}")
print(f"{damaged} damaged files: {states['scene']} scenes, {states['error']} errors; at most {largest:.0f} MiB")
sys.exit(f"{len(failures)} failed (marked !)" if failures else 0)
