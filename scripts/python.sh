# Sourced by checks that use Python packages, from the project's root.
# shellcheck shell=bash

# Packages with which the golden data were written.
GOLDEN_PINS=(numpy==2.4.6 zarr==3.1.5 numcodecs==0.16.6)
# Packages that trace lenses as built, and read their packs.
OPTILAND_PINS=(numpy==2.4.6 zarr==3.1.5 numcodecs==0.16.6 scipy==1.17.1 optiland==0.6.3)
# Packages that write charts and read films and exports, and those of the Python package, which the documents' commands use, with plots.
INTEROP_PINS=(numpy==2.4.6 zarr==3.1.5 xarray==2026.9.0 tensorstore==0.1.86 OpenEXR==3.5.3 rawpy==0.28.0 tifffile==2026.3.3 spectral==0.25
    h5py==3.16.0 h5netcdf==1.8.2 hdf5storage==0.2.2 scipy==1.17.1 rasterio==1.4.4 pillow==13.0.0 pandas==3.1.1
    tqdm==4.70.1 matplotlib==3.11.2 imagecodecs==2026.3.6)

# python_with NAME PIN...: sets `python` to an interpreter with these packages, in an environment under target/ that is created once.
# Without Python, or if pip fails, it returns 1 and sets `python_lacks` to the reason.
python_with() {
    local place=target/$1-venv
    shift
    python_lacks="python3 is missing or older than 3.11"
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || return 1
    python_lacks="pip cannot install $*"
    if [ "$(cat "$place/pins" 2>/dev/null)" != "$*" ]; then
        rm -rf "$place"
        mkdir -p target
        if python3 -m venv "$place" 2>/dev/null; then
            "$place/bin/python" -m pip install --quiet --disable-pip-version-check "$@" || return 1
        else # no ensurepip, as on a bare Debian
            rm -rf "$place"
            python3 -m pip install --quiet --disable-pip-version-check --target "$place/site" "$@" || return 1
        fi
        echo "$*" >"$place/pins"
    fi
    python=$place/bin/python
    unset PYTHONPATH
    if [ -d "$place/site" ]; then
        python=python3
        export PYTHONPATH=$PWD/$place/site
    fi
}

# Sets LENSCUBE, unless it is set, to the binary that `cargo test` builds; beside it lies the library of the Python package's native module.
built_lenscube() {
    # With a test the packages have the features of `cargo test`; without, all that depends on them would be built a second time.
    if [ -z "${LENSCUBE:-}" ]; then cargo build --quiet --workspace --all-features --lib --bins --test golden; fi
    LENSCUBE=${LENSCUBE:-$(cargo test --quiet --workspace --all-features --test golden --no-run --message-format=json | python3 -c '
import json, sys
artifacts = [json.loads(line) for line in sys.stdin if line.startswith("{")]
print(next(a["executable"] for a in artifacts if a.get("target", {}).get("kind") == ["bin"] and a.get("executable") and not a["profile"]["test"]))')}
}
