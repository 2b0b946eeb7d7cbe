// SPDX-License-Identifier: Apache-2.0
// What minimal.c asks of a machine, on one that has stdio: text to the terminal, the model to
// model.ply.
#include <stdio.h>

#include <subview/subview.h>

void put(const char *text) { fputs(text, stdout); }

subview_status put_file(void *self, const void *data, size_t bytes) {
  static FILE *file;
  (void)self;
  if (!file) file = fopen("model.ply", "wb");
  return file && fwrite(data, 1, bytes, file) == bytes ? SUBVIEW_OK : SUBVIEW_E_IO;
}
