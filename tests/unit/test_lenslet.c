// SPDX-License-Identifier: Apache-2.0
// Lenslet sensors: the lattice of simulated white images, and sub-views of a simulated light field.
// The simulator integrates a formula over the pixels of the sensor; it knows nothing of the
// decoder.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/rig/lenslet.h"
#include "tests/common/test.h"

#define DEG (SV_PI / 180)

static sv_err err;

// --- the simulated sensor ------------------------------------------------------------------------

typedef struct {
  int w, h, bits;
  sv_lenslet_grid grid; // where the lenslets are
  double fill;          // radius of a lenslet's image, in half pitches
  double fall_off;      // loss of light at the sensor's corners, 0..1
  double n_dead;        // share of dead lenslets
  double shot, read;    // variance shot x + read of a value x
  double level;         // value of the white image
  uint64_t seed;
  double cs, sn; // of the rotation
} sensor;

static sensor sensor_make(int w, int h, double pitch, double turn_deg, bool is_hexagonal) {
  double at[2] = {0.5 * w + 0.31 * pitch, 0.5 * h - 0.17 * pitch};
  return (sensor){.w = w,
                  .h = h,
                  .bits = 14,
                  .grid = sv_lenslet_grid_make(pitch, turn_deg * DEG, at, is_hexagonal),
                  .fill = 0.92,
                  .fall_off = 0.4,
                  .level = 0.8,
                  .seed = 7,
                  .cs = cos(turn_deg * DEG),
                  .sn = sin(turn_deg * DEG)};
}

// One wave of the light field: in the plane of the picture with a slope (disparity) of its own, so
// each wave is a textured plane at another depth. s, t count pixels of a sub-view, u, v steps in
// the aperture.
static const struct {
  double amplitude, fs, ft, phase, slope;
} waves[] = {{0.12, 0.021, 0.013, 0.3, 0.25},
             {0.08, -0.043, 0.062, 1.1, -0.3},
             {0.06, 0.09, 0.031, 2.0, 0.1},
             {0.05, 0.061, -0.1, 0.7, -0.15},
             {0.03, 0.13, 0.07, 2.9, 0.2}};
#define N_WAVES ((int)(sizeof waves / sizeof *waves))

typedef struct {
  double share[N_WAVES]; // what is left of each wave's amplitude after integration over a cell
} light;

// Integration of the waves over a cell of the picture plane: |s| <= a/2, |t| <= b/2, or a hexagon
// of width a.
static light light_over(double a, double b, bool is_hexagon) {
  light l;
  for (int k = 0; k < N_WAVES; k++) {
    double sum = 0, n = 0;
    for (int i = 0; i < 64; i++)
      for (int j = 0; j < 64; j++) {
        double s = a * ((i + 0.5) / 64 - 0.5),
               t = (is_hexagon ? 2 / sqrt(3) * a : b) * ((j + 0.5) / 64 - 0.5);
        if (is_hexagon && fabs(s) / 2 + fabs(t) * sqrt(3) / 2 > a / 2) continue;
        sum += cos(2 * SV_PI * (waves[k].fs * s + waves[k].ft * t));
        n++;
      }
    l.share[k] = sum / n;
  }
  return l;
}

static double light_at(const light *l, double s, double t, double u, double v) {
  double sum = 0.45 + 0.004 * u - 0.003 * v;
  for (int k = 0; k < N_WAVES; k++)
    sum += waves[k].amplitude * l->share[k] *
           cos(2 * SV_PI * (waves[k].fs * (s + waves[k].slope * u) + waves[k].ft * (t + waves[k].slope * v)) +
               waves[k].phase);
  return sum;
}

