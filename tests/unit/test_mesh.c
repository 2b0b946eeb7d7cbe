// SPDX-License-Identifier: Apache-2.0
// The mesh of a sphere from depth images about it: where it is, which way it faces, that it is
// closed, the same for any number of threads; a sphere about fisheyes, behind them, too; a floater
// is dropped, and full pools are told.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "calib/fisheye.h"
#include "platform/linux/linux.h"
#include "src/mesh/mesh.h"
#include "tests/common/test.h"

#define W      96
#define H      80
#define N      14
#define RADIUS 0.7f
#define BYTES  (64 << 20)

static float depth[H * W], r[H * W], g[H * W], b[H * W];
static const sv_planes rgb = {.c = {r, g, b}, .stride = W};
static uint8_t memory[2][BYTES];

// A camera at distance 3 that looks at the origin from direction i of N on a spiral.
static sv_view look(int i) {
  sv_pose pose;
  const double z = -1 + (2 * i + 1.0) / N, s = sqrt(1 - z * z), a = 2.4 * i, c[3] = {0, 0, 0},
               up[3] = {0, 0, 1}, eye[3] = {3 * s * cos(a), 3 * s * sin(a), 3 * z};
  assert_true(sv_pose_look_at(&pose, eye, c, up));
  return sv_view_make(W, H, (const double[]){110, 110, W / 2.0, H / 2.0}, &pose);
}

static double volume_of(const sv_mesh *m) {
  double volume = 0;
  for (int t = 0; t < m->n_triangles; t++) {
    const float *p = m->vertex[m->triangle[t].v[0]].x, *q = m->vertex[m->triangle[t].v[1]].x,
                *s = m->vertex[m->triangle[t].v[2]].x;
    volume += (double)(p[0] * (q[1] * s[2] - q[2] * s[1]) + p[1] * (q[2] * s[0] - q[0] * s[2]) +
                       p[2] * (q[0] * s[1] - q[1] * s[0])) /
              6;
  }
  return volume;
}

// Depth of a sphere about p, where it is nearer than what was drawn before.
static void draw(const sv_view *v, const float p[3], float radius) {
  float c[3];
  for (int k = 0; k < 3; k++)
    c[k] = v->r[3 * k] * p[0] + v->r[3 * k + 1] * p[1] + v->r[3 * k + 2] * p[2] + v->t[k];
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const float d[3] = {((float)x + 0.5f - v->cx) / v->fx, ((float)y + 0.5f - v->cy) / v->fy, 1};
      const float dd = d[0] * d[0] + d[1] * d[1] + 1, dc = d[0] * c[0] + d[1] * c[1] + c[2],
                  cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2] - radius * radius, q = dc * dc - dd * cc;
      const float z = q > 0 ? (dc - sqrtf(q)) / dd : 0;
      float *o = &depth[y * W + x];
      if (z > 0 && (*o == 0 || z < *o)) *o = z;
    }
}

static sv_mesh_cfg cfg(void) {
  return (sv_mesh_cfg){
      .radius = 1.5f, .voxel = 0.03f, .cap_blocks = 4000, .cap_vertices = 60000, .cap_triangles = 120000};
}

static void make(sv_mesh *m, int i_memory, const sv_mesh_cfg *c, const sv_pool *pool, bool has_floater) {
  static const float origin[3] = {0, 0, 0}, aside[3] = {0.2f, 0.1f, 1.05f};
  sv_arena a = sv_arena_make(memory[i_memory], BYTES);
  assert_int_equal(sv_mesh_init(m, c, &a), SV_OK);
  for (int i = 0; i < N; i++) {
    const sv_view v = look(i);
    memset(depth, 0, sizeof depth);
    draw(&v, origin, RADIUS);
    if (has_floater) draw(&v, aside, 0.12f);
    sv_mesh_fuse(m, &(sv_mesh_image){&v, depth, &rgb}, pool);
  }
}

