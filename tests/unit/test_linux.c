// SPDX-License-Identifier: Apache-2.0
// The Linux machine: pool, store, console, clock. The system calls of a save are replaced here, so
// each of them can fail, be cut short, be interrupted, or be the last thing the process does.
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "tests/common/test.h"
#include "tests/fault/heap_count.h"
#include "src/base/str.h"

// --- replaced system calls -----------------------------------------------------------------------
static int g_i_call, g_fail_at = -1, g_fail_errno, g_die_at = -1;
static bool g_is_short, g_is_interrupted;

// True when this call is to fail.
static bool is_hit(void) {
  int i = g_i_call++;
  if (i == g_die_at) _exit(42);
  return i == g_fail_at;
}

ssize_t write(int fd, const void *buf, size_t n) {
  if (fd > 2 && is_hit()) {
    errno = g_fail_errno;
    return -1;
  }
  if (fd > 2 && g_is_interrupted && g_i_call % 2) {
    errno = EINTR;
    return -1;
  }
  if (fd > 2 && g_is_short && n > 1) n = n / 2;
  return syscall(SYS_write, fd, buf, n);
}

int fsync(int fd) {
  if (is_hit()) {
    errno = g_fail_errno;
    return -1;
  }
  if (g_is_interrupted && g_i_call % 2) {
    errno = EINTR;
    return -1;
  }
  return (int)syscall(SYS_fsync, fd);
}

int renameat(int from_fd, const char *from, int to_fd, const char *to) {
  if (is_hit()) {
    errno = g_fail_errno;
    return -1;
  }
  return (int)syscall(SYS_renameat, from_fd, from, to_fd, to);
}

// A file system without hard links.
static bool g_is_without_links;
int linkat(int from_fd, const char *from, int to_fd, const char *to, int flags) {
  if (is_hit() || g_is_without_links) {
    errno = g_is_without_links ? EPERM : g_fail_errno;
    return -1;
  }
  return (int)syscall(SYS_linkat, from_fd, from, to_fd, to, flags);
}

// --- pool ----------------------------------------------------------------------------------------
typedef struct {
  _Atomic int n_runs[4096];
  _Atomic int in_use[SV_LINUX_CAP_THREADS];
  int n_threads;
  _Atomic int n_bad;
  int payload[4096];
} job_t;

static void task(void *arg, int i_task, int i_thread) {
  job_t *j = arg;
  if (i_thread < 0 || i_thread >= j->n_threads || j->in_use[i_thread]++) j->n_bad++;
  j->n_runs[i_task]++;
  j->payload[i_task] += i_task; // plain memory: the pool must order it between jobs
  for (volatile int k = 0; k < (i_task & 15) * 10; k++) {
  }
  j->in_use[i_thread]--;
}

TEST(pool_runs_each_task_once) {
  static const int threads[] = {1, 2, 4};
  for (int t = 0; t < 3; t++) {
    static sv_linux_pool pool;
    sv_err err;
    assert_int_equal(sv_linux_pool_start(&pool, threads[t], t == 2 ? 0 : -1, &err), SV_OK);
    sv_pool p = sv_linux_pool_port(&pool);
    assert_int_equal(p.n_threads, threads[t]);
    static job_t job;
    memset(&job, 0, sizeof job);
    job.n_threads = threads[t];
    long n_sum = 0;
    static int want[4096];
    memset(want, 0, sizeof want);
    for (int i = 0; i < 20000; i++) {
      int n = i % 50 == 0 ? 1000 : i % 7; // large after small and small after large, also none
      sv_pool_run(&p, task, &job, n);
      for (int k = 0; k < n; k++) want[k]++;
      n_sum += n;
      if (i % 1000 == 0) usleep(300); // lets the workers fall asleep
    }
    for (int k = 0; k < 4096; k++) {
      assert_int_equal(job.n_runs[k], want[k]);
      assert_int_equal(job.payload[k], want[k] * k);
      n_sum -= want[k];
    }
    assert_int_equal(n_sum, 0);
    assert_int_equal(job.n_bad, 0);
    sv_linux_pool_stop(&pool);
  }
}

TEST(pool_refuses_bad_counts) {
  static sv_linux_pool pool;
  sv_err err;
  assert_int_equal(sv_linux_pool_start(&pool, 0, -1, &err), SV_E_ARG);
  assert_int_equal(sv_linux_pool_start(&pool, SV_LINUX_CAP_THREADS + 1, -1, &err), SV_E_ARG);
}

static void empty(void *arg, int i_task, int i_thread) { (void)arg, (void)i_task, (void)i_thread; }

