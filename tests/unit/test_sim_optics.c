// SPDX-License-Identifier: Apache-2.0
// What the simulator's lenses, sensors and shutters do to frames, each option against its formula.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/codec/codec.h"
#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "tests/common/test.h"

#define W    96
#define H    72
#define N    (3 * W * H)
#define BASE "textured,rig=phone,size=96x72,fps=10,exposures=4"

static uint8_t memory[16 << 20];
static sv_sim sim;
static uint8_t ideal[N], frame[N], other[N];

static void make(const char *spec) {
  sv_sim_config cfg;
  sv_err err = {0};
  if (sv_sim_parse(&cfg, spec, &err) < 0) fail_msg("%s: %s", spec, err.text);
  memset(memory, 0xa5, sizeof memory);
  sv_arena arena = sv_arena_make(memory, sizeof memory);
  if (sv_sim_init(&sim, &cfg, &arena, &err) < 0) fail_msg("%s: %s", spec, err.text);
}

static void expose_at(const char *spec, int i_camera, int64_t slot, sv_ns late_ns, uint8_t *out) {
  make(spec);
  const sv_sim_event e = {
      .i_camera = i_camera, .slot = slot, .true_ns = sv_sim_slot_ns(&sim, slot) + late_ns};
  sv_sim_expose(&sim, &e, out);
}

static void expose(const char *more, int i_camera, int64_t slot, uint8_t *out) {
  char spec[300];
  sv_fmt(spec, sizeof spec, BASE "%s", more);
  expose_at(spec, i_camera, slot, 0, out);
}

static double linear(uint8_t v) { return (double)sim.noise.linear8[v]; }

// Mean ratio of linear light in a channel (3: all), where neither is dark or saturated, with the
// largest deviation from it.
static double ratio(const uint8_t *a, const uint8_t *b, int channel) {
  double from = 0, to = 0;
  for (int i = 0; i < N; i++) {
    if (channel < 3 && i % 3 != channel) continue;
    if (a[i] < 30 || a[i] > 245 || b[i] < 30 || b[i] > 245) continue;
    from += linear(a[i]);
    to += linear(b[i]);
  }
  assert_true(from > 1);
  return to / from;
}

TEST(test_ideal_by_default) {
  expose("", 1, 1, ideal);
  expose(",white=6500,gain=0,response=1,auto_exposure=1,vignetting=0,aperture_mm=0,readout_ms=0,blur=off", 1,
         1, frame);
  assert_memory_equal(ideal, frame, N);
}

TEST(test_light_and_color) {
  for (int i = 0; i < 3; i++) {
    static const double share[3] = {1, 1.3, 0.7}, drift[4] = {1, 1.2599, 1.5874, 2};
    expose("", i, 2, ideal);
    expose(",gain=0.3", i, 2, frame);
    assert_true(fabs(ratio(ideal, frame, 3) - share[i]) < 0.01);
    for (int slot = 0; slot < 4; slot++) {
      expose("", i, slot, ideal);
      expose(",auto_exposure=2", i, slot, frame);
      assert_true(fabs(ratio(ideal, frame, 3) - drift[slot]) < 0.015);
    }
  }
  // Balanced to warmer light than there is: blue is raised, red lowered.
  expose("", 1, 0, ideal);
  expose(",white=4500", 1, 0, frame);
  print_message("white balance: %.3f %.3f %.3f\n", ratio(ideal, frame, 0), ratio(ideal, frame, 1),
                ratio(ideal, frame, 2));
  assert_true(ratio(ideal, frame, 0) < 0.85 && fabs(ratio(ideal, frame, 1) - 1) < 0.01 &&
              ratio(ideal, frame, 2) > 1.4);
  expose(",white=4500", 0, 0, frame);
  expose("", 0, 0, ideal);
  assert_memory_equal(ideal, frame, N); // the reference
  // White stays white under crosstalk; a color comes nearer to it.
  expose("", 1, 0, ideal);
  expose(",crosstalk=0.1", 1, 0, frame);
  for (int i = 0; i < N; i += 3) {
    const double mean = (linear(ideal[i]) + linear(ideal[i + 1]) + linear(ideal[i + 2])) / 3;
    for (int k = 0; k < 3; k++)
      if (ideal[i + k] < 250)
        assert_true(fabs(linear(frame[i + k]) - (0.7 * linear(ideal[i + k]) + 0.3 * mean)) < 0.02);
  }
  expose(",response=1.2", 1, 0, frame);
  for (int i = 0; i < N; i++) assert_true(fabs(frame[i] - 255 * pow(ideal[i] / 255.0, 1.2)) < 1.5);
  expose(",black=0.1", 1, 0, frame);
  for (int i = 0; i < N; i++)
    assert_true(fabs(linear(frame[i]) - sv_minf((float)linear(ideal[i]) + 0.1f, 1)) < 0.01);
}