// The lenslet whose centre is nearest to a point.
static void nearest(const sv_lenslet_grid *g, double x, double y, int *bi, int *bj, double c[2]) {
  double det = g->col_px[0] * g->row_px[1] - g->col_px[1] * g->row_px[0], best = 1e30;
  double dx = x - g->offset_px[0], dy = y - g->offset_px[1];
  double p = (dx * g->row_px[1] - dy * g->row_px[0]) / det, q = (dy * g->col_px[0] - dx * g->col_px[1]) / det;
  // Of a square array the nearest is the rounded one; of a hexagonal one it is in one of the two
  // rows around.
  int j0 = (int)floor(g->is_hexagonal ? q : q + 0.5);
  for (int j = j0; j <= j0 + g->is_hexagonal; j++) {
    double h = g->is_hexagonal && (j & 1) ? 0.5 : 0, i = floor(p - h + 0.5), ex = dx, ey = dy;
    ex -= (i + h) * g->col_px[0] + j * g->row_px[0];
    ey -= (i + h) * g->col_px[1] + j * g->row_px[1];
    if (ex * ex + ey * ey >= best) continue;
    best = ex * ex + ey * ey;
    *bi = (int)i;
    *bj = j;
    c[0] = x - ex;
    c[1] = y - ey;
  }
}

// Light of a place on the sensor; l NULL: an even field.
static double radiance(const sensor *s, const light *l, double x, double y) {
  const sv_lenslet_grid *g = &s->grid;
  double c[2] = {0, 0}, radius = 0.5 * g->pitch_px * s->fill;
  int i = 0, j = 0;
  nearest(g, x, y, &i, &j, c);
  double dx = x - c[0], dy = y - c[1], r = sqrt(dx * dx + dy * dy) / radius;
  if (s->n_dead > 0 && sv_hash3((uint32_t)i, (uint32_t)j, (uint32_t)s->seed) < s->n_dead * 4294967295.0)
    return 0.02;
  double edge = (1 - r) / 0.15, open = edge >= 1 ? 1 : edge <= 0 ? 0 : edge * edge * (3 - 2 * edge);
  double fx = 2 * x / s->w - 1, fy = 2 * y / s->h - 1;
  double value = s->level * open * (1 - 0.25 * r * r) * (1 - s->fall_off * 0.5 * (fx * fx + fy * fy)) + 0.004;
  if (!l) return value;
  double cs = s->cs, sn = s->sn, lx = c[0] - 0.5 * s->w, ly = c[1] - 0.5 * s->h;
  // a pixel of a sub-view
  double unit = g->is_hexagonal ? 0.86602540378443865 * g->pitch_px : g->pitch_px;
  return value * light_at(l, (cs * lx + sn * ly) / unit, (cs * ly - sn * lx) / unit, cs * dx + sn * dy,
                          cs * dy - sn * dx);
}

static uint16_t *expose(const sensor *s, const light *l) {
  uint16_t *px = malloc(sizeof *px * (size_t)(s->w * s->h));
  sv_rng rng = sv_rng_make(s->seed, l ? 2 : 1);
  double top = (double)((1 << s->bits) - 1);
  for (int y = 0; y < s->h; y++)
    for (int x = 0; x < s->w; x++) {
      double sum = 0;
      for (int k = 0; k < 16; k++) sum += radiance(s, l, x + (k % 4 + 0.5) / 4, y + (k / 4 + 0.5) / 4) / 16;
      if (s->shot + s->read > 0) sum += sqrt(s->shot * sum + s->read) * (double)sv_rng_normal(&rng);
      sum = sum < 0 ? 0 : sum > 1 ? 1 : sum;
      px[y * s->w + x] = (uint16_t)(floor(sum * top + 0.5) / top * 65535 + 0.5);
    }
  return px;
}

static sv_raw raw_of(const sensor *s, const uint16_t *px) {
  return (sv_raw){.u16 = px, .width_px = s->w, .height_px = s->h, .n_channels = 1};
}

