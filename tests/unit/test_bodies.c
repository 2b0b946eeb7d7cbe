// SPDX-License-Identifier: Apache-2.0
// Poses of rigid bodies at knots, between them and behind them.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/deform/bodies.h"
#include "tests/common/test.h"

static _Alignas(64) unsigned char block[1 << 20];
static sv_bodies b;

static void start(int cap_knots) {
  sv_arena a = sv_arena_make(block, sizeof block);
  assert_int_equal(sv_bodies_init(&b, 32, cap_knots, true, &a), SV_OK);
  sv_bodies_reset(&b, 32);
}

// A turn about an axis by rad.
static void turn(float rad, float q[4]) {
  const float axis[3] = {0.6f, 0.0f, 0.8f};
  q[0] = cosf(0.5f * rad);
  for (int k = 0; k < 3; k++) q[1 + k] = axis[k] * sinf(0.5f * rad);
}

static float angle_between(const float p[4], const float q[4]) {
  float dot = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
  return 2 * acosf(fminf(fabsf(dot), 1.0f));
}

// Body 1 turns uniformly by 2 rad and goes along a parabola.
static sv_rigid truth(float t) {
  sv_rigid m = {.d = {1.0f - 2 * t, 3 * t * t - t, 0.5f}};
  turn(2.0f * t, m.q);
  return m;
}

// as they come in, unevenly
static const float times[] = {0.5f, 0.4f, 0.0f, 0.7f, 0.15f, 1.0f, 0.8f, 0.3f};

static void fill(int n) {
  for (int i = 0; i < n; i++) (void)sv_bodies_add_knot(&b, times[i]);
  b.n = 2;
  for (int i = 0; i < n; i++) {
    sv_rigid *m = sv_bodies_knot(&b, 1, i);
    *m = truth(b.time[i]);
    for (int k = 0; k < 4 && i % 2; k++) m->q[k] = -m->q[k]; // the same turn
  }
}

static void assert_pose_near(const sv_rigid *is, const sv_rigid *expected, float most_d, float most_rad) {
  for (int k = 0; k < 3; k++) assert_true(fabsf(is->d[k] - expected->d[k]) < most_d);
  assert_true(angle_between(is->q, expected->q) < most_rad);
  float len = 0;
  for (int k = 0; k < 4; k++) len += is->q[k] * is->q[k];
  assert_true(fabsf(len - 1) < 1e-5f);
}

TEST(test_between) {
  start(8);
  fill(8);
  for (int i = 0; i + 1 < b.n_knots; i++) assert_true(b.time[i] < b.time[i + 1]);
  for (int s = 0; s <= 100; s++) {
    sv_rigid out[SV_CAP_BODIES], expected = truth(0.01f * (float)s);
    sv_bodies_at(&b, 0.01f * (float)s, out);
    assert_pose_near(&out[1], &expected, 1e-5f, 2e-3f);
    assert_pose_near(&out[0], &SV_RIGID_IDENTITY, 1e-9f, 1e-9f);
    assert_pose_near(&out[2], &SV_RIGID_IDENTITY, 1e-9f, 1e-9f);
  }
  for (int i = 0; i < b.n_knots; i++) { // the very knots
    sv_rigid out[SV_CAP_BODIES];
    sv_bodies_at(&b, b.time[i], out);
    assert_memory_equal(&out[1], sv_bodies_knot(&b, 1, i), sizeof *out);
  }
  for (int i = 0; i < 2; i++) { // outside they rest
    sv_rigid out[SV_CAP_BODIES];
    sv_bodies_at(&b, i ? 3.0f : -1.0f, out);
    assert_memory_equal(&out[1], sv_bodies_knot(&b, 1, i ? 7 : 0), sizeof *out);
  }
}

// A fast swing between knots of which every fourth time is missing; and what a knot should be as
// those beside it have it.
TEST(test_swing) {
  start(32);
  for (int i = 0; i < 25; i++)
    if (i % 4 != 2) (void)sv_bodies_add_knot(&b, (float)i / 24);
  b.n = 2;
  for (int i = 0; i < b.n_knots; i++)
    *sv_bodies_knot(&b, 1, i) = (sv_rigid){.q = {1, 0, 0, 0}, .d = {sinf(24 * 0.45f * b.time[i]), 0, 0}};
  for (int i = 6; i < 22; i += 4) {
    sv_rigid out[SV_CAP_BODIES];
    sv_bodies_at(&b, (float)i / 24, out);
    assert_true(fabsf(out[1].d[0] - sinf(0.45f * (float)i)) < 1e-3f);
  }
  sv_rigid m;
  assert_false(sv_bodies_among(&b, 1, 0, &m) || sv_bodies_among(&b, 1, b.n_knots - 1, &m));
  for (int i = 3; i < b.n_knots - 3; i++) {
    sv_rigid *knot = sv_bodies_knot(&b, 1, i), was = *knot;
    knot->d[0] = 7; // has no say
    assert_true(sv_bodies_among(&b, 1, i, &m) && fabsf(m.d[0] - was.d[0]) < 5e-3f);
    *knot = was;
  }
}

