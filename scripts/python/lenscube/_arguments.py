"""Keywords to flags: `film_size="512x768"` becomes `--film-size=512x768`. The flags are those that the program describes."""

import difflib
import os
import re
from collections.abc import Mapping, Sequence
from keyword import iskeyword
from numbers import Number
from typing import Any

from ._program import described_command

# Flags that this package sets.
OWN = {"progress", "die_with_parent", "quiet", "verbose"}


def keyword(flag: str) -> str:
    """`film_pitch_um` of `--film-pitch-um`; `from_` of `--from`, which is a word of Python."""
    name = flag.removeprefix("--").replace("-", "_")
    return f"{name}_" if iskeyword(name) else name


def flags_of(described: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The flags of a described command, by keyword."""
    found = {keyword(a["flag"]): a for a in described["arguments"] if a.get("flag")}
    return {name: argument for name, argument in found.items() if name not in OWN}


def _flags(words: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    return flags_of(described_command(words))


def flags(*words: str) -> dict[str, str]:
    """The keywords of a command, with their help: `lenscube.flags("run")`, `lenscube.flags("lens", "show")`."""
    return {name: argument["help"] for name, argument in _flags(words).items()}


def arguments(words: tuple[str, ...], positional: Sequence[Any], keywords: Mapping[str, Any]) -> list[str]:
    """The command line of a command, without the program.

    Raises TypeError for an unknown keyword, with the names that are close to it, and for a value that is no text, number or list.
    """
    known, line = _flags(words), list(words)
    former = {keyword(alias): argument for argument in known.values() for alias in argument.get("aliases", ())}
    for name, value in keywords.items():
        argument = known.get(name) or former.get(name)
        if argument is None:
            raise TypeError(_unknown(words, name, list(known)))
        line += _flag(argument, value)
    return [*line, "--", *(_text(p, "") for p in positional)]


def _unknown(words: tuple[str, ...], name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    close += [k for k in known if (name in k or k in name) and k not in close][:3]
    if close:
        return f"{'_'.join(words)}() has no keyword {name!r}; close: {', '.join(close)}"
    listed = ", ".join(map(repr, words))
    return f"{'_'.join(words)}() has no keyword {name!r}; all: {', '.join(known) or 'none'}; lenscube.flags({listed}) explains them"


def _flag(argument: Mapping[str, Any], value: Any) -> list[str]:
    flag = argument["flag"]
    if value is None or value is False:
        return []
    if not argument["takes_value"]:
        if value is not True:
            raise TypeError(f"{keyword(flag)}: a switch, expected True or False, found {value!r}")
        return [flag]
    if argument["repeatable"]:
        if isinstance(value, Mapping):
            value = [f"{k}={_text(v, ',')}" for k, v in value.items()]
        if _is_list(value) and not all(isinstance(v, Number) for v in value):
            return [f"{flag}={_value(argument, v)}" for v in value]
    return [f"{flag}={_value(argument, value)}"]


def _value(argument: Mapping[str, Any], value: Any) -> str:
    # `WxH`: two sides of a rectangle.
    separator = "x" if re.search(r"\b[A-Z]x[A-Z]\b", argument.get("value") or "") else ","
    try:
        return _text(value, separator)
    except TypeError as e:
        raise TypeError(f"{keyword(argument['flag'])}: {e}") from None


def _is_list(value: Any) -> bool:
    return isinstance(value, (list, tuple)) or hasattr(value, "__array__") and getattr(value, "ndim", 0) == 1


def _text(value: Any, separator: str) -> str:
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    if isinstance(value, bool):
        raise TypeError(f"expected a value, found {value}")
    if isinstance(value, slice):
        # An open end stays empty: `450:` is all from 450 nm, `450` one band.
        ends = (value.start, value.stop) if value.step is None else (value.start, value.stop, value.step)
        return ":".join("" if v is None else _text(v, "") for v in ends)
    if _is_list(value) and separator:
        # Positions ((x, y), (x, y)) are separated by `;`.
        nested = any(_is_list(v) for v in value)
        return (";" if nested else separator).join(_text(v, separator) for v in value)
    if hasattr(value, "item") and getattr(value, "ndim", 0) == 0:
        return _text(value.item(), separator)
    if isinstance(value, (int, float)):
        return repr(value)
    raise TypeError(f"expected a text, a path, a number, a slice or a list of these, found {type(value).__name__}")
