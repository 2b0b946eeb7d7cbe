# SPDX-License-Identifier: Apache-2.0
# Fuzz targets: tests/fuzz/fuzz_*.c, each a program of its own. Usually driver.c is its main(); in a
# build by clang with SAN=fuzzer-no-link,... it is libFuzzer, which is guided by coverage.
FUZZ_SRC   := $(wildcard tests/fuzz/fuzz_*.c)
FUZZ_MAIN  := $(if $(findstring fuzzer-no-link,$(SAN)),tests/fuzz/seeds.c,tests/fuzz/driver.c)
FUZZ_LDFLAGS := $(if $(findstring fuzzer-no-link,$(SAN)),-fsanitize=fuzzer)
# The page's server without its sandbox, where its library is there.
HAVE_PAGE  := $(and $(call have,microhttpd.h),$(call have,seccomp.h))
FUZZ_PAGE  := tests/fuzz/fuzz_http.c tests/fuzz/fuzz_page.c
FUZZ_SRC   := $(if $(HAVE_PAGE),$(FUZZ_SRC),$(filter-out $(FUZZ_PAGE),$(FUZZ_SRC)))
PROGS_fuzz := $(FUZZ_SRC:%.c=$(O)/%)
$(PROGS_fuzz): $(O)/tests/fuzz/%: $(O)/obj/tests/fuzz/%.o $(call obj,$(FUZZ_MAIN)) $(TEST_ARCHIVES)
	$(call link,$(FUZZ_LDFLAGS) $(FUZZ_LIBS))
$(FUZZ_PAGE:%.c=$(O)/%): $(call obj,$(filter-out %/main.c,$(PREVIEW_SRC)))
$(FUZZ_PAGE:%.c=$(O)/%): FUZZ_LIBS = -lmicrohttpd -lseccomp $(call has_lib,gnutls/x509.h,-lgnutls)

# These wait for the system, or copy much: fewer mutations in a short run.
FUZZ_ARGS_fuzz_http := -n 500
FUZZ_ARGS_fuzz_page := -n 4000
ITEMS_fuzz = $(foreach p,$(PROGS_fuzz),$(call item,$(p:$(O)/tests/%=%),$(EMULATE) $(p) \
  $(or $(FUZZ_ARGS),$(FUZZ_ARGS_$(notdir $(p)))))) \
  $(if $(SAN),,$(call item,fuzz/corpus,BUILD='$(BUILD)' tests/run/corpus.sh,900))

# MINUTES of all targets together, in turn; the corpus of the tree and what was found before are
# where they begin. Needs clang.
.PHONY: fuzz-programs fuzz-long fuzz-corpus
fuzz-programs: $(PROGS_fuzz)
fuzz-long:
	@BUILD='$(BUILD)' tests/run/fuzz_long.sh $(or $(MINUTES),10) $(TARGETS)
fuzz-corpus:
	@BUILD='$(BUILD)' tests/run/fuzz_corpus.sh
