# SPDX-License-Identifier: Apache-2.0
# One file, not recursive. `make help` lists the targets from their ## lines. Sources are found by folder, so
# a new file needs no change here; a folder that does not exist is an empty one.
#   BOARD=rpi5              the board to build for (boards/*)
#   SAN=address,undefined   the same with sanitizers, in a folder of its own
#   WERROR=1                warnings are errors, for developers and CI
#   DEBUG=-g                local variables for a debugger, too (compiles a quarter longer than line numbers alone)
#   CC=clang                another compiler than gcc
#   WITH=minimal            subview and subview-lab alone: no calibration, no live page, no libcamera
HOST_ARCH := $(shell uname -m)
BOARD     ?= $(if $(filter aarch64,$(HOST_ARCH)),generic-arm64,sim-x86)
BUILD     ?= build
SAN       ?=
WERROR    ?=
WITH      ?= all
DEBUG     ?= $(if $(SAN),-g,-g1)
PREFIX    ?= /usr/local
JOBS      ?= $(shell nproc)

BOARDS    := $(notdir $(patsubst %/board.mk,%,$(wildcard boards/[a-z]*/board.mk)))
ifeq ($(wildcard boards/$(BOARD)/board.mk),)
$(error no boards/$(BOARD)/board.mk; the boards are: $(BOARDS))
endif
include boards/$(BOARD)/board.mk
# The benchmark (tools/bench) is linked into `subview` where the board wants it.
BOARD_BENCH ?= yes
HAVE_BENCH  := $(filter-out no,$(BOARD_BENCH))

# On a machine of the board's own kind nothing is crossed and nothing emulated.
ifeq ($(BOARD_ARCH),$(HOST_ARCH))
override BOARD_CROSS :=
override BOARD_RUN   :=
SYSROOT_STAMP :=
else
SYSROOT       := $(BUILD)/sysroot-$(BOARD_DEBIAN_ARCH)
SYSROOT_STAMP := $(SYSROOT)/.complete
SYSROOT_FLAG  := --sysroot=$(SYSROOT)
EMULATE       := $(BOARD_RUN) $(if $(BOARD_RUN),-L $(SYSROOT))
endif

comma := ,
O  := $(BUILD)/$(BOARD)$(if $(SAN),-$(if $(findstring address,$(SAN)),asan,$(subst $(comma),-,$(SAN))))
CC := $(BOARD_CROSS)gcc
CXX := $(if $(findstring clang,$(CC)),$(subst clang,clang++,$(CC)),$(subst gcc,g++,$(CC)))
AR := $(BOARD_CROSS)gcc-ar
IS_CLANG := $(findstring clang,$(CC))
OBJDUMP := $(BOARD_CROSS)objdump

# --- flags ----------------------------------------------------------------------------------------
# The same bits on every machine: no contraction, no fast-math (architecture of the arithmetic:
# kernels/kernels.h).
ARITH  := -ffp-contract=off -fno-math-errno -fno-trapping-math
ERRORS := $(if $(filter-out 0,$(WERROR)),-Werror)
WARN   := -Wall -Wextra -Wpedantic -Wshadow -Wvla -Walloca -Wstrict-prototypes \
          -Wpointer-arith -Wno-unused-function -Wno-missing-field-initializers $(ERRORS)
