// SPDX-License-Identifier: Apache-2.0
// Datasets of the simulator's scenes, laid out as those of the paper's experiment: for each device
// the images of a few exposures, and held-out views with depth beside the first exposure and all
// around. Of a moving scene: a rig that stands still, its camera alone, held-out times of all
// cameras, and held-out cameras over all times. Of a scene with rig=: that rig alone, as `subview
// run` captures it, and the views that its PSNR is measured on.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "src/base/str.h"
#include "tools/import/import.h"

#define N_EXPOSURES 3
#define N_TEST      40
#define DEPTH_UNIT  (1.0 / 8000)
#define N_TIMES     25 // of moving scenes
#define N_NOVEL     4
#define ANGLE_DEG   "10" // the paper's, unless the specification says another
#define SIZE        "400x400"
#define GOLDEN_DEG  137.50776405003785

#define CAP_FILES  80
#define CAP_ANGLES 16 // of a sweep
#define CAP_SLOTS  100

// A transforms file. All are kept until every image is there: without them a folder does not look
// like a dataset.
typedef struct {
  char name[100];
  char *text;
  size_t bytes;
} file;

typedef struct {
  const char *out;
  const lab_session *session;
  sv_sim sim;
  char folder[60]; // of the images of a device, below train
  int n_exposures; // of the devices of a still scene
  bool is_spread;  // exposures have the numbers of number_of, not those of their slots
  int number_of[CAP_SLOTS];
  void *block;
  file files[CAP_FILES];
  int n_files;
  FILE *f;           // the last of them, while it grows
  const char *split; // of the next frame, moving scenes only
  int n_written;
  uint8_t *rgb; // [height][width][3]
  float *depth; // [height][width]
  sv_err *err;
} job;

// 16 bits hold 8.2 m of the small scenes and all of the hall.
static double depth_unit(const job *j) {
  return j->sim.cfg.scene == SV_SIM_SCENE_HALL ? 2 * DEPTH_UNIT : DEPTH_UNIT;
}

static bool is_moving(const char *spec) {
  static const char name[] = "moving";
  return strncmp(spec, name, sizeof name - 1) == 0 && strchr(",", spec[sizeof name - 1]);
}

// rig NULL: everything is as spec says.
static sv_status start(job *j, const char *spec, const char *rig) {
  char text[400];
  sv_sim_config cfg;
  if (rig)
    snprintf(text, sizeof text, "%.300s,rig=%s%s%s%s", spec, rig,
             strstr(spec, "angle=") ? "" : ",angle=" ANGLE_DEG, strstr(spec, "size=") ? "" : ",size=" SIZE,
             is_moving(spec) && !strstr(spec, "arc=") ? ",arc=0" : "");
  sv_status s = sv_sim_parse(&cfg, rig ? text : spec, j->err);
  if (s < 0) return s;
  if (rig) cfg.n_exposures = is_moving(spec) ? N_TIMES : j->n_exposures;
  size_t bytes = sv_sim_bytes(&cfg) + SV_ARENA_ALIGN, px = (size_t)cfg.width_px * (size_t)cfg.height_px;
  j->block = malloc(bytes);
  j->rgb = malloc(3 * px);
  j->depth = malloc(px * sizeof *j->depth);
  if (!j->block || !j->rgb || !j->depth) return sv_fail(j->err, SV_E_NOMEM, "no memory for the simulator");
  sv_arena a = sv_arena_make(j->block, bytes);
  s = sv_sim_init(&j->sim, &cfg, &a, j->err);
  if (s >= 0) sv_copy(j->folder, sizeof j->folder, j->sim.rig.name);
  return s;
}

static void stop(job *j) {
  free(j->block);
  free(j->rgb);
  free(j->depth);
  j->block = j->rgb = NULL;
  j->depth = NULL;
}

// --- transforms ----------------------------------------------------------------------------------