static sv_status find(const sv_raw *white, sv_lenslet_grid *g) {
  void *block = malloc(sv_lenslet_find_bytes() + SV_ARENA_ALIGN);
  sv_arena a = sv_arena_make(block, sv_lenslet_find_bytes() + SV_ARENA_ALIGN);
  sv_status s = sv_lenslet_find(g, "white.png", white, &a, &err);
  free(block);
  return s;
}

// --- the lattice ---------------------------------------------------------------------------------

static double worst_pitch, worst_turn, worst_offset;

// Distance of a found centre from the nearest true one.
static double off_lattice(const sv_lenslet_grid *found, const sv_lenslet_grid *truth) {
  double c[2];
  int i, j;
  nearest(truth, found->offset_px[0], found->offset_px[1], &i, &j, c);
  return sqrt((c[0] - found->offset_px[0]) * (c[0] - found->offset_px[0]) +
              (c[1] - found->offset_px[1]) * (c[1] - found->offset_px[1]));
}

static void check_found(const sensor *s) {
  uint16_t *px = expose(s, NULL);
  sv_raw white = raw_of(s, px);
  sv_lenslet_grid g;
  const sv_lenslet_grid *t = &s->grid;
  if (find(&white, &g) != SV_OK)
    fail_msg("pitch %g turn %g: %s", t->pitch_px, t->rotation_rad / DEG, err.text);
  double pitch = fabs(g.pitch_px - t->pitch_px), turn = fabs(g.rotation_rad - t->rotation_rad) / DEG;
  double offset = off_lattice(&g, t);
  if (g.is_hexagonal != t->is_hexagonal || pitch > 0.02 || turn > 0.05 || offset > 0.1)
    fail_msg("pitch %g turn %g %s: off by %.4f px, %.4f deg, %.4f px; rms %.3f, %d of %d", t->pitch_px,
             t->rotation_rad / DEG, t->is_hexagonal ? "hex" : "square", pitch, turn, offset, g.rms_px,
             g.n_used, g.n_seen);
  if (pitch > worst_pitch) worst_pitch = pitch;
  if (turn > worst_turn) worst_turn = turn;
  if (offset > worst_offset) worst_offset = offset;
  free(px);
}

// A search over whole sensors takes minutes there; test_decode finds two lattices on every machine.
static void skip_under_emulation(void) {
  if (!is_emulated()) return;
  print_message("skip the search for many lattices: it takes minutes under emulation\n");
  skip();
}

TEST(test_find) {
  skip_under_emulation();
  static const double pitches[] = {6, 7.77, 13.3, 20.05, 40}, turns[] = {-5, 0, 3.3};
  for (int p = 0; p < 5; p++)
    for (int k = 0; k < 3; k++) {
      int side = pitches[p] < 14 ? 160 : pitches[p] < 30 ? 240 : 420;
      sensor s = sensor_make(side + 40, side, pitches[p], turns[k], (p + k) & 1);
      s.seed = (uint64_t)(p * 5 + k);
      s.n_dead = 0.03;
      s.shot = 2.7e-4;
      s.read = 5e-7; // ISO 800
      check_found(&s);
    }
  print_message("found lattices: worst pitch %.4f px, rotation %.4f deg, centre %.3f px\n", worst_pitch,
                worst_turn, worst_offset);
}

TEST(test_find_hard) {
  skip_under_emulation();
  sensor s = sensor_make(420, 300, 9.13, 1.3, true); // a tenth dead, strong noise and fall-off
  s.n_dead = 0.1;
  s.shot = 5e-3;
  s.read = 1e-4;
  s.fall_off = 0.8;
  check_found(&s);
  s = sensor_make(260, 380, 11.02, -2, false); // 8 bits
  s.bits = 8;
  s.n_dead = 0.05;
  check_found(&s);
  s = sensor_make(160, 160, 14, 3, true); // few lenslets
  check_found(&s);
  s = sensor_make(240, 240, 12.5, 0.7, false); // touching images
  s.fill = 1.05;
  check_found(&s);
  s.fill = 0.6; // small ones
  check_found(&s);
}

