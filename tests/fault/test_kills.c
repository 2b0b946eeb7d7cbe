// SPDX-License-Identifier: Apache-2.0
// SIGKILL at random moments of running programs. After each kill no file is torn, and the next run
// goes on from a checkpoint at least as new as the one before. A run that was killed again and
// again ends with the digest of one that was not. KILL_N: kills of runs (24); a quarter as many of
// captures follow. `make kill-test N=1000` sets it.
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "src/base/rng.h"
#include "tests/common/test.h"
#include "tests/common/whole.h"

#define CAP_WORDS 40
#define SOURCE    "--source sim:textured,rig=stereo,size=48x36 --exposures 2 --gaussians 100 --threads 1 "

static char bin[256], said[8 << 10];
static sv_rng rng;
static long n_kills, n_resumed, n_rounds, n_fallbacks, n_temporaries;

// --- programs ------------------------------------------------------------------------------------

// `subview` with these words; stderr goes to FOLDER/err.
static pid_t start(const char *line) {
  const pid_t pid = fork();
  if (pid != 0) return pid;
  char text[1000], *words[CAP_WORDS], *save = NULL;
  int n = 0;
  snprintf(text, sizeof text, "%s/subview %s", bin, line);
  for (char *w = strtok_r(text, " ", &save); w && n < CAP_WORDS - 1; w = strtok_r(NULL, " ", &save))
    words[n++] = w;
  words[n] = NULL;
  const int out = open("/dev/null", O_WRONLY),
            err = open(temp_path("err"), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  if (out < 0 || err < 0 || dup2(out, 1) < 0 || dup2(err, 2) < 0) _exit(99);
  execv(words[0], words);
  _exit(98);
}

static void read_said(void) {
  char *text = temp_read(temp_folder, "err");
  snprintf(said, sizeof said, "%s", text);
  free(text);
}

static int finish(pid_t pid) {
  int status = 0;
  while (waitpid(pid, &status, 0) < 0) assert_int_equal(errno, EINTR);
  read_said();
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

// Kills it after a random time below most_ms; true: it had ended before, well.
static bool kill_soon(pid_t pid, uint32_t most_ms) {
  const uint32_t us = sv_rng_below(&rng, most_ms * 1000);
  const struct timespec t = {us / 1000000, (long)(us % 1000000) * 1000};
  nanosleep(&t, NULL);
  kill(pid, SIGKILL);
  const int code = finish(pid);
  n_kills += code == 128 + SIGKILL;
  if (code != 0 && code != 128 + SIGKILL) fail_msg("exit %d: %s", code, said);
  return code == 0;
}

// --- files ---------------------------------------------------------------------------------------

static void check_folder(const char *folder) {
  char path[600];
  DIR *d = opendir(folder);
  for (struct dirent *e; d && (e = readdir(d));) {
    size_t n = 0;
    if (e->d_name[0] == '.') continue;
    if (strstr(e->d_name, ".subview-tmp")) { // removed by the next run
      n_temporaries++;
      continue;
    }
    snprintf(path, sizeof path, "%s/%s", folder, e->d_name);
    uint8_t *data = whole_read(path, &n);
    if (!data || !whole_is(e->d_name, data, n)) fail_msg("kill %ld: %s is torn, %zu bytes", n_kills, path, n);
    free(data);
  }
  if (d) closedir(d);
}

static void digest_of(const char *folder, char out[20]) {
  char *text = temp_read(temp_path("%s", folder), "run.json"), *at = strstr(text, "\"digest\": \"");
  if (!at) fail_msg("%s: no digest", folder);
  snprintf(out, 20, "%.16s", at + 11);
  free(text);
}

// --- runs ----------------------------------------------------------------------------------------

typedef struct {
  long steps;
  uint32_t most_ms;
} round_kind;

// One run, killed again and again until it ends by itself or there were enough kills.
static void one_round(const round_kind *k, long enough) {
  char line[600], want[20], is[20];
  long last_step = 0;
  bool is_done = false, has_checkpoint = false;
  snprintf(line, sizeof line, "run " SOURCE "--steps %ld --save-every 1000 --out %s", k->steps,
           temp_path("whole"));
  shell_ok("rm -rf %s %s", temp_path("whole"), temp_path("killed"));
  if (finish(start(line)) != 0) fail_msg("%s", said);
  digest_of("whole", want);
  snprintf(line, sizeof line,
           "run " SOURCE "--steps %ld --save-every 0.004 --picture-every 0.02 --resume --out %s", k->steps,
           temp_path("killed"));
  while (!is_done) {
    is_done = n_kills < enough ? kill_soon(start(line), k->most_ms) : finish(start(line)) == 0;
    const char *at = strstr(said, "resumed at step ");
    const long step = at ? strtol(at + 16, NULL, 10) : -1;
    if (at && step < last_step) fail_msg("step %ld after step %ld: %s", step, last_step, said);
    if (has_checkpoint && strstr(said, "starting at step 0")) fail_msg("began anew: %s", said);
    if (at) last_step = step;
    n_resumed += at != NULL;
    n_fallbacks += strstr(said, "the checkpoint before it") != NULL;
    if (!is_done && n_kills >= enough && *said && !at && !strstr(said, "starting")) fail_msg("%s", said);
    check_folder(temp_path("killed"));
    has_checkpoint |= access(temp_path("killed/checkpoint.bin"), F_OK) == 0;
  }
  digest_of("killed", is);
  if (strcmp(want, is) != 0) fail_msg("digest %s, undisturbed %s", is, want);
  shell_ok("! ls %s | grep subview-tmp", temp_path("killed"));
  n_rounds++;
}

static long n_asked(void) {
  const char *n = getenv("KILL_N");
  return n && strtol(n, NULL, 10) > 0 ? strtol(n, NULL, 10) : 24;
}

TEST(test_runs) {
  // Short ones are killed in their final save, too; long ones resume often.
  static const round_kind kinds[] = {{300, 160}, {20000, 240}, {1500, 200}};
  for (int i = 0; n_kills < n_asked(); i++) one_round(&kinds[i % 3], n_asked());
  print_message(
      "%ld kills in %ld runs: 0 torn files, %ld times resumed, %ld times from the checkpoint before, "
      "%ld temporary files left and removed; all digests as undisturbed\n",
      n_kills, n_rounds, n_resumed, n_fallbacks, n_temporaries);
}

// --- captures ------------------------------------------------------------------------------------

// After each kill the frames that were added replay.
TEST(test_captures) {
  char line[600];
  long n_replayed = 0;
  const long enough = n_asked() / 4;
  n_kills = 0;
  while (n_kills < enough) {
    shell_ok("rm -rf %s %s", temp_path("capture"), temp_path("trained"));
    snprintf(line, sizeof line,
             "capture --source sim:textured,rig=stereo,size=48x36,fps=30 --exposures 2000 --quiet --out %s",
             temp_path("capture"));
    (void)kill_soon(start(line), 250);
    const bool is_listed = access(temp_path("capture/capture.json"), F_OK) == 0;
    snprintf(line, sizeof line,
             "run --source replay:%s,speed=max --exposures 1 --gaussians 100 --threads 1 --steps 1 --quiet "
             "--out %s",
             temp_path("capture"), temp_path("trained"));
    const int code = is_listed ? finish(start(line)) : 1;
    // One that was killed before its first exposure has none to replay.
    const bool is_empty = code == 1 && (!is_listed || strstr(said, "no frames") || strstr(said, "without") ||
                                        strstr(said, "rig"));
    if (code != 0 && !is_empty) fail_msg("kill %ld: exit %d: %s", n_kills, code, said);
    n_replayed += code == 0;
  }
  print_message("%ld kills of captures: %ld replay, the others had no exposure yet\n", n_kills, n_replayed);
  assert_true(n_replayed > 0);
}

FIXTURE(set_up) {
  const char *b = getenv("SV_BIN"), *seed = getenv("KILL_SEED");
  snprintf(bin, sizeof bin, "%s", b ? b : "build/sim-x86/bin");
  const uint64_t s = seed ? strtoull(seed, NULL, 10) : (uint64_t)time(NULL);
  rng = sv_rng_make(s, 1);
  print_message("KILL_SEED=%llu\n", (unsigned long long)s);
  return temp_folder_setup(NULL);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_runs), cmocka_unit_test(test_captures)};
  if (is_emulated()) {
    printf("the programs are started by their names here, which an emulator does not take\n");
    return 77;
  }
  return cmocka_run_group_tests(tests, set_up, temp_folder_teardown);
}
