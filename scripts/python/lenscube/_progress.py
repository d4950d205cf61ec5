"""Progress of a run: a bar of tqdm on a terminal and in notebooks, from the events of `--progress jsonl`."""

import sys
from collections.abc import Callable
from types import TracebackType
from typing import Any

Event = dict[str, Any]


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and shell.__class__.__name__ == "ZMQInteractiveShell"


class Progress:
    """`shown`: None: a bar on a terminal and in notebooks; True, False; or a function that is called with every event."""

    def __init__(self, shown: bool | Callable[[Event], None] | None = None):
        self.function = shown if callable(shown) else None
        self.shown = in_notebook() or sys.stderr.isatty() if shown is None else shown is True
        self.bars: list[Any] = []
        self.name = ""

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None) -> None:
        for bar in self.bars:
            bar.close()

    def __call__(self, event: Event) -> None:
        if self.function:
            self.function(event)
        if not self.shown:
            return
        kind = event.get("event")
        if kind == "trace":
            self._show("lens", event["bands_total"], event["bands"], "band")
        elif kind == "start":
            self._show("film", event["pixels"], 0, "px")
        elif kind == "progress":
            self._show("film", event["pixels_total"], event["pixels"], "px")
        elif kind == "done" and self.name == "film":
            self._show("film", self.bars[-1].total, self.bars[-1].total, "px")

    def _show(self, name: str, total: int, done: int, unit: str) -> None:
        if self.name != name:
            from tqdm.std import tqdm  # type: ignore[import-untyped]

            for bar in self.bars:
                bar.close()
            self.name = name
            self.bars.append(tqdm(total=total, desc=name, unit=unit, unit_scale=unit == "px", file=sys.stderr))
        self.bars[-1].update(done - self.bars[-1].n)