static int exposure_of(const job *j, int slot) { return j->is_spread ? j->number_of[slot] : slot; }

// The sensor's measurement of each exposure, where lens images overlap.
static void put_measurements(job *j) {
  fprintf(j->f, " \"composites_linear\": [");
  for (int e = 0; e < j->sim.cfg.n_exposures; e++)
    fprintf(j->f, "%s{\"exposure\": %d, \"file_path\": \"train/%s/e%02d_composite.png\", \"M_max\": %d}",
            e ? ", " : "", exposure_of(j, e), j->folder, e, j->sim.largest_overlap);
  fprintf(j->f, "],\n");
}

// One of that name which is there already goes: its images are about to be replaced.
static sv_status open_transforms(job *j, const char *name, bool has_measurements) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, j->out, name, j->err);
  if (s < 0) return s;
  file *t = &j->files[j->n_files];
  sv_copy(t->name, sizeof t->name, name);
  j->f = j->n_files < CAP_FILES ? open_memstream(&t->text, &t->bytes) : NULL;
  if (!j->f) return sv_fail(j->err, SV_E_NOMEM, "%s: no memory for its text", path);
  j->n_files++;
  (void)remove(path);
  j->n_written = 0;
  fprintf(j->f,
          "{\"camera_model\": \"OPENCV\", \"world_unit\": \"m\", \"depth_unit_scale_factor\": %.17g, "
          "\"ray_distance_unit\": %.17g,\n",
          depth_unit(j), depth_unit(j));
  if (has_measurements) put_measurements(j);
  fprintf(j->f, " \"frames\": [\n");
  return SV_OK;
}

static sv_status close_transforms(job *j, sv_status s) {
  if (!j->f) return s;
  fprintf(j->f, "\n]}\n");
  bool is_bad = ferror(j->f) != 0;
  is_bad |= fclose(j->f) != 0;
  j->f = NULL;
  return s >= 0 && is_bad ? sv_fail(j->err, SV_E_NOMEM, "%s: no memory for a transforms file", j->out) : s;
}

// Those that are trained on come last.
static sv_status write_transforms(const job *j) {
  char path[SV_CAP_PATH];
  sv_status s = SV_OK;
  for (int i = j->n_files - 1; i >= 0 && s >= 0; i--) {
    s = sv_path_join(path, sizeof path, j->out, j->files[i].name, j->err);
    if (s >= 0) s = sv_file_write(path, j->files[i].text, j->files[i].bytes, j->err);
  }
  return s;
}

// Ours are OpenCV's axes, the file's are OpenGL's.
static void put_frame(job *j, const char *picture, const char *depth, const sv_view *v, const char *camera,
                      const sv_footprint *on_sensor) {
  float eye[3];
  sv_view_centre(eye, v);
  fprintf(j->f, "%s {\"file_path\": \"%s\", \"transform_matrix\": [", j->n_written++ ? ",\n" : "", picture);
  for (int i = 0; i < 3; i++)
    fprintf(j->f, "[%.9g, %.9g, %.9g, %.9g], ", (double)v->r[i], -(double)v->r[3 + i], -(double)v->r[6 + i],
            (double)eye[i]);
  fprintf(j->f,
          "[0, 0, 0, 1]], \"fl_x\": %.9g, \"fl_y\": %.9g, \"cx\": %.9g, \"cy\": %.9g, \"w\": %d, \"h\": %d",
          (double)v->fx, (double)v->fy, (double)v->cx, (double)v->cy, v->width_px, v->height_px);
  const double *k = j->sim.rig.sub_views[0].model.p + 4; // of all lenses
  if (v->fisheye)
    fprintf(j->f,
            ", \"camera_model\": \"OPENCV_FISHEYE\", \"k1\": %.9g, \"k2\": %.9g, \"k3\": %.9g, \"k4\": %.9g",
            k[0], k[1], k[2], k[3]);
  fprintf(j->f, ", \"exposure\": %d, \"sub_view\": %d, \"camera\": \"%s\"", v->i_exposure, v->i_sub_view,
          camera);
  if (depth) fprintf(j->f, ", \"%s\": \"%s\"", v->fisheye ? "ray_distance_path" : "depth_path", depth);
  if (j->split)
    fprintf(j->f, ", \"time\": %.9g, \"frame\": %d, \"split\": \"%s\"", (double)v->time, v->i_exposure,
            j->split);
  if (on_sensor)
    fprintf(j->f, ", \"footprint\": [%d, %d, %d, %d]", on_sensor->x0_px, on_sensor->y0_px,
            on_sensor->width_px, on_sensor->height_px);
  fprintf(j->f, "}");
}

