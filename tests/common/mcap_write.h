// SPDX-License-Identifier: Apache-2.0
// Writes MCAP files of ROS 2's picture messages as rosbag2 does, for tests: CDR in chunks that are
// stored or compressed by zstd. It owns the file that it builds; it never checks its input.
#ifndef SV_TESTS_COMMON_MCAP_WRITE_H
#define SV_TESTS_COMMON_MCAP_WRITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint8_t *data;
  size_t bytes, cap;
} mcap_bytes;

typedef struct {
  mcap_bytes file, chunk;
  bool is_packed; // chunks by zstd, where the build has it
} mcap_file;

// A picture; encoding "": compressed, px is a file then.
typedef struct {
  int64_t stamp_ns;
  const char *encoding;
  int width_px, height_px, stride_bytes;
  const void *px;
  size_t bytes;
} mcap_picture;

bool mcap_can_pack(void);
void mcap_begin(mcap_file *m);
void mcap_topic(mcap_file *m, int channel, const char *name, bool is_compressed);
// The message in CDR, behind what is in b; its alignment is counted from there. The caller frees
// b->data.
void mcap_message(mcap_bytes *b, const mcap_picture *p);
void mcap_put(mcap_file *m, int channel, const mcap_picture *p);
void mcap_chunk(mcap_file *m); // what was put since the last one
void mcap_end(mcap_file *m);   // m->file is the file then
void mcap_free(mcap_file *m);

#ifdef __cplusplus
}
#endif
#endif
