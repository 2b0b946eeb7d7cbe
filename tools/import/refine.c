// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment of imported views (src/track/bundle.h). In rounds: all points are triangulated
// at the present poses, what does not agree with them is left out, and poses and points are
// adjusted together; the limit of agreement falls with the residuals.
#include "tools/import/refine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/track/bundle.h"
#include "src/track/pose.h"

#define N_ROUNDS     6
#define N_ITERATIONS 20
#define HUBER_PX     0.3
#define COARSE       0.2 // weight of a residual whose feature was not aligned
#define LEAST_PX     0.5 // smallest limit of agreement
#define N_SIGMAS     5.0
#define MIN_OBS      8    // points that poses share which are adjusted to each other
#define CAP_POSES    1200 // the dense system grows with their square
#define CAP_SEEN     256  // views of a point that count
#define ENOUGH       1.5  // poses are left alone when the residuals are at most so much larger
#define SIGMA_FOCAL  0.02
#define SIGMA_CENTRE 0.02
#define SAME_POSE    1e-7 // relative poses of a rig whose views were placed by one

typedef struct {
  lab_import *im;
  const lab_matches *m;
  const lab_refine_options *o;
  int *pose_of, *camera_of;        // [n views]
  sv_pose *given, *before, *after; // [n_poses] rig_from_world
  int *part, *n_shared;            // [n_poses] part of the matched poses; observations
  int *exposure;                   // [n_poses] -1: a view by itself
  int *key;                        // [n_cameras] sub-view of the rig, -1: none
  sv_camera_model *lens;           // [n_cameras]
  char (*name)[32];                // [n_cameras]
  int n_poses, n_cameras;
  double sigma_rot_rad, sigma_trans; // of the rig's poses
  bool is_rig_free;
  bool *is_used; // [n_obs]
  double (*x)[3], limit_px, *work;
  bool *has_x; // [n_points]
  sv_bundle b;
  void *block;
} job;

// --- poses and cameras ---------------------------------------------------------------------------

static bool is_member(const job *j, int i) {
  const lab_import_view *v = &j->im->views[i];
  if (!j->o->is_rig || v->exposure < 0 || v->sub_view < 0) return false;
  for (int k = 0; k < j->im->n; k++)
    if (k != i && j->im->views[k].exposure == v->exposure && j->im->views[k].sub_view >= 0 &&
        strcmp(j->im->views[k].split, v->split) == 0)
      return true;
  return false;
}

static int camera_for(job *j, int i, bool member) {
  const lab_import_view *v = &j->im->views[i];
  const int key = member ? v->sub_view : -1;
  for (int c = 0; c < j->n_cameras; c++)
    if (j->key[c] == key && memcmp(&j->lens[c], &v->model, sizeof v->model) == 0 &&
        (key >= 0 || sv_str_eq(j->name[c], v->camera)))
      return c;
  j->key[j->n_cameras] = key;
  j->lens[j->n_cameras] = v->model;
  sv_copy(j->name[j->n_cameras], sizeof j->name[0], v->camera);
  return j->n_cameras++;
}

static int pose_for(job *j, int i, bool member) {
  const lab_import_view *v = &j->im->views[i];
  for (int k = 0; k < i && member; k++)
    if (j->exposure[j->pose_of[k]] == v->exposure && strcmp(j->im->views[k].split, v->split) == 0)
      return j->pose_of[k];
  j->exposure[j->n_poses] = member ? v->exposure : -1;
  return j->n_poses++;
}

// Mean of poses that are near each other: of the rotations, by their twists from the first.
static sv_pose mean_pose(const sv_pose *p, int n) {
  double twist[6] = {0};
  sv_pose back = sv_pose_inv(&p[0]), out = p[0];
  for (int i = 1; i < n; i++) {
    sv_pose d = sv_pose_mul(&p[i], &back);
    double w[3];
    sv_rodrigues_inv(w, d.r);
    for (int k = 0; k < 3; k++) {
      twist[k] += w[k] / n;
      twist[3 + k] += d.t[k] / n;
    }
  }
  sv_pose_twist(&out, twist);
  return out;
}

