"""Fixtures: plans for fake_lenscube.py."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent.parent / "python"))
FAKE = str(Path(__file__).with_name("fake_lenscube.py"))


class Job:
    """A plan of `units` units in a folder, and the record of their execution."""

    def __init__(self, place: Path, units: int, fake: dict | None = None):
        self.film, self.plan = place / "film", place / "job.json"
        (self.film / "done").mkdir(parents=True)
        command = {"chart": "gen:none", "film": str(self.film), "flags": []}
        plan = {"digest": "0123456789abcdef" * 4, "command": command, "fake": fake or {}}
        plan["units"] = [{"unit": n, "tiles": 10} for n in range(units)]
        self.plan.write_text(json.dumps(plan))

    def tries(self, unit: int) -> int:
        path = self.film / "tries"
        return path.read_text().split().count(str(unit)) if path.exists() else 0

    def done(self) -> int:
        return len(list((self.film / "done").iterdir()))


@pytest.fixture
def job(tmp_path):
    return lambda units, fake=None: Job(tmp_path, units, fake)


@pytest.fixture
def fake() -> str:
    return FAKE
