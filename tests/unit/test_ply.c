// SPDX-License-Identifier: Apache-2.0
// PLY in both forms, properties in any order, models written and read back, .splat bytes.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/rng.h"
#include "src/format/ply.h"
#include "src/format/splat_file.h"
#include "tests/common/test.h"

static sv_err err;

typedef struct {
  uint8_t data[200000];
  size_t n;
  int n_calls, fail_at; // fails the call with this number, from 1
} memory;
static memory mem;

static sv_status to_memory(void *self, const void *data, size_t bytes, sv_err *e) {
  memory *m = self;
  assert_true(bytes > 0);
  if (++m->n_calls == m->fail_at) return sv_fail(e, SV_E_IO, "disk full");
  assert_true(m->n + bytes <= sizeof m->data);
  memcpy(m->data + m->n, data, bytes);
  m->n += bytes;
  return SV_OK;
}

static sv_gaussian random_gaussian(sv_rng *r, int degree) {
  sv_gaussian g = {{0}, {0}, {0}, sv_rng_normal(r), {{0}}};
  for (int i = 0; i < 3; i++) {
    g.mean[i] = sv_rng_normal(r);
    g.log_scale[i] = sv_rng_normal(r) - 4;
  }
  for (int i = 0; i < 4; i++) g.quat_wxyz[i] = sv_rng_normal(r);
  for (int k = 0; k < (degree + 1) * (degree + 1); k++)
    for (int c = 0; c < 3; c++) g.sh[k][c] = sv_rng_normal(r);
  return g;
}

TEST(test_round_trip) {
  for (int degree = 0; degree <= 3; degree++)
    for (int normals = 0; normals < 2; normals++) {
      enum { N = 100 };
      static sv_gaussian g[N];
      static sv_ply_writer w;
      sv_rng r = sv_rng_make(3, (uint64_t)degree);
      sv_ply_options o = {.n = N,
                          .sh_degree = degree,
                          .vertical = "-y",
                          .is_mip = degree == 2,
                          .dilation_px2 = degree == 1 ? 0.1f : 0.0f,
                          .unit = {.is_metric = degree == 3, .scale_sigma = 0.001f * (float)degree},
                          .has_normals = normals != 0};
      memset(&mem, 0, sizeof mem);
      assert_int_equal(sv_ply_write_begin(&w, (sv_sink){&mem, to_memory}, &o, &err), SV_OK);
      for (int i = 0; i < N; i++) {
        g[i] = random_gaussian(&r, degree);
        assert_int_equal(sv_ply_write_gaussian(&w, &g[i], &err), SV_OK);
      }
      assert_int_equal(sv_ply_write_end(&w, &err), SV_OK);
      assert_int_equal(mem.n, sv_ply_file_bytes(&o));
      sv_ply p;
      assert_int_equal(sv_ply_open(&p, "m.ply", mem.data, mem.n, &err), SV_OK);
      assert_int_equal(p.kind, SV_PLY_GAUSSIANS);
      assert_int_equal(p.n, N);
      assert_int_equal(p.sh_degree, degree);
      assert_int_equal(p.is_mip, degree == 2);
      assert_int_equal(p.unit.is_metric, degree == 3);
      assert_float_equal(p.unit.scale_sigma, 0.001f * (float)degree, 1e-9);
      assert_float_equal(p.dilation_px2, o.dilation_px2, 1e-7);
      assert_string_equal(p.vertical, "-y");
      for (int i = N - 1; i >= 0; i--) {
        sv_gaussian back;
        assert_int_equal(sv_ply_read_gaussian(&p, (uint32_t)i, &back, &err), SV_OK);
        assert_memory_equal(&back, &g[i], sizeof back);
      }
      assert_int_equal(sv_ply_open(&p, "m.ply", mem.data, mem.n - 1, &err), SV_E_FORMAT);
    }
}

TEST(test_writer_failures) {
  static sv_ply_writer w;
  sv_gaussian g = {.quat_wxyz = {1}};
  sv_ply_options o = {.n = 40, .sh_degree = 3};
  for (int k = 1;; k++) {
    memset(&mem, 0, sizeof mem);
    mem.fail_at = k;
    sv_status s = sv_ply_write_begin(&w, (sv_sink){&mem, to_memory}, &o, &err);
    for (int i = 0; i < 40 && s == SV_OK; i++) s = sv_ply_write_gaussian(&w, &g, &err);
    if (s == SV_OK) s = sv_ply_write_end(&w, &err);
    if (s == SV_OK) break;
    assert_int_equal(s, SV_E_IO);
    assert_true(k < 100);
  }
  assert_int_equal(sv_ply_write_gaussian(&w, &g, &err), SV_E_FULL);
  o.sh_degree = 4;
  assert_int_equal(sv_ply_write_begin(&w, (sv_sink){&mem, to_memory}, &o, &err), SV_E_ARG);
  o.sh_degree = 0;
  mem.fail_at = 0;
  mem.n = 0;
  assert_int_equal(sv_ply_write_begin(&w, (sv_sink){&mem, to_memory}, &o, &err), SV_OK);
  assert_int_equal(sv_ply_write_end(&w, &err), SV_E_ARG);
}

