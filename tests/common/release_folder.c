// SPDX-License-Identifier: Apache-2.0
#include "tests/common/release_folder.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/format/bytes.h"
#include "tests/common/exr_write.h"
#include "tests/common/release_maker.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#define SIM_PX 256
#define DEG    (SV_PI / 180)

static void start(maker *m, const char *root, const char *spec) {
  sv_err err;
  sv_sim_config cfg;
  m->root = root;
  assert_ok(sv_sim_parse(&cfg, spec, &err), &err);
  size_t bytes = sv_sim_bytes(&cfg) + SV_ARENA_ALIGN;
  m->block = malloc(bytes);
  assert_non_null(m->block);
  sv_arena a = sv_arena_make(m->block, bytes);
  assert_ok(sv_sim_init(&m->sim, &cfg, &a, &err), &err);
}

static void stop(maker *m) { free(m->block); }

void release_path(const maker *m, const char *name, char path[SV_CAP_PATH]) {
  char folder[SV_CAP_PATH];
  sv_err err;
  snprintf(path, SV_CAP_PATH, "%.400s/data/%.400s", m->root, name);
  sv_path_folder(folder, sizeof folder, path);
  assert_ok(sv_path_make_folder(folder, &err), &err);
}

static void put_file(const maker *m, const char *name, const void *data, size_t bytes) {
  char path[SV_CAP_PATH];
  sv_err err;
  release_path(m, name, path);
  assert_ok(sv_file_write(path, data, bytes, &err), &err);
}

// --- cameras -------------------------------------------------------------------------------------

camera release_around(double azimuth_deg, double elevation_deg, double f, int w, int h) {
  camera c = {.f = f, .w = w, .h = h};
  const double a = azimuth_deg * DEG, e = elevation_deg * DEG, d = SV_SIM_DISTANCE_M;
  const double eye[3] = {d * cos(e) * cos(a), d * cos(e) * sin(a), d * sin(e)}, at[3] = {0, 0, 0},
               up[3] = {0, 0, 1};
  assert_true(sv_pose_look_at(&c.pose, eye, at, up));
  return c;
}

camera release_moved(camera c, double right, double down) {
  c.pose.t[0] -= right;
  c.pose.t[1] -= down;
  return c;
}

static sv_view view_of(const camera *c) {
  const double p[4] = {c->f, c->f, 0.5 * c->w, 0.5 * c->h};
  return sv_view_make(c->w, c->h, p, &c->pose);
}

// 3 or 4 channels; depth may be NULL.
static void render(maker *m, const camera *c, int n_channels, uint8_t *px, float *depth) {
  const sv_view v = view_of(c);
  const size_t n = (size_t)c->w * (size_t)c->h;
  float *z = depth ? depth : malloc(n * sizeof *z);
  uint8_t *rgb = malloc(3 * n);
  assert_true(z && rgb);
  sv_sim_render(&m->sim, &v, c->time_s, rgb, z);
  for (size_t i = 0; i < n; i++) {
    for (size_t k = 0; k < 3; k++)
      px[(size_t)n_channels * i + k] = n_channels == 4 && z[i] == 0 ? 0 : rgb[3 * i + k];
    if (n_channels == 4) px[4 * i + 3] = z[i] > 0 ? 255 : 0;
  }
  free(rgb);
  if (!depth) free(z);
}

static void put_picture(maker *m, const char *name, const camera *c, int n_channels) {
  char path[SV_CAP_PATH];
  sv_err err;
  uint8_t *px = malloc((size_t)n_channels * (size_t)c->w * (size_t)c->h);
  assert_non_null(px);
  render(m, c, n_channels, px, NULL);
  release_path(m, name, path);
  const sv_bitmap b = {c->w, c->h, n_channels, 8, px, NULL};
  assert_ok(sv_bitmap_write_png(path, &b, &err), &err);
  free(px);
}

// --- COLMAP --------------------------------------------------------------------------------------

#define CAP_IMAGES 160
typedef struct {
  uint8_t *data;
  size_t n, cap;
} bytes;

static uint8_t *room(bytes *b, size_t n) {
  if (b->n + n > b->cap) {
    b->cap = 2 * b->cap + n + 256;
    b->data = realloc(b->data, b->cap);
    assert_non_null(b->data);
  }
  b->n += n;
  return b->data + b->n - n;
}
static void put_u32(bytes *b, uint32_t v) { sv_put_le32(room(b, 4), v); }
static void put_u64(bytes *b, uint64_t v) { sv_put_le64(room(b, 8), v); }
static void put_real(bytes *b, double v) {
  uint64_t u;
  memcpy(&u, &v, sizeof u);
  put_u64(b, u);
}

