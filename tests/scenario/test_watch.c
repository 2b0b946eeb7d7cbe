// SPDX-License-Identifier: Apache-2.0
// A run that is stopped from outside: the page's state calls it stale, and the system watchdog gets
// no sign of life, until it goes on. A processor that gets hot: training rests before frames are
// lost.
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "tests/common/live_run.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

static char root[256];
static live_run r;
static uint8_t answer[1u << 20];

// --- a run that is stopped -----------------------------------------------------------------------

static const char *state_of_run(void) {
  live_run_get(&r, "/state", NULL, answer, sizeof answer);
  return (const char *)answer;
}

static bool wait_for(const char *text, double seconds) {
  for (int i = 0; i < 20 * seconds; i++, poll(NULL, 0, 50))
    if (strstr(state_of_run(), text)) return true;
  return false;
}

static int open_socket(const char *path) {
  struct sockaddr_un a = {.sun_family = AF_UNIX};
  assert_true(strlen(path) < sizeof a.sun_path);
  memcpy(a.sun_path, path, strlen(path));
  int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  assert_true(fd >= 0 && bind(fd, (struct sockaddr *)&a, sizeof a) == 0);
  return fd;
}

// Datagrams with this text within the time.
static int n_of(int fd, const char *text, int ms) {
  char got[128];
  int n = 0;
  const sv_clock c = sv_linux_clock();
  for (sv_ns end = c.now_ns(c.self) + ms * SV_NS_PER_MS; c.now_ns(c.self) < end; poll(NULL, 0, 20))
    for (ssize_t m; (m = recv(fd, got, sizeof got - 1, 0)) >= 0;) {
      got[m] = 0;
      n += !strcmp(got, text);
    }
  return n;
}

TEST(test_stopped) {
  char path[300];
  snprintf(path, sizeof path, "%s/notify", root);
  int fd = open_socket(path);
  setenv("NOTIFY_SOCKET", path, 1);
  setenv("WATCHDOG_USEC", "1000000", 1);
  bool is_started =
      live_run_start(&r, root,
                     "--source sim:textured,rig=stereo,size=96x64 --exposures 4 --gaussians 1500 "
                     "--threads 2 --time-limit 600");
  unsetenv("NOTIFY_SOCKET");
  unsetenv("WATCHDOG_USEC");
  if (!is_started) fail_msg("the run does not start: %s", r.err);
  assert_true(wait_for("\"state\":\"training\"", 30));
  assert_true(n_of(fd, "READY=1", 200) == 1);
  assert_in_range(n_of(fd, "WATCHDOG=1", 2000), 2, 9); // every 250 ms
  assert_non_null(strstr(state_of_run(), "\"stale_s\":0,"));
  assert_non_null(strstr(state_of_run(), "{\"name\":\"main\",\"age_s\":0."));
  assert_non_null(strstr(state_of_run(), "{\"name\":\"pool 1\",\"age_s\":0."));

  assert_int_equal(kill(r.pid, SIGSTOP), 0);
  (void)n_of(fd, "", 200);
  assert_int_equal(n_of(fd, "WATCHDOG=1", 1000), 0);
  assert_true(wait_for("\"stale_s\":5,\"stale_thread\":\"", 10));
  assert_true(wait_for("\"stale_s\":6,\"stale_thread\":\"", 5));

  assert_int_equal(kill(r.pid, SIGCONT), 0);
  assert_true(wait_for("\"stale_s\":0,\"stale_thread\":\"\"", 5));
  assert_true(n_of(fd, "WATCHDOG=1", 2000) >= 2);
  assert_int_equal(kill(r.pid, SIGINT), 0);
  assert_int_equal(n_of(fd, "STOPPING=1", 3000), 1);
  assert_int_equal(live_run_stop(&r), 0);
  close(fd);
}

// --- heat ----------------------------------------------------------------------------------------
// A processor whose temperature follows its load: 40 degrees at rest, 100 under full load, with a
// time constant of 6 s. From 85 degrees on it is five times as slow, until it is below 80.
#define WORK_NS  (2 * SV_NS_PER_MS) // of each job of the pool: a step has about ten
#define REST_C   40.0
#define LOAD_C   60.0
#define TAU_S    6.0
#define LIMIT_C  85.0
#define RETURN_C 80.0

static world w;
static sv_pool inner;
static struct {
  double c, hottest_c;
  bool is_slow;
  long n_slow;
} heat;

static void pass(sv_ns ns, double load) {
  const double target_c = REST_C + LOAD_C * load, s = sv_ns_to_s(ns);
  heat.c += (target_c - heat.c) * (s < TAU_S ? s / TAU_S : 1);
  if (heat.c > heat.hottest_c) heat.hottest_c = heat.c;
  if (heat.c >= LIMIT_C) heat.is_slow = true;
  if (heat.c < RETURN_C) heat.is_slow = false;
  w.machine_ns += ns;
}

static void work(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  (void)self;
  sv_pool_run(&inner, fn, arg, n_tasks);
  heat.n_slow += heat.is_slow;
  pass(heat.is_slow ? 5 * WORK_NS : WORK_NS, 1);
}
static sv_ns read_clock(void *self) {
  (void)self;
  pass(10000, 1);
  return w.machine_ns;
}
static void rest_until(void *self, sv_ns until_ns) {
  (void)self;
  if (until_ns > w.machine_ns) pass(until_ns - w.machine_ns, 0);
}
static sv_heat read_heat(void *self) {
  (void)self;
  return (sv_heat){.temperature_c = heat.c, .is_throttled = heat.is_slow};
}

// A live run of so many seconds; returns the frames that it lost.
static uint64_t run_hot(bool has_thermometer) {
  memset(&heat, 0, sizeof heat);
  heat.c = REST_C;
  world_open_well(&w, "textured,rig=stereo,size=32x24,fps=30,buffers=8", 3, ~0u, 1);
  w.cfg.train.n_gaussians = 100;
  w.cfg.is_continuous = true;
  w.cfg.preview_every_s = 1;
  w.cfg.time_limit_s = 90;
  w.cfg.steps = 0;
  w.port.machine = (sv_clock){NULL, read_clock, rest_until};
  inner = w.port.pool;
  w.port.pool.run = work;
  if (has_thermometer) w.port.thermometer = (sv_thermometer){NULL, read_heat};
  world_run_well(&w);
  const uint64_t n_lost = sv_sync_ledger(&w.app.queue.sync, 0)->dropped[SV_DROP_OVERLOAD];
  print_message("%s: at most %.1f C, slow in %ld jobs, %llu frames lost, %u steps, duty %.2f\n",
                has_thermometer ? "heeded" : "ignored", heat.hottest_c, heat.n_slow,
                (unsigned long long)n_lost, world_stats(&w).step, w.app.capture.governor.duty);
  return n_lost;
}

TEST(test_hot) {
  uint64_t n_lost = run_hot(false);
  const uint32_t n_steps = world_stats(&w).step;
  assert_true(n_lost > 20);
  assert_true(heat.n_slow > 100);
  world_close(&w);
  assert_int_equal(run_hot(true), 0);
  assert_int_equal(heat.n_slow, 0); // it rested in time
  assert_true(heat.hottest_c < LIMIT_C);
  assert_true(w.app.capture.governor.least_duty < 0.9);
  assert_true(world_stats(&w).step > n_steps / 2);
  assert_true(world_has_line(&w, "training rests at times so that it does not slow down and lose frames"));
  world_close(&w);
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "watch"); }
FIXTURE(stop) {
  if (r.pid > 0) kill(r.pid, SIGCONT);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_stopped, stop),
      cmocka_unit_test(test_hot),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
