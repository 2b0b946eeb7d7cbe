// SPDX-License-Identifier: Apache-2.0
// What minimal.c asks of a machine, on one without a system: text goes to the serial port (PL011)
// of QEMU's "virt" boards. Of the PLY file only the size is kept; a firmware would write it to
// flash or send it.
#include <stdint.h>

#include <subview/subview.h>

#define UART ((volatile uint32_t *)0x09000000)
enum { DATA = 0, FLAGS = 6, FULL = 1 << 5 };

static uint32_t n_bytes;

void put(const char *text) {
  for (; *text; text++) {
    while (UART[FLAGS] & FULL) {
    }
    UART[DATA] = (uint8_t)*text;
  }
}

subview_status put_file(void *self, const void *data, size_t bytes) {
  (void)self;
  (void)data;
  n_bytes += (uint32_t)bytes;
  return SUBVIEW_OK;
}

// Called by the start-up code with what main returned.
void finish(int code) {
  char text[] = "file     0000000 bytes\n";
  for (int i = 15; i > 8; i--, n_bytes /= 10) text[i] = (char)('0' + n_bytes % 10);
  put(text);
  put(code ? "failed\n" : "done\n");
}
