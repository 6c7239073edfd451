# make demo    the main job on a bare machine: ZeroMQ in, ROS 2 out, a live table
# make build   the program with all that it can, and its links, in target/release
# make check   for daily work: format, lints, tests without real peers
# make test    everything: format, lints, tests against real peers, documentation, colcon
# make nightly what takes hours: fuzz targets, more seeds, every feature alone, the release build, the oldest Rust,
#              public interfaces, 200 kills of each kind of peer and of the bridge, AddressSanitizer over CycloneDDS
#              and the code around it
# make soak    everything around a bridge killed by chance for MINUTES=60: fails where the bridge grows
# make bench   raw transports, bridge and Python Wrapyfi measured by turns: bench/RESULTS.md
# make doc     API documentation of the workspace, in target/doc; links of the pages
# make fmt     formats the sources
# make lint    lints only
# make package-deb, make package-wheel   what others install without a compiler, in target/package
# make package-ros   the packages of ROS 2 for the one that is sourced, in target/package
# make release  packages, sources, crates, bill of materials and checksums, in target/package/release; PROCESSORS="x86_64 aarch64"
#              makes wheels of both: docs/releasing.md
# make version TO=0.2.0   writes the version where it stands
# make fuzz    fuzz targets, SECONDS_EACH=60 seconds each; see fuzz/README.md
# make test-rmw   ROS 2 a second time, through each rmw of an installed ROS 2; a part of make test
# make test-rosidl   structs of rosidl_generator_rs and a node on rclrs, where a workspace with the generator is sourced; a part of make test
# make test-frameworks   tensors of the real PyTorch, JAX, TensorFlow, Paddle: 700 MB to download, once

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
MAKEFLAGS += --no-print-directory
# One after the other: every step uses all cores, and each one fails with its own message.
.NOTPARALLEL:
.PHONY: demo build package-crates package-deb package-ros package-wheel release version check test nightly soak test-churn bench doc fmt lint fuzz setup-build setup-test setup-wheel setup-frameworks test-fmt test-rust
.PHONY: test-asan test-frameworks test-publish test-python test-colcon test-packages test-rmw test-rosidl test-release test-seeds test-features test-oldest test-semver deny

DEMO_ARGS ?= --seconds 20
BENCH_ARGS ?=
# Debian's ament needs Debian's Python, whatever comes first in PATH.
export PYTHON3 ?= /usr/bin/python3

# A quiet cargo still prints warnings and errors.
CARGO := cargo --quiet

# Without what the demo does not show: libraries of Python's formats, and of services of Fast DDS nodes; optimised less.
LEAN := --profile demo --locked --package wrapyfi_bridge --bin wrapyfi --no-default-features
demo: setup-build
	cargo build $(LEAN)
	@$(CARGO) run $(LEAN) -- demo $(DEMO_ARGS)

build: setup-build
	cargo build --release --locked --package wrapyfi_bridge
	@for node in bridge ros1_bridge yarp_bridge zeromq_bridge; do ln -sf wrapyfi "$${CARGO_TARGET_DIR:-target}/release/$$node"; done

# The same selection of the workspace as everywhere, so that nothing is compiled twice.
check: test-fmt lint
	@$(CARGO) nextest run --workspace --locked --no-run
	@scripts/lo-namespace.sh cargo nextest run --workspace --locked --status-level fail --final-status-level slow \
		-E 'not (package(wrapyfi_e2e) or test(/^simulation::/))'

test: setup-test test-fmt lint test-rust test-rmw test-rosidl test-python doc test-colcon
	@echo "make test: all passed"

nightly: test-oldest test-semver test-features test-seeds test-churn test-release test-asan test-packages test-publish fuzz

# CycloneDDS, and the Rust around it, under AddressSanitizer; see the script for where its artefacts lie.
test-asan: | target/COLCON_IGNORE
	@scripts/test-asan.sh

# Built as users build it, every test once more.
test-release: export PROFILE := colcon
test-release: test-colcon

setup-build:
	@scripts/setup.sh build

setup-test:
	@scripts/setup.sh test

setup-wheel:
	@scripts/setup.sh wheel $(PROCESSORS)

setup-frameworks:
	@scripts/setup.sh frameworks

test-fmt:
	@cargo fmt --all --check || { echo "remedy: make fmt" >&2; exit 1; }

fmt:
	@cargo fmt --all

# With the cameras of the examples, which no other build compiles.
CAMERAS := --features wrapyfi_communicator_examples/v4l2

