// SPDX-License-Identifier: Apache-2.0
// The simulator: pictures, depth, rigs, clocks, faults, the ledger of frames, and its option text.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "tests/common/test.h"

static uint8_t memory[48 << 20];
static sv_sim sim;
static sv_arena arena;

static void make(const char *spec) {
  sv_sim_config cfg;
  sv_err err = {0};
  if (sv_sim_parse(&cfg, spec, &err) < 0) fail_msg("%s: %s", spec, err.text);
  memset(memory, 0xa5, sizeof memory); // nothing may depend on cleared memory
  arena = sv_arena_make(memory, sizeof memory);
  if (sv_sim_init(&sim, &cfg, &arena, &err) < 0) fail_msg("%s: %s", spec, err.text);
}

static uint64_t hash_of(const void *data, size_t n) { // FNV-1a
  const uint8_t *p = data;
  uint64_t h = 0xcbf29ce484222325ull;
  for (size_t i = 0; i < n; i++) h = (h ^ p[i]) * 0x100000001b3ull;
  return h;
}

static uint8_t rgb[640 * 480 * 3], rgb_b[640 * 480 * 3];
static float depth[640 * 480], depth_b[640 * 480];

// The same digests hold on x86-64 and on aarch64. A change of a scene or of the renderer changes
// them: look at the pictures, then take the new ones.
TEST(test_same_bits) {
  static const struct {
    const char *spec;
    uint64_t rgb, depth;
  } golden[] = {
#include "tests/unit/test_sim_golden.inc"
  };
  bool is_same = true;
  for (size_t i = 0; i < sizeof golden / sizeof *golden; i++) {
    make(golden[i].spec);
    sv_view v;
    double t;
    sv_sim_view(&sim, 3, 0, &v, &t);
    sv_sim_render(&sim, &v, t, rgb, depth);
    size_t n = (size_t)v.width_px * (size_t)v.height_px;
    uint64_t a = hash_of(rgb, 3 * n), b = hash_of(depth, n * sizeof *depth);
    if (a != golden[i].rgb || b != golden[i].depth) {
      is_same = false;
      print_message("{\"%s\", 0x%016llxull, 0x%016llxull},\n", golden[i].spec, (unsigned long long)a,
                    (unsigned long long)b);
    }
  }
  assert_true(is_same);
}

TEST(test_rows_do_not_matter) {
  make("thin,rig=phone");
  sv_view v;
  double t;
  sv_sim_view(&sim, 1, 2, &v, &t);
  sv_sim_render(&sim, &v, t, rgb, depth);
  memset(rgb_b, 1, sizeof rgb_b);
  for (int y = 0, step = 1; y < v.height_px; y += step, step = step % 37 + 5)
    sv_sim_render_rows(&sim, sim.shot, y, sv_mini(y + step, v.height_px), rgb_b, depth_b);
  size_t n = (size_t)v.width_px * (size_t)v.height_px;
  assert_memory_equal(rgb, rgb_b, 3 * n);
  assert_memory_equal(depth, depth_b, n * sizeof *depth);
}

