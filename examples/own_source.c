// SPDX-License-Identifier: Apache-2.0
// A frame source of one's own: two cameras that deliver frame by frame, with jitter and a lost
// frame. The library puts frames of the same instant together, gives every frame back, and keeps
// account of those that it left out.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <subview/subview.h>

enum { WIDTH = 64, HEIGHT = 48, N_CAMERAS = 2, N_BUFFERS = 6, N_FRAMES = 8, N_STEPS = 300 };
#define PERIOD_NS 33333333

static _Alignas(SUBVIEW_ALIGN) unsigned char block[8 << 20];

// A driver's state: a ring of buffers for each camera, which it fills and which come back.
typedef struct {
  uint8_t pixels[N_CAMERAS][N_BUFFERS][HEIGHT][WIDTH];
  int is_lent[N_CAMERAS][N_BUFFERS];
  int i_next; // frames of both cameras so far
} cameras;

static cameras mine;

static int wave(int x, int period) { return abs(x % period * 2 - period) * 80 / period; } // 0..80

// Crossed waves at 2.1 m; a camera 0.1 m to the right sees them 3 px to the left.
static void expose(uint8_t image[HEIGHT][WIDTH], int i_camera, int i_frame) {
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      const int u = x + 3 * (i_camera + i_frame);
      image[y][x] = (uint8_t)(wave(u, 17) + wave(y, 13) + wave(u + y, 29));
    }
}

// Frames arrive camera by camera, the second one 0.3 ms late. Frame 3 of camera 1 is lost.
static subview_status dequeue(void *self, subview_source_frame *out) {
  cameras *c = self;
  if (c->i_next == 2 * 3 + 1) c->i_next++;
  if (c->i_next >= 2 * N_FRAMES) return SUBVIEW_END;
  const int i_camera = c->i_next % 2, i_frame = c->i_next / 2;
  int i_buffer = 0;
  while (i_buffer < N_BUFFERS && c->is_lent[i_camera][i_buffer]) i_buffer++;
  if (i_buffer == N_BUFFERS) return SUBVIEW_E_DEVICE; // a real driver would drop the frame
  expose(c->pixels[i_camera][i_buffer], i_camera, i_frame);
  c->is_lent[i_camera][i_buffer] = 1;
  c->i_next++;
  out->i_camera = i_camera;
  out->sequence = (uint32_t)i_frame;
  out->camera_ns = (int64_t)i_frame * PERIOD_NS + 300000 * i_camera;
  out->arrival_ns = out->camera_ns + 5000000;
  out->exposure_ns = 4000000;
  out->frame.data = &c->pixels[i_camera][i_buffer][0][0];
  out->i_buffer = i_buffer;
  return SUBVIEW_OK;
}

static subview_status requeue(void *self, const subview_source_frame *frame) {
  cameras *c = self;
  c->is_lent[frame->i_camera][frame->i_buffer] = 0;
  return SUBVIEW_OK;
}

// The rig moves to the right by 0.1 m a frame.
static subview_status rig_pose(void *self, int64_t host_ns, subview_pose *rig_from_world) {
  (void)self;
  *rig_from_world = subview_pose_identity();
  rig_from_world->t[0] = -0.1 * (double)(host_ns / PERIOD_NS);
  return SUBVIEW_OK;
}

static int fail(const char *what, const subview_error *error) {
  fprintf(stderr, "%s: %s\n", what, error->text);
  return 1;
}

int main(void) {
  const subview_source source = {&mine, dequeue, requeue, rig_pose};
  subview *s;
  subview_error error;
  subview_status status;
  subview_camera rig[N_CAMERAS];
  subview_config config = subview_defaults();
  double psnr_db;
  int n_lent = 0;

  for (int i = 0; i < N_CAMERAS; i++) {
    rig[i] = subview_camera_defaults(WIDTH, HEIGHT);
    rig[i].pixels = SUBVIEW_PIXELS_GREY8;
    rig[i].cam_from_rig.t[0] = -0.1 * i;
  }
  config.cameras = rig;
  config.n_cameras = N_CAMERAS;
  config.n_exposures = N_FRAMES;
  config.n_gaussians = 500;
  config.n_steps = N_STEPS;
  if (subview_init(&s, &config, block, sizeof block, &error) < 0) return fail("init", &error);

  // OK: an exposure came. AGAIN: wait for the cameras here. END: no more frames.
  do status = subview_capture(s, &source, &error);
  while (status == SUBVIEW_OK || status == SUBVIEW_AGAIN);
  if (status < 0) return fail("capture", &error);
  for (int i = 0; i < N_CAMERAS * N_BUFFERS; i++) n_lent += mine.is_lent[i / N_BUFFERS][i % N_BUFFERS];
  const subview_ledger ledger = subview_capture_ledger(s);
  printf("frames: %llu captured = %llu delivered + %llu dropped; %d not returned\n",
         (unsigned long long)ledger.captured, (unsigned long long)ledger.delivered,
         (unsigned long long)ledger.dropped, n_lent);
  printf("exposures: %d\n", subview_n_exposures(s));

  if (subview_start(s, &error) < 0) return fail("start", &error);
  while (subview_step(s, NULL, &error) == SUBVIEW_OK) {
  }
  if (subview_psnr(s, &psnr_db, &error) < 0) return fail("psnr", &error);
  printf("psnr: %.1f dB\n", psnr_db);
  return 0;
}
