"""Runs the tests of one crate and writes one xunit file with one case per Rust test.

cargo-nextest runs them where it is installed (a process and a time limit for each test), else
`cargo test`. Doc tests always go through `cargo test`: nextest has none.

A test that cannot run because a peer is not installed prints a line `SKIPPED name: reason` to
standard error and passes; it is counted as skipped with that reason.

WRAPYFI_TESTS in the environment narrows what cargo-nextest runs: an expression of its filter language. Doc tests,
which have no names there, are left out then.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET

SKIP = re.compile(r"^\s*SKIPPED (\S+): (.+)$", re.MULTILINE)
# Characters that XML 1.0 cannot hold, and the colours around them.
UNPRINTABLE = re.compile("\x1b\\[[0-9;]*m|[^\t\n\r\x20-\ud7ff\ue000-\ufffd]")


# Features that tests of a crate alone need; built with the workspace they have them.
WITH = {"wrapyfi_core": ["full"], "wrapyfi_ros2": ["fastdds-services"], "wrapyfi_zeromq": ["curve"]}


class Case:
    def __init__(self, suite, name, seconds=0.0, failure=None, skipped=None, output=""):
        self.suite, self.name, self.seconds = suite, name, seconds
        self.failure, self.skipped, self.output = failure, skipped, output
        reason = SKIP.search(output)
        if reason and failure is None:
            self.skipped = reason.group(2).strip()


def run(command, env):
    print("+", " ".join(command), flush=True)
    process = subprocess.Popen(
        command, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )
    lines = []
    for line in process.stdout:
        print(line, end="", flush=True)
        lines.append(line)
    return process.wait(), "".join(lines)


def from_nextest(path):
    for suite in ET.parse(path).getroot().iter("testsuite"):
        for case in suite.iter("testcase"):
            failure = case.find("failure")
            if failure is None:
                failure = case.find("error")
            message = None
            if failure is not None:
                message = f"{failure.get('message') or 'failed'}\n{failure.text or ''}"
            skipped = case.find("skipped")
            output = "\n".join(e.text or "" for e in case if e.tag in ("system-out", "system-err"))
            yield Case(
                suite.get("name"),
                case.get("name"),
                float(case.get("time") or 0),
                message,
                None if skipped is None else skipped.get("message") or "ignored",
                output,
            )


def from_libtest(crate, text):
    """Reads what libtest prints for people; its JSON is not stable yet."""
    suite, cases, outputs, section = crate, {}, {}, None
    # Written past libtest's capture, so it is somewhere in the text instead of in a test's section.
    skips = dict(SKIP.findall(text))
    for line in text.splitlines():
        # One binary after the other: what was open belongs to the last one.
        started = re.match(r"\s+(?:Running (?:unittests )?(\S+)|Doc-tests (\S+))", line)
        if started:
            stem = pathlib.Path(started.group(1)).stem if started.group(1) else "doc"
            suite, section = crate if stem in ("lib", "main") else f"{crate}::{stem}", None
            continue
        result = re.match(r"test (.+?)(?: - should panic)? \.\.\. (ok|FAILED|ignored)(?:, (.*))?$", line)
        header = re.match(r"---- (.+) stdout ----$", line)
        if result:
            cases[suite, result.group(1)] = result.group(2), result.group(3)
        elif header:
            section = outputs.setdefault((suite, header.group(1)), [])
        elif re.match(r"(failures|successes|test result):", line):
            section = None
        elif section is not None:
            section.append(line)
    for (suite, name), (state, reason) in cases.items():
        output = "\n".join(outputs.get((suite, name), []))
        yield Case(
            suite,
            name,
            failure=output or "failed" if state == "FAILED" else None,
            skipped=reason or "ignored" if state == "ignored" else skips.get(name.rsplit("::", 1)[-1]),
            output=output,
        )


def write(path, crate, cases, seconds):
    def text(value):
        return UNPRINTABLE.sub("", value)

    root = ET.Element(
        "testsuite",
        name=crate,
        tests=str(len(cases)),
        failures=str(sum(c.failure is not None for c in cases)),
        errors="0",
        skipped=str(sum(c.skipped is not None for c in cases)),
        time=f"{seconds:.3f}",
    )
    for case in cases:
        element = ET.SubElement(
            root, "testcase", classname=text(case.suite), name=text(case.name), time=f"{case.seconds:.3f}"
        )
        if case.failure is not None:
            message = text(case.failure)
            first = (message.strip().splitlines() or ["failed"])[0]
            ET.SubElement(element, "failure", message=first).text = message
        elif case.skipped is not None:
            ET.SubElement(element, "skipped", message=text(case.skipped))
        if case.output and case.skipped is None:
            ET.SubElement(element, "system-out").text = text(case.output)
    path.parent.mkdir(parents=True, exist_ok=True)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cargo", required=True)
    parser.add_argument("--package", required=True)
    parser.add_argument("--profile", default="release", help="Cargo's profile with which the package was built")
    parser.add_argument("--target-dir", required=True, type=pathlib.Path)
    parser.add_argument("--result", required=True, type=pathlib.Path)
    parser.add_argument("--rmw", default="", help="prefixes of the ROS 2 that it was built with, none for none")
    parser.add_argument("--tested", default="", help="packages whose tests were built with it, by commas; none for all")
    parser.add_argument("--doc-tests", action="store_true", help="also those of all crates")
    options = parser.parse_args()
    crate = options.package

    env = dict(os.environ, CARGO_TARGET_DIR=str(options.target_dir), CARGO_TERM_COLOR="never",
               WRAPYFI_RMW_PREFIX_PATH=options.rmw)
    metadata = json.loads(
        subprocess.check_output(
            [options.cargo, "metadata", "--no-deps", "--format-version", "1"], env=env
        )
    )
    targets = next(p["targets"] for p in metadata["packages"] if p["name"] == crate)
    is_library = any("lib" in t["kind"] or "proc-macro" in t["kind"] for t in targets)
    # Of all that was built wherever one crate can be chosen from it: for a crate alone Cargo unites
    # other features, and compiles again what `colcon build` has compiled.
    built = ["--locked", *([f"--package={c}" for c in options.tested.split(",")] if options.tested else ["--workspace"])]
    if options.rmw:
        built += ["--features", "wrapyfi_bridge/rmw"]
    nextest = subprocess.run(
        [options.cargo, "nextest", "--version"], env=env, capture_output=True
    ).returncode == 0

    begin = time.monotonic()
    cases = []
    if nextest:
        # nextest writes into the sources unless told otherwise in its configuration file. Outside
        # the build folders, or `colcon test-result` would count its file a second time.
        with tempfile.TemporaryDirectory(prefix="wrapyfi-nextest-") as store:
            config = pathlib.Path(store, "nextest.toml")
            settings = pathlib.Path(metadata["workspace_root"], ".config", "nextest.toml").read_text()
            config.write_text(f"{settings}\n[store]\ndir = {json.dumps(store)}\n")
            status, text = run(
                [options.cargo, "nextest", "run", "--cargo-profile", options.profile, *built]
                + ["-E", f"package(={crate}) and ({os.environ.get('WRAPYFI_TESTS') or 'all()'})"]
                + ["--profile", "colcon", "--no-tests=pass", "--config-file", str(config)],
                env,
            )
            junit = pathlib.Path(store, "colcon", "junit.xml")
            if junit.exists():
                cases += from_nextest(junit)
    else:
        kinds = ["--lib"] if is_library else []
        features = WITH.get(crate, [])
        if options.rmw and crate in ("wrapyfi_bridge", "wrapyfi_ros2"):
            features = [*features, "rmw"]
        if features:
            kinds += ["--features", ",".join(features)]
        status, text = run(
            [options.cargo, "test", "--profile", options.profile, "--locked", "--package", crate, *kinds]
            + ["--bins", "--tests", "--no-fail-fast", "--", "--show-output"]
            # With one thread libtest starts the line before the test runs, and stray output splits it.
            + [f"--test-threads={max(2, os.cpu_count() or 2)}"],
            env,
        )
        cases += from_libtest(crate, text)
    if status != 0 and not any(c.failure for c in cases):
        cases.append(Case(crate, "run", failure=f"exit status {status}\n{text}"))
    if options.doc_tests and not os.environ.get("WRAPYFI_TESTS"):
        status, text = run([options.cargo, "test", "--profile", options.profile, *built, "--doc", "--no-fail-fast"], env)
        documented = list(from_libtest(crate, text))
        if status != 0 and not any(c.failure for c in documented):
            documented.append(Case(f"{crate}::doc", "run", failure=f"exit status {status}\n{text}"))
        cases += documented

    write(options.result, crate, cases, time.monotonic() - begin)
    for case in cases:
        if case.skipped is not None:
            print(f"skipped: {case.suite} {case.name}: {case.skipped}")
    sys.exit(1 if any(c.failure is not None for c in cases) else 0)


if __name__ == "__main__":
    main()