// f_rest is channel-major: f_rest_0 is R's first coefficient, f_rest_3 G's first (degree 1).
TEST(test_ascii_any_order) {
  static const char t[] =
      "ply\r\nformat ascii 1.0\ncomment by hand\nobj_info x\nelement camera 2\nproperty float a\n"
      "element vertex 2\n"
      "property double rot_3\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n"
      "property float z\nproperty float y\nproperty float x\nproperty int label\nproperty float opacity\n"
      "property float scale_2\nproperty float scale_1\nproperty float scale_0\n"
      "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
      "property float f_rest_0\nproperty float f_rest_1\nproperty float f_rest_2\nproperty float f_rest_3\n"
      "property float f_rest_4\nproperty float f_rest_5\nproperty float f_rest_6\nproperty float f_rest_7\n"
      "property float f_rest_8\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n1\n\n2\n"
      "4 1 2 3 30 20 10 77 -inf -3 -2 -inf .1 .2 .3 0 1 2 3 4 5 6 7 8\n"
      "0 1 0 0 3 2 1 7 0.5 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0\n";
  sv_ply p;
  sv_gaussian g;
  assert_int_equal(sv_ply_open(&p, "a.ply", t, sizeof t - 1, &err), SV_OK);
  assert_int_equal(p.sh_degree, 1);
  for (int pass = 0; pass < 2; pass++) { // the second goes back to the start
    assert_int_equal(sv_ply_read_gaussian(&p, 0, &g, &err), SV_OK);
    assert_true(g.mean[0] == 10 && g.mean[1] == 20 && g.mean[2] == 30);
    assert_true(g.quat_wxyz[0] == 1 && g.quat_wxyz[1] == 2 && g.quat_wxyz[2] == 3 && g.quat_wxyz[3] == 4);
    assert_true(g.log_scale[0] == -30 && g.log_scale[1] == -2 && g.log_scale[2] == -3 &&
                g.opacity_logit == -15);
    for (int k = 0; k < 3; k++)
      for (int c = 0; c < 3; c++) assert_true(g.sh[1 + k][c] == (float)(3 * c + k));
    assert_true(g.sh[4][0] == 0);
    assert_int_equal(sv_ply_read_gaussian(&p, 1, &g, &err), SV_OK);
    assert_true(g.mean[0] == 1 && g.opacity_logit == 0.5f);
  }
  assert_int_equal(sv_ply_read_gaussian(&p, 2, &g, &err), SV_E_ARG);
}

static sv_status points(const char *t, size_t n, float xyz[3], float rgb[3]) {
  sv_ply p;
  sv_status s = sv_ply_open(&p, "p.ply", t, n, &err);
  return s == SV_OK ? sv_ply_read_point(&p, 0, xyz, rgb, &err) : s;
}
#define HEAD(form) "ply\nformat " form " 1.0\n"

TEST(test_points) {
  float x[3], c[3];
  static const char bin[] = HEAD(
      "binary_little_endian") "element skipped 3\nproperty ushort q\nelement vertex 1\nproperty uchar blue\n"
                              "property uchar green\nproperty uchar red\nproperty short x\nproperty float "
                              "y\nproperty char z\nend_header\n"
                              "ABCDEF"
                              "\x00\x33\xff"
                              "\xfe\xff"
                              "\x00\x00\x80\x3f"
                              "\x81";
  assert_int_equal(points(bin, sizeof bin - 1, x, c), SV_OK);
  assert_true(x[0] == -2 && x[1] == 1 && x[2] == -127);
  assert_true(c[0] == 1 && fabsf(c[1] - 0.2f) < 1e-7f && c[2] == 0);
  static const char f[] = HEAD(
      "ascii") "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
               "property float red\nproperty float green\nproperty float blue\nend_header\n1 2 3 0.25 2 -1\n";
  assert_int_equal(points(f, sizeof f - 1, x, c), SV_OK);
  assert_true(c[0] == 0.25f && c[1] == 1 && c[2] == 0); // clamped
  static const char dc[] =
      HEAD("ascii") "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
                    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nend_header\n1 2 3 "
                    "0 1 -1";
  assert_int_equal(points(dc, sizeof dc - 1, x, c), SV_OK);
  assert_true(c[0] == 0.5f && fabsf(c[1] - 0.7820948f) < 1e-6f);
  static const char grey[] = HEAD(
      "ascii") "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
  assert_int_equal(points(grey, sizeof grey - 1, x, c), SV_OK);
  assert_true(c[0] == 0.5f && c[2] == 0.5f);
}

