// SPDX-License-Identifier: Apache-2.0
// subview-calibrate live: calibrates from a capture while it is written. Each new exposure is
// searched for the board; when there are enough, or the capture has ended, the rig is solved,
// written and checked. `subview run` starts it for the page's Calibrate and shares a block of
// memory for what it finds (src/port/calibration.h).
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>

#include "calib/solve/corners.h"
#include "platform/replay/capture.h"
#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/port/calibration.h"
#include "src/preview/preview.h"
#include "tools/calibrate/calibrate.h"
#include "tools/calibrate/check.h"
#include "tools/common/imageio.h"

#define BLOCK_BYTES ((size_t)64 << 20)
#define N_NEEDED    15  // boards of each camera
#define NEEDED_PART 0.6 // of the image in which corners were
#define MAX_RMS_PX  1.0 // of a rig that is installed
#define WAIT_S      30  // for a first image
#define PAUSE_NS    100000000
#define N_AT_ONCE   4 // new exposures of a search: what is found is shown after each

typedef struct {
  const cal_options *o;
  lab_session *session;
  sv_calibration_block *block; // of the run that started this, or one of our own
  sv_feed_calibration now;
  sv_feed_tiles tiles;
  cal_options with; // --images: the folders of the capture's cameras
  char folders[SV_CALIBRATION_CAP_CAMERAS][SV_CAP_PATH];
  char cache[SV_CAP_PATH];
  double began_s;
} live;

static void publish(live *l, sv_calibration_phase phase) {
  l->now.phase = (int32_t)phase;
  l->now.seconds = lab_seconds(l->session) - l->began_s;
  l->now.peak_bytes = (uint64_t)lab_peak_rss_bytes();
  sv_calibration_write(l->block, &l->now, &l->tiles);
}

// --- what a search has found ---------------------------------------------------------------------

static void look_at_camera(live *l, const cal_boards *b, int c) {
  sv_calibration_camera *q = &l->now.camera[c];
  const int *size = b->cameras[c].size_px;
  const int n = b->n_cols * b->n_rows, outer[4] = {0, b->n_cols - 1, n - 1, n - b->n_cols};
  sv_copy(q->name, sizeof q->name, b->cameras[c].name);
  q->n_boards = q->is_seen = 0;
  q->coverage = 0;
  if (!size[0]) return; // no board yet
  for (int f = 0; f < b->n_frames; f++) {
    const size_t i = (size_t)c * (size_t)b->n_frames + (size_t)f;
    const double *uv = b->uv_px + 2 * (size_t)n * i;
    if (!b->is_seen[i]) continue;
    q->n_boards++;
    for (int k = 0; k < n; k++) {
      const int x = (int)(uv[2 * k] / size[0] * SV_CALIBRATION_GRID_X);
      const int y = (int)(uv[2 * k + 1] / size[1] * SV_CALIBRATION_GRID_Y);
      if (x >= 0 && x < SV_CALIBRATION_GRID_X && y >= 0 && y < SV_CALIBRATION_GRID_Y)
        q->coverage |= 1ull << (SV_CALIBRATION_GRID_X * y + x);
    }
    q->is_seen = f == b->n_frames - 1;
    for (int k = 0; k < 4 && q->is_seen; k++)
      for (int d = 0; d < 2; d++) q->outline[k][d] = (float)(uv[2 * outer[k] + d] / size[d]);
  }
}

