// SPDX-License-Identifier: Apache-2.0
// Cameras that run freely are brought together by the length of their frames, through a camera that
// queues commands and counts in lines; bounded, rate-limited, and not at all when there is nothing
// to correct.
#include <math.h>
#include <stdint.h>

#include "src/base/rng.h"
#include "src/sync/frame_length.h"
#include "tests/common/test.h"

#define PERIOD_NS 33333333LL
#define CAP_QUEUE 8

typedef struct {
  double next_ns, rate;              // true time of its next frame; error of its oscillator
  sv_ns length_ns, queue[CAP_QUEUE]; // lengths on their way to it
  int n_latency;
} free_camera;

static _Alignas(64) uint8_t block[4096];
static sv_frame_length loop;

static void open_loop(int n) {
  sv_arena a = sv_arena_make(block, sizeof block);
  assert_int_equal(
      sv_frame_length_init(&loop, &(sv_frame_length_cfg){.n_cameras = n, .period_ns = PERIOD_NS}, &a), SV_OK);
}

static free_camera camera(double phase_ns, double rate, int n_latency) {
  free_camera c = {.next_ns = 1e9 + phase_ns, .rate = rate, .length_ns = PERIOD_NS, .n_latency = n_latency};
  for (int i = 0; i < CAP_QUEUE; i++) c.queue[i] = PERIOD_NS;
  return c;
}

// One frame: its middle as measured goes to the loop, a command into the camera's queue.
static void step(free_camera *cam, int i, double noise_ns, sv_rng *r, sv_ns line_ns, double *largest) {
  sv_ns wanted_ns, mid_ns = (sv_ns)(cam->next_ns + noise_ns * (double)sv_rng_normal(r));
  for (int k = 0; k + 1 < CAP_QUEUE; k++) cam->queue[k] = cam->queue[k + 1];
  if (sv_frame_length_frame(&loop, i, mid_ns, &wanted_ns)) {
    cam->length_ns = wanted_ns / line_ns * line_ns;
    if (wanted_ns == PERIOD_NS) cam->length_ns = PERIOD_NS;
    double change = fabs((double)(wanted_ns - PERIOD_NS));
    if (change > *largest) *largest = change;
    sv_frame_length_set(&loop, i, cam->length_ns);
  }
  cam->queue[CAP_QUEUE - 1] = cam->length_ns;
  cam->next_ns += (double)cam->queue[CAP_QUEUE - 1 - cam->n_latency] * (1 + cam->rate);
}

TEST(pairs_come_together) {
  static const struct {
    double phase_ns, rate, noise_ns;
    sv_ns line_ns;
    int n_latency, settle;
    double limit_ns;
  } runs[] = {
      // nearly half a frame off, 100 ppm between the oscillators
      {14e6, 100e-6, 0, 1, 3, 400, 60e3},
      {-9e6, -100e-6, 20e3, 18900, 5, 400, 110e3}, // in lines of 18.9 us, stamps that scatter
      {16.6e6, 0, 100e3, 10000, 2, 600, 150e3},    // the sign of half a period is noise
      {300e3, 20e-6, 5e3, 10000, 7, 200, 60e3},
  };
  for (size_t t = 0; t < sizeof runs / sizeof *runs; t++) {
    free_camera a = camera(0, 0, 0), b = camera(runs[t].phase_ns, runs[t].rate, runs[t].n_latency);
    sv_rng r = sv_rng_make(t + 1, 1);
    double worst = 0, largest = 0;
    open_loop(2);
    for (int k = 0; k < 3000; k++) {
      step(&a, 0, runs[t].noise_ns, &r, 1, &largest);
      step(&b, 1, runs[t].noise_ns, &r, runs[t].line_ns, &largest);
      double d = b.next_ns - a.next_ns;
      d -= PERIOD_NS * floor(d / PERIOD_NS + 0.5);
      if (k >= runs[t].settle && fabs(d) > worst) worst = fabs(d);
    }
    print_message("phase %.1f ms, %.0f ppm, noise %.0f us: within %.1f us after %.0f s, %llu commands\n",
                  runs[t].phase_ns * 1e-6, runs[t].rate * 1e6, runs[t].noise_ns * 1e-3, worst * 1e-3,
                  runs[t].settle / 30.0, (unsigned long long)loop.n_commands);
    assert_true(worst < runs[t].limit_ns);
    assert_true(largest <= SV_FRAME_LENGTH_MAX * PERIOD_NS + 1);
    assert_true(loop.n_commands <= 2 * 3000 / SV_FRAME_LENGTH_MEASURE);
  }
}

TEST(synchronous_rigs_are_left_alone) {
  free_camera a = camera(0, 0, 0), b = camera(12e3, 0, 0);
  sv_rng r = sv_rng_make(1, 1);
  double largest = 0;
  open_loop(2);
  for (int k = 0; k < 2000; k++) {
    step(&a, 0, 0, &r, 1, &largest);
    step(&b, 1, 0, &r, 1, &largest);
  }
  assert_int_equal(loop.n_commands, 0);
}

// A camera that refuses is asked once; one whose leader is gone follows the next one.
TEST(refusals_and_lost_leaders) {
  sv_ns wanted_ns;
  int n_asked = 0;
  open_loop(3);
  for (int k = 0; k < 200; k++)
    for (int i = 0; i < 3; i++)
      if (sv_frame_length_frame(&loop, i, k * PERIOD_NS + i * 5000000, &wanted_ns)) {
        assert_true(i > 0);
        n_asked++;
        sv_frame_length_set(&loop, i, 0);
      }
  assert_int_equal(n_asked, 2);
  open_loop(3);
  sv_rng r = sv_rng_make(1, 1);
  free_camera b = camera(0, 0, 1), c = camera(4e6, 0, 1);
  double largest = 0;
  (void)sv_frame_length_frame(&loop, 0, (sv_ns)(b.next_ns - 7e6), &wanted_ns); // then silent
  for (int k = 0; k < 600; k++) {
    step(&b, 1, 0, &r, 1, &largest);
    step(&c, 2, 0, &r, 1, &largest);
  }
  double d = c.next_ns - b.next_ns;
  d -= PERIOD_NS * floor(d / PERIOD_NS + 0.5);
  print_message("after the leader is lost: %.1f us\n", d * 1e-3);
  assert_true(fabs(d) < 30e3);
  sv_frame_length_forget(&loop, 2);
  assert_false(loop.cameras[2].has_frame);
}

TEST(bad_configs_are_refused) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_frame_length_cfg bad[] = {{0, PERIOD_NS, 0}, {2, 0, 0}, {2, PERIOD_NS, -1}};
  for (int i = 0; i < 3; i++) assert_int_equal(sv_frame_length_init(&loop, &bad[i], &a), SV_E_ARG);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(pairs_come_together),
      cmocka_unit_test(synchronous_rigs_are_left_alone),
      cmocka_unit_test(refusals_and_lost_leaders),
      cmocka_unit_test(bad_configs_are_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
