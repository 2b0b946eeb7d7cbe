// SPDX-License-Identifier: Apache-2.0
// A CPU for the cameras alone: their thread stays on it, all others leave it, and the report tells.
#include <dirent.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

static live_run r;
static char out[8192];

// Threads of the run that may use this CPU alone, and those that may use it beside others.
static void count_threads(int cpu, int *n_alone, int *n_beside) {
  char path[64], line[256], alone[16];
  snprintf(path, sizeof path, "/proc/%d/task", (int)r.pid);
  snprintf(alone, sizeof alone, "%d\n", cpu);
  *n_alone = *n_beside = 0;
  DIR *d = opendir(path);
  assert_non_null(d);
  for (const struct dirent *e; (e = readdir(d));) {
    char status[384];
    if (e->d_name[0] == '.') continue;
    snprintf(status, sizeof status, "%s/%s/status", path, e->d_name);
    FILE *f = fopen(status, "r");
    while (f && fgets(line, sizeof line, f)) {
      unsigned long low = 0;
      if (!strncmp(line, "Cpus_allowed_list:\t", 19) && !strcmp(line + 19, alone)) {
        (*n_alone)++;
        (*n_beside)--;
      }
      if (!strncmp(line, "Cpus_allowed:\t", 14)) {
        const char *comma = strrchr(line, ',');
        low = strtoul(comma ? comma + 1 : line + 14, NULL, 16);
        *n_beside += (int)(low >> cpu & 1);
      }
    }
    if (f) fclose(f);
  }
  closedir(d);
}

TEST(test_threads_of_a_run) {
  const int cpu = sv_linux_camera_cpu("/sys");
  if (sv_linux_n_cpus() < 2 || cpu > 31) skip();
  shell_ok("%s/subview capture --source sim:textured,rig=stereo,fps=30,size=96x64 --exposures 150 --out %s "
           "--quiet 2>/dev/null",
           getenv("SV_BIN"), temp_path("capture"));
  char args[400];
  snprintf(
      args, sizeof args,
      "--source replay:@/capture,speed=realtime --rig @/capture/rig --live --exposures 4 --gaussians 500 "
      "--time-limit 4 --capture-cpu %d",
      cpu);
  if (!live_run_start(&r, temp_folder, args)) fail_msg("the run does not start: %s", r.err);
  int n_alone = 0, n_beside = 0;
  for (int i = 0; i < 100 && n_alone == 0; i++, poll(NULL, 0, 50)) count_threads(cpu, &n_alone, &n_beside);
  assert_int_equal(n_alone, 1);
  assert_int_equal(n_beside, 0);
  assert_int_equal(live_run_wait(&r, 60), 0);
  char *report = temp_read(temp_path("out"), "run.json"), expected[40];
  snprintf(expected, sizeof expected, "\"capture_cpu\": %d", cpu);
  assert_contains(report, expected);
  free(report);
}

static int run(const char *args) {
  char command[800];
  snprintf(command, sizeof command, "%s/subview run --source sim:textured --out %s %s 2>&1", getenv("SV_BIN"),
           temp_path("none"), args);
  return shell_read(out, sizeof out, command);
}

TEST(test_refused) {
  assert_int_equal(run("--live --capture-cpu first"), 2);
  assert_contains(out, "--capture-cpu first: expected auto, off or the number of a CPU");
  assert_int_equal(run("--capture-cpu 0"), 2);
  assert_contains(out, "only with --live");
  assert_int_equal(run("--live --capture-cpu 4095"), 1);
  assert_contains(out, "CPU 4095: not one of the ");
  assert_int_equal(run("--capture-cpu off --check"), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_threads_of_a_run),
      cmocka_unit_test(test_refused),
  };
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