// --- images ------------------------------------------------------------------------------------

static sv_status write_png(job *j, const char *name, const sv_bitmap *b) {
  char path[SV_CAP_PATH], folder[SV_CAP_PATH];
  if (lab_is_stopped(j->session)) return SV_E_INTERRUPTED;
  sv_status s = sv_path_join(path, sizeof path, j->out, name, j->err);
  if (s < 0) return s;
  sv_path_folder(folder, sizeof folder, path);
  s = sv_path_make_folder(folder, j->err);
  return s < 0 ? s : sv_bitmap_write_png(path, b, j->err);
}

// A clean image with depth.
static sv_status write_view(job *j, const char *stem, const sv_view *v, double time_s, const char *camera) {
  char picture[200], depth[200];
  size_t px = (size_t)v->width_px * (size_t)v->height_px;
  snprintf(picture, sizeof picture, "%s.png", stem);
  snprintf(depth, sizeof depth, "%s_depth.png", stem);
  uint16_t *units = malloc(px * sizeof *units);
  if (!units) return sv_fail(j->err, SV_E_NOMEM, "no memory for a depth image");
  sv_sim_render(&j->sim, v, time_s, j->rgb, j->depth);
  for (size_t i = 0; i < px; i++) units[i] = (uint16_t)fmin(65535, (double)j->depth[i] / depth_unit(j) + 0.5);
  sv_bitmap colour = {v->width_px, v->height_px, 3, 8, j->rgb, NULL},
            grey = {v->width_px, v->height_px, 1, 16, NULL, units};
  sv_status s = write_png(j, picture, &colour);
  if (s >= 0) s = write_png(j, depth, &grey);
  if (s >= 0) put_frame(j, picture, depth, v, camera, NULL);
  free(units);
  return s;
}

// The sub-views of one camera's frame, as the sensor gave them.
static sv_status write_frame(job *j, const sv_frame *f, int i_exposure) {
  const sv_rig *rig = &j->sim.rig;
  bool is_shared = rig->forward == SV_FORWARD_MULTIPLEXED;
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *sv = &rig->sub_views[i];
    sv_view v;
    double time_s;
    char name[200];
    if (sv->i_camera != f->i_camera) continue;
    sv_sim_view(&j->sim, i_exposure, i, &v, &time_s);
    v.i_exposure = exposure_of(j, i_exposure);
    snprintf(name, sizeof name, "train/%s/e%02d_s%02d.png", j->folder, i_exposure, i);
    put_frame(j, name, NULL, &v, sv->name, is_shared ? &sv->footprint : NULL);
    if (is_shared) continue;
    for (int y = 0; y < v.height_px; y++)
      memcpy(j->rgb + 3 * (size_t)y * (size_t)v.width_px,
             f->data + (size_t)(y + sv->footprint.y0_px) * (size_t)f->stride_bytes + 3 * sv->footprint.x0_px,
             3 * (size_t)v.width_px);
    sv_bitmap b = {v.width_px, v.height_px, 3, 8, j->rgb, NULL};
    sv_status s = write_png(j, name, &b);
    if (s < 0) return s;
  }
  if (!is_shared) return SV_OK;
  char name[200];
  snprintf(name, sizeof name, "train/%s/e%02d_composite.png", j->folder, i_exposure);
  sv_bitmap b = {f->width_px, f->height_px, 3, 16, NULL, (uint16_t *)(uintptr_t)f->data};
  return write_png(j, name, &b);
}

