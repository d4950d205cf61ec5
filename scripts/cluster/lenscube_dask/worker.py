"""What runs on a worker: one process of lenscube for each unit, its events passed on, its end told.

Sent by value (this module imports nothing of the package), as a plugin that every worker gets, later ones too. The process
is started from the task's own thread, which waits for it: with --die-with-parent the kernel kills it when that thread
ends, so a worker that is killed leaves nothing behind.
"""

import json
import os
import signal
import socket
import subprocess
import tempfile
import threading
import time
from pathlib import Path

from distributed import WorkerPlugin, get_worker

# Seconds between two reports of one unit's progress: with 1000 workers the scheduler passes 500 on a second.
REPORT_EVERY_S = 2.0
# What is kept of a process's words.
TAIL_BYTES = 2000


class Units(WorkerPlugin):
    """Does units of one plan on a worker."""

    def __init__(self, name: str, plan: str, command: str, paths: list[str], flags: list[str], detach: bool = False):
        self.name, self.plan, self.command, self.paths, self.flags = name, plan, command, paths, flags
        self.detach = detach

    def setup(self, worker) -> None:
        if self.detach:  # a worker of the driver's own machine: Ctrl-C at its terminal goes to the driver alone
            os.setpgid(0, 0)
        self.worker = worker
        self.children: dict[int, subprocess.Popen] = {}
        self.lock, self.stopping = threading.Lock(), False
        self.file = Path(worker.local_directory) / f"{self.name}.json"
        self.file.write_text(self.plan)

    def teardown(self, worker) -> None:
        self.stop()
        self.file.unlink(missing_ok=True)

    def stop(self) -> None:
        """Ends what runs (tiles in flight are finished, shards kept) and starts nothing more."""
        with self.lock:
            self.stopping = True
            for child in self.children.values():
                child.send_signal(signal.SIGTERM)

    def tell(self, event: str, unit: int, **more) -> None:
        told = {"event": event, "unit": unit, "host": socket.gethostname(), "name": str(self.worker.name), **more}
        self.worker.log_event(self.name, told)

    def do(self, unit: int) -> dict:
        """Runs a unit to its end: `code` (None: the program did not start), `message`, and what the last event said."""
        with tempfile.TemporaryFile() as words:
            try:
                child = self.start(unit, words)
            except OSError as e:
                return self.end(unit, None, {"message": f"starting {self.command}: {e.strerror}"})
            if child is None:
                return self.end(unit, 130, {"message": "the driver was stopped"})
            last = self.follow(unit, child)
            code = child.wait()
            with self.lock:
                del self.children[child.pid]
            if code and "message" not in last:
                words.seek(max(0, words.seek(0, 2) - TAIL_BYTES))
                last["message"] = words.read().decode(errors="replace").strip()
            return self.end(unit, code, last)

    def start(self, unit: int, words) -> subprocess.Popen | None:
        argv = [self.command, "run", *self.paths, "--plan", str(self.file), "--unit", str(unit)]
        argv += ["--progress", "jsonl", "--die-with-parent", *self.flags]
        with self.lock:
            if self.stopping:
                return None
            # Its own session: Ctrl-C at a terminal goes to the driver, who stops the units in good order.
            child = subprocess.Popen(argv, stdout=subprocess.PIPE, stderr=words, text=True, start_new_session=True)
            self.children[child.pid] = child
        self.tell("start", unit, pid=child.pid)
        return child

    def follow(self, unit: int, child: subprocess.Popen) -> dict:
        """Passes events on until the process closes its output; gives the last one."""
        told, last = 0.0, {}
        for line in child.stdout:
            try:
                event = json.loads(line)
                kind = event["event"]
            except (ValueError, KeyError, TypeError):
                continue  # the half line of a killed process
            if kind in ("done", "error"):
                last = {k: event[k] for k in ("message", "pixels", "tiles", "shards", "wall_s") if k in event}
            elif kind == "progress" and time.monotonic() - told >= REPORT_EVERY_S:
                told = time.monotonic()
                self.tell("progress", unit, tiles=event.get("tiles", 0), pixels=event.get("pixels", 0))
        return last

    def end(self, unit: int, code: int | None, last: dict) -> dict:
        ended = {"unit": unit, "code": code, "host": socket.gethostname(), "address": self.worker.address, **last}
        self.tell("end", unit, code=code)
        return ended


def task(name: str):
    """The task of a drive. A closure, because Dask sends the functions of modules by name, whatever is registered."""

    def do_unit(unit: int) -> dict:
        return get_worker().plugins[name].do(unit)

    return do_unit


async def stop_units(name: str, dask_worker=None) -> None:
    """Ends the units of a drive on one worker. Async, as Dask asks of what it does not wait for."""
    if name in dask_worker.plugins:
        dask_worker.plugins[name].stop()
