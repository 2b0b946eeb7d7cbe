// SPDX-License-Identifier: Apache-2.0
// Models in viewers' formats: written and read back within the quantisation of each, refused when
// damaged, and read by an independent program where it is installed (splat-transform of PlayCanvas:
// npm install -g @playcanvas/splat-transform, or its path in SV_SPLAT_TRANSFORM).
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/rng.h"
#include "src/format/axes.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/lab/lab.h"
#include "tools/lab/model_formats.h"

#define N 41 // no multiple of 16

static char dir[256];
static sv_gaussian fixture[N];

static float span(sv_rng *r, float lo, float hi) { return lo + (hi - lo) * sv_rng_f(r); }

// No symmetry that could hide a swapped axis, sign or channel.
static void make_fixture(void) {
  sv_rng r = sv_rng_make(11, 3);
  for (int i = 0; i < N; i++) {
    sv_gaussian *g = &fixture[i];
    for (int k = 0; k < 3; k++) {
      g->mean[k] = span(&r, -3, 5) * (float)(k + 1);
      g->log_scale[k] = span(&r, -6, 1);
    }
    for (int k = 0; k < 4; k++) g->quat_wxyz[k] = span(&r, -1, 1) + (k == i % 4 ? 0.6f : 0);
    g->opacity_logit = span(&r, -4, 4);
    for (int k = 0; k < 16; k++)
      for (int c = 0; c < 3; c++) g->sh[k][c] = k ? span(&r, -0.8f, 0.8f) : span(&r, -1.5f, 1.5f);
  }
}

static lab_model make_model(int degree) {
  lab_model m = {0};
  size_t bytes = sv_gaussians_bytes(N, degree) + SV_ARENA_ALIGN;
  m.block = malloc(bytes);
  sv_arena a = sv_arena_make(m.block, bytes);
  assert_int_equal(sv_gaussians_init(&m.g, N, degree, &a), SV_OK);
  for (int i = 0; i < N; i++) sv_gaussians_put(&m.g, i, &fixture[i]);
  m.is_mip = true;
  return m;
}

typedef struct {
  double mean, log_scale, opacity, dc, sh1, sh_rest, angle;
} limits;

static double sigmoid(double x) { return 1 / (1 + exp(-x)); }

// Of two rotations of an ellipsoid: half turns about its own axes do not change it.
static double angle_between(const float a[4], const float b[4]) {
  const float same[4][4] = {{b[0], b[1], b[2], b[3]},
                            {-b[1], b[0], b[3], -b[2]},
                            {-b[2], -b[3], b[0], b[1]},
                            {-b[3], b[2], -b[1], b[0]}}; // b, b i, b j, b k
  double best = 0, aa = 0, bb = 0;
  for (int k = 0; k < 4; k++) {
    aa += (double)a[k] * (double)a[k];
    bb += (double)b[k] * (double)b[k];
  }
  for (int t = 0; t < 4; t++) {
    double ab = 0;
    for (int k = 0; k < 4; k++) ab += (double)a[k] * (double)same[t][k];
    if (fabs(ab) > best) best = fabs(ab);
  }
  double c = best / sqrt(aa * bb);
  return 2 * acos(c > 1 ? 1 : c);
}

static void must_be_near(const char *what, double got, double wanted, double limit) {
  if (!(fabs(got - wanted) <= limit)) fail_msg("%s: %g, expected %g within %g", what, got, wanted, limit);
}

static void compare(const sv_gaussian *got, const sv_gaussian *want, int degree, const limits *l) {
  must_be_near("opacity", sigmoid((double)got->opacity_logit), sigmoid((double)want->opacity_logit),
               l->opacity);
  must_be_near("rotation", angle_between(got->quat_wxyz, want->quat_wxyz), 0, l->angle);
  for (int k = 0; k < 3; k++) {
    must_be_near("mean", (double)got->mean[k], (double)want->mean[k], l->mean);
    must_be_near("log-scale", (double)got->log_scale[k], (double)want->log_scale[k], l->log_scale);
    for (int s = 0; s < (degree + 1) * (degree + 1); s++)
      must_be_near("SH", (double)got->sh[s][k], (double)want->sh[s][k],
                   s == 0  ? l->dc
                   : s < 4 ? l->sh1
                           : l->sh_rest);
  }
}

