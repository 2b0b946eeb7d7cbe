# SPDX-License-Identifier: Apache-2.0
# From sources to objects and archives.
.DELETE_ON_ERROR:
.PHONY: FORCE

# Objects depend on this file, which is written only when a flag changes.
FLAGS_NOW := $(CC) $(CORE_CFLAGS) $(KERNEL_CFLAGS) $(PROJECT_CFLAGS) $(HOST_CFLAGS) $(LDFLAGS_ALL) $(LIBS) \
  $(foreach i,$(BOARD_ISAS),$(ISA_$(i))) $(SOLVE_LIBS)
$(O)/flags: FORCE
	@mkdir -p $(@D); echo '$(FLAGS_NOW)' | cmp -s - $@ || echo '$(FLAGS_NOW)' > $@
$(ALL_OBJ): $(O)/flags | $(SYSROOT_STAMP)

compile = @mkdir -p $(@D); $(if $(V),echo $(CC) $(1) $<;) $(CC) -MMD -MP $(1) -c $< -o $@
compile_cxx = @mkdir -p $(@D); $(if $(V),echo $(CXX) $(1) $<;) $(CXX) -MMD -MP $(CXXFLAGS_ALL) $(1) -c $< -o $@
$(O)/obj/shared/%.o: %.cc
	$(call compile_cxx,$(SHARED_CFLAGS) -isystem $(INC_DIR)/libcamera)
$(O)/obj/shared/calib/solve/%.o: calib/solve/%.cc
	$(call compile_cxx,$(SHARED_CFLAGS) -isystem $(INC_DIR)/opencv4)
$(O)/obj/shared/%.o: %.c
	$(call compile,$(HOST_CFLAGS) $(SHARED_CFLAGS))
$(O)/obj/platform/%.o: platform/%.c
	$(call compile,$(HOST_CFLAGS))
$(O)/obj/boards/%.o: boards/%.c
	$(call compile,$(HOST_CFLAGS) $(BOARD_HDR))
$(O)/obj/tools/%.o: tools/%.c
	$(call compile,$(HOST_CFLAGS) $(BOARD_HDR))
$(O)/obj/tools/%.o: tools/%.cc
	$(call compile_cxx,-isystem $(INC_DIR)/opencv4)
$(O)/obj/tests/%.o: tests/%.c
	$(call compile,$(HOST_CFLAGS) $(BOARD_HDR))
$(O)/obj/calib/solve/%.o: calib/solve/%.c
	$(call compile,$(SOLVE_CFLAGS))
$(O)/obj/calib/solve/%.o: calib/solve/%.cc
	$(call compile_cxx,-isystem $(INC_DIR)/opencv4 -isystem $(INC_DIR)/eigen3)
$(O)/obj/%.o: %.c
	$(call compile,$(CORE_CFLAGS))
$(O)/obj/src/metric/%.o: CORE_CFLAGS += $(OPT_KERNELS)
-include $(ALL_OBJ:.o=.d)
# Files that the assembler includes: the compiler does not list them.
$(O)/obj/platform/preview/bundle.o: $(wildcard platform/preview/page/*)
$(O)/obj/tools/metric/lpips_weights.o: tools/weights/lpips_squeeze.bin

# archive_rule NAME,OBJECTS. A changed list of members makes the archive anew: a deleted source must
# not live on in it.
define archive_rule
$(O)/$(1).list: FORCE
	@mkdir -p $$(@D); echo '$(2)' | cmp -s - $$@ || echo '$(2)' > $$@
$(O)/$(1).a: $(2) $(O)/$(1).list
	@rm -f $$@; $$(AR) rcs $$@ $(2)
endef