// Relative poses of the rig's cameras: means over the exposures, about camera `key[first]`.
static void find_rig(job *j, sv_pose *mount, sv_pose *work) {
  int first = -1;
  double rot2 = 0, trans2 = 0;
  int n_all = 0;
  for (int c = 0; c < j->n_cameras; c++) {
    mount[c] = sv_pose_identity();
    if (j->key[c] >= 0 && (first < 0 || j->key[c] < j->key[first])) first = c;
  }
  for (int c = 0; c < j->n_cameras; c++) {
    int n = 0;
    if (j->key[c] < 0 || j->key[c] == j->key[first]) continue;
    for (int a = 0; a < j->im->n; a++)
      for (int b = 0; b < j->im->n; b++) {
        if (j->camera_of[a] != c || j->key[j->camera_of[b]] != j->key[first] ||
            j->pose_of[a] != j->pose_of[b])
          continue;
        sv_pose back = sv_pose_inv(&j->im->views[b].cam_from_world);
        work[n++] = sv_pose_mul(&j->im->views[a].cam_from_world, &back);
      }
    if (n == 0) continue;
    mount[c] = mean_pose(work, n);
    for (int i = 0; i < n; i++) {
      sv_pose back = sv_pose_inv(&mount[c]), d = sv_pose_mul(&work[i], &back);
      double w[3];
      sv_rodrigues_inv(w, d.r);
      rot2 += sv_dot3(w, w);
      trans2 += sv_dot3(d.t, d.t);
    }
    n_all += n;
  }
  j->sigma_rot_rad = n_all ? sqrt(rot2 / (3.0 * n_all)) : 0;
  j->sigma_trans = n_all ? sqrt(trans2 / (3.0 * n_all)) : 0;
  j->is_rig_free = !j->o->is_rig_known && (j->sigma_rot_rad > SAME_POSE || j->sigma_trans > SAME_POSE);
}

static sv_pose rig_pose_of(const job *j, int i_view) {
  sv_pose rig_from_cam = sv_pose_inv(&j->b.camera[j->camera_of[i_view]].cam_from_rig);
  return sv_pose_mul(&rig_from_cam, &j->im->views[i_view].cam_from_world);
}

static bool is_free_lens(const job *j, int c) {
  const char *list = j->o->free_lenses;
  if (!list) return false;
  if (sv_str_eq(list, "all")) return true;
  const size_t n = strlen(j->name[c]);
  for (const char *p = list; n && p; p = strchr(p, ',')) {
    p += *p == ',';
    if (strncmp(p, j->name[c], n) == 0 && (p[n] == ',' || !p[n])) return true;
  }
  return false;
}

// --- memory --------------------------------------------------------------------------------------

static sv_status allocate(job *j, sv_err *err) {
  const size_t n = (size_t)j->im->n, n_obs = (size_t)j->m->n_obs + 1, n_points = (size_t)j->m->n_points + 1;
  j->pose_of = calloc(n, sizeof *j->pose_of);
  j->camera_of = calloc(n, sizeof *j->camera_of);
  j->given = calloc(n, sizeof *j->given);
  j->before = calloc(n, sizeof *j->before);
  j->after = calloc(n, sizeof *j->after);
  j->part = calloc(n, sizeof *j->part);
  j->n_shared = calloc(n, sizeof *j->n_shared);
  j->exposure = calloc(n, sizeof *j->exposure);
  j->key = calloc(n, sizeof *j->key);
  j->lens = calloc(n, sizeof *j->lens);
  j->name = calloc(n, sizeof *j->name);
  j->is_used = calloc(n_obs, sizeof *j->is_used);
  j->work = calloc(n_obs, sizeof *j->work);
  j->x = calloc(n_points, sizeof *j->x);
  j->has_x = calloc(n_points, sizeof *j->has_x);
  bool has = j->pose_of && j->camera_of && j->given && j->before && j->after && j->part && j->n_shared &&
             j->exposure && j->key && j->lens && j->name && j->is_used && j->work && j->x && j->has_x;
  return has ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory to refine %d poses", j->im->n);
}

static void free_job(job *j) {
  free(j->pose_of);
  free(j->camera_of);
  free(j->given);
  free(j->before);
  free(j->after);
  free(j->part);
  free(j->n_shared);
  free(j->exposure);
  free(j->key);
  free(j->lens);
  free(j->name);
  free(j->is_used);
  free(j->work);
  free(j->x);
  free(j->has_x);
  free(j->block);
}