// Files may be in another order (.splat: largest first): the nearest by position is meant.
static void compare_all(const sv_gaussians *g, int degree, const limits *l) {
  assert_int_equal(g->n, N);
  assert_true(g->sh_degree <= degree);
  bool seen[N] = {false};
  for (int i = 0; i < N; i++) {
    sv_gaussian v;
    sv_gaussians_get(g, i, &v);
    int best = 0;
    double least = INFINITY;
    for (int k = 0; k < N; k++) {
      double d = 0;
      for (int a = 0; a < 3; a++) d += pow((double)v.mean[a] - (double)fixture[k].mean[a], 2);
      if (d < least) {
        least = d;
        best = k;
      }
    }
    assert_false(seen[best]);
    seen[best] = true;
    compare(&v, &fixture[best], g->sh_degree, l);
  }
}

static const limits splat_limits = {1e-6, 1e-6, 1.0 / 509, 0.5 / 255 / 0.2820, 0, 0, 0.03},
                    spz2_limits = {0.000123, 1.0 / 31.9, 1.0 / 509, 0.0132, 4.51 / 128, 8.51 / 128, 0.2},
                    spz3_limits = {0.000123, 1.0 / 31.9, 1.0 / 509, 0.0132, 4.51 / 128, 8.51 / 128, 0.004},
                    // 11 and 10 bits of the range of each value, which the fixture's chunk has
    compressed_limits = {0.013, 0.0035, 1.0 / 509, 0.006, 4.01 / 256, 4.01 / 256, 0.0035},
                    float_limits = {1e-6, 1e-5, 1e-6, 1e-6, 1e-6, 1e-6, 2e-3};

static void path_of(char out[400], const char *name) { snprintf(out, 400, "%s/%s", dir, name); }

static void write_as(const lab_model *m, int kind, const char *path) {
  sv_err err;
  const sv_model_notes notes = {.is_mip = m->is_mip, .unit = {.is_metric = true, .scale_sigma = 0.001f}};
  sv_status s = kind == 0   ? lab_write_splat(&m->g, path, &err)
                : kind == 1 ? lab_write_glb(&m->g, &notes, path, &err)
                : kind == 5 ? lab_write_compressed_ply(&m->g, &notes, path, &err)
                            : lab_write_spz(&m->g, &notes, kind, path, &err);
  if (s == SV_E_UNSUPPORTED && kind == 4) skip();
  if (s != SV_OK) fail_msg("%s", err.text);
}

// kinds 0, 1, 2, 3, 4, 5 (which we only write)
static const char *const names[] = {"m.splat", "m.glb", "m2.spz", "m3.spz", "m4.spz", "m.compressed.ply"};
static const limits *const limits_of[] = {&splat_limits, &float_limits, &spz2_limits,
                                          &spz3_limits,  &spz3_limits,  &compressed_limits};

static void round_trip(int kind) {
  char path[400];
  sv_err err;
  path_of(path, names[kind]);
  for (int degree = 0; degree <= 3; degree++) {
    lab_model m = make_model(degree), back;
    write_as(&m, kind, path);
    assert_ok(lab_model_read(&back, path, &err), &err);
    assert_int_equal(back.g.sh_degree, kind == 0 ? 0 : degree);
    if (kind >= 2) assert_true(back.is_mip);
    compare_all(&back.g, degree, limits_of[kind]);
    lab_model_free(&back);
    lab_model_free(&m);
  }
}

static void test_splat(void **state) { (void)state, round_trip(0); }
static void test_glb(void **state) { (void)state, round_trip(1); }
static void test_spz2(void **state) { (void)state, round_trip(2); }
static void test_spz3(void **state) { (void)state, round_trip(3); }
static void test_spz4(void **state) { (void)state, round_trip(4); }