SANF   := $(if $(SAN),-fsanitize=$(SAN) -fno-sanitize-recover=all -fno-omit-frame-pointer)
OPT    ?= $(if $(SAN),-O1,-O2)
OPT_KERNELS ?= $(if $(SAN),-O1,-O3)
upper   = $(shell echo $(1) | tr a-z A-Z)
HAVE   := $(foreach i,$(BOARD_ISAS),-DSV_HAVE_$(call upper,$(i))=1)
COMMON := -std=c11 $(DEBUG) -I. $(ARITH) $(WARN) $(HAVE) $(SANF) $(SYSROOT_FLAG) $(BOARD_CFLAGS)
CORE_CFLAGS   := $(COMMON) $(OPT) -fstack-usage
KERNEL_CFLAGS := $(COMMON) $(OPT_KERNELS) -fstack-usage
HOST_CFLAGS   := $(COMMON) $(OPT) -D_GNU_SOURCE
# Long functions without loops, of more vectors than there are registers: ordered before registers are given out, more of
# their chains run side by side.
PROJECT_CFLAGS := $(if $(IS_CLANG),,-fschedule-insns -fsched-pressure)
# Only here do board, platform and runtime meet, so only here the board's sizes are visible.
BOARD_HDR     := -include boards/$(BOARD)/board.h $(if $(HAVE_BENCH),-DBOARD_HAS_BENCH)
LDFLAGS_ALL   := $(SANF) $(SYSROOT_FLAG) -Wl,--as-needed $(LDFLAGS)
SOLVE_CFLAGS  := -std=c11 $(DEBUG) -I. $(filter-out -Wpedantic,$(WARN)) $(SANF) $(SYSROOT_FLAG) $(OPT) -D_GNU_SOURCE
SOLVE_CXXFLAGS := -std=c++17 $(DEBUG) -I. -Wall -Wextra $(ERRORS) $(SANF) $(SYSROOT_FLAG) $(OPT)
LIBS          := $(BOARD_LIBS) -ljpeg -lpng -lz -lpthread -lm
ISA_sse41  := -msse4.1
ISA_avx2   := -mavx2 -mfma -mbmi -mbmi2 -mlzcnt -mpopcnt
ISA_avx512 := -mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma -mbmi -mbmi2 -mlzcnt -mpopcnt -mprefer-vector-width=512
# GCC for AArch64 orders instructions before registers are given out; vectors of four registers then go to the stack.
ISA_neon   := $(if $(IS_CLANG),,-fno-schedule-insns)

