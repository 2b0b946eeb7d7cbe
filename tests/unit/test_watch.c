// SPDX-License-Identifier: Apache-2.0
// Who watches a run: heartbeats of threads that work, rest or hang; the datagrams that a system
// watchdog gets, on a socket of the test's own; temperature and throttling from a folder like /sys.
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/linux/watch.h"
#include "src/capture/governor.h"
#include "tests/common/test.h"

#define MS SV_NS_PER_MS

static char root[256];

// --- heartbeats ----------------------------------------------------------------------------------

static sv_ns now;
static sv_ns read_now(void *self) {
  (void)self;
  return now;
}

static sv_beat_of beats[SV_CAP_BEATS];
static sv_heartbeats make(void) {
  memset(beats, 0, sizeof beats);
  now = 1000 * MS;
  return (sv_heartbeats){.clock = {NULL, read_now, NULL}, .beats = beats};
}

TEST(test_ages) {
  sv_heartbeats h = make();
  sv_ns age_ns;
  char name[16];
  sv_beat(NULL, SV_BEAT_MAIN);
  sv_beat(&h, SV_CAP_BEATS);
  sv_beat(&h, -1);
  (void)sv_beat_oldest(beats, now, &age_ns);
  assert_int_equal(age_ns, 0); // nobody has begun
  sv_beat(&h, SV_BEAT_MAIN);
  sv_beat(&h, SV_BEAT_POOL + 1);
  now += 30 * MS;
  sv_beat(&h, SV_BEAT_MAIN);
  now += 10 * MS;
  assert_int_equal(sv_beat_age_ns(beats, SV_BEAT_MAIN, now), 10 * MS);
  assert_int_equal(sv_beat_longest_ns(beats, SV_BEAT_MAIN), 30 * MS);
  sv_beat_name(sv_beat_oldest(beats, now, &age_ns), name);
  assert_string_equal(name, "pool 2");
  assert_int_equal(age_ns, 40 * MS);
  sv_beat_rest(&h, SV_BEAT_POOL + 1); // without work it cannot be late
  sv_beat_name(sv_beat_oldest(beats, now, &age_ns), name);
  assert_string_equal(name, "main");
  now += 500 * MS;
  sv_beat(&h, SV_BEAT_POOL + 1);
  assert_int_equal(sv_beat_longest_ns(beats, SV_BEAT_POOL + 1), 0); // rest is no gap
  // Work without beats of its own
  sv_beat_for(&h, SV_BEAT_POOL + 1, 900 * MS);
  now += 800 * MS;
  assert_int_equal(sv_beat_age_ns(beats, SV_BEAT_POOL + 1, now), 0);
  now += 150 * MS;
  assert_int_equal(sv_beat_age_ns(beats, SV_BEAT_POOL + 1, now), 50 * MS);
  sv_beat_for(&h, SV_BEAT_POOL + 1, 900 * MS);
  sv_beat(&h, SV_BEAT_POOL + 1);
  assert_int_equal(sv_beat_longest_ns(beats, SV_BEAT_POOL + 1), 50 * MS);
  sv_beat_for(NULL, SV_BEAT_MAIN, MS);
  sv_beat_for(&h, SV_CAP_BEATS, MS);
}

// --- a pool with a thread that hangs ------------------------------------------------------------

static atomic_bool is_hanging, is_let_go;
static void hang_in_second_thread(void *arg, int i_task, int i_thread) {
  (void)arg, (void)i_task;
  if (i_thread == 1) {
    atomic_store(&is_hanging, true);
    while (!atomic_load(&is_let_go)) usleep(1000);
  } else {
    while (!atomic_load(&is_hanging)) usleep(1000);
  }
}

static sv_pool watched;
static void *run_job(void *arg) {
  sv_pool_run(&watched, hang_in_second_thread, arg, 2);
  return NULL;
}

