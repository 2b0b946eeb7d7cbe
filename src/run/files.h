// SPDX-License-Identifier: Apache-2.0
// C only: sv_app is.
// The files of a run, handed to the port's store: model.ply, motion.bin, poses.json,
// checkpoint.bin, run.json. Owns the buffers that they are written from and read into. Never
// touches a file system, and leaves an older file whole until the new one is complete.
#ifndef SV_RUN_FILES_H
#define SV_RUN_FILES_H

#include "src/base/arena.h"
#include "src/base/str.h"
#include "src/splat/model_file.h"

typedef struct sv_app sv_app;

#define SV_APP_REPORT_BYTES (64 * 1024)

typedef struct {
  char *report;        // [SV_APP_REPORT_BYTES]
  uint8_t *checkpoint; // [checkpoint_bytes] read buffer for resume
  size_t checkpoint_bytes;
  sv_ply_writer ply;
  double checkpoint_s; // of the machine's clock: the newest checkpoint while training
  double picture_s;    // likewise the newest preview image
} sv_app_files;

sv_status sv_app_save_model(sv_app *app, sv_err *err) SV_MUST_USE;      // model.ply
sv_status sv_app_save_motion(sv_app *app, sv_err *err) SV_MUST_USE;     // motion.bin
sv_status sv_app_save_checkpoint(sv_app *app, sv_err *err) SV_MUST_USE; // checkpoint.bin
// With is_refining: the trainer's poses into the exposures, how far they moved into the log, all of
// them into poses.json (as subview-calibrate pose writes them).
sv_status sv_app_save_poses(sv_app *app, sv_err *err) SV_MUST_USE;
// Everything but run.json: model, motion, poses, checkpoint, preview image.
sv_status sv_app_save_all(sv_app *app, sv_err *err) SV_MUST_USE;
// The trainer's origin: a hash of the source string; NULL: of none.
uint64_t sv_app_origin(const char *source);
sv_status sv_app_resume(sv_app *app, sv_err *err) SV_MUST_USE; // AGAIN: there is no checkpoint
// run.json: settings, digest, ledger, timing, memory map. extra: more JSON members ("\"psnr\":
// 27.1") or NULL.
sv_status sv_app_save_report(sv_app *app, const char *extra, sv_err *err) SV_MUST_USE;
// The memory map as text, a line for each part; or as elements of a JSON array.
void sv_app_memory_map(sv_str *out, const sv_arena *arena, bool is_json);

#endif
