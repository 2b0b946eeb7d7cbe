# SPDX-License-Identifier: Apache-2.0
# One make, not recursive; the rules are in mk/, by subject. `make help` lists the targets below.

# --- options ----------------------------------------
HOST_ARCH := $(shell uname -m)
# The board to build for: a folder of boards/ (BOARD=rpi5).
BOARD     ?= $(if $(filter aarch64,$(HOST_ARCH)),generic-arm64,sim-x86)
# SUITE, the Debian release to build for (bookworm, trixie), is that of this machine by default.
# Where everything that is built goes.
BUILD     ?= build
# Sanitizers (SAN=address,undefined); objects go to a folder of their own.
SAN       ?=
# 1: warnings are errors.
WERROR    ?=
# minimal: subview and subview-lab alone, without calibration, preview page and libcamera.
WITH      ?= all
# Debugging information; line numbers by default, -g has local variables too and compiles a quarter
# longer.
DEBUG     ?= $(if $(SAN),-g,-g1)
# A compiler prefix without a sysroot, for the library alone; with ARCH_FLAGS and ISAS
# (mk/foreign.mk).
CROSS     ?=
# Where `make install` installs.
PREFIX    ?= /usr/local
# How many tests run at once.
JOBS      ?= $(shell nproc)
# What `make only` runs: groups (GROUPS="unit golden") or single tests (TESTS=scenario/test_run).
GROUPS    ?= $(if $(TESTS),named,unit)
# Arguments of the fuzzers.
FUZZ_ARGS ?=
# The port of `make demo-live`.
PORT      ?= 8080
# Also: CC=clang takes another compiler, V=1 prints commands, OPT and OPT_KERNELS set optimization
# levels, RUNS selects systems of `make bare-test`, DESTDIR prefixes PREFIX.

# What make already runs in parallel keeps its jobs; otherwise an inner make takes all cores.
PARALLEL = $(if $(findstring jobserver,$(MAKEFLAGS)),,-j$(JOBS))

.DEFAULT_GOAL := all
include mk/board.mk mk/kernels.mk mk/flags.mk mk/sources.mk mk/compile.mk mk/programs.mk mk/tests.mk mk/checks.mk mk/install.mk \
  mk/library.mk

# --- targets ----------------------------------------
#: Use it
demo: ## install what is missing, build, run the main job on the simulator
demo-live: ## the same build, then the live page on the simulator at 127.0.0.1:8080 (PORT=8080) until Ctrl-C
programs: ## build the runtime and the tools only
install: ## copy programs, man pages, library, headers and examples to PREFIX (and DESTDIR)
install-library: ## the library part of it alone
clean: ## remove what was built for BOARD
#: Test while working
only: ## the groups or tests named: make only GROUPS="unit golden", make only TESTS=scenario/test_run
check: ## the fast tests: unit, kernels, grad
unit: ## the unit tests
kernels-check: ## every kernel variant against its reference
grad: ## every backward pass against double precision and central differences
golden: ## digests that must be equal on every machine
scenario: ## the whole runtime on the simulator and a virtual clock
fault: ## failures injected at every port call, power cuts, heap use
fuzz: ## every parser on damaged files, a short run
lint: ## includes, headers, sizes, words, symbols, stack, format
#: Test everything
test: ## install what is missing, build, run every lint and test; ends with N passed, N failed, N skipped
cross: ## kernels, digests and what depends on the processor, for arm64, emulated
library-test: ## the installed library: its symbols, C and C++, the examples, the same digest without a system
board-test: ## capture and train on a virtual ARM board with cameras (QEMU); under 5 minutes, 4 more the first time
service-test: ## packages of this machine's release, installed, and their service from start to purge (needs root); 1 minute
slurm-test: ## jobs of subview-lab tables by a real Slurm of one node (needs root); 1 minute
deploy-test: ## calibration, packages, service and power cuts on virtual boards with Debian 12 and 13 (needs root); 30 minutes
bare-test: ## the README's commands on minimal Debian 12 and 13 systems (needs root); RUNS=trixie: one of them
#: Boards and packages
plan: ## the board's memory map; fails when it does not fit
package: ## Debian packages for BOARD and SUITE: subview, subview-calibrate, subview-lab, libsubview-dev
deploy: ## build the package, install it on boards by ssh, check them there: HOST=pi, HOST="pi1 pi2"
deploy-rollback: ## on the boards HOST, the package before the present one
libsubview: ## the library for embedding; with CROSS=PREFIX- ARCH_FLAGS=... for a board without a system
examples: ## build the examples against the library, as installed in build/BOARD/stage
#: Measure
bench: ## time the kernels (kernels.csv), whole steps and their stages, seconds to a quality (quality.csv)
reproduce: ## measure the figures of docs/results.md again and compare (ONLY=pattern; SV_DATA=folder of datasets)
live-bench: ## MINUTES=10 of live training at 5,000, 10,000 and 20,000 Gaussians, one and two threads: a table
mca: ## predicted cycles of the kernels on ARM cores, and the steps that follow (llvm-mca)
stage-digests: ## digests of each stage of each step (STAGE_ARGS="STEPS ISA THREADS"); compare two builds by diff
#: Long runs
soak: ## still, session and moving runs for HOURS=1, with memory, descriptors, ledger and quality watched
soak-sim: ## long live runs on virtual clocks (EXPOSURES=10000 each)
ring-stress: ## OPERATIONS=100000000 of a ring between two threads, under ThreadSanitizer
kill-test: ## N=1000 kills of running programs at random moments: nothing torn, always resumed, the same digest
fuzz-long: ## MINUTES=10 of libFuzzer on all parsers and protocols, with sanitizers (clang); executions and coverage of each
fuzz-corpus: ## takes the inputs that fuzz-long found and that reach new edges into tests/fuzz/corpus
#: Care for the code
format: ## clang-format everything in place
format-check: ## tell which files clang-format would change
headers: ## each header alone, as C and as C++
tidy: ## clang-tidy and cppcheck
accept-counts: ## take the instructions counted now as those a step may take
man: ## man pages from the programs' own --help, in build/BOARD/man
deps: ## install what the build and the tests need from the distribution's packages
all: ## build the runtime, the tools and the tests for BOARD
help: ## this list
	@awk -F ':.*## ' '/^#: / { print "\n" substr($$0, 4) ":" } \
	  /^[a-z-]+:.*## / { printf "  %-16s %s\n", $$1, $$2 }' Makefile
	@printf '\nboards: %s\n' "$(BOARDS)"
.PHONY: help