static sv_status write_exposures(job *j) {
  sv_source src = sv_sim_source(&j->sim);
  int n_of[SV_SIM_CAP_CAMERAS] = {0}, n_exposures = j->sim.cfg.n_exposures, n = n_exposures * src.n_cameras;
  sv_status s = src.start(src.self);
  for (int i = 0; i < n && s >= 0; i++) {
    sv_frame f;
    if ((s = src.dequeue(src.self, &f, INT64_MAX)) != SV_OK)
      return sv_fail(j->err, s < 0 ? s : SV_E_DEVICE, "the simulator gave no frame: %s", sv_status_text(s));
    s = n_of[f.i_camera] < n_exposures ? write_frame(j, &f, n_of[f.i_camera]++) : (n++, SV_OK);
    sv_status back = src.requeue(src.self, &f);
    if (s >= 0) s = back;
  }
  sv_status ended = src.stop(src.self);
  return s < 0 ? s : ended;
}

// --- files ---------------------------------------------------------------------------------------

// Exposures are numbered so that the first n of them are spread over the trajectory, whatever n is:
// each next one is the farthest from those before it, going round.
static void number_slots(job *j) {
  const int n = sv_mini(j->sim.cfg.n_exposures, CAP_SLOTS);
  bool is_taken[CAP_SLOTS] = {false};
  for (int number = 0; number < n; number++) {
    int best = 0, most = -1;
    for (int i = 0; i < n; i++) {
      int least = n;
      for (int k = 0; k < n; k++) {
        const int d = i > k ? i - k : k - i;
        if (is_taken[k]) least = sv_mini(least, sv_mini(d, n - d));
      }
      if (!is_taken[i] && least > most) {
        most = least;
        best = i;
      }
    }
    is_taken[best] = true;
    j->number_of[best] = number;
  }
}

static sv_status write_device(job *j, const char *name) {
  sv_status s = open_transforms(j, name, j->sim.rig.forward == SV_FORWARD_MULTIPLEXED);
  return close_transforms(j, s >= 0 ? write_exposures(j) : s);
}

// A view from `direction`, at the cameras' distance, looking at the scene's center.
static sv_view view_from(const job *j, const double direction[3], int i) {
  double eye[3], at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
  const double *p = j->sim.rig.sub_views[0].model.p;
  sv_pose pose;
  for (int k = 0; k < 3; k++) eye[k] = sv_sim_distance_m(&j->sim.cfg) * direction[k] / sv_norm3(direction);
  (void)sv_pose_look_at(&pose, eye, at, up);
  sv_view v = sv_view_make(j->sim.cfg.width_px, j->sim.cfg.height_px, p, &pose);
  v.i_exposure = -1;
  v.i_sub_view = i;
  v.fisheye = j->sim.fisheye; // of the first sub-view, or NULL
  return v;
}

static sv_status write_test_near(job *j) {
  static const double off_deg[] = {6, 8, 9.5, 11, 12.5, 14};
  float eye[3];
  double time_s, axis[3], right[3], up[3] = {0, 0, 1}, above[3];
  sv_view first;
  sv_sim_view(&j->sim, 0, 0, &first, &time_s);
  sv_view_centre(eye, &first);
  for (int k = 0; k < 3; k++) axis[k] = (double)eye[k] / sv_sim_distance_m(&j->sim.cfg);
  sv_cross3(right, up, axis);
  double n = sv_norm3(right);
  for (int k = 0; k < 3; k++) right[k] /= n;
  sv_cross3(above, axis, right);
  sv_status s = open_transforms(j, "transforms_test_near.json", false);
  for (int i = 0; i < 6 && s >= 0; i++) {
    char stem[100];
    double rho = off_deg[i] * SV_PI / 180, phi = i * GOLDEN_DEG * SV_PI / 180, d[3];
    for (int k = 0; k < 3; k++)
      d[k] = sv_cos(rho) * axis[k] + sv_sin(rho) * (sv_cos(phi) * right[k] + sv_sin(phi) * above[k]);
    sv_view v = view_from(j, d, i);
    snprintf(stem, sizeof stem, "test_near/r_%03d", i);
    s = write_view(j, stem, &v, 0, "test");
  }
  return close_transforms(j, s);
}

