// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/align.h"
#include "calib/solve/corners.h"
#include "calib/solve/structure.h"
#include "src/base/mathx.h"
#include "src/base/str.h"
#include "tools/calibrate/lenses.h"

#define FEW_OBSERVATIONS 40 // of a lens
#define GOOD_SD_DEG      0.025
#define FOCAL_SD         0.01 // lenses of one array: spread of their focal lengths
#define CAP_GUESS_POINTS 400  // that the first focal length is found with
#define LIKENESS         0.95 // correlation of a corner's patch in two lenses
#define MOVE_PX          1.5  // that alignment may move a corner
// spread of principal points about the middle of what they light, of its width
#define CENTRE_SD 0.0003

typedef struct {
  const cal_options *o;
  lab_session *session;
  cal_lenses lenses;
  sv_lens_array bundle;
  sv_array_stats stats;
  double rms_px;
  int n_used; // features, or corners
  double rotation_sd_deg, focal_sd_px;
  cal_advice advice;
} job;

// --- a textured object ---------------------------------------------------------------------------
static sv_status gather_exposure(job *j, int exposure, sv_err *err) {
  cal_lenses *l = &j->lenses;
  sv_lens_array *b = &j->bundle;
  sv_structure_view views[SV_CAP_SUB_VIEWS];
  int whose[SV_CAP_SUB_VIEWS], n = 0, n_points, n_old = b->n_observations;
  sv_array_observation *found;
  for (int i = 0; i < l->n_lenses; i++) {
    const cal_lens *lens = &l->lenses[i];
    if (!lens->grey[exposure]) continue;
    const sv_footprint *f = &lens->footprint;
    views[n] = (sv_structure_view){f->width_px,
                                   f->height_px,
                                   lens->grey[exposure],
                                   lens->mask,
                                   {f->x0_px + 0.5 * f->width_px, f->y0_px + 0.5 * f->height_px}};
    whose[n++] = i;
  }
  const sv_structure_options options = sv_structure_defaults();
  int n_found = sv_structure_tracks(views, n, &options, &found, &n_points);
  sv_array_observation *more =
      n_found > 0 ? realloc(b->observations, (size_t)(n_old + n_found) * sizeof *more) : b->observations;
  if (n_found < 0 || (n_found > 0 && !more)) {
    free(found);
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for its features", j->o->isolated);
  }
  b->observations = more;
  for (int k = 0; k < n_found; k++) {
    more[n_old + k] = found[k];
    more[n_old + k].view = whose[found[k].view];
    more[n_old + k].point += b->n_points;
  }
  free(found);
  b->n_observations += n_found;
  b->n_points += n_points;
  return SV_OK;
}

static sv_status check_features(job *j, sv_err *err) {
  int n[SV_CAP_SUB_VIEWS] = {0};
  for (int k = 0; k < j->bundle.n_observations; k++) n[j->bundle.observations[k].view]++;
  for (int i = 0; i < j->lenses.n_lenses; i++)
    if (n[i] < FEW_OBSERVATIONS)
      return sv_fail(
          err, SV_E_FORMAT,
          "lens %s shares %d features with two other lenses, at least %d are needed: use an object with more "
          "fine texture that fills the image, sharp and well lit, or add exposures of other objects",
          j->lenses.lenses[i].name, n[i], FEW_OBSERVATIONS);
  return SV_OK;
}

// Where a lens's principal point is expected: the middle of what it lights.
static void find_centre(const cal_lens *l, double centre_px[2]) {
  const sv_footprint *f = &l->footprint;
  double sum[3] = {0};
  for (int y = 0; y < f->height_px; y++)
    for (int x = 0; x < f->width_px; x++) {
      // half lit counts as lit: fall-off of the light does not move the middle, a rim's share does
      double c = (double)sv_minf(1, 2 * (float)f->coverage[y * f->width_px + x] / 255);
      sum[0] += c;
      sum[1] += c * (x + 0.5);
      sum[2] += c * (y + 0.5);
    }
  for (int k = 0; k < 2; k++) centre_px[k] = sum[1 + k] / sum[0];
}