// A pixel's depth lifted to the world and seen from another camera must agree with that camera's
// depth where the surface is smooth and visible there. Returns the number compared, and the worst
// error.
static int compare_depth(const sv_view *a, const sv_view *b, double *median_m) {
  static float errors[640 * 480];
  int n = 0;
  for (int y = 0; y < a->height_px; y++)
    for (int x = 0; x < a->width_px; x++) {
      double z = (double)depth[y * a->width_px + x], p[3], q[3], w[3];
      if (z == 0) continue;
      p[0] = (x + 0.5 - (double)a->cx) / (double)a->fx * z - (double)a->t[0];
      p[1] = (y + 0.5 - (double)a->cy) / (double)a->fy * z - (double)a->t[1];
      p[2] = z - (double)a->t[2];
      for (int i = 0; i < 3; i++)
        w[i] = (double)a->r[i] * p[0] + (double)a->r[3 + i] * p[1] + (double)a->r[6 + i] * p[2];
      for (int i = 0; i < 3; i++)
        q[i] = (double)b->r[3 * i] * w[0] + (double)b->r[3 * i + 1] * w[1] + (double)b->r[3 * i + 2] * w[2] +
               (double)b->t[i];
      double u = (double)b->fx * q[0] / q[2] + (double)b->cx - 0.5,
             v = (double)b->fy * q[1] / q[2] + (double)b->cy - 0.5;
      int i = (int)floor(u), j = (int)floor(v);
      if (i < 0 || j < 0 || i + 1 >= b->width_px || j + 1 >= b->height_px) continue;
      const float *d = depth_b + j * b->width_px + i;
      float lo = sv_minf(sv_minf(d[0], d[1]), sv_minf(d[b->width_px], d[b->width_px + 1]));
      float hi = sv_maxf(sv_maxf(d[0], d[1]), sv_maxf(d[b->width_px], d[b->width_px + 1]));
      // an edge, or hidden
      if (lo == 0 || hi - lo > 0.04f || fabs(q[2] - (double)lo) > 0.1) continue;
      double fu = u - i, fv = v - j;
      double top = (double)d[0] * (1 - fu) + (double)d[1] * fu;
      double low = (double)d[b->width_px] * (1 - fu) + (double)d[b->width_px + 1] * fu;
      errors[n++] = (float)fabs(top * (1 - fv) + low * fv - q[2]);
    }
  int below = 0; // the median by bisection
  double lo = 0, hi = 0.2;
  for (int k = 0; k < 30; k++) {
    double mid = 0.5 * (lo + hi);
    below = 0;
    for (int i = 0; i < n; i++) below += (double)errors[i] < mid;
    if (2 * below < n) lo = mid;
    else hi = mid;
  }
  *median_m = hi;
  return n;
}

TEST(test_depth_agrees_between_views) {
  static const char *const scenes[] = {"textured", "thin", "occlusion", "moving", "room"};
  for (int i = 0; i < 5; i++) {
    make(scenes[i]);
    sv_view a, b;
    double t, median;
    sv_sim_view(&sim, 2, 0, &a, &t);
    sv_sim_render(&sim, &a, t, NULL, depth);
    sv_sim_view(&sim, 2, 1, &b, &t);
    sv_sim_render(&sim, &b, t, NULL, depth_b);
    int n = compare_depth(&a, &b, &median);
    assert_true(n > 4000);
    if (!(median < 2e-4)) fail_msg("%s: median depth error %g m over %d px", scenes[i], median, n);
  }
}

// One sphere has a depth that can be written down.
TEST(test_depth_is_exact) {
  make("textured,rig=mono");
  static const sv_sim_prim sphere = {.shape = SV_SIM_ELLIPSOID,
                                     .size_m = {0.5f, 0.5f, 0.5f},
                                     .i_motion = -1,
                                     .r = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                     .material = {.cell_m = 0.1f}};
  sim.scene->n_prims = 1;
  sim.scene->prims[0] = sphere;
  sv_view v;
  double t, worst = 0;
  sv_sim_view(&sim, 0, 0, &v, &t);
  sv_sim_render(&sim, &v, t, rgb, depth);
  for (int y = 0; y < v.height_px; y++)
    for (int x = 0; x < v.width_px; x++) {
      double d[3] = {(x + 0.5 - (double)v.cx) / (double)v.fx, (y + 0.5 - (double)v.cy) / (double)v.fy, 1};
      double a = sv_dot3(d, d), h = 16 - a * (16 - 0.25); // centre at (0, 0, 4)
      if (fabs(h) < 0.01) continue;                       // the very rim
      double z = h > 0 ? (4 - sqrt(h)) / a : 0;
      worst = fmax(worst, fabs(z - (double)depth[y * v.width_px + x]));
    }
  assert_true(worst < 5e-6);
}

// Sixteen samples and one shade a surface against the mean of 4 x 4 pixels of a larger picture.
// Plain surfaces: texture is filtered to the footprint on purpose and would hide the edges' error.
TEST(test_edges_are_antialiased) {
  make("occlusion,size=160x120");
  for (int i = 0; i < sim.scene->n_prims; i++) sim.scene->prims[i].material.cell_m = 1000;
  sv_view v, big;
  double t, sse = 0;
  sv_sim_view(&sim, 1, 0, &v, &t);
  sv_sim_render(&sim, &v, t, rgb, NULL);
  big = v;
  big.width_px *= 4;
  big.height_px *= 4;
  big.fx *= 4;
  big.fy *= 4;
  big.cx *= 4;
  big.cy *= 4;
  sv_sim_render(&sim, &big, t, rgb_b, NULL);
  for (int y = 0; y < v.height_px; y++)
    for (int x = 0; x < v.width_px; x++)
      for (int k = 0; k < 3; k++) {
        double sum = 0;
        for (int i = 0; i < 16; i++) {
          double s = rgb_b[((4 * y + i / 4) * big.width_px + 4 * x + i % 4) * 3 + k] / 255.0;
          sum += s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4);
        }
        double lin = sum / 16, enc = lin <= 0.0031308 ? 12.92 * lin : 1.055 * pow(lin, 1 / 2.4) - 0.055;
        double e = enc - rgb[(y * v.width_px + x) * 3 + k] / 255.0;
        sse += e * e;
      }
  double psnr = -10 * log10(sse / (3.0 * v.width_px * v.height_px));
  print_message("against 4x4 supersampling: %.1f dB\n", psnr);
  assert_true(psnr > 36);
}