static sv_status
write_test(job *j) { // a spiral from 60 down to 5 degrees of elevation, uniform on the sphere
  sv_status s = open_transforms(j, "transforms_test.json", false);
  for (int i = 0; i < N_TEST && s >= 0; i++) {
    char stem[100];
    double lo = sv_sin(5 * SV_PI / 180), hi = sv_sin(60 * SV_PI / 180),
           z = hi + (lo - hi) * (i + 0.5) / N_TEST;
    double phi = i * GOLDEN_DEG * SV_PI / 180, r = sqrt(1 - z * z);
    sv_view v = view_from(j, (double[3]){r * sv_cos(phi), r * sv_sin(phi), z}, i);
    snprintf(stem, sizeof stem, "test/r_%03d", i);
    s = write_view(j, stem, &v, 0, "test");
  }
  return close_transforms(j, s);
}

// --- moving scenes -------------------------------------------------------------------------------

static sv_pose pose_of(const sv_view *v) {
  sv_pose p;
  for (int i = 0; i < 9; i++) p.r[i] = (double)v->r[i];
  for (int i = 0; i < 3; i++) p.t[i] = (double)v->t[i];
  return p;
}

static void place(sv_view *v, const sv_pose *p) {
  for (int i = 0; i < 9; i++) v->r[i] = (float)p->r[i];
  for (int i = 0; i < 3; i++) v->t[i] = (float)p->t[i];
}

// Every camera of a view list at every time; of those of a device, one time in four is held out.
static sv_status write_times(job *j, const char *folder, sv_view *views, const char *const *names, int n,
                             bool is_device) {
  sv_status s = SV_OK;
  for (int k = 0; k < N_TIMES && s >= 0; k++)
    for (int i = 0; i < n && s >= 0; i++) {
      char stem[100];
      snprintf(stem, sizeof stem, "frames/%s_%s/f%03d", folder, names[i], k);
      views[i].time = (float)k / (N_TIMES - 1);
      views[i].i_exposure = k;
      views[i].i_sub_view = i;
      j->split = !is_device ? "test_view" : k % 4 == 2 ? "test_time" : "train";
      s = write_view(j, stem, &views[i], sv_sim_slot_time_s(&j->sim, k), names[i]);
    }
  return s;
}

// A device whose camera i_shared is where `shared` is; only that camera when is_alone.
static sv_status write_standing(job *j, const char *spec, const char *rig, int i_shared, sv_pose *shared,
                                bool is_alone) {
  char name[100];
  const char *names[SV_SIM_CAP_CAMERAS];
  sv_view views[SV_SIM_CAP_CAMERAS];
  double time_s;
  sv_status s = start(j, spec, rig);
  int n = s >= 0 ? j->sim.rig.n_sub_views : 0;
  for (int i = 0; i < n; i++) sv_sim_view(&j->sim, 0, i, &views[i], &time_s);
  if (n && is_alone) *shared = pose_of(&views[i_shared]);
  sv_pose here = n ? pose_of(&views[i_shared]) : sv_pose_identity(), back = sv_pose_inv(&here);
  for (int i = 0; i < n; i++) { // the rig as a whole goes there
    sv_pose p = pose_of(&views[i]), other = sv_pose_mul(&p, &back);
    p = sv_pose_mul(&other, shared);
    place(&views[i], &p);
    names[i] = j->sim.rig.sub_views[i].name;
  }
  snprintf(name, sizeof name, "transforms_train_%s.json", is_alone ? "mono" : rig);
  if (s >= 0) s = open_transforms(j, name, false);
  if (s >= 0)
    s = is_alone ? write_times(j, "mono", views + i_shared, names + i_shared, 1, true)
                 : write_times(j, rig, views, names, n, true);
  s = close_transforms(j, s);
  stop(j);
  return s;
}

