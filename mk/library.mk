# SPDX-License-Identifier: Apache-2.0
# The installed library: the core as one object in which only the functions of include/subview are
# visible.
#   make libsubview                                     for BOARD
#   make libsubview CROSS=arm-none-eabi- \
#     ARCH_FLAGS='-mcpu=cortex-a15 -mfpu=neon-vfpv4 -mfloat-abi=hard'
LIBRARY     := $(O)/lib/libsubview.a
PUBLIC_HDR  := $(wildcard include/subview/*.h)
OBJCOPY     := $(OBJDUMP:%objdump=%objcopy)
LIB_VERSION  = $(shell sed -n 's/^.define SUBVIEW_VERSION  *"\(.*\)"/\1/p' include/subview/version.h)
bracket     := (
PUBLIC_NAMES = $(shell sed 's|//.*||' $(PUBLIC_HDR) | grep -oE 'subview_[a-z_]+[$(bracket)]' | tr -d '$(bracket)' | sort -u)

# Linked from the members that the public functions need; then all other names become local.
$(LIBRARY): $(CORE) $(PUBLIC_HDR) mk/library.mk
	@mkdir -p $(@D)
	@printf '%s\n' $(PUBLIC_NAMES) > $(@D)/public.txt
	@$(CC) $(filter -m%,$(BOARD_CFLAGS)) -r -nostdlib -o $(@D)/all.o $(PUBLIC_NAMES:%=-Wl,-u,%) $(CORE)
	@$(OBJCOPY) --strip-debug --keep-global-symbols=$(@D)/public.txt $(@D)/all.o $(@D)/subview.o
	@rm -f $@ $(@D)/all.o
	@$(AR) rcs $@ $(@D)/subview.o

.PHONY: libsubview install-library examples library-test
libsubview: $(LIBRARY)
install: install-library
EXAMPLES_DIR = $(DESTDIR)$(PREFIX)/share/doc/subview/examples
install-library: $(LIBRARY)
	@install -d '$(DESTDIR)$(PREFIX)/lib/pkgconfig' '$(DESTDIR)$(PREFIX)/include/subview' '$(EXAMPLES_DIR)/bare'
	@install -m 644 $(LIBRARY) '$(DESTDIR)$(PREFIX)/lib'
	@install -m 644 $(PUBLIC_HDR) '$(DESTDIR)$(PREFIX)/include/subview'
	@install -m 644 $(wildcard examples/*.* examples/Makefile) '$(EXAMPLES_DIR)'
	@install -m 644 $(wildcard examples/bare/*) '$(EXAMPLES_DIR)/bare'
	@printf '%s\n' 'prefix=$(PREFIX)' 'includedir=$${prefix}/include' 'libdir=$${prefix}/lib' '' 'Name: subview' \
	  'Description: Trains Gaussians from synchronized cameras, in one fixed block of memory' \
	  'Version: $(LIB_VERSION)' 'Cflags: -I$${includedir}' 'Libs: -L$${libdir} -lsubview -lm' \
	  > '$(DESTDIR)$(PREFIX)/lib/pkgconfig/subview.pc'

# Examples see the library as a user does: installed, through pkg-config.
STAGE := $(abspath $(O))/stage
examples:
	@+$(MAKE) --no-print-directory install-library PREFIX='$(STAGE)' DESTDIR=
	@+$(MAKE) --no-print-directory -C examples OUT='$(abspath $(O))/examples' CC='$(CC)' \
	  PKG_CONFIG_PATH='$(STAGE)/lib/pkgconfig'
library-test:
	@+$(MAKE) --no-print-directory only GROUPS=library