// Knots that lie very unevenly: no swing between them.
TEST(test_uneven) {
  static const float at[] = {0, 0.01f, 0.02f, 0.9f, 0.91f, 0.92f};
  start(8);
  for (int i = 0; i < 6; i++) (void)sv_bodies_add_knot(&b, at[i]);
  b.n = 2;
  for (int i = 0; i < 6; i++)
    *sv_bodies_knot(&b, 1, i) = (sv_rigid){.q = {1, 0, 0, 0}, .d = {i % 2 ? 0.01f : -0.01f, 0, 0}};
  for (int s = 0; s <= 92; s++) {
    sv_rigid out[SV_CAP_BODIES];
    sv_bodies_at(&b, 0.01f * (float)s, out);
    assert_true(fabsf(out[1].d[0]) < 0.03f);
  }
}

TEST(test_few_knots) {
  sv_rigid out[SV_CAP_BODIES];
  start(2);
  b.n = 2;
  sv_bodies_at(&b, 0.3f, out);
  assert_pose_near(&out[1], &SV_RIGID_IDENTITY, 1e-9f, 1e-9f);
  b.n = 1;
  fill(1);
  sv_bodies_at(&b, 0.9f, out);
  assert_memory_equal(&out[1], sv_bodies_knot(&b, 1, 0), sizeof *out);
  b.n = 1;
  fill(2);
  sv_bodies_at(&b, 0.45f, out); // a line
  const sv_rigid a = truth(0.4f), c = truth(0.5f);
  for (int k = 0; k < 3; k++) assert_true(fabsf(out[1].d[k] - 0.5f * (a.d[k] + c.d[k])) < 1e-6f);
  assert_int_equal(sv_bodies_add_knot(&b, 0.5f), sv_bodies_find_knot(&b, 0.5f));
  assert_int_equal(sv_bodies_add_knot(&b, 0.6f), -1); // no room
}

// A time that comes in: all go on as they went, in turn and place; what was there stays.
TEST(test_new_knot) {
  const float at[] = {0.4f, 0.5f, 0.7f, 0.3f, 0.45f};
  start(5);
  b.n = 2;
  for (int i = 0; i < 2; i++) {
    int knot = sv_bodies_add_knot(&b, at[i]);
    *sv_bodies_knot(&b, 1, knot) = (sv_rigid){.d = {at[i], 0, -at[i]}};
    turn(3 * at[i], sv_bodies_knot(&b, 1, knot)->q);
    b.adam[b.cap_knots + knot].n_steps = (uint32_t)(100 * at[i]);
  }
  for (int i = 2; i < 5; i++) {
    int knot = sv_bodies_add_knot(&b, at[i]);
    sv_rigid expected = {.d = {at[i], 0, -at[i]}};
    turn(3 * at[i], expected.q);
    assert_pose_near(sv_bodies_knot(&b, 1, knot), &expected, 1e-5f, 2e-3f);
    assert_int_equal(b.adam[b.cap_knots + knot].n_steps, 0);
  }
  assert_int_equal(b.n_knots, 5);
  for (int i = 0; i < 2; i++)
    assert_int_equal(b.adam[b.cap_knots + sv_bodies_find_knot(&b, at[i])].n_steps, (int)(100 * at[i]));
  assert_pose_near(sv_bodies_knot(&b, 2, 4), &SV_RIGID_IDENTITY, 1e-9f, 1e-9f);
}

TEST(test_motions) {
  const float c[3] = {0.3f, -1, 2}, x[3] = {1, 2, -0.5f};
  sv_rigid m = truth(0.7f), n = truth(0.2f);
  float y[3], back[3], at[3], z[3], direct[3];
  sv_rigid_apply(&m, c, x, y);
  sv_rigid_undo(&m, c, y, back);
  for (int k = 0; k < 3; k++) assert_true(fabsf(back[k] - x[k]) < 1e-5f);
  for (int k = 0; k < 3; k++) at[k] = c[k] + m.d[k];
  sv_rigid_apply(&n, at, y, z); // about where the centre went
  const sv_rigid both = sv_rigid_then(&m, &n);
  sv_rigid_apply(&both, c, x, direct);
  for (int k = 0; k < 3; k++) assert_true(fabsf(direct[k] - z[k]) < 1e-5f);
}

TEST(test_reach) {
  start(3);
  b.n = 2;
  b.radius[1] = 0.5f;
  (void)sv_bodies_add_knot(&b, 0.2f);
  (void)sv_bodies_add_knot(&b, 0.9f);
  assert_true(sv_bodies_reach(&b, 1) == 0.0f);
  sv_bodies_knot(&b, 1, 1)->d[1] = -3;
  assert_true(fabsf(sv_bodies_reach(&b, 1) - 3) < 1e-6f);
  turn(0.2f, sv_bodies_knot(&b, 1, 0)->q);
  sv_bodies_knot(&b, 1, 1)->d[1] = 0;
  assert_true(fabsf(sv_bodies_reach(&b, 1) - 0.1f) < 1e-3f);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_between),  cmocka_unit_test(test_swing),
                                     cmocka_unit_test(test_uneven),   cmocka_unit_test(test_few_knots),
                                     cmocka_unit_test(test_new_knot), cmocka_unit_test(test_motions),
                                     cmocka_unit_test(test_reach)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