static sv_status make_bundle(job *j, sv_err *err) {
  const sv_bundle_cfg cfg = {.cap_poses = j->n_poses,
                             .cap_cameras = j->n_cameras,
                             .cap_points = j->m->n_points + 1,
                             .cap_obs = j->m->n_obs + 1,
                             .has_extrinsics = true,
                             .has_lenses = j->o->free_lenses != NULL};
  if (j->n_poses > CAP_POSES)
    return sv_fail(err, SV_E_RANGE, "%d poses to refine; expected at most %d", j->n_poses, CAP_POSES);
  sv_arena dry = sv_arena_dry();
  if (sv_bundle_init(&j->b, &cfg, &dry) != SV_OK) return sv_fail(err, SV_E_RANGE, "too many poses");
  const size_t bytes = sv_arena_mark(&dry) + 4096;
  if (!(j->block = malloc(bytes))) return sv_fail(err, SV_E_NOMEM, "no memory for %d poses", j->n_poses);
  sv_arena a = sv_arena_make(j->block, bytes);
  sv_status s = sv_bundle_init(&j->b, &cfg, &a);
  return s == SV_OK ? s : sv_fail(err, s, "no memory for %d poses", j->n_poses);
}

static sv_status set_up(job *j, sv_err *err) {
  for (int i = 0; i < j->im->n; i++) {
    const bool member = is_member(j, i);
    j->pose_of[i] = pose_for(j, i, member);
    j->camera_of[i] = camera_for(j, i, member);
  }
  sv_status s = make_bundle(j, err);
  sv_pose *mount = calloc((size_t)j->n_cameras, sizeof *mount);
  sv_pose *work = calloc((size_t)j->im->n * 2 + 1, sizeof *work);
  if (s == SV_OK && (!mount || !work)) s = sv_fail(err, SV_E_NOMEM, "no memory for %d poses", j->n_poses);
  if (s == SV_OK) find_rig(j, mount, work);
  for (int c = 0; s == SV_OK && c < j->n_cameras; c++) {
    const double *p = j->lens[c].p;
    j->b.camera[c] = (sv_bundle_camera){mount[c], p[0], p[1], p[2], p[3]};
    j->b.calibrated[c] = mount[c];
    j->b.is_lens_free[c] = is_free_lens(j, c);
  }
  for (int k = 0; s == SV_OK && k < j->n_poses; k++) {
    int n = 0;
    for (int i = 0; i < j->im->n; i++)
      if (j->pose_of[i] == k) work[n++] = rig_pose_of(j, i);
    j->b.pose[k] = j->given[k] = mean_pose(work, n);
    j->b.is_fixed[k] = false;
  }
  free(mount);
  free(work);
  return s;
}

// --- points --------------------------------------------------------------------------------------

static sv_pose cam_pose(const job *j, int i_view) {
  return sv_pose_mul(&j->b.camera[j->camera_of[i_view]].cam_from_rig, &j->b.pose[j->pose_of[i_view]]);
}

static bool ray_of(const job *j, const sv_array_observation *o, double ray[2]) {
  double d[3];
  if (!sv_model_unproject(&j->lens[j->camera_of[o->view]], o->uv_px, d) || !(d[2] > 0.05)) return false;
  ray[0] = d[0] / d[2];
  ray[1] = d[1] / d[2];
  return true;
}

static float weight_of(const sv_array_observation *o) { return o->is_coarse ? (float)COARSE : 1; }

// In pixels of aligned features: residuals of coarse ones count less.
static double residual_px(const job *j, const lab_ray *r, const sv_array_observation *o, const double x[3]) {
  const int i_camera = j->camera_of[o->view];
  double c[3];
  sv_pose_apply(c, &r->cam_from_world, x);
  if (!(c[2] > 0)) return 1e9;
  return (double)weight_of(o) * j->b.camera[i_camera].fx *
         hypot(c[0] / c[2] - r->ray[0], c[1] / c[2] - r->ray[1]);
}

