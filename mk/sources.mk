# SPDX-License-Identifier: Apache-2.0
# Sources by folder: a new file, or a new folder below src, tools or tests, needs no change here.
c_files = $(wildcard $(1)/*.c $(1)/*/*.c)
obj     = $(patsubst %.cc,$(O)/obj/%.o,$(patsubst %.c,$(O)/obj/%.o,$(1)))

CORE_SRC    := $(call c_files,src/*) $(wildcard calib/*.c)
MAIN_SRC    := $(filter-out $(if $(HAVE_BENCH),,boards/cmd_bench.c),$(wildcard boards/*.c))
# What a model's page needs without a server: subview-lab makes files of it.
VIEWER_SRC  := platform/preview/bundle.c platform/preview/compact.c
PREVIEW_SRC := $(filter-out $(VIEWER_SRC),$(wildcard platform/preview/*.c))
CAL_SRC     := $(call c_files,tools/calibrate)
# Programs of tools/ have their main() in a file main.c; all other files of tools/ are a library.
LAB_SRC     := $(filter-out $(CAL_SRC),$(call c_files,tools/*))
HELPER_SRC  := $(filter-out %/main.c,$(LAB_SRC))
TEST_SRC    := $(filter-out %_vec.c,$(call c_files,tests/*))

# --- optional libraries: what is missing is left out, and said (features below) -------------
have     = $(if $(filter minimal,$(WITH)),,$(if $(filter $(words $(1)),$(words $(wildcard $(addprefix $(INC_DIR)/,$(1))))),1))
have_cxx = $(if $(HAVE_CXX),$(call have,$(1)))
HAVE_libcamera := $(call have_cxx,libcamera/libcamera/libcamera.h)
HAVE_mrcal     := $(call have,mrcal/mrcal.h suitesparse/cholmod.h)
HAVE_opencv    := $(call have_cxx,opencv4/opencv2/calib3d.hpp opencv4/opencv2/video.hpp)
HAVE_dnn       := $(call have_cxx,opencv4/opencv2/dnn.hpp opencv4/opencv2/imgproc.hpp)
HAVE_mrgingham := $(call have_cxx,mrgingham/mrgingham.hh opencv4/opencv2/core.hpp)
HAVE_opengv    := $(call have_cxx,opengv/types.hpp eigen3/Eigen/Core)
HAVE_page      := $(call have,microhttpd.h seccomp.h)
HAVE_display   := $(if $(wildcard $(INC_DIR)/libdrm/drm_mode.h),1)
HAVE_openexr   := $(if $(wildcard $(INC_DIR)/OpenEXR/openexr.h),1)
HAVE_sqlite    := $(if $(wildcard $(INC_DIR)/sqlite3.h),1)
HAVE_zstd      := $(if $(wildcard $(INC_DIR)/zstd.h),1)

PLAT_SRC := $(VIEWER_SRC) $(foreach p,$(BOARD_PLATFORMS),$(wildcard platform/$(p)/*.c))
LIBS     := $(BOARD_LIBS) -ljpeg -lpng -lz -lpthread -lm

# The module subview-libcamera.so, and the few C files that it shares with the programs; they are
# compiled once more, as code of a shared object.
MODULE_CXX := $(if $(HAVE_libcamera),$(foreach p,$(BOARD_PLATFORMS),$(wildcard platform/$(p)/*.cc)))
MODULE_C   := $(if $(MODULE_CXX),platform/camera/options.c src/base/status.c src/base/str.c src/port/pixel.c)
MODULE_OBJ := $(MODULE_CXX:%.cc=$(O)/obj/shared/%.o) $(MODULE_C:%.c=$(O)/obj/shared/%.o)

# Of calib/solve the files named *_LIB.c or *_LIB.cc need LIB; without it *_LIB_none.c takes their
# place, whose functions report that LIB is missing.
SOLVE_ALL  := mrcal opencv mrgingham opengv
SOLVE_LIBS_mrcal     := -lmrcal -lcholmod
SOLVE_LIBS_opencv    := -lopencv_calib3d -lopencv_video -lopencv_features2d -lopencv_imgproc -lopencv_core
SOLVE_LIBS_mrgingham := -lmrgingham -lopencv_core
SOLVE_LIBS_opengv    := -lopengv
SOLVE_SRC  := $(filter-out $(foreach l,$(SOLVE_ALL),%_$(l).c %_$(l)_none.c),$(wildcard calib/solve/*.c)) \
  $(foreach l,$(SOLVE_ALL),$(wildcard $(if $(HAVE_$(l)),calib/solve/*_$(l).c calib/solve/*_$(l).cc,\
  calib/solve/*_$(l)_none.c)))
SOLVE_LIBS := $(foreach l,$(SOLVE_ALL),$(if $(HAVE_$(l)),$(SOLVE_LIBS_$(l)))) \
  $(if $(HAVE_opencv)$(HAVE_mrgingham)$(HAVE_opengv),-lstdc++)

# The module subview-matches.so.
MATCH_SRC := $(if $(HAVE_opencv),calib/solve/structure_opencv.cc calib/solve/align.c src/base/vec.c src/base/mathx.c)
MATCH_OBJ := $(patsubst %,$(O)/obj/shared/%.o,$(basename $(MATCH_SRC)))

CORE_OBJ := $(call obj,$(CORE_SRC)) $(KERNEL_OBJ)
ALL_OBJ  := $(CORE_OBJ) $(PROBE_OBJ) $(MODULE_OBJ) $(MATCH_OBJ) $(call obj,tools/prior/depth_dnn.cc) \
  $(call obj,$(PLAT_SRC) $(PREVIEW_SRC) $(MAIN_SRC) $(LAB_SRC) $(CAL_SRC) $(SOLVE_SRC) $(TEST_SRC))