static void set_lenses(job *j, double focal_per_width) {
  for (int i = 0; i < j->lenses.n_lenses; i++) {
    const sv_footprint *f = &j->lenses.lenses[i].footprint;
    double focal = focal_per_width * j->lenses.lenses[0].footprint.width_px;
    j->bundle.models[i] =
        (sv_camera_model){SV_MODEL_PINHOLE,
                          f->width_px,
                          f->height_px,
                          {focal, focal, j->bundle.centre_px[i][0], j->bundle.centre_px[i][1]}};
    j->bundle.cam_from_rig[i] = sv_pose_identity();
  }
  for (int k = 0; k < j->bundle.n_observations; k++) j->bundle.observations[k].is_outlier = false;
}

// Every k-th point, so that about CAP_GUESS_POINTS are left. NULL without memory.
static sv_array_observation *thinned(const sv_lens_array *b, int *n_observations, int *n_points) {
  int every = 1 + b->n_points / CAP_GUESS_POINTS;
  sv_array_observation *out = malloc((size_t)b->n_observations * sizeof *out);
  *n_observations = 0;
  *n_points = 1 + (b->n_points - 1) / every;
  for (int k = 0; k < b->n_observations && out; k++)
    if (b->observations[k].point % every == 0) {
      out[*n_observations] = b->observations[k];
      out[(*n_observations)++].point /= every;
    }
  return out;
}

static sv_status solve_from(job *j, double focal_per_width, int n_rounds, sv_err *err) {
  sv_lens_array *b = &j->bundle;
  set_lenses(j, focal_per_width);
  if (!sv_structure_start(b))
    return sv_fail(err, SV_E_FORMAT, "the images of the lenses cannot be linked by shared features");
  b->is_lens_fixed = true;
  sv_status s = sv_array_solve(b, 2, &j->stats, err);
  b->is_lens_fixed = false;
  return s == SV_OK ? sv_array_solve(b, n_rounds, &j->stats, err) : s;
}

// The focal length is not known: several are tried on some of the points; from the one that fits
// best all goes on.
static sv_status solve_texture(job *j, sv_err *err) {
  static const double guesses[] = {0.9, 1.5, 2.5};
  sv_lens_array *b = &j->bundle, all = *b;
  double best = INFINITY, best_guess = 0;
  int best_in = 0;
  sv_array_observation *few = thinned(&all, &b->n_observations, &b->n_points);
  if (!few) return sv_fail(err, SV_E_NOMEM, "%s: no memory for features", j->o->isolated);
  double width = b->n_views ? j->lenses.lenses[0].footprint.width_px : 1, known = j->o->focal_px / width;
  size_t n_guesses = known > 0 ? 1 : sizeof guesses / sizeof *guesses;
  b->is_focal_known = known > 0;
  b->focal_sd = FOCAL_SD;
  b->centre_sd_px = CENTRE_SD * j->lenses.lenses[0].footprint.width_px;
  b->observations = few;
  for (size_t g = 0; g < n_guesses; g++) {
    if (solve_from(j, known > 0 ? known : guesses[g], 2, err) != SV_OK) continue;
    int n_in = b->n_observations - j->stats.n_outliers;
    if (n_in * 10 < best_in * 9 || j->stats.sigma_px >= best) continue;
    best = j->stats.sigma_px;
    best_in = n_in;
    best_guess = known > 0 ? known : b->models[0].p[0] / width; // where it went from the guess
  }
  free(few);
  b->observations = all.observations;
  b->n_observations = all.n_observations;
  b->n_points = all.n_points;
  if (best_guess > 0 && solve_from(j, best_guess, 5, err) == SV_OK) return SV_OK;
  return sv_fail(err, SV_E_FORMAT,
                 "%s: the features do not fit one rigid object: did something move between the images, or is "
                 "the object flat and seen only from the front?",
                 j->o->isolated);
}

