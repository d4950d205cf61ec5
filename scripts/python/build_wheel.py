"""Build hook of the wheel: puts the program and the module `lenscube._native` into it, names the platform that they need, and generates the types of
the flags.

LENSCUBE_BINARY and LENSCUBE_NATIVE: a program and a library of the module that are built already; without them Cargo builds both. LENSCUBE_HOST_BINARY: the same version for this machine,
which describes the flags, if LENSCUBE_BINARY is for another one. LENSCUBE_LICENCES: the licences of what the program contains.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))
from elf import platform_tag  # noqa: E402
from flags_stub import stub  # noqa: E402


class WheelHook(BuildHookInterface):
    """Called by hatchling."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        given = [os.environ.get(name) for name in ("LENSCUBE_BINARY", "LENSCUBE_NATIVE")]
        if any(given) and not all(given):
            raise ValueError("LENSCUBE_BINARY and LENSCUBE_NATIVE: expected both or none")
        program, native = map(Path, given if all(given) else self.build())
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{platform_tag(program.read_bytes(), native.read_bytes())}"
        build_data["shared_scripts"][str(program)] = "lenscube"
        build_data["force_include"][str(native)] = "lenscube/_native.abi3.so"
        listing = subprocess.run([os.environ.get("LENSCUBE_HOST_BINARY") or program, "man", "--json"], stdout=subprocess.PIPE, check=True).stdout
        self.folder = tempfile.TemporaryDirectory()
        for name, text in (("_flags.pyi", stub(json.loads(listing))), ("commands.json", listing.decode())):
            path = Path(self.folder.name) / name
            path.write_text(text)
            build_data["force_include"][str(path)] = f"lenscube/{name}"
        if licences := os.environ.get("LENSCUBE_LICENCES"):
            build_data["extra_metadata"][licences] = "THIRD-PARTY-LICENCES.txt"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        self.folder.cleanup()

    def build(self) -> tuple[str, str]:
        """The program and the library of the module, built by Cargo from the sources around this folder."""
        root = Path(self.root).parent.parent
        packages = ["--package", "lenscube", "--package", "lenscube-python"]
        command = ["cargo", "build", "--release", "--all-features", *packages, "--message-format=json"]
        done = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, check=True)
        messages = [json.loads(line) for line in done.stdout.splitlines()]
        program = next(m["executable"] for m in messages if m.get("executable") and m["target"]["name"] == "lenscube")
        native = next(m["filenames"] for m in messages if m.get("target", {}).get("name") == "lenscube_native")
        return program, next(name for name in native if name.endswith(".so"))
