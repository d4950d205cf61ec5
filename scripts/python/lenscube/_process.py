"""One process of the program: its lines, its end, and Ctrl-C.

The process has a session of its own, so that Ctrl-C in a terminal reaches this process alone, which passes it on once: the program
finishes the tiles in progress and ends with 130. A second Ctrl-C kills it.
"""

import json
import logging
import queue
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from . import errors
from ._program import path

LOG = logging.getLogger("lenscube")
PACKAGE = str(Path(__file__).parent)


def execute(line: Sequence[str], on_event: Callable[[dict[str, Any]], None] | None = None) -> str:
    """Runs `lenscube LINE`; its standard output. With `on_event` the lines of standard output are events (`--progress jsonl`).

    Raises the exception of the exit code.
    """
    command = [path(), *line]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    followed = _Followed(process, on_event)
    code = followed.to_the_end()
    output = "".join(followed.output)
    if followed.interrupted and code in (0, -signal.SIGINT, -signal.SIGKILL, errors.Interrupted.code):
        text = "complete" if code == 0 else "the same call resumes"
        raise errors.Interrupted(f"interrupted; {text}", command, output)
    if code != 0:
        raise errors.error(code, followed.message(), command, output)
    return output


class _Followed:
    """The lines of a process, in this thread, in the order in which they arrive."""

    def __init__(self, process: subprocess.Popen[bytes], on_event: Callable[[dict[str, Any]], None] | None):
        self.process, self.on_event = process, on_event
        self.output: list[str] = []
        self.errors: list[str] = []
        self.last_event: dict[str, Any] = {}
        self.interrupted = False
        self.lines: queue.Queue[tuple[Callable[[str], None], str | None]] = queue.Queue()
        for stream, handle in ((process.stdout, self._output), (process.stderr, self._error)):
            threading.Thread(target=self._read, args=(stream, handle), daemon=True).start()

    def _read(self, stream: Any, handle: Callable[[str], None]) -> None:
        for line in stream:
            self.lines.put((handle, line.decode(errors="replace")))
        self.lines.put((handle, None))

    def to_the_end(self) -> int:
        """The exit code."""
        # Python's own handler would raise KeyboardInterrupt anywhere, also between two lines.
        handler = signal.getsignal(signal.SIGINT)
        replaced = handler is signal.default_int_handler and threading.current_thread() is threading.main_thread()
        if replaced:
            signal.signal(signal.SIGINT, lambda *_: self._interrupt())
        try:
            return self._follow()
        finally:
            if replaced:
                signal.signal(signal.SIGINT, handler)

    def _interrupt(self) -> None:
        self.process.send_signal(signal.SIGKILL if self.interrupted else signal.SIGINT)
        self.interrupted = True

    def _follow(self) -> int:
        streams = 2
        while streams:
            handle, line = self.lines.get()
            streams -= line is None
            try:
                if line is not None:
                    handle(line)
            except BaseException:
                # An exception of the caller's own progress function.
                self.process.send_signal(signal.SIGINT)
                self.process.wait()
                raise
        return self.process.wait()

    def _output(self, line: str) -> None:
        if self.on_event is None:
            self.output.append(line)
            return
        try:
            event = json.loads(line)
        except ValueError:
            self.output.append(line)
            return
        self.last_event = event
        self.on_event(event)

    def _error(self, line: str) -> None:
        text = line.rstrip("\n")
        if not text:
            return
        self.errors.append(text)
        if text.startswith("note: "):
            warn(text.removeprefix("note: "))
        elif not text.startswith(("lenscube: ", "error: ")):
            LOG.info("%s", text)

    def message(self) -> str:
        """The error message: that of the last event, else the lines of standard error from the error on."""
        if "message" in self.last_event:
            return self.last_event["message"]
        first = next((n for n, text in enumerate(self.errors) if text.startswith(("lenscube: ", "error: "))), 0)
        lines = [t for t in self.errors[first:] if not t.startswith(("For more information", "Usage: "))]
        return "\n".join(lines).removeprefix("lenscube: ").removeprefix("error: ")


def warn(text: str) -> None:
    """A warning at the line that called this package."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, errors.LenscubeWarning, stacklevel=level)
