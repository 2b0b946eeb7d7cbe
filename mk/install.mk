# SPDX-License-Identifier: Apache-2.0
# The machine: packages the build needs, the demo, installation.
.PHONY: deps demo demo-live man install
deps:
	@WITH='$(WITH)' tools/deps/install.sh test
demo:
	@WITH='$(WITH)' tools/deps/install.sh build
	@+$(MAKE) --no-print-directory $(PARALLEL) programs
	@tools/demo.sh '$(O)/bin'
demo-live:
	@tools/deps/install.sh build
	@+$(MAKE) --no-print-directory $(PARALLEL) programs
	@tools/demo_live.sh '$(O)/bin' '$(PORT)'
man: programs
	@EMULATE='$(EMULATE)' tools/man/man.sh $(O)/bin $(O)/man
install: programs man
	@install -d '$(DESTDIR)$(PREFIX)/bin'
	@install $(PROGRAMS) '$(DESTDIR)$(PREFIX)/bin'
	@$(if $(MODULES),install -d '$(DESTDIR)$(PREFIX)/lib/subview' && \
	  install -m 644 $(MODULES) '$(DESTDIR)$(PREFIX)/lib/subview')
	@install -d '$(DESTDIR)$(PREFIX)/share/man/man1'
	@install -m 644 $(O)/man/*.1 '$(DESTDIR)$(PREFIX)/share/man/man1'
	@install -d '$(DESTDIR)$(PREFIX)/share/bash-completion/completions'
	@for p in subview subview-lab subview-calibrate; do install -m 644 tools/completion/subview.bash \
	  "$(DESTDIR)$(PREFIX)/share/bash-completion/completions/$$p"; done
