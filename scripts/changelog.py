"""CHANGELOG.md as the CHANGELOG.rst of a package, which ROS's tools read (REP-132): the one source stays CHANGELOG.md.

    scripts/changelog.py PACKAGE > PACKAGE/CHANGELOG.rst
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
# `## 0.2.0 (2027-02-01)`, or what is not released yet.
VERSION = re.compile(r"## (?:Unreleased: )?(\d+\.\d+\.\d+)(?: \((\d{4}-\d{2}-\d{2})\))?$")


def inline(text):
    """Markdown inside a line: links become their words, code is in two backquotes."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"(?<!\*)\*\*([^*]+)\*\*(?!\*)", r"\1", text)
    parts = text.split("`")
    # Outside of code, a star or a bar would begin markup.
    plain = [re.sub(r"([*|\\_])", r"\\\1", part) if at % 2 == 0 else f"``{part}``" for at, part in enumerate(parts)]
    return "".join(plain)


def entries(markdown):
    """Lines of the page with the lines that go on with a bullet joined to it."""
    joined = []
    for line in markdown.splitlines():
        if line.startswith("  ") and joined and joined[-1].startswith("- "):
            joined[-1] += " " + line.strip()
        else:
            joined.append(line.rstrip())
    return joined


def rst(markdown, package):
    title = f"Changelog for package {package}"
    lines = ["^" * len(title), title, "^" * len(title), ""]
    versions = 0
    for line in entries(markdown):
        if line.startswith("## "):
            found = VERSION.match(line)
            if not found:
                raise ValueError(f"{line!r} is no heading of a version: ## 0.2.0 (2027-02-01)")
            version, date = found.groups()
            heading = f"{version} ({date})" if date else "Forthcoming"
            lines += ([""] if versions else []) + [heading, "-" * len(heading)]
            versions += 1
        elif line.startswith("- ") and versions:
            lines.append("* " + inline(line[2:]))
    if not versions:
        raise ValueError("CHANGELOG.md names no version")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.stdout.write(rst((ROOT / "CHANGELOG.md").read_text(), sys.argv[1]))
