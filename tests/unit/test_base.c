// SPDX-License-Identifier: Apache-2.0
// The floor: arena, rings, text, numbers, random numbers, elementary functions, poses.
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/arena.h"
#include "src/base/mathx.h"
#include "src/base/ring.h"
#include "src/base/rng.h"
#include "src/base/str.h"
#include "src/base/vec.h"
#include "src/rig/rig.h"
#include "tests/common/test.h"

TEST(test_status) {
  sv_err e;
  assert_string_equal(sv_status_name(SV_E_NOMEM), "E_NOMEM");
  assert_string_equal(sv_status_name(12345), "?");
  assert_true(strlen(sv_status_text(SV_E_SEALED)) > 10);
  assert_int_equal(sv_fail(&e, SV_E_IO, "file %s, byte %zu", "a.bin", (size_t)12), SV_E_IO);
  assert_string_equal(e.text, "file a.bin, byte 12");
  assert_int_equal(sv_fail(NULL, SV_E_IO, "x"), SV_E_IO);
}

static void carve(sv_arena *a, char **p, double **d) {
  sv_arena_part_begin(a, "text");
  *p = SV_TAKE(a, char, 100);
  sv_arena_part_begin(a, "numbers");
  *d = SV_TAKE(a, double, 33);
}

TEST(test_arena) {
  char *p;
  double *d;
  sv_arena dry = sv_arena_dry();
  carve(&dry, &p, &d);
  assert_int_equal(dry.used_bytes, 128 + 320);
  uint8_t *block = aligned_alloc(64, 1024);
  assert_non_null(block);
  sv_arena a = sv_arena_make(block, dry.used_bytes);
  carve(&a, &p, &d);
  assert_int_equal(a.status, SV_OK);
  assert_true(p && d && (uintptr_t)d % 64 == 0);
  size_t sum = 0;
  for (int i = 0; i < a.n_parts; i++) sum += a.parts[i].bytes;
  assert_int_equal(sum, a.used_bytes); // the map adds up to the byte
  a = sv_arena_make(block, dry.used_bytes - 1);
  carve(&a, &p, &d);
  assert_int_equal(a.status, SV_E_NOMEM); // one byte short
  a = sv_arena_make(block + 1, 512);      // an unaligned block loses its first bytes, and says so
  assert_int_equal(a.used_bytes, 63);
  assert_string_equal(a.parts[0].name, "align");
  size_t mark = sv_arena_mark(&a);
  assert_non_null(SV_TAKE(&a, char, 64));
  sv_arena_reset(&a, mark);
  assert_int_equal(a.used_bytes, 63);
  assert_int_equal(a.high_bytes, 127);
  assert_null(sv_arena_take(&a, SIZE_MAX / 2, 4)); // n * size overflows
  assert_int_equal(a.status, SV_E_NOMEM);
  sv_arena_reset(&a, mark);
  sv_arena sub = sv_arena_sub(&a, 128);
  assert_non_null(SV_TAKE(&sub, char, 128));
  assert_null(SV_TAKE(&sub, char, 1));
  sv_arena_seal(&a);
  assert_null(SV_TAKE(&a, char, 1));
  assert_int_equal(a.status, SV_E_SEALED);
  free(block);
}

#define N_RING 200000
static void *ring_writer(void *arg) {
  sv_ring *r = arg;
  for (uint32_t i = 0; i < N_RING;)
    if (sv_ring_push(r, &i) == SV_OK) i++;
  return NULL;
}

TEST(test_ring) {
  static _Alignas(64) uint8_t block[4096];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_ring r;
  pthread_t writer;
  uint32_t x;
  assert_int_equal(sv_ring_init(&r, 0, 4, &a), SV_E_ARG);
  assert_int_equal(sv_ring_init(&r, 100, sizeof x, &a), SV_OK);
  assert_int_equal(r.cap, 128);
  assert_int_equal(sv_ring_pop(&r, &x), SV_AGAIN);
  for (uint32_t i = 0; i < 128; i++) assert_int_equal(sv_ring_push(&r, &i), SV_OK);
  assert_int_equal(sv_ring_push(&r, &x), SV_AGAIN);
  assert_int_equal(sv_ring_count(&r), 128);
  for (uint32_t i = 0; i < 128; i++) {
    assert_int_equal(sv_ring_pop(&r, &x), SV_OK);
    assert_int_equal(x, i);
  }
  assert_int_equal(pthread_create(&writer, NULL, ring_writer, &r), 0);
  for (uint32_t i = 0; i < N_RING;)
    if (sv_ring_pop(&r, &x) == SV_OK) {
      if (x != i) fail_msg("element %u came out as %u", i, x);
      i++;
    }
  pthread_join(writer, NULL);
}

