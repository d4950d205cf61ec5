"""Submission of units: enough in flight to keep the workers busy, never all of them.

A unit ends in one of three ways. Done: its future is dropped at once (a finished future whose worker ends is computed
again). Retryable (exit code 75 or 130, killed, worker lost): submitted again after a pause, on another worker if there is
one. Permanent failure (any other exit code): the driver stops with the error message of the worker.
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

# Units submitted before any worker is connected, so that an adaptive cluster grows.
INITIAL_UNITS = 64
# Maximum pause before a retry.
MAX_PAUSE_S = 60.0
# Time for running units to finish their tiles when the driver stops.
STOP_TIMEOUT_S = 10.0


@dataclass
class Settings:
    """Settings of units on the workers."""

    lenscube: str = "lenscube"
    paths: list[str] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)
    gpu: bool = False
    detach: bool = False
    retries: int = 10
    retry_pause_s: float = 5.0


class Drive:
    """Executes units of a plan on the workers of a client."""

    def __init__(self, client: Client, plan: Plan, settings: Settings, display: Display):
        self.client, self.settings, self.display = client, settings, display
        self.name = f"lenscube-{plan.digest[:12]}-{uuid.uuid4().hex[:8]}"
        self.task = worker.task(self.name)
        self.ends = as_completed(with_results=True, raise_errors=False, loop=client.loop)
        self.in_flight: dict[Future, int] = {}
        self.attempts: dict[int, int] = {}
        self.pending_retries: list[tuple[float, int, str | None]] = []  # heap of (time, unit, address to avoid)
        s = settings
        plugin = worker.Units(self.name, plan.text, s.lenscube, s.paths, s.flags, s.detach)
        client.subscribe_topic(self.name, lambda event: display.event(event[1]))
        client.register_plugin(plugin, name=self.name)

    def run(self, units: list[int]) -> None:
        """Executes all units; raises a Failure otherwise."""
        waiting = iter(units)
        remaining, max_in_flight, updated = len(units), INITIAL_UNITS, 0.0
        while remaining:
            if time.monotonic() - updated > 2:
                updated, max_in_flight = time.monotonic(), self.max_in_flight()
            self.submit_pending(waiting, max_in_flight)
            done = self.handle_ends()
            remaining -= done or 0
            self.display.show()
            if done is None:
                time.sleep(0.05)

    def handle_ends(self) -> int | None:
        """Handles the futures that have ended, of which none is kept. Returns how many units are done, None if no future has ended."""
        ended = self.ends.next_batch(block=False)
        return sum(self.handle_end(future, result) for future, result in ended) if ended else None

    def max_in_flight(self) -> int:
        """Maximum number of futures in flight: two per worker thread."""
        return 2 * sum(self.client.nthreads().values()) or INITIAL_UNITS

    def submit_pending(self, waiting, max_in_flight: int) -> None:
        while len(self.in_flight) < max_in_flight:
            if self.pending_retries and self.pending_retries[0][0] <= time.monotonic():
                _, unit, avoid = heapq.heappop(self.pending_retries)
                self.submit(unit, avoid)
            elif (unit := next(waiting, None)) is not None:
                self.submit(unit)
            else:
                return

    def submit(self, unit: int, avoid: str | None = None) -> None:
        attempt = self.attempts[unit] = self.attempts.get(unit, 0) + 1
        placement = {}
        if avoid and (others := [w for w in self.client.nthreads() if w != avoid]):
            placement = {"workers": others, "allow_other_workers": True}
        key = f"unit-{unit}-{attempt}-{self.name}"
        resources = {"GPU": 1} if self.settings.gpu else None
        future = self.client.submit(self.task, unit, key=key, pure=False, resources=resources, **placement)
        self.in_flight[future] = unit
        self.ends.add(future)
        self.display.note(event="submit", unit=unit, attempt=attempt)

    def handle_end(self, future: Future, result) -> int:
        """Handles the end of a future. Returns 1 if its unit is done, else 0."""
        unit = self.in_flight.pop(future)
        if isinstance(result, dict):
            return self.handle_exit(unit, result)
        error = result[1] if isinstance(result, tuple) else result
        if isinstance(error, KilledWorker):
            return self.retry(unit, "its workers were lost", None)
        if isinstance(error, CancelledError):
            raise error
        raise Failure(f"unit {unit}: {type(error).__name__}: {error}", 1)

    def handle_exit(self, unit: int, end: dict) -> int:
        code, message = end["code"], end.get("message", "no message")
        if code == 0:
            self.attempts.pop(unit, None)
            self.display.done(unit, end.get("pixels", 0))
            return 1
        if code is not None and (code in (75, 130) or code < 0):
            reason = f"killed by signal {-code}" if code < 0 else message
            return self.retry(unit, f"{reason} (on {end['host']})", end["address"])
        kind = "did not start" if code is None else f"failed with exit code {code}"
        raise Failure(f"unit {unit} {kind} on {end['host']}: {message}", code or 1)

    def retry(self, unit: int, reason: str, avoid: str | None) -> int:
        attempt = self.attempts[unit]
        self.display.note(event="retry", unit=unit, attempt=attempt, why=reason)
        if attempt > self.settings.retries:
            raise Failure(f"unit {unit} was tried {attempt} times: {reason}", 75)
        pause = min(self.settings.retry_pause_s * 2 ** (attempt - 1), MAX_PAUSE_S)
        self.display.print_line(f"unit {unit}: {reason}; retry in {pause:.0f} s (attempt {attempt + 1} of {self.settings.retries + 1})")
        heapq.heappush(self.pending_retries, (time.monotonic() + pause, unit, avoid))
        return 0

    def stop(self) -> None:
        """Stops the units on the workers, waits for their end, and cancels the rest."""
        self.client.run(worker.stop_units, self.name, wait=False, on_error="ignore")
        end = time.monotonic() + STOP_TIMEOUT_S
        while self.in_flight and time.monotonic() < end:
            self.in_flight = {f: unit for f, unit in self.in_flight.items() if not f.done()}
            time.sleep(0.05)
        if self.in_flight:
            self.display.print_line(f"units {format_units(list(self.in_flight.values()))} did not end within {STOP_TIMEOUT_S:.0f} s")
            self.client.cancel(list(self.in_flight), force=True)
        self.close()

    def close(self) -> None:
        self.client.unsubscribe_topic(self.name)
        self.client.unregister_worker_plugin(self.name)
