#!/usr/bin/env python3
"""Licences of the crates in the program `wrapyfi` and in the library for Python, against THIRD_PARTY.md.

    scripts/licences.py                 says what is missing or wrong; a part of `make lint`
    scripts/licences.py --write         writes the table
    scripts/licences.py --texts FILE    writes the texts that come with the crates, for the packages
    scripts/licences.py --spdx FILE     writes the bill of materials; its date is $SOURCE_DATE_EPOCH, else that of the commit
"""

import datetime
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "THIRD_PARTY.md"
BEGIN, END = "<!-- by scripts/licences.py --write -->\n", "<!-- to here -->\n"
# A crate that needs one of these to be built may have C in it, or link it.
OF_C = {"bindgen", "cc", "cmake", "pkg_config", "system_deps"}
# Loaded when the program starts; in the wheels it is inside, and what zig links with it.
LINKED = {"libjpeg-turbo": "IJG AND BSD-3-Clause AND Zlib"}
IN_WHEELS = {"compiler-rt": "MIT", "libunwind": "Apache-2.0 WITH LLVM-exception"}
TEXTS = ("licen", "copying", "copyright", "notice", "unlicense")


def cargo(*arguments):
    # The features of the program, whatever the workspace is compiled with.
    environment = {name: value for name, value in os.environ.items() if name != "CARGO_RESOLVER_FEATURE_UNIFICATION"}
    return subprocess.run(["cargo", *arguments, "--locked"], cwd=ROOT, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout


def crates():
    """Packages of `cargo metadata` that are compiled into the program or into the library, those of others."""
    tree = cargo("tree", "--package", "wrapyfi_bridge", "--package", "wrapyfi_python", "--edges", "normal,no-proc-macro", "--prefix", "none", "--no-dedupe",
                 "--format", "{p}", *(f"--target={processor}-unknown-linux-gnu" for processor in ("aarch64", "x86_64")))
    inside = {tuple(line.split()[:2]) for line in tree.splitlines()}
    metadata = json.loads(cargo("metadata", "--format-version", "1"))
    packages = {p["id"]: p for p in metadata["packages"] if p["source"] and (p["name"], "v" + p["version"]) in inside}
    for node in metadata["resolve"]["nodes"]:
        if node["id"] in packages:
            packages[node["id"]]["built_with"] = {dep["name"] for dep in node["deps"] if any(k["kind"] == "build" for k in dep["dep_kinds"])}
    return sorted(packages.values(), key=lambda p: (p["name"], p["version"]))


def licence(package):
    """Its licence in the words of SPDX, choices in one order."""
    text = (package["license"] or "none").replace("/", " OR ")
    return text if " AND " in text else " OR ".join(sorted(text.split(" OR ")))


def table(packages):
    rows = {}
    for package in packages:
        rows.setdefault(licence(package), set()).add(package["name"])
    lines = [f"| {name} | {', '.join(sorted(names))} |\n" for name, names in sorted(rows.items())]
    return "| licence | crates |\n| --- | --- |\n" + "".join(lines)


def texts(packages):
    """Each text once, with the crates that it comes with."""
    found = {}
    for package in packages:
        folder = pathlib.Path(package["manifest_path"]).parent
        # CycloneDDS lies in a folder of the crate that brings it.
        files = [file for place in (folder, folder / "cyclonedds") if place.is_dir() for file in sorted(place.iterdir())
                 if file.is_file() and file.name.lower().startswith(TEXTS)]
        name = f"{package['name']} {package['version']}"
        contents = [file.read_text(errors="replace").strip() for file in files]
        if not contents:
            contents = [f"{licence(package)}. Its authors publish no text with it: {', '.join(package['authors']) or 'unnamed'}."]
        for content in contents:
            users = found.setdefault(re.sub(r"\s+", " ", content), (content, []))[1]
            if name not in users:
                users.append(name)
    return "\n\n".join(f"{'=' * 100}\n{', '.join(users)}\n{'-' * 100}\n{content}" for content, users in found.values()) + "\n"


def spdx(packages):
    """Bill of materials as SPDX 2.3 in JSON, the same for the same commit."""
    version = next(p for p in json.loads(cargo("metadata", "--no-deps", "--format-version", "1"))["packages"]
                   if p["name"] == "wrapyfi_bridge")["version"]
    seconds = os.environ.get("SOURCE_DATE_EPOCH") or subprocess.check_output(["git", "log", "-1", "--format=%ct"], cwd=ROOT, text=True)
    created = datetime.datetime.fromtimestamp(int(seconds), datetime.timezone.utc)
    parts, relations = [], []

    def part(name, version, licence, location, relation):
        identity = f"SPDXRef-{re.sub('[^A-Za-z0-9.-]', '-', f'{name}-{version}' if version else name)}"
        entry = {"SPDXID": identity, "name": name, "licenseDeclared": licence, "licenseConcluded": "NOASSERTION",
                 "copyrightText": "NOASSERTION", "filesAnalyzed": False, "downloadLocation": location or "NOASSERTION"}
        if version:
            entry["versionInfo"] = version
        if location:
            entry["externalRefs"] = [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                                      "referenceLocator": f"pkg:cargo/{name}@{version}"}]
        parts.append(entry)
        ours = parts[0]["SPDXID"]
        relations.append({"spdxElementId": "SPDXRef-DOCUMENT" if identity == ours else ours, "relationshipType": relation,
                          "relatedSpdxElement": identity})

    part("wrapyfi", version, "Apache-2.0 OR MIT", None, "DESCRIBES")
    for package in packages:
        name, its = package["name"], package["version"]
        part(name, its, licence(package), f"https://crates.io/api/v1/crates/{name}/{its}/download", "CONTAINS")
        if name == "cyclors":
            text = pathlib.Path(package["manifest_path"]).with_name("cyclonedds").joinpath("CMakeLists.txt").read_text()
            part("cyclonedds", re.search(r"project\(CycloneDDS VERSION (\S+)", text)[1], "BSD-3-Clause", None, "CONTAINS")
    for name, its in LINKED.items():
        part(name, None, its, None, "DYNAMIC_LINK")
    for name, its in IN_WHEELS.items():
        part(name, None, its, None, "STATIC_LINK")
    contents = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    return json.dumps({
        "spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": f"wrapyfi-{version}",
        "documentNamespace": f"https://spdx.org/spdxdocs/wrapyfi-{version}-{contents}",
        "creationInfo": {"created": f"{created:%Y-%m-%dT%H:%M:%SZ}", "creators": ["Tool: scripts/licences.py"]},
        "packages": parts, "relationships": relations}, indent=1) + "\n"


def main(arguments):
    packages = crates()
    writers = {"--texts": texts, "--spdx": spdx}
    if len(arguments) == 2 and arguments[0] in writers:
        pathlib.Path(arguments[1]).write_text(writers[arguments[0]](packages))
        return 0
    page = PAGE.read_text()
    before, _, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        print(f"licences: {PAGE.name} lacks {BEGIN.strip()} and {END.strip()}", file=sys.stderr)
        return 1
    right = before + BEGIN + table(packages) + END + after
    faults = [f"{package['name']} brings or links C, and {PAGE.name} says nothing of it" for package in packages
              if package["built_with"] & OF_C and f"`{package['name']}`" not in before + after]
    if arguments == ["--write"]:
        PAGE.write_text(right)
    elif arguments:
        print(__doc__, file=sys.stderr)
        return 2
    elif page != right:
        faults.append(f"{PAGE.name} does not list the crates that are in the program: scripts/licences.py --write")
    for fault in faults:
        print(f"licences: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