static void refuse(const sv_raw *r, const char *word) {
  sv_lenslet_grid g;
  sv_status s = find(r, &g);
  if (s >= 0 || !strstr(err.text, word) || !strstr(err.text, "white.png"))
    fail_msg("'%s' expected, got %s: %s", word, sv_status_name(s), s < 0 ? err.text : "accepted");
}

TEST(test_no_white_image) {
  enum { W = 320, H = 300 };
  static uint8_t px[W * H];
  sv_raw r = {.u8 = px, .width_px = W, .height_px = H, .n_channels = 1};
  sv_rng rng = sv_rng_make(3, 3);
  memset(px, 200, sizeof px);
  refuse(&r, "no repeating pattern");
  for (int i = 0; i < W * H; i++) px[i] = (uint8_t)sv_rng_below(&rng, 256);
  refuse(&r, "no repeating pattern");
  for (int i = 0; i < W * H; i++) { // a smooth picture
    double x = i % W, y = i / W;
    px[i] = (uint8_t)(128 + 50 * sin(x * x * 0.0007 + y * 0.05) + 40 * cos(y * y * 0.0004 - x * 0.03));
  }
  refuse(&r, "expected");
  for (int i = 0; i < W * H; i++) px[i] = (uint8_t)(128 + 100 * sin(i % W * 0.5)); // stripes
  refuse(&r, "one direction");
  for (int i = 0; i < W * H; i++) // a lattice of 8 x 14 px
    px[i] = (uint8_t)(128 + 60 * cos(2 * SV_PI * (i % W) / 8) + 60 * cos(2 * SV_PI * (double)(i / W) / 14));
  refuse(&r, "expected");
  r.width_px = 20;
  refuse(&r, "32x32");
  r.width_px = W;
  sv_lenslet_grid g;
  sv_arena none = sv_arena_make(px, 1000);
  assert_int_equal(sv_lenslet_find(&g, "white.png", &r, &none, &err), SV_E_NOMEM);
}

// --- sub-views -----------------------------------------------------------------------------------

typedef struct {
  double all_db, worst_db;
  int w, h;
} quality;

// A sensor of the light field, and what the formula gives for it.
typedef struct {
  const sensor *s;
  light pixel;
  uint16_t *white_px, *raw_px;
  sv_raw white, raw;
} shot;

static shot take(const sensor *s) {
  shot t = {.s = s, .pixel = light_over(1, 1, false)};
  light lens = s->grid.is_hexagonal ? light_over(1 / sqrt(0.75), 0, true) : t.pixel;
  t.white_px = expose(s, NULL);
  t.raw_px = expose(s, &lens);
  t.white = raw_of(s, t.white_px);
  t.raw = raw_of(s, t.raw_px);
  return t;
}

// Mean squared error of one sub-view at the places where the plan says that its pixels are.
static double error_of(const shot *t, const sv_lenslet_plan *p, const float *out, double u, double v,
                       double scale) {
  const sv_lenslet_grid *truth = &t->s->grid;
  double cs = cos(truth->rotation_rad), sn = sin(truth->rotation_rad), sum = 0;
  double unit = truth->is_hexagonal ? sqrt(0.75) * truth->pitch_px : truth->pitch_px;
  for (int j = 0; j < p->height_px; j++)
    for (int i = 0; i < p->width_px; i++) {
      double q = p->q0 + i * p->dq, l[2];
      for (int k = 0; k < 2; k++)
        l[k] = p->grid.offset_px[k] + q * p->grid.col_px[k] + (p->j0 + j) * p->grid.row_px[k] -
               0.5 * (k ? t->s->h : t->s->w);
      double want = light_at(&t->pixel, (cs * l[0] + sn * l[1]) / unit, (cs * l[1] - sn * l[0]) / unit, u, v);
      double e = (double)out[j * p->width_px + i] * scale - want;
      sum += e * e;
    }
  return sum / (p->width_px * p->height_px);
}