// The colour that SH give in a direction is the same after both are turned.
static double colour(const sv_gaussian *g, int c, const double d[3]) {
  double x = d[0], y = d[1], z = d[2];
  const double b[16] = {1,
                        y,
                        z,
                        x,
                        x * y,
                        y * z,
                        3 * z * z - 1,
                        x * z,
                        x * x - y * y,
                        y * (3 * x * x - y * y),
                        x * y * z,
                        y * (5 * z * z - 1),
                        z * (5 * z * z - 3),
                        x * (5 * z * z - 1),
                        z * (x * x - y * y),
                        x * (x * x - 3 * y * y)};
  double sum = 0;
  for (int k = 0; k < 16; k++) sum += b[k] * (double)g->sh[k][c];
  return sum;
}

TEST(test_turns) {
  static const double signs[3][3] = {{1, 1, 1}, {1, -1, -1}, {-1, -1, 1}};
  const double d[3] = {0.36, -0.48, 0.8};
  for (int t = 0; t < 3; t++)
    for (int i = 0; i < N; i++) {
      sv_gaussian g = fixture[i];
      double turned[3], r[9], r0[9];
      sv_gaussian_turn(&g, (sv_half_turn)t);
      for (int k = 0; k < 3; k++) {
        turned[k] = signs[t][k] * d[k];
        assert_true((double)g.mean[k] == signs[t][k] * (double)fixture[i].mean[k]);
      }
      for (int c = 0; c < 3; c++) assert_true(fabs(colour(&g, c, turned) - colour(&fixture[i], c, d)) < 1e-9);
      double q[4], q0[4];
      for (int k = 0; k < 4; k++) {
        q[k] = (double)g.quat_wxyz[k];
        q0[k] = (double)fixture[i].quat_wxyz[k];
      }
      sv_quat_to_mat(r, q);
      sv_quat_to_mat(r0, q0);
      // The Gaussian's covariance in the turned world: S R R' S. Its first axis is enough to see a
      // wrong sign.
      for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
          double cov = 0, cov0 = 0;
          for (int k = 0; k < 3; k++) {
            cov += r[3 * a + k] * r[3 * b + k] * (k + 1);
            cov0 += r0[3 * a + k] * r0[3 * b + k] * (k + 1);
          }
          assert_true(fabs(cov - signs[t][a] * signs[t][b] * cov0) < 1e-9);
        }
      sv_gaussian_turn(&g, (sv_half_turn)t);
      assert_memory_equal(&g, &fixture[i], sizeof g);
    }
}

// The covariance of a Gaussian.
static void covariance(const sv_gaussian *g, double out[9]) {
  double q[4], r[9];
  for (int k = 0; k < 4; k++) q[k] = (double)g->quat_wxyz[k];
  sv_quat_to_mat(r, q);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      out[3 * a + b] = 0;
      for (int k = 0; k < 3; k++)
        out[3 * a + b] += r[3 * a + k] * r[3 * b + k] * exp(2 * (double)g->log_scale[k]);
    }
}

// A turned world seen from turned places is the same: places, covariances, colours of the real SH
// in any direction.
static void must_be_turned(const sv_gaussian *g, const sv_gaussian *was, const double r[9]) {
  double x[3], want[3], c[9], c0[9], d[3] = {0.36, -0.48, 0.8}, turned[3];
  for (int k = 0; k < 3; k++) x[k] = (double)was->mean[k];
  sv_apply33(want, r, x);
  sv_apply33(turned, r, d);
  for (int k = 0; k < 3; k++) must_be_near("turned place", (double)g->mean[k], want[k], 1e-5);
  covariance(g, c);
  covariance(was, c0);
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      double v = 0;
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) v += r[3 * a + i] * c0[3 * i + j] * r[3 * b + j];
      must_be_near("turned covariance", c[3 * a + b], v, 2e-5);
    }
  // The norms of the functions, which `colour` leaves out.
  static const double norm[16] = {1,      -0.4886, 0.4886, -0.4886, 1.0925,  -1.0925, 0.31539, -1.0925,
                                  0.5463, -0.5900, 2.8906, -0.4570, 0.37318, -0.4570, 1.4453,  -0.5900};
  sv_gaussian a = *g, b = *was;
  for (int k = 0; k < 16; k++)
    for (int ch = 0; ch < 3; ch++) {
      a.sh[k][ch] *= (float)norm[k];
      b.sh[k][ch] *= (float)norm[k];
    }
  for (int ch = 0; ch < 3; ch++)
    must_be_near("turned colour", colour(&a, ch, turned), colour(&b, ch, d), 2e-3);
}

