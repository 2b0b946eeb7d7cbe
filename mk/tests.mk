# SPDX-License-Identifier: Apache-2.0
# Tests: tests/GROUP/test_*.c are programs of their own; the other files of a group's folder are
# linked to all of its programs, tests/common to all of all groups.
GROUPS_PLAIN := unit grad golden fault scenario budget

# Programs that count or forbid heap calls are linked with the malloc interposer; any other program
# would be interposed unasked.
HEAP_SRC   := tests/fault/heap_count.c
HEAP_USERS := fault/test_hostile_jpeg fault/test_heap_live fault/test_heap_run fault/test_v4l2_faults \
  unit/test_codec unit/test_linux unit/test_heap_count unit/test_replay
# Programs that are linked with calibration and its libraries.
SOLVE_USERS := unit/test_boards unit/test_rig_pose unit/test_calib_mrcal unit/test_lenslets \
  scenario/test_real_boards scenario/test_fisheye_rig scenario/test_lenslet_rig scenario/test_shutter_rig scenario/test_calibrate_page \
  scenario/test_photometric_rig

# Programs alone must not need tests/common (tools/lint/links.sh checks).
$(eval $(call archive_rule,libtests,$(call obj,$(call c_files,tests/common))))
TEST_ARCHIVES := $(O)/libtests.a $(ARCHIVES)

group_main = $(foreach f,$(call c_files,tests/$(1)),$(if $(filter test_%,$(notdir $(f))),$(f)))
define group_rules
PROGS_$(1) := $(patsubst %.c,$(O)/%,$(call group_main,$(1)))
$$(PROGS_$(1)): $(O)/tests/$(1)/%: $(O)/obj/tests/$(1)/%.o \
  $(call obj,$(filter-out $(call group_main,$(1)) $(HEAP_SRC),$(call c_files,tests/$(1)))) $(TEST_ARCHIVES)
	$$(call link,-lcmocka $$(SOLVE_LIBS_HERE))
endef
$(foreach g,$(GROUPS_PLAIN),$(if $(call group_main,$(g)),$(eval $(call group_rules,$(g)))))
# Programs that are linked with a part of subview-preview.
SANDBOX_USERS := unit/test_sandbox

# Minutes of solving each under emulation: only where the programs are not foreign, or by name.
ifneq ($(EMULATE),)
PROGS_unit := $(filter-out %/test_boards %/test_lenslets,$(PROGS_unit))
endif

$(HEAP_USERS:%=$(O)/tests/%): $(call obj,$(HEAP_SRC))
$(SANDBOX_USERS:%=$(O)/tests/%): $(call obj,platform/preview/sandbox.c)
$(O)/tests/unit/test_page_scans: $(call obj,platform/preview/scans.c platform/preview/scans_helper.c \
  platform/preview/sandbox.c)
$(O)/tests/unit/test_page_scans: SOLVE_LIBS_HERE = $(call has_lib,seccomp.h,-lseccomp)
$(O)/tests/unit/test_control: $(call obj,platform/preview/control.c)
$(O)/tests/unit/test_pin: $(call obj,platform/preview/pin.c)
$(SANDBOX_USERS:%=$(O)/tests/%): SOLVE_LIBS_HERE = $(call has_lib,seccomp.h,-lseccomp)
$(SOLVE_USERS:%=$(O)/tests/%): SOLVE_LIBS_HERE = $(O)/libcalibrate.a $(TEST_ARCHIVES) $(SOLVE_LIBS)
$(SOLVE_USERS:%=$(O)/tests/%): $(O)/libcalibrate.a

# Preloaded into programs by these tests: a system call of a save fails, pauses are short.
SAVE_FAULTS := $(O)/tests/save_faults.so
$(SAVE_FAULTS): $(O)/obj/shared/tests/preload/save_faults.o
	@mkdir -p $(@D); $(CC) -shared $< $(SYSROOT_FLAG) -o $@
