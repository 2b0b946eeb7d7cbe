// SPDX-License-Identifier: Apache-2.0
// Makes tests/data/capture_tiny: two cameras 12 cm apart look at a ball over a chequered floor in
// front of a wall, four exposures while the rig moves. Everything is computed here, so the
// pictures, the rig and the poses agree and the files are ours.
//   gcc -std=c11 -D_GNU_SOURCE -I. tests/data/make_capture_tiny.c platform/replay/*.c
//   platform/codec/*.c
//     platform/linux/*.c src/base/*.c -ljpeg -lpng -lm -lpthread -o make_capture_tiny
//   ./make_capture_tiny tests/data/capture_tiny
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "platform/replay/capture_writer.h"
#include "src/base/mathx.h"
#include "src/base/str.h"

enum { W = 64, H = 48, N_CAMERAS = 2, N_EXPOSURES = 4 };
static const double FOCAL_PX = 60, BASELINE_M = 0.12;

// Colour of the ray o + s d in the world (x right, y down, z forward; floor at y = 0.5, wall at z =
// 3).
static void shade(const double o[3], const double d[3], uint8_t rgb[3]) {
  static const double ball[3] = {0.1, 0.15, 1.6}, radius = 0.35;
  double oc[3], s = 3, hit[3];
  sv_sub3(oc, o, ball);
  double b = sv_dot3(oc, d), disc = b * b - sv_dot3(oc, oc) + radius * radius;
  int what = 0; // wall
  s = (3 - o[2]) / d[2];
  if (d[1] > 0 && (0.5 - o[1]) / d[1] < s) {
    what = 1;
    s = (0.5 - o[1]) / d[1];
  }
  if (disc > 0 && -b - sqrt(disc) > 0 && -b - sqrt(disc) < s) {
    what = 2;
    s = -b - sqrt(disc);
  }
  for (int i = 0; i < 3; i++) hit[i] = o[i] + s * d[i];
  double c[3];
  if (what == 2) {
    double n[3];
    sv_sub3(n, hit, ball);
    double light = 0.35 + 0.65 * sv_maxf(0, (float)((n[0] * -0.4 - n[1] * 0.8 - n[2] * 0.45) / radius));
    int band = ((int)floor(n[0] * 12) + (int)floor(n[1] * 12)) & 1;
    c[0] = 230 * light;
    c[1] = (band ? 120 : 70) * light;
    c[2] = 50 * light;
  } else if (what == 1) {
    int dark = ((int)floor(hit[0] * 4) + (int)floor(hit[2] * 4)) & 1;
    c[0] = c[1] = dark ? 60 : 200;
    c[2] = dark ? 80 : 190;
  } else {
    c[0] = 90 + 40 * sv_sin(hit[0] * 5);
    c[1] = 140 + 50 * sv_sin(hit[1] * 7 + hit[0]);
    c[2] = 190;
  }
  for (int i = 0; i < 3; i++) rgb[i] = (uint8_t)(c[i] < 0 ? 0 : c[i] > 255 ? 255 : c[i]);
}

static void render(const sv_pose *cam_from_world, uint8_t *rgb) {
  double eye[3];
  sv_pose_centre(eye, cam_from_world);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      double ray[3] = {(x + 0.5 - W / 2.0) / FOCAL_PX, (y + 0.5 - H / 2.0) / FOCAL_PX, 1}, d[3];
      double n = sv_norm3(ray);
      for (int i = 0; i < 3; i++) // transposed: from the camera to the world
        d[i] = (cam_from_world->r[i] * ray[0] + cam_from_world->r[3 + i] * ray[1] +
                cam_from_world->r[6 + i] * ray[2]) /
               n;
      shade(eye, d, rgb + (y * W + x) * 3);
    }
}