TEST(test_text) {
  char b[64];
  double d;
  long long n;
  assert_int_equal(sv_fmt(b, sizeof b, "%5d|%-4s|%04x|%.3f|%zu", -42, "ab", 0xbeu, 2.0 / 3, (size_t)7), 23);
  assert_string_equal(b, "  -42|ab  |00be|0.667|7");
  sv_fmt(b, 5, "%s", "abcdefg");
  assert_string_equal(b, "abcd");
  sv_fmt(b, sizeof b, "%f %g %g", (double)NAN, (double)INFINITY, -1e-30);
  assert_string_equal(b, "nan inf -1e-30");
  sv_rng r = sv_rng_make(1, 1);
  for (int i = 0; i < 20000; i++) { // a float printed with %g comes back unchanged
    uint32_t u = sv_rng_u32(&r);
    float f;
    memcpy(&f, &u, 4);
    if (!isfinite(f) || fabsf(f) < 1e-37f) continue;
    size_t len = sv_fmt(b, sizeof b, "%g", (double)f);
    assert_true(sv_parse_double(b, len, &d));
    if ((float)d != f) fail_msg("%.9g was printed as %s", (double)f, b);
  }
  assert_false(sv_parse_double("1.5x", 4, &d));
  assert_false(sv_parse_double("1e999", 5, &d));
  assert_false(sv_parse_double("", 0, &d));
  assert_true(sv_parse_int("-12", 3, &n) && n == -12);
  assert_false(sv_parse_int("12a", 3, &n));
  sv_str s = sv_str_make(b, 12);
  sv_str_add_json(&s, "a\"\n");
  assert_string_equal(b, "a\\\"\\u000a");
  sv_str_add(&s, "%s", "long text");
  assert_true(s.is_cut && strlen(b) == 11);
  static const char *const texts[][3] = {
      // what comes in, as JSON, as a name
      {"\xc3\xbc \xe2\x82\xac \xf0\x9f\x99\x82", "\xc3\xbc \xe2\x82\xac \xf0\x9f\x99\x82",
       "\xc3\xbc \xe2\x82\xac \xf0\x9f\x99\x82"},
      {"a\xff", "a\xef\xbf\xbd", "a_"},                                // no such byte
      {"\xe2\x82", "\xef\xbf\xbd\xef\xbf\xbd", "__"},                  // cut
      {"\xc3(\x80", "\xef\xbf\xbd(\xef\xbf\xbd", "_(_"},               // stray
      {"\xc0\xaf", "\xef\xbf\xbd\xef\xbf\xbd", "__"},                  // longer than it need be
      {"\xed\xa0\x80", "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd", "___"}, // a surrogate
      // beyond Unicode
      {"\xf4\x90\x80\x80 ", "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd ", "____ "},
  };
  for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
    s = sv_str_make(b, sizeof b);
    sv_str_add_json(&s, texts[i][0]);
    assert_string_equal(b, texts[i][1]);
    sv_fmt(b, sizeof b, "%s", texts[i][0]);
    sv_make_utf8(b);
    assert_string_equal(b, texts[i][2]);
  }
}

static double rel(double a, double b) { return fabs(a - b) / fmax(fabs(b), 1e-300); }

TEST(test_functions) {
  sv_rng r = sv_rng_make(3, 1);
  double e_exp = 0, e_log = 0, e_sin = 0, e_atan = 0, e_pow = 0;
  for (int i = 0; i < 200000; i++) {
    double u = (sv_rng_u32(&r) - 2147483648.0) / 2147483648.0,
           v = (sv_rng_u32(&r) - 2147483648.0) / 2147483648.0;
    e_exp = fmax(e_exp, rel(sv_exp(700 * u), exp(700 * u)));
    double p = exp(300 * v);
    e_log = fmax(e_log, fabs(log(p)) > 1e-3 ? rel(sv_log(p), log(p)) : fabs(sv_log(p) - log(p)));
    e_sin = fmax(e_sin, fmax(fabs(sv_sin(1e5 * u) - sin(1e5 * u)), fabs(sv_cos(1e5 * u) - cos(1e5 * u))));
    e_atan = fmax(e_atan, fabs(sv_atan2(u, v) - atan2(u, v)));
    e_pow = fmax(e_pow, rel(sv_pow(fabs(u) + 1e-3, 4 * v), pow(fabs(u) + 1e-3, 4 * v)));
  }
  print_message("errors: exp %.1e log %.1e sin/cos %.1e atan2 %.1e pow %.1e\n", e_exp, e_log, e_sin, e_atan,
                e_pow);
  assert_true(e_exp < 1e-15 && e_log < 1e-15 && e_sin < 1e-15 && e_atan < 1e-15 && e_pow < 1e-14);
  assert_true(sv_exp(1000) == INFINITY && sv_exp(-1000) == 0 && isnan(sv_exp(NAN)));
  assert_true(sv_log(0) == -INFINITY && isnan(sv_log(-1)) && sv_log(1) == 0);
  assert_true(sv_acos(1) == 0 && fabs(sv_acos(-1) - SV_PI) < 1e-15 && fabs(sv_tan(0.5) - tan(0.5)) < 1e-15);
}