// A model: pictures that were made, of cameras with one lens each.
typedef struct {
  camera cameras[CAP_IMAGES];
  char names[CAP_IMAGES][64];
  uint32_t lens[CAP_IMAGES]; // number of the lens
  int n;
} colmap;

static void add(colmap *k, const camera *c, uint32_t lens, const char *name) {
  assert_in_range(k->n, 0, CAP_IMAGES - 1);
  k->cameras[k->n] = *c;
  k->lens[k->n] = lens;
  snprintf(k->names[k->n++], sizeof k->names[0], "%s", name);
}

static void put_cameras(const maker *m, const colmap *k, const char *name) {
  bytes b = {0};
  uint64_t n = 0;
  put_u64(&b, 0);
  for (int i = 0; i < k->n; i++) {
    bool is_known = false;
    for (int j = 0; j < i; j++) is_known |= k->lens[j] == k->lens[i];
    if (is_known) continue;
    const camera *c = &k->cameras[i];
    const int kind = (int)(k->lens[i] % 3); // SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL
    put_u32(&b, k->lens[i]);
    put_u32(&b, (uint32_t)kind);
    put_u64(&b, (uint64_t)c->w);
    put_u64(&b, (uint64_t)c->h);
    put_real(&b, c->f);
    if (kind == 1) put_real(&b, c->f);
    put_real(&b, 0.5 * c->w);
    put_real(&b, 0.5 * c->h);
    if (kind == 2) put_real(&b, 0);
    n++;
  }
  sv_put_le64(b.data, n);
  put_file(m, name, b.data, b.n);
  free(b.data);
}

// Images in the reverse of their names' order: numbers in a model mean nothing.
static void put_images(const maker *m, const colmap *k, const char *name) {
  bytes b = {0};
  put_u64(&b, (uint64_t)k->n);
  for (int i = k->n - 1; i >= 0; i--) {
    double q[4];
    sv_quat_from_mat(q, k->cameras[i].pose.r);
    put_u32(&b, (uint32_t)(k->n - i));
    for (int j = 0; j < 4; j++) put_real(&b, q[j]);
    for (int j = 0; j < 3; j++) put_real(&b, k->cameras[i].pose.t[j]);
    put_u32(&b, k->lens[i]);
    memcpy(room(&b, strlen(k->names[i]) + 1), k->names[i], strlen(k->names[i]) + 1);
    put_u64(&b, 0);
  }
  put_file(m, name, b.data, b.n);
  free(b.data);
}

// Points on what a camera sees, without tracks.
static void put_points(maker *m, const camera *c, const char *name) {
  bytes b = {0};
  uint64_t n = 0;
  const size_t px = (size_t)c->w * (size_t)c->h;
  uint8_t *rgb = malloc(3 * px);
  float *depth = malloc(px * sizeof *depth);
  assert_true(rgb && depth);
  render(m, c, 3, rgb, depth);
  const sv_pose world = sv_pose_inv(&c->pose);
  put_u64(&b, 0);
  for (int y = 1; y < c->h; y += 3)
    for (int x = 1; x < c->w; x += 3) {
      const size_t i = (size_t)y * (size_t)c->w + (size_t)x;
      if (!(depth[i] > 0)) continue;
      const double z = (double)depth[i],
                   at[3] = {(x + 0.5 - 0.5 * c->w) / c->f * z, (y + 0.5 - 0.5 * c->h) / c->f * z, z};
      double p[3];
      sv_pose_apply(p, &world, at);
      put_u64(&b, ++n);
      for (int k = 0; k < 3; k++) put_real(&b, p[k]);
      memcpy(room(&b, 3), rgb + 3 * i, 3);
      put_real(&b, 0.5);
      put_u64(&b, 0);
    }
  sv_put_le64(b.data, n);
  put_file(m, name, b.data, b.n);
  free(b.data);
  free(rgb);
  free(depth);
}

// FOLDER/{cameras,images,points3D}.bin.
static void put_model(maker *m, const colmap *k, const char *folder, const camera *points_from) {
  char name[200];
  snprintf(name, sizeof name, "%.150s/cameras.bin", folder);
  put_cameras(m, k, name);
  snprintf(name, sizeof name, "%.150s/images.bin", folder);
  put_images(m, k, name);
  snprintf(name, sizeof name, "%.150s/points3D.bin", folder);
  put_points(m, points_from, name);
}

