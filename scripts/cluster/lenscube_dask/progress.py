"""What is shown while units are done: one line that is rewritten on a terminal, a line every ten seconds elsewhere."""

import json
import sys
import threading
import time
from typing import IO

LINE_EVERY_S = 10.0


def clock(seconds: float) -> str:
    if not 0 <= seconds < 1e8:
        return "?"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02} min"


class Display:
    """Counts units, tiles and pixels as their events come (in any thread), and shows them."""

    def __init__(self, tiles: list[int], todo: list[int], log: IO[str] | None = None, out: IO[str] | None = None):
        self.tiles, self.all, self.log, self.out = tiles, len(tiles), log, out or sys.stderr
        self.total = sum(tiles[unit] for unit in todo)
        self.done_units, self.done_tiles, self.pixels = self.all - len(todo), 0, 0
        self.at_work: dict[int, dict] = {}
        self.lock = threading.RLock()
        self.begin: float | None = None
        self.shown = time.monotonic()
        self.bar = self.out.isatty()

    def event(self, told: dict) -> None:
        """Something happened on a worker: a unit's start, progress or end."""
        with self.lock:
            self.note(**told)
            unit = told["unit"]
            if told["event"] == "end":
                self.at_work.pop(unit, None)
                return
            self.begin = self.begin or time.monotonic()
            if told["event"] == "start":  # a worker of this name that was lost did not tell its end
                self.at_work = {n: e for n, e in self.at_work.items() if e["name"] != told["name"]}
            self.at_work[unit] = told

    def done(self, unit: int, pixels: int) -> None:
        with self.lock:
            self.at_work.pop(unit, None)
            self.done_units, self.done_tiles = self.done_units + 1, self.done_tiles + self.tiles[unit]
            self.pixels += pixels

    def note(self, **what) -> None:
        """Into the log, a line of JSON each."""
        if self.log:
            with self.lock:
                self.log.write(json.dumps({"time": round(time.time(), 3), **what}) + "\n")
                self.log.flush()

    def say(self, words: str) -> None:
        with self.lock:
            self.out.write(("\r\033[K" if self.bar else "") + words + "\n")
            self.out.flush()

    def line(self) -> str:
        with self.lock:
            seconds = time.monotonic() - self.begin if self.begin else 0.0
            running = [e for e in self.at_work.values() if e["event"] == "progress"]
            tiles = self.done_tiles + sum(e["tiles"] for e in running)
            pixels = self.pixels + sum(e["pixels"] for e in running)
            share = min(tiles / self.total, 1.0) if self.total else 1.0
            left = clock(seconds * (1 - share) / share) if share else "?"
            rate = pixels / seconds * 1e-6 if seconds else 0.0
            hosts = len({e["host"] for e in self.at_work.values()})
            work = f"{len(self.at_work)} at work on {hosts} host{'s' * (hosts != 1)}" if self.begin else "waiting for workers"
            bar = f"[{'=' * int(24 * share):<24}] " if self.bar else ""
            return f"{bar}{self.done_units} of {self.all} units, {100 * share:.0f} %, {rate:.1f} Mpx/s, {work}, {left} left"

    def show(self) -> None:
        """Shows the line if it is time to."""
        with self.lock:
            now = time.monotonic()
            if now - self.shown < (0.2 if self.bar else LINE_EVERY_S):
                return
            self.shown = now
            self.out.write(f"\r\033[K{self.line()}" if self.bar else self.line() + "\n")
            self.out.flush()

    def finish(self) -> None:
        if self.bar:
            self.out.write("\r\033[K")
            self.out.flush()