TEST(test_falloff) {
  static const char *const more[] = {",vignetting=-0.4", ",vignetting=cos4", ",vignetting=-0.1:-0.2:-0.1"};
  expose("", 2, 0, ideal);
  for (int m = 0; m < 3; m++) {
    int n = 0;
    expose(more[m], 2, 0, frame);
    const sv_view v = sv_sim_sub_view_at(&sim, &sim.rig.sub_views[2], sv_sim_slot_ns(&sim, 0));
    const double far2 =
        pow(fmax((double)v.cx, W - (double)v.cx), 2) + pow(fmax((double)v.cy, H - (double)v.cy), 2);
    for (int i = 0; i < N; i++) {
      const double dx = i / 3 % W + 0.5 - (double)v.cx, dy = i / 3 / W + 0.5 - (double)v.cy;
      const double r2 = (dx * dx + dy * dy) / far2, cos2 = 1 / (1 + dx * dx / ((double)v.fx * (double)v.fx) +
                                                                dy * dy / ((double)v.fy * (double)v.fy));
      const double left = m == 0   ? 1 - 0.4 * r2
                          : m == 1 ? cos2 * cos2
                                   : 1 - r2 * (0.1 + r2 * (0.2 + r2 * 0.1));
      if (ideal[i] > 250 || ideal[i] < 70) continue;
      assert_true(fabs(linear(frame[i]) / linear(ideal[i]) - left) < 0.06);
      n++;
    }
    assert_true(n > 1000);
  }
}

// Row y of a rolling shutter's frame is row y of a frame of that row's own time.
TEST(test_rolling_shutter) {
#define MOVING "moving,rig=mono,size=96x72,fps=10,exposures=40,path=handheld"
  static const char *const shutters[] = {"down", "up", "right", "left"};
  expose_at(MOVING, 0, 3, 0, ideal);
  for (int s = 0; s < 4; s++) {
    char spec[200];
    sv_fmt(spec, sizeof spec, MOVING ",readout_ms=40,shutter=%s", shutters[s]);
    expose_at(spec, 0, 3, 0, frame);
    assert_memory_not_equal(ideal, frame, N);
    for (int b = 0; b < 4; b++) {
      const int side = s < 2 ? H : W, band = s < 2 ? 2 : 8, from = b * side / 4 / band * band;
      const double at = (from + 0.5 * band) / side - 0.5;
      expose_at(MOVING, 0, 3, (sv_ns)(40e6 * (s & 1 ? -at : at)), other);
      for (int y = s < 2 ? from : 0; y < (s < 2 ? from + band : H); y++)
        for (int x = s < 2 ? 0 : from; x < (s < 2 ? W : from + band); x++)
          for (int k = 0; k < 3; k++) {
            const int i = 3 * (y * W + x) + k;
            assert_true(abs(frame[i] - other[i]) <= 1);
          }
    }
  }
}

static double sharpness(const uint8_t *rgb) { // mean squared difference of neighbours
  double sum = 0;
  for (int y = 0; y < H; y++)
    for (int x = 0; x + 1 < W; x++) {
      const double d = rgb[3 * (y * W + x) + 1] - rgb[3 * (y * W + x) + 4];
      sum += d * d / (W * H);
    }
  return sum;
}

TEST(test_blur) {
  const char *moving = MOVING ",shutter_us=60000,blur=on,samples=8";
  expose_at(MOVING, 0, 3, 0, ideal);
  expose_at(moving, 0, 3, 0, frame);
  print_message("sharpness: %.1f, with motion blur %.1f\n", sharpness(ideal), sharpness(frame));
  assert_true(sharpness(frame) < 0.9 * sharpness(ideal));
  // Defocus: the scene is about 4 m away.
  expose("", 0, 0, ideal);
  expose(",aperture_mm=60", 0, 0, frame);
  expose(",aperture_mm=60,focus_m=1.5", 0, 0, other);
  print_message("sharpness: %.1f, focus at 4 m %.1f, at 1.5 m %.1f\n", sharpness(ideal), sharpness(frame),
                sharpness(other));
  assert_true(sharpness(frame) < sharpness(ideal) && sharpness(other) < 0.6 * sharpness(frame));
}

