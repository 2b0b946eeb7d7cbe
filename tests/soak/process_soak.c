// SPDX-License-Identifier: Apache-2.0
// `subview run` with its page for hours: a still scene, a session of many scans, and a live moving
// scene, a third of the time each. Samples once a second the resident memory and the descriptors of
// both processes and the PSNR, into FOLDER/soak.csv, and fails when memory or descriptors grow, a
// ledger does not add up, or quality falls.
//
// process-soak HOURS FOLDER
#include <dirent.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "tests/common/live_run.h"

#define CAP_SAMPLES  100000 // 27 hours
#define MAX_GROWTH   1024   // KiB of resident memory, from the second fifth of a phase to its last
#define MAX_FALL_DB  1.0
#define SCAN_LIMIT_S 60

typedef enum { RUN_KIB, SERVER_KIB, RUN_FILES, SERVER_FILES, PSNR, N_VALUES } value;
static const char *const value_names[N_VALUES] = {"run_rss_kib", "server_rss_kib", "run_files",
                                                  "server_files", "psnr_db"};

static double sample[N_VALUES][CAP_SAMPLES], sorted[CAP_SAMPLES];
static int n_samples, n_faults;
static live_run r;
static uint8_t answer[1u << 20];
static const char *folder;
static FILE *csv;
static double t0_s;

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void fault(const char *phase, const char *what, double from, double to) {
  printf("%s: %s: from %g to %g\n", phase, what, from, to);
  n_faults++;
}

// --- samples -------------------------------------------------------------------------------------

static int n_files(pid_t pid) {
  char path[64];
  int n = 0;
  snprintf(path, sizeof path, "/proc/%d/fd", (int)pid);
  DIR *d = opendir(path);
  while (d && readdir(d)) n++;
  if (d) closedir(d);
  return n - 2; // . and ..
}

static double rss_kib(pid_t pid) {
  const live_run of = {.pid = pid};
  return (double)live_run_rss_kib(&of);
}

static bool read_state(void) {
  return live_run_get(&r, "/state", NULL, answer, sizeof answer) && live_run_code(answer) == 200;
}

static double number_of(const char *key) {
  const char *p = strstr((const char *)answer, key);
  return p ? strtod(p + strlen(key), NULL) : 0;
}

static void take_sample(const char *phase) {
  const pid_t server = live_run_server(&r);
  // it is just being started again
  if (!server || !read_state() || n_samples == CAP_SAMPLES) return;
  const double v[N_VALUES] = {rss_kib(r.pid), rss_kib(server), n_files(r.pid), n_files(server),
                              number_of("\"psnr\":")};
  fprintf(csv, "%s,%.1f", phase, now_s() - t0_s);
  for (int i = 0; i < N_VALUES; i++) {
    sample[i][n_samples] = v[i];
    fprintf(csv, ",%g", v[i]);
  }
  fprintf(csv, "\n");
  fflush(csv);
  n_samples++;
}

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

// Median of the i-th fifth of the samples.
static double median(value v, int i) {
  const int from = n_samples * i / 5, n = n_samples * (i + 1) / 5 - from;
  if (n < 1) return 0;
  memcpy(sorted, sample[v] + from, (size_t)n * sizeof *sorted);
  qsort(sorted, (size_t)n, sizeof *sorted, by_value);
  return sorted[n / 2];
}

// --- verdict -------------------------------------------------------------------------------------

static bool read_report(void) {
  char path[400];
  snprintf(path, sizeof path, "%s/out/run.json", folder);
  FILE *f = fopen(path, "rb");
  if (!f) return false;
  answer[fread(answer, 1, sizeof answer - 1, f)] = 0;
  fclose(f);
  return true;
}

