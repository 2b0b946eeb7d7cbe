// SPDX-License-Identifier: Apache-2.0
// The live view under attack while a run goes on: damaged requests, slow and many clients, a server
// that is killed again and again. The run must not notice: the same digest, an exact ledger, no
// memory. SV_LONG=1 runs the long form (1,000,000 damaged requests, 16 clients for 60 s, 100
// kills).
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define BASE "--source sim:textured,rig=stereo,size=96x64 --exposures 4 --gaussians 1500 --threads 1 "

static char root[256];
static live_run r;
static uint8_t answer[4u << 20];

static bool is_long(void) { return getenv("SV_LONG") != NULL; }

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void start(const char *args) {
  if (!live_run_start(&r, root, args)) fail_msg("the run does not start: %s", r.err);
}

static int code_of(const char *method, const char *path, const char *headers) {
  live_run_request(&r, method, path, headers, answer, sizeof answer);
  return live_run_code(answer);
}

// A value of the state's JSON.
static bool state_has(const char *text) {
  return code_of("GET", "/state", NULL) == 200 && strstr((const char *)answer, text) != NULL;
}
static bool wait_for(const char *text, double seconds) {
  for (double until = now_s() + seconds; now_s() < until; poll(NULL, 0, 50))
    if (state_has(text)) return true;
  return false;
}

// --- a run that must not notice ------------------------------------------------------------------

static _Thread_local uint64_t rng = 88172645463325252ull;
static uint32_t rnd(uint32_t n) {
  rng ^= rng << 13;
  rng ^= rng >> 7;
  rng ^= rng << 17;
  return (uint32_t)((rng >> 20) % n);
}

// Damaged requests: many in one connection until the server hangs up. Counted as they go.
static void send_damaged(atomic_long *n) {
  static const char *const parts[] = {"GET ",
                                      "POST ",
                                      "/state",
                                      "/start",
                                      " HTTP/1.1",
                                      "\r\n",
                                      "Host: 127.0.0.1\r\n",
                                      "Content-Length: 99999999\r\n",
                                      "Transfer-Encoding: chunked\r\n",
                                      "\r\n\r\n",
                                      "%00",
                                      "/../..",
                                      "X-Subview-Token: ",
                                      "Cookie: subview=",
                                      "-1",
                                      "ffffffff\r\n",
                                      "?after=-9",
                                      " HTTP/9.9\r\n"};
  int fd = live_run_connect_from(&r, 6);
  if (fd < 0) {
    poll(NULL, 0, 5);
    return;
  }
  for (int k = 0; k < 20; k++) {
    char text[600], back[4096];
    size_t at = 0;
    if (rnd(3))
      at = (size_t)snprintf(text, sizeof text, "GET /state HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n", r.port);
    for (uint32_t i = 0, m = 1 + rnd(5); i < m; i++)
      at += (size_t)snprintf(text + at, sizeof text - at, "%s", parts[rnd(sizeof parts / sizeof *parts)]);
    for (uint32_t i = 0, m = rnd(4); i < m; i++) text[rnd((uint32_t)at)] = (char)rnd(256);
    if (rnd(2)) at += (size_t)snprintf(text + at, sizeof text - at, "\r\n\r\n");
    if (send(fd, text, at, MSG_NOSIGNAL | MSG_DONTWAIT) < 0) break;
    atomic_fetch_add(n, 1);
    ssize_t got = recv(fd, back, sizeof back, MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EAGAIN)) break; // it has hung up, as it should
  }
  close(fd);
}

// Reads "KEY": VALUE of the finished run's report.
static void report_value(const char *folder, const char *key, char out[64]) {
  char path[400], mark[64];
  static char text[64 << 10];
  snprintf(path, sizeof path, "%s/out/run.json", folder);
  FILE *f = fopen(path, "rb");
  size_t n = f ? fread(text, 1, sizeof text - 1, f) : 0;
  if (f) fclose(f);
  text[n] = 0;
  snprintf(mark, sizeof mark, "\"%s\": ", key);
  const char *p = strstr(text, mark);
  snprintf(out, 64, "%.*s", p ? (int)strcspn(p + strlen(mark), ",\n}") : 0, p ? p + strlen(mark) : "");
  if (strcmp(key, "is_exact") == 0 && strstr(text, "\"is_exact\": false")) snprintf(out, 64, "false");
}

