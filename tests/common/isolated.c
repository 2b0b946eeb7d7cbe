// SPDX-License-Identifier: Apache-2.0
#include "tests/common/isolated.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/format/rig_file.h"
#include "tests/common/test.h"
#include "tools/common/coverage.h"
#include "tools/common/imageio.h"

static sv_err err;

static void join(char *path, const char *folder, const char *name) {
  assert_int_equal(sv_path_join(path, SV_CAP_PATH, folder, name, &err), SV_OK);
}

static double light_of(double s) { return s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4); }
double isolated_srgb(double l) { return l <= 0.0031308 ? 12.92 * l : 1.055 * pow(l, 1 / 2.4) - 0.055; }

double isolated_share(const isolated *s, const sv_footprint *f, int x, int y) {
  double r = 0.5 * f->width_px - 1, dx = x + 0.5 - 0.5 * f->width_px, dy = y + 0.5 - 0.5 * f->height_px;
  double d = sqrt(dx * dx + dy * dy), rim = r + 0.5 - d;
  return s->is_flat ? 1 : (rim < 0 ? 0 : rim > 1 ? 1 : rim) * (1 - ISOLATED_FALL_OFF * d * d / (r * r));
}

#define ENCODINGS 8192
static float light[256];
static uint16_t encoded[ENCODINGS + 1];

static void make_tables(void) {
  for (int i = 0; i < 256; i++) light[i] = (float)light_of(i / 255.0);
  for (int i = 0; i <= ENCODINGS; i++)
    encoded[i] = (uint16_t)lrint(65535 * isolated_srgb((double)i / ENCODINGS));
}

static uint16_t measured(double v) {
  double at = ENCODINGS * (v < 0 ? 0 : v > 1 ? 1 : v), part = at - floor(at);
  size_t i = (size_t)at;
  return (uint16_t)lrint(i < ENCODINGS ? encoded[i] + part * (encoded[i + 1] - encoded[i]) : encoded[i]);
}

// One sensor picture; rgb NULL: white.
static void save(isolated *s, const char *path, const sv_footprint *f, const uint8_t *rgb) {
  int w = s->sim.cfg.width_px, h = s->sim.cfg.height_px;
  sv_bitmap b = {.width_px = w, .height_px = h, .n_channels = 1, .bits = 16};
  uint32_t seed = s->n_saved++;
  b.u16 = malloc((size_t)w * (size_t)h * 2);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int lx = x - f->x0_px, ly = y - f->y0_px;
      double v = 0.004 + 0.002 * (double)sv_hash_normal(sv_hash3(seed, (uint32_t)x, (uint32_t)y));
      if (lx >= 0 && ly >= 0 && lx < f->width_px && ly < f->height_px) {
        const uint8_t *p = rgb ? rgb + 3 * (ly * f->width_px + lx) : NULL;
        double l = p ? (double)(light[p[0]] + light[p[1]] + light[p[2]]) / 3 : 0.85;
        v += l * isolated_share(s, f, lx, ly);
      }
      b.u16[y * w + x] = measured(v);
    }
  assert_ok(sv_bitmap_write_png(path, &b, &err), &err);
  free(b.u16);
}

void isolated_save(isolated *s, int e, int i, const uint8_t *rgb) {
  const sv_sub_view *v = &s->sim.rig.sub_views[i];
  char path[SV_CAP_PATH], name[80];
  snprintf(name, sizeof name, "e%02d/%s.png", e, v->name);
  join(path, s->isolated, name);
  save(s, path, &v->footprint, rgb);
}

void isolated_scene(isolated *s, int n_exposures) {
  uint8_t *rgb = malloc((size_t)s->sim.cfg.width_px * (size_t)s->sim.cfg.height_px * 3);
  for (int e = 0; e < n_exposures; e++)
    for (int i = 0; i < s->sim.rig.n_sub_views; i++) {
      sv_view view;
      double time_s;
      sv_sim_view(&s->sim, e, i, &view, &time_s);
      sv_sim_render(&s->sim, &view, 0, rgb, NULL);
      isolated_save(s, e, i, rgb);
    }
  free(rgb);
}

void isolated_open(isolated *s, const char *spec, bool is_flat, int n_exposures) {
  const char *tmp = getenv("TMPDIR");
  char path[SV_CAP_PATH], name[80];
  sv_sim_config cfg;
  assert_ok(sv_sim_parse(&cfg, spec, &err), &err);
  size_t n_bytes = sv_sim_bytes(&cfg) + 4096;
  s->block = malloc(n_bytes);
  s->is_flat = is_flat;
  s->n_saved = 0;
  make_tables();
  sv_arena arena = sv_arena_make(s->block, n_bytes);
  assert_ok(sv_sim_init(&s->sim, &cfg, &arena, &err), &err);
  snprintf(s->folder, sizeof s->folder, "%s/subview-lenslets-%ld", tmp ? tmp : "/tmp", (long)getpid());
  join(s->white, s->folder, "white");
  join(s->isolated, s->folder, "isolated");
  join(s->out, s->folder, "rig");
  assert_int_equal(sv_path_make_folder(s->white, &err), SV_OK);
  for (int i = 0; i < s->sim.rig.n_sub_views; i++) {
    const sv_sub_view *v = &s->sim.rig.sub_views[i];
    snprintf(name, sizeof name, "%s.png", v->name);
    join(path, s->white, name);
    save(s, path, &v->footprint, NULL);
  }
  for (int e = 0; e < n_exposures; e++) {
    snprintf(name, sizeof name, "e%02d", e);
    join(path, s->isolated, name);
    assert_int_equal(sv_path_make_folder(path, &err), SV_OK);
  }
}

void isolated_close(isolated *s) {
  char command[SV_CAP_PATH + 20];
  snprintf(command, sizeof command, "rm -rf '%s'", s->folder);
  if (system(command) != 0) printf("%s stays\n", s->folder);
  free(s->block);
}

void isolated_read_rig(isolated *s, sv_rig *rig, sv_arena *a, sv_arena *scratch) {
  static sv_coverage_names names;
  sv_file_reader files = {s->out, sv_folder_read};
  assert_int_equal(sv_rig_init(rig, 64, a), SV_OK);
  if (sv_rig_read_coverage(rig, &names, &files, 1, scratch, &err) != SV_OK) fail_msg("%s", err.text);
  assert_ok(sv_coverage_load(s->out, rig, &names, &err), &err);
}

isolated_errors isolated_compare(const sv_rig *rig, const sv_rig *want) {
  isolated_errors e = {0};
  sv_pose back = sv_pose_inv(&want->sub_views[0].cam_from_rig);
  double far[3];
  sv_pose last = sv_pose_mul(&want->sub_views[want->n_sub_views - 1].cam_from_rig, &back);
  sv_pose_centre(far, &last);
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *v = &rig->sub_views[i];
    sv_pose true_pose = sv_pose_mul(&want->sub_views[i].cam_from_rig, &back), inv = sv_pose_inv(&true_pose);
    double r[9], w[3], a[3], b[3];
    sv_mul33(r, v->cam_from_rig.r, inv.r);
    sv_rodrigues_inv(w, r);
    sv_pose_centre(a, &v->cam_from_rig);
    sv_pose_centre(b, &true_pose);
    sv_sub3(a, a, b);
    e.rotation_deg = fmax(e.rotation_deg, sv_norm3(w) * 180 / SV_PI);
    e.place = fmax(e.place, sv_norm3(a) / sv_norm3(far));
    e.focal = fmax(e.focal, fabs(v->model.p[0] / want->sub_views[i].model.p[0] - 1));
  }
  return e;
}
