"""Units in flight: as many as keep the workers busy, never all of them.

A unit ends in one of three ways. Done: its future is dropped at once (a finished future whose worker dies is computed
again). To be tried again (exit code 75 or 130, killed, its worker lost): submitted again after a pause, elsewhere if there is
an elsewhere. Failed for good (any other code): all stops with the worker's words.
"""

import heapq
import time
import uuid
from concurrent.futures import CancelledError
from dataclasses import dataclass, field

import cloudpickle
from distributed import Client, Future, KilledWorker, as_completed

from . import worker
from .plan import Failure, Plan, format_units
from .progress import Display

cloudpickle.register_pickle_by_value(worker)

# Units submitted before any worker is there: enough for a cluster that grows with its load.
FIRST = 64
# A unit waits this long at most before it is tried again.
LONGEST_PAUSE_S = 60.0
# Given to units that run when the driver stops, to finish their tiles and tell their end.
STOP_S = 10.0


@dataclass
class Settings:
    """How units are run on the workers."""

    lenscube: str = "lenscube"
    paths: list[str] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)
    gpu: bool = False
    detach: bool = False
    retries: int = 10
    retry_pause_s: float = 5.0


class Drive:
    """Does units of a plan on a client's workers."""

    def __init__(self, client: Client, plan: Plan, settings: Settings, display: Display):
        self.client, self.settings, self.display = client, settings, display
        self.name = f"lenscube-{plan.digest[:12]}-{uuid.uuid4().hex[:8]}"
        self.task = worker.task(self.name)
        self.ends = as_completed(with_results=True, raise_errors=False, loop=client.loop)
        self.flying: dict[Future, int] = {}
        self.tries: dict[int, int] = {}
        self.again: list[tuple[float, int, str | None]] = []  # when, unit, address to avoid
        self.done = 0
        s = settings
        plugin = worker.Units(self.name, plan.text, s.lenscube, s.paths, s.flags, s.detach)
        client.subscribe_topic(self.name, lambda event: display.event(event[1]))
        client.register_plugin(plugin, name=self.name)

    def run(self, units: list[int]) -> None:
        """All of them; a Failure otherwise."""
        waiting = iter(units)
        left, room, looked = len(units), FIRST, 0.0
        while left:
            if time.monotonic() - looked > 2:
                looked, room = time.monotonic(), self.room()
            self.submit_some(waiting, room)
            ended = self.ends.next_batch(block=False)
            for future, result in ended:
                left -= self.settle(future, result)
            self.display.show()
            if not ended:
                time.sleep(0.05)

    def room(self) -> int:
        """Futures in flight: two for each unit that can run at a time."""
        return 2 * sum(self.client.nthreads().values()) or FIRST

    def submit_some(self, waiting, room: int) -> None:
        while len(self.flying) < room:
            if self.again and self.again[0][0] <= time.monotonic():
                _, unit, avoid = heapq.heappop(self.again)
                self.submit(unit, avoid)
            elif (unit := next(waiting, None)) is not None:
                self.submit(unit)
            else:
                return

    def submit(self, unit: int, avoid: str | None = None) -> None:
        tried = self.tries[unit] = self.tries.get(unit, 0) + 1
        places = {}
        if avoid and (others := [w for w in self.client.nthreads() if w != avoid]):
            places = {"workers": others, "allow_other_workers": True}
        key = f"unit-{unit}-{tried}-{self.name}"
        resources = {"GPU": 1} if self.settings.gpu else None
        future = self.client.submit(self.task, unit, key=key, pure=False, resources=resources, **places)
        self.flying[future] = unit
        self.ends.add(future)
        self.display.note(event="submit", unit=unit, attempt=tried)

    def settle(self, future: Future, result) -> int:
        """A future has ended: 1 if its unit is done."""
        unit = self.flying.pop(future)
        if isinstance(result, dict):
            return self.ended(unit, result)
        error = result[1] if isinstance(result, tuple) else result
        if isinstance(error, KilledWorker):
            return self.retry(unit, "its workers were lost", None)
        if isinstance(error, CancelledError):
            raise error
        raise Failure(f"unit {unit}: {type(error).__name__}: {error}", 1)

    def ended(self, unit: int, end: dict) -> int:
        code, words = end["code"], end.get("message", "no words")
        if code == 0:
            self.done += 1
            self.tries.pop(unit, None)
            self.display.done(unit, end.get("pixels", 0))
            return 1
        if code is not None and (code in (75, 130) or code < 0):
            how = f"killed by signal {-code}" if code < 0 else words
            return self.retry(unit, f"{how} (on {end['host']})", end["address"])
        kind = "did not start" if code is None else f"failed with exit code {code}"
        raise Failure(f"unit {unit} {kind} on {end['host']}: {words}", code or 1)

    def retry(self, unit: int, why: str, avoid: str | None) -> int:
        tried = self.tries[unit]
        self.display.note(event="retry", unit=unit, attempt=tried, why=why)
        if tried > self.settings.retries:
            raise Failure(f"unit {unit} was tried {tried} times: {why}", 75)
        pause = min(self.settings.retry_pause_s * 2 ** (tried - 1), LONGEST_PAUSE_S)
        self.display.say(f"unit {unit}: {why}; again in {pause:.0f} s (try {tried + 1} of {self.settings.retries + 1})")
        heapq.heappush(self.again, (time.monotonic() + pause, unit, avoid))
        return 0

    def stop(self) -> None:
        """Ends what runs on the workers, waits a little for it, and drops the rest."""
        self.client.run(worker.stop_units, self.name, wait=False, on_error="ignore")
        end = time.monotonic() + STOP_S
        while self.flying and time.monotonic() < end:
            self.flying = {f: unit for f, unit in self.flying.items() if not f.done()}
            time.sleep(0.05)
        if self.flying:
            self.display.say(f"units {format_units(list(self.flying.values()))} gave no answer in {STOP_S:.0f} s")
            self.client.cancel(list(self.flying), force=True)
        self.close()

    def close(self) -> None:
        self.client.unsubscribe_topic(self.name)
        self.client.unregister_worker_plugin(self.name)
