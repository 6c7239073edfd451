#!/usr/bin/env python3
"""Adds the run that `make bench` wrote into RESULTS.md to history.csv, a line a figure, unless it is there.

    bench/history.py [COMMIT]

Before another run takes its place. The columns are explained in README.md beside this.
"""
import csv
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).parent
# The first pattern that a row's name has says to which area it belongs.
AREAS = {
    "package": r"wrapyfi_rs",
    "codecs": r"^(encode|decode|ROS 1,)|dynamic decodes",
    "library": r"registered|structs",
    "engine": r"^engine",
    "routes": r"^\d+ routes",
    "ros2": r"ROS 2|CycloneDDS",
    "zeromq": "",
}
UNITS = {
    "%": r"percent", "MiB/min": r"MiB a minute", "MiB": r"MiB", "s": r"seconds? from", "ms": r"\bms\b", "us": r"\bus\b",
}
VERDICTS = {"": "", "met": "met", "**missed**": "missed", "**undecided**": "undecided"}
# Columns of the table of ways: the figure, its unit.
WAYS = [
    ("p50", "us"), None, ("p99", "us"), ("lost", ""), ("twice", ""), ("messages a second", "1/s"), ("CPU a message", "us"),
    ("CPU a message, between the ends", "us"), ("RSS", "MiB"), ("RSS, between the ends", "MiB"),
]


def first(patterns, text):
    return next((name for name, pattern in patterns.items() if re.search(pattern, text)), "")


def tables(text):
    """Rows of each table, its head the first."""
    for table in re.findall(r"(?:^\|.*\n)+", text, re.M):
        lines = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in table.splitlines()]
        yield lines[0], lines[2:]


def targets(rows):
    before = ""
    for what, promised, found, interval, verdict in rows:
        what = re.sub(r"^the same\b", lambda _: before, what)
        before = what.split(":")[0]
        value, parts = found.split(": ", 1) if ": " in found else (found.rstrip(":"), "")
        unit = "ratio" if " / " in parts and not re.search(r"\bms\b", what) else first(UNITS, what)
        limit = promised.replace("at most", "<=").replace("at least", ">=")
        low, _, high = interval.partition(" to ")
        if not high:
            low, parts = "", f"{parts}; {low}".strip("; ")
        yield first(AREAS, what), what, unit, limit, value, low, high, VERDICTS[verdict], parts


def coding(head, rows):
    names = [head[1], f"{head[1]}, Python", head[3], f"{head[3]}, Python", *head[5:]]
    for what, *cells in rows:
        for name, cell in zip(names, cells):
            yield "codecs", f"{name}: {what}", "us", "", cell, "", "", "", "one thread, no transport"


def ways(rows):
    for way, payload, *cells in rows:
        low, high = cells[1].split(" to ")
        for column, cell in zip(WAYS, cells):
            if column:
                name, unit = column
                bounds = (low, high) if name == "p50" else ("", "")
                yield first(AREAS, way), f"{way}, {payload}: {name}", unit, "", cell, *bounds, "", ""


def run(text):
    """Figures of a report, with date and machine."""
    head = next(line for line in text.splitlines() if re.match(r"\d{4}-\d\d-\d\d", line))
    date, cores, memory, conditions = head.split("; ", 3)
    for titles, rows in tables(text):
        of = {"target": lambda: targets(rows), "payload": lambda: coding(titles, rows), "way": lambda: ways(rows)}[titles[0]]
        for area, *figure, parts in of():
            yield date, f"{cores}; {memory}", area, *figure, "; ".join(filter(None, [parts, conditions]))


if __name__ == "__main__":
    text = (HERE / "RESULTS.md").read_text()
    text = text.partition("<!-- make bench writes from here -->")[2].partition("<!-- to here -->")[0]
    commit = sys.argv[1] if len(sys.argv) > 1 else ""
    history = HERE / "history.csv"
    lines = [[date, commit, *line] for date, *line in run(text)]
    with history.open("a+", newline="") as file:
        file.seek(0)
        if any(line[:1] == lines[0][:1] for line in csv.reader(file)):
            sys.exit(f"{history} has the run of {lines[0][0]} already")
        csv.writer(file, lineterminator="\n").writerows(lines)
    print(f"{len(lines)} figures of {lines[0][0]}")
