"""Build hook of the wheel: puts the program into it, names the platform that the program needs, and generates the types of the flags.

LENSCUBE_BINARY: a program that is built already; without it Cargo builds one. LENSCUBE_HOST_BINARY: the same version for this machine,
which describes the flags, if LENSCUBE_BINARY is for another one.
"""

import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))
from flags_stub import stub  # noqa: E402

MACHINES = {0x3E: "x86_64", 0xB7: "aarch64"}


def glibc(program: bytes) -> int | None:
    """The minor version of glibc 2 that an executable requires: the highest among its versioned symbols; None: it is static."""
    return max((int(minor) for minor in re.findall(rb"GLIBC_2\.(\d+)\b", program)), default=None)


def platform_tag(program: bytes) -> str:
    """The platform tag of the wheel (PEP 600). A static program runs on all; manylinux_2_17 is manylinux2014."""
    if program[:4] != b"\x7fELF":
        return f"{platform.system().lower()}_{platform.machine()}"
    machine = MACHINES[int.from_bytes(program[18:20], "little")]
    minor = glibc(program)
    # The oldest tags that pip knows, of glibc and of musl.
    return f"manylinux_2_5_{machine}.musllinux_1_1_{machine}" if minor is None else f"manylinux_2_{max(minor, 5)}_{machine}"


class WheelHook(BuildHookInterface):
    """Called by hatchling."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        program = Path(os.environ.get("LENSCUBE_BINARY") or self.build())
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform_tag(program.read_bytes())}"
        build_data["shared_scripts"][str(program)] = "lenscube"
        listing = subprocess.run([os.environ.get("LENSCUBE_HOST_BINARY") or program, "man", "--json"], capture_output=True, check=True)
        self.folder = tempfile.TemporaryDirectory()
        types = Path(self.folder.name) / "_flags.pyi"
        types.write_text(stub(json.loads(listing.stdout)))
        build_data["force_include"][str(types)] = "lenscube/_flags.pyi"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        self.folder.cleanup()

    def build(self) -> Path:
        """The program, built by Cargo from the sources around this folder."""
        root = Path(self.root).parent.parent
        command = ["cargo", "build", "--release", "--bin", "lenscube", "--message-format=json"]
        done = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, check=True)
        messages = map(json.loads, done.stdout.splitlines())
        return Path(next(m["executable"] for m in messages if m.get("executable")))
