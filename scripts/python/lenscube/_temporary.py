"""Temporary folders, removed by the process that made them: a child of `os.fork` inherits the handlers that would remove them."""

import atexit
import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def folder(directory: str | os.PathLike[str] | None = None) -> Iterator[Path]:
    """A new folder in `directory` [default: TMPDIR or /tmp], removed at the end of the block."""
    path, process = _new(directory), os.getpid()
    try:
        yield path
    finally:
        _remove(path, process)


def folder_until_exit() -> Path:
    """A folder for results without a path, removed at the end of this process."""
    path = _new(None)
    atexit.register(_remove, path, os.getpid())
    return path


def _new(directory: str | os.PathLike[str] | None) -> Path:
    return Path(tempfile.mkdtemp(prefix="lenscube-", dir=directory))


def _remove(path: Path, process: int) -> None:
    if os.getpid() == process:
        shutil.rmtree(path, ignore_errors=True)