static void busy_25us(void *arg, int i_task, int i_thread) {
  (void)i_task, (void)i_thread;
  sv_clock *c = arg;
  for (sv_ns end = c->now_ns(c->self) + 25000; c->now_ns(c->self) < end;) {
  }
}

static int by_value(const void *a, const void *b) {
  sv_ns x = *(const sv_ns *)a, y = *(const sv_ns *)b;
  return x < y ? -1 : x > y;
}

TEST(pool_overhead_is_small) {
  static sv_linux_pool pool;
  static sv_ns t[20000];
  sv_err err;
  sv_clock c = sv_linux_clock();
  assert_int_equal(sv_linux_pool_start(&pool, 2, -1, &err), SV_OK);
  sv_pool p = sv_linux_pool_port(&pool);
  for (int i = 0; i < 20000; i++) {
    sv_ns t0 = c.now_ns(c.self);
    sv_pool_run(&p, empty, NULL, 2);
    t[i] = c.now_ns(c.self) - t0;
  }
  qsort(t, 20000, sizeof t[0], by_value);
  print_message("empty run of 2 tasks on 2 threads, hot: median %lld ns, p90 %lld ns\n", (long long)t[10000],
                (long long)t[18000]);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  assert_true(t[10000] < 5000);
#endif
  for (int i = 0; i < 500; i++) { // 50 us of work every 300 us
    usleep(250);
    sv_ns t0 = c.now_ns(c.self);
    sv_pool_run(&p, busy_25us, &c, 2);
    t[i] = c.now_ns(c.self) - t0;
  }
  qsort(t, 500, sizeof t[0], by_value);
  print_message(
      "two tasks of 25 us after 250 us of rest: median %lld ns (25000 is ideal, 50000 is one thread)\n",
      (long long)t[250]);
  sv_linux_pool_stop(&pool);
}

TEST(pool_makes_no_heap_calls) {
  static sv_linux_pool pool;
  static job_t job;
  sv_err err;
  memset(&job, 0, sizeof job);
  job.n_threads = 3;
  assert_int_equal(sv_linux_pool_start(&pool, 3, -1, &err), SV_OK);
  sv_pool p = sv_linux_pool_port(&pool);
  sv_heap_arm();
  for (int i = 0; i < 1000; i++) sv_pool_run(&p, task, &job, 10);
  sv_heap_disarm();
  sv_heap_report();
  assert_int_equal(sv_heap_count(), 0);
  sv_linux_pool_stop(&pool);
}

// --- store ---------------------------------------------------------------------------------------
static char g_dir[64];

FIXTURE(setup) {
  strcpy(g_dir, "/tmp/sv_test_linux_XXXXXX");
  return mkdtemp(g_dir) ? 0 : -1;
}

FIXTURE(teardown) {
  char cmd[128];
  snprintf(cmd, sizeof cmd, "rm -rf '%s'", g_dir);
  return system(cmd);
}

static void reset_faults(void) {
  g_i_call = 0;
  g_fail_at = g_die_at = -1;
  g_is_short = g_is_interrupted = false;
}

static sv_status save(sv_store *s, const char *name, char fill, sv_err *err) {
  static char data[10000];
  memset(data, fill, sizeof data);
  sv_status st = s->begin(s->self, name, err);
  if (st < 0) return st;
  for (int i = 0; i < 4 && st == SV_OK; i++) st = s->write(s->self, data, sizeof data, err);
  sv_err second;
  sv_status st2 = s->commit(s->self, st < 0 ? &second : err);
  return st < 0 ? st : st2;
}

// The fill byte of a whole file, 0 when it is not there, -1 when it is torn.
static int content(sv_store *s, const char *name) {
  static char data[50000];
  size_t n;
  sv_err err;
  sv_status st = s->read(s->self, name, data, sizeof data, &n, &err);
  if (st == SV_E_NOT_FOUND) return 0;
  if (st < 0 || n != 40000) return -1;
  for (size_t i = 1; i < n; i++)
    if (data[i] != data[0]) return -1;
  return data[0];
}

static void open_store(sv_linux_store *ls, sv_store *s, const char *sub) {
  char path[128];
  sv_err err;
  sv_fmt(path, sizeof path, "%s/%s", g_dir, sub);
  reset_faults();
  assert_int_equal(sv_linux_store_open(ls, path, &err), SV_OK);
  *s = sv_linux_store_port(ls);
}