TEST(test_rigs) {
  static const struct {
    const char *spec;
    int n_cameras, n_sub_views;
    double angle_deg;
  } rigs[] = {{"textured,rig=mono", 1, 1, 0},
              {"textured,rig=stereo,angle=10", 2, 2, 10},
              {"textured,rig=phone", 3, 3, 8},
              {"textured,rig=lightfield", 1, 16, 10},
              {"textured,rig=multiplexed,angle=4", 1, 16, 4}};
  for (int i = 0; i < 5; i++) {
    make(rigs[i].spec);
    const sv_rig *rig = sv_sim_rig(&sim);
    double centre[3] = {0, 0, SV_SIM_DISTANCE_M};
    assert_int_equal(sv_sim_source(&sim).n_cameras, rigs[i].n_cameras);
    assert_int_equal(rig->n_sub_views, rigs[i].n_sub_views);
    assert_true(fabs(sv_rig_angular_baseline_rad(rig, centre) * 180 / SV_PI - rigs[i].angle_deg) < 1e-9);
    // every sub-view has the scene's centre in its middle
    for (int k = 0; k < rig->n_sub_views; k++) {
      const sv_sub_view *s = &rig->sub_views[k];
      double x[3];
      sv_pose_apply(x, &s->cam_from_rig, centre);
      assert_true(fabs(x[0]) < 1e-12 && fabs(x[1]) < 1e-12 && fabs(x[2] - SV_SIM_DISTANCE_M) < 1e-12);
      assert_true(s->footprint.x0_px + s->footprint.width_px <= 320);
    }
    for (int h = 0; h < 24; h++) { // held-out views are none of the training views
      sv_view v, train;
      double t;
      float a[3], b[3];
      sv_sim_heldout_view(&sim, h, 24, &v, &t);
      sv_view_centre(a, &v);
      double nearest = 1e9;
      for (int k = 0; k < 8 * rig->n_sub_views; k++) {
        sv_sim_view(&sim, k / rig->n_sub_views, k % rig->n_sub_views, &train, &t);
        sv_view_centre(b, &train);
        double da[3] = {(double)a[0], (double)a[1], (double)a[2]},
               db[3] = {(double)b[0], (double)b[1], (double)b[2]};
        nearest = fmin(nearest, sv_angle_between(da, db) * 180 / SV_PI);
      }
      assert_true(nearest > 0.4 && nearest < 10);
    }
  }
}

TEST(held_out_views_go_with_the_rig) {
  make("moving,rig=stereo,arc=60,exposures=5");
  for (int k = 0; k < 12; k++) {
    const sv_ns now_ns = sv_sim_slot_ns(&sim, k);
    sv_pose rig;
    sv_view v;
    float at[3];
    double eye[3];
    sv_sim_rig_pose(&sim, now_ns, &rig);
    sv_pose_centre(eye, &rig);
    sv_sim_heldout_view_at(&sim, k, now_ns, &v);
    sv_view_centre(at, &v);
    const double to[3] = {(double)at[0], (double)at[1], (double)at[2]};
    assert_near(sv_angle_between(eye, to) * 180 / SV_PI, 3, 0.01); // the scene is at the origin
  }
}

static sv_status next_frame(sv_frame *f) {
  sv_source src = sv_sim_source(&sim);
  return src.dequeue(src.self, f, sim.now_ns + 2 * SV_NS_PER_S);
}
static void give_back(const sv_frame *f) {
  sv_source src = sv_sim_source(&sim);
  assert_int_equal(src.requeue(src.self, f), SV_OK);
}
static void start(void) {
  sv_source src = sv_sim_source(&sim);
  assert_int_equal(src.start(src.self), SV_OK);
}