# --- sources --------------------------------------------------------------------------------------
obj = $(patsubst %.cc,$(O)/obj/%.o,$(patsubst %.c,$(O)/obj/%.o,$(1)))
KERNEL_SRC := $(filter-out %_sse41.c %_avx2.c %_avx512.c %_neon.c,$(wildcard kernels/*.c kernels/*/*.c)) \
  $(foreach i,$(BOARD_ISAS),$(wildcard kernels/*/*_$(i).c))
CORE_SRC   := $(wildcard src/*/*.c calib/*.c) $(KERNEL_SRC)
BENCH_SRC  := $(wildcard tools/bench/*.c)
MAIN_SRC   := $(filter-out $(if $(HAVE_BENCH),,boards/cmd_bench.c),$(wildcard boards/*.c))
PREVIEW_SRC := $(wildcard platform/preview/*.c)
TOOL_SRC   := $(wildcard tools/lab/*.c tools/common/*.c tools/import/*.c tools/metric/*.c)
TEST_SRC   := $(wildcard tests/*/*.c)
# Calibration's libraries come from the distribution. What is missing is left out: of calib/solve the files
# named *_LIB.c or .cc need LIB, and *_LIB_none.c stands in for them and says so when it is called.
INC_DIR    := $(SYSROOT)/usr/include
have        = $(if $(filter minimal,$(WITH)),,$(if $(filter $(words $(1)),$(words $(wildcard $(addprefix $(INC_DIR)/,$(1))))),1))
have_cxx    = $(if $(shell command -v $(CXX)),$(call have,$(1)))
HAVE_libcamera := $(call have_cxx,libcamera/libcamera/libcamera.h)
PLAT_SRC   := $(foreach p,$(BOARD_PLATFORMS),$(wildcard platform/$(p)/*.c $(if $(HAVE_$(p)),platform/$(p)/*.cc)))
ifneq ($(filter libcamera,$(BOARD_PLATFORMS))$(HAVE_libcamera),libcamera)
PLAT_SRC   := $(filter-out platform/libcamera/libcamera_none.c,$(PLAT_SRC))
LIBS       += $(if $(HAVE_libcamera),-lcamera -lcamera-base -lstdc++)
endif
SOLVE_LIBS_mrcal     := -lmrcal -lcholmod
SOLVE_LIBS_opencv    := -lopencv_calib3d -lopencv_video -lopencv_features2d -lopencv_imgproc -lopencv_core
SOLVE_LIBS_mrgingham := -lmrgingham -lopencv_core
SOLVE_LIBS_opengv    := -lopengv
HAVE_mrcal     := $(call have,mrcal/mrcal.h suitesparse/cholmod.h)
HAVE_opencv    := $(call have_cxx,opencv4/opencv2/calib3d.hpp opencv4/opencv2/video.hpp)
HAVE_mrgingham := $(call have_cxx,mrgingham/mrgingham.hh opencv4/opencv2/core.hpp)
HAVE_opengv    := $(call have_cxx,opengv/types.hpp eigen3/Eigen/Core)
SOLVE_ALL  := mrcal opencv mrgingham opengv
SOLVE_SRC  := $(filter-out $(foreach l,$(SOLVE_ALL),%_$(l).c %_$(l)_none.c),$(wildcard calib/solve/*.c)) \
  $(foreach l,$(SOLVE_ALL),$(wildcard $(if $(HAVE_$(l)),calib/solve/*_$(l).c calib/solve/*_$(l).cc,\
  calib/solve/*_$(l)_none.c)))
SOLVE_LIBS := $(foreach l,$(SOLVE_ALL),$(if $(HAVE_$(l)),$(SOLVE_LIBS_$(l)))) \
  $(if $(HAVE_opencv)$(HAVE_mrgingham)$(HAVE_opengv),-lstdc++)
CAL_SRC    := $(wildcard tools/calibrate/*.c)
# A file with main() is a program; the other files of its folder are linked to all programs of the folder.
MAIN_RE    := ^(int )?main ?\(
MAINS      := $(shell grep -lE '$(MAIN_RE)' /dev/null $(TOOL_SRC) $(CAL_SRC) $(TEST_SRC))
LAB_MAIN   := $(filter $(MAINS),$(wildcard tools/lab/*.c))
CAL_MAIN   := $(filter $(MAINS),$(CAL_SRC))
HELPER_SRC := $(filter-out $(MAINS),$(TOOL_SRC))
# Linked to tests alone (tools/lint/links.sh checks): a program needs nothing that only the tests need.
TEST_HELPER_SRC := $(filter-out $(MAINS),$(wildcard tests/common/*.c))
# The malloc interposer goes only to the programs that ask for it: anywhere else it would be picked up
# unasked.
HEAP_SRC   := $(filter-out $(MAINS),$(wildcard tests/fault/heap_*.c))
HEAP_USERS := $(shell grep -lF '"tests/fault/heap_count.h"' /dev/null $(filter $(MAINS),$(TEST_SRC)))
# Tests of these parts are linked with their libraries.
SOLVE_USERS := $(shell grep -lE '"(calib/solve|tools/calibrate)/' /dev/null $(filter $(MAINS),$(TEST_SRC)))
ALL_OBJ    := $(call obj,$(CORE_SRC) $(PLAT_SRC) $(PREVIEW_SRC) $(MAIN_SRC) $(BENCH_SRC) $(TOOL_SRC) $(CAL_SRC) $(SOLVE_SRC) $(TEST_SRC))

CORE    := $(O)/libcore.a
ARCHIVES := $(O)/libtools.a $(O)/libbench.a $(O)/libplatform.a $(CORE)
TEST_ARCHIVES := $(O)/libtests.a $(ARCHIVES)
PROGRAMS := $(if $(MAIN_SRC),$(O)/bin/subview) $(if $(LAB_MAIN),$(O)/bin/subview-lab)
ifneq ($(WITH),minimal)
PROGRAMS += $(if $(PREVIEW_SRC),$(O)/bin/subview-preview) $(if $(CAL_MAIN),$(O)/bin/subview-calibrate)
endif
ifneq ($(filter-out all minimal,$(WITH)),)
$(error WITH is all or minimal, not $(WITH))
endif

.DEFAULT_GOAL := all
.DELETE_ON_ERROR:
.PHONY: all programs tests-build conform demo demo-live test test-all check bench accept-counts mca kernels-check grad scenario golden \
  fault fuzz unit only board-test bare-test headers lint format format-check tidy plan clean deps help install man cross FORCE

all: $(CORE) $(PROGRAMS) tests-build ## build the runtime, the tools and the tests for BOARD
programs: $(CORE) $(PROGRAMS) ## build the runtime and the tools only

# --- compiling ------------------------------------------------------------------------------------
# Objects depend on this file, which changes when a flag does: no stale objects, no rebuild for a comment
# here.
FLAGS_NOW := $(CC) $(CORE_CFLAGS) $(KERNEL_CFLAGS) $(PROJECT_CFLAGS) $(HOST_CFLAGS) $(LDFLAGS_ALL) $(LIBS) $(ISA_avx2) $(ISA_avx512) $(ISA_neon) $(SOLVE_LIBS)
$(O)/flags: FORCE
	@mkdir -p $(@D); echo '$(FLAGS_NOW)' | cmp -s - $@ || echo '$(FLAGS_NOW)' > $@
$(ALL_OBJ): $(O)/flags | $(SYSROOT_STAMP)

compile = @mkdir -p $(@D); $(if $(V),echo $(CC) $(1) $<;) $(CC) -MMD -MP $(1) -c $< -o $@
define isa_rule
$(O)/obj/kernels/%_$(1).o: kernels/%_$(1).c
	$$(call compile,$$(ISA_$(1)) $$(KERNEL_CFLAGS))
endef
$(foreach i,$(BOARD_ISAS),$(eval $(call isa_rule,$(i))))
$(foreach i,$(BOARD_ISAS),$(eval $(O)/obj/tests/kernels/v16_probe_$(i).o: HOST_CFLAGS += $(ISA_$(i))))
# GCC 12 for AArch64 at -O3 moves a copy of one struct over another's (tests/kernels/check_v16.c found it); the reference
# of the vocabulary is compiled without that freedom.
$(O)/obj/tests/kernels/v16_probe_ref.o: HOST_CFLAGS += -fno-strict-aliasing
$(O)/obj/kernels/%.o: kernels/%.c
	$(call compile,$(KERNEL_CFLAGS))
$(O)/obj/kernels/project/%.o: KERNEL_CFLAGS += $(PROJECT_CFLAGS)
$(O)/obj/platform/%.o: platform/%.cc
	@mkdir -p $(@D); $(CXX) -MMD -MP $(SOLVE_CXXFLAGS) -isystem $(INC_DIR)/libcamera -c $< -o $@
$(O)/obj/platform/%.o: platform/%.c
	$(call compile,$(HOST_CFLAGS))
$(O)/obj/boards/%.o: boards/%.c
	$(call compile,$(HOST_CFLAGS) $(BOARD_HDR))
$(O)/obj/tools/%.o: tools/%.c
	$(call compile,$(HOST_CFLAGS) $(BOARD_HDR))
$(O)/obj/tests/%.o: tests/%.c
	$(call compile,$(HOST_CFLAGS) $(BOARD_HDR))
$(O)/obj/calib/solve/%.o: calib/solve/%.c
	$(call compile,$(SOLVE_CFLAGS))
$(O)/obj/calib/solve/%.o: calib/solve/%.cc
	@mkdir -p $(@D); $(CXX) -MMD -MP $(SOLVE_CXXFLAGS) -isystem $(INC_DIR)/opencv4 -isystem $(INC_DIR)/eigen3 \
	  -c $< -o $@
$(O)/obj/%.o: %.c
	$(call compile,$(CORE_CFLAGS))
-include $(ALL_OBJ:.o=.d)
# Files that the assembler includes: the compiler does not list them.
$(O)/obj/platform/preview/bundle.o: $(wildcard platform/preview/page/*)
$(O)/obj/tools/metric/lpips_weights.o: tools/weights/lpips_squeeze.bin

# An archive is made anew when its list of members changes, too: a deleted source must not live on in it.
define archive_rule
$(O)/$(1).list: FORCE
	@mkdir -p $$(@D); echo '$(2)' | cmp -s - $$@ || echo '$(2)' > $$@
$(O)/$(1).a: $(2) $(O)/$(1).list
	@rm -f $$@; $$(AR) rcs $$@ $(2)
endef
$(eval $(call archive_rule,libcore,$(call obj,$(CORE_SRC))))
$(eval $(call archive_rule,libplatform,$(call obj,$(PLAT_SRC))))
$(eval $(call archive_rule,libbench,$(call obj,$(BENCH_SRC))))
$(eval $(call archive_rule,libtools,$(call obj,$(HELPER_SRC))))
$(eval $(call archive_rule,libtests,$(call obj,$(TEST_HELPER_SRC))))
$(eval $(call archive_rule,libcalibrate,$(call obj,$(filter-out $(MAINS),$(CAL_SRC)) $(SOLVE_SRC))))

# --- programs -------------------------------------------------------------------------------------
# Libraries that may be missing: the part then says so when it is called. Looked up when a program is linked, as the
# sysroot may be made by the same make.
has_lib = $(if $(wildcard $(SYSROOT)/usr/include/$(1)),$(2))
link = @mkdir -p $(@D); $(if $(V),echo link $@;) $(CC) $(filter %.o,$^) $(filter %.a,$^) $(LDFLAGS_ALL) $(1) \
  $(LIBS) $(call has_lib,zstd.h,-lzstd) $(call has_lib,webp/mux.h,-lwebpmux -lwebpdemux -lwebp) -o $@
$(O)/bin/subview: $(call obj,$(MAIN_SRC)) $(if $(HAVE_BENCH),$(O)/libbench.a) $(O)/libplatform.a $(CORE)
	$(call link)
$(O)/bin/subview-preview: $(call obj,$(PREVIEW_SRC)) $(O)/libplatform.a $(CORE)
	$(call link,$(call has_lib,microhttpd.h,-lmicrohttpd) $(call has_lib,seccomp.h,-lseccomp))
$(O)/bin/subview-lab: $(call obj,$(LAB_MAIN)) $(ARCHIVES)
	$(call link)
$(O)/bin/subview-calibrate: $(call obj,$(CAL_MAIN)) $(O)/libcalibrate.a $(ARCHIVES)
	$(call link,$(SOLVE_LIBS))

# --- tests ----------------------------------------------------------------------------------------
GROUPS_PLAIN := unit grad golden fault scenario budget
progs_of = $(patsubst %.c,$(O)/%,$(filter $(MAINS),$(wildcard tests/$(1)/*.c)))
define group_rules
PROGS_$(1) := $(call progs_of,$(1))
$(call progs_of,$(1)): $(O)/tests/$(1)/%: $(O)/obj/tests/$(1)/%.o \
  $(call obj,$(filter-out $(MAINS) $(HEAP_SRC),$(wildcard tests/$(1)/*.c))) $(TEST_ARCHIVES)
	$$(call link,-lcmocka $$(SOLVE_LIBS_HERE))
endef
$(foreach g,$(GROUPS_PLAIN),$(if $(call progs_of,$(g)),$(eval $(call group_rules,$(g)))))
$(patsubst %.c,$(O)/%,$(HEAP_USERS)): $(call obj,$(HEAP_SRC))

$(patsubst %.c,$(O)/%,$(SOLVE_USERS)): SOLVE_LIBS_HERE = $(O)/libcalibrate.a $(TEST_ARCHIVES) $(SOLVE_LIBS)
$(patsubst %.c,$(O)/%,$(SOLVE_USERS)): $(O)/libcalibrate.a

KERNEL_TEST_SRC := $(wildcard tests/kernels/*.c)
PROGS_kernels := $(if $(KERNEL_TEST_SRC),$(O)/tests/kernels-check)
$(O)/tests/kernels-check: $(call obj,$(KERNEL_TEST_SRC)) $(TEST_ARCHIVES)
	$(call link)

FUZZ_SRC   := $(wildcard tests/fuzz/fuzz_*.c)
PROGS_fuzz := $(FUZZ_SRC:%.c=$(O)/%)
$(PROGS_fuzz): $(O)/tests/fuzz/%: $(O)/obj/tests/fuzz/%.o \
  $(call obj,$(filter-out $(FUZZ_SRC),$(wildcard tests/fuzz/*.c))) $(TEST_ARCHIVES)
	$(call link)

# The source suite and faults on cameras that are there; the virtual board runs them.
PROGS_conform := $(O)/tests/source-check $(O)/tests/source-faults
$(O)/tests/source-check: $(call obj,tests/conform/source_check.c) $(TEST_ARCHIVES)
	$(call link)
$(O)/tests/source-faults: $(call obj,tests/conform/source_faults.c tests/conform/inject.c) $(TEST_ARCHIVES)
	$(call link)

ALL_PROGS := $(foreach g,$(GROUPS_PLAIN) kernels fuzz,$(PROGS_$(g)))
tests-build: $(ALL_PROGS) $(PROGS_conform)
conform: $(PROGS_conform)
PROGS_lint := $(CORE) $(PROGRAMS)

# What a group runs: one line "label<TAB>command" each. A leading "!" asks to be run with nothing beside it.
TAB := $(shell printf '\t')
define NL


endef
LINTS := files words includes headers symbols stack links format
LINT_ENV = CC='$(CC) $(SYSROOT_FLAG)' OBJDUMP='$(OBJDUMP)' SAN='$(SAN)'
ITEMS_lint  = $(foreach l,$(LINTS),lint/$(l)$(TAB)$(LINT_ENV) tools/lint/$(l).sh \
  $(if $(filter symbols stack links,$(l)),$(O))$(NL)) lint/selftest$(TAB)tests/run/selftest.sh$(NL)
# Building and emulating takes a while longer than other checks.
ITEMS_cross = cross/generic-arm64$(TAB)BUILD='$(BUILD)' tests/run/cross.sh generic-arm64$(TAB)1500$(NL)
ITEMS_budget = $(foreach p,$(PROGS_budget),!$(p:$(O)/tests/%=%)$(TAB)$(EMULATE) $(p)$(NL))
FUZZ_ARGS ?=
ITEMS_fuzz = $(foreach p,$(PROGS_fuzz),$(p:$(O)/tests/%=%)$(TAB)$(EMULATE) $(p) $(FUZZ_ARGS)$(NL))
items = $(or $(ITEMS_$(1)),$(foreach p,$(PROGS_$(1)),$(p:$(O)/tests/%=%)$(TAB)$(EMULATE) $(p)$(NL)))
run_groups = $(shell mkdir -p $(O)/run)$(file >$(O)/run/$(1).list,$(foreach g,$(2),$(call items,$(g)))) \
  @tests/run/run.sh -j $(JOBS) -o $(O)/run/$(1) $(O)/run/$(1).list
# Some tests run the programs themselves.
define run_rule
$(1): $(foreach g,$(2),$(PROGS_$(g))) $(if $(filter scenario fault budget named,$(2)),$(PROGRAMS)) | $(SYSROOT_STAMP)
	$$(call run_groups,$(1),$(2))
endef

# What make already runs in parallel keeps its jobs; otherwise the inner make takes all cores.
PARALLEL = $(if $(findstring jobserver,$(MAKEFLAGS)),,-j$(JOBS))
demo: ## install what is missing, build, run the main job on the simulator
	@WITH='$(WITH)' tools/deps/install.sh build
	@+$(MAKE) --no-print-directory $(PARALLEL) programs
	@tools/demo.sh '$(O)/bin'
PORT ?= 8080
demo-live: ## the same build, then the live page on the simulator at 127.0.0.1:8080 (PORT=8080) until Ctrl-C
	@tools/deps/install.sh build
	@+$(MAKE) --no-print-directory $(PARALLEL) programs
	@tools/demo_live.sh '$(O)/bin' '$(PORT)'
test: ## install what is missing, build, run every lint and test; ends with N passed, N failed, N skipped
	@[ '$(WITH)' != minimal ] || { echo "make test: the tests are of all features, so not with WITH=minimal" >&2; exit 2; }
	@WITH='$(WITH)' tools/deps/install.sh test
	@+$(MAKE) --no-print-directory $(PARALLEL) test-all
ifeq ($(BOARD_ARCH)$(SAN),$(HOST_ARCH))
ALL_GROUPS := lint unit kernels grad golden fault fuzz scenario cross budget
else
ALL_GROUPS := unit kernels grad golden fault fuzz scenario
endif
$(eval $(call run_rule,test-all,$(ALL_GROUPS)))
test-all: programs
# For tests that start a program: where the programs are, and what to put before them when they are foreign.
export SV_BIN := $(O)/bin
export SV_EMULATE := $(EMULATE)
check: ## the fast tests: unit, kernels, grad
$(eval $(call run_rule,check,unit kernels grad))
unit: ## the unit tests
$(eval $(call run_rule,unit,unit))
kernels-check: ## every kernel variant against its reference
$(eval $(call run_rule,kernels-check,kernels))
grad: ## every backward against double and central differences
$(eval $(call run_rule,grad,grad))
scenario: ## the whole runtime on the simulator and a virtual clock
$(eval $(call run_rule,scenario,scenario))
golden: ## digests that must be equal on every machine
$(eval $(call run_rule,golden,golden))
fault: ## failures injected at every port call, power cuts, heap use
$(eval $(call run_rule,fault,fault))
fuzz: ## every parser on damaged files, a short run
$(eval $(call run_rule,fuzz,fuzz))
lint: ## includes, headers, sizes, words, symbols, stack, format
$(eval $(call run_rule,lint,lint))
only: ## the groups or tests named: make only GROUPS="unit golden", make only TESTS=scenario/test_run
GROUPS ?= $(if $(TESTS),named,unit)
PROGS_named := $(addprefix $(O)/tests/,$(TESTS))
$(eval $(call run_rule,only,$(GROUPS)))
cross: ## the fast tests and the digests for arm64, emulated
	@BUILD='$(BUILD)' tests/run/cross.sh generic-arm64
# The sysroot comes first: what it has decides what is built.
board-test: ## capture and train on a virtual ARM board with cameras (QEMU); under 5 minutes, 4 more the first time
	@WITH='$(WITH)' tools/deps/install.sh board
	@+$(MAKE) --no-print-directory '$(BUILD)/sysroot-arm64/.complete'
	@+$(MAKE) --no-print-directory BOARD=generic-arm64 SAN= $(PARALLEL) programs conform
	@tests/board/run.sh '$(BUILD)' '$(BUILD)/generic-arm64'
bare-test: ## the README's commands on minimal Debian 12 and 13 systems (needs root); RUNS=trixie: one of them
	@tools/deps/install.sh bare
	@tests/bare/bare.sh '$(BUILD)' $(RUNS)
bench: programs $(PROGS_kernels) ## time the kernels (also into kernels.csv), whole steps and their stages
	@$(if $(PROGS_kernels),$(EMULATE) $(PROGS_kernels) --bench | tee $(O)/kernels.csv)
	@$(if $(LAB_MAIN),$(EMULATE) $(O)/bin/subview-lab bench)
accept-counts: $(O)/tests/budget/test_budget_counts ## take the instructions counted now as those a step may take
	@$< --accept
mca: ## predicted cycles of the kernels on ARM cores, and the steps that follow (llvm-mca)
	@neon='$(ISA_neon)' avx2='$(ISA_avx2)' avx512='$(ISA_avx512)' project='$(PROJECT_CFLAGS)' tools/mca/mca.sh $(if $(V),-v)
plan: $(O)/bin/subview ## the board's memory map; fails when it does not fit
	@$(EMULATE) $< plan

# --- the sources themselves -----------------------------------------------------------------------
headers: ## each header alone, as C and as C++
	@CC='$(CC) $(SYSROOT_FLAG)' tools/lint/headers.sh
format: ## clang-format everything in place
	@tools/lint/format.sh --fix
format-check: ## tell which files clang-format would change
	@tools/lint/format.sh
tidy: ## clang-tidy and cppcheck
	@HAVE='$(HAVE)' tools/lint/tidy.sh

# --- the machine ----------------------------------------------------------------------------------
deps: ## install what the build and the tests need from the distribution's packages
	@WITH='$(WITH)' tools/deps/install.sh test
$(BUILD)/sysroot-%/.complete: tools/deps/sysroot.sh
	@tools/deps/sysroot.sh $* $(BUILD)/sysroot-$*
man: programs ## man pages from the programs' own --help, in build/BOARD/man
	@EMULATE='$(EMULATE)' tools/man/man.sh $(O)/bin $(O)/man
install: programs man ## copy the programs and their man pages to PREFIX (and DESTDIR)
	@install -d '$(DESTDIR)$(PREFIX)/bin'
	@install $(PROGRAMS) '$(DESTDIR)$(PREFIX)/bin'
	@install -d '$(DESTDIR)$(PREFIX)/share/man/man1'
	@install -m 644 $(O)/man/*.1 '$(DESTDIR)$(PREFIX)/share/man/man1'
	@install -d '$(DESTDIR)$(PREFIX)/share/bash-completion/completions'
	@for p in subview subview-lab subview-calibrate; do install -m 644 tools/completion/subview.bash \
	  "$(DESTDIR)$(PREFIX)/share/bash-completion/completions/$$p"; done
clean: ## remove what was built for BOARD
	@rm -rf $(O)
help: ## this list
	@grep -hE '^[a-z-]+:.*##' $(firstword $(MAKEFILE_LIST)) | sed -E 's/:.*##/\t/' | sort | \
	  awk -F '\t' '{ printf "  %-14s %s\n", $$1, $$2 }'
	@echo "boards: $(BOARDS)"
