// SPDX-License-Identifier: Apache-2.0
// What the commands share: the machine (threads, kernels, console), models on disk, settings beside
// them.
#ifndef SV_TOOLS_LAB_LAB_H
#define SV_TOOLS_LAB_LAB_H

#include "include/subview/version.h"
#include "platform/linux/linux.h"
#include "src/dynamic/dynamic.h"
#include "src/splat/model_file.h"
#include "tools/common/fileio.h"
#include "tools/lab/args.h"
#include "tools/dataset/dataset.h"

#define LAB_VERSION SUBVIEW_VERSION

int lab_cmd_train(const lab_options *o);
int lab_cmd_eval(const lab_options *o);
int lab_cmd_render(const lab_options *o);
int lab_cmd_export(const lab_options *o);
int lab_cmd_import(const lab_options *o);
int lab_cmd_bench(const lab_options *o);
int lab_cmd_tables(const lab_options *o);
int lab_cmd_compare(const lab_options *o);
int lab_cmd_mesh(const lab_options *o);
int lab_cmd_measure(const lab_options *o);
int lab_cmd_info(const lab_options *o);

// --- the machine (session.c) ---------------------------------------------------------------------
typedef struct {
  sv_linux_pool threads;
  sv_pool pool;
  int n_threads;
  sv_kernels k;
  uint32_t isa_mask; // that k was chosen by
  int folder_fd;     // of lab_session_folder; -1: none
  sv_linux_console lines;
  sv_console console;
  sv_clock clock;
} lab_session;

// Starts n_threads (below 1: as many as CPUs are online) and fills the kernel table as SV_ISA says.
// The session must stay where it is.
sv_status lab_session_start(lab_session *s, long n_threads, bool is_quiet, sv_err *err) SV_MUST_USE;
void lab_session_stop(lab_session *s);
// Makes the folder of --out and holds its lock until the session stops. E_IO: another program
// writes there.
sv_status lab_session_folder(lab_session *s, const char *folder, sv_err *err) SV_MUST_USE;
// Prints a failure as one sentence on stderr; returns LAB_EXIT_FAILED.
int lab_failed(lab_session *s, const sv_err *err);
// --model 4dgs: what --motion says (args.c has checked it), over the defaults, and over what
// n_times times ask for when they are known (above 0).
void lab_dynamic_cfg(const lab_options *o, int expected_steps, int n_times, sv_dynamic_cfg *d);
// The last line of a program's log, without a leading "error: "; empty when there is none.
void lab_last_line(const char *path, char *out, size_t cap);
double lab_seconds(const lab_session *s);  // since some moment
bool lab_is_stopped(const lab_session *s); // by Ctrl-C, once sv_linux_catch_signals waits for it
long lab_peak_rss_bytes(void);
// A line of progress, nothing with --quiet.
void lab_say(lab_session *s, const char *fmt, ...) SV_PRINTF(2, 3);

// --- models (model.c) ----------------------------------------------------------------------------
// A model outside
// the trainer, in a block of its own.
typedef struct {
  sv_gaussians g;
  void *block;
  bool is_mip;
  float dilation_px2;  // 0: not said
  sv_unit unit;        // as the file says
  uint32_t background; // likewise, 0xRRGGBB
  char up[4];          // empty: not said
  uint64_t digest;     // as sv_train_digest
  sv_deform deform;    // of motion.bin beside the model; kind NONE without
  void *deform_block;
  struct lab_sequence *sequence; // of a model that was read from a sequence; else NULL
} lab_model;

// What takes Gaussians to a time; all NULL: they are still.
typedef struct lab_sequence lab_sequence;
typedef struct {
  sv_deform *deform;
  lab_sequence *sequence;
} lab_motion;
lab_motion lab_model_motion(lab_model *m);
static inline bool lab_moves(const lab_motion *m) { return m->deform || m->sequence; }
// g is rendered as it is at time t, 0 to 1, until the next call. Fails for a damaged sequence.
sv_status lab_motion_at(const lab_motion *m, const lab_session *s, sv_gaussians *g, float t,
                        sv_err *err) SV_MUST_USE;

sv_status lab_model_read(lab_model *m, const char *path, sv_err *err) SV_MUST_USE;
void lab_model_free(lab_model *m);
// A model, and motion.bin beside it, up to the commit, so that what belongs together comes at once.
// Failed: abandon.
sv_status lab_model_begin(sv_file *f, const sv_gaussians *g, const sv_model_notes *notes, const char *path,
                          sv_err *err) SV_MUST_USE;
sv_status lab_motion_begin(sv_file *f, const sv_deform *d, const sv_gaussians *g, const char *model_path,
                           sv_err *err) SV_MUST_USE;
// The motion.bin of an earlier model there, if any: a still model that was just written does not
// move.
sv_status lab_motion_remove(const char *model_path, sv_err *err) SV_MUST_USE;
sv_status lab_model_write(const sv_gaussians *g, const sv_model_notes *notes, const char *path,
                          sv_err *err) SV_MUST_USE;
sv_model_notes lab_model_notes(const lab_model *m);

// How a model was trained, as train.json beside it tells. Without that file: the defaults of
// lab_settings_default.
typedef struct {
  char transforms[SV_TRANSFORMS_CAP_PATH]; // empty: by the rule of the dataset
  // train.json, when it is who says `transforms`; else empty
  char told_by[SV_CAP_PATH];
  char refined[SV_CAP_PATH]; // the training file with refined poses, beside the model; empty: none
  sv_background background;
  uint32_t color; // of OF_PICTURES, 0xRRGGBB
  int scale;
  int n_exposures; // trained on; 0: all
  bool is_antialiased;
  float dilation_px2;
  float near_z;            // 0: from the model
  float centre[3], radius; // of the scene; radius 0: from the model
  float psnr;              // dB of held-out views, or of training views; 0: not known
} lab_settings;
lab_settings lab_settings_default(void);
// Reads FOLDER-of-model/train.json into *out if it is there, and the PSNR of a run from run.json.
sv_status lab_settings_read(lab_settings *out, const char *model_path, sv_err *err) SV_MUST_USE;
// The same, then replaced by what the options say; near_z and bounds are completed from the model.
sv_status lab_settings_for(lab_settings *out, const lab_options *o, const lab_model *m,
                           sv_err *err) SV_MUST_USE;
sv_render_options lab_render_options(const lab_settings *st, int sh_degree, bool has_depth);
sv_background lab_background_by_name(const char *name);

#endif