$(O)/obj/shared/tests/preload/save_faults.o: SHARED_CFLAGS = -fPIC
$(O)/tests/fault/test_save_calls $(O)/tests/fault/test_saving: | $(SAVE_FAULTS)

PROGS_kernels := $(O)/tests/kernels-check
$(PROGS_kernels): $(call obj,$(filter tests/kernels/%,$(TEST_SRC))) $(PROBE_OBJ) $(TEST_ARCHIVES)
	$(call link)

include mk/fuzz.mk

# The source suite and fault injection on cameras that are present; the virtual board runs them.
PROGS_conform := $(O)/tests/source-check $(O)/tests/source-faults $(if $(HAVE_display),$(O)/tests/display-check)
$(O)/tests/display-check: $(call obj,tests/conform/display_check.c) $(TEST_ARCHIVES)
	$(call link,-lcmocka)
$(O)/tests/source-check: $(call obj,tests/conform/source_check.c) $(TEST_ARCHIVES)
	$(call link)
$(O)/tests/source-faults: $(call obj,tests/conform/source_faults.c tests/conform/inject.c) $(TEST_ARCHIVES)
	$(call link)

# Plays back what the virtual board wrote to its disk, up to a power cut (make deploy-test).
DISK_CUTS := $(O)/tests/disk-cuts
$(DISK_CUTS): $(call obj,tests/deploy/disk_cuts.c) $(TEST_ARCHIVES)
	$(call link)

# Long runs (make soak, make soak-sim).
PROGS_soak := $(O)/tests/live-soak $(O)/tests/process-soak $(O)/tests/ring-stress
$(O)/tests/ring-stress: $(call obj,tests/soak/ring_stress.c) $(TEST_ARCHIVES)
	$(call link)
$(O)/tests/process-soak: $(call obj,tests/soak/process_soak.c) $(TEST_ARCHIVES)
	$(call link)
$(O)/tests/live-soak: $(call obj,tests/soak/live_soak.c) $(TEST_ARCHIVES)
	$(call link,-lcmocka)

# Digests of every stage of every step, to find the first that differs between two builds.
PROGS_digests := $(O)/tests/stage-digests
$(PROGS_digests): $(call obj,tests/digests/stage_digests.c) $(TEST_ARCHIVES)
	$(call link,-lcmocka)

PROGS_lint  := $(CORE) $(PROGRAMS)
# Both items may run at once, and each would make it.
PROGS_library := $(O)/lib/libsubview.a
PROGS_package := $(PROGS_library)
PROGS_named := $(addprefix $(O)/tests/,$(TESTS))

# What `make only` is asked for has to be there.
ifneq ($(filter only,$(MAKECMDGOALS)),)
KNOWN_GROUPS := $(GROUPS_PLAIN) kernels fuzz lint cross library package soak named
$(foreach g,$(filter-out $(KNOWN_GROUPS),$(GROUPS)),$(error no group $(g) of tests; the groups are: $(filter-out named,$(KNOWN_GROUPS))))
KNOWN_TESTS := $(foreach g,$(GROUPS_PLAIN) kernels fuzz conform soak,$(PROGS_$(g):$(O)/tests/%=%))
$(foreach t,$(filter-out $(KNOWN_TESTS),$(TESTS)),$(if $(wildcard tests/$(t).c),,\
  $(error no test $(t); those of a group are tests/GROUP/test_NAME.c, as TESTS=GROUP/test_NAME)))
endif

.PHONY: tests-build conform
tests-build: $(foreach g,$(GROUPS_PLAIN) kernels fuzz conform digests soak,$(PROGS_$(g)))
conform: $(PROGS_conform)

# --- running ----------------------------------------
# Tests that start a program read these: where the programs are, and what to put before them when
# they are foreign.
export SV_BIN := $(O)/bin
export SV_EMULATE := $(EMULATE)

