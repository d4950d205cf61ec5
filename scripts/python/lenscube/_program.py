"""The program `lenscube`: where it is, and what it says of its commands."""

import functools
import json
import os
import shutil
import subprocess
import sysconfig
from pathlib import Path
from typing import Any


def path() -> str:
    """Path of the program: that of the environment variable LENSCUBE, else of this package, else of PATH."""
    if given := os.environ.get("LENSCUBE"):
        return given
    package = Path(__file__).resolve().parent
    user = sysconfig.get_preferred_scheme("user")
    # Environment, `pip install --target`, `pip install --prefix`, `pip install --user`.
    folders = [Path(sysconfig.get_path("scripts")), package.parent / "bin", Path(sysconfig.get_path("scripts", user))]
    folders += [p / "bin" for p in package.parents if p.name == "lib" for p in [p.parent]]
    for folder in folders:
        if (found := folder / "lenscube").is_file() and os.access(found, os.X_OK):
            return str(found)
    if on_path := shutil.which("lenscube"):
        return on_path
    raise FileNotFoundError("the program lenscube is neither in this environment nor on PATH; the variable LENSCUBE gives its path")


@functools.cache
def _described(program: str, _modified_ns: int) -> dict[str, Any]:
    done = subprocess.run([program, "man", "--json"], capture_output=True, check=False, stdin=subprocess.DEVNULL)
    if done.returncode != 0:
        raise RuntimeError(f"{program} is another version than this package: {done.stderr.decode(errors='replace').strip()}")
    return json.loads(done.stdout)


def description() -> dict[str, Any]:
    """Commands, arguments and exit codes, as `lenscube man --json` prints them."""
    program = path()
    return _described(program, os.stat(program).st_mtime_ns)


def described_command(words: tuple[str, ...]) -> dict[str, Any]:
    """The description of a command, e.g. ("lens", "show")."""
    found: dict[str, Any] = {"commands": description()["commands"]}
    for word in words:
        names = {c["name"]: c for c in found["commands"]}
        if word not in names:
            raise TypeError(f"lenscube has no command {' '.join(words)}; commands: {', '.join(names)}")
        found = names[word]
    return found