TEST(store_round_trip) {
  sv_linux_store ls;
  sv_store s;
  sv_err err;
  open_store(&ls, &s, "a/b/c"); // parents are made
  assert_int_equal(content(&s, "x.bin"), 0);
  assert_int_equal(save(&s, "x.bin", 'a', &err), SV_OK);
  assert_int_equal(content(&s, "x.bin"), 'a');
  g_is_short = g_is_interrupted = true;
  assert_int_equal(save(&s, "x.bin", 'b', &err), SV_OK);
  reset_faults();
  assert_int_equal(content(&s, "x.bin"), 'b');
  char small[10];
  size_t n;
  assert_int_equal(s.read(s.self, "x.bin", small, sizeof small, &n, &err), SV_E_NOMEM);
  assert_int_equal(n, 40000); // tells how much is needed
  assert_int_equal(s.begin(s.self, "y.bin", &err), SV_OK);
  assert_int_equal(s.begin(s.self, "z.bin", &err), SV_E_ARG); // one at a time
  s.abandon(s.self);
  assert_int_equal(content(&s, "y.bin"), 0);
  assert_int_equal(s.write(s.self, small, 1, &err), SV_E_ARG);
  assert_int_equal(s.commit(s.self, &err), SV_E_ARG);
  sv_linux_store_close(&ls);
}

TEST(store_refuses_bad_names) {
  sv_linux_store ls;
  sv_store s;
  sv_err err;
  open_store(&ls, &s, "n");
  char name[300];
  memset(name, 'x', sizeof name);
  name[299] = 0;
  const char *bad[] = {"", ".", "..", "../x", "a/b", "/x", "a\\b", ".x", name};
  for (int i = 0; i < 9; i++) assert_int_equal(s.begin(s.self, bad[i], &err), SV_E_ARG);
  sv_linux_store_close(&ls);
  assert_int_equal(sv_linux_store_open(&ls, "/dev/null/x", &err), SV_E_IO);
  assert_contains(err.text, "/dev/null");
}

TEST(store_failure_at_every_call) {
  sv_linux_store ls;
  sv_store s;
  sv_err err;
  open_store(&ls, &s, "f");
  assert_int_equal(save(&s, "x.bin", 'a', &err), SV_OK);
  int n_failed = 0;
  for (int i = 0;; i++) {
    reset_faults();
    g_fail_at = i;
    g_fail_errno = ENOSPC;
    sv_status st = save(&s, "x.bin", 'b', &err);
    int n_calls = g_i_call;
    reset_faults();
    if (i >= n_calls) break; // the fault was never reached
    assert_int_equal(st, SV_E_IO);
    assert_contains(err.text, "the disk is full");
    int c = content(&s, "x.bin");
    bool is_last = i == 6; // the sync of the folder, after the rename
    assert_int_equal(c, is_last ? 'b' : 'a');
    n_failed++;
  }
  assert_int_equal(n_failed, 7); // 4 writes, fsync, rename, fsync of the folder
  sv_linux_store_close(&ls);
}

// What stands in the temporary file's place is not opened, a symbolic link neither.
TEST(store_follows_no_link) {
  sv_linux_store ls;
  sv_store s;
  sv_err err;
  char path[200], kept[16] = "";
  open_store(&ls, &s, "l");
  shell_ok("echo precious > %s/victim && ln -s %s/victim %s/l/x.bin.%ld-0.subview-tmp", g_dir, g_dir, g_dir,
           (long)getpid());
  assert_int_equal(save(&s, "x.bin", 'a', &err), SV_OK);
  assert_int_equal(content(&s, "x.bin"), 'a');
  sv_fmt(path, sizeof path, "%s/victim", g_dir);
  FILE *f = fopen(path, "r");
  assert_non_null(f);
  assert_non_null(fgets(kept, sizeof kept, f));
  fclose(f);
  assert_string_equal(kept, "precious\n");
  sv_linux_store_close(&ls);
}

TEST(store_has_a_lock) {
  sv_linux_store a, b;
  sv_store s;
  sv_err err;
  open_store(&a, &s, "lock");
  open_store(&b, &s, "lock");
  assert_int_equal(sv_linux_store_lock(&a, &err), SV_OK);
  assert_error(sv_linux_store_lock(&b, &err), SV_E_IO, &err, "another program is writing there");
  sv_linux_store_close(&a);
  assert_int_equal(sv_linux_store_lock(&b, &err), SV_OK);
  sv_linux_store_close(&b);
}