// Steps that keep this machine busy for about so long.
static int steps_for(double seconds) {
  const int n = 500;
  char args[256];
  snprintf(args, sizeof args, BASE "--steps %d", n);
  double begin = now_s();
  start(args);
  assert_int_equal(live_run_wait(&r, 60), 0);
  return (int)(n * seconds / (now_s() - begin)) + n;
}

#define N_SLOW    64
#define N_READERS 16

typedef struct {
  long n_damaged, n_good, rss_kib, half_rss_kib,
      most_rss_kib; // at first; at most in the first half, and at all
  int n_kills, n_reopened;
  double seconds;
} storm;

// The attackers have other addresses than those whose requests must be answered.
static void begin_slow(int *fd, int i) { // begins a request and never ends it
  *fd = live_run_connect_from(&r, 2 + i % 3);
  if (*fd >= 0) (void)!send(*fd, "GET /state HTTP/1.1\r\nX: ", 24, MSG_NOSIGNAL);
}

static void begin_reader(int *fd, int i) { // opens a stream and hardly reads
  char text[128];
  int n = snprintf(text, sizeof text, "GET %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n",
                   i % 2 ? "/stream" : "/cameras", r.port);
  if ((*fd = live_run_connect_from(&r, 5)) >= 0) (void)!send(*fd, text, (size_t)n, MSG_NOSIGNAL);
}

// The server hangs up on those that are too slow, and dies at times: they come again.
static void keep_clients(int *slow, int *readers, storm *t) {
  for (int i = 0; i < N_SLOW + N_READERS; i++) {
    int *fd = i < N_SLOW ? &slow[i] : &readers[i - N_SLOW];
    ssize_t got = *fd < 0 ? 0 : recv(*fd, answer, 4096, MSG_DONTWAIT);
    if (got > 0 || (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))) continue;
    if (*fd >= 0) close(*fd);
    if (i < N_SLOW) begin_slow(fd, i);
    else begin_reader(fd, i);
    t->n_reopened++;
  }
}

// Those that send damaged requests and the one that kills have threads of their own: a client may
// have to wait for its turn, and holds up nobody else then.
#define N_SENDERS 4
typedef struct {
  double gap_s; // from one kill to the next
  int n_kills_wanted, n_started;
  atomic_int n_kills, n_seeds;
  atomic_long n_damaged;
  atomic_bool is_over;
  pthread_t threads[N_SENDERS + 1];
} attackers;

static void *send_on_and_on(void *context) {
  attackers *a = context;
  rng += (uint64_t)atomic_fetch_add(&a->n_seeds, 1) << 32; // every sender its own
  while (!atomic_load(&a->is_over)) send_damaged(&a->n_damaged);
  return NULL;
}

static void *kill_servers(void *context) {
  attackers *a = context;
  while (!atomic_load(&a->is_over) && atomic_load(&a->n_kills) < a->n_kills_wanted) {
    pid_t server = live_run_server(&r);
    if (server > 0 && kill(server, SIGKILL) == 0) atomic_fetch_add(&a->n_kills, 1);
    poll(NULL, 0, (int)(1000 * a->gap_s));
  }
  return NULL;
}

static void attackers_start(attackers *a) {
  const int n_senders = is_long() ? N_SENDERS : 1;
  for (int i = 0; i <= n_senders; i++)
    assert_int_equal(pthread_create(&a->threads[a->n_started++], NULL, i ? send_on_and_on : kill_servers, a),
                     0);
}
static void attackers_stop(attackers *a) {
  atomic_store(&a->is_over, true);
  while (a->n_started > 0) pthread_join(a->threads[--a->n_started], NULL);
}

