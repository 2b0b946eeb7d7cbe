// SPDX-License-Identifier: Apache-2.0
// run --mesh of a rig whose poses nobody tells: lengths are meters, the mesh lies on the surfaces
// of the simulated scene, the model is the one without it. Fisheyes inside a hall; what cannot be
// is refused.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "tests/common/test.h"

#define N_EXPOSURES 40
#define SPEC        "textured,rig=stereo,size=240x180,exposures=40,path=handheld,poses=unknown"
#define FISHEYES    "hall,rig=stereo,size=240x180,exposures=40,path=handheld,lens=kb4:185"
#define RUN                                                                                                  \
  "$SV_EMULATE $SV_BIN/subview run --exposures 40 --steps 600 --gaussians 8000 --json --quiet --overwrite "
#define W         240
#define H         180
#define N_VIEWS   4
#define CAP_BYTES (32 << 20)

static uint8_t file[CAP_BYTES], memory[8 << 20];
static float depth[H * W];

static void run(const char *spec, const char *more, const char *folder, char digest[20]) {
  char command[600];
  static char out[8192];
  snprintf(command, sizeof command, RUN "--source sim:%s %s --out %s 2>&1", spec, more, temp_path(folder));
  if (shell_read(out, sizeof out, command)) fail_msg("%s\n%s", command, out);
  const char *d = strstr(out, "\"digest\": \"");
  assert_non_null(d);
  memcpy(digest, d + 11, 16);
  digest[16] = 0;
}

static size_t read_whole(const char *path) {
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

static sv_pose pose[N_EXPOSURES]; // rig_from_world, as the run found them

static void read_poses(const char *folder) {
  char path[300];
  snprintf(path, sizeof path, "%s/poses.json", temp_path(folder));
  (void)read_whole(path);
  assert_contains((const char *)file, "\"scale_sigma\"");
  const char *p = (const char *)file;
  for (int e = 0; e < N_EXPOSURES; e++) {
    double v[7];
    char *at;
    p = strstr(p, "\"rig_from_world\": [");
    assert_non_null(p);
    p += 19;
    for (int k = 0; k < 7; k++) {
      v[k] = strtod(p, &at);
      p = at + 1;
    }
    sv_quat_to_mat(pose[e].r, v);
    memcpy(pose[e].t, v + 4, sizeof pose[e].t);
  }
}

// Mean distance between the rig's places, as the run found them, over the true one.
static double scale_of(const sv_sim *sim) {
  double sum[2] = {0};
  for (int a = 0; a < N_EXPOSURES; a++)
    for (int b = 0; b < a; b++) {
      sv_pose truth[2];
      double c[4][3];
      sv_sim_rig_pose(sim, sv_sim_slot_ns(sim, a), &truth[0]);
      sv_sim_rig_pose(sim, sv_sim_slot_ns(sim, b), &truth[1]);
      sv_pose_centre(c[0], &truth[0]);
      sv_pose_centre(c[1], &truth[1]);
      sv_pose_centre(c[2], &pose[a]);
      sv_pose_centre(c[3], &pose[b]);
      for (int k = 0; k < 2; k++) {
        sv_sub3(c[2 * k], c[2 * k], c[2 * k + 1]);
        sum[k] += sv_norm3(c[2 * k]);
      }
    }
  return sum[1] / sum[0];
}

// Share of the vertices that views of the scene see within 1.2 % of its surface's distance; those
// that something hides, or that lie at an edge, do not count. mean: of the differences.
static double near_share(sv_sim *sim, const uint8_t *row, long n, double *mean) {
  long n_seen = 0, n_near = 0;
  *mean = 0;
  for (int i = 0; i < N_VIEWS; i++) {
    const int e = i * N_EXPOSURES / N_VIEWS;
    const sv_pose cam = sv_pose_mul(&sim->rig.sub_views[0].cam_from_rig, &pose[e]);
    sv_view v;
    double t;
    sv_sim_view(sim, e, 0, &v, &t);
    sv_sim_render(sim, &v, t, NULL, depth);
    for (long k = 0; k < n; k++) {
      float x[3], c[3], uv[2], z;
      memcpy(x, row + 15 * k, sizeof x);
      for (int j = 0; j < 3; j++)
        c[j] = (float)(cam.r[3 * j] * (double)x[0] + cam.r[3 * j + 1] * (double)x[1] +
                       cam.r[3 * j + 2] * (double)x[2] + cam.t[j]);
      if (!sv_view_project(&v, c, uv, &z) || uv[0] < 0 || uv[1] < 0 || uv[0] >= W || uv[1] >= H) continue;
      const float d = depth[(int)uv[1] * W + (int)uv[0]];
      if (!(d > 0) || z > 1.03f * d || is_edge((int)uv[0], (int)uv[1])) continue;
      n_seen++;
      n_near += fabsf(z - d) < 0.012f * d;
      *mean += (double)fabsf(z - d) / (double)d;
    }
  }
  assert_true(n_seen > 1000);
  *mean /= (double)n_seen;
  return (double)n_near / (double)n_seen;
}

static void open_sim(sv_sim *sim, const char *spec) {
  sv_sim_config cfg;
  sv_err err;
  sv_arena a = sv_arena_make(memory, sizeof memory);
  assert_ok(sv_sim_parse(&cfg, spec, &err), &err);
  assert_ok(sv_sim_init(sim, &cfg, &a, &err), &err);
}

// near_share of the mesh in a folder.
static double share_in(const char *folder, sv_sim *sim, double *mean) {
  char path[300];
  snprintf(path, sizeof path, "%s/mesh.ply", temp_path(folder));
  const size_t bytes = read_whole(path);
  const long n = count_of("element vertex "), n_faces = count_of("element face ");
  const uint8_t *row = (const uint8_t *)strstr((const char *)file, "end_header\n") + 11;
  assert_int_equal(bytes, (size_t)(row - file) + (size_t)n * 15 + (size_t)n_faces * 13);
  const double share = near_share(sim, row, n, mean);
  print_message("%ld vertices, %ld triangles: mean %.2f %%, %.1f %% within 1.2 %% of the distance\n", n,
                n_faces, 100 * *mean, 100 * share);
  return share;
}

TEST(the_mesh_lies_on_the_surface) {
  char with[20], without[20];
  sv_sim sim;
  double mean;
  run(SPEC, "--mesh", "with", with);
  run(SPEC, "", "without", without);
  assert_string_equal(with, without);
  open_sim(&sim, SPEC);
  read_poses("with");
  const double scale = scale_of(&sim), share = share_in("with", &sim, &mean);
  print_message("scale %+.2f %%\n", 100 * (scale - 1));
  assert_true(fabs(scale - 1) < 0.003);
  assert_true(mean < 0.006 && share > 0.9);
}

TEST(fisheyes_are_fused_over_their_whole_field) {
  char digest[20];
  sv_sim sim;
  double mean;
  run(FISHEYES, "--mesh", "fisheyes", digest);
  open_sim(&sim, FISHEYES);
  for (int e = 0; e < N_EXPOSURES; e++) sv_sim_rig_pose(&sim, sv_sim_slot_ns(&sim, e), &pose[e]);
  const double share = share_in("fisheyes", &sim, &mean);
  assert_true(mean < 0.01 && share > 0.75);
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
                                     cmocka_unit_test(fisheyes_are_fused_over_their_whole_field),
                                     cmocka_unit_test(what_cannot_be_is_refused),
                                     cmocka_unit_test(the_plan_holds_it)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
