// SPDX-License-Identifier: Apache-2.0
// What a dataset or a rig holds, and its angular baseline theta: the largest angle between two
// sub-views of an exposure, as seen from the scene's center of gravity (the paper's section "Light
// field sampling"): the centroid of the dataset's points, or, without points, the point nearest to
// all optical axes; of a rig, the point on its mean axis at a given distance.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/format/rig_file.h"
#include "tools/common/report.h"
#include "tools/lab/lab.h"

#define SCRATCH_BYTES ((size_t)16 << 20)
#define ARENA_BYTES   ((size_t)256 << 20) // of address space; pages come when they are used
#define DEG           (SV_PI / 180)

typedef struct {
  const lab_options *o;
  lab_session session;
  lab_views views;
  int n_exposures, n_cameras; // cameras: at most in one exposure
  double center[3];
  const char *center_from;
  double theta_deg, theta_min_deg, theta_max_deg; // theta: mean over the exposures
} run;

static double angle_deg(const double a[3], const double b[3], const double center[3]) {
  double u[3], v[3], w[3];
  sv_sub3(u, a, center);
  sv_sub3(v, b, center);
  sv_cross3(w, u, v);
  return atan2(sv_norm3(w), sv_dot3(u, v)) / DEG;
}

// The largest angle between two of n places, each of 3 numbers.
static double largest_angle_deg(const double *place, int n, const double center[3]) {
  double most = 0;
  for (int i = 0; i < n; i++)
    for (int k = 0; k < i; k++) most = fmax(most, angle_deg(place + 3 * i, place + 3 * k, center));
  return most;
}

static void add_exposure(run *r, const double *place, int n) {
  const double theta = largest_angle_deg(place, n, r->center);
  r->theta_min_deg = r->n_exposures ? fmin(r->theta_min_deg, theta) : theta;
  r->theta_max_deg = fmax(r->theta_max_deg, theta);
  r->theta_deg = (r->theta_deg * r->n_exposures + theta) / (r->n_exposures + 1);
  r->n_cameras = sv_maxi(r->n_cameras, n);
  r->n_exposures++;
}

static sv_status find_center(run *r, sv_err *err) {
  sv_point *points;
  int n;
  float center[3], radius;
  if (!*r->views.points) {
    const lab_scene scene = lab_scene_of(&r->views);
    for (int k = 0; k < 3; k++) r->center[k] = (double)scene.centre[k];
    r->center_from = "the point nearest to all optical axes";
    return SV_OK;
  }
  sv_status s = lab_points_read(r->views.points, &points, &n, center, &radius, err);
  if (s != SV_OK) return s;
  free(points);
  for (int k = 0; k < 3; k++) r->center[k] = (double)center[k];
  r->center_from = "the centroid of the points";
  return SV_OK;
}

// Frames without an exposure's number are exposures of their own.
static sv_status of_dataset(run *r, sv_err *err) {
  const lab_source src = {.folder = r->o->data,
                          .transforms = r->o->transforms,
                          .split = r->o->split ? r->o->split : "train",
                          .scale = 1};
  sv_status s = lab_views_open(&r->views, &src, &r->session.pool, err);
  if (s == SV_OK) s = find_center(r, err);
  if (s != SV_OK) return s;
  const lab_frame *f = r->views.frames;
  double *place = malloc((size_t)r->views.n * 3 * sizeof *place);
  if (!place) return sv_fail(err, SV_E_NOMEM, "no memory for %d views", r->views.n);
  for (int i = 0; i < r->views.n; i++) {
    const int e = f[i].f.exposure;
    int n = 0;
    bool is_first = true;
    for (int k = 0; k < i && e >= 0; k++) is_first &= f[k].f.exposure != e;
    if (!is_first) continue;
    for (int k = i; k < r->views.n; k++)
      if (k == i || (e >= 0 && f[k].f.exposure == e)) sv_pose_centre(place + 3 * n++, &f[k].f.cam_from_world);
    add_exposure(r, place, n);
  }
  free(place);
  return SV_OK;
}