static float length3(const float *x) { return sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

TEST(test_sphere) {
  sv_mesh m;
  const sv_mesh_cfg c = cfg();
  const sv_pool serial = sv_pool_serial();
  for (int i = 0; i < W * H; i++) {
    r[i] = 1;
    g[i] = 0.5f;
    b[i] = 0;
  }
  make(&m, 0, &c, &serial, false);
  assert_false(m.is_full);
  assert_int_equal(sv_mesh_extract(&m, 1), SV_OK);
  assert_true(m.n_vertices > 3000 && m.n_triangles > 6000);
  double sum = 0, worst = 0;
  for (int i = 0; i < m.n_vertices; i++) {
    const double e = fabs((double)(length3(m.vertex[i].x) - RADIUS));
    sum += e;
    worst = e > worst ? e : worst;
    assert_true(m.vertex[i].rgb[0] == 255 && m.vertex[i].rgb[1] == 128 && m.vertex[i].rgb[2] == 0);
  }
  print_message("distance from the sphere: mean %.2f %%, largest %.2f %% of its radius\n",
                100 * sum / m.n_vertices / (double)RADIUS, 100 * worst / (double)RADIUS);
  assert_true(sum / m.n_vertices < 0.004 * (double)RADIUS && worst < 0.04 * (double)RADIUS);
  // It faces outward, so the volume is positive, and that of the sphere, so it is closed.
  const double expected = 4.0 / 3 * 3.14159265 * pow((double)RADIUS, 3);
  assert_true(fabs(volume_of(&m) - expected) < 0.02 * expected);
}

// Fisheyes of 200 degrees in a sphere, back to back: each sees a little more than half of it.
TEST(test_fisheyes) {
  sv_mesh m;
  const sv_mesh_cfg c = cfg();
  const sv_pool serial = sv_pool_serial();
  const sv_camera_model lens = {
      .kind = SV_MODEL_KB4, .width_px = W, .height_px = H, .p = {22, 22, W / 2.0, H / 2.0, 0.02, -0.004}};
  sv_fisheye fisheye;
  assert_true(sv_fisheye_make(&fisheye, &lens));
  sv_arena a = sv_arena_make(memory[0], BYTES);
  assert_int_equal(sv_mesh_init(&m, &c, &a), SV_OK);
  for (int i = 0; i < N; i++) {
    sv_pose pose;
    const double turn = 2.4 * i, eye[3] = {0.1 * cos(turn), 0.1 * sin(turn), 0.02 * (i - N / 2)},
                 to[3] = {3 * cos(turn), 3 * sin(turn), 0.4 * (i - N / 2)}, up[3] = {0, 0, 1};
    assert_true(sv_pose_look_at(&pose, eye, to, up));
    sv_view v = sv_view_make(W, H, lens.p, &pose);
    v.fisheye = &fisheye;
    float centre[3];
    sv_view_centre(centre, &v);
    memset(depth, 0, sizeof depth);
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++) {
        float ray[3], along = 0;
        if (!sv_view_ray(&v, (float)x + 0.5f, (float)y + 0.5f, ray)) continue;
        for (int k = 0; k < 3; k++) along += ray[k] * v.t[k]; // minus the center along the ray
        const float off = length3(centre);
        depth[y * W + x] = along + sqrtf(along * along - off * off + RADIUS * RADIUS);
      }
    sv_mesh_fuse(&m, &(sv_mesh_image){&v, depth, &rgb}, &serial);
  }
  assert_int_equal(sv_mesh_extract(&m, 1), SV_OK);
  double sum = 0, worst = 0;
  for (int i = 0; i < m.n_vertices; i++) {
    const double e = fabs((double)(length3(m.vertex[i].x) - RADIUS));
    sum += e;
    worst = fmax(worst, e);
  }
  print_message("distance from the sphere: mean %.2f %%, largest %.2f %% of its radius\n",
                100 * sum / m.n_vertices / (double)RADIUS, 100 * worst / (double)RADIUS);
  assert_true(sum / m.n_vertices < 0.004 * (double)RADIUS && worst < 0.04 * (double)RADIUS);
  // It faces inward, and is closed.
  const double expected = -4.0 / 3 * 3.14159265 * pow((double)RADIUS, 3);
  print_message("volume %.4f, expected %.4f\n", volume_of(&m), expected);
  assert_true(fabs(volume_of(&m) / expected - 1) < 0.02);
}