static void show_newest(live *l, const cal_boards *b, int c) {
  const cal_camera *q = &b->cameras[c];
  sv_bitmap image = {0};
  sv_err err;
  int w = 0, h = 0;
  if (c >= SV_FEED_CAP_TILES || !q->n_pictures) return;
  sv_status s = sv_bitmap_read(q->pictures[q->n_pictures - 1].path, &image, &err);
  if (s == SV_OK) s = sv_bitmap_to_8(&image, &err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&image, 3, &err);
  if (s == SV_OK) {
    const sv_frame f = {.i_camera = c,
                        .format = SV_PIX_RGB8,
                        .width_px = image.width_px,
                        .height_px = image.height_px,
                        .stride_bytes = 3 * image.width_px,
                        .data = image.u8,
                        .data_bytes = 3 * (size_t)image.width_px * (size_t)image.height_px};
    l->now.camera[c].width_px = image.width_px;
    l->now.camera[c].height_px = image.height_px;
    if (sv_preview_thumbnail(&f, SV_FEED_TILE_W, SV_FEED_TILE_H, l->tiles.rgb[c], &w, &h)) {
      l->tiles.tile[c].width_px = w;
      l->tiles.tile[c].height_px = h;
      l->tiles.tile[c].n++;
    }
  }
  sv_bitmap_free(&image);
}

static bool has_enough(const live *l) {
  for (int c = 0; c < l->now.n_cameras; c++) {
    int n_cells = 0;
    for (uint64_t v = l->now.camera[c].coverage; v; v &= v - 1) n_cells++;
    if (l->now.camera[c].n_boards < N_NEEDED ||
        n_cells < NEEDED_PART * SV_CALIBRATION_GRID_X * SV_CALIBRATION_GRID_Y)
      return false;
  }
  return true;
}

static void keep_first(cal_boards *b, int n_frames) {
  if (b->n_frames <= n_frames) return;
  for (int c = 0; c < b->n_cameras; c++) {
    cal_camera *q = &b->cameras[c];
    while (q->n_pictures && q->pictures[q->n_pictures - 1].i_frame >= n_frames)
      free(q->pictures[--q->n_pictures].path);
  }
  while (b->n_frames > n_frames) free(b->frames[--b->n_frames]);
}

// Searches what is new, or a part of it: *is_all tells. E_NOT_FOUND: some camera has not seen the
// board yet.
static sv_status look(live *l, cal_boards *b, bool *is_all, sv_err *err) {
  sv_status s = cal_boards_list(b, &l->with, err);
  const int n_all = b->n_frames;
  if (s == SV_OK) keep_first(b, l->now.n_exposures + N_AT_ONCE);
  *is_all = b->n_frames == n_all;
  if (s == SV_OK) s = cal_boards_find(b, l->session, l->cache, err);
  if (s != SV_OK && s != SV_E_NOT_FOUND) return s;
  if (!b->uv_px || b->n_cameras != l->now.n_cameras) return s;
  const bool is_new = b->n_frames != l->now.n_exposures;
  l->now.n_exposures = b->n_frames;
  for (int c = 0; c < b->n_cameras && is_new; c++) {
    look_at_camera(l, b, c);
    show_newest(l, b, c);
  }
  return s;
}

// --- the capture ---------------------------------------------------------------------------------

// The folders of the capture's cameras take the place of --images.
static sv_status find_cameras(live *l, void *memory, sv_err *err) {
  sv_arena arena = sv_arena_make(memory, BLOCK_BYTES);
  sv_capture capture;
  sv_status s = sv_capture_load(&capture, l->o->capture, &arena, err);
  if (s < 0) return s;
  if (capture.n_cameras > SV_CALIBRATION_CAP_CAMERAS)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: %d cameras, at most %d are calibrated live", l->o->capture,
                   capture.n_cameras, SV_CALIBRATION_CAP_CAMERAS);
  l->now.n_cameras = l->with.images.n = l->tiles.n = capture.n_cameras;
  for (int c = 0; c < capture.n_cameras && s >= 0; c++) {
    s = sv_path_join(l->folders[c], SV_CAP_PATH, l->o->capture, capture.cameras[c].folder, err);
    l->with.images.of[c] = l->folders[c];
  }
  return s;
}

static void rest(void) {
  const struct timespec t = {.tv_nsec = PAUSE_NS};
  (void)nanosleep(&t, NULL);
}