static sv_status measure_rig(run *r, sv_arena *arena, sv_err *err) {
  sv_rig rig;
  sv_file_reader files = {(void *)(uintptr_t)r->o->rig, sv_folder_read};
  if (sv_rig_init(&rig, SV_CAP_SUB_VIEWS, arena) != SV_OK)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", r->o->rig);
  sv_arena scratch = sv_arena_sub(arena, SCRATCH_BYTES);
  sv_status s = sv_rig_read(&rig, &files, -1, &scratch, err);
  if (s != SV_OK) return s;
  double *place = SV_TAKE(arena, double, 3 * rig.n_sub_views), axis[3] = {0};
  if (!place) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its sub-views", r->o->rig);
  for (int i = 0; i < rig.n_sub_views; i++) {
    const sv_pose *p = &rig.sub_views[i].cam_from_rig;
    sv_pose_centre(place + 3 * i, p);
    for (int k = 0; k < 3; k++) {
      r->center[k] += place[3 * i + k] / rig.n_sub_views;
      axis[k] += p->r[6 + k];
    }
  }
  const double n = sv_norm3(axis);
  for (int k = 0; k < 3; k++) r->center[k] += n > 0 ? axis[k] / n * r->o->distance_m : 0;
  r->center_from = "the point at --distance before the rig";
  add_exposure(r, place, rig.n_sub_views);
  return SV_OK;
}

static sv_status of_rig(run *r, sv_err *err) {
  void *block = malloc(ARENA_BYTES);
  if (!block) return sv_fail(err, SV_E_NOMEM, "no memory for a rig");
  sv_arena arena = sv_arena_make(block, ARENA_BYTES);
  sv_status s = measure_rig(r, &arena, err);
  free(block);
  return s;
}

static sv_status print(const run *r, sv_err *err) {
  if (!r->o->is_json) {
    if (r->views.n)
      printf("%s: %d view%s of up to %dx%d, ", r->views.transforms, r->views.n, r->views.n == 1 ? "" : "s",
             r->views.cap_width_px, r->views.cap_height_px);
    printf("%d exposure%s of up to %d sub-view%s\n", r->n_exposures, r->n_exposures == 1 ? "" : "s",
           r->n_cameras, r->n_cameras == 1 ? "" : "s");
    printf("angular baseline theta: %.3f degrees (%.3f to %.3f over the exposures), seen from %s\n",
           r->theta_deg, r->theta_min_deg, r->theta_max_deg, r->center_from);
    return SV_OK;
  }
  lab_report j;
  const float center[3] = {(float)r->center[0], (float)r->center[1], (float)r->center[2]};
  lab_report_begin(&j);
  if (r->views.n) lab_report_int(&j, "views", r->views.n);
  lab_report_int(&j, "exposures", r->n_exposures);
  lab_report_int(&j, "sub_views", r->n_cameras);
  lab_report_num(&j, "theta_deg", r->theta_deg);
  lab_report_num(&j, "theta_min_deg", r->theta_min_deg);
  lab_report_num(&j, "theta_max_deg", r->theta_max_deg);
  lab_report_nums(&j, "center", center, 3);
  lab_report_text(&j, "center_from", r->center_from);
  lab_report_end(&j);
  return lab_report_print(&j, err);
}

int lab_cmd_info(const lab_options *o) {
  sv_err err = {0};
  run r = {.o = o};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&r.session, 1, o->is_quiet, &err);
  if (s == SV_OK) s = o->data ? of_dataset(&r, &err) : of_rig(&r, &err);
  if (s == SV_OK) s = print(&r, &err);
  if (s != SV_OK) code = lab_failed(&r.session, &err);
  lab_session_stop(&r.session);
  lab_views_free(&r.views);
  return code;
}
