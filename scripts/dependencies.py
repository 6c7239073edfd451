#!/usr/bin/env python3
"""Compares every crate of every build with deny.toml: its licence, its source, and that its version is named.

This is the part of `cargo deny check licenses bans sources` that Cargo's own metadata can answer, in a second and with
nothing to install. Licence texts are read by cargo-deny alone: `make deny`, a part of `make nightly`.
"""

import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
REGISTRY = "registry+https://github.com/rust-lang/crates.io-index"


def is_allowed(expression, allowed):
    """An SPDX expression, with `/` for OR as old crates write it."""
    words = re.findall(r"[()]|[^\s()/]+|/", expression)

    def either():
        result = both()
        while words and words[0] in ("OR", "/"):
            words.pop(0)
            # Not `or`: the words of the other side have to be read in any case.
            result |= both()
        return result

    def both():
        result = licence()
        while words and words[0] == "AND":
            words.pop(0)
            result &= licence()
        return result

    def licence():
        word = words.pop(0)
        if word == "(":
            result = either()
            words.pop(0)
            return result
        if words[:1] == ["WITH"]:
            word = " ".join([word, words.pop(0), words.pop(0)])
        return word in allowed

    return either() and not words


def faults(package, allowed):
    if package["source"] not in (None, REGISTRY):
        yield f"comes from {package['source']}; only crates.io is allowed"
    licence = package["license"]
    if licence is None:
        yield "names no licence"
    elif not is_allowed(licence, allowed):
        yield f"has the licence {licence}, which is not in the list `allow` of deny.toml"
    if package["source"] is None:
        for dependency in package["dependencies"]:
            if dependency["req"] == "*" and dependency.get("path") is None:
                yield f"depends on any version of {dependency['name']}: name one"


def built(target):
    """Crates that some build of the workspace has. Cargo's metadata lists others too, of features that nobody takes."""
    lines = cargo("tree", "--workspace", f"--target={target}", "--prefix=none", "--format={p}").splitlines()
    return {tuple(line.split()[:2]) for line in lines if line}


def cargo(command, *arguments):
    return subprocess.check_output(["cargo", command, "--locked", "--all-features", *arguments], cwd=ROOT, text=True)


def main():
    with open(ROOT / "deny.toml", "rb") as file:
        deny = tomllib.load(file)
    allowed = set(deny["licenses"]["allow"])
    wrong = {}
    for target in deny["graph"]["targets"]:
        crates = built(target)
        metadata = json.loads(cargo("metadata", "--format-version=1", f"--filter-platform={target}"))
        for package in metadata["packages"]:
            if (package["name"], f"v{package['version']}") in crates:
                name = f"{package['name']} {package['version']}"
                wrong[name] = list(faults(package, allowed))
    texts = [f"dependencies: {name} {fault}" for name, found in sorted(wrong.items()) for fault in found]
    if not wrong:
        sys.exit("dependencies: `cargo tree` names no crate that `cargo metadata` has")
    if texts:
        sys.exit("\n".join(texts))


if __name__ == "__main__":
    main()