// Until there is enough. boards: those of the last search.
static sv_status gather(live *l, void *memory, cal_boards *boards, sv_err *err) {
  double heard_s = lab_seconds(l->session);
  bool is_known = false;
  for (;;) {
    // Whatever comes after this is not waited for
    const bool is_last = atomic_load(&l->block->is_enough) != 0;
    const int n_before = l->now.n_exposures;
    bool is_all = true;
    sv_status s = is_known ? SV_OK : find_cameras(l, memory, err);
    is_known = s >= 0;
    if (is_known) {
      cal_boards_free(boards);
      s = look(l, boards, &is_all, err);
      publish(l, SV_CALIBRATION_LOOKING);
    }
    if (l->now.n_exposures != n_before) heard_s = lab_seconds(l->session);
    if (lab_is_stopped(l->session)) return cal_stopped(l->session, l->cache, err);
    if (is_known && s == SV_OK && has_enough(l)) return SV_OK;
    if (is_last && (is_all || (s < 0 && s != SV_E_NOT_FOUND))) return s;
    // An image that is being written is whole the next time; without any the cameras are stuck
    if (lab_seconds(l->session) - heard_s > WAIT_S)
      return s < 0 ? s : sv_fail(err, SV_E_TIMEOUT, "%s: no new image for %d s", l->o->capture, WAIT_S);
    if (is_all) rest();
  }
}

// --- result --------------------------------------------------------------------------------------

static double baseline_m(const sv_rig *rig) {
  double a[3], b[3], most = 0;
  sv_pose_centre(a, &rig->sub_views[0].cam_from_rig);
  for (int i = 1; i < rig->n_sub_views; i++) {
    sv_pose_centre(b, &rig->sub_views[i].cam_from_rig);
    sv_sub3(b, b, a);
    most = fmax(most, sv_norm3(b));
  }
  return most;
}

// The earlier rig over the same boards; one that does not fit these cameras tells nothing.
static void check_before(live *l, const cal_boards *b, void *memory) {
  cal_check c = {0};
  sv_rig rig;
  sv_err err;
  if (l->o->rig && cal_read_rig(&rig, l->o->rig, memory, &err) == SV_OK && rig.n_sub_views == b->n_cameras &&
      cal_check_boards(&c, &rig, b, l->o->spacing_m, &err) == SV_OK)
    for (int i = 0; i < b->n_cameras; i++) l->now.camera[i].before_px = c.cameras[i].rms_rig_px;
  cal_check_free(&c);
}

static sv_status check_after(live *l, const cal_boards *b, void *memory, sv_err *err) {
  cal_check c = {0};
  sv_rig rig;
  sv_status s = cal_read_rig(&rig, l->o->out, memory, err);
  if (s == SV_OK) s = cal_check_boards(&c, &rig, b, l->o->spacing_m, err);
  for (int i = 0; i < b->n_cameras && s == SV_OK; i++) {
    sv_calibration_camera *q = &l->now.camera[i];
    q->rms_px = c.cameras[i].rms_rig_px;
    q->epipolar_px = c.cameras[i].epipolar_px;
    if (!(q->rms_px <= MAX_RMS_PX))
      s = sv_fail(
          err, SV_E_RANGE,
          "%s: the board is %.2f px off in the new rig, expected at most %g px: was the board flat, and "
          "did all cameras expose together?",
          q->name, q->rms_px, MAX_RMS_PX);
  }
  if (s == SV_OK) l->now.baseline_m = baseline_m(&rig);
  cal_check_free(&c);
  return s;
}

static sv_status calibrate(live *l, void *memory, cal_boards *boards, sv_err *err) {
  sv_status s = gather(l, memory, boards, err);
  if (s != SV_OK) return s;
  publish(l, SV_CALIBRATION_SOLVING);
  s = cal_board_solve(&l->with, l->session, boards, err);
  if (s == SV_OK) check_before(l, boards, memory);
  return s == SV_OK ? check_after(l, boards, memory, err) : s;
}

