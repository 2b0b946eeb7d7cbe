// SPDX-License-Identifier: Apache-2.0
// No heap between the seal and the end of a run, its report and its preview: on the simulator and
// on a capture, with one thread and with two, on the machine's own store, console and clock, the
// preview compressed by libjpeg.
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/codec/codec.h"
#include "tests/common/test.h"
#include "tests/common/world.h"
#include "tests/fault/heap_count.h"

#define CAP_JPEG (256u << 10)

static world w;
static sv_codec codec;
static sv_linux_store store;
static sv_linux_console console;
static uint8_t *jpeg;
static char dir[256];
static int n_pictures;
static sv_feed feed;
static _Alignas(64) uint8_t feed_block[16u << 20];

static void publish_jpeg(void *self, const char *name, int width_px, int height_px, const uint8_t *rgb) {
  sv_picture pic = {.width_px = width_px,
                    .height_px = height_px,
                    .stride_bytes = (size_t)width_px * 3,
                    .format = SV_PIX_RGB8,
                    .data = (uint8_t *)(uintptr_t)rgb};
  sv_store st = sv_linux_store_port(&store);
  size_t bytes;
  sv_err err;
  (void)self;
  (void)name;
  if (sv_codec_encode_jpeg(&codec, &pic, (sv_jpeg_options){92, true}, (sv_codec_buffer){jpeg, CAP_JPEG},
                           &bytes, &err) < 0)
    return;
  if (st.begin(st.self, "preview.jpg", &err) < 0) return;
  if (st.write(st.self, jpeg, bytes, &err) < 0) st.abandon(st.self);
  else if (st.commit(st.self, &err) == SV_OK) n_pictures++;
}

#define REPLAY NULL // instead of a simulator's name

static void run_with(const char *sim, int n_threads, sv_prior_method prior) {
  bool is_open = sim ? world_open(&w, sim, 4, ~0u, n_threads)
                     : world_open_replay(&w, "tests/data/capture_tiny", 4, ~0u, n_threads);
  if (!is_open) fail_msg("%s", w.err.text);
  sv_codec_cfg cc = {.max_width_px = 192, .max_height_px = 48};
  assert_int_equal(sv_codec_init(&codec, &cc, &w.arena), SV_OK);
  jpeg = SV_TAKE(&w.arena, uint8_t, CAP_JPEG);
  int fd = open("/dev/null", O_WRONLY | O_CLOEXEC);
  sv_linux_console_init(&console, fd, false);
  console.live_period_ns = 0; // every live line
  if (sv_linux_store_open(&store, dir, &w.err) < 0) fail_msg("%s", w.err.text);
  w.port = w.inner;
  w.port.machine = sv_linux_clock();
  w.port.store = sv_linux_store_port(&store);
  w.port.console = sv_linux_console_port(&console);
  memset(feed_block, 0, sizeof feed_block);
  assert_int_equal(sv_feed_init(&feed, feed_block, sizeof feed_block, 300, 59, 0), SV_OK);
  w.port.publish = (sv_publish){.image = publish_jpeg, .feed = &feed};
  w.cfg.has_preview = true;
  w.cfg.train.n_gaussians = 300;
  w.cfg.prior = prior;
  w.cfg.is_deep = sim && strstr(sim, "depth=16");
  w.cfg.train.relocate_every = 10;
  w.cfg.train.lr.logit = 0.3f;
  w.cfg.steps = 150;
  w.cfg.save_every_s = 0.02;
  w.cfg.is_resume = true;
  n_pictures = 0;
  assert_ok(world_init(&w), &w.err); // seals
  assert_true(w.arena.is_sealed);
  double psnr = 0;
  sv_heap_arm();
  sv_status run = sv_app_run(&w.app, &w.err);
  sv_status shown = sv_app_publish_preview(&w.app);
  sv_status rated = sv_driver_training_psnr(&w.app.trainer, &psnr);
  sv_status told = sv_app_save_report(&w.app, "\"psnr\": 0", &w.err);
  sv_heap_disarm();
  sv_heap_report();
  if (run < 0 || shown < 0 || rated < 0 || told < 0) fail_msg("%s", w.err.text);
  assert_int_equal(sv_heap_count(), 0);
  assert_true(n_pictures >= 2);
  assert_true(sv_feed_seq(&feed, SV_FEED_MODEL) >= 3); // the live view went along
  assert_true(sv_feed_seq(&feed, SV_FEED_STATE) >= 3);
  assert_true(sv_feed_seq(&feed, SV_FEED_PICTURE) >= 2);
  assert_int_equal(w.app.exposures.n, 4);
  assert_int_equal(world_stats(&w).step, 150);
  void *late = sv_arena_take(&w.arena, 1, 1); // the arena says no, too
  assert_null(late);
  assert_int_equal(w.arena.status, SV_E_SEALED);
  sv_linux_store_close(&store);
  sv_codec_close(&codec);
  close(fd);
  world_close(&w);
}

static void run_without_heap(const char *sim, int n_threads) { run_with(sim, n_threads, SV_PRIOR_NONE); }

FIXTURE(make_dir) {
  const char *tmp = getenv("TMPDIR");
  snprintf(dir, sizeof dir, "%s/sv_heap_run_XXXXXX", tmp ? tmp : "/tmp");
  return mkdtemp(dir) ? 0 : -1;
}
FIXTURE(remove_dir) {
  char command[300];
  snprintf(command, sizeof command, "rm -rf '%s'", dir);
  return system(command);
}

#define STEREO      "textured,rig=stereo,size=64x48"
#define MULTIPLEXED "textured,rig=multiplexed,grid=2x2,size=64x48"

TEST(test_sim_1) { run_without_heap(STEREO, 1); }
TEST(test_sim_2) { run_without_heap(STEREO, 2); }
TEST(test_deep) { run_without_heap(STEREO ",depth=16,bracket=0.2", 2); }
TEST(test_fsgs) { run_with(STEREO, 2, SV_PRIOR_FSGS); }
TEST(test_sparsegs) { run_with(STEREO, 2, SV_PRIOR_SPARSEGS); }
TEST(test_multiplexed_1) { run_without_heap(MULTIPLEXED, 1); }
TEST(test_multiplexed_2) { run_without_heap(MULTIPLEXED, 2); }
TEST(test_replay_1) { run_without_heap(REPLAY, 1); }
TEST(test_replay_2) { run_without_heap(REPLAY, 2); }

#define CASE(name) cmocka_unit_test_setup_teardown(name, make_dir, remove_dir)
int main(void) {
  const struct CMUnitTest tests[] = {CASE(test_sim_1),         CASE(test_sim_2),    CASE(test_multiplexed_1),
                                     CASE(test_multiplexed_2), CASE(test_replay_1), CASE(test_replay_2),
                                     CASE(test_fsgs),          CASE(test_sparsegs), CASE(test_deep)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
