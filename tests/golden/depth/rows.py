"""A table of checks: row, expected, found, limit."""
import sys


class Table:
    def __init__(self, title):
        self.failed = 0
        print(f"{title}\n{'':2}{'check':<74} {'expected':>12} {'found':>12} {'limit':>9}")

    def _print(self, name, expected, found, limit, good):
        self.failed += not good
        print(f"{' ' if good else '!':2}{name:<74} {expected:>12} {found:>12} {limit:>9}", flush=True)

    def near(self, name, expected, found, limit):
        """|found - expected| <= limit."""
        self._print(name, f"{expected:.6g}", f"{found:.6g}", f"{limit:.1e}", abs(found - expected) <= limit)

    def below(self, name, found, limit, expected=None):
        """found <= limit; `expected`: the figure it is compared with."""
        self._print(name, "" if expected is None else f"{expected:.3g}", f"{found:.3g}", f"{limit:.2g}", found <= limit)

    def end(self):
        """Exits with 1 if a row was out of its limit."""
        if self.failed:
            sys.exit(f"{self.failed} rows are out of their limits (marked !)")
