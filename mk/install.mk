# SPDX-License-Identifier: Apache-2.0
# The machine: packages the build needs, the demo, installation.
.PHONY: deps demo demo-live man install package deploy deploy-rollback
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

# Debian packages of this build, in $(O)/packages. REVISION is the last part of their version.
REVISION ?= 1
PACKAGES := $(O)/packages
package: programs man libsubview
	@rm -rf '$(PACKAGES)' && mkdir -p '$(PACKAGES)'
	@+$(MAKE) --no-print-directory install DESTDIR='$(abspath $(PACKAGES))/stage' PREFIX=/usr
	@tools/package/package.sh '$(PACKAGES)/stage' '$(PACKAGES)' '$(BOARD_DEBIAN_ARCH)' '$(SUITE)' '$(REVISION)' '$(SYSROOT)'
	@rm -rf '$(PACKAGES)/stage'

# On boards that ssh reaches: HOST=pi, or several, HOST="pi1 pi2".
HOST ?=
deploy: package
	@tools/package/deploy.sh install $(PACKAGES)/subview_*.deb '$(SUITE)' $(HOST)
deploy-rollback:
	@tools/package/deploy.sh rollback $(HOST)
