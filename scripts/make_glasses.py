#!/usr/bin/env python3
"""Makes pipeline/data/glasses.csv and glass-equivalents.csv from the tables that pipeline/data/SOURCES.md describes.

    scripts/make_glasses.py FOLDER     a folder with catalogue.csv, tabulated-fits.csv and equivalents.csv

Left out: rows without a formula that pipeline/src/design/prescription/glass.rs has, and aliases that follow from vendor and name.
"""

import csv
import pathlib
import sys

# Formulas of the AGF format by number, and two of the refractiveindex.info database.
CAUCHY, SELLMEIER_WITH_CONSTANT = 14, 15
OWN = {"rii-5": CAUCHY, "rii-1": SELLMEIER_WITH_CONSTANT}


def rows(folder, name):
    with open(folder / name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def derived(vendor, name):
    """Aliases that the reader makes itself."""
    plain = name.replace("-", "")
    return {f"{vendor}_{name}", f"{name}_{vendor}", f"{plain}_{vendor}", f"{vendor}_{plain}"}


def main():
    folder, out = pathlib.Path(sys.argv[1]), pathlib.Path(__file__).resolve().parent.parent / "pipeline/data"
    fits = {(r["vendor"], r["name"]): r for r in rows(folder, "tabulated-fits.csv")}
    known, left_out = set(), []
    with open(out / "glasses.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["vendor", "name", "aliases", "formula", "coefficients", "min_um", "max_um", "status"])
        for row in rows(folder, "catalogue.csv"):
            key = row["vendor"], row["name"]
            source = fits.get(key, row)
            formula = source["agf_formula"] or OWN.get(source["formula"])
            if not formula:
                left_out.append("/".join(key))
                continue
            aliases = [a for a in row["aliases"].split(";") if a and a not in derived(*key)]
            fitted = "fitted" if key in fits else row["status"]
            table.writerow([*key, ";".join(aliases), formula, source["coefficients"], source["min_um"], source["max_um"], fitted])
            known.add(key)
    with open(out / "glass-equivalents.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["old_vendor", "old_name", "vendor", "name", "relation", "old_nd", "old_vd", "delta_nd", "delta_vd"])
        for row in rows(folder, "equivalents.csv"):
            if row["name"] and (row["vendor"], row["name"]) not in known:
                left_out.append("/".join((row["old_vendor"], row["old_name"])))
                continue
            relation = row["relation"].split(":")[0].split(" (")[0].split(",")[0]
            columns = ("old_vendor", "old_name", "vendor", "name")
            table.writerow([*(row[c] for c in columns), relation, *(row[c] for c in ("old_nd", "old_vd", "delta_nd", "delta_vd"))])
    print(len(known), "glasses; left out:", ", ".join(left_out))


if __name__ == "__main__":
    main()
