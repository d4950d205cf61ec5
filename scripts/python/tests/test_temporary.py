"""Temporary folders of a process that forks."""

import json
import multiprocessing
import subprocess
import sys

from conftest import FLAGS
from lenscube import _temporary

FORKED = """
import json, os, sys
import lenscube
from lenscube import _temporary
film = lenscube.run("gen:points?size=64&wavelengths=550", **json.loads(sys.argv[1]))
before = float(film.film.sum())
with _temporary.folder() as folder:
    if os.fork() == 0:
        sys.exit(0)
    os.wait()
    assert folder.exists(), "the folder of a call"
assert not folder.exists()
print(before == float(lenscube.open(film.encoding["source"].removeprefix("file://")).film.sum()))
"""


def test_the_child_of_a_fork_removes_nothing_of_its_parent():
    line = [sys.executable, "-W", "ignore", "-c", FORKED, json.dumps(FLAGS)]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.stdout == "True\n", done.stderr


def _leave():
    sys.exit(0)


def test_a_forked_worker_removes_nothing_of_its_parent():
    folder = _temporary.folder_until_exit()
    worker = multiprocessing.get_context("fork").Process(target=_leave)
    worker.start()
    worker.join()
    assert worker.exitcode == 0 and folder.exists()