TEST(test_any_turn) {
  sv_rng rng = sv_rng_make(5, 5);
  for (int n = 0; n < 20; n++) {
    double r[9];
    const double w[3] = {(double)span(&rng, -2, 2), (double)span(&rng, -2, 2), (double)span(&rng, -2, 2)};
    sv_turn turn;
    sv_rodrigues(r, w);
    sv_turn_make(&turn, r);
    for (int i = 0; i < N; i++) {
      sv_gaussian g = fixture[i];
      sv_gaussian_turn_by(&g, &turn);
      must_be_turned(&g, &fixture[i], r);
    }
  }
}

// Models of worlds with each way up are Y-up in the formats that define it, and unchanged in PLY.
TEST(test_up) {
  static const char *const ups[] = {"x", "y", "z", "-x", "-y", "-z"};
  char path[400];
  sv_err err;
  lab_session session;
  assert_int_equal(lab_session_start(&session, 1, true, &err), SV_OK);
  for (int u = 0; u < 6; u++) {
    double up[3], turned[3];
    sv_turn turn;
    assert_true(sv_up_axis(ups[u], up));
    const float near[3] = {(float)up[0] * 0.9f + 0.2f, (float)up[1] * 0.9f - 0.1f,
                           (float)up[2] * 0.9f + 0.3f};
    assert_string_equal(sv_up_name(near), ups[u]);
    sv_turn_upright(&turn, ups[u]);
    assert_int_equal(turn.is_none, u == 4);
    if (turn.is_none) continue;
    sv_apply33(turned, turn.r, up);
    must_be_near("up", turned[1], -1, 1e-12);
    for (int kind = 1; kind < 4; kind++) {
      lab_model m = make_model(3), back;
      path_of(path, names[kind]);
      if (kind == 1)
        assert_int_equal(lab_write_glb(&m.g, &(sv_model_notes){.up = ups[u]}, path, &err), SV_OK);
      else
        assert_int_equal(
            lab_write_spz(&m.g, &(sv_model_notes){.is_mip = true, .up = ups[u]}, kind, path, &err), SV_OK);
      assert_ok(lab_model_read(&back, path, &err), &err);
      for (int i = 0; i < N; i++) {
        sv_gaussian got, want = fixture[i];
        sv_gaussians_get(&back.g, i, &got);
        sv_gaussian_turn_by(&want, &turn);
        // SH of degree 3 can leave the range of SPZ's bytes when they are turned.
        for (int k = 0; k < 48; k++) (&want.sh[0][0])[k] = fminf(fmaxf((&want.sh[0][0])[k], -0.99f), 0.99f);
        for (int k = 0; k < 3; k++) want.sh[0][k] = fixture[i].sh[0][k];
        if (kind == 1)
          for (int k = 0; k < 48; k++)
            (&got.sh[0][0])[k] = k < 3 ? (&got.sh[0][0])[k] : fminf(fmaxf((&got.sh[0][0])[k], -0.99f), 0.99f);
        compare(&got, &want, 3, limits_of[kind]);
      }
      lab_turn_back(&back, &session, path, ups[u], NULL);
      for (int i = 0; i < N; i++) {
        sv_gaussian got;
        sv_gaussians_get(&back.g, i, &got);
        for (int k = 0; k < 3; k++)
          must_be_near("place", (double)got.mean[k], (double)fixture[i].mean[k], 1e-3);
      }
      lab_model_free(&back);
      lab_model_free(&m);
    }
    lab_model m = make_model(1), back;
    path_of(path, "up.ply");
    assert_int_equal(
        lab_model_write(&m.g, &(sv_model_notes){.up = ups[u], .unit = {.is_metric = u == 1}}, path, &err),
        SV_OK);
    assert_int_equal(lab_model_read(&back, path, &err), SV_OK);
    assert_int_equal(lab_model_notes(&back).unit.is_metric, u == 1);
    assert_string_equal(back.up, ups[u]);
    sv_gaussian got;
    sv_gaussians_get(&back.g, 7, &got);
    assert_true((double)got.mean[0] == (double)fixture[7].mean[0]);
    lab_model_free(&back);
    lab_model_free(&m);
  }
  lab_session_stop(&session);
}