// A file of which the one before is kept: at every moment one of both names has a whole file, of
// the newest two, also where there are no hard links.
TEST(two_generations_survive_a_kill_at_every_call) {
  for (int without = 0; without < 2; without++) {
    sv_linux_store ls;
    sv_store s;
    sv_err err;
    open_store(&ls, &s, without ? "g0" : "g1");
    g_is_without_links = without != 0;
    assert_int_equal(save(&s, "x.bin", 'a', &err), SV_OK);
    int n_killed = 0, newest = 'a';
    for (int i = 0; i < 16; i++) {
      const pid_t pid = fork();
      assert_true(pid >= 0);
      if (pid == 0) {
        static char data[40000];
        reset_faults();
        memset(data, 'b' + i, sizeof data);
        g_die_at = i;
        if (s.begin(s.self, "x.bin", &err) < 0 || s.write(s.self, data, sizeof data, &err) < 0) _exit(1);
        _exit(s.commit_over(s.self, "x.1.bin", true, &err) == SV_OK ? 0 : 1);
      }
      int status;
      waitpid(pid, &status, 0);
      assert_true(WIFEXITED(status));
      n_killed += WEXITSTATUS(status) == 42;
      const int x = content(&s, "x.bin"), older = content(&s, "x.1.bin");
      if (x < 0 || older < 0) fail_msg("call %d: torn", i);
      if (x != newest && x != 'b' + i && older != newest) fail_msg("call %d: %d and %d", i, x, older);
      if (x > 0) newest = x;
    }
    assert_true(n_killed >= 5);
    g_is_without_links = false;
    sv_linux_store_close(&ls);
  }
}

TEST(store_survives_a_kill_at_every_call) {
  sv_linux_store ls;
  sv_store s;
  sv_err err;
  open_store(&ls, &s, "k");
  assert_int_equal(save(&s, "x.bin", 'a', &err), SV_OK);
  int n_killed = 0;
  for (int i = 0; i < 20; i++) {
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
      reset_faults();
      g_die_at = i;
      g_is_short = true;
      _exit(save(&s, "x.bin", (char)('b' + i), &err) == SV_OK ? 0 : 1);
    }
    int status;
    waitpid(pid, &status, 0);
    assert_true(WIFEXITED(status));
    int c = content(&s, "x.bin");
    assert_true(c > 0); // old or new, never torn, never gone
    n_killed += WEXITSTATUS(status) == 42;
  }
  assert_true(n_killed >= 7);
  assert_int_equal(save(&s, "x.bin", 'z', &err), SV_OK); // left-overs are no obstacle
  assert_int_equal(content(&s, "x.bin"), 'z');
  sv_linux_store_close(&ls);
}

// --- console and clock ---------------------------------------------------------------------------
static size_t read_pipe(int fd, char *buf, size_t cap) {
  ssize_t n = read(fd, buf, cap - 1);
  buf[n > 0 ? n : 0] = 0;
  return n > 0 ? (size_t)n : 0;
}

TEST(console_lines) {
  reset_faults();
  int fd[2];
  assert_int_equal(pipe(fd), 0);
  fcntl(fd[0], F_SETFL, O_NONBLOCK);
  sv_linux_console lc;
  sv_linux_console_init(&lc, fd[1], false);
  sv_console c = sv_linux_console_port(&lc);
  char buf[4096];
  c.log(c.self, SV_LOG_INFO, "one");
  c.log(c.self, SV_LOG_WARN, "two");
  c.log(c.self, SV_LOG_ERROR, "three");
  read_pipe(fd[0], buf, sizeof buf);
  assert_string_equal(buf, "one\nwarning: two\nerror: three\n");
  for (int i = 0; i < 100; i++) c.log(c.self, SV_LOG_LIVE, "step");
  read_pipe(fd[0], buf, sizeof buf);
  assert_string_equal(buf, "step\n"); // not a terminal: rare lines
  lc.is_terminal = true;
  c.log(c.self, SV_LOG_LIVE, "step 1");
  c.log(c.self, SV_LOG_LIVE, "step 2");
  c.log(c.self, SV_LOG_INFO, "note");
  c.log(c.self, SV_LOG_LIVE, "step 3");
  sv_linux_console_finish(&lc);
  read_pipe(fd[0], buf, sizeof buf);
  assert_string_equal(buf, "\r\x1b[Kstep 1\r\x1b[Kstep 2\r\x1b[Knote\n\r\x1b[Kstep 3\n");
  lc.is_quiet = true;
  c.log(c.self, SV_LOG_INFO, "not seen");
  c.log(c.self, SV_LOG_LIVE, "not seen");
  assert_int_equal(read_pipe(fd[0], buf, sizeof buf), 0);
  char line[3000];
  memset(line, 'x', sizeof line);
  line[2999] = 0;
  c.log(c.self, SV_LOG_ERROR, line); // cut, but a line
  size_t n = read_pipe(fd[0], buf, sizeof buf);
  assert_true(n > 900 && buf[n - 1] == '\n');
  close(fd[0]);
  close(fd[1]);
}

