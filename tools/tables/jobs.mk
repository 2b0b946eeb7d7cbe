# SPDX-License-Identifier: Apache-2.0
# Jobs of `subview-lab tables --plan jobs.txt` by make: make -j4 -f tools/tables/jobs.mk
# JOBS=jobs.txt
JOBS ?= jobs.txt
lines := $(shell seq $$(wc -l < '$(JOBS)'))
.PHONY: all $(lines)
all: $(lines)
$(lines):
	@sed -n '$@p' '$(JOBS)' | sh