// All sub-views against the formula. g NULL: with the lattice found in the white image.
static quality decode(const shot *t, const sv_lenslet_grid *g, int keep) {
  const sensor *s = t->s;
  sv_lenslet_grid found;
  sv_lenslet_plan p;
  if (!g && find(&t->white, &found) != SV_OK) fail_msg("%s", err.text);
  if (sv_lenslet_plan_make(&p, g ? g : &found, &(sv_lenslet_cfg){.keep = keep, .black = 0.004}, s->w, s->h,
                           &err) != SV_OK)
    fail_msg("%s", err.text);
  float *gain = malloc(sizeof *gain * (size_t)(s->w * s->h)),
        *row = malloc(sizeof *row * (size_t)p.n_columns);
  float *out = malloc(sizeof *out * (size_t)(p.width_px * p.height_px));
  assert_int_equal(sv_lenslet_gain(&p, "white.png", &t->white, gain, &err), SV_OK);
  // Decoded values are in units of the white image's bright level; the formula's are shares of the
  // white.
  double bright = 0, total = 0;
  for (int i = 0; i < s->w * s->h; i++)
    if (gain[i] < 9.9f) bright = ((double)t->white_px[i] / 65535 - 0.004) * (double)gain[i];
  quality q = {.worst_db = 1e9, .w = p.width_px, .h = p.height_px};
  for (int i = 0; i < keep * keep; i++) {
    sv_lenslet_decode(&p, &(sv_lenslet_image){&t->raw, gain, 0}, i % keep, i / keep, row, out);
    double e = error_of(t, &p, out, i % keep - 0.5 * (keep - 1), i / keep - 0.5 * (keep - 1), 1 / bright);
    total += e / (keep * keep);
    if (-10 * log10(e) < q.worst_db) q.worst_db = -10 * log10(e);
  }
  q.all_db = -10 * log10(total);
  free(gain);
  free(row);
  free(out);
  return q;
}

TEST(test_decode) {
  for (int is_hex = 0; is_hex < 2; is_hex++) {
    sensor s = sensor_make(400, 380, 13.07, 1.1, is_hex), n = s;
    n.shot = 1.3e-4;
    n.read = 1.4e-7; // ISO 400
    shot clean = take(&s), grainy = take(&n);
    quality known = decode(&clean, &s.grid, 9), found = decode(&clean, NULL, 9);
    quality noisy = decode(&grainy, NULL, 9);
    free(clean.white_px);
    free(clean.raw_px);
    free(grainy.white_px);
    free(grainy.raw_px);
    print_message("%s %dx%d: known lattice %.2f dB (worst sub-view %.2f), found %.2f (%.2f), noise %.2f\n",
                  is_hex ? "hexagonal" : "square", known.w, known.h, known.all_db, known.worst_db,
                  found.all_db, found.worst_db, noisy.all_db);
    assert_true(known.w >= 27 && known.h >= 27);
    assert_true(known.all_db >= 38 && known.worst_db >= 38);
    assert_true(found.all_db >= 38 && found.worst_db >= 37);
    assert_true(noisy.all_db >= 38);
  }
}

