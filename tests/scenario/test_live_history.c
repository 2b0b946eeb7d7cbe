// SPDX-License-Identifier: Apache-2.0
// A live run of a moving scene keeps its last seconds: model.svseq shows each of the last exposures
// as the model was at the end of its turn; the block is as it was to the byte; bytes add up.
#include <string.h>

#include "src/format/sequence.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define N_GAUSSIANS 300
#define EXPOSURE_S  0.1
#define HISTORY_S   3.0
#define STEPS_EACH  6
#define N_EXPOSURES 70
#define CAP_NOTED   100

static world w;
static _Alignas(8) uint8_t workspace[1u << 20];
static sv_status (*replace)(void *self, sv_err *err);
static long n_readings;

// Means as they were when an exposure's turn ended, at its time.
static struct {
  sv_ns time_ns;
  float mean[N_GAUSSIANS][3];
} noted[CAP_NOTED];
static int n_noted;

static sv_ns now_ns(void *self) {
  (void)self;
  return w.machine_ns + (sv_ns)(EXPOSURE_S * 1e9 / STEPS_EACH) * (sv_ns)world_stats(&w).step +
         1000 * n_readings++;
}

static void note(void) {
  const sv_ns newest_ns = sv_app_newest_ns(&w.app);
  const sv_gaussians *g = &w.app.trainer.g;
  if (n_noted && noted[n_noted - 1].time_ns == newest_ns) return;
  assert_true(n_noted < CAP_NOTED);
  noted[n_noted].time_ns = newest_ns;
  sv_train_set_time(&w.app.trainer, sv_app_time_of(&w.app, newest_ns));
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int k = 0; k < 3; k++) {
      const float *p = sv_gaussians_at(g, i, k);
      noted[n_noted].mean[i][k] = i < g->n_moved ? g->moved[p - g->param] : *p;
    }
  n_noted++;
}

static sv_status note_and_replace(void *self, sv_err *err) {
  note();
  return replace(self, err);
}

static void open_live(const char *spec, double history_s) {
  world_open_well(&w, spec, 4, ~0u, 1);
  w.cfg.is_dynamic = w.cfg.is_continuous = true;
  w.cfg.exposure_s = EXPOSURE_S;
  w.cfg.history_s = history_s;
  w.cfg.steps = N_EXPOSURES * STEPS_EACH;
  w.cfg.train.n_gaussians = N_GAUSSIANS;
  w.cfg.train.sh_degree = 0;
  w.port.machine.now_ns = now_ns;
  n_readings = n_noted = 0;
  assert_ok(world_init(&w), &w.err);
  replace = w.app.capture.cfg.calls.replace;
  w.app.capture.cfg.calls.replace = note_and_replace;
}

static void run(void) {
  const size_t used = w.arena.used_bytes;
  const sv_history *h = &w.app.moving.history;
  assert_ok(sv_app_run(&w.app, &w.err), &w.err);
  note();
  assert_int_equal(w.arena.used_bytes, used);
  assert_true(sv_history_used_bytes(h) <= h->cap_bytes);
  const sv_ledger l = sv_sync_ledger_sum(&w.app.queue.sync);
  assert_true(sv_ledger_is_exact(&l) && l.pending == 0);
}

static void open_file(sv_sequence_reader *r) {
  const world_file *f = world_find(&w, "model.svseq");
  assert_non_null(f);
  assert_true(f->bytes <= sv_history_cap_file_bytes(&w.app.moving.history.cfg));
  assert_true(f->bytes >= sv_history_used_bytes(&w.app.moving.history));
  assert_ok(sv_sequence_open(r, &(sv_file_data){"model.svseq", f->data, f->bytes}, &w.err), &w.err);
  assert_true(sv_sequence_reader_bytes(&r->head) <= sizeof workspace);
  assert_ok(sv_sequence_read_base(r, workspace, &w.err), &w.err);
}

static const float (*noted_at(sv_ns time_ns))[3] {
  for (int i = 0; i < n_noted; i++)
    if (noted[i].time_ns == time_ns) return (const float(*)[3])noted[i].mean;
  return NULL;
}

