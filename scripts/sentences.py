#!/usr/bin/env python3
"""Faults of the documentation in Rust sources: paragraphs that begin with a question word instead of their subject."""
import pathlib
import re
import subprocess
import sys

QUESTION = re.compile(r"\s*(?:[*-] )?(?:What|Whether|Who|Whose|Where|How|Which|If it|When to)\b")

faults = []
for name in subprocess.run(["git", "ls-files", "*.rs"], capture_output=True, check=True, text=True).stdout.splitlines():
    begins, is_code = True, False
    for number, line in enumerate(pathlib.Path(name).read_text().splitlines(), 1):
        doc = re.match(r"\s*//[/!] ?(.*)", line)
        text = doc.group(1).strip() if doc else ""
        is_fence = text.startswith("```")
        is_code = bool(doc) and is_code != is_fence
        if not is_code and (begins or text.startswith(("* ", "- "))) and QUESTION.match(text):
            faults.append(f"{name}:{number}: begins with a question word: {text}")
        begins = not text or is_fence or is_code
sys.exit("\n".join(faults) or None)