// A list of the names with a prefix.
static void put_split(const maker *m, const colmap *k, const char *prefix, const char *file) {
  char text[CAP_IMAGES * 66];
  size_t at = (size_t)snprintf(text, sizeof text, "# pictures of this split\n");
  for (int i = 0; i < k->n; i++)
    if (strncmp(k->names[i], prefix, strlen(prefix)) == 0)
      at += (size_t)snprintf(text + at, sizeof text - at, "%s\n", k->names[i]);
  put_file(m, file, text, at);
}

// --- static --------------------------------------------------------------------------------------

#define PHOTO_F 60.0

static void photo(maker *m, colmap *k, const camera *c, uint32_t lens, const char *name) {
  char path[200];
  snprintf(path, sizeof path, "casual/toy/static/shared/images/%s", name);
  put_picture(m, path, c, 3);
  add(k, c, lens, name);
}

static void make_static(maker *m) {
  static const char *const splits[][2] = {{"mono__", "monocular"},
                                          {"iphone__", "iphone"},
                                          {"stereo__", "stereo"},
                                          {"lf__", "lightfield"},
                                          {"eval__", "iphone_eval"}};
  colmap *k = calloc(1, sizeof *k);
  assert_non_null(k);
  const camera wide = release_around(45, 25, PHOTO_F, RELEASE_PHOTO_W, RELEASE_PHOTO_H);
  camera tele = release_moved(wide, 0.2, 0.2), ultra = release_moved(wide, 0.2, -0.2);
  tele.f = 100;
  ultra.f = 40;
  photo(m, k, &wide, 7, "mono__wide.png");
  photo(m, k, &wide, 7, "iphone__wide.png");
  photo(m, k, &tele, 8, "iphone__tele.png");
  photo(m, k, &ultra, 9, "iphone__ultrawide.png");
  const camera right = release_moved(wide, 0.5, 0);
  photo(m, k, &wide, 10, "stereo__stereo_left.png");
  photo(m, k, &right, 11, "stereo__stereo_right.png");
  for (int row = 2; row <= 10; row++)
    for (int column = 2; column <= 10; column++) {
      char name[40];
      const camera c = release_moved(release_around(45, 25, 200, RELEASE_LF_W, RELEASE_LF_H),
                                     0.04 * (column - 6), 0.04 * (row - 6));
      snprintf(name, sizeof name, "lf__%02d_%02d.png", row, column);
      photo(m, k, &c, 12, name);
    }
  for (int i = 1; i <= RELEASE_N_EVAL; i++) {
    char name[40];
    const camera c = release_around(38 + 2.5 * i, 22 + i, PHOTO_F, RELEASE_PHOTO_W, RELEASE_PHOTO_H);
    snprintf(name, sizeof name, "eval__frame_%05d.png", i);
    photo(m, k, &c, 7, name);
  }
  put_model(m, k, "casual/toy/static/shared/sparse", &wide);
  for (size_t i = 0; i < sizeof splits / sizeof *splits; i++) {
    char file[100];
    snprintf(file, sizeof file, "casual/toy/static/shared/splits/%s.txt", splits[i][1]);
    put_split(m, k, splits[i][0], file);
  }
  free(k);
}

// --- casual video --------------------------------------------------------------------------------

typedef struct {
  const char *folder, *stems[3];
  double offset_m[3], f[3];
  int n;
} video;

static void make_video(maker *m, const video *v) {
  colmap *k = calloc(1, sizeof *k);
  char path[200], name[64];
  assert_non_null(k);
  for (int is_eval = 0; is_eval < 2; is_eval++)
    for (int s = 0; s < (is_eval ? 1 : v->n); s++)
      for (int i = 1; i <= (is_eval ? RELEASE_N_EVAL : RELEASE_N_TRAIN); i++) {
        const camera c = release_moved(release_around(35 + 3 * i + (is_eval ? 1.5 : 0), is_eval ? 30 : 25,
                                                      v->f[s], RELEASE_PHOTO_W, RELEASE_PHOTO_H),
                                       v->offset_m[s], 0);
        snprintf(name, sizeof name, "%s__%.20s__frame_%06d.png", is_eval ? "eval" : "train", v->stems[s], i);
        snprintf(path, sizeof path, "casual/toy/%.40s/images/%s", v->folder, name);
        put_picture(m, path, &c, 3);
        add(k, &c, (uint32_t)(20 + s), name);
      }
  snprintf(path, sizeof path, "casual/toy/%s/sparse", v->folder);
  put_model(m, k, path, &k->cameras[2]);
  snprintf(path, sizeof path, "casual/toy/%s/splits/train.txt", v->folder);
  put_split(m, k, "train__", path);
  snprintf(path, sizeof path, "casual/toy/%s/splits/eval.txt", v->folder);
  put_split(m, k, "eval__", path);
  free(k);
}