// Triangulates a point; what agrees least is left out until the rest agrees within the limit.
static void place_point(job *j, int i_point) {
  lab_ray rays[CAP_SEEN];
  int at[CAP_SEEN], n = 0;
  const int first = j->m->first[i_point], end = j->m->first[i_point + 1];
  j->has_x[i_point] = false;
  for (int i = first; i < end; i++) {
    j->is_used[i] = false;
    if (n == CAP_SEEN || !ray_of(j, &j->m->obs[i], rays[n].ray)) continue;
    rays[n].cam_from_world = cam_pose(j, j->m->obs[i].view);
    at[n++] = i;
  }
  while (n >= 3 && lab_triangulate(rays, n, j->x[i_point])) {
    double worst_px = 0;
    int worst = 0;
    for (int i = 0; i < n; i++) {
      double r = residual_px(j, &rays[i], &j->m->obs[at[i]], j->x[i_point]);
      if (r <= worst_px) continue;
      worst_px = r;
      worst = i;
    }
    if (worst_px <= j->limit_px) {
      for (int i = 0; i < n; i++) j->is_used[at[i]] = true;
      j->has_x[i_point] = true;
      return;
    }
    n--;
    rays[worst] = rays[n];
    at[worst] = at[n];
  }
}

static int by_value(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return x < y ? -1 : x > y;
}

// Residuals of all that is used, in pixels: how many, their median in *median_px and root mean
// square of an axis in *rms_px.
static int residuals(job *j, double *median_px, double *rms_px) {
  int n = 0;
  double sum = 0;
  for (int p = 0; p < j->m->n_points; p++)
    for (int i = j->m->first[p]; j->has_x[p] && i < j->m->first[p + 1]; i++) {
      lab_ray r;
      const int view = j->m->obs[i].view;
      if (!j->is_used[i] || !ray_of(j, &j->m->obs[i], r.ray)) continue;
      r.cam_from_world = cam_pose(j, view);
      j->work[n] = residual_px(j, &r, &j->m->obs[i], j->x[p]);
      sum += j->work[n] * j->work[n];
      n++;
    }
  *median_px = *rms_px = 0;
  if (n == 0) return 0;
  qsort(j->work, (size_t)n, sizeof *j->work, by_value);
  *median_px = j->work[n / 2];
  *rms_px = sqrt(sum / (2.0 * n));
  return n;
}

// --- rounds --------------------------------------------------------------------------------------

static void fill_bundle(job *j, int *point_of) {
  sv_bundle *b = &j->b;
  int n_obs = 0;
  b->n_poses = j->n_poses;
  b->n_cameras = j->n_cameras;
  b->n_points = 0;
  for (int p = 0; p < j->m->n_points; p++) {
    if (!j->has_x[p]) continue;
    b->first[b->n_points] = n_obs;
    memcpy(b->point[b->n_points], j->x[p], sizeof j->x[p]);
    point_of[b->n_points++] = p;
    for (int i = j->m->first[p]; i < j->m->first[p + 1]; i++) {
      double ray[2];
      const int view = j->m->obs[i].view, c = j->camera_of[view];
      const sv_bundle_camera *cam = &b->camera[c];
      if (!j->is_used[i] || !ray_of(j, &j->m->obs[i], ray)) continue;
      b->obs[n_obs++] =
          (sv_bundle_obs){.i_pose = (int16_t)j->pose_of[view],
                          .i_camera = (int16_t)c,
                          .uv_px = {(float)(cam->fx * ray[0] + cam->cx), (float)(cam->fy * ray[1] + cam->cy)},
                          .weight = weight_of(&j->m->obs[i])};
    }
  }
  b->first[b->n_points] = n_obs;
}

// Poses that share enough points belong together; between parts that do not, nothing is known.
static sv_status find_parts(job *j, sv_err *err) {
  const size_t n = (size_t)j->n_poses;
  uint16_t *shared = calloc(n * n, sizeof *shared);
  if (!shared) return sv_fail(err, SV_E_NOMEM, "no memory for %d poses", j->n_poses);
  for (int p = 0; p < j->b.n_points; p++)
    for (int a = j->b.first[p]; a < j->b.first[p + 1]; a++)
      for (int b = j->b.first[p]; b < j->b.first[p + 1]; b++) {
        const size_t at = (size_t)j->b.obs[a].i_pose * n + (size_t)j->b.obs[b].i_pose;
        if (shared[at] < UINT16_MAX) shared[at]++;
      }
  for (int k = 0; k < j->n_poses; k++) j->part[k] = k;
  for (bool has_changed = true; has_changed;) {
    has_changed = false;
    for (size_t a = 0; a < n; a++)
      for (size_t b = 0; b < a; b++) {
        if (shared[a * n + b] < MIN_OBS || j->part[a] == j->part[b]) continue;
        j->part[a] = j->part[b] = sv_mini(j->part[a], j->part[b]);
        has_changed = true;
      }
  }
  for (size_t k = 0; k < n; k++) j->n_shared[k] = shared[k * n + k];
  free(shared);
  return SV_OK;
}

