#!/usr/bin/env python3
"""Faults of the documentation: links and anchors that lead nowhere, files that are named and not there."""
import pathlib
import re
import subprocess
import sys


def anchors(page):
    """Anchors of the headings of a page, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    for heading in re.findall(r"^#+ +(.*)$", text, flags=re.M):
        heading = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        yield re.sub(r"[^\w\- ]", "", heading).replace(" ", "-")


def links(path, text):
    """Target and anchor of each link in a file."""
    if path.suffix == ".md":
        text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
        for target, anchor in re.findall(r"\]\(([^)#\s]*)(#[^)\s]*)?\)", text):
            if not re.match(r"[a-z]+:", target):
                yield (path.parent / target if target else path), anchor
        for target in re.findall(r"`((?:[\w/]+/src|test|bench|scripts|config)/[\w/.-]+)`", text):
            yield pathlib.Path(target), ""
    else:
        for target, anchor in re.findall(r"(?<![\w/.])(docs/[\w/.-]+\.md)(#[\w-]+)?", text):
            yield pathlib.Path(target), anchor


faults = []
for name in subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], capture_output=True, check=True, text=True).stdout.splitlines():
    path = pathlib.Path(name)
    if path.suffix not in {".md", ".rs", ".yaml", ".toml", ".sh", ".cmake", ".py"} and path.name != "Makefile":
        continue
    if not path.exists():
        continue
    for target, anchor in links(path, path.read_text()):
        if not target.exists():
            faults.append(f"{path}: {target} does not exist")
        elif anchor and target.suffix == ".md" and anchor[1:] not in anchors(target):
            faults.append(f"{path}: {target} has no heading {anchor}")
sys.exit("\n".join(faults) or None)