// Whatever the lattice, every sample is on the sensor with the pixels around it.
TEST(test_plan) {
  for (int k = 0; k < 60; k++) {
    sensor s = sensor_make(300 + 7 * k, 280 + 3 * (k % 5), 7 + 0.37 * k, k % 11 - 5, k & 1);
    sv_lenslet_plan p;
    int keep = 1 + k % (int)(0.6 * s.grid.pitch_px);
    if (keep > 16) keep = 16;
    if (sv_lenslet_plan_make(&p, &s.grid, &(sv_lenslet_cfg){.keep = keep}, s.w, s.h, &err) != SV_OK)
      fail_msg("%s", err.text);
    for (int t = 0; t < p.height_px; t++)
      for (int c = 0; c < 4; c++) {
        double at[2];
        sv_lenslet_centre(&p.grid, p.i0 + (c & 1 ? p.n_columns - 1 : 0), p.j0 + t, at);
        for (int i = 0; i < 2; i++)
          at[i] += 0.5 * (keep - 1) * ((c & 1 ? 1 : -1) * p.axis_u[i] + (c & 2 ? 1 : -1) * p.axis_v[i]);
        assert_true(at[0] >= 2 && at[1] >= 2 && at[0] <= s.w - 2 && at[1] <= s.h - 2);
      }
    // Nothing much is given away: the rectangle fills the sensor but for the turn.
    if (k % 11 == 5 && !(k & 1)) assert_true(p.width_px >= s.w / s.grid.pitch_px - 3);
  }
  sv_lenslet_plan p;
  sensor s = sensor_make(300, 300, 9, 0, false);
  assert_int_equal(sv_lenslet_plan_make(&p, &s.grid, &(sv_lenslet_cfg){.keep = 12}, 300, 300, &err),
                   SV_E_RANGE);
  assert_int_equal(sv_lenslet_plan_make(&p, &s.grid, &(sv_lenslet_cfg){.keep = 0}, 300, 300, &err), SV_E_ARG);
  assert_int_equal(sv_lenslet_plan_make(&p, &s.grid, &(sv_lenslet_cfg){.keep = 7}, 20, 300, &err),
                   SV_E_RANGE);
}

// A point in the plane of focus is at one place in all sub-views; a nearer one moves against the
// camera.
TEST(test_rig) {
  sensor s = sensor_make(400, 300, 10, 0, true);
  sv_lenslet_plan p;
  static uint8_t block[64 << 10];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_rig rig;
  assert_int_equal(sv_lenslet_plan_make(&p, &s.grid, &(sv_lenslet_cfg){.keep = 3}, s.w, s.h, &err), SV_OK);
  assert_int_equal(sv_rig_init(&rig, 8, &a), SV_OK);
  sv_lenslet_optics o = {.focal_px = 60, .baseline_m = 0.002, .focus_m = 0.5};
  assert_int_equal(sv_lenslet_rig(&rig, &p, &o), SV_E_FULL);
  assert_int_equal(sv_rig_init(&rig, 9, &a), SV_OK);
  assert_int_equal(sv_lenslet_rig(&rig, &p, &o), SV_OK);
  assert_true(rig.n_sub_views == 9 && rig.forward == SV_FORWARD_LIGHT_FIELD);
  assert_string_equal(rig.sub_views[5].name, "r1c2");
  double far[3] = {0.05, 0.03, 0.5}, near[3] = {0.05, 0.03, 0.25}, first[2], uv[2];
  for (int i = 0; i < 9; i++) {
    double x[3];
    sv_pose_apply(x, &rig.sub_views[i].cam_from_rig, far);
    assert_true(sv_model_project(&rig.sub_views[i].model, x, uv, NULL, NULL));
    if (i == 0) {
      first[0] = uv[0];
      first[1] = uv[1];
    }
    assert_true(fabs(uv[0] - first[0]) < 1e-9 && fabs(uv[1] - first[1]) < 1e-9);
    sv_pose_apply(x, &rig.sub_views[i].cam_from_rig, near);
    assert_true(sv_model_project(&rig.sub_views[i].model, x, uv, NULL, NULL));
    double slope = 60 * 0.002 * (1 / 0.25 - 1 / 0.5); // px per step
    double centre = rig.sub_views[4].model.p[2] + 60 * 0.05 / 0.25;
    assert_true(fabs(uv[0] - (centre - slope * (i % 3 - 1))) < 1e-9);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_find),   cmocka_unit_test(test_find_hard), cmocka_unit_test(test_no_white_image),
      cmocka_unit_test(test_decode), cmocka_unit_test(test_plan),      cmocka_unit_test(test_rig),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
