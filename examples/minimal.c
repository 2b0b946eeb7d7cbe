// SPDX-License-Identifier: Apache-2.0
// Two synthetic cameras, two exposures, 300 steps, one PLY file: all of it in one static block and
// without a call to an operating system. The same file runs on a desktop (host.c) and without one
// (bare/).
#include <string.h>

#include <subview/subview.h>

void put(const char *text);                                          // prints; from host.c or
                                                                     // bare/start.S
subview_status put_file(void *self, const void *data, size_t bytes); // takes the PLY file

enum { WIDTH = 64, HEIGHT = 48, N_CAMERAS = 2, N_EXPOSURES = 2, N_STEPS = 300 };

static _Alignas(SUBVIEW_ALIGN) unsigned char block[4 << 20];
static uint8_t pixels[N_CAMERAS][HEIGHT][WIDTH][3];
static uint8_t picture[HEIGHT][WIDTH][3];

// --- a scene of integers, so that every compiler gives the same pixels ---------------------------

static uint32_t hash(uint32_t x) {
  x = (x ^ (x >> 16)) * 0x7feb352du;
  x = (x ^ (x >> 15)) * 0x846ca68bu;
  return x ^ (x >> 16);
}

// Smooth noise of 8 px cells.
static int texture(int x, int y, int channel) {
  int sum = 0;
  for (int k = 0; k < 4; k++) {
    int i = x / 8 + (k & 1), j = y / 8 + (k >> 1);
    int weight = (k & 1 ? x % 8 : 8 - x % 8) * (k & 2 ? y % 8 : 8 - y % 8);
    sum += weight * (int)(hash((uint32_t)(i + 977 * j + 31337 * channel)) & 255);
  }
  return sum / 64;
}

// A wall at 3.2 m with a square at 1.6 m before it, seen from x = 0.1 m * position: a step of one
// position moves the wall by 2 px and the square by 4.
static void draw(uint8_t rgb[HEIGHT][WIDTH][3], int position) {
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      int near_x = x + 4 * position, is_near = near_x >= 28 && near_x < 52 && y >= 12 && y < 36;
      for (int c = 0; c < 3; c++)
        rgb[y][x][c] =
            (uint8_t)(is_near ? texture(near_x, y, c) : texture(x + 2 * position + 500, y, c + 3) / 2);
    }
}

// --- output --------------------------------------------------------------------------------------

static void put_number(const char *name, uint64_t value, unsigned base, int n_digits, const char *end) {
  char text[24];
  int i = (int)sizeof text - 1;
  text[i] = 0;
  for (; i > 0 && (value || (int)sizeof text - 1 - i < n_digits); value /= base)
    text[--i] = "0123456789abcdef"[value % base];
  put(name);
  put(text + i);
  put(end);
}

static int fail(const char *what, const subview_error *error) {
  put(what);
  put(": ");
  put(error->text);
  put("\n");
  return 1;
}

// --- the run -------------------------------------------------------------------------------------

int main(void) {
  subview *s;
  subview_error error = {SUBVIEW_OK, ""};
  subview_camera cameras[N_CAMERAS];
  subview_config config = subview_defaults();
  size_t bytes;
  double psnr_db;

  for (int i = 0; i < N_CAMERAS; i++) {
    cameras[i] = subview_camera_defaults(WIDTH, HEIGHT); // its focal length is 64 px
    cameras[i].cam_from_rig.t[0] = -0.1 * i;             // the second one stands 0.1 m to the right
  }
  config.cameras = cameras;
  config.n_cameras = N_CAMERAS;
  config.n_exposures = N_EXPOSURES;
  config.n_gaussians = 500;
  config.n_steps = N_STEPS;
  if (subview_bytes(&config, &bytes, &error) < 0) return fail("size", &error);
  put_number("block    ", bytes, 10, 1, " bytes\n");
  if (subview_init(&s, &config, block, sizeof block, &error) < 0) return fail("init", &error);

  for (int e = 0; e < N_EXPOSURES; e++) {
    subview_frame frames[N_CAMERAS];
    subview_pose rig_from_world = subview_pose_identity();
    rig_from_world.t[0] = -0.2 * e; // the rig moves to the right by 0.2 m each time
    memset(frames, 0, sizeof frames);
    for (int i = 0; i < N_CAMERAS; i++) {
      draw(pixels[i], 2 * e + i);
      frames[i].data = &pixels[i][0][0][0];
    }
    if (subview_push_exposure(s, frames, &rig_from_world, &error) < 0) return fail("exposure", &error);
  }

  if (subview_start(s, &error) < 0) return fail("start", &error);
  while (subview_step(s, NULL, &error) == SUBVIEW_OK) {
  }
  if (subview_psnr(s, &psnr_db, &error) < 0) return fail("psnr", &error);
  put_number("digest   ", subview_digest(s), 16, 16, "\n");
  put_number("psnr     ", (uint64_t)(psnr_db * 100), 10, 1, " / 100 dB\n");

  subview_view view; // what no camera saw: from between the two of the first exposure
  subview_sink sink = {NULL, put_file};
  if (subview_view_of(s, 0, 0, &view) < 0) return 1;
  view.cam_from_world.t[0] -= 0.05;
  if (subview_render(s, &view, &picture[0][0][0], 0, &error) < 0) return fail("render", &error);
  if (subview_save(s, SUBVIEW_FILE_PLY, sink, &error) < 0) return fail("save", &error);
  return 0;
}
