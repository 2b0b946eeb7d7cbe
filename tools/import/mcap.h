// SPDX-License-Identifier: Apache-2.0
// Recordings of ROS 2: MCAP (mcap.dev/spec) over a buffer, and SQLite. Messages with pictures in
// the file's order. Chunks may be stored or compressed by zstd. Owns nothing but the chunk that
// it unpacks; never trusts a length of the file.
#ifndef SV_TOOLS_IMPORT_MCAP_H
#define SV_TOOLS_IMPORT_MCAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/file_data.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LAB_MCAP_CAP_TOPIC 200

typedef struct {
  const char *topic;
  bool is_compressed;  // sensor_msgs/CompressedImage, else sensor_msgs/Image
  uint64_t log_ns;     // when it was recorded, since 1970
  const uint8_t *data; // CDR
  size_t bytes;
} lab_mcap_message;

// Called with each message; another result than SV_OK ends the reading with it.
typedef struct {
  void *self;
  sv_status (*take)(void *self, const lab_mcap_message *m, sv_err *err);
} lab_mcap_sink;
// E_FORMAT for anything that is not a whole MCAP file, E_UNSUPPORTED for other compressions.
sv_status lab_mcap_read(const sv_file_data *file, const lab_mcap_sink *sink, sv_err *err) SV_MUST_USE;

sv_status lab_mcap_read_file(const char *path, const lab_mcap_sink *sink, sv_err *err) SV_MUST_USE;

// The same of a recording in SQLite (db3.c). E_UNSUPPORTED in builds without it.
bool lab_has_db3(void);
sv_status lab_db3_read(const char *path, const lab_mcap_sink *sink, sv_err *err) SV_MUST_USE;

// The picture in a message.
typedef struct {
  int64_t stamp_ns;                      // of the header: when it was taken; 0: not told
  char encoding[40];                     // of raw pixels; of compressed ones the format
  int width_px, height_px, stride_bytes; // of raw pixels
  const uint8_t *px;
  size_t bytes;
} lab_mcap_picture;
sv_status lab_mcap_picture_of(const lab_mcap_message *m, lab_mcap_picture *p, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