// --- dynamic -------------------------------------------------------------------------------------

static void make_stream(maker *m, const char *device, const char *const *stems, int n) {
  colmap *train = calloc(1, sizeof *train), *test = calloc(1, sizeof *test);
  char path[200], name[64];
  assert_true(train && test);
  for (int s = 0; s < n; s++)
    for (int i = 1; i <= RELEASE_N_FRAMES; i++) {
      // streams have sizes of their own
      camera c = release_moved(release_around(45, 25, PHOTO_F, RELEASE_PHOTO_W + 4 * s, RELEASE_PHOTO_H),
                               0.3 * s, 0);
      c.time_s = 0.08 * i;
      snprintf(name, sizeof name, "%.20s_%03d/frame_%05d.png", stems[s], s + 1, i);
      snprintf(path, sizeof path, "dynamic/toy/%.20s/%s", device, name);
      put_picture(m, path, &c, 3);
      add(i % 8 == 0 ? test : train, &c, (uint32_t)(30 + s), name);
    }
  snprintf(path, sizeof path, "dynamic/toy/%s/sparse_train", device);
  put_model(m, train, path, &train->cameras[0]);
  snprintf(path, sizeof path, "dynamic/toy/%s/sparse_test", device);
  put_model(m, test, path, &test->cameras[0]);
  free(train);
  free(test);
}

// --- synthetic -----------------------------------------------------------------------------------

#define SYNTHETIC_F 100.0

static void put_frame(bytes *b, const camera *c, const char *file, int group, int view) {
  char text[600];
  const sv_pose w = sv_pose_inv(&c->pose);
  size_t n = (size_t)snprintf(text, sizeof text, "%s{\"file_path\": \"%s\", ", b->n > 60 ? ",\n" : "", file);
  if (group >= 0)
    n += (size_t)snprintf(text + n, sizeof text - n, "\"group_id\": %d, \"view_id\": %d, ", group, view);
  n += (size_t)snprintf(text + n, sizeof text - n, "\"transform_matrix\": [");
  for (int i = 0; i < 3; i++)
    n += (size_t)snprintf(text + n, sizeof text - n, "[%.9g, %.9g, %.9g, %.9g], ", w.r[3 * i],
                          -w.r[3 * i + 1], -w.r[3 * i + 2], w.t[i]);
  n += (size_t)snprintf(text + n, sizeof text - n, "[0, 0, 0, 1]]}");
  memcpy(room(b, n), text, n);
}

static bytes begin_json(void) {
  bytes b = {0};
  char text[80];
  const int n = snprintf(text, sizeof text, "{\"camera_angle_x\": %.12f, \"frames\": [\n",
                         2 * atan(0.5 * RELEASE_SIDE / SYNTHETIC_F));
  memcpy(room(&b, (size_t)n), text, (size_t)n);
  return b;
}

static void end_json(const maker *m, bytes *b, const char *name) {
  memcpy(room(b, 4), "\n]}\n", 4);
  put_file(m, name, b->data, b->n);
  free(b->data);
}

// Sub-view i of a device at its offsets, all with the rotation of the base camera.
static camera synthetic_view(const char *device, int exposure, int i) {
  static const double phone[3][2] = {{-1, -1}, {1, -1}, {0, 1}};
  const double d = SV_SIM_DISTANCE_M * tan(5 * DEG);
  const camera base = release_around(45 + 110 * exposure, 30, SYNTHETIC_F, RELEASE_SIDE, RELEASE_SIDE);
  if (strcmp(device, "stereo") == 0) return release_moved(base, i ? d : -d, 0);
  if (strcmp(device, "iphone") == 0) return release_moved(base, d * phone[i][0], d * phone[i][1]);
  if (strcmp(device, "lightfield") == 0)
    return release_moved(base, d * (-1 + i / 4 * 2.0 / 3), d * (-1 + i % 4 * 2.0 / 3));
  return base;
}