// All of it at once on the run that is under way: at least so long, so many damaged requests and
// kills.
static storm attack(double seconds, long n_damaged, int n_kills, double at_most_s) {
  storm t = {.rss_kib = live_run_rss_kib(&r)};
  int slow[N_SLOW], readers[N_READERS];
  attackers a = {.gap_s = seconds / n_kills, .n_kills_wanted = n_kills};
  for (int i = 0; i < N_SLOW; i++) begin_slow(&slow[i], i);
  for (int i = 0; i < N_READERS; i++) begin_reader(&readers[i], i);
  attackers_start(&a);
  for (double begin = now_s(); t.seconds < at_most_s; t.seconds = now_s() - begin) {
    t.n_damaged = atomic_load(&a.n_damaged);
    t.n_kills = atomic_load(&a.n_kills);
    if (t.seconds >= seconds && t.n_damaged >= n_damaged && t.n_kills >= n_kills) break;
    t.n_good += code_of("GET", "/state", NULL) == 200;
    t.n_good += code_of("GET", "/model.ply", NULL) == 200;
    keep_clients(slow, readers, &t);
    poll(NULL, 0, 300);
    long rss = live_run_rss_kib(&r);
    if (rss > t.most_rss_kib) t.most_rss_kib = rss;
    if (t.seconds < seconds / 2) t.half_rss_kib = t.most_rss_kib;
  }
  attackers_stop(&a);
  for (int i = 0; i < N_SLOW; i++)
    if (slow[i] >= 0) close(slow[i]);
  for (int i = 0; i < N_READERS; i++)
    if (readers[i] >= 0) close(readers[i]);
  print_message(
      "%.0f s: %ld damaged requests, %ld answered among them, %d slow clients and readers came again, "
      "%d kills; memory of subview %ld KiB, half way %ld, in the end %ld\n",
      t.seconds, t.n_damaged, t.n_good, t.n_reopened, t.n_kills, t.rss_kib, t.half_rss_kib, t.most_rss_kib);
  assert_true(t.n_kills >= n_kills);
  assert_true(t.n_damaged >= n_damaged);
  assert_true(t.n_good > 0);
  // pages of the block that had not been touched yet; a short attack is over before training has
  // touched all of them (a leak of 8 bytes a damaged request would still be seen)
  assert_true(t.half_rss_kib <= t.rss_kib + 2048);
  assert_true(t.most_rss_kib <= t.half_rss_kib + (is_long() ? 128 : 1024));
  return t;
}

static void test_the_run_does_not_notice(void **state) {
  (void)state;
  char want[64], got[64], args[256];
  const double storm_s = is_long() ? 60 : 4;
  snprintf(args, sizeof args, BASE "--steps %d", steps_for(is_long() ? 300 : 12));
  start(args); // the same run, in peace
  assert_int_equal(live_run_wait(&r, is_long() ? 900 : 60), 0);
  report_value(root, "digest", want);
  start(args);
  assert_true(wait_for("\"state\":\"training\"", 20));
  (void)attack(storm_s, is_long() ? 1000000 : 0, is_long() ? 100 : 2, is_long() ? 840 : 10);
  assert_int_equal(live_run_wait(&r, is_long() ? 900 : 90), 0);
  report_value(root, "digest", got);
  assert_string_equal(got, want);
  report_value(root, "is_exact", got);
  assert_string_equal(got, "true");
}

// Cameras on real time (a recording at its own speed, on the thread that cameras get) while the run
// trains and the server is under attack: every frame is taken before the next one comes, and the
// ledger closes.
static void test_capture_meets_its_deadlines(void **state) {
  (void)state;
  char command[700], got[64];
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  const double storm_s = is_long() ? 60 : 4;
  if (emulate && *emulate) {
    print_message("skip deadlines: emulated programs have no real time\n");
    skip();
  }
  snprintf(command, sizeof command,
           "%s/subview capture --source sim:textured,rig=stereo,size=96x64,fps=30 --exposures %d --out "
           "%s/recording "
           "--quiet >/dev/null 2>&1",
           bin ? bin : "build/sim-x86/bin", is_long() ? 27000 : 450, root);
  assert_int_equal(system(command), 0);
  start("--source replay:@/recording,speed=realtime --live --exposures 4 --gaussians 1500 --threads 1 "
        "--time-limit 3600");
  assert_true(wait_for("\"state\":\"training\"", 20));
  (void)attack(storm_s, is_long() ? 1000000 : 0, is_long() ? 100 : 2, is_long() ? 840 : 12);
  assert_int_equal(live_run_stop(&r), 0);
  report_value(root, "is_exact", got);
  assert_string_equal(got, "true");
  report_value(root, "exposures_replaced", got);
  print_message("%s exposures replaced; ", got);
  assert_true(strtol(got, NULL, 10) > 2 * storm_s);
  report_value(root, "deadline_misses", got);
  print_message("deadlines of 33 ms missed: %s\n", got);
  assert_string_equal(got, "0");
}