// A delivered frame is the picture of the rig's pose at its own time, pixel for pixel.
TEST(test_frames_match_poses) {
  static const char *const specs[] = {"moving,frames=4,size=96x72",
                                      "thin,path=smooth,skew_us=800,frames=4,size=96x72"};
  for (int i = 0; i < 2; i++) {
    make(specs[i]);
    sv_source src = sv_sim_source(&sim);
    sv_camera_caps caps;
    sv_frame f;
    int n = 0;
    assert_int_equal(src.caps(src.self, 1, &caps), SV_OK);
    assert_string_equal(caps.name, "right");
    assert_int_equal(caps.clock, SV_CLOCK_MONOTONIC);
    start();
    while (next_frame(&f) == SV_OK) {
      sv_pose rig, cam;
      assert_int_equal(src.rig_pose(src.self, f.camera_ns, &rig), SV_OK);
      const sv_sub_view *s = &sv_sim_rig(&sim)->sub_views[f.i_camera];
      cam = sv_pose_mul(&s->cam_from_rig, &rig);
      sv_view v = sv_view_make(96, 72, s->model.p, &cam);
      sv_sim_render(&sim, &v, sv_ns_to_s(f.camera_ns - SV_SIM_EPOCH_NS), rgb, NULL);
      assert_memory_equal(rgb, f.data, f.data_bytes);
      assert_true(f.arrival_ns > f.camera_ns);
      give_back(&f);
      n++;
    }
    assert_int_equal(n, 8);
  }
}

TEST(test_lenses) {
  make("textured,rig=lightfield,frames=1");
  sv_frame f;
  start();
  assert_int_equal(next_frame(&f), SV_OK);
  for (int i = 0; i < 16; i++) {
    const sv_footprint *p = &sv_sim_rig(&sim)->sub_views[i].footprint;
    sv_view v;
    double t;
    sv_sim_view(&sim, 0, i, &v, &t);
    sv_sim_render(&sim, &v, t, rgb, NULL);
    for (int y = 0; y < p->height_px; y++)
      assert_memory_equal(rgb + 3 * y * p->width_px, f.data + (p->y0_px + y) * f.stride_bytes + 3 * p->x0_px,
                          (size_t)(3 * p->width_px));
  }
  assert_int_equal(next_frame(&f), SV_END);
  make("textured,rig=multiplexed,frames=1");
  start();
  assert_int_equal(next_frame(&f), SV_OK);
  assert_int_equal(f.format, SV_PIX_RGB16);
  int most = 0, cover[5] = {0};
  for (int y = 0; y < 240; y++)
    for (int x = 0; x < 320; x++) {
      int n = 0;
      for (int i = 0; i < 16; i++) {
        const sv_footprint *p = &sv_sim_rig(&sim)->sub_views[i].footprint;
        n += x >= p->x0_px && x < p->x0_px + p->width_px && y >= p->y0_px && y < p->y0_px + p->height_px;
      }
      most = sv_maxi(most, n);
      cover[n > 4 ? 0 : n]++;
    }
  assert_int_equal(most, 4);
  assert_true(cover[4] > 0 && cover[0] == 0);
}

TEST(test_noise) {
  make("room,frames=1,rig=mono");
  sv_frame f;
  start();
  assert_int_equal(next_frame(&f), SV_OK);
  memcpy(rgb, f.data, f.data_bytes);
  make("room,frames=1,rig=mono,noise=read:0.0004:shot:0.002,seed=7");
  start();
  assert_int_equal(next_frame(&f), SV_OK);
  double n = 0, sum = 0, sq = 0, expected = 0;
  for (size_t i = 0; i < f.data_bytes; i++) {
    if (rgb[i] < 80 || rgb[i] > 200) continue; // away from the clipping
    double s = rgb[i] / 255.0, g = f.data[i] / 255.0;
    double x = pow((s + 0.055) / 1.055, 2.4), y = g <= 0.04045 ? g / 12.92 : pow((g + 0.055) / 1.055, 2.4);
    n++;
    sum += y - x;
    sq += (y - x) * (y - x);
    expected += 0.0004 + 0.002 * x;
  }
  assert_true(n > 10000);
  assert_true(fabs(sum / n) < 1e-3);
  assert_true(fabs(sq / expected - 1) < 0.05);
  memcpy(rgb_b, f.data, f.data_bytes);
  make("room,frames=1,rig=mono,noise=shot:0.002:read:0.0004,seed=7");
  start();
  assert_int_equal(next_frame(&f), SV_OK);
  assert_memory_equal(rgb_b, f.data, f.data_bytes);
}