// 7.6 to 11.8 degrees off the stereo rig's middle.
static sv_status write_novel(job *j, const char *spec) {
  static const double off_deg[N_NOVEL] = {9.3, 8.3, 7.6, 11.8}, at_deg[N_NOVEL] = {80, 200, 320, 140};
  static const char *const names[N_NOVEL] = {"novel0", "novel1", "novel2", "novel3"};
  sv_view views[N_NOVEL];
  sv_pose rig, inverse;
  sv_status s = start(j, spec, "stereo");
  if (s < 0) return s;
  sv_sim_rig_pose(&j->sim, sv_sim_slot_ns(&j->sim, 0), &rig);
  inverse = sv_pose_inv(&rig);
  for (int i = 0; i < N_NOVEL; i++) {
    double rho = off_deg[i] * SV_PI / 180, phi = at_deg[i] * SV_PI / 180, d[3];
    for (int k = 0; k < 3; k++) // the rig's z axis points at the scene
      d[k] = -sv_cos(rho) * inverse.r[3 * k + 2] +
             sv_sin(rho) * (sv_cos(phi) * inverse.r[3 * k] + sv_sin(phi) * inverse.r[3 * k + 1]);
    views[i] = view_from(j, d, i);
  }
  s = open_transforms(j, "transforms_test.json", false);
  if (s >= 0) s = write_times(j, "test", views, names, N_NOVEL, false);
  return close_transforms(j, s);
}

static sv_status import_moving(job *j, const char *spec) {
  sv_pose shared;
  if (strstr(spec, ",noise="))
    return sv_fail(j->err, SV_E_UNSUPPORTED,
                   "sim:%.200s: images of moving scenes are written without noise; train --noise adds it",
                   spec);
  sv_status s = write_standing(j, spec, "stereo", 1, &shared, true);
  if (s >= 0) s = write_standing(j, spec, "stereo", 1, &shared, false);
  if (s >= 0) s = write_standing(j, spec, "phone", 0, &shared, false);
  if (s >= 0) s = write_novel(j, spec);
  stop(j);
  return s;
}

// angles=A+B+...: takes them from the specification. E_RANGE.
static sv_status take_angles(char *spec, double angles[CAP_ANGLES], int *n, sv_err *err) {
  static const char key[] = ",angles=";
  char *at = strstr(spec, key), *p;
  *n = 0;
  if (!at) return SV_OK;
  for (p = at + sizeof key - 1;; p++) {
    const size_t len = strcspn(p, "+,");
    if (*n == CAP_ANGLES || !sv_parse_double(p, len, &angles[*n]) || !(angles[*n] > 0 && angles[*n] <= 60))
      return sv_fail(err, SV_E_RANGE,
                     "sim:%.150s: angles= has 1 to %d angles of up to 60 degrees, as 0.5+2+5", spec,
                     CAP_ANGLES);
    ++*n;
    p += len;
    if (*p != '+') break;
  }
  memmove(at, p, strlen(p) + 1);
  return SV_OK;
}

