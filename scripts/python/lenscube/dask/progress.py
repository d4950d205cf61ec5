"""Progress display: one line that is rewritten on a terminal, else a line every ten seconds."""

import json
import sys
import threading
import time
from typing import IO

LINE_EVERY_S = 10.0


def clock(seconds: float) -> str:
    if not 0 <= seconds < 1e8:
        return "?"
    rounded = round(seconds)
    if rounded < 60:
        return f"{rounded} s"
    if rounded < 3600:
        return f"{rounded // 60} min {rounded % 60:02} s"
    return f"{rounded // 3600} h {rounded % 3600 // 60:02} min"


class Display:
    """Counts units, tiles and pixels from their events (in any thread), and prints them."""

    def __init__(self, tiles: list[int], todo: list[int], log: IO[str] | None = None, out: IO[str] | None = None):
        self.tiles, self.all, self.log, self.out = tiles, len(tiles), log, out or sys.stderr
        self.total = sum(tiles[unit] for unit in todo)
        self.done_units, self.done_tiles, self.pixels = self.all - len(todo), 0, 0
        self.running: dict[int, dict] = {}
        self.lock = threading.RLock()
        self.begin: float | None = None
        self.last_shown = time.monotonic()
        self.bar = self.out.isatty()

    def event(self, event: dict) -> None:
        """Start, progress or end of a unit on a worker."""
        with self.lock:
            self.note(**event)
            unit = event["unit"]
            if event["event"] == "end":
                self.running.pop(unit, None)
                return
            self.begin = self.begin or time.monotonic()
            if event["event"] == "start":  # a lost worker of this name sent no end
                self.running = {n: e for n, e in self.running.items() if e["name"] != event["name"]}
            self.running[unit] = event

    def done(self, unit: int, pixels: int) -> None:
        with self.lock:
            self.running.pop(unit, None)
            self.done_units, self.done_tiles = self.done_units + 1, self.done_tiles + self.tiles[unit]
            self.pixels += pixels

    def note(self, **event) -> None:
        """Appends an event to the log, as a line of JSON."""
        if self.log:
            with self.lock:
                self.log.write(json.dumps({"time": round(time.time(), 3), **event}) + "\n")
                self.log.flush()

    def print_line(self, text: str) -> None:
        with self.lock:
            self.out.write(("\r\033[K" if self.bar else "") + text + "\n")
            self.out.flush()

    def line(self) -> str:
        with self.lock:
            seconds = time.monotonic() - self.begin if self.begin else 0.0
            progress = [e for e in self.running.values() if e["event"] == "progress"]
            tiles = self.done_tiles + sum(e["tiles"] for e in progress)
            pixels = self.pixels + sum(e["pixels"] for e in progress)
            share = min(tiles / self.total, 1.0) if self.total else 1.0
            left = clock(seconds * (1 - share) / share) if share else "?"
            rate = pixels / seconds * 1e-6 if seconds else 0.0
            hosts = len({e["host"] for e in self.running.values()})
            work = f"{len(self.running)} running on {hosts} host{'s' * (hosts != 1)}" if self.begin else "waiting for workers"
            bar = f"[{'=' * int(24 * share):<24}] " if self.bar else ""
            return f"{bar}{self.done_units} of {self.all} units, {100 * share:.0f} %, {rate:.1f} Mpx/s, {work}, {left} left"

    def show(self) -> None:
        """Prints the progress line if it is due."""
        with self.lock:
            now = time.monotonic()
            if now - self.last_shown < (0.2 if self.bar else LINE_EVERY_S):
                return
            self.last_shown = now
            self.out.write(f"\r\033[K{self.line()}" if self.bar else self.line() + "\n")
            self.out.flush()

    def finish(self) -> None:
        if self.bar:
            self.out.write("\r\033[K")
            self.out.flush()