// Holds one pose of each part. Returns how many stay free.
static int choose_fixed(job *j) {
  int n_free = 0;
  for (int k = 0; k < j->n_poses; k++) {
    int best = k;
    for (int i = 0; i < j->n_poses; i++)
      if (j->part[i] == j->part[k] && j->n_shared[i] > j->n_shared[best]) best = i;
    j->b.is_fixed[k] = best == k;
    n_free += best != k;
  }
  return n_free;
}

static sv_status adjust(job *j, int *point_of, sv_err *err) {
  sv_bundle_result r;
  const sv_bundle_options o = {.max_iterations = N_ITERATIONS,
                               .huber_px = HUBER_PX,
                               .is_extrinsics = j->is_rig_free,
                               .sigma_rot_rad = fmax(j->sigma_rot_rad, 1e-6),
                               .sigma_trans_m = fmax(j->sigma_trans, 1e-9),
                               .is_lenses = j->o->free_lenses != NULL,
                               .sigma_focal = SIGMA_FOCAL,
                               .sigma_centre = SIGMA_CENTRE};
  fill_bundle(j, point_of);
  sv_status s = find_parts(j, err);
  if (s != SV_OK) return s;
  if (choose_fixed(j) < 1)
    return sv_fail(
        err, SV_E_NOT_FOUND,
        "the images do not match each other at these poses: %d points agree; are they the poses of "
        "these images?",
        j->b.n_points);
  s = sv_bundle_solve(&j->b, &o, &r);
  if (s != SV_OK) return sv_fail(err, s, "bundle adjustment of %d poses failed", j->n_poses);
  for (int i = 0; i < j->b.n_points; i++) memcpy(j->x[point_of[i]], j->b.point[i], sizeof j->x[0]);
  for (int c = 0; c < j->n_cameras; c++) {
    const double lens[4] = {j->b.camera[c].fx, j->b.camera[c].fy, j->b.camera[c].cx, j->b.camera[c].cy};
    if (j->b.is_lens_free[c]) memcpy(j->lens[c].p, lens, sizeof lens);
  }
  return SV_OK;
}

static sv_status rounds(job *j, lab_refined *out, sv_err *err) {
  sv_status s = SV_OK;
  double median_px, rms_px;
  int *point_of = calloc((size_t)j->m->n_points + 1, sizeof *point_of);
  if (!point_of) return sv_fail(err, SV_E_NOMEM, "no memory for %d points", j->m->n_points);
  j->limit_px = 0.05 * j->b.camera[0].fx;
  for (int round = 0; s == SV_OK && round < N_ROUNDS; round++) {
    for (int p = 0; p < j->m->n_points; p++) place_point(j, p);
    if (round == 0) {
      (void)residuals(j, &median_px, &rms_px);
      j->limit_px = fmax(N_SIGMAS * 1.5 * median_px, LEAST_PX);
      for (int p = 0; p < j->m->n_points; p++) place_point(j, p);
    }
    if ((s = adjust(j, point_of, err)) != SV_OK) break;
    out->n_obs = residuals(j, &median_px, &out->rms_px);
    out->n_points = j->b.n_points;
    j->limit_px = fmax(N_SIGMAS * median_px, LEAST_PX);
  }
  free(point_of);
  return s;
}

// What the final observations say of the poses as they were given: points are triangulated anew.
static void measure_given(job *j, lab_refined *out) {
  double median_px;
  sv_pose *keep = malloc((size_t)j->n_poses * sizeof *keep);
  out->rms_before_px = INFINITY;
  if (!keep) return;
  memcpy(keep, j->b.pose, (size_t)j->n_poses * sizeof *keep);
  memcpy(j->b.pose, j->given, (size_t)j->n_poses * sizeof *keep);
  for (int p = 0; p < j->m->n_points; p++) {
    lab_ray rays[CAP_SEEN];
    int n = 0;
    for (int i = j->m->first[p]; j->has_x[p] && i < j->m->first[p + 1]; i++) {
      if (!j->is_used[i] || n == CAP_SEEN || !ray_of(j, &j->m->obs[i], rays[n].ray)) continue;
      rays[n++].cam_from_world = cam_pose(j, j->m->obs[i].view);
    }
    if (j->has_x[p]) j->has_x[p] = lab_triangulate(rays, n, j->x[p]);
  }
  (void)residuals(j, &median_px, &out->rms_before_px);
  memcpy(j->b.pose, keep, (size_t)j->n_poses * sizeof *keep);
  free(keep);
}