TEST(test_threads) {
  sv_mesh m[2];
  sv_linux_pool threads;
  sv_err err;
  const sv_mesh_cfg c = cfg();
  const sv_pool serial = sv_pool_serial();
  assert_int_equal(sv_linux_pool_start(&threads, 3, 0, &err), SV_OK);
  const sv_pool pool = sv_linux_pool_port(&threads);
  make(&m[0], 0, &c, &serial, true);
  make(&m[1], 1, &c, &pool, true);
  for (int i = 0; i < 2; i++) assert_int_equal(sv_mesh_extract(&m[i], 2), SV_OK);
  assert_int_equal(m[0].n_vertices, m[1].n_vertices);
  assert_int_equal(m[0].n_triangles, m[1].n_triangles);
  assert_memory_equal(m[0].vertex, m[1].vertex, (size_t)m[0].n_vertices * sizeof *m[0].vertex);
  assert_memory_equal(m[0].triangle, m[1].triangle, (size_t)m[0].n_triangles * sizeof *m[0].triangle);
  sv_linux_pool_stop(&threads);
}

TEST(test_floater) {
  sv_mesh m;
  const sv_mesh_cfg c = cfg();
  const sv_pool serial = sv_pool_serial();
  int n_far = 0;
  make(&m, 0, &c, &serial, true);
  assert_int_equal(sv_mesh_extract(&m, 1), SV_OK);
  for (int i = 0; i < m.n_vertices; i++) n_far += length3(m.vertex[i].x) > 1.2f * RADIUS;
  assert_true(n_far > 50);
  sv_mesh_drop_small(&m, 0.2f);
  for (int i = 0; i < m.n_vertices; i++) assert_true(length3(m.vertex[i].x) < 1.2f * RADIUS);
  for (int t = 0; t < m.n_triangles; t++)
    for (int k = 0; k < 3; k++) assert_true(m.triangle[t].v[k] >= 0 && m.triangle[t].v[k] < m.n_vertices);
}

TEST(test_decimated) {
  sv_mesh m;
  const sv_mesh_cfg c = cfg();
  const sv_pool serial = sv_pool_serial();
  make(&m, 0, &c, &serial, false);
  assert_int_equal(sv_mesh_extract(&m, 1), SV_OK);
  const int n_before = m.n_triangles;
  assert_int_equal(sv_mesh_decimate(&m, 0), SV_E_ARG);
  assert_int_equal(sv_mesh_decimate(&m, n_before), SV_OK); // nothing to do
  assert_int_equal(m.n_triangles, n_before);
  const double volume = volume_of(&m);
  assert_int_equal(sv_mesh_decimate(&m, 1000), SV_OK);
  print_message("%d triangles become %d, %d vertices\n", n_before, m.n_triangles, m.n_vertices);
  assert_in_range(m.n_triangles, 700, 1000);
  double sum = 0;
  for (int i = 0; i < m.n_vertices; i++) {
    sum += fabs((double)(length3(m.vertex[i].x) - RADIUS)) / (double)RADIUS;
    assert_true(m.vertex[i].rgb[0] == 255 && m.vertex[i].rgb[1] == 128 && m.vertex[i].rgb[2] == 0);
  }
  assert_true(sum / m.n_vertices < 0.01);
  assert_true(fabs(volume_of(&m) - volume) < 0.04 * volume);
  for (int t = 0; t < m.n_triangles; t++)
    for (int k = 0; k < 3; k++) assert_in_range(m.triangle[t].v[k], 0, m.n_vertices - 1);
}

TEST(test_pools) {
  sv_mesh m;
  sv_mesh_cfg c = cfg();
  const sv_pool serial = sv_pool_serial();
  assert_true(sv_mesh_bytes(&c) < BYTES);
  c.cap_blocks = 20;
  make(&m, 0, &c, &serial, false);
  assert_true(m.is_full);
  c = cfg();
  c.cap_vertices = 100;
  make(&m, 0, &c, &serial, false);
  assert_int_equal(sv_mesh_extract(&m, 1), SV_E_FULL);
  c.voxel = 0;
  sv_arena a = sv_arena_make(memory[0], BYTES);
  assert_int_equal(sv_mesh_init(&m, &c, &a), SV_E_ARG);
  c.voxel = 0.03f;
  a = sv_arena_make(memory[0], 10000);
  assert_int_equal(sv_mesh_init(&m, &c, &a), SV_E_NOMEM);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_sphere),    cmocka_unit_test(test_fisheyes),
                                     cmocka_unit_test(test_threads),   cmocka_unit_test(test_floater),
                                     cmocka_unit_test(test_decimated), cmocka_unit_test(test_pools)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