# The second without what can be left out, as `make demo` builds it.
lint: | target/COLCON_IGNORE
	@$(CARGO) clippy --workspace --all-targets --locked $(CAMERAS) -- -D warnings
	@$(CARGO) clippy --package wrapyfi_bridge --no-default-features --locked -- -D warnings
	@scripts/dependencies.sh
	@$(PYTHON3) scripts/sentences.py
	@$(PYTHON3) scripts/circles.py
	@$(PYTHON3) scripts/causes.py
	@$(MAKE) deny
	@$(PYTHON3) scripts/licences.py

# Licences, sources and doubled crates of all dependencies against deny.toml. Compiled without optimisation where it is
# not installed: under two minutes, once; the check itself takes three seconds. It reads the crates of every platform in Cargo.lock,
# of which a build has fetched its own platform's only.
CARGO_DENY_VERSION := 0.20.2
deny:
	@cargo deny --version 2>/dev/null | grep -qF " $(CARGO_DENY_VERSION)" || { echo "make: cargo install cargo-deny $(CARGO_DENY_VERSION) (two minutes, once)"; \
		CARGO_PROFILE_DEV_DEBUG=0 cargo install --quiet --locked --debug cargo-deny@$(CARGO_DENY_VERSION); }
	@$(CARGO) fetch --locked
	@cargo deny --offline --log-level error check licenses bans sources

