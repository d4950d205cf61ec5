"""Exceptions of the package: one class for each exit code of the program."""

from collections.abc import Sequence


class LenscubeWarning(UserWarning):
    """A note of the program: something was assumed, ignored or left out."""


class LenscubeError(Exception):
    """The program ended with an exit code other than 0; the message is its own.

    code: the exit code; command: the command line; output: its standard output.
    """

    code = 1

    def __init__(self, message: str, command: Sequence[str] = (), output: str = ""):
        super().__init__(message)
        self.command, self.output = list(command), output


class FailedError(LenscubeError):
    """Exit code 1: the command failed (a damaged or unreadable file, something forbidden). The same call fails again."""


class UsageError(LenscubeError, ValueError):
    """Exit code 2: the arguments are not valid, or do not fit the files."""

    code = 2


class OtherJobError(LenscubeError):
    """Exit code 3: the output exists and belongs to another job. `overwrite=True` replaces it, where a command has it."""

    code = 3


class CheckError(LenscubeError):
    """Exit code 4: a check found errors or missing parts; `output` is its report."""

    code = 4


class TemporaryError(LenscubeError):
    """Exit code 75: temporary (disk full, store unreachable, film locked by another run). The same call may succeed, and resumes."""

    code = 75


class KilledError(LenscubeError):
    """The program was ended by a signal, e.g. for lack of memory; `code` is its negative number. The same call resumes."""


class Interrupted(KeyboardInterrupt):
    """Exit code 130: interrupted, by Ctrl-C or the interrupt of a notebook. What is complete is kept, and the same call resumes.

    A KeyboardInterrupt and no LenscubeError, so that `except Exception` does not swallow it.
    """

    code = 130

    def __init__(self, message: str, command: Sequence[str] = (), output: str = ""):
        super().__init__(message)
        self.command, self.output = list(command), output


CLASSES: dict[int, type[LenscubeError] | type[Interrupted]] = {
    c.code: c for c in (FailedError, UsageError, OtherJobError, CheckError, TemporaryError, Interrupted)
}


def error(code: int, message: str, command: Sequence[str], output: str) -> BaseException:
    """The exception of an exit code; negative: of a signal."""
    if code in CLASSES:
        return CLASSES[code](message, command, output)
    killed = KilledError(message or f"the program was ended by signal {-code}", command, output)
    killed.code = code
    return killed
