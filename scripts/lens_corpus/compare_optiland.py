#!/usr/bin/env python3
"""Focal lengths of the .zmx files of a folder by lenscube and by Optiland, at the primary wavelength; prints those that differ by more than 1e-4.

    python3 -m venv v && v/bin/pip install optiland==0.6.3 && v/bin/python scripts/lens_corpus/compare_optiland.py FOLDER [PROGRAM]

Not each difference is a fault: Optiland takes the first glass of a name in its database, skips surface types that it does not know, and has no model
glasses of old files. The notes of lenscube stand beside each difference.
"""

import json
import subprocess
import sys
import warnings
from pathlib import Path

warnings.filterwarnings("ignore")
from optiland.fileio import load_zemax_file  # noqa: E402


def main():
    folder, program = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "target/release/lenscube"
    both, agree, only = 0, 0, 0
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() == ".zmx"):
        done = subprocess.run([program, "lens", "show", "--json", str(path)], capture_output=True, text=True, errors="replace")
        if done.returncode != 0:
            continue
        shown = json.loads(done.stdout)
        efl = shown["design"]["effective_focal_length_mm"]
        try:
            optic = load_zemax_file(str(path))
            other = float(optic.paraxial.f2())
        except Exception as error:  # any failure of the other program
            only += 1
            print(f"only lenscube: {path.name}: {type(error).__name__}: {str(error)[:100]}")
            continue
        both += 1
        if efl is not None and abs(abs(other) - abs(efl)) <= 1e-4 * abs(efl):
            agree += 1
        else:
            print(f"{path.name}: {efl} against Optiland's {other}: {shown.get('notes')}")
    print(f"{both} read by both, {agree} agree to 1e-4; {only} by lenscube only")


if __name__ == "__main__":
    main()