static sv_status calibrate_texture(job *j, sv_err *err) {
  sv_status s = SV_OK;
  if (!sv_structure_available())
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "this build cannot match images: it was built without OpenCV "
                   "(libopencv-dev)");
  for (int e = 0; e < j->lenses.n_exposures && s == SV_OK; e++)
    if ((s = cal_stopped(j->session, NULL, err)) == SV_OK) s = gather_exposure(j, e, err);
  if (s == SV_OK) s = check_features(j, err);
  j->bundle.points = calloc((size_t)j->bundle.n_points + 1, sizeof *j->bundle.points);
  if (s == SV_OK && !j->bundle.points)
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for points", j->o->isolated);
  if (s == SV_OK) s = solve_texture(j, err);
  if (s != SV_OK) return s;
  j->rms_px = j->stats.rms_px;
  j->n_used = j->bundle.n_observations - j->stats.n_outliers;
  j->rotation_sd_deg = j->stats.rotation_sd_deg;
  j->focal_sd_px = j->stats.focal_sd_px;
  return SV_OK;
}

// Neighboring lenses are `pitch` apart in the mean.
static void set_scale(job *j) {
  sv_lens_array *b = &j->bundle;
  double sum = 0;
  for (int i = 0; i < b->n_views; i++) {
    double least = INFINITY, c[3], d[3];
    sv_pose_centre(c, &b->cam_from_rig[i]);
    for (int k = 0; k < b->n_views; k++) {
      if (k == i) continue;
      sv_pose_centre(d, &b->cam_from_rig[k]);
      sv_sub3(d, d, c);
      least = fmin(least, sv_norm3(d));
    }
    sum += least / b->n_views;
  }
  double scale = (j->o->pitch_m > 0 ? j->o->pitch_m : 1) / sum;
  for (int i = 0; i < b->n_views; i++)
    for (int k = 0; k < 3; k++) b->cam_from_rig[i].t[k] *= scale;
  if (!(j->o->pitch_m > 0))
    cal_advise(&j->advice, "the scale is unknown: one unit is the distance between neighboring lenses; set "
                           "it with --pitch or calibrate with a chessboard");
}

// --- a chessboard --------------------------------------------------------------------------------
static double mean_distance(const sv_pose *poses, int n) { // of the views' centers from the first
  double sum = 0, c[3];
  for (int i = 1; i < n; i++) {
    sv_pose_centre(c, &poses[i]);
    sum += sv_norm3(c) / (n - 1);
  }
  return sum;
}

static const double *corner(const sv_boards *b, const sv_boards_result *r, int lens, int e, size_t k) {
  size_t n = (size_t)r->n_corners, at = (size_t)lens * (size_t)b->n_frames + (size_t)e;
  return b->is_seen[at] && !r->is_outlier[at * n + k] ? b->uv_px + 2 * (at * n + k) : NULL;
}

// A corner as the lenses see it: found in one of the middle, its patch aligned with the others.
// What a detector finds in each by itself is worse by some times.
static void take_corner(job *j, const sv_boards *b, const sv_boards_result *r, int e, size_t k) {
  sv_lens_array *a = &j->bundle;
  const double *ref = NULL;
  int i_ref = 0, n = b->n_cameras;
  for (int d = 0; d < n && !ref; d++) {
    i_ref = (n / 2 + (d % 2 ? -(d + 1) / 2 : d / 2) + n) % n;
    ref = corner(b, r, i_ref, e, k);
  }
  if (!ref) return;
  const sv_footprint *f = &j->lenses.lenses[i_ref].footprint;
  const sv_align_image from = {f->width_px, f->height_px, j->lenses.lenses[i_ref].grey[e]};
  for (int i = 0; i < n; i++) {
    const double *uv = corner(b, r, i, e, k), at[2] = {ref[0] - 0.5, ref[1] - 0.5};
    if (!uv) continue;
    f = &j->lenses.lenses[i].footprint;
    const sv_align_image to = {f->width_px, f->height_px, j->lenses.lenses[i].grey[e]};
    double found[2] = {uv[0] - 0.5, uv[1] - 0.5}, warp[4] = {1, 0, 0, 1};
    if (i != i_ref && sv_align_patch(&from, at, &to, found, warp) < LIKENESS) continue;
    if (hypot(found[0] + 0.5 - uv[0], found[1] + 0.5 - uv[1]) > MOVE_PX) continue;
    a->observations[a->n_observations++] =
        (sv_array_observation){i, a->n_points, {found[0] + 0.5, found[1] + 0.5}, false};
  }
}

