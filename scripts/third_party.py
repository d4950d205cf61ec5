"""Licences and the bill of materials of a release, from `cargo metadata`.

    python3 scripts/third_party.py FOLDER

Writes THIRD-PARTY-LICENCES.txt, the licence texts of everything that the program contains, and lenscube.cdx.json, its packages (CycloneDX 1.5).
A package without a licence text in its sources is listed with its licence and repository.
"""
import hashlib
import json
import subprocess
import sys
import tomllib
import uuid
from pathlib import Path

from check_dependencies import ROOT, packages

# Beside the Rust packages: the viewer's page contains OpenSeadragon, and blosc-src contains c-blosc without its licence.
OTHERS = [
    ("OpenSeadragon", "BSD-3-Clause", ROOT / "src/commands/view/page/openseadragon.LICENSE.txt"),
    ("c-blosc", "BSD-3-Clause", ROOT / "scripts/licences/c-blosc.txt"),
]
NAMES = ("license", "licence", "copying", "notice", "unlicense")


def texts(package):
    """Licence files of a package's sources and of the libraries that it contains."""
    folder = Path(package["manifest_path"]).parent
    found = [p for depth in ("*", "*/*", "*/*/*") for p in folder.glob(depth) if p.is_file() and p.name.lower().startswith(NAMES)]
    # Sources that are named after a licence are none.
    return sorted(p for p in found if p.suffix.lower() in ("", ".txt", ".md", ".mit", ".apache", ".bsd", ".zlib", ".boost"))


def licences(found):
    """The text of THIRD-PARTY-LICENCES.txt: each text once, after the packages that have it."""
    by_text, without = {}, []
    for p in sorted(found.values(), key=lambda p: (p["name"], p["version"])):
        name = f"{p['name']} {p['version']} ({p['license']})"
        files = texts(p)
        if not files:
            without.append(f"{name}, {p['repository'] or 'https://crates.io/crates/' + p['name']}")
        for file in files:
            by_text.setdefault(file.read_text(errors="replace").strip(), []).append(name)
    for name, licence, path in OTHERS:
        by_text.setdefault(path.read_text().strip(), []).append(f"{name} ({licence})")
    parts = [f"lenscube contains the following software.\n\nWithout a licence text in their sources:\n\n{chr(10).join(without)}"]
    for text, names in sorted(by_text.items(), key=lambda item: item[1]):
        parts.append("\n".join(dict.fromkeys(names)) + "\n\n" + text)
    return f"\n\n{'-' * 100}\n\n".join(parts) + "\n"


def bill(found, version):
    """CycloneDX 1.5: the packages with their licences and digests."""
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    digests = {(p["name"], p["version"]): p.get("checksum") for p in lock}

    def component(p):
        purl = f"pkg:cargo/{p['name']}@{p['version']}"
        digest = digests[p["name"], p["version"]]
        hashes = {"hashes": [{"alg": "SHA-256", "content": digest}]} if digest else {}
        expression = (p["license"] or "").replace("/", " OR ")
        return {"type": "library", "bom-ref": purl, "name": p["name"], "version": p["version"], "purl": purl, "licenses": [{"expression": expression}], **hashes}

    components = [component(p) for p in sorted(found.values(), key=lambda p: (p["name"], p["version"]))]
    components += [{"type": "library", "bom-ref": name, "name": name, "licenses": [{"expression": licence}]} for name, licence, _ in OTHERS]
    time = subprocess.run(["git", "log", "-1", "--format=%cI"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    serial = uuid.UUID(hashlib.sha256(json.dumps(components).encode()).hexdigest()[:32], version=4)
    program = {"type": "application", "bom-ref": "lenscube", "name": "lenscube", "version": version, "licenses": [{"expression": "MIT OR Apache-2.0"}]}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{serial}",
        "version": 1,
        "metadata": {**({"timestamp": time} if time else {}), "component": program},
        "components": components,
        "dependencies": [{"ref": "lenscube", "dependsOn": [c["bom-ref"] for c in components]}],
    }


def main(folder):
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    found = packages()
    (folder / "THIRD-PARTY-LICENCES.txt").write_text(licences(found))
    (folder / "lenscube.cdx.json").write_text(json.dumps(bill(found, version), indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
