"""What an executable for Linux requires: machine and glibc."""

import re

MACHINES = {0x3E: "x86_64", 0xB7: "aarch64"}


def machine(program: bytes) -> str:
    """The name of the machine in tags of wheels."""
    if program[:4] != b"\x7fELF":
        raise ValueError("not an executable for Linux")
    return MACHINES[int.from_bytes(program[18:20], "little")]


def glibc(program: bytes) -> int | None:
    """The minor version of glibc 2 that an executable requires: the highest among its versioned symbols; None: it is static."""
    return max((int(minor) for minor in re.findall(rb"\0GLIBC_2\.(\d+)(?=[.\0])", program)), default=None)


def platform_tag(*files: bytes) -> str:
    """The platform tag of a wheel with these files (PEP 600). manylinux_2_17 is manylinux2014."""
    (name,) = {machine(file) for file in files}
    return f"manylinux_2_{max([17, *(glibc(file) or 17 for file in files)])}_{name}"