#define N_SEEN 64
typedef struct {
  int n, n_device_errors, n_flagged;
  uint32_t sequence[N_SEEN];
  sv_ns camera_ns[N_SEEN], arrival_ns[N_SEEN];
} seen;

static void play(const char *spec, seen out[3]) {
  make(spec);
  memset(out, 0, 3 * sizeof *out);
  start();
  sv_frame f;
  sv_status s;
  while ((s = next_frame(&f)) != SV_END) {
    if (s == SV_AGAIN) continue;
    seen *o = &out[f.i_camera];
    if (s == SV_E_DEVICE) {
      o->n_device_errors++;
      continue;
    }
    assert_int_equal(s, SV_OK);
    assert_true(o->n < N_SEEN);
    o->sequence[o->n] = f.sequence;
    o->camera_ns[o->n] = f.camera_ns;
    o->arrival_ns[o->n++] = f.arrival_ns;
    o->n_flagged += f.is_error;
    give_back(&f);
  }
}

TEST(test_faults) {
  seen c[3];
  play("thin,size=16x16,frames=20,fault=unplug:1:5", c);
  assert_true(c[0].n == 20 && c[1].n == 5 && c[1].n_device_errors == 1 && c[0].n_device_errors == 0);
  play("thin,size=16x16,frames=20,fault=unplug:1:5:4", c);
  assert_true(c[1].n == 16 && c[1].n_device_errors == 1 && c[1].sequence[5] == 0);
  play("thin,size=16x16,frames=20,fault=stall:0:3:6", c);
  assert_true(c[0].n == 14 && c[0].sequence[3] == 3 &&
              c[0].camera_ns[3] - c[0].camera_ns[2] == 700 * SV_NS_PER_MS);
  play("thin,size=16x16,frames=20,fault=error:1:4", c);
  assert_true(c[1].n == 20 && c[1].n_flagged == 1 && c[0].n_flagged == 0);
  play("thin,size=16x16,frames=20,fault=dup:0:4", c);
  assert_true(c[0].n == 21 && c[0].sequence[4] == 4 && c[0].sequence[5] == 4 &&
              c[0].camera_ns[4] == c[0].camera_ns[5]);
  play("thin,size=16x16,frames=20,fault=reorder:0:4", c);
  assert_true(c[0].n == 20 && c[0].sequence[4] == 5 && c[0].sequence[5] == 4 && c[0].sequence[6] == 6);
  play("thin,size=16x16,frames=20,fault=seqreset:0:4", c);
  assert_true(c[0].n == 20 && c[0].sequence[3] == 3 && c[0].sequence[4] == 0 && c[0].sequence[19] == 15);
  play("thin,size=16x16,frames=20,fault=clockstep:1:4:-250+dup:0:2+error:0:7:3", c);
  assert_true(c[1].camera_ns[4] - c[1].camera_ns[3] == -150 * SV_NS_PER_MS && c[0].n == 21 &&
              c[0].n_flagged == 3);
  for (int i = 1; i < c[0].n; i++) assert_true(c[0].arrival_ns[i] >= c[0].arrival_ns[i - 1]);
}

TEST(test_clocks) {
  seen c[3];
  play("thin,size=16x16,rig=phone,frames=40,skew_us=100,drift_ppm=50,offset_ms=20", c);
  sv_camera_caps caps;
  sv_source src = sv_sim_source(&sim);
  assert_int_equal(src.caps(src.self, 0, &caps), SV_OK);
  assert_int_equal(caps.clock, SV_CLOCK_CAMERA);
  assert_true(llabs(c[1].camera_ns[0] - c[0].camera_ns[0] - 20 * SV_NS_PER_MS - 50000) < 10000);
  sv_ns span = 39 * 100 * SV_NS_PER_MS;
  assert_true(llabs(c[0].camera_ns[39] - c[0].camera_ns[0] - span - span / 20000) < 3);
  assert_true(llabs(c[1].camera_ns[39] - c[1].camera_ns[0] - span + span / 20000) < 3);
  play("thin,size=16x16,rig=mono,frames=60,jitter_us=50", c);
  double sq = 0;
  for (int i = 0; i < 60; i++) {
    double e = (double)(c[0].camera_ns[i] - sv_sim_slot_ns(&sim, i));
    sq += e * e;
  }
  assert_true(sqrt(sq / 60) > 35e3 && sqrt(sq / 60) < 65e3);
}

