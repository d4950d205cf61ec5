"""What the build of the wheel derives from the program: its platform, the types of the keywords."""

import ast
import importlib.metadata
import sys
from pathlib import Path

import pytest

import lenscube
from lenscube._program import description

sys.path.insert(0, str(Path(__file__).parent.parent))
import elf  # noqa: E402
import flags_stub  # noqa: E402


def executable(machine: int, symbols: bytes) -> bytes:
    return b"\x7fELF".ljust(18, b"\0") + machine.to_bytes(2, "little") + symbols


def test_platform_is_the_oldest_that_the_program_runs_on():
    assert elf.platform_tag(executable(0x3E, b"\0GLIBC_2.2.5\0GLIBC_2.28\0GLIBC_2.17\0")) == "manylinux_2_28_x86_64"
    assert elf.platform_tag(executable(0xB7, b"\0GLIBC_2.4\0")) == "manylinux_2_17_aarch64"
    assert elf.platform_tag(executable(0x3E, b"no such symbols")) == "manylinux_2_17_x86_64"
    both = executable(0x3E, b"\0GLIBC_2.28\0"), executable(0x3E, b"\0GLIBC_2.34\0")
    assert elf.platform_tag(*both) == "manylinux_2_34_x86_64"
    with pytest.raises(ValueError):
        elf.machine(b"\xcf\xfa\xed\xfe")


def test_types_of_the_keywords_are_those_of_the_program():
    text = flags_stub.stub(description())
    classes = {c.name: c for c in ast.parse(text).body if isinstance(c, ast.ClassDef)}
    fields = {f.target.id: ast.unparse(f.annotation) for f in classes["Run"].body if isinstance(f, ast.AnnAssign)}
    assert set(fields) == set(lenscube.flags("run")) - flags_stub.OWN
    assert fields["overwrite"] == "bool" and fields["interp"] == "Literal['bicubic', 'bilinear'] | None"
    assert "LensShow" in classes and "ChartImage" in classes


def test_package_and_program_have_one_version():
    try:
        version = importlib.metadata.version("lenscube")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package is not installed")
    assert version == description()["version"]
