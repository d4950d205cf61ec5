"""The types of the keywords of each function, from the flags that the program describes (`lenscube man --json`): lenscube/_flags.pyi.

    python flags_stub.py <(lenscube man --json)
"""

import json
import sys
from collections.abc import Iterator
from keyword import iskeyword
from typing import Any

HEAD = '''"""Flags of each command of lenscube. Generated."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

Number = int | float
# Arrays of NumPy are lists too.
Value = str | os.PathLike[str] | Number | slice | Sequence[Number] | Sequence[Sequence[Number]] | Any
'''
# Flags that functions of the package set, or have as parameters.
OWN = {"progress", "die_with_parent", "quiet", "verbose", "dry_run", "plan", "unit", "missing", "out", "output", "json"}


def commands(described: dict[str, Any], words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    for command in described["commands"]:
        name = (*words, command["name"])
        yield name, command
        yield from commands(command, name)


def kind(argument: dict[str, Any]) -> str:
    if not argument["takes_value"]:
        return "bool"
    one = f"Literal[{', '.join(map(repr, argument['values']))}]" if "values" in argument else "Value"
    many = f" | Sequence[{one}] | Mapping[str, Value]" if argument["repeatable"] else ""
    return f"{one}{many} | None"


def stub(described: dict[str, Any]) -> str:
    """The text of the file."""
    parts = [HEAD]
    for words, command in commands(described):
        parts.append(f"\nclass {''.join(w.title() for w in words)}(TypedDict, total=False):")
        parts.append(f"    {json.dumps(command['about'] or '', ensure_ascii=False)}\n")
        for argument in command["arguments"]:
            name = (argument.get("flag") or "").removeprefix("--").replace("-", "_")
            if name and name not in OWN:
                parts.append(f"    {name}{'_' * iskeyword(name)}: {kind(argument)}")
                parts.append(f"    {json.dumps(argument.get('help', ''), ensure_ascii=False)}")
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    with open(sys.argv[1]) as file:
        print(stub(json.load(file)), end="")