// What is missing is told apart: no camera, no rig.
static void test_what_is_missing(void **state) {
  (void)state;
  char command[600];
  snprintf(command, sizeof command,
           "cp -r tests/data/capture_tiny %s/norig && sed -i '/\"rig\":/d' %s/norig/capture.json", root,
           root);
  assert_int_equal(system(command), 0);
  start("--source replay:@/norig --session");
  assert_true(wait_for("\"state\":\"failed\",\"cause\":\"rig\"", 10));
  live_run_stop(&r);
  start("--source replay:@/nowhere --session");
  assert_true(wait_for("\"state\":\"failed\",\"cause\":\"camera\"", 10));
  live_run_stop(&r);
}

// Save keeps all that the end of the run would.
static void test_save(void **state) {
  (void)state;
  static const char *const files[] = {"model.ply", "motion.bin", "checkpoint.bin", "preview.jpg"};
  char headers[128], path[400];
  start("--source sim:moving,rig=stereo,arc=0,size=96x64 --scene dynamic --exposures 3 --gaussians 1000 "
        "--threads 1 --time-limit 600");
  assert_true(wait_for("\"state\":\"training\"", 20));
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
  assert_int_equal(code_of("POST", "/save", headers), 200);
  assert_true(wait_for("\"saves\":1", 20));
  for (int i = 0; i < 4; i++) {
    snprintf(path, sizeof path, "%s/out/%s", root, files[i]);
    if (access(path, F_OK) != 0) fail_msg("%s is not there", files[i]);
  }
  assert_int_equal(live_run_stop(&r), 0);
}

// A server that hangs is replaced as well.
static void test_hang(void **state) {
  (void)state;
  start(BASE "--steps 100 --session");
  assert_true(wait_for("\"state\":\"waiting\"", 10));
  pid_t first = live_run_server(&r);
  assert_true(first > 0);
  assert_int_equal(kill(first, SIGSTOP), 0);
  double begin = now_s();
  while (live_run_server(&r) == first && now_s() - begin < 20) poll(NULL, 0, 200);
  assert_true(live_run_server(&r) != first);
  assert_true(wait_for("\"state\":\"waiting\"", 10));
  print_message("a hanging server was replaced after %.1f s\n", now_s() - begin);
  live_run_stop(&r);
}

// --- a port that cannot be had -------------------------------------------------------------------

// One line that names the place and the reason, of two processes.
static void refuses_port(const char *place, const char *reason) {
  char command[900], said[1024], whole[256];
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  snprintf(command, sizeof command,
           "%s %s/subview run " BASE "--steps 2 --quiet --overwrite --preview %s --out %s/out 2>&1",
           emulate ? emulate : "", bin ? bin : "build/sim-x86/bin", place, root);
  FILE *p = popen(command, "r");
  assert_non_null(p);
  said[fread(said, 1, sizeof said - 1, p)] = 0;
  int status = pclose(p);
  snprintf(whole, sizeof whole, "subview-preview: %s: cannot listen: %s\n", place, reason);
  assert_string_equal(said, whole);
  assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 1);
}

TEST(test_port_that_cannot_be_had) {
  struct sockaddr_in a = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  socklen_t n = sizeof a;
  char place[64];
  int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  assert_true(fd >= 0 && bind(fd, (struct sockaddr *)&a, n) == 0 && listen(fd, 1) == 0);
  assert_int_equal(getsockname(fd, (struct sockaddr *)&a, &n), 0);
  snprintf(place, sizeof place, "127.0.0.1:%d", ntohs(a.sin_port));
  refuses_port(place, "the port is in use");
  close(fd);
  refuses_port("192.0.2.1:18080", "this machine has no such address"); // of documentation: nobody's
}

// --- setup ---------------------------------------------------------------------------------------

FIXTURE(make_root) {
  signal(SIGPIPE, SIG_IGN);
  return temp_folder_make(root, sizeof root, "live");
}
FIXTURE(stop) {
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_the_run_does_not_notice, stop),
      cmocka_unit_test_teardown(test_capture_meets_its_deadlines, stop),
      cmocka_unit_test_teardown(test_what_is_missing, stop),
      cmocka_unit_test_teardown(test_save, stop),
      cmocka_unit_test_teardown(test_hang, stop),
      cmocka_unit_test(test_port_that_cannot_be_had),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