static void put_rig(const char *dir) {
  char path[600];
  sv_err err;
  sv_fmt(path, sizeof path, "%s/rig", dir);
  if (sv_linux_make_dir(path, &err) < 0) exit(1);
  for (int c = 0; c < N_CAMERAS; c++) {
    sv_fmt(path, sizeof path, "%s/rig/cam%d.cameramodel", dir, c);
    FILE *f = fopen(path, "w");
    if (!f) exit(1);
    // mrcal's pixel centres lie at integers
    fprintf(f, "{\n 'lensmodel': 'LENSMODEL_PINHOLE',\n 'extrinsics': [0, 0, 0, %g, 0, 0],\n",
            c ? -BASELINE_M : 0.0);
    fprintf(f, " 'intrinsics': [%g, %g, %g, %g],\n 'imagersize': [%d, %d]\n}\n", FOCAL_PX, FOCAL_PX,
            W / 2.0 - 0.5, H / 2.0 - 0.5, W, H);
    fclose(f);
  }
  sv_fmt(path, sizeof path, "%s/rig/rig.json", dir);
  FILE *f = fopen(path, "w");
  if (!f) exit(1);
  fprintf(f, "{\"version\": 1, \"name\": \"tiny\", \"forward\": \"direct\", \"sub_views\": [\n");
  for (int c = 0; c < N_CAMERAS; c++)
    fprintf(f, "  {\"name\": \"cam%d\", \"model\": \"cam%d.cameramodel\", \"camera\": %d}%s\n", c, c, c,
            c + 1 < N_CAMERAS ? "," : "");
  fprintf(f, "]}\n");
  fclose(f);
}

int main(int argc, char **argv) {
  static _Alignas(64) uint8_t block[2 << 20], rgb[W * H * 3];
  static const double scene_m[6] = {-1.5, -1, 0.5, 1.5, 0.5, 3};
  if (argc != 2) return 2;
  sv_camera_caps caps[N_CAMERAS] = {{.name = "cam0"}, {.name = "cam1"}};
  for (int c = 0; c < N_CAMERAS; c++) {
    caps[c].width_px = W;
    caps[c].height_px = H;
    caps[c].fps = 10;
    caps[c].clock = SV_CLOCK_MONOTONIC;
  }
  sv_capture_writer_cfg cfg = {.dir = argv[1],
                               .name = "tiny",
                               .rig = "rig",
                               .n_cameras = N_CAMERAS,
                               .caps = caps,
                               .scene_m = scene_m,
                               .quality = 90};
  static sv_capture_writer w;
  sv_arena arena = sv_arena_make(block, sizeof block);
  sv_err err = {.text = ""};
  sv_status s = sv_capture_writer_open(&w, &cfg, &arena, &err);
  for (int e = 0; e < N_EXPOSURES && s == SV_OK; e++) {
    double angle[3] = {0, (e - 1.5) * 0.08, 0}, eye[3] = {(e - 1.5) * 0.15, -0.05 * e, 0};
    sv_pose rig;
    sv_rodrigues(rig.r, angle);
    sv_apply33(rig.t, rig.r, eye);
    for (int i = 0; i < 3; i++) rig.t[i] = -rig.t[i];
    sv_ns t_ns = SV_NS_PER_S + e * 100 * SV_NS_PER_MS;
    for (int c = 0; c < N_CAMERAS && s == SV_OK; c++) {
      sv_pose cam = rig;
      cam.t[0] -= c * BASELINE_M;
      render(&cam, rgb);
      sv_frame f = {.i_camera = c,
                    .sequence = (uint32_t)e,
                    .camera_ns = t_ns - 4 * SV_NS_PER_MS + c * 50000,
                    .arrival_ns = t_ns + (5 + c) * SV_NS_PER_MS,
                    .exposure_ns = 8 * SV_NS_PER_MS,
                    .width_px = W,
                    .height_px = H,
                    .stride_bytes = W * 3,
                    .format = SV_PIX_RGB8,
                    .data = rgb,
                    .data_bytes = sizeof rgb};
      s = sv_capture_writer_add(&w, &f, &err);
    }
    // of the middle of the exposure
    if (s == SV_OK) s = sv_capture_writer_add_pose(&w, t_ns, &rig, &err);
  }
  if (s == SV_OK) s = sv_capture_writer_close(&w, &err);
  if (s < 0) {
    fprintf(stderr, "make_capture_tiny: %s\n", err.text);
    return 1;
  }
  put_rig(argv[1]);
  return 0;
}