TEST(test_random) {
  sv_rng a = sv_rng_make(42, 1), b = sv_rng_make(42, 1), c = sv_rng_make(42, 2);
  double sum = 0, sq = 0;
  int n_same = 0, count[7] = {0};
  for (int i = 0; i < 100000; i++) {
    assert_int_equal(sv_rng_u32(&a), sv_rng_u32(&b));
    n_same += sv_rng_u32(&a) == sv_rng_u32(&c);
    (void)sv_rng_u32(&b);
    double z = (double)sv_rng_normal(&c);
    sum += z;
    sq += z * z;
    count[sv_rng_below(&c, 7)]++;
  }
  assert_true(n_same < 5);
  assert_true(fabs(sum / 1e5) < 0.015 && fabs(sq / 1e5 - 1) < 0.02);
  for (int i = 0; i < 7; i++) assert_true(abs(count[i] - 100000 / 7) < 600);
  assert_int_equal(sv_rng_below(&c, 0), 0);
  assert_true(sv_hash3(1, 2, 3) != sv_hash3(1, 3, 2) && sv_hash3(1, 2, 3) == sv_hash3(1, 2, 3));
}

TEST(test_poses) {
  sv_rng r = sv_rng_make(9, 1);
  for (int i = 0; i < 1000; i++) {
    double w[3], back[3], q[4], x[3] = {0.3, -2, 5}, y[3];
    sv_pose a, b;
    for (int k = 0; k < 3; k++) {
      w[k] = 1.7 * (2 * (double)sv_rng_f(&r) - 1);
      a.t[k] = (double)sv_rng_normal(&r);
    }
    sv_rodrigues(a.r, w);
    assert_true(sv_rotation_error(a.r) < 1e-14);
    sv_rodrigues_inv(back, a.r);
    for (int k = 0; k < 3; k++) assert_true(fabs(back[k] - w[k]) < 1e-12);
    sv_quat_from_mat(q, a.r);
    sv_quat_to_mat(b.r, q);
    for (int k = 0; k < 9; k++) assert_true(fabs(a.r[k] - b.r[k]) < 1e-14);
    b = sv_pose_inv(&a);
    sv_pose_apply(y, &a, x);
    sv_pose_apply(y, &b, y);
    for (int k = 0; k < 3; k++) assert_true(fabs(x[k] - y[k]) < 1e-13);
    b = sv_pose_mul(&a, &b);
    for (int k = 0; k < 9; k++) assert_true(fabs(b.r[k] - (k % 4 == 0)) < 1e-13);
  }
  sv_pose p;
  double eye[3] = {3, 0, 0}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1}, o[3], c[3];
  assert_true(sv_pose_look_at(&p, eye, at, up));
  sv_pose_apply(o, &p, at);
  assert_true(fabs(o[0]) < 1e-15 && fabs(o[1]) < 1e-15 && fabs(o[2] - 3) < 1e-15); // straight ahead
  double above[3] = {0, 0, 1};
  sv_pose_apply(o, &p, above);
  assert_true(o[1] < -0.9); // world up is image up, -y
  sv_pose_centre(c, &p);
  assert_true(fabs(c[0] - 3) < 1e-15);
  assert_false(sv_pose_look_at(&p, eye, eye, up));
  double a1[3] = {1, 0, 0}, a2[3] = {1, 1e-9, 0};
  assert_true(rel(sv_angle_between(a1, a2), 1e-9) < 1e-12); // acos would say 0
}

TEST(test_rig) {
  static _Alignas(64) uint8_t block[1 << 16];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_rig rig;
  double point[3] = {0, 0, 4};
  assert_int_equal(sv_rig_init(&rig, 0, &a), SV_E_ARG);
  assert_int_equal(sv_rig_init(&rig, 2, &a), SV_OK);
  rig.n_sub_views = 1;
  rig.sub_views[0].cam_from_rig = rig.sub_views[1].cam_from_rig = sv_pose_identity();
  assert_true(sv_rig_angular_baseline_rad(&rig, point) == 0);
  rig.n_sub_views = 2;
  rig.sub_views[0].cam_from_rig.t[0] = 0.5; // centres at x = -0.5 and +0.5
  rig.sub_views[1].cam_from_rig.t[0] = -0.5;
  assert_true(fabs(sv_rig_angular_baseline_rad(&rig, point) - 2 * atan(0.125)) < 1e-14);
  sv_pose id = sv_pose_identity();
  sv_view v = sv_view_make(641, 480, (const double[]){500, 510, 320, 240}, &id), s = sv_view_scaled(&v, 4);
  assert_int_equal(s.width_px, 160);
  assert_true(s.fx == 125.0f && s.cy == 60.0f);
  s = sv_view_scaled(&v, 1000);
  assert_int_equal(s.height_px, 1);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_status), cmocka_unit_test(test_arena),     cmocka_unit_test(test_ring),
      cmocka_unit_test(test_text),   cmocka_unit_test(test_functions), cmocka_unit_test(test_random),
      cmocka_unit_test(test_poses),  cmocka_unit_test(test_rig),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
