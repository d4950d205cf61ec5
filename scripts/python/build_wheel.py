"""Build hook of the wheel: puts the program into it, names the platform that the program needs, and generates the types of the flags.

LENSCUBE_BINARY: a program that is built already; without it Cargo builds one. LENSCUBE_HOST_BINARY: the same version for this machine,
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
        program = Path(os.environ.get("LENSCUBE_BINARY") or self.build())
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform_tag(program.read_bytes())}"
        build_data["shared_scripts"][str(program)] = "lenscube"
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

    def build(self) -> Path:
        """The program, built by Cargo from the sources around this folder."""
        root = Path(self.root).parent.parent
        command = ["cargo", "build", "--release", "--all-features", "--bin", "lenscube", "--message-format=json"]
        done = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, check=True)
        messages = map(json.loads, done.stdout.splitlines())
        return Path(next(m["executable"] for m in messages if m.get("executable")))