// How many frames are those of exposures; each is as it was.
static int check_frames(sv_sequence_reader *r) {
  const sv_history *h = &w.app.moving.history;
  const double most = 0.51 * (double)sv_sequence_step(&r->head, 0);
  int n = 0;
  for (int k = h->n_frames - 1; k >= 0; k--) { // backwards, as somebody who scrubs
    const float(*mean)[3] = noted_at(sv_history_time_ns(h, k));
    if (!mean) continue;
    n++;
    assert_ok(sv_sequence_read_frame(r, (uint32_t)k, &w.err), &w.err);
    for (uint32_t i = 0; i < N_GAUSSIANS; i++) {
      sv_gaussian g;
      sv_sequence_get(r, i, &g);
      for (int c = 0; c < 3; c++) assert_near((double)g.mean[c], (double)mean[i][c], most);
    }
  }
  return n;
}

TEST(shows_the_last_exposures_as_they_were) {
  sv_sequence_reader r;
  open_live("moving,rig=stereo,size=64x48,arc=0,fps=10", HISTORY_S);
  run();
  const sv_history *h = &w.app.moving.history;
  print_message("%d exposures; %d frames of %.1f s in %zu of %zu bytes\n", n_noted, h->n_frames,
                (double)(sv_history_time_ns(h, h->n_frames - 1) - sv_history_time_ns(h, 0)) * 1e-9,
                sv_history_used_bytes(h), h->cap_bytes);
  assert_true(n_noted > 2 * HISTORY_S / EXPOSURE_S);
  open_file(&r);
  assert_int_equal(r.head.n_frames, h->n_frames);
  assert_true((double)r.head.seconds >= HISTORY_S && (double)r.head.seconds < 2.5 * HISTORY_S);
  assert_int_equal(sv_history_time_ns(h, h->n_frames - 1), noted[n_noted - 1].time_ns);
  assert_int_equal(check_frames(&r), h->n_frames);
  world_close(&w);
}

// Cameras at half the rate: in between stands the frame before, so that time runs evenly.
TEST(gaps_are_filled) {
  sv_sequence_reader r;
  open_live("moving,rig=stereo,size=64x48,arc=0,fps=5", HISTORY_S);
  run();
  const sv_history *h = &w.app.moving.history;
  open_file(&r);
  const double period_s = (double)r.head.seconds / (double)(r.head.n_frames - 1);
  assert_near(period_s, EXPOSURE_S, 0.01);
  const int n = check_frames(&r);
  assert_true(n > h->n_frames / 3 && n < h->n_frames * 2 / 3);
  world_close(&w);
}

TEST(none_is_asked_for) {
  open_live("moving,rig=stereo,size=64x48,arc=0,fps=10", 0);
  assert_int_equal(w.app.moving.history.cap_bytes, 0);
  world_forget_files(&w);
  run();
  assert_null(world_find(&w, "model.svseq"));
  world_close(&w);
}

// A plan counts the ring.
TEST(plan_counts_it) {
  world_open_well(&w, "moving,rig=stereo,size=64x48,arc=0", 4, ~0u, 1);
  w.cfg.is_dynamic = w.cfg.is_continuous = true;
  w.cfg.exposure_s = EXPOSURE_S;
  w.cfg.train.n_gaussians = N_GAUSSIANS;
  const size_t without = world_app_bytes(&w);
  w.cfg.history_s = 100;
  const size_t with = world_app_bytes(&w);
  assert_true(with - without >= (size_t)(100 / EXPOSURE_S) * N_GAUSSIANS * SV_HISTORY_GAUSSIAN_BYTES);
  world_close(&w);
}

TEST(so_does_the_command) {
  char out[8192];
  assert_int_equal(
      shell_read(out, sizeof out, "$SV_EMULATE $SV_BIN/subview plan --images 16 --size 320x240 2>&1"), 0);
  assert_null(strstr(out, "history"));
  assert_int_equal(shell_read(out, sizeof out,
                              "$SV_EMULATE $SV_BIN/subview plan --images 16 --size 320x240 --gaussians 10000 "
                              "--sh 0 --history 10 2>&1"),
                   0);
  assert_non_null(strstr(out, "history"));
  assert_int_equal(shell_read(out, sizeof out, "$SV_EMULATE $SV_BIN/subview plan --history 10 --mesh 2>&1"),
                   2);
  assert_int_equal(
      shell_read(out, sizeof out,
                 "$SV_EMULATE $SV_BIN/subview run --source sim:moving --out none --history 10 2>&1"),
      2);
  assert_non_null(strstr(out, "--history: only with --scene dynamic and --live"));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(shows_the_last_exposures_as_they_were),
                                     cmocka_unit_test(gaps_are_filled), cmocka_unit_test(none_is_asked_for),
                                     cmocka_unit_test(plan_counts_it), cmocka_unit_test(so_does_the_command)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