// --- the process ---------------------------------------------------------------------------------

static sv_status share(live *l, sv_err *err) {
  if (l->o->feed_fd < 0) {
    l->block = calloc(1, sizeof *l->block);
    if (!l->block) return sv_fail(err, SV_E_NOMEM, "no memory");
    l->block->is_enough = 1; // the capture is whole
    return SV_OK;
  }
  struct stat st;
  if (fstat((int)l->o->feed_fd, &st) == 0 && (size_t)st.st_size >= sizeof *l->block)
    l->block = mmap(NULL, sizeof *l->block, PROT_READ | PROT_WRITE, MAP_SHARED, (int)l->o->feed_fd, 0);
  if (l->block && l->block != MAP_FAILED) return SV_OK;
  l->block = NULL;
  return sv_fail(err, SV_E_ARG, "--feed-fd %ld: no block of a run", l->o->feed_fd);
}

static void limit_memory(long mib) {
  struct rlimit r;
  if (mib < 0 || getrlimit(RLIMIT_DATA, &r) != 0) return;
  r.rlim_cur = (rlim_t)mib << 20;
  if (r.rlim_max == RLIM_INFINITY || r.rlim_cur < r.rlim_max) r.rlim_max = r.rlim_cur;
  (void)setrlimit(RLIMIT_DATA, &r);
}

static sv_status begin(live *l, sv_err *err) {
  const cal_options *o = l->o;
  l->with = *o;
  l->began_s = lab_seconds(l->session);
  l->now = (sv_feed_calibration){.n_cols = o->n_cols,
                                 .n_rows = o->n_rows,
                                 .spacing_m = o->spacing_m,
                                 .baseline_m = NAN,
                                 .n_needed = N_NEEDED};
  for (int c = 0; c < SV_CALIBRATION_CAP_CAMERAS; c++)
    l->now.camera[c] = (sv_calibration_camera){.rms_px = NAN, .epipolar_px = NAN, .before_px = NAN};
  sv_status s = share(l, err);
  if (s == SV_OK) s = sv_boards_available(err);
  if (s == SV_OK) s = sv_corners_available(o->n_cols, o->n_rows, err);
  if (s == SV_OK) s = lab_session_folder(l->session, o->out, err);
  return s == SV_OK ? sv_path_join(l->cache, sizeof l->cache, o->out, "corners.txt", err) : s;
}

int cal_cmd_live(const cal_options *o) {
  static live l;
  lab_session se;
  cal_boards boards = {0};
  sv_err err = {0};
  limit_memory(o->memory_mib);
  l = (live){.o = o, .session = &se};
  void *memory = malloc(BLOCK_BYTES);
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK && !memory) s = sv_fail(&err, SV_E_NOMEM, "no memory");
  if (s == SV_OK) s = begin(&l, &err);
  if (s == SV_OK) s = calibrate(&l, memory, &boards, &err);
  if (s != SV_OK) lab_failed(&se, &err);
  sv_copy(l.now.sentence, sizeof l.now.sentence, err.text);
  if (l.block) publish(&l, s == SV_OK ? SV_CALIBRATION_DONE : SV_CALIBRATION_FAILED);
  for (int c = 0; c < l.now.n_cameras && s == SV_OK; c++)
    lab_say(&se, "  %s: %.3f px in the new rig, %.3f px from epipolar lines", l.now.camera[c].name,
            l.now.camera[c].rms_px, l.now.camera[c].epipolar_px);
  for (int c = 0; c < l.now.n_cameras && s == SV_OK; c++)
    if (!isnan(l.now.camera[c].before_px))
      lab_say(&se, "  %s: %.3f px in the earlier rig", l.now.camera[c].name, l.now.camera[c].before_px);
  cal_boards_free(&boards);
  lab_session_stop(&se);
  free(memory);
  return s == SV_OK ? CAL_EXIT_OK : CAL_EXIT_FAILED;
}