TEST(test_refused) {
#define XYZ "property float x\nproperty float y\nproperty float z\n"
  static const struct {
    const char *text, *word;
    sv_status s;
  } cases[] = {
      {"plx\n", "ply", SV_E_FORMAT},
      {"ply\nelement vertex 1\n" XYZ "end_header\n1 2 3\n", "format", SV_E_FORMAT},
      {HEAD("binary_big_endian") "element vertex 0\n" XYZ "end_header\n", "binary_big_endian",
       SV_E_UNSUPPORTED},
      {HEAD("ascii") "element vertex -1\n" XYZ "end_header\n", "count", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 99999999999\n" XYZ "end_header\n", "too many", SV_E_RANGE},
      {HEAD("ascii") "element vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n", "x, y and z",
       SV_E_NOT_FOUND},
      {HEAD("ascii") "element vertex 1\n" XYZ "property float x\nend_header\n", "twice", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "property quad w\nend_header\n", "quad", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "property list uchar int w\nend_header\n", "list",
       SV_E_UNSUPPORTED},
      {HEAD("ascii") "element face 1\nproperty list uchar int w\nelement vertex 1\n" XYZ "end_header\n",
       "list", SV_E_UNSUPPORTED},
      {HEAD("ascii") "element vertex 1\n" XYZ "bogus\nend_header\n", "bogus", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ, "end_header", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "property float scale_0\nend_header\n", "whole 3DGS",
       SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "end_header\n1 2\n", "2 values", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "end_header\n1 2 3 4\n", "more than 3", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "end_header\n1 2 x3\n", "x3", SV_E_FORMAT},
      {HEAD("ascii") "element vertex 1\n" XYZ "end_header\n1 nan 3\n", "finite", SV_E_RANGE},
      {HEAD("ascii") "element vertex 1\n" XYZ "end_header\n1 1e39 3\n", "finite", SV_E_RANGE},
      {HEAD("ascii") "element vertex 1\n" XYZ "end_header\n", "ends after 0", SV_E_FORMAT},
      {HEAD("binary_little_endian") "element vertex 1\n" XYZ "end_header\n12345678901", "ends after 0",
       SV_E_FORMAT},
      {HEAD("binary_little_endian") "element a 9999\nproperty int b\nelement vertex 1\n" XYZ
                                    "end_header\n123456789012",
       "before its vertices", SV_E_FORMAT},
  };
  float x[3], c[3];
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    sv_status s = points(cases[i].text, strlen(cases[i].text), x, c);
    assert_error(s, cases[i].s, &err, cases[i].word);
  }
}

TEST(test_splat) {
  sv_gaussian g = {{1, -2, 3}, {-2, 0, 0, 0}, {0, -1, 1}, 0, {{10, 0, -10}}};
  uint8_t o[SV_SPLAT_BYTES];
  float f[6];
  sv_splat_encode(&g, o);
  memcpy(f, o, sizeof f); // this test runs on little-endian machines
  assert_true(f[0] == 1 && f[1] == -2 && f[2] == 3 && f[3] == 1);
  assert_true(fabsf(f[4] - 0.36787944f) < 1e-7f && fabsf(f[5] - 2.7182817f) < 1e-6f);
  assert_int_equal(o[24], 255);
  assert_int_equal(o[25], 128);
  assert_int_equal(o[26], 0);
  assert_int_equal(o[27], 128);
  assert_int_equal(o[28], 0); // w = -1
  assert_int_equal(o[29], 128);
  assert_true(fabsf(sv_splat_order(&g) - 0.5f) < 1e-7f);
  g.quat_wxyz[0] = 5;
  sv_splat_encode(&g, o);
  assert_int_equal(o[28], 255); // 256 does not fit
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_round_trip),      cmocka_unit_test(test_writer_failures),
      cmocka_unit_test(test_ascii_any_order), cmocka_unit_test(test_points),
      cmocka_unit_test(test_refused),         cmocka_unit_test(test_splat)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