// Frames in no order; the names of files with and without "./" and their extension.
static void make_device(maker *m, const char *device, int n_views, int n_exposures) {
  bytes b = begin_json();
  char path[200], name[40], file[48];
  const int n = n_views * n_exposures;
  for (int j = 0; j < n; j++) {
    const int at = n - 1 - j, e = at / n_views, i = at % n_views;
    const camera c = synthetic_view(device, e, i);
    snprintf(name, sizeof name, "g%d_v%02d", e, i);
    snprintf(path, sizeof path, "synthetic/toy/%s/%dviews/train/%s.png", device, n_exposures, name);
    put_picture(m, path, &c, 4);
    snprintf(file, sizeof file, "%s%s%s", j % 2 ? "./" : "", name, j % 3 ? "" : ".png");
    put_frame(&b, &c, file, n_views > 1 ? 10 + 7 * e : -1, i);
  }
  snprintf(path, sizeof path, "synthetic/toy/%s/%dviews/train/transforms_train.json", device, n_exposures);
  end_json(m, &b, path);
}

// World positions of a view's pixels, 0 where there is no surface, as the authors' prepare-depth
// leaves them.
static void put_positions(maker *m, const camera *c, int number) {
  static float depth[RELEASE_SIDE * RELEASE_SIDE], values[3][RELEASE_SIDE * RELEASE_SIDE];
  uint8_t rgb[3 * RELEASE_SIDE * RELEASE_SIDE];
  const sv_pose world = sv_pose_inv(&c->pose);
  render(m, c, 3, rgb, depth);
  for (int i = 0; i < RELEASE_SIDE * RELEASE_SIDE; i++) {
    const double z = (double)depth[i], at[3] = {(i % c->w + 0.5 - 0.5 * c->w) / c->f * z,
                                                (i / c->w + 0.5 - 0.5 * c->h) / c->f * z, z};
    double p[3];
    sv_pose_apply(p, &world, at);
    for (int k = 0; k < 3; k++) values[k][i] = z > 0 ? (float)p[k] : 0;
  }
  for (int k = 0; k < 3; k++) {
    char name[80], path[SV_CAP_PATH];
    snprintf(name, sizeof name, "synthetic/toy/positions/position_%c_%04d.exr", "xyz"[k], number);
    release_path(m, name, path);
    exr_write(path, &(exr_image){"V", c->w, c->h, values[k]});
  }
}

static void make_synthetic(maker *m) {
  static const struct {
    const char *name;
    int n_views;
  } devices[] = {{"monocular", 1}, {"stereo", 2}, {"iphone", 3}, {"lightfield", 16}};
  bytes b = begin_json();
  for (int i = 0; i < RELEASE_N_TEST; i++) {
    char path[80], name[40];
    const camera c = release_around(45 + 30 * i, 20 + i % 3 * 10, SYNTHETIC_F, RELEASE_SIDE, RELEASE_SIDE);
    snprintf(name, sizeof name, "./test/r_%d", i);
    snprintf(path, sizeof path, "synthetic/toy/test/r_%d.png", i);
    put_picture(m, path, &c, 4);
    put_frame(&b, &c, name, -1, 0);
    put_positions(m, &c, i);
  }
  end_json(m, &b, "synthetic/toy/transforms_test.json");
  for (size_t i = 0; i < sizeof devices / sizeof *devices; i++)
    for (int n = 1; n <= 3; n += 2) make_device(m, devices[i].name, devices[i].n_views, n);
}

// --- all -----------------------------------------------------------------------------------------

void release_folder_make(const char *root) {
  static const video videos[] = {
      {"iphone-video", {"IMG_7.wide", "IMG_7.ultrawide", "IMG_7.tele"}, {0, 0.2, -0.2}, {60, 40, 90}, 3},
      {"stereo-video", {"clip-Left", "clip-Right"}, {0, 0.5}, {60, 60}, 2}};
  static const char *const phone[] = {"wide", "ultrawide"}, *const stereo[] = {"left", "right"};
  char spec[80];
  maker m;
  snprintf(spec, sizeof spec, "textured,rig=mono,size=%dx%d", SIM_PX, SIM_PX);
  start(&m, root, spec);
  make_static(&m);
  for (int i = 0; i < 2; i++) make_video(&m, &videos[i]);
  make_synthetic(&m);
  release_put_multiplexed(&m);
  stop(&m);
  snprintf(spec, sizeof spec, "moving,rig=mono,arc=0,size=%dx%d", SIM_PX, SIM_PX);
  start(&m, root, spec);
  make_stream(&m, "iphone", phone, 2);
  make_stream(&m, "stereo", stereo, 2);
  stop(&m);
}
