# SPDX-License-Identifier: Apache-2.0
# Libraries and programs: libcore.a (src, calib, kernels), libplatform.a, libtools.a, and the
# programs in bin/.
ifneq ($(filter-out all minimal,$(WITH)),)
$(error WITH is all or minimal, not $(WITH))
endif
CORE     := $(O)/libcore.a
ARCHIVES := $(O)/libtools.a $(O)/libplatform.a $(CORE)
PROGRAMS := $(O)/bin/subview $(O)/bin/subview-lab
# Opened by `subview` when a libcamera source is asked for: as in an installation, in lib/subview
# beside bin.
CAMERA_MODULE := $(if $(MODULE_CXX),$(O)/lib/subview/subview-libcamera.so)
# Opened by `subview-lab import` when it matches views: OpenCV is loaded by nothing else of it.
MATCH_MODULE := $(if $(HAVE_opencv),$(O)/lib/subview/subview-matches.so)
MODULES  := $(CAMERA_MODULE) $(MATCH_MODULE)
ifneq ($(WITH),minimal)
PROGRAMS += $(O)/bin/subview-preview $(O)/bin/subview-calibrate $(if $(HAVE_dnn),$(O)/bin/subview-depth)
endif

$(eval $(call archive_rule,libcore,$(CORE_OBJ)))
$(eval $(call archive_rule,libplatform,$(call obj,$(PLAT_SRC))))
$(eval $(call archive_rule,libtools,$(call obj,$(HELPER_SRC))))
$(eval $(call archive_rule,libcalibrate,$(call obj,$(filter-out %/main.c,$(CAL_SRC)) $(SOLVE_SRC))))

# Optional libraries are looked up when a program is linked, as the same make may have made the
# sysroot.
has_lib = $(if $(wildcard $(INC_DIR)/$(1)),$(2))
link = @mkdir -p $(@D); $(if $(V),echo link $@;) $(CC) $(filter %.o,$^) $(filter %.a,$^) $(LDFLAGS_ALL) $(1) \
  $(LIBS) $(call has_lib,zstd.h,-lzstd) $(call has_lib,webp/mux.h,-lwebpmux -lwebpdemux -lwebp) \
  $(call has_lib,OpenEXR/openexr.h,-lOpenEXRCore) $(call has_lib,sqlite3.h,-lsqlite3) -o $@
$(O)/bin/subview: $(call obj,$(MAIN_SRC)) $(ARCHIVES)
	$(call link)
$(O)/bin/subview-preview: $(call obj,$(PREVIEW_SRC)) $(O)/libplatform.a $(CORE)
	$(call link,$(call has_lib,microhttpd.h,-lmicrohttpd) $(call has_lib,seccomp.h,-lseccomp) \
	  $(call has_lib,gnutls/x509.h,-lgnutls))
$(O)/bin/subview-lab: $(call obj,tools/lab/main.c) $(ARCHIVES)
	$(call link)
$(O)/bin/subview-calibrate: $(call obj,tools/calibrate/main.c) $(O)/libcalibrate.a $(ARCHIVES)
	$(call link,$(SOLVE_LIBS))
$(O)/bin/subview-depth: $(call obj,tools/prior/depth_dnn.cc) $(ARCHIVES)
	$(call link,-lopencv_dnn -lopencv_imgproc -lopencv_core -lstdc++)
$(MATCH_MODULE): $(MATCH_OBJ)
	@mkdir -p $(@D); $(if $(V),echo link $@;) $(CXX) -shared $(MATCH_OBJ) $(LDFLAGS_ALL) $(if $(SAN),,-Wl$(comma)-z$(comma)defs) \
	  $(SOLVE_LIBS_opencv) -lm -o $@
$(CAMERA_MODULE): $(MODULE_OBJ)
	@mkdir -p $(@D); $(if $(V),echo link $@;) $(CXX) -shared $(MODULE_OBJ) $(LDFLAGS_ALL) $(if $(SAN),,-Wl$(comma)-z$(comma)defs) \
	  -lcamera -lcamera-base -o $@

# What this build has of the optional libraries: a line that is printed when it changes.
LIBCAMERA_VERSION := $(if $(HAVE_libcamera),$(shell sed -n 's/.*VERSION_\(MAJOR\|MINOR\|PATCH\)[^0-9]*\([0-9]*\)$$/\2/p' \
  $(INC_DIR)/libcamera/libcamera/version.h | paste -sd .))
FEATURE_LIST := libcamera page display mrcal opencv dnn mrgingham opengv openexr sqlite zstd
with_feature = $(if $(HAVE_$(1)),$(1)$(if $(filter libcamera,$(1)), $(LIBCAMERA_VERSION)))
WITHOUT  := $(strip $(foreach f,$(FEATURE_LIST),$(if $(HAVE_$(f)),,$(f))))
FEATURES := $(O), $(SUITE): with $(strip $(foreach f,$(FEATURE_LIST),$(call with_feature,$(f)))); without $(or $(WITHOUT),nothing)
$(O)/features: FORCE
	@mkdir -p $(@D); echo '$(FEATURES)' | cmp -s - $@ || echo '$(FEATURES)' | tee $@
$(ALL_OBJ): | $(O)/features

.PHONY: all programs runtime plan clean
all: $(CORE) $(PROGRAMS) $(MODULES) tests-build
programs: $(CORE) $(PROGRAMS) $(MODULES)
# Without the tools: what the virtual board runs.
runtime: $(filter %/subview %/subview-preview,$(PROGRAMS)) $(MODULES)
plan: $(O)/bin/subview
	@$(EMULATE) $< plan
clean:
	@rm -rf $(O)