# What Cargo.toml promises as `rust-version`; its artefacts lie apart, so that the next build is not one from nothing.
OLDEST_RUST = $(shell sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
test-oldest: | target/COLCON_IGNORE
	@if rustup toolchain install --no-self-update --profile minimal $(OLDEST_RUST) >/dev/null 2>&1; then \
		$(CARGO) +$(OLDEST_RUST) check --workspace --all-targets --locked --target-dir target/oldest; \
	else echo "SKIPPED test-oldest: rustup cannot install Rust $(OLDEST_RUST)" >&2; fi

# Public interfaces against the last release: what breaks them is a new version in Cargo.toml.
LAST_RELEASE = $(shell git describe --tags --abbrev=0 2>/dev/null)
# cargo-semver-checks does not follow what wrapyfi_core shows of the crates below: changes there are for the reviewer of its lists.
# Until a release has a tag: the commit since which the public interface is compared.
SEMVER_BASE := f5ea02c3a5108badc3b26ae962bf9bfa454059e6
test-semver: | target/COLCON_IGNORE
	@if ! git cat-file -e "$(or $(LAST_RELEASE),$(SEMVER_BASE))^{commit}" 2>/dev/null; then \
		echo "SKIPPED test-semver: this clone lacks the commit to compare with, $(or $(LAST_RELEASE),$(SEMVER_BASE))" >&2; \
	elif cargo semver-checks --version >/dev/null 2>&1; then cargo semver-checks check-release --package wrapyfi_core \
		--only-explicit-features --features full --baseline-rev $(or $(LAST_RELEASE),$(SEMVER_BASE)); \
	else echo "SKIPPED test-semver: run cargo install --locked cargo-semver-checks" >&2; fi

# Each feature alone, which no other build compiles: one must not need another.
test-features: | target/COLCON_IGNORE
	@scripts/features.sh

# Bridges under an invented clock: ten times the seeds of `make test`.
test-seeds: export WRAPYFI_SEEDS ?= 100000
test-seeds: | target/COLCON_IGNORE
	@cargo nextest run --workspace --locked --profile nightly -E 'test(/^simulation::/)'

# Peers, servers and the bridge killed with SIGKILL; the same for a time, with a look at memory, files and threads.
CHURN := --profile nightly --success-output final -E 'test(/^churn::/)'
test-churn: export WRAPYFI_ROUNDS ?= 200
soak: export WRAPYFI_MINUTES = $(MINUTES)
MINUTES ?= 60
test-churn soak: setup-test | target/COLCON_IGNORE
	@$(CARGO) build --workspace --all-targets --locked
	@$(CARGO) nextest run --workspace --locked --no-run
	@scripts/lo-namespace.sh cargo nextest run --workspace --locked $(CHURN)

fuzz: export SECONDS_EACH ?= 60
fuzz: | target/COLCON_IGNORE
	@fuzz/run.sh

# Most end-to-end tests wait for their peers most of the time: with two tests for each core, a part of it idles. Eight are
# the most, because the cores of a hired machine may be shared: with many tests at once, each runs out of its time then.
TEST_THREADS := $(shell threads=$$((3 * $$(nproc))); echo $$((threads < 8 ? threads : 8)))

# Compiled outside: the namespace has no network, should Cargo still have to fetch something.
# The programs too, because the end-to-end tests start them; all in one command, because the programs alone
# are built with fewer features of the foreign crates, and these would be compiled twice.
test-rust: | target/COLCON_IGNORE
	@$(CARGO) build --workspace --all-targets --locked
	@$(CARGO) nextest run --workspace --locked --no-run
	@WRAPYFI_REQUIRE_PEERS=1 scripts/lo-namespace.sh \
		cargo nextest run --workspace --locked --status-level fail --final-status-level slow --test-threads $(TEST_THREADS)
	@cargo nextest run --workspace --locked $(CAMERAS) -E 'package(wrapyfi_communicator_examples) and kind(lib)' \
		--status-level fail
	@$(CARGO) test --doc --workspace --locked

# With the libraries of the peers; `colcon test` runs them with what the system has.
test-python:
	@cd wrapyfi_py && PYTHONDONTWRITEBYTECODE=1 ../.venv/bin/python -m unittest discover --quiet -t . -s test

# Not part of `make test`: the libraries take 3 GB of disk.
test-frameworks: setup-test setup-frameworks | target/COLCON_IGNORE
	@$(CARGO) build --locked --package wrapyfi_bridge --package wrapyfi_python
	@$(CARGO) nextest run --locked --package wrapyfi_e2e --no-run
	@$(CARGO) nextest run --locked --package wrapyfi_data --features candle \
		tensor_candle::
	@WRAPYFI_REQUIRE_PEERS=1 WRAPYFI_PYTHON=$(CURDIR)/.venv-frameworks/bin/python \
		WRAPYFI_FRAMEWORKS=1 scripts/lo-namespace.sh \
		cargo nextest run --locked --package wrapyfi_e2e frameworks::

package-crates package-deb: package-%: setup-build | target/COLCON_IGNORE
	@packaging/$*/build.sh

package-ros: setup-build | target/COLCON_IGNORE
	@packaging/deb/ros.sh

package-wheel: setup-wheel | target/COLCON_IGNORE
	@packaging/wheel/build.sh $(PROCESSORS)

# In a new Debian 12 each, the Debian package in Ubuntu 24.04 too, as root; a skip that says why where none can be made.
test-packages: package-deb package-wheel
	@packaging/test.sh deb target/package/wrapyfi_*.deb
	@SUITE=noble packaging/test.sh deb target/package/wrapyfi_*.deb
	@packaging/test.sh container target/package/wrapyfi_*.deb
	@packaging/test.sh wheel target/package/wrapyfi_{ros2,rs}-*_$$(uname -m).whl
	@if [ -n "$${ROS_DISTRO:-}" ]; then $(MAKE) package-ros && packaging/test.sh ros target/package/ros-*-wrapyfi_*.deb; \
	else echo "SKIPPED package ros: no ROS 2 is sourced" >&2; fi

# What crates.io would be given, compiled crate by crate, and installed as from there.
test-publish: package-crates
	@CARGO_TARGET_DIR=target/publish $(CARGO) publish --workspace --dry-run --locked --allow-dirty
	@packaging/crates/test.sh

release: setup-wheel | target/COLCON_IGNORE
	@packaging/release.sh

# Cargo.toml has it for the crates, the program, the Debian package and the wheel; colcon reads package.xml alone.
version:
	@[[ "$(TO)" =~ ^[0-9]+\.[0-9]+\.[0-9]+$$ ]] || { echo "make version: say which, for instance TO=0.2.0" >&2; exit 1; }
	@sed -i -E 's/^((version|wrapyfi_[a-z0-9_]+) = (.*version = )?)"[0-9.]+"/\1"$(TO)"/' Cargo.toml
	@sed -i -E 's:<version>.*</version>:<version>$(TO)</version>:' wrapyfi*/package.xml
	@$(CARGO) update --workspace --offline

# Of the ROS 2 that is sourced, else of the newest in /opt/ros; a counted skip where there is none.
test-rmw: setup-test | target/COLCON_IGNORE
	@scripts/test-rmw.sh

test-rosidl: setup-test | target/COLCON_IGNORE
	@scripts/test-rosidl.sh

doc: | target/COLCON_IGNORE
	@$(PYTHON3) scripts/links.py
	@RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked

test-colcon:
	@test/colcon.sh

# Built outside: the namespace has no network.
bench: setup-test | target/COLCON_IGNORE
	@$(CARGO) build --release --locked --package wrapyfi_bridge --package wrapyfi_python --package wrapyfi_bench
	@scripts/lo-namespace.sh target/release/wrapyfi_bench $(BENCH_ARGS)

# colcon reads every folder below the one it starts in.
target/COLCON_IGNORE:
	@mkdir -p target && touch $@
