# SPDX-License-Identifier: Apache-2.0
# Checks of the sources themselves, and measurements.
.PHONY: headers format format-check tidy bench mca reproduce
headers:
	@CC='$(CC) $(SYSROOT_FLAG)' tools/lint/headers.sh
format:
	@tools/lint/format.sh --fix
format-check:
	@tools/lint/format.sh
tidy:
	@HAVE='$(HAVE)' tools/lint/tidy.sh
bench: programs $(PROGS_kernels)
	@$(EMULATE) $(PROGS_kernels) --bench | tee $(O)/kernels.csv
	@$(EMULATE) $(O)/bin/subview-lab bench
	@tools/bench/quality.sh $(O)/bin/subview-lab | tee $(O)/quality.csv
reproduce: programs
	@tools/reproduce/reproduce.sh $(O)/bin $(O)/reproduce '$(ONLY)'
mca:
	@neon='$(ISA_neon)' avx2='$(ISA_avx2)' avx512='$(ISA_avx512)' project='$(PROJECT_CFLAGS)' tools/mca/mca.sh $(if $(V),-v)