static void take_corners(job *j, const sv_boards *b, const sv_boards_result *r) {
  sv_lens_array *a = &j->bundle;
  for (int e = 0; e < b->n_frames; e++)
    for (size_t k = 0; k < (size_t)r->n_corners; k++, a->n_points++) {
      double x[3];
      sv_boards_corner(x, b, r->warp_m, (int)k % b->n_cols, (int)k / b->n_cols);
      sv_pose_apply(a->points[a->n_points], &r->rig_from_board[e], x);
      take_corner(j, b, r, e, k);
    }
}

// The board gives the lenses' mean focal length and the size. What each lens has of its own follows
// from the corners as free points with the array's spread as a prior: a small image alone mixes up
// direction and principal point.
static sv_status refine_board(job *j, const sv_boards *b, const sv_boards_result *r, sv_err *err) {
  sv_lens_array *a = &j->bundle;
  size_t n_points = (size_t)b->n_frames * (size_t)r->n_corners;
  double focal = 0, size = mean_distance(r->cam_from_rig, b->n_cameras);
  for (int i = 0; i < b->n_cameras; i++)
    focal += 0.5 * (r->models[i].p[0] + r->models[i].p[1]) / b->n_cameras;
  for (int i = 0; i < b->n_cameras; i++) {
    sv_camera_model *m = &a->models[i];
    *m = r->models[i];
    m->p[0] = m->p[1] = focal;
    m->p[2] = a->centre_px[i][0];
    m->p[3] = a->centre_px[i][1];
    a->cam_from_rig[i] = r->cam_from_rig[i];
  }
  a->points = calloc(n_points, sizeof *a->points);
  a->observations = calloc(n_points * (size_t)b->n_cameras, sizeof *a->observations);
  if (!a->points || !a->observations)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for corners", j->o->isolated);
  a->n_points = 0;
  take_corners(j, b, r);
  a->is_focal_known = true;
  a->focal_sd = FOCAL_SD;
  a->centre_sd_px = CENTRE_SD * j->lenses.lenses[0].footprint.width_px;
  sv_status s = sv_array_solve(a, 4, &j->stats, err);
  double scale = s == SV_OK ? size / mean_distance(a->cam_from_rig, a->n_views) : 1;
  for (int i = 0; i < a->n_views; i++)
    for (int k = 0; k < 3; k++) a->cam_from_rig[i].t[k] *= scale;
  j->rms_px = j->stats.rms_px;
  j->n_used = a->n_observations - j->stats.n_outliers;
  j->rotation_sd_deg = j->stats.rotation_sd_deg;
  j->focal_sd_px = j->stats.focal_sd_px;
  return s;
}

