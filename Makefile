# make demo    all programs, and the main job on a bare machine: ZeroMQ in, ROS 2 out, a live table
# make test    everything: format, lints, tests against real peers, documentation, colcon
# make bench   raw transports, bridge and Python Wrapyfi measured by turns: bench/RESULTS.md
# make doc     API documentation of the workspace, in target/doc
# make fmt     formats the sources
# make lint    lints only
# make fuzz    fuzz targets, SECONDS_EACH=60 seconds each; see docs/fuzzing.md
# make test-rmw   ROS 2 through the rmw of the ROS 2 that is sourced
# make test-frameworks   tensors of the real PyTorch, JAX, TensorFlow, Paddle: 700 MB to download, once

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
MAKEFLAGS += --no-print-directory
# One after the other: every step uses all cores, and each one fails with its own message.
.NOTPARALLEL:
.PHONY: demo test bench doc fmt lint fuzz setup-build setup-test setup-frameworks test-fmt test-rust
.PHONY: test-frameworks test-python test-colcon test-rmw

DEMO_ARGS ?= --seconds 20
BENCH_ARGS ?=
# Debian's ament needs Debian's Python, whatever comes first in PATH.
export PYTHON3 ?= /usr/bin/python3

# A quiet cargo still prints warnings and errors.
CARGO := cargo --quiet

demo: setup-build
	cargo build --release --locked --package wrapyfi_bridge
	@$(CARGO) run --release --locked --package wrapyfi_bridge --bin wrapyfi -- demo $(DEMO_ARGS)

test: setup-test test-fmt lint test-rust test-python doc test-colcon
	@echo "make test: all passed"

setup-build:
	@scripts/setup.sh build

setup-test:
	@scripts/setup.sh test

setup-frameworks:
	@scripts/setup.sh frameworks

test-fmt:
	@cargo fmt --all --check || { echo "remedy: make fmt" >&2; exit 1; }

fmt:
	@cargo fmt --all

# With the cameras of the examples, which no other build compiles.
CAMERAS := --features wrapyfi_communicator_examples/v4l2

lint: | target/COLCON_IGNORE
	@$(CARGO) clippy --workspace --all-targets --locked $(CAMERAS) -- -D warnings

fuzz: export SECONDS_EACH ?= 60
fuzz: | target/COLCON_IGNORE
	@fuzz/run.sh

# Compiled outside: the namespace has no network, should Cargo still have to fetch something.
# The programs too, because the end-to-end tests start them.
test-rust: | target/COLCON_IGNORE
	@$(CARGO) build --workspace --locked
	@$(CARGO) nextest run --workspace --locked --no-run
	@WRAPYFI_REQUIRE_PEERS=1 scripts/lo-namespace.sh \
		cargo nextest run --workspace --locked --status-level fail --final-status-level slow
	@cargo nextest run --locked --package wrapyfi_communicator_examples $(CAMERAS) --lib \
		--status-level fail
	@$(CARGO) test --doc --workspace --locked

# With the libraries of the peers; `colcon test` runs them with what the system has.
test-python:
	@cd wrapyfi_py && PYTHONDONTWRITEBYTECODE=1 ../.venv/bin/python -m unittest discover --quiet -t . -s test

# Not part of `make test`: the libraries take 3 GB of disk.
test-frameworks: setup-test setup-frameworks | target/COLCON_IGNORE
	@$(CARGO) build --locked --package wrapyfi_bridge
	@$(CARGO) nextest run --locked --package wrapyfi_e2e --test frameworks --no-run
	@$(CARGO) nextest run --locked --package wrapyfi_core --no-default-features --features candle \
		--test tensor_candle
	@WRAPYFI_REQUIRE_PEERS=1 WRAPYFI_PYTHON=$(CURDIR)/.venv-frameworks/bin/python \
		WRAPYFI_FRAMEWORKS=1 scripts/lo-namespace.sh \
		cargo nextest run --locked --package wrapyfi_e2e --test frameworks

# Not part of `make test`: needs a ROS 2 that is sourced. RMW_IMPLEMENTATION chooses the middleware.
RMW := --workspace --locked --features wrapyfi_bridge/rmw
test-rmw: setup-test | target/COLCON_IGNORE
	@$(CARGO) build $(RMW)
	@$(CARGO) nextest run $(RMW) --no-run
	@WRAPYFI_REQUIRE_PEERS=1 WRAPYFI_REQUIRE_ROS2=1 scripts/lo-namespace.sh cargo nextest run $(RMW) \
		-E 'package(wrapyfi_rmw) or binary(ros2_rmw) or binary(real_ros2)' --status-level fail

doc: | target/COLCON_IGNORE
	@RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked

test-colcon:
	@test/colcon.sh

# Built outside: the namespace has no network.
bench: setup-build | target/COLCON_IGNORE
	@$(CARGO) build --release --locked --package wrapyfi_bridge --package wrapyfi_bench
	@scripts/lo-namespace.sh target/release/wrapyfi_bench $(BENCH_ARGS)

# colcon reads every folder below the one it starts in.
target/COLCON_IGNORE:
	@mkdir -p target && touch $@