// Cut anywhere, and changed anywhere in the head: refused with a sentence, or at least read without
// a fault.
TEST(test_damage) {
  char path[400], cut[400];
  sv_err err;
  for (int kind = 0; kind < 5; kind++) {
    lab_model m = make_model(1);
    void *data;
    size_t bytes;
    path_of(path, names[kind]);
    path_of(cut, kind == 0 ? "cut.splat" : "cut.bin");
    write_as(&m, kind, path);
    lab_model_free(&m);
    assert_int_equal(sv_file_read(path, &data, &bytes, &err), SV_OK);
    for (size_t n = 1; n < bytes; n += n < 200 ? 1 : 37) {
      sv_gaussians g;
      sv_model_notes notes;
      void *block;
      uint8_t *part = malloc(n); // of exactly its size, for the address sanitizer
      memcpy(part, data, n);
      err.text[0] = 0;
      sv_status s = lab_read_viewer_format(&g, &notes, &block, &(sv_file_data){cut, part, n}, &err);
      if (s == SV_OK) {
        assert_int_equal(kind, 0); // a whole number of .splat records cannot be told from a whole
                                   // file
        assert_int_equal(n % 32, 0);
        free(block);
      } else assert_true(err.text[0] != 0);
      if (kind == 4 && n >= 4) assert_contains(err.text, "ends early"); // a cut is called one
      free(part);
    }
    uint8_t *copy = malloc(bytes);
    for (size_t i = 0; i < bytes && i < 4000; i += 3) {
      sv_gaussians g;
      sv_model_notes notes;
      void *block = NULL;
      memcpy(copy, data, bytes);
      copy[i] ^= (uint8_t)(1 << i % 8);
      if (lab_read_viewer_format(&g, &notes, &block, &(sv_file_data){cut, copy, bytes}, &err) == SV_OK)
        free(block);
    }
    free(copy);
    free(data);
  }
}

// The unit and its deviation come back from each format that has a place for them.
static void test_unit(void **state) {
  static const char *const files[] = {"u.glb", "u2.spz", "u3.spz", "u4.spz", "u.ply"};
  sv_err err;
  char path[400];
  (void)state;
  for (int kind = 1; kind <= 5; kind++)
    for (int is_known = 0; is_known < 2; is_known++) {
      lab_model m = make_model(1), back;
      const sv_model_notes notes = {.is_mip = true,
                                    .unit = {.is_metric = is_known, .scale_sigma = is_known ? 0.00125f : 0}};
      path_of(path, files[kind - 1]);
      const sv_status s = kind == 1   ? lab_write_glb(&m.g, &notes, path, &err)
                          : kind == 5 ? lab_model_write(&m.g, &notes, path, &err)
                                      : lab_write_spz(&m.g, &notes, kind, path, &err);
      if (kind == 4 && s == SV_E_UNSUPPORTED) continue; // a build without zstd
      assert_int_equal(s, SV_OK);
      assert_int_equal(lab_model_read(&back, path, &err), SV_OK);
      assert_int_equal(back.unit.is_metric, is_known);
      assert_float_equal(back.unit.scale_sigma, notes.unit.scale_sigma, 1e-9);
      assert_int_equal(back.g.n, m.g.n);
      lab_model_free(&back);
      lab_model_free(&m);
    }
}