# A group's list for tests/run/run.sh: one line an item, "label\tcommand" or
# "label\tcommand\tseconds". An item whose label begins with "!" runs alone.
LINTS := files words terms width statements includes headers symbols stack links docs format
LINT_ENV := CC='$(CC) $(SYSROOT_FLAG)' OBJDUMP='$(OBJDUMP)' SAN='$(SAN)'
item = "$(1)\t$(2)$(if $(3),\t$(3))"
ITEMS_lint = $(foreach l,$(LINTS),$(call item,lint/$(l),$(LINT_ENV) tools/lint/$(l).sh \
  $(if $(filter symbols stack links,$(l)),$(O)))) $(call item,lint/selftest,tests/run/selftest.sh)
# Building and emulating takes longer than other checks.
ITEMS_cross = $(call item,cross/generic-arm64,BUILD='$(BUILD)' SUITE='$(SUITE)' tests/run/cross.sh generic-arm64,1500)
# The installed library; one item, as the parts without a system are compared with the first.
ITEMS_library = $(call item,library/installed,BUILD='$(BUILD)' tests/run/library.sh,900)
# Short forms of the long runs.
ITEMS_soak = $(call item,soak/live,$(O)/tests/live-soak 600 1000 20 0.05) \
  $(call item,!soak/process,mkdir -p $(O)/soak && $(O)/tests/process-soak 0.01 $(O)/soak)
ITEMS_package = $(call item,package/built,BUILD='$(BUILD)' O='$(O)' tests/run/packages.sh,600)
# Counted instructions are the same beside other tests.
ITEMS_budget = $(foreach p,$(PROGS_budget),$(call item,$(if $(filter %_counts,$(p)),,!)$(p:$(O)/tests/%=%),$(EMULATE) $(p)))
items = $(or $(ITEMS_$(1)),$(foreach p,$(PROGS_$(1)),$(call item,$(p:$(O)/tests/%=%),$(EMULATE) $(p))))

# run_rule TARGET,GROUPS. Tests of these groups start the programs.
USE_PROGRAMS := scenario fault budget soak named
define run_rule
.PHONY: $(1)
$(1): $(foreach g,$(2),$$(PROGS_$(g))) $(if $(filter $(USE_PROGRAMS),$(2)),$(PROGRAMS) $(MODULES)) | $(SYSROOT_STAMP)
	@mkdir -p $(O)/run
	@printf '%b\n' $$(foreach g,$(2),$$(call items,$$(g))) > $(O)/run/$(1).list
	@tests/run/run.sh -j $(JOBS) -t $(if $(EMULATE),900,300) -o $(O)/run/$(1) $(O)/run/$(1).list
endef
ifeq ($(BOARD_ARCH)$(SAN),$(HOST_ARCH))
# What takes longest comes first, so that it does not run alone at the end.
ALL_GROUPS := cross lint unit kernels grad golden fault fuzz scenario library package soak budget
else
ALL_GROUPS := unit kernels grad golden fault fuzz scenario
endif
$(eval $(call run_rule,test-all,$(ALL_GROUPS)))
$(eval $(call run_rule,check,unit kernels grad))
$(eval $(call run_rule,unit,unit))
$(eval $(call run_rule,kernels-check,kernels))
$(eval $(call run_rule,grad,grad))
$(eval $(call run_rule,scenario,scenario))
$(eval $(call run_rule,golden,golden))
$(eval $(call run_rule,fault,fault))
$(eval $(call run_rule,fuzz,fuzz))
$(eval $(call run_rule,lint,lint))
$(eval $(call run_rule,only,$(GROUPS)))
test-all: programs

.PHONY: stage-digests
stage-digests: $(PROGS_digests)
	@$(EMULATE) $< $(STAGE_ARGS)

