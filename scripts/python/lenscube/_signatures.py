"""The keywords of each function in its signature and help, for the completion of notebooks: from commands.json, which the build of the wheel writes."""

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ._arguments import flags_of

COMMANDS = Path(__file__).with_name("commands.json")


def describe(functions: dict[tuple[str, ...], Callable[..., Any]]) -> None:
    """Adds the flags of the commands to their functions. In a source tree, without the file, nothing is added."""
    if not COMMANDS.exists():
        return
    listing = json.loads(COMMANDS.read_text())
    for words, function in functions.items():
        described: Any = {"commands": listing["commands"]}
        for word in words:
            described = next(c for c in described["commands"] if c["name"] == word)
        _describe(function, flags_of(described))


def _describe(function: Any, flags: dict[str, dict[str, Any]]) -> None:
    signature = inspect.signature(function)
    own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    added = {name: a for name, a in flags.items() if name not in signature.parameters}
    keywords = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None) for name in added]
    function.__signature__ = signature.replace(parameters=[*own, *keywords])
    lines = [f"    {name}: {_help(argument)}" for name, argument in added.items()]
    function.__doc__ = f"{inspect.getdoc(function)}\n\nFlags:\n" + "\n".join(lines) + "\n"


def _help(argument: dict[str, Any]) -> str:
    values = f" ({', '.join(argument['values'])})" if "values" in argument else ""
    default = f" [default: {argument['default']}]" if "default" in argument else ""
    return f"{argument.get('help', '')}{values}{default}"