static void judge(const char *phase, bool has_quality) {
  for (int v = 0; v < N_VALUES; v++) {
    const double from = median((value)v, 1), to = median((value)v, 4);
    printf("%s: %s %g -> %g (medians of the second and the last fifth of %d samples)\n", phase,
           value_names[v], from, to, n_samples);
    if (v <= SERVER_KIB && to > from + MAX_GROWTH) fault(phase, value_names[v], from, to);
    if ((v == RUN_FILES || v == SERVER_FILES) && to > from) fault(phase, value_names[v], from, to);
    if (v == PSNR && has_quality && to < from - MAX_FALL_DB) fault(phase, value_names[v], from, to);
  }
  if (!read_report()) {
    fault(phase, "there is no run.json", 0, 0);
    return;
  }
  if (strstr((const char *)answer, "\"is_exact\": false")) fault(phase, "a ledger does not add up", 0, 0);
  printf("%s: %g deadlines missed, %g exposures replaced\n", phase, number_of("\"deadline_misses\": "),
         number_of("\"exposures_replaced\": "));
}

// --- phases --------------------------------------------------------------------------------------

static bool begin(const char *phase, const char *args) {
  n_samples = 0;
  if (live_run_start(&r, folder, args)) return true;
  printf("%s: the run does not start: %s\n", phase, r.err);
  n_faults++;
  return false;
}

static void end(const char *phase, int wanted) {
  const int code = live_run_stop(&r);
  if (code != wanted) {
    printf("%s: exit %d: %s\n", phase, code, r.err);
    n_faults++;
  }
}

static void one_run(const char *phase, const char *args, double seconds) {
  if (!begin(phase, args)) return;
  for (double until = now_s() + seconds; now_s() < until; poll(NULL, 0, 1000)) take_sample(phase);
  end(phase, 0);
  judge(phase, true);
}

static bool post(const char *path) {
  char headers[256];
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
  live_run_request(&r, "POST", path, headers, answer, sizeof answer);
  return live_run_code(answer) == 200;
}

static bool wait_for(const char *state) {
  char text[64];
  snprintf(text, sizeof text, "\"state\":\"%s\"", state);
  for (double until = now_s() + SCAN_LIMIT_S; now_s() < until; poll(NULL, 0, 50))
    if (read_state() && strstr((const char *)answer, text)) return true;
  return false;
}

static void scans(double seconds) {
  int n = 0;
  bool is_well = true;
  if (!begin("scans",
             "--source sim:textured,rig=stereo,size=96x72 --exposures 4 --gaussians 1500 --steps 300 "
             "--threads 1 --session"))
    return;
  for (double until = now_s() + seconds; is_well && now_s() < until; n++) {
    is_well = wait_for("waiting") && post("/start") && wait_for("done");
    take_sample("scans");
    is_well = is_well && post("/new");
  }
  if (!is_well) {
    printf("scans: scan %d did not end within %d s\n", n, SCAN_LIMIT_S);
    n_faults++;
  }
  printf("scans: %d in one session\n", n);
  end("scans", 0);
  judge("scans", false);
}

int main(int argc, char **argv) {
  const double hours = argc == 3 ? strtod(argv[1], NULL) : 0;
  char path[400];
  if (!(hours > 0)) {
    fprintf(stderr, "usage: process-soak HOURS FOLDER\n");
    return 2;
  }
  folder = argv[2];
  snprintf(path, sizeof path, "%s/soak.csv", folder);
  if (!(csv = fopen(path, "w"))) {
    fprintf(stderr, "process-soak: %s: cannot be written\n", path);
    return 1;
  }
  fprintf(csv, "phase,seconds");
  for (int v = 0; v < N_VALUES; v++) fprintf(csv, ",%s", value_names[v]);
  fprintf(csv, "\n");
  t0_s = now_s();
  const double part_s = hours * 1200;
  one_run("still",
          "--source sim:textured,rig=stereo,size=160x120,fps=10 --exposures 8 --gaussians 2000 --live "
          "--time-limit 1000000 --threads 1",
          part_s);
  scans(part_s);
  one_run("moving",
          "--source sim:moving,rig=stereo,arc=0,size=160x120,fps=30 --scene dynamic --live "
          "--exposure-time 0.1 --gaussians 2000 --time-limit 1000000 --threads 1",
          part_s);
  fclose(csv);
  printf("%s: %d faults; samples in %s\n", n_faults ? "FAILED" : "passed", n_faults, path);
  return n_faults != 0;
}