TEST(stop_signals) {
  sv_err err;
  sv_linux_console lc;
  sv_linux_console_init(&lc, 2, false);
  sv_console c = sv_linux_console_port(&lc);
  assert_int_equal(sv_linux_catch_signals(&err), SV_OK);
  assert_false(c.is_stop_requested(c.self));
  raise(SIGINT);
  assert_true(c.is_stop_requested(c.self));
  sv_linux_reset_stop();
  raise(SIGTERM);
  assert_true(c.is_stop_requested(c.self));
  sv_linux_reset_stop();
  for (int i = 0; i < 2; i++) { // a connection that drops is told of twice
    raise(SIGHUP);
    assert_true(c.is_stop_requested(c.self));
  }
  sv_linux_reset_stop();
  signal(SIGHUP, SIG_IGN); // as nohup does
  assert_int_equal(sv_linux_catch_signals(&err), SV_OK);
  raise(SIGHUP);
  assert_false(c.is_stop_requested(c.self));
  signal(SIGHUP, SIG_DFL);
  raise(SIGINT);
  raise(SIGTERM);
  sv_linux_reset_stop();
  pid_t pid = fork();
  if (pid == 0) {
    raise(SIGINT); // both were used up: the usual effect
    _exit(0);
  }
  int status;
  waitpid(pid, &status, 0);
  assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGINT);
}

TEST(clock_sleeps) {
  sv_clock c = sv_linux_clock();
  sv_ns t0 = c.now_ns(c.self);
  c.sleep_until_ns(c.self, t0 + 3 * SV_NS_PER_MS);
  assert_true(c.now_ns(c.self) >= t0 + 3 * SV_NS_PER_MS);
  c.sleep_until_ns(c.self, t0); // the past, and before the epoch: returns at once
  c.sleep_until_ns(c.self, -5);
}

static void *leave_and_take(void *arg) { // in a thread of its own, whose CPUs end with it
  sv_err err = {0};
  const int n = sv_linux_n_cpus(), cpu = *(int *)arg;
  assert_error(sv_linux_leave_cpu(-1, &err), SV_E_RANGE, &err, "not one of the");
  if (n > 1) {
    assert_ok(sv_linux_leave_cpu(cpu, &err), &err);
    assert_int_equal(sv_linux_n_cpus(), n - 1);
    assert_error(sv_linux_leave_cpu(cpu, &err), SV_E_RANGE, &err, "not one of the");
  }
  assert_int_equal(sv_linux_take_cpu(cpu), SV_OK);
  assert_int_equal(sv_linux_n_cpus(), 1);
  assert_error(sv_linux_leave_cpu(cpu, &err), SV_E_RANGE, &err, "is the only one");
  assert_int_equal(sv_linux_take_cpu(-1), SV_E_ARG);
  return NULL;
}

TEST(cpus) {
  pthread_t id;
  char sys[300], path[400];
  int first = sv_linux_camera_cpu("/nowhere"), last = first;
  assert_true(first >= 0);
  assert_int_equal(pthread_create(&id, NULL, leave_and_take, &first), 0);
  assert_int_equal(pthread_join(id, NULL), 0);
  // A machine with slow CPUs: the first of them, here the last that this program may use.
  assert_int_equal(temp_folder_make(sys, sizeof sys, "sys"), 0);
  for (int i = first + 1; i < first + 64; i++) {
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) == 0 && CPU_ISSET(i, &set)) last = i;
  }
  snprintf(path, sizeof path, "%s/devices/system/cpu/cpu%d", sys, last);
  shell_ok("mkdir -p %s && echo 414 > %s/cpu_capacity", path, path);
  assert_int_equal(sv_linux_camera_cpu(sys), last);
  (void)temp_folder_remove(sys);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(pool_runs_each_task_once),
      cmocka_unit_test(pool_refuses_bad_counts),
      cmocka_unit_test(pool_overhead_is_small),
      cmocka_unit_test(pool_makes_no_heap_calls),
      cmocka_unit_test(store_round_trip),
      cmocka_unit_test(store_refuses_bad_names),
      cmocka_unit_test(store_failure_at_every_call),
      cmocka_unit_test(store_follows_no_link),
      cmocka_unit_test(store_has_a_lock),
      cmocka_unit_test(two_generations_survive_a_kill_at_every_call),
      cmocka_unit_test(store_survives_a_kill_at_every_call),
      cmocka_unit_test(console_lines),
      cmocka_unit_test(stop_signals),
      cmocka_unit_test(clock_sleeps),
      cmocka_unit_test(cpus),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
