// SPDX-License-Identifier: Apache-2.0
// C only: sv_app is.
// The files of a run, handed to the port's store: model.ply, motion.bin, model.svseq, poses.json,
// checkpoint.bin, run.json. Owns the buffers that they are written from and read into. Never
// touches a file system, and leaves an older file whole until the new one is complete.
#ifndef SV_RUN_FILES_H
#define SV_RUN_FILES_H

#include "src/base/arena.h"
#include "src/base/str.h"
#include "src/splat/model_file.h"

typedef struct sv_app sv_app;

#define SV_APP_REPORT_BYTES (64 * 1024)

typedef enum {
  SV_APP_FILE_MODEL,
  SV_APP_FILE_MOTION,
  SV_APP_FILE_SEQUENCE, // of a moving scene; while capturing goes on, of its history
  SV_APP_FILE_POSES,
  SV_APP_FILE_CHECKPOINT,
  SV_APP_FILE_REPORT,
  SV_APP_N_FILES
} sv_app_file;
const char *sv_app_file_name(sv_app_file f); // "model.ply"

typedef struct {
  char *report; // [SV_APP_REPORT_BYTES]
  size_t report_bytes;
  uint8_t *checkpoint; // [checkpoint_bytes] read buffer for resume
  size_t checkpoint_bytes;
  sv_ply_writer ply;
  double checkpoint_s; // of the machine's clock: the newest checkpoint while training
  double picture_s;    // likewise the newest preview image
  // checkpoint.bin is a whole one of this run: the next save keeps it as checkpoint.1.bin.
  bool has_checkpoint;
  int n_failed;       // checkpoints in a row that could not be saved while training
  double retry_s;     // of the machine's clock: not tried again before
  bool is_store_lost; // the final save has given the store up
  uint32_t rescued;   // bit f: file f is in port.rescue instead
} sv_app_files;

// One try each. E_IO: the store refused, a later try may succeed. E_RANGE: the model has values
// that are not finite; it is never saved.
sv_status sv_app_save_model(sv_app *app, sv_err *err) SV_MUST_USE;      // model.ply
sv_status sv_app_save_motion(sv_app *app, sv_err *err) SV_MUST_USE;     // motion.bin
sv_status sv_app_save_checkpoint(sv_app *app, sv_err *err) SV_MUST_USE; // checkpoint.bin
// Everything but run.json: model, motion, poses, checkpoint, preview image. Tries each; the first
// failure is returned.
sv_status sv_app_save_all(sv_app *app, sv_err *err) SV_MUST_USE;
// The same at the end of a run: tries for some seconds, then in port.rescue. A failure is of what
// is saved nowhere.
sv_status sv_app_save_final(sv_app *app, sv_err *err) SV_MUST_USE;
// A checkpoint while training. When the store refuses it warns, and the next try waits 1 s, 2 s, 4
// s, ... up to 64 s; the run goes on.
sv_status sv_app_save_running(sv_app *app, double now_s, sv_err *err) SV_MUST_USE;
// Mean PSNR in dB over the pixels that were kept from training, as their cameras show the model, in
// at most n_most views from all of the run; as it was when they were released. E_NOT_FOUND: none
// were.
sv_status sv_app_held_out_psnr(sv_app *app, int n_most, double *psnr) SV_MUST_USE;
// run.json: settings, digest, ledger, timing, memory map. extra: more JSON members ("\"psnr\":
// 27.1") or NULL. Saved as sv_app_save_final does.
sv_status sv_app_save_report(sv_app *app, const char *extra, sv_err *err) SV_MUST_USE;
// What files.report holds, as run.json.
sv_status sv_app_put_report(sv_app *app, sv_err *err) SV_MUST_USE;

// The trainer's origin: a hash of the source string; NULL: of none.
uint64_t sv_app_origin(const char *source);
// From checkpoint.bin; when that is damaged or missing, from checkpoint.1.bin, with a warning.
// AGAIN: there is neither.
sv_status sv_app_resume(sv_app *app, sv_err *err) SV_MUST_USE;

// With is_refining: the trainer's poses into the exposures, and how far they moved into the log.
void sv_app_take_poses(sv_app *app);
// The unit of the model. Lengths are meters when the rig has a baseline and odometry, where it gave
// the poses, measured the scale by it. The scale is as uncertain as the rig's and odometry's.
sv_unit sv_app_unit(const sv_app *app);
// poses.json, as subview-calibrate pose writes it.
sv_status sv_app_write_poses(sv_app *app, sv_sink sink, sv_err *err) SV_MUST_USE;
// The memory map as text, a line for each part; or as elements of a JSON array.
// The member "measured" of run.json, photometric calibrations (photometric.c), with a comma after
// it; nothing without appearance, or where the rig corrected the pictures.
void sv_app_add_photometric(sv_str *out, const sv_app *app);
void sv_app_memory_map(sv_str *out, const sv_arena *arena, bool is_json);

#endif
