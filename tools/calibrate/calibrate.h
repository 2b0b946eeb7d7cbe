// SPDX-License-Identifier: Apache-2.0
// What the commands of subview-calibrate share.
#ifndef SV_TOOLS_CALIBRATE_CALIBRATE_H
#define SV_TOOLS_CALIBRATE_CALIBRATE_H

#include "calib/solve/boards.h"
#include "src/format/rig_file.h"
#include "src/rig/rig.h"
#include "tools/calibrate/args.h"
#include "tools/lab/lab.h"
#include "tools/common/report.h"

#define CAL_VERSION LAB_VERSION

int cal_cmd_board(const cal_options *o);
int cal_cmd_lenslets(const cal_options *o);
int cal_cmd_check(const cal_options *o);
int cal_cmd_pose(const cal_options *o);
int cal_cmd_shutter(const cal_options *o);
int cal_cmd_noise(const cal_options *o);
int cal_cmd_photometric(const cal_options *o);
int cal_cmd_print(const cal_options *o);
int cal_cmd_live(const cal_options *o);

// --- images of boards (gather.c) -----------------------------------------------------------------
typedef struct {
  char *path;
  int i_frame;
} cal_picture;

typedef struct {
  char name[32]; // from the pattern
  int n_pictures, size_px[2];
  cal_picture *pictures; // [n_pictures] in order of frames
} cal_camera;

typedef struct {
  int n_cameras, n_frames, n_cols, n_rows;
  cal_camera *cameras;
  char **frames;            // [n_frames] what the wildcards stand for
  const char **names;       // [n_cameras]
  int (*size_px)[2];        // [n_cameras]
  double *uv_px;            // [n_cameras][n_frames][n_rows][n_cols][2]
  uint8_t *is_seen;         // [n_cameras][n_frames]
  int n_searched, n_cached; // images searched for the board now, and taken from the cache
} cal_boards;

// Lists the images of --images by camera and frame. SV_E_NOT_FOUND for a pattern without pictures.
sv_status cal_boards_list(cal_boards *b, const cal_options *o, sv_err *err) SV_MUST_USE;
// Finds the corners in all images on all threads. cache: a file that remembers them by path, size
// and time of change, read and written anew; NULL: none. Images of one camera must have one size.
sv_status cal_boards_find(cal_boards *b, lab_session *s, const char *cache, sv_err *err) SV_MUST_USE;
void cal_boards_free(cal_boards *b);
// SV_E_INTERRUPTED when a stop was requested, with a sentence. kept: what of the work stays; NULL:
// nothing.
sv_status cal_stopped(const lab_session *s, const char *kept, sv_err *err) SV_MUST_USE;

// From boards that were found to a written rig (cmd_board.c).
sv_status cal_board_solve(const cal_options *o, lab_session *se, const cal_boards *b,
                          sv_err *err) SV_MUST_USE;
// A rig folder, into CAL_RIG_BYTES at block (cmd_check.c).
#define CAL_RIG_BYTES ((size_t)64 << 20)
sv_status cal_read_rig(sv_rig *rig, const char *folder, void *block, sv_err *err) SV_MUST_USE;

// What an image shows of its sensor, where it lies in a capture folder whose capture.json tells
// that (sensor.c). False: not known.
bool cal_sensor_area(const char *picture, const int size_px[2], sv_sensor_area *out);
// Exposure time of camera c's first picture over that of the first camera's, where captures tell
// both and that all else was shared (lock=shared); else 1.
double cal_exposure_share(const cal_boards *b, int c);

// --- a command's frame (frame.c) -----------------------------------------------------------------
// What a command works with: half of its block for what stays, half for what comes and goes.
typedef struct {
  const cal_options *options;
  lab_session *session;
  sv_arena arena, scratch;
} cal_frame;
// job: zeroed memory of the command's own; what it opened it also frees.
typedef sv_status cal_work(void *job, const cal_frame *frame, sv_err *err);
// Runs a command that signals can stop. The exit code; a failure is told.
int cal_frame_run(const cal_options *o, size_t job_bytes, size_t block_bytes, cal_work *work);

// --- what the user is told (advice.c) ------------------------------------------------------------
#define CAL_CAP_ADVICE 64
typedef struct {
  int n;
  char text[CAL_CAP_ADVICE][300];
} cal_advice;
void cal_advise(cal_advice *a, const char *fmt, ...) SV_PRINTF(2, 3);
void cal_report_warnings(lab_report *r, const cal_advice *a); // "warnings" of --json
// Of squares that are hardly as large as said: millimeters, mostly.
void cal_advise_spacing(cal_advice *a, double spacing_m);
// Of a calibration: too few boards, parts of the image without any, too little tilt, uncertain
// figures.
void cal_advise_boards(cal_advice *a, const cal_boards *b, const sv_boards_result *r);

// --- files (rig_out.c, plots.c) ------------------------------------------------------------------
// rig.json and one .cameramodel a sub-view into a folder that is made. coverage may be NULL.
sv_status cal_rig_write(const char *folder, const sv_rig *rig, sv_err *err) SV_MUST_USE;
// The same of a rig that was read from this folder, whose images stay.
sv_status cal_rig_update(const char *folder, const sv_rig *rig, const sv_coverage_names *names,
                         sv_err *err) SV_MUST_USE;
// residuals.csv, and an image per camera in folder/plots drawn by gnuplot (where it is installed).
sv_status cal_plots_write(const char *folder, const cal_boards *b, const sv_boards_result *r, lab_session *s,
                          sv_err *err) SV_MUST_USE;

#endif
