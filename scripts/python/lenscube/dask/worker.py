"""Code for a worker: one process of lenscube per unit, whose events and exit code are sent to the driver.

Sent by value (this module imports nothing of the package), as a plugin for all workers, including later ones. The process is
started by the thread of the task, which waits for it: with --die-with-parent the kernel kills it when that thread ends, so a
killed worker leaves no process running.
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

# Seconds between two progress events of a unit: 1000 workers send 500 events a second to the scheduler.
REPORT_EVERY_S = 2.0
# Bytes kept of the end of a process's stderr.
TAIL_BYTES = 2000


class Units(WorkerPlugin):
    """Executes units of one plan on a worker."""

    def __init__(self, name: str, plan: str, command: str, paths: list[str], flags: list[str], detach: bool = False):
        self.name, self.plan, self.command, self.paths, self.flags = name, plan, command, paths, flags
        self.detach = detach

    def setup(self, worker) -> None:
        if self.detach:  # a worker on the driver's machine: Ctrl-C in the terminal is sent only to the driver
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
        """Stops running units (tiles in flight are finished, shards kept) and starts no other."""
        with self.lock:
            self.stopping = True
            for child in self.children.values():
                child.send_signal(signal.SIGTERM)

    def send_event(self, event: str, unit: int, **more) -> None:
        fields = {"event": event, "unit": unit, "host": socket.gethostname(), "name": str(self.worker.name), **more}
        self.worker.log_event(self.name, fields)

    def execute(self, unit: int) -> dict:
        """Executes a unit. Returns `code` (None: the program did not start), `message`, and the fields of the last event."""
        with tempfile.TemporaryFile() as stderr:
            try:
                child = self.start(unit, stderr)
            except OSError as e:
                return self.end(unit, None, {"message": f"starting {self.command}: {e.strerror}"})
            if child is None:
                return self.end(unit, 130, {"message": "the driver was stopped"})
            last = self.follow(unit, child)
            code = child.wait()
            with self.lock:
                del self.children[child.pid]
            if code and "message" not in last:
                stderr.seek(max(0, stderr.seek(0, 2) - TAIL_BYTES))
                last["message"] = stderr.read().decode(errors="replace").strip()
            return self.end(unit, code, last)

    def start(self, unit: int, stderr) -> subprocess.Popen | None:
        argv = [self.command, "run", *self.paths, "--plan", str(self.file), "--unit", str(unit)]
        argv += ["--progress", "jsonl", "--die-with-parent", *self.flags]
        with self.lock:
            if self.stopping:
                return None
            # A separate session: Ctrl-C in a terminal is sent to the driver, which stops the units by SIGTERM.
            child = subprocess.Popen(argv, stdout=subprocess.PIPE, stderr=stderr, text=True, start_new_session=True)
            self.children[child.pid] = child
        self.send_event("start", unit, pid=child.pid)
        return child

    def follow(self, unit: int, child: subprocess.Popen) -> dict:
        """Sends events until the process closes its output; returns the last one."""
        sent, last = 0.0, {}
        for line in child.stdout:
            try:
                event = json.loads(line)
                kind = event["event"]
            except (ValueError, KeyError, TypeError):
                continue  # incomplete line of a killed process
            if kind in ("done", "error"):
                last = {k: event[k] for k in ("message", "pixels", "tiles", "shards", "wall_s") if k in event}
            elif kind == "progress" and time.monotonic() - sent >= REPORT_EVERY_S:
                sent = time.monotonic()
                self.send_event("progress", unit, tiles=event.get("tiles", 0), pixels=event.get("pixels", 0))
        return last

    def end(self, unit: int, code: int | None, last: dict) -> dict:
        ended = {"unit": unit, "code": code, "host": socket.gethostname(), "address": self.worker.address, **last}
        self.send_event("end", unit, code=code)
        return ended


def task(name: str):
    """The task of a drive. A closure, because Dask sends functions of modules by name."""

    def do_unit(unit: int) -> dict:
        return get_worker().plugins[name].execute(unit)

    return do_unit


async def stop_units(name: str, dask_worker=None) -> None:
    """Stops the units of a drive on one worker. Async, as required by Client.run with wait=False."""
    if name in dask_worker.plugins:
        dask_worker.plugins[name].stop()