static sv_status calibrate_board(job *j, sv_err *err) {
  cal_lenses *l = &j->lenses;
  const char *names[SV_CAP_SUB_VIEWS];
  int size[SV_CAP_SUB_VIEWS][2];
  size_t n = (size_t)j->o->n_cols * (size_t)j->o->n_rows,
         cells = (size_t)l->n_lenses * (size_t)l->n_exposures;
  double *uv = calloc(cells * n * 2, sizeof *uv);
  uint8_t *seen = calloc(cells, 1);
  sv_boards_result r;
  sv_status s = sv_boards_available(err);
  if (s == SV_OK) s = sv_corners_available(j->o->n_cols, j->o->n_rows, err);
  if (s == SV_OK && (!uv || !seen)) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for corners", j->o->isolated);
  for (int i = 0; i < l->n_lenses && s == SV_OK; i++) {
    const sv_footprint *f = &l->lenses[i].footprint;
    names[i] = l->lenses[i].name;
    size[i][0] = f->width_px;
    size[i][1] = f->height_px;
    for (int e = 0; e < l->n_exposures && (s = cal_stopped(j->session, NULL, err)) == SV_OK; e++) {
      size_t at = (size_t)i * (size_t)l->n_exposures + (size_t)e;
      sv_corners_job c = {j->o->n_cols, j->o->n_rows, f->width_px, f->height_px, l->lenses[i].grey[e]};
      if (c.grey) seen[at] = sv_corners_find(&c, uv + 2 * n * at);
    }
  }
  sv_boards b = {l->n_lenses,
                 l->n_exposures,
                 j->o->n_cols,
                 j->o->n_rows,
                 j->o->spacing_m,
                 SV_MODEL_PINHOLE,
                 l->n_exposures >= 8,
                 names,
                 (const int(*)[2])size,
                 uv,
                 seen};
  if (s == SV_OK && (s = sv_boards_solve(&b, &r, err)) == SV_OK) {
    s = refine_board(j, &b, &r, err);
    sv_boards_free(&r);
  }
  free(uv);
  free(seen);
  return s;
}

// --- the result ----------------------------------------------------------------------------------
static sv_status write_rig(job *j, sv_err *err) {
  cal_lenses *l = &j->lenses;
  sv_sub_view *views = calloc((size_t)l->n_lenses, sizeof *views);
  if (!views) return sv_fail(err, SV_E_NOMEM, "%s: no memory to write the rig", j->o->out);
  sv_rig rig = {.forward = SV_FORWARD_MULTIPLEXED, .n_sub_views = l->n_lenses, .cap_sub_views = l->n_lenses};
  rig.sub_views = views;
  sv_fmt(rig.name, sizeof rig.name, "%.31s", j->o->name ? j->o->name : sv_path_name(j->o->out));
  if (!*rig.name) sv_fmt(rig.name, sizeof rig.name, "rig");
  for (int i = 0; i < l->n_lenses; i++) {
    views[i] = (sv_sub_view){.model = j->bundle.models[i],
                             .cam_from_rig = j->bundle.cam_from_rig[i],
                             .footprint = l->lenses[i].footprint};
    sv_copy(views[i].name, sizeof views[i].name, l->lenses[i].name);
  }
  sv_status s = cal_rig_write(j->o->out, &rig, err);
  free(views);
  return s;
}

static void report(lab_report *r, const job *j) {
  lab_report_begin(r);
  lab_report_text(r, "object", j->o->board ? "board" : "texture");
  lab_report_num(r, "rms_px", j->rms_px);
  lab_report_int(r, "observations", j->n_used);
  lab_report_int(r, "exposures", j->lenses.n_exposures);
  lab_report_num(r, "rotation_sd_deg", j->rotation_sd_deg);
  lab_report_num(r, "focal_sd_px", j->focal_sd_px);
  lab_report_num(r, "largest_overlap", j->lenses.max_overlap);
  lab_report_array(r, "lenses");
  for (int i = 0; i < j->lenses.n_lenses; i++) {
    const cal_lens *l = &j->lenses.lenses[i];
    const double *p = j->bundle.models[i].p;
    double c[3];
    sv_pose_centre(c, &j->bundle.cam_from_rig[i]);
    lab_report_item_begin(r);
    lab_report_text(r, "name", l->name);
    lab_report_nums(r, "footprint",
                    (float[4]){(float)l->footprint.x0_px, (float)l->footprint.y0_px,
                               (float)l->footprint.width_px, (float)l->footprint.height_px},
                    4);
    lab_report_num(r, "area_px", l->stats.area_px);
    lab_report_num(r, "fx_px", p[0]);
    lab_report_num(r, "cx_px", p[2]);
    lab_report_num(r, "cy_px", p[3]);
    lab_report_nums(r, "centre", (float[3]){(float)c[0], (float)c[1], (float)c[2]}, 3);
    lab_report_item_end(r);
  }
  lab_report_array_end(r);
  cal_report_warnings(r, &j->advice);
  lab_report_end(r);
}