// A fisheye's pixels see the same point through every place of the lens at the distance in focus,
// and further off the more blur the nearer they are.
TEST(test_fisheye_defocus) {
  static const char fisheye[] = "hall,rig=mono,size=96x72,lens=kb4:185";
  char spec[200];
  double sharp[3];
  expose_at(fisheye, 0, 0, 0, ideal);
  for (int i = 0; i < 3; i++) {
    static const double focus_m[3] = {1, 4, 30};
    sv_fmt(spec, sizeof spec, "%s,aperture_mm=120,focus_m=%g", fisheye, focus_m[i]);
    expose_at(spec, 0, 0, 0, frame);
    sharp[i] = sharpness(frame);
  }
  print_message("sharpness: %.1f, focus at 1 m %.1f, at 4 m %.1f, at 30 m %.1f\n", sharpness(ideal), sharp[0],
                sharp[1], sharp[2]);
  assert_true(sharp[0] < 0.6 * sharp[1] && sharp[2] < sharp[1] && sharp[1] > 0.75 * sharpness(ideal));
  sv_fmt(spec, sizeof spec, "%s,aperture_mm=0.001,focus_m=1", fisheye);
  expose_at(spec, 0, 0, 0, frame);
  for (int i = 0; i < N; i++) assert_true(abs(frame[i] - ideal[i]) < 4); // a pinhole
}

TEST(test_hot_pixels) {
  int n[2] = {0};
  expose("", 1, 0, ideal);
  expose(",hot=20", 1, 0, frame);
  expose(",hot=20", 1, 3, other);
  for (int i = 0; i < N; i += 3) {
    n[0] += frame[i] == 255 && frame[i + 1] == 255 && frame[i + 2] == 255;
    n[1] += frame[i] == 255 && frame[i + 1] == 255 && other[i] == 255 && other[i + 1] == 255;
  }
  assert_true(n[0] >= 19 && n[0] <= 24 && n[1] >= 19); // the same in each frame
}

// A plenoptic camera's lenses each have their own falloff; a multiplexed sensor sums their light.
TEST(test_all_rigs) {
  static const char *const rigs[] = {"mono", "stereo", "phone", "lightfield", "multiplexed"};
  static uint8_t big[2][6 * 96 * 96];
  for (int r = 0; r < 5; r++) {
    char spec[300];
    sv_fmt(spec, sizeof spec,
           "thin,rig=%s,size=96x96,vignetting=-0.3,gain=0.2,readout_ms=5,hot=3,noise=read:1e-5", rigs[r]);
    for (int i = 0; i < 2; i++) expose_at(spec, 0, 1, 0, big[i]);
    assert_memory_equal(big[0], big[1], sim.frame_bytes);
  }
}

static double rms(const uint8_t *a, const uint8_t *b) {
  double sum = 0;
  for (int i = 0; i < N; i++) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sqrt(sum / N);
}

// Frames lose what libjpeg's coding at that quality loses of them, but for how it enlarges chroma.
TEST(test_jpeg) {
  static uint8_t coded[N + 4096], block[8 << 20] __attribute__((aligned(64)));
  sv_arena arena = sv_arena_make(block, sizeof block);
  sv_codec codec;
  sv_err err = {0};
  assert_int_equal(sv_codec_init(&codec, &(sv_codec_cfg){W, H}, &arena), SV_OK);
  double last = 0;
  for (int quality = 90; quality >= 30; quality -= 30) {
    char option[40];
    size_t bytes;
    sv_fmt(option, sizeof option, ",jpeg=%d", quality);
    expose(option, 0, 1, frame);
    expose("", 0, 1, ideal);
    const sv_picture from = {W, H, 3 * W, SV_PIX_RGB8, ideal}, to = {W, H, 3 * W, SV_PIX_RGB8, other};
    const sv_jpeg_options o = {quality, false};
    assert_int_equal(
        sv_codec_encode_jpeg(&codec, &from, o, (sv_codec_buffer){coded, sizeof coded}, &bytes, &err), SV_OK);
    assert_int_equal(sv_codec_decode_jpeg(&codec, coded, bytes, &to, &err), SV_OK);
    const double lost = rms(frame, ideal), apart = rms(frame, other), real = rms(other, ideal);
    printf("  quality %d: %.2f levels lost, by libjpeg %.2f; %.2f apart\n", quality, lost, real, apart);
    assert_true(lost > last && fabs(lost - real) < 0.25 * real && apart < 0.6 * real);
    last = lost;
  }
  sv_codec_close(&codec);
}