// --- back ----------------------------------------------------------------------------------------

// A view gets its refined pose.
static void put_view(lab_import_view *v, const sv_pose *pose, lab_refined *out) {
  sv_pose was = v->cam_from_world, back = sv_pose_inv(&was);
  double w[3], c0[3], c1[3];
  v->cam_from_world = *pose;
  sv_pose d = sv_pose_mul(&v->cam_from_world, &back);
  sv_rodrigues_inv(w, d.r);
  sv_pose_centre(c0, &was);
  sv_pose_centre(c1, pose);
  sv_sub3(c1, c1, c0);
  out->moved_deg += sv_norm3(w) * 180 / SV_PI;
  out->moved += sv_norm3(c1);
  out->n_placed++;
}

// The world of a part's adjusted poses is the given one up to what no image tells: a similarity.
static void put_part(job *j, int part, lab_refined *out) {
  sv_pose *a = j->before, *b = j->after;
  int n = 0;
  const bool has_scale = !(j->o->is_rig && j->o->is_rig_known);
  for (int k = 0; k < j->n_poses; k++) {
    if (j->part[k] != part) continue;
    a[n] = j->b.pose[k];
    b[n++] = j->given[k];
  }
  if (n < 2) return;
  const sv_similarity world = sv_align_trajectories(a, b, n, has_scale);
  for (int i = 0; i < n; i++) a[i] = sv_similarity_apply(&world, &a[i]);
  const sv_similarity larger = sv_align_trajectories(b, a, n, true);
  for (int i = 0; i < j->im->n_points && !has_scale && n > out->n_poses; i++) {
    double x[3];
    for (int k = 0; k < 3; k++) x[k] = (double)j->im->points[i].mean[k];
    sv_apply33(x, larger.r, x);
    for (int k = 0; k < 3; k++) j->im->points[i].mean[k] = (float)(larger.s * x[k] + larger.t[k]);
  }
  out->n_poses += n;
  out->n_parts++;
  for (int i = 0; i < j->im->n; i++) {
    if (j->part[j->pose_of[i]] != part) continue;
    sv_pose rig = sv_similarity_apply(&world, &j->b.pose[j->pose_of[i]]);
    sv_pose mount = j->b.camera[j->camera_of[i]].cam_from_rig;
    for (int k = 0; k < 3; k++) mount.t[k] *= world.s;
    sv_pose pose = sv_pose_mul(&mount, &rig);
    put_view(&j->im->views[i], &pose, out);
    if (j->b.is_lens_free[j->camera_of[i]]) j->im->views[i].model = j->lens[j->camera_of[i]];
  }
}

static void put_back(job *j, lab_refined *out) {
  for (int k = 0; k < j->n_poses; k++) put_part(j, k, out);
  if (!out->n_placed) return;
  out->moved_deg /= out->n_placed;
  out->moved /= out->n_placed;
}

sv_status lab_import_refine(lab_import *im, const lab_matches *m, const lab_refine_options *o,
                            lab_refined *out, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  memset(out, 0, sizeof *out);
  if (!j) return sv_fail(err, SV_E_NOMEM, "no memory to refine %d poses", im->n);
  j->im = im;
  j->m = m;
  j->o = o;
  sv_status s = allocate(j, err);
  if (s == SV_OK) s = set_up(j, err);
  if (s == SV_OK) s = rounds(j, out, err);
  if (s == SV_OK) measure_given(j, out);
  out->is_kept =
      s == SV_OK && !o->free_lenses && !j->is_rig_free && out->rms_before_px < ENOUGH * out->rms_px;
  if (s == SV_OK && !out->is_kept) put_back(j, out);
  free_job(j);
  free(j);
  return s;
}