static sv_status finish(job *j, sv_err *err) {
  char path[SV_CAP_PATH];
  lab_report r = {0};
  lab_session *se = j->session;
  if (j->rotation_sd_deg > GOOD_SD_DEG)
    cal_advise(&j->advice,
               "directions of the lenses are uncertain by %.3f degrees: add exposures of an object with "
               "more depth and texture, or of a chessboard",
               j->rotation_sd_deg);
  lab_say(se,
          "%.3f px RMS over %d %s in %d exposures; focal lengths uncertain by %.2f px, directions by %.3f "
          "degrees",
          j->rms_px, j->n_used, j->o->board ? "corners" : "features", j->lenses.n_exposures, j->focal_sd_px,
          j->rotation_sd_deg);
  lab_say(se, "%d lenses, at most %.2f overlap in one pixel", j->lenses.n_lenses,
          (double)j->lenses.max_overlap);
  for (int i = 0; i < j->advice.n; i++) se->console.log(se->console.self, SV_LOG_WARN, j->advice.text[i]);
  sv_status s = write_rig(j, err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, j->o->out, "calibration.json", err);
  if (s == SV_OK) {
    report(&r, j);
    s = lab_report_save(&r, path, err);
  }
  if (s == SV_OK && j->o->is_json) {
    report(&r, j);
    s = lab_report_print(&r, err);
  }
  if (s == SV_OK) lab_say(se, "wrote %s (rig.json, calibration.json, coverage images)", j->o->out);
  return s;
}

static sv_status calibrate(job *j, sv_err *err) {
  sv_status s = cal_lenses_read(&j->lenses, j->o, j->session, err);
  if (s != SV_OK) return s;
  size_t n = (size_t)j->lenses.n_lenses;
  cal_advise_spacing(&j->advice, j->o->spacing_m);
  j->bundle.n_views = j->lenses.n_lenses;
  j->bundle.models = calloc(n, sizeof *j->bundle.models);
  j->bundle.cam_from_rig = calloc(n, sizeof *j->bundle.cam_from_rig);
  j->bundle.centre_px = calloc(n, sizeof *j->bundle.centre_px);
  if (!j->bundle.models || !j->bundle.cam_from_rig || !j->bundle.centre_px)
    return sv_fail(err, SV_E_NOMEM, "no memory for %zu lenses", n);
  for (int i = 0; i < j->bundle.n_views; i++) find_centre(&j->lenses.lenses[i], j->bundle.centre_px[i]);
  lab_say(j->session, "%zu lenses on %dx%d pixels, %d isolated exposures", n, j->lenses.width_px,
          j->lenses.height_px, j->lenses.n_exposures);
  s = j->o->board ? calibrate_board(j, err) : calibrate_texture(j, err);
  if (s == SV_OK && !j->o->board) set_scale(j);
  if (s == SV_OK) s = cal_stopped(j->session, NULL, err);
  return s == SV_OK ? finish(j, err) : s;
}

int cal_cmd_lenslets(const cal_options *o) {
  lab_session se;
  sv_err err = {0};
  job *j = calloc(1, sizeof *j);
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK && !j) s = sv_fail(&err, SV_E_NOMEM, "no memory");
  if (s == SV_OK) {
    j->o = o;
    j->session = &se;
    s = calibrate(j, &err);
  }
  if (s != SV_OK) lab_failed(&se, &err);
  if (j) {
    free(j->bundle.models);
    free(j->bundle.centre_px);
    free(j->bundle.cam_from_rig);
    free(j->bundle.points);
    free(j->bundle.observations);
    cal_lenses_free(&j->lenses);
  }
  free(j);
  lab_session_stop(&se);
  return s == SV_OK ? CAL_EXIT_OK : CAL_EXIT_FAILED;
}
