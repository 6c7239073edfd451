#!/usr/bin/env python3
"""Texts that `wrapyfi why` takes apart: it learns causes from values, never from a sentence."""
import pathlib
import re
import sys

FOLDER = pathlib.Path("wrapyfi_bridge/src/why")
TAKES_APART = re.compile(r"\b(?:contains(?=\((?!&))|r?split_once|strip_suffix|strip_prefix|starts_with|ends_with)\(")
NO_CODE = re.compile(r'//[^\n]*|b?r(#*)".*?"\1|"(?:\\.|[^"\\])*"', re.S)

faults = []
for file in sorted(FOLDER.rglob("*.rs")):
    if file.stem.endswith("tests"):
        continue
    code = NO_CODE.sub(lambda found: "\n" * found[0].count("\n"), file.read_text().split("#[cfg(test)]")[0])
    for number, line in enumerate(code.splitlines(), 1):
        faults += [f"{file}:{number}: takes a text apart: {found[0]}…)" for found in TAKES_APART.finditer(line)]
sys.exit("\n".join(faults) or None)