// A host that dawdles: it keeps frames, sleeps, gives them back. Every frame is somewhere in the
// ledger, and every frame that did not come shows as a gap in the sequence.
TEST(test_ledger) {
  make("textured,size=16x16,rig=phone,frames=400,fps=100,drop=0.1,buffers=3,delay_jitter_us=2000");
  sv_clock clock = sv_sim_clock(&sim);
  sv_frame held[3][3], f;
  int n_held[3] = {0}, n = 0;
  uint64_t gaps[3] = {0}, last[3] = {0}, first[3] = {1, 1, 1};
  start();
  for (sv_status s; (s = next_frame(&f)) != SV_END; n++) {
    int c = f.i_camera;
    assert_int_equal(s, SV_OK);
    assert_true(first[c] || f.sequence > last[c]);
    gaps[c] += first[c] ? f.sequence : f.sequence - last[c] - 1;
    last[c] = f.sequence;
    first[c] = 0;
    held[c][n_held[c]++] = f;
    if (n_held[c] == 3 || n % 5 == 0) {
      if (n % 7 == 0) clock.sleep_until_ns(clock.self, clock.now_ns(clock.self) + 50 * SV_NS_PER_MS);
      while (n_held[c]) give_back(&held[c][--n_held[c]]);
    }
  }
  for (int c = 0; c < 3; c++) {
    const sv_sim_counts *k = sv_sim_camera_counts(&sim, c);
    assert_int_equal(k->n_exposed, 400);
    assert_int_equal(k->n_exposed, k->n_delivered + k->n_lost + k->n_starved);
    assert_int_equal(gaps[c] + (399 - last[c]), k->n_lost + k->n_starved);
    assert_true(k->n_lost > 15 && k->n_lost < 75 && k->n_starved > 0);
  }
  sv_source src = sv_sim_source(&sim);
  f.i_buffer = 0;
  for (int c = 0; c < 3; c++)
    while (n_held[c]) give_back(&held[c][--n_held[c]]);
  assert_int_equal(src.requeue(src.self, &f), SV_E_ARG); // nothing is on loan any more
  assert_int_equal(src.stop(src.self), SV_OK);
}

TEST(test_waiting) {
  make("textured,size=16x16,rig=mono,fps=10");
  sv_source src = sv_sim_source(&sim);
  sv_frame f;
  assert_int_equal(src.dequeue(src.self, &f, 0), SV_END); // not started
  start();
  assert_int_equal(src.dequeue(src.self, &f, SV_SIM_EPOCH_NS + 20 * SV_NS_PER_MS), SV_AGAIN);
  assert_int_equal(sim.now_ns, SV_SIM_EPOCH_NS + 20 * SV_NS_PER_MS);
  assert_int_equal(src.dequeue(src.self, &f, SV_SIM_EPOCH_NS + SV_NS_PER_S), SV_OK);
  assert_int_equal(f.camera_ns, SV_SIM_EPOCH_NS + 50 * SV_NS_PER_MS);
  assert_int_equal(sim.now_ns, f.arrival_ns);
}

