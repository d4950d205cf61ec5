#!/usr/bin/env python3
"""Import circles between source files of different folders, and between folders: none are allowed; in the command none at all.

An edge leads from a file to each file that its `use` lines and `crate::` paths name; test modules are left out. A file `a.rs` with a
folder `a/` beside it belongs to that folder as well as to the one that it lies in. Exit code 1 if there is no folder to which all
files of a circle belong, or if a circle of the files and folders in one folder, each folder taken as a whole, has two folders, and
for any circle in a package of WITHOUT_CIRCLES. With --all other circles are printed as well.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CRATES = {"pipeline": ROOT / "pipeline/src", "lenscube_formats": ROOT / "formats/src", "lenscube": ROOT / "src"}
# Packages in which no files import each other in a circle, in one folder neither.
WITHOUT_CIRCLES = ("lenscube",)


def modules(source):
    """Module path (a tuple of names) -> file."""
    found = {}
    for file in source.rglob("*.rs"):
        parts = file.relative_to(source).with_suffix("").parts
        if file.stem in ("lib", "main"):
            parts = parts[:-1]
        if parts[-1:] != ("tests",) and "tests" not in parts:
            found[parts] = file
    return found


def without_tests(text):
    """The text without comments, strings, visibilities and what follows `#[cfg(test)]` for one item."""
    text = re.sub(r"//[^\n]*", "", text)
    text = re.sub(r'"(?:[^"\\]|\\.)*"', '""', text)
    text = re.sub(r"pub\(in [^)]*\)", "pub", text)
    out, start = [], 0
    for match in re.finditer(r"#\[cfg\(test\)\]", text):
        if match.start() < start:
            continue
        out.append(text[start : match.start()])
        depth, position = 0, match.end()
        while position < len(text):
            character = text[position]
            depth += (character == "{") - (character == "}")
            position += 1
            if depth == 0 and character in ";}":
                break
        start = position
    out.append(text[start:])
    return "".join(out)


def leaves(tree, prefix=()):
    """The paths that a `use` tree such as `a::{b, c::D as E}` names."""
    tree = tree.strip()
    brace = tree.find("{")
    if brace < 0:
        path = tree.split(" as ")[0].strip()
        return [prefix + tuple(p.strip() for p in path.split("::") if p.strip())]
    head = tuple(p.strip() for p in tree[:brace].split("::") if p.strip())
    parts, depth, part = [], 0, ""
    for character in tree[brace + 1 : tree.rfind("}")]:
        depth += (character == "{") - (character == "}")
        if character == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += character
    parts.append(part)
    return [leaf for p in parts if p.strip() for leaf in leaves(p, prefix + head)]


def edges(found):
    """File -> the other files of its crate that it names."""
    graph = {}
    for path, file in found.items():
        text = without_tests(file.read_text())
        named = [leaf for use in re.findall(r"\buse\s+([^;]+);", text) for leaf in leaves(use)]
        rest = re.sub(r"\buse\s+[^;]+;", "", text)
        named += [tuple(p.split("::")) for p in re.findall(r"\b(?:crate|super)(?:::\w+)+", rest)]
        targets = set()
        for name in named:
            base = path
            if name[0] == "crate":
                base, name = (), name[1:]
            elif name[0] == "self":
                name = name[1:]
            elif name[0] == "super":
                while name and name[0] == "super":
                    base, name = base[:-1], name[1:]
            elif path + name[:1] not in found:
                continue
            whole = base + name
            for length in range(len(whole), 0, -1):
                if whole[:length] in found:
                    # A name re-exported or defined by a file that has children is that file's.
                    if found[whole[:length]] != file:
                        targets.add(whole[:length])
                    break
        graph[path] = targets
    return graph


def circles(graph):
    """Strongly connected components of more than one file (Tarjan 1972)."""
    index, low, stack, out = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in graph[node]:
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            component = []
            while True:
                component.append(stack.pop())
                if component[-1] == node:
                    break
            if len(component) > 1:
                out.append(component)

    for node in graph:
        if node not in index:
            visit(node)
    return out


def folders(path, found):
    """The folders that a file belongs to."""
    has_children = any(p[: len(path)] == path and len(p) > len(path) for p in found)
    return {path[:-1], path} if has_children else {path[:-1]}


def circles_of_folders(graph, found):
    """Circles of the files and folders in one folder: (folder, members that are folders, other members, the edges between them)."""
    parents = {path[:n] for path in found for n in range(len(path))}
    out = []
    for parent in sorted(parents):
        depth = len(parent)
        between = {}
        for path, targets in graph.items():
            for target in targets:
                inside = path[:depth] == parent == target[:depth] and min(len(path), len(target)) > depth
                if inside and path[depth] != target[depth]:
                    between.setdefault((path[depth], target[depth]), []).append((path, target))
        names = {name for edge in between for name in edge}
        of_names = {(name,): {(b,) for a, b in between if a == name} for name in names}
        for component in circles(of_names):
            members = {name for (name,) in component}
            are_folders = {name for name in members if parent + (name,) in parents}
            edges_inside = {edge: files for edge, files in between.items() if set(edge) <= members}
            out.append((parent, are_folders, members - are_folders, edges_inside))
    return out


def main():
    sys.setrecursionlimit(10_000)
    failed = False
    for crate, source in CRATES.items():
        found = modules(source)
        graph = edges(found)
        for component in circles(graph):
            across = not set.intersection(*(folders(path, found) for path in component))
            fails = across or crate in WITHOUT_CIRCLES
            failed |= fails
            if fails or "--all" in sys.argv[1:]:
                kind = "circle across folders" if across else "circle in a folder"
                inside = set(component)
                print(f"{crate}: {kind}:")
                for path in sorted(component):
                    print(f"  {'/'.join(path)} -> {', '.join(sorted('/'.join(t) for t in graph[path] & inside))}")
        for parent, are_folders, others, between in circles_of_folders(graph, found):
            several = len(are_folders) > 1
            failed |= several
            if several or (are_folders and "--all" in sys.argv[1:]):
                print(f"{crate}: circle of folders in {'/'.join(parent) or 'its root'}: {', '.join(sorted(are_folders | others))}")
                for (a, b), files in sorted(between.items()):
                    print(f"  {a} -> {b}: {', '.join('/'.join(x) + ' -> ' + '/'.join(y) for x, y in files[:3])}")
    return failed


if __name__ == "__main__":
    sys.exit(main())
