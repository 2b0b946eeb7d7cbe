// SPDX-License-Identifier: Apache-2.0
// What the module subview-libcamera.so gives to the program that opens it: one table, found by its
// name. Owns nothing.
// Never changes without a new revision: a module of another build must be refused, not called.
#ifndef SV_PLATFORM_LIBCAMERA_MODULE_H
#define SV_PLATFORM_LIBCAMERA_MODULE_H

#include "platform/libcamera/libcamera.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_LIBCAMERA_MODULE "subview-libcamera.so"
#define SV_LIBCAMERA_TABLE  "sv_libcamera_table" // the symbol
// Raise the number when a function or the meaning of a shared struct changes.
#define SV_LIBCAMERA_REVISION "subview libcamera module 4"

// Sizes of the structs that both sides use: a second guard beside the revision.
#define SV_LIBCAMERA_SIZES                                                                                   \
  {                                                                                                          \
    sizeof(sv_camera_options), sizeof(sv_camera_caps), sizeof(sv_frame), sizeof(sv_source),                  \
        sizeof(sv_camera_event), sizeof(sv_err)                                                              \
  }

typedef struct {
  char revision[32];
  unsigned sizes[6];
  sv_status (*open)(sv_libcamera **self, const sv_camera_options *cfg, const sv_clock *clock, sv_err *err);
  void (*close)(sv_libcamera *self);
  sv_source (*source)(sv_libcamera *self);
  int (*list)(sv_str *out, sv_err *err);
} sv_libcamera_table_t;

#ifdef __cplusplus
}
#endif
#endif
