"""Commands in a Markdown document: lines of indented and fenced blocks, and code in the text that begins with a program's name."""
import ast
import re
import tomllib
from dataclasses import dataclass

# Programs whose use in the text, as `lenscube status film.zarr`, is a command.
PROGRAMS = ("lenscube", "lenscube-dask", "cargo", "pip", "python", "sbatch", "kubectl")
# A block of anything else is not shell.
SHELL = re.compile(r"(?:" + "|".join(map(re.escape, PROGRAMS)) + r"|export|scripts/\S+)(?: |$)")


@dataclass
class Command:
    line: int
    text: str
    kind: str  # shell, python, or inline


def blocks(text):
    """(first line number, lines) of each indented or fenced block."""
    found, fenced, previous = [], False, ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("```"):
            fenced = not fenced
            if fenced:
                found.append((number + 1, []))
        elif fenced:
            found[-1][1].append(line)
        elif line.startswith("    ") and (previous == "" or previous.startswith("    ")):
            if not previous.startswith("    "):
                found.append((number, []))
            found[-1][1].append(line[4:])
        previous = line
    return found


def is_python(lines):
    try:
        ast.parse("\n".join(lines))
        return True
    except SyntaxError:
        return False


def is_toml(lines):
    try:
        tomllib.loads("\n".join(lines))
        return True
    except tomllib.TOMLDecodeError:
        return False


def commands(text):
    """The commands of a document in its order; a block of Python is one, a block of TOML has none. Fails where a block is something else."""
    found, inside = [], set()
    for first, lines in blocks(text):
        inside.update(range(first, first + len(lines)))
        if all(SHELL.match(line) for line in lines if line):
            found += [Command(first + i, line, "shell") for i, line in enumerate(lines) if line]
        elif is_toml(lines):
            continue  # tables of TOML may be Python, too
        elif is_python(lines):
            found.append(Command(first, "\n".join(lines), "python"))
        else:
            raise ValueError(f"line {first}: a block that is neither shell, Python nor TOML: {lines[0]}")
    for number, line in enumerate(text.splitlines(), 1):
        if number not in inside:
            spans = [s for s in re.findall(r"`([^`]+)`", line) if s.split()[0] in PROGRAMS and len(s.split()) > 1]
            found += [Command(number, span, "inline") for span in spans]
    return sorted(found, key=lambda c: c.line)


def without_comment(command):
    return re.sub(r"\s+# .*$", "", command)


def is_synopsis(command):
    """Whether it has a placeholder, a word in capitals: `lenscube view FILM --chart CHART`."""
    return any(re.fullmatch(r"[A-Z]+", word) for word in command.split())


def is_name(command):
    """Whether it only names a command: `lenscube device check`."""
    return all(re.fullmatch(r"[a-z-]+", word) and not word.startswith("-") for word in command.split())


def paths(text):
    """Files of the repository that a document names: link targets and code that begins with a folder's name."""
    links = re.findall(r"\]\(([^)#:]+)\)", text)
    named = [s.split()[0] for s in re.findall(r"`((?:scripts|src|tests|pipeline|formats)/[^`]*)`", text)]
    return links, named