TEST(test_pool_thread_that_hangs) {
  static sv_linux_pool pool;
  static sv_linux_watch w;
  static sv_watched_pool wp;
  sv_err err;
  sv_clock c = sv_linux_clock();
  pthread_t caller;
  char name[16];
  sv_ns age_ns;
  sv_linux_watch_open(&w, root);
  assert_int_equal(sv_linux_pool_start(&pool, 2, 0, &err), SV_OK);
  sv_pool inner = sv_linux_pool_port(&pool);
  watched = sv_watch_pool(&wp, &inner, NULL);
  assert_true(watched.self == inner.self); // nobody watches
  watched = sv_watch_pool(&wp, &inner, &w.beats);
  assert_int_equal(watched.n_threads, 2);
  assert_int_equal(pthread_create(&caller, NULL, run_job, NULL), 0);
  while (!atomic_load(&is_hanging)) usleep(1000);
  usleep(150000);
  sv_beat(&w.beats, SV_BEAT_MAIN);
  sv_beat_name(sv_beat_oldest(w.beats.beats, c.now_ns(c.self), &age_ns), name);
  assert_string_equal(name, "pool 1");
  assert_true(age_ns > 100 * MS);
  atomic_store(&is_let_go, true);
  pthread_join(caller, NULL);
  assert_int_equal(sv_beat_age_ns(w.beats.beats, SV_BEAT_POOL, c.now_ns(c.self)), 0); // it rests
  assert_true(sv_beat_longest_ns(w.beats.beats, SV_BEAT_POOL) > 100 * MS);
  sv_linux_pool_stop(&pool);
  sv_linux_watch_close(&w);
}

// --- system watchdog -----------------------------------------------------------------------------

static int open_socket(const char *name) {
  struct sockaddr_un a = {.sun_family = AF_UNIX};
  size_t n = strlen(name);
  memcpy(a.sun_path, name, n);
  if (name[0] == '@') a.sun_path[0] = 0;
  int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
  assert_true(fd >= 0);
  assert_int_equal(bind(fd, (struct sockaddr *)&a, (socklen_t)(offsetof(struct sockaddr_un, sun_path) + n)),
                   0);
  return fd;
}

// The next datagram, "" when there is none.
static const char *next(int fd) {
  static char text[128];
  ssize_t n = recv(fd, text, sizeof text - 1, 0);
  text[n > 0 ? n : 0] = 0;
  return text;
}

static void set_environment(const char *socket, const char *usec, const char *pid) {
  setenv("NOTIFY_SOCKET", socket, 1);
  if (usec) setenv("WATCHDOG_USEC", usec, 1);
  if (pid) setenv("WATCHDOG_PID", pid, 1);
}

static void watch_with(const char *socket) {
  static sv_linux_watch w;
  char pid[32];
  int fd = open_socket(socket);
  snprintf(pid, sizeof pid, "%d", (int)getpid());
  set_environment(socket, "400000", pid);
  sv_linux_watch_open(&w, root);
  assert_null(getenv("NOTIFY_SOCKET")); // not for the programs that are started
  assert_null(getenv("WATCHDOG_USEC"));
  assert_string_equal(next(fd), "");
  sv_linux_watch_ready(&w);
  sv_linux_watch_ready(&w);
  assert_string_equal(next(fd), "READY=1");
  assert_string_equal(next(fd), ""); // once
  (void)make();
  w.beats.clock = (sv_clock){NULL, read_now, NULL};
  sv_linux_watch_share(&w, beats);
  sv_beat(&w.beats, SV_BEAT_MAIN);
  assert_string_equal(next(fd), "WATCHDOG=1");
  sv_beat(&w.beats, SV_BEAT_CAMERAS);
  for (int i = 0; i < 10; i++, now += 8 * MS) sv_beat(&w.beats, SV_BEAT_MAIN);
  assert_string_equal(next(fd), ""); // not more often than four times in the interval
  now += 30 * MS;
  sv_beat(&w.beats, SV_BEAT_MAIN);
  assert_string_equal(next(fd), "WATCHDOG=1");
  for (int i = 0; i < 40; i++, now += 10 * MS) sv_beat(&w.beats, SV_BEAT_MAIN);
  assert_string_equal(next(fd), ""); // the cameras' thread hangs: no sign of life any more
  sv_beat(&w.beats, SV_BEAT_CAMERAS);
  sv_beat(&w.beats, SV_BEAT_MAIN);
  assert_string_equal(next(fd), "WATCHDOG=1");
  sv_linux_watch_close(&w);
  assert_string_equal(next(fd), "STOPPING=1");
  close(fd);
}

TEST(test_watchdog) {
  char path[300];
  snprintf(path, sizeof path, "%s/notify", root);
  watch_with(path);
  snprintf(path, sizeof path, "@subview-test-%d", (int)getpid());
  watch_with(path);
}