// --- an independent reader -----------------------------------------------------------------------

static bool find_tool(char out[600]) {
  const char *given = getenv("SV_SPLAT_TRANSFORM");
  if (given) snprintf(out, 600, "%s", given);
  else snprintf(out, 600, "splat-transform");
  char command[700];
  snprintf(command, sizeof command, "command -v '%s' >/dev/null 2>&1", out);
  return system(command) == 0;
}

// Distance of a position to the nearest of the fixture's.
static double distance(const sv_gaussian *g) {
  double least = INFINITY;
  for (int k = 0; k < N; k++) {
    double d = 0;
    for (int a = 0; a < 3; a++) d += pow((double)g->mean[a] - (double)fixture[k].mean[a], 2);
    least = d < least ? d : least;
  }
  return least;
}

// Its releases turn .spz files, whose axes are right-up-back, or keep their numbers: one for all
// Gaussians, which are compared whole afterwards. GLB it only writes: then ours is the reader.
TEST(test_independent) {
  char tool[600], path[400], back_path[400], command[2000];
  sv_err err;
  if (!find_tool(tool)) {
    print_message("skip the independent reader: splat-transform is not installed\n");
    skip();
  }
  for (int kind = 0; kind < 6; kind++) {
    lab_model m = make_model(3), back;
    path_of(path, names[kind]);
    path_of(back_path, kind == 1 ? "theirs.glb" : "back.ply");
    if (kind == 1) {
      path_of(path, "m.ply");
      assert_int_equal(lab_model_write(&m.g, &(sv_model_notes){.is_mip = false}, path, &err), SV_OK);
    } else write_as(&m, kind, path);
    lab_model_free(&m);
    snprintf(command, sizeof command, "'%s' -w '%s' '%s' >'%s/log' 2>&1", tool, path, back_path, dir);
    if (system(command) != 0) fail_msg("%s failed", command);
    if (lab_model_read(&back, back_path, &err) < 0) fail_msg("%s: %s", names[kind], err.text);
    sv_gaussian g;
    sv_gaussians_get(&back.g, 0, &g);
    bool is_kept = kind >= 2 && kind <= 4 && distance(&g) > 0.01;
    for (int i = 0; is_kept && i < back.g.n; i++) {
      sv_gaussians_get(&back.g, i, &g);
      sv_gaussian_turn(&g, SV_TURN_X);
      sv_gaussians_put(&back.g, i, &g);
    }
    compare_all(&back.g, 3, limits_of[kind]);
    print_message(kind == 1 ? "%s: splat-transform's reads as ours does\n"
                            : "%s: read by splat-transform within its quantisation\n",
                  names[kind]);
    lab_model_free(&back);
  }
}

FIXTURE(make_dir) {
  const char *tmp = getenv("TMPDIR");
  snprintf(dir, sizeof dir, "%s/sv_formats_XXXXXX", tmp ? tmp : "/tmp");
  make_fixture();
  return mkdtemp(dir) ? 0 : -1;
}
FIXTURE(remove_dir) {
  char command[300];
  snprintf(command, sizeof command, "rm -rf '%s'", dir);
  return system(command);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_turns), cmocka_unit_test(test_any_turn),    cmocka_unit_test(test_up),
      cmocka_unit_test(test_splat), cmocka_unit_test(test_glb),         cmocka_unit_test(test_spz2),
      cmocka_unit_test(test_spz3),  cmocka_unit_test(test_spz4),        cmocka_unit_test(test_damage),
      cmocka_unit_test(test_unit),  cmocka_unit_test(test_independent),
  };
  return cmocka_run_group_tests(tests, make_dir, remove_dir);
}
