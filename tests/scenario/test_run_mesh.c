// SPDX-License-Identifier: Apache-2.0
// run --mesh: the mesh lies on the surfaces of the simulated scene, the model is the one without
// it, and what cannot be is refused.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "tests/common/test.h"

#define SPEC "textured,rig=stereo,size=240x180,exposures=16"
#define RUN                                                                                                  \
  "$SV_EMULATE $SV_BIN/subview run --exposures 16 --steps 600 --gaussians 8000 --json --quiet --overwrite "
#define W         240
#define H         180
#define N_VIEWS   4
#define CAP_BYTES (32 << 20)

static uint8_t file[CAP_BYTES], memory[8 << 20];
static float depth[H * W];

static void run(const char *more, const char *folder, char digest[20]) {
  char command[600];
  static char out[8192];
  snprintf(command, sizeof command, RUN "--source sim:" SPEC " %s --out %s 2>&1", more, temp_path(folder));
  if (shell_read(out, sizeof out, command)) fail_msg("%s\n%s", command, out);
  const char *d = strstr(out, "\"digest\": \"");
  assert_non_null(d);
  memcpy(digest, d + 11, 16);
  digest[16] = 0;
}

static size_t read_mesh(const char *path) {
  FILE *f = fopen(path, "rb");
  assert_non_null(f);
  const size_t n = fread(file, 1, CAP_BYTES - 1, f);
  (void)fclose(f);
  file[n] = 0;
  return n;
}

static long count_of(const char *word) {
  const char *p = strstr((const char *)file, word);
  assert_non_null(p);
  return strtol(p + strlen(word), NULL, 10);
}

// A pixel with a neighbor at another distance: which of the two a vertex is on, nobody can tell.
static bool is_edge(int x, int y) {
  const float d = depth[y * W + x];
  for (int v = y - 1; v <= y + 1; v++)
    for (int u = x - 1; u <= x + 1; u++)
      if (u < 0 || v < 0 || u >= W || v >= H || !(fabsf(depth[v * W + u] - d) < 0.05f * d)) return true;
  return false;
}

// Share of the vertices that views of the scene see within 1.2 % of its surface's distance; those
// that something hides, or that lie at an edge, do not count.
static double near_share(const uint8_t *row, long n) {
  sv_sim sim;
  sv_sim_config cfg;
  sv_err err;
  sv_arena a = sv_arena_make(memory, sizeof memory);
  long n_seen = 0, n_near = 0;
  assert_ok(sv_sim_parse(&cfg, SPEC, &err), &err);
  assert_ok(sv_sim_init(&sim, &cfg, &a, &err), &err);
  for (int i = 0; i < N_VIEWS; i++) {
    sv_view v;
    double t;
    sv_sim_view(&sim, 4 * i, 0, &v, &t);
    sv_sim_render(&sim, &v, t, NULL, depth);
    for (long k = 0; k < n; k++) {
      float x[3], cam[3], uv[2], z;
      memcpy(x, row + 15 * k, sizeof x);
      for (int j = 0; j < 3; j++)
        cam[j] = v.r[3 * j] * x[0] + v.r[3 * j + 1] * x[1] + v.r[3 * j + 2] * x[2] + v.t[j];
      if (!sv_view_project(&v, cam, uv, &z) || uv[0] < 0 || uv[1] < 0 || uv[0] >= W || uv[1] >= H) continue;
      const float d = depth[(int)uv[1] * W + (int)uv[0]];
      if (!(d > 0) || z > 1.03f * d || is_edge((int)uv[0], (int)uv[1])) continue;
      n_seen++;
      n_near += fabsf(z - d) < 0.012f * d;
    }
  }
  assert_true(n_seen > 1000);
  return (double)n_near / (double)n_seen;
}

TEST(the_mesh_lies_on_the_surface) {
  char with[20], without[20], path[300];
  run("--mesh", "with", with);
  run("", "without", without);
  assert_string_equal(with, without);
  snprintf(path, sizeof path, "%s/mesh.ply", temp_path("with"));
  const size_t bytes = read_mesh(path);
  const long n = count_of("element vertex "), n_faces = count_of("element face ");
  const uint8_t *row = (const uint8_t *)strstr((const char *)file, "end_header\n") + 11;
  assert_int_equal(bytes, (size_t)(row - file) + (size_t)n * 15 + (size_t)n_faces * 13);
  const double share = near_share(row, n);
  print_message("%ld vertices, %ld triangles: %.1f %% within 1.2 %% of the distance\n", n, n_faces,
                100 * share);
  assert_true(share > 0.87);
}

TEST(what_cannot_be_is_refused) {
  char command[600], out[4096];
  snprintf(command, sizeof command, RUN "--source sim:moving --scene dynamic --mesh --out %s 2>&1",
           temp_path("moving"));
  assert_true(shell_read(out, sizeof out, command) > 0);
  assert_contains(out, "--mesh: not with --scene dynamic");
  snprintf(command, sizeof command, RUN "--source sim:textured,rig=multiplexed --mesh --out %s 2>&1",
           temp_path("lenses"));
  assert_true(shell_read(out, sizeof out, command) > 0);
  assert_contains(out, "--mesh: not with multiplexed rigs");
}

TEST(the_plan_holds_it) {
  char out[8192];
  assert_int_equal(shell_read(out, sizeof out, "$SV_EMULATE $SV_BIN/subview plan --mesh 2>&1"), 0);
  assert_contains(out, "\nmesh ");
  assert_int_equal(shell_read(out, sizeof out, "$SV_EMULATE $SV_BIN/subview plan 2>&1"), 0);
  assert_not_contains(out, "\nmesh ");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(the_mesh_lies_on_the_surface),
                                     cmocka_unit_test(what_cannot_be_is_refused),
                                     cmocka_unit_test(the_plan_holds_it)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