// READY, but no signs of life: nobody asked, or another process is meant. Names that are no socket.
TEST(test_no_watchdog) {
  static sv_linux_watch w;
  char path[300];
  static const char *const intervals[][2] = {
      {NULL, NULL}, {"0", NULL}, {"-5", NULL}, {"1e9x", NULL}, {"400000", "1"}};
  snprintf(path, sizeof path, "%s/quiet", root);
  int fd = open_socket(path);
  for (int i = 0; i < 5; i++) {
    set_environment(path, intervals[i][0], intervals[i][1]);
    sv_linux_watch_open(&w, root);
    sv_linux_watch_ready(&w);
    sv_beat(&w.beats, SV_BEAT_MAIN);
    assert_string_equal(next(fd), "READY=1");
    assert_string_equal(next(fd), "");
    sv_linux_watch_close(&w);
    (void)next(fd);
  }
  static const char *const bad[] = {"", "@", "relative", "/nowhere/at/all"};
  for (int i = 0; i < 4; i++) {
    set_environment(bad[i], "400000", NULL);
    sv_linux_watch_open(&w, root);
    sv_linux_watch_ready(&w);
    sv_beat(&w.beats, SV_BEAT_MAIN);
    sv_linux_watch_close(&w);
  }
  close(fd);
}

// --- temperature ---------------------------------------------------------------------------------

static void put(const char *path, const char *text) {
  char whole[400];
  snprintf(whole, sizeof whole, "mkdir -p \"$(dirname '%s/%s')\"", root, path);
  assert_int_equal(system(whole), 0);
  snprintf(whole, sizeof whole, "%s/%s", root, path);
  FILE *f = fopen(whole, "w");
  assert_non_null(f);
  fputs(text, f);
  fclose(f);
}

// The share of its time that training keeps after so many seconds of this.
static double duty_after(double c, int is_throttled, int seconds) {
  sv_governor g;
  sv_governor_cfg cfg = sv_governor_defaults(0);
  sv_heat h = {.temperature_c = c, .is_throttled = is_throttled};
  int n_told = 0;
  sv_governor_init(&g, &cfg, 0);
  for (sv_ns t = 0; t <= seconds * SV_NS_PER_S; t += SV_NS_PER_S / 4) n_told += sv_governor_heat(&g, &h, t);
  assert_int_equal(n_told, g.duty < 1);
  assert_true(g.least_duty == g.duty);
  return g.duty;
}

TEST(test_duty) {
  assert_true(duty_after(60, 0, 100) == 1);
  assert_true(duty_after((double)NAN, -1, 100) == 1); // a machine that tells nothing
  assert_true(duty_after(75, 0, 100) == 1);           // between the two limits nothing changes
  assert_true(fabs(duty_after(77, 0, 1) - 0.85) < 1e-9);
  assert_true(fabs(duty_after(90, 0, 100) - 0.1) < 1e-9);
  assert_true(fabs(duty_after(90, 1, 100) - 0.1) < 1e-9);
  // slow for want of power
  assert_true(fabs(duty_after(50, 1, 100) - 0.5) < 1e-9);
  assert_true(fabs(duty_after((double)NAN, 1, 100) - 0.5) < 1e-9);
}

#define THROTTLED "devices/platform/soc/soc:firmware/get_throttled"

TEST(test_temperature) {
  static sv_linux_watch w;
  sv_linux_watch_open(&w, "/nowhere");
  sv_thermometer t = sv_linux_thermometer(&w);
  assert_true(isnan(t.read(t.self).temperature_c));
  assert_int_equal(t.read(t.self).is_throttled, -1);
  sv_linux_watch_close(&w);
  put("class/thermal/thermal_zone0/type", "battery\n");
  put("class/thermal/thermal_zone0/temp", "31000\n");
  put("class/thermal/thermal_zone1/type", "cpu-thermal\n");
  put("class/thermal/thermal_zone1/temp", "78250\n");
  put(THROTTLED, "0\n");
  sv_linux_watch_open(&w, root);
  t = sv_linux_thermometer(&w);
  assert_true(fabs(t.read(t.self).temperature_c - 78.25) < 1e-9); // the processor's, not the first
  assert_int_equal(t.read(t.self).is_throttled, 0);
  put(THROTTLED, "50000\n"); // it was so, and is not now
  assert_int_equal(t.read(t.self).is_throttled, 0);
  put(THROTTLED, "50004\n");
  assert_int_equal(t.read(t.self).is_throttled, 1);
  put("class/thermal/thermal_zone1/temp", "-4500\n");
  assert_true(fabs(t.read(t.self).temperature_c + 4.5) < 1e-9);
  put("class/thermal/thermal_zone1/temp", "hot\n");
  assert_true(isnan(t.read(t.self).temperature_c));
  put("class/thermal/thermal_zone1/temp", "");
  assert_true(isnan(t.read(t.self).temperature_c));
  sv_linux_watch_close(&w);
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "watch"); }
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_ages),        cmocka_unit_test(test_pool_thread_that_hangs),
      cmocka_unit_test(test_watchdog),    cmocka_unit_test(test_no_watchdog),
      cmocka_unit_test(test_temperature), cmocka_unit_test(test_duty),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