TEST(test_bad_specs) {
  static const struct {
    const char *spec, *says;
  } bad[] = {{"kitchen", "textured, thin, occlusion, moving, room"},
             {"", "textured"},
             {"thin,rig=cube", "mono, stereo, phone, lightfield, multiplexed"},
             {"thin,colour=red", "subview cameras"},
             {"thin,fps=fast", "a number from 0.1 to 1000"},
             {"thin,fps=", "fps"},
             {"thin,fps", "fps"},
             {"thin,size=12", "WIDTHxHEIGHT"},
             {"thin,size=320x240x3", "WIDTHxHEIGHT"},
             {"thin,size=99999x10", "16 to 4096"},
             {"thin,exposures=2.5", "whole number"},
             {"thin,noise=read", "read:V:shot:V"},
             {"thin,noise=hum:1", "read:V:shot:V"},
             {"thin,fault=fire", "unplug, stall, error, dup, reorder, seqreset, clockstep"},
             {"thin,fault=dup:7", "cameras 0 to 1"},
             {"thin,fault=dup:0:1:2:3", "NAME[:CAMERA"},
             {"thin,fault=stall:0:1:-4", "negative"},
             {"thin,fault=dup+dup+dup+dup+dup+dup+dup+dup+dup", "at most 8"},
             {"thin,angle=0", "expected more than 0"},
             {"thin,rig=lightfield,grid=4", "ROWSxCOLS"},
             {"thin,rig=lightfield,grid=17x17", "1 to 256"},
             {"thin,rig=lightfield,overlap=1.5", "side by side"},
             {"thin,rig=multiplexed,overlap=0.9", "a number from 1 to 16"},
             {"thin,rig=multiplexed,size=16x16,grid=1x100", "do not fit"},
             {"thin,grid=2x2", "no grid"},
             {"thin,fps=1000,skew_us=900", "half a period"},
             {"thin,path=crooked", "step, smooth, handheld or sway"},
             {"thin,seed=-1", "whole number"},
             {"thin,drop=nan", "drop"},
             {"thin,skew_su=3", "no option 'skew_su' (did you mean skew_us?)"},
             {"thin,,", "no option ''; `subview cameras` lists them"}};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    sv_sim_config cfg = {.fps = 123};
    sv_err err = {0};
    assert_true(sv_sim_parse(&cfg, bad[i].spec, &err) < 0);
    if (!strstr(err.text, bad[i].says))
      fail_msg("%s: \"%s\" does not say \"%s\"", bad[i].spec, err.text, bad[i].says);
    assert_true(strlen(err.text) < sizeof err.text - 1); // not cut
    assert_true(cfg.fps == 123);
  }
  char text[2000];
  sv_str s = sv_str_make(text, sizeof text);
  sv_sim_list(&s);
  assert_false(s.is_cut);
  assert_contains(text, "sim:occlusion");
}

TEST(test_memory) {
  sv_sim_config cfg;
  sv_err err = {0};
  assert_int_equal(sv_sim_parse(&cfg, "room,rig=multiplexed,buffers=2", &err), SV_OK);
  size_t bytes = sv_sim_bytes(&cfg);
  uint8_t *block = aligned_alloc(64, (bytes + 63) / 64 * 64);
  arena = sv_arena_make(block, bytes);
  assert_int_equal(sv_sim_init(&sim, &cfg, &arena, &err), SV_OK);
  assert_int_equal(arena.used_bytes, bytes);
  arena = sv_arena_make(block, bytes - 1);
  assert_int_equal(sv_sim_init(&sim, &cfg, &arena, &err), SV_E_NOMEM);
  assert_contains(err.text, "do not fit");
  free(block);
}

// A loose bound: the goal is 10 ms on one desktop core, checked here with room for slow or busy
// machines.
TEST(test_speed) {
  static const char *const scenes[] = {"textured", "thin", "occlusion", "moving", "room"};
  for (int i = 0; i < 5; i++) {
    make(scenes[i]);
    double best = 1e9;
    for (int k = 0; k < 8; k++) {
      sv_view v;
      double t;
      struct timespec a, b;
      sv_sim_view(&sim, k, 0, &v, &t);
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
      sv_sim_render(&sim, &v, t, rgb, depth);
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
      best = fmin(best, (double)(b.tv_sec - a.tv_sec) * 1e3 + (double)(b.tv_nsec - a.tv_nsec) * 1e-6);
    }
    print_message("%-10s %.2f ms a 320x240 frame\n", scenes[i], best);
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && defined(__x86_64__)
    assert_true(best < 40);
#endif
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_same_bits),
      cmocka_unit_test(test_rows_do_not_matter),
      cmocka_unit_test(test_depth_agrees_between_views),
      cmocka_unit_test(test_depth_is_exact),
      cmocka_unit_test(test_edges_are_antialiased),
      cmocka_unit_test(test_rigs),
      cmocka_unit_test(held_out_views_go_with_the_rig),
      cmocka_unit_test(test_frames_match_poses),
      cmocka_unit_test(test_lenses),
      cmocka_unit_test(test_noise),
      cmocka_unit_test(test_faults),
      cmocka_unit_test(test_clocks),
      cmocka_unit_test(test_ledger),
      cmocka_unit_test(test_waiting),
      cmocka_unit_test(test_bad_specs),
      cmocka_unit_test(test_memory),
      cmocka_unit_test(test_speed),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