static double linear16(const uint8_t *p) {
  const double v = (p[0] | p[1] << 8) / 65535.0;
  return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

// Dark frames of 16 bits are those of 8 bits, in finer steps.
TEST(test_depth) {
  static uint8_t deep[2 * N];
  int n_far = 0, n_finer = 0;
  expose(",light=0.1", 0, 1, frame);
  assert_true(sim.frame_bytes == N);
  expose(",light=0.1,depth=16", 0, 1, deep);
  assert_true(sim.frame_bytes == 2 * N);
  for (int i = 0; i < N; i++) {
    const int v = deep[2 * i] | deep[2 * i + 1] << 8;
    if (abs(v - 257 * frame[i]) > 129) n_far++; // half a step of 8 bits
    if (v % 257 != 0) n_finer++;
  }
  assert_int_equal(n_far, 0);
  assert_true(n_finer > N / 4);
}

TEST(test_bracket_and_flat) {
  static uint8_t deep[2 * N];
  expose("", 0, 2, ideal);
  expose(",bracket=0.25", 0, 2, frame);
  assert_memory_equal(ideal, frame, N);
  expose("", 0, 3, ideal);
  expose(",bracket=0.25", 0, 3, frame);
  assert_true(fabs(ratio(ideal, frame, 3) - 0.25) < 0.01);
  expose(",flat=0.5,depth=16,vignetting=-0.4", 0, 0, deep);
  assert_true(fabs(linear16(deep + 6 * (H / 2 * W + W / 2)) - 0.5) < 1e-3);
  assert_true(fabs(linear16(deep) - 0.3) < 5e-3); // the corner
}

static double green_of(const sv_frame *f) {
  double sum = 0;
  for (int i = 1; i < N; i += 3) sum += linear(f->data[i]) / (W * H);
  return sum;
}

// Automatic exposure: of each camera by itself, or all as the first, over their responses.
TEST(test_lock) {
  static const char *const locks[3] = {",lock=on", ",lock=shared", ",lock=shared"};
  for (int k = 0; k < 3; k++) {
    char spec[200];
    double green[3], us[3];
    const float response[SV_SIM_CAP_CAMERAS] = {1, 1.3f, 0.7f};
    sv_fmt(spec, sizeof spec, "room,rig=phone,size=96x72,gain=0.3,white=4500%s", locks[k]);
    make(spec);
    if (k == 2) sim.cfg.response = response;
    const sv_source src = sv_sim_source(&sim);
    sv_camera_caps caps;
    assert_int_equal(src.caps(src.self, 1, &caps), SV_OK);
    assert_true(caps.is_light_locked && caps.is_light_shared == (k > 0));
    assert_int_equal(src.start(src.self), SV_OK);
    for (int i = 0; i < 3; i++) {
      sv_frame f;
      assert_int_equal(src.dequeue(src.self, &f, SV_SIM_EPOCH_NS + SV_NS_PER_S), SV_OK);
      green[f.i_camera] = green_of(&f);
      us[f.i_camera] = (double)f.exposure_ns * 1e-3;
      assert_int_equal(src.requeue(src.self, &f), SV_OK);
    }
    print_message("%s: green %.3f %.3f %.3f at %.0f %.0f %.0f us\n", locks[k], green[0], green[1], green[2],
                  us[0], us[1], us[2]);
    assert_true(fabs(us[0] / 4000 - (double)sv_sim_light(&sim)) < 1e-3 && us[0] > 2000 && us[0] < 16000);
    for (int i = 0; i < 3; i++) {
      if (i == 0 || k == 0) assert_true(fabs(green[i] - 0.18) < 0.01);
      else assert_true(fabs(us[i] / us[0] * (k == 2 ? (double)response[i] : 1) - 1) < 1e-3);
    }
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_ideal_by_default),
                                     cmocka_unit_test(test_light_and_color),
                                     cmocka_unit_test(test_falloff),
                                     cmocka_unit_test(test_rolling_shutter),
                                     cmocka_unit_test(test_blur),
                                     cmocka_unit_test(test_fisheye_defocus),
                                     cmocka_unit_test(test_hot_pixels),
                                     cmocka_unit_test(test_all_rigs),
                                     cmocka_unit_test(test_depth),
                                     cmocka_unit_test(test_bracket_and_flat),
                                     cmocka_unit_test(test_lock),
                                     cmocka_unit_test(test_jpeg)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
