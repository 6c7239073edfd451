#!/usr/bin/env python3
"""Circles of imports among the files of a crate: more than three files in one have no order in which they can be read."""
import pathlib
import re
import sys

MOST = 3
# What is no code, in the order in which it would begin.
NO_CODE = re.compile(r"""//[^\n]*|/\*.*?\*/|b?r(#*)".*?"\1|b?"(?:\\.|[^"\\])*"|b?'(?:\\.[^']*|[^'\\])'""", re.S)
TEST = re.compile(r"#\[cfg\((?:test|all\(test\b[^\]]*)\)\]\s*(?:#\[[^\]]*\]\s*)*[^;{]*")
USE = re.compile(r"\b(pub(?:\([^)]*\))? +)?use\s+([^;]+);")


def without_tests(code):
    """Code without the items that only tests have."""
    while found := TEST.search(code):
        end, depth = found.end(), 0
        while end < len(code):
            depth += {"{": 1, "}": -1}.get(code[end], 0)
            end += 1
            if depth == 0 and code[end - 1] in ";}":
                break
        code = code[: found.start()] + code[end:]
    return code


def paths(tree, before=()):
    """Paths of a `use`, each with the name that it gets."""
    depth, part, parts = 0, "", []
    for letter in tree + ",":
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append(part.strip())
            part = ""
        else:
            part += letter
    for part in filter(None, parts):
        head, brace, rest = part.partition("{")
        if brace:
            yield from paths(rest.rpartition("}")[0], before + tuple(filter(None, head.strip().split("::"))))
            continue
        path, _, name = part.partition(" as ")
        path = before + tuple(one.strip() for one in path.split("::"))
        yield (path[:-1], path[-2] if path[-1] == "self" else path[-1]) if path[-1] == "self" else (path, name.strip() or path[-1])


def circles(graph):
    """Strongly connected files, after Tarjan."""
    index, low, stack, found = {}, {}, [], []

    def visit(one):
        index[one] = low[one] = len(index)
        stack.append(one)
        for other in graph.get(one, ()):
            if other not in index:
                visit(other)
            if other in stack:
                low[one] = min(low[one], low[other])
        if low[one] == index[one]:
            at = stack.index(one)
            found.append(stack[at:])
            del stack[at:]

    for one in graph:
        if one not in index:
            visit(one)
    return found


def of_crate(source):
    """Imports of each file of a crate from others of it."""
    uses, modules = {}, {}
    for file in sorted(source.rglob("*.rs")):
        place = file.relative_to(source).with_suffix("").parts
        if place[-1].endswith("tests") or "tests" in place or place[0] == "bin":
            continue
        module = () if place in (("lib",), ("main",)) else place[:-1] if place[-1] == "mod" else place
        modules[module] = file
        code = without_tests(NO_CODE.sub('""', file.read_text()))
        uses[module] = [(bool(found[1]), path, name) for found in USE.finditer(code) for path, name in paths(found[2])]

    def resolved(module, path, depth=0):
        """Module that has what a path in a module names."""
        at, rest = module, list(path)
        if rest[0] == "crate":
            at, rest = (), rest[1:]
        elif rest[0] not in ("self", "super") and module + (rest[0],) not in modules:
            return None
        while rest and rest[0] in ("self", "super"):
            at = at[:-1] if rest.pop(0) == "super" else at
        while rest and at + (rest[0],) in modules:
            at += (rest.pop(0),)
        for is_public, inner, name in uses.get(at, ()):
            if rest and is_public and name == rest[0] and depth < 9:
                return resolved(at, inner, depth + 1)
        return at if at in modules else None

    graph = {}
    for module, imports in uses.items():
        targets = {resolved(module, path) for is_public, path, _ in imports if not is_public}
        graph[modules[module]] = {modules[one] for one in targets if one is not None} - {modules[module]}
    return graph


faults = [
    f"{len(circle)} files import each other, at most {MOST} may: {', '.join(sorted(map(str, circle)))}"
    for source in sorted(pathlib.Path().glob("*/src")) + sorted(pathlib.Path("crates").glob("*/src"))
    for circle in circles(of_crate(source))
    if len(circle) > MOST
]
sys.exit("\n".join(faults) or None)
