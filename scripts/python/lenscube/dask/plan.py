"""The plan: its units, and the missing ones as reported by `lenscube status`."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path


class Failure(Exception):
    """Error of the driver: a message and an exit code (those of lenscube)."""

    def __init__(self, message: str, code: int = 1):
        super().__init__(message)
        self.code = code


def parse_units(text: str) -> list[int]:
    """`3,7-9` (ends included) as [3, 7, 8, 9]."""
    units: list[int] = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        first, _, last = part.partition("-")
        if not first.isdigit() or (last and not last.isdigit()) or part.endswith("-"):
            raise ValueError(f"a list of units must have the form 3,7-9; found {part!r}")
        units += range(int(first), int(last or first) + 1)
    return units


def format_units(units: list[int]) -> str:
    """[3, 7, 8, 9] as `3,7-9`."""
    runs: list[list[int]] = []
    for unit in sorted(units):
        if runs and unit == runs[-1][1] + 1:
            runs[-1][1] = unit
        else:
            runs.append([unit, unit])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in runs)


@dataclass(frozen=True)
class Plan:
    """A plan read from its file. `text` is sent to the workers, which need no access to the file."""

    path: Path
    text: str
    digest: str
    film: str
    tiles: list[int]

    @classmethod
    def read(cls, path: Path) -> "Plan":
        try:
            text = path.read_text()
            plan = json.loads(text)
            digest, film, tiles = plan["digest"], plan["command"]["film"], [u["tiles"] for u in plan["units"]]
        except OSError as e:
            raise Failure(f"reading the plan {path}: {e.strerror}", 2) from e
        except (ValueError, KeyError, TypeError) as e:
            raise Failure(f"{path} is not a plan (make one with `lenscube plan CHART FILM -o {path}`): {e!r}", 2) from e
        return cls(path, text, digest, film, tiles)

    def missing(self, lenscube: str, paths: list[str]) -> list[int]:
        """The units that are not complete; `paths`: chart and film on this machine, if not those of the plan."""
        command = [lenscube, "status", *paths[1:], "--plan", str(self.path), "--missing"]
        try:
            process = subprocess.run(command, capture_output=True, text=True)
        except OSError as e:
            raise Failure(f"starting {lenscube}: {e.strerror} (give its path by --lenscube)", 2) from e
        if process.returncode:
            raise Failure(f"{' '.join(command)}: exit code {process.returncode}\n{process.stderr.strip()}", process.returncode)
        return parse_units(process.stdout)