.PHONY: test cross board-test bare-test service-test slurm-test deploy-test deploy-test-one two-packages accept-counts soak soak-sim live-bench ring-stress
test:
	@[ '$(WITH)' != minimal ] || { echo "make test: the tests are of all features, so not with WITH=minimal" >&2; exit 2; }
	@WITH='$(WITH)' tools/deps/install.sh test
	@+$(MAKE) --no-print-directory $(PARALLEL) test-all
cross:
	@BUILD='$(BUILD)' SUITE='$(SUITE)' tests/run/cross.sh generic-arm64
board-test:
	@WITH='$(WITH)' tools/deps/install.sh board
	@tools/deps/sysroot.sh '$(SUITE)' arm64 '$(BUILD)/sysroot-$(SUITE)-arm64'
	@+$(MAKE) --no-print-directory BOARD=generic-arm64 SAN= $(PARALLEL) runtime conform
	@tests/board/run.sh '$(BUILD)' '$(BUILD)/generic-arm64$(OTHER_SUITE)' '$(BUILD)/sysroot-$(SUITE)-arm64'
bare-test:
	@tools/deps/install.sh bare
	@tests/bare/bare.sh '$(BUILD)' $(RUNS)
# N kills of runs and N / 4 of captures, at random moments; KILL_SEED repeats them.
.PHONY: kill-test
kill-test: $(O)/tests/fault/test_kills programs
	@KILL_N=$(or $(N),1000) $<
# The packages of this machine's release, and the service that they install, started once.
slurm-test: programs
	@tools/deps/install.sh slurm
	@tests/slurm/slurm.sh $(O)/bin/subview-lab || [ $$? = 77 ]
service-test:
	@tools/deps/install.sh test
	@+$(MAKE) --no-print-directory $(PARALLEL) two-packages
	@tests/deploy/native.sh '$(BUILD)' '$(HOST_SUITE)' $(PACKAGES)/subview_*.deb $(O)/second/subview_*.deb
# make deploy by a stand-in for ssh; then for each release: calibration as on this machine, and the
# packages and the service on a board that boots from a disk.
deploy-test:
	@tools/deps/install.sh deploy
	@+$(MAKE) --no-print-directory $(PARALLEL) two-packages
	@tests/deploy/ssh_test.sh '$(BUILD)/deploy/ssh' $(PACKAGES)/subview_*.deb $(O)/second/subview_*.deb
	@+$(MAKE) --no-print-directory $(PARALLEL) programs $(DISK_CUTS)
	@+$(foreach s,bookworm trixie,HERE='$(O)' $(MAKE) --no-print-directory $(PARALLEL) BOARD=generic-arm64 SUITE=$(s) deploy-test-one &&) true
deploy-test-one: two-packages
	@tests/deploy/calibrate.sh '$(O)/bin' '$(EMULATE)' '$(O)'
	@tests/deploy/deploy.sh '$(BUILD)' '$(SUITE)' $(PACKAGES)/subview_*.deb $(O)/second/subview_*.deb \
	  '$(HERE)/bin' '$(HERE)/tests'
# Of two revisions, for upgrades.
two-packages:
	@+$(MAKE) --no-print-directory package REVISION=2
	@rm -rf '$(O)/second' && mv '$(PACKAGES)' '$(O)/second'
	@+$(MAKE) --no-print-directory package
accept-counts: $(O)/tests/budget/test_budget_counts
	@$< --accept
soak: $(PROGS_soak) programs
	@tests/soak/soak.sh real $(O) $(or $(HOURS),1)
soak-sim: $(PROGS_soak)
	@tests/soak/soak.sh sim $(O) $(EXPOSURES)
live-bench: programs
	@tests/soak/live.sh $(O) $(or $(MINUTES),10) $(GAUSSIANS)
ring-stress:
	@+$(MAKE) --no-print-directory SAN=thread '$(BUILD)/$(BOARD)-thread/tests/ring-stress'
	@'$(BUILD)/$(BOARD)-thread/tests/ring-stress' $(or $(OPERATIONS),100000000)