// A device at an angle of its own; angle 0: that of the specification.
static sv_status import_device(job *j, const char *spec, const char *rig, double angle_deg, int n_exposures) {
  char name[100], text[400], tail[40] = "";
  if (angle_deg > 0) snprintf(tail, sizeof tail, "_theta%g", angle_deg);
  sv_copy(text, sizeof text, spec);
  if (angle_deg > 0) snprintf(text, sizeof text, "%.300s,angle=%.9g", spec, angle_deg);
  snprintf(name, sizeof name, "transforms_train_%s%s.json", rig, tail);
  j->n_exposures = n_exposures;
  sv_status s = start(j, text, rig);
  snprintf(j->folder, sizeof j->folder, "%s%s", rig, tail);
  if (s >= 0) number_slots(j);
  j->is_spread = true;
  if (s >= 0) s = write_device(j, name);
  j->is_spread = false;
  stop(j);
  return s;
}

static double option_or(const char *spec, const char *key, double value) {
  const char *at = strstr(spec, key);
  double v;
  if (!at) return value;
  at += strlen(key);
  return sv_parse_double(at, strcspn(at, ","), &v) ? v : value;
}

static sv_status import_still(job *j, const char *given) {
  static const char *const rigs[] = {"mono", "stereo", "phone", "lightfield", "multiplexed"};
  char spec[400];
  double angles[CAP_ANGLES];
  int n_angles = 0;
  sv_copy(spec, sizeof spec, given);
  sv_status s = take_angles(spec, angles, &n_angles, j->err);
  const int n_exposures = (int)option_or(spec, ",exposures=", N_EXPOSURES);
  const double main_deg = option_or(spec, ",angle=", 10);
  if (s >= 0 && !(n_exposures >= 1 && n_exposures <= CAP_SLOTS))
    s = sv_fail(j->err, SV_E_RANGE, "sim:%.150s: 1 to %d exposures for a dataset of several devices", given,
                CAP_SLOTS);
  if (s >= 0 && n_angles && strstr(spec, ",angle="))
    s = sv_fail(j->err, SV_E_ARG, "sim:%.150s: angle= or angles=, not both; the tables' angle is 10", given);
  for (int i = 0; i < 5 && s >= 0; i++) {
    s = import_device(j, spec, rigs[i], i && n_angles ? main_deg : 0, n_exposures);
    for (int k = 0; k < n_angles && i && s >= 0; k++)
      if (angles[k] != main_deg) s = import_device(j, spec, rigs[i], angles[k], sv_mini(n_exposures, 3));
  }
  j->n_exposures = N_EXPOSURES;
  if (s >= 0) s = start(j, spec, "mono");
  if (s >= 0) s = write_test_near(j);
  if (s >= 0) s = write_test(j);
  stop(j);
  return s;
}

static sv_status write_heldout(job *j) {
  sv_status s = open_transforms(j, "transforms_test.json", false);
  for (int i = 0; i < SV_SIM_N_HELDOUT && s >= 0; i++) {
    char stem[100];
    double time_s;
    sv_view v;
    sv_sim_heldout_view(&j->sim, i, SV_SIM_N_HELDOUT, &v, &time_s);
    v.i_exposure = -1;
    v.i_sub_view = i;
    snprintf(stem, sizeof stem, "test/r_%03d", i);
    s = write_view(j, stem, &v, time_s, "test");
  }
  return close_transforms(j, s);
}

// What `subview run --source sim:SPEC` captures and is measured on.
static sv_status import_rig(job *j, const char *spec) {
  sv_status s = start(j, spec, NULL);
  if (s >= 0) s = write_device(j, "transforms_train.json");
  if (s >= 0) s = write_heldout(j);
  stop(j);
  return s;
}

sv_status lab_import_sim(const char *spec, const lab_session *session, const char *out, sv_err *err) {
  job j = {.out = out, .session = session, .err = err};
  sv_status s = is_moving(spec)         ? import_moving(&j, spec) // images make the folder
                : strstr(spec, ",rig=") ? import_rig(&j, spec)
                                        : import_still(&j, spec);
  if (s >= 0) s = write_transforms(&j);
  for (int i = 0; i < j.n_files; i++) free(j.files[i].text);
  return s;
}
