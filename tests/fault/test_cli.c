// SPDX-License-Identifier: Apache-2.0
// The built `subview`, run as a user runs it: bad input ends with exit code 1 or 2 and one line on
// stderr and leaves no file behind; a killed run goes on; Ctrl-C saves; the memory it takes is what
// its report says. SV_BIN names the programs' folder, SV_EMULATE what runs them on a foreign
// machine.
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <png.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/common/test.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define IS_SANITIZED 1
#else
#define IS_SANITIZED 0
#endif

#define MAX_ARGS 40
#define CAP_JSON (64 << 10)

static char g_root[256], g_program[512], g_emulate[512];
static char g_out[64 << 10], g_err[64 << 10]; // what the last program wrote

// --- processes and files -------------------------------------------------------------------------

// Starts `subview` with the words of a command line. "@" in it stands for the test's folder.
static pid_t start(const char *line) {
  static char text[2048];
  char *argv[MAX_ARGS], *save = NULL;
  int n = 0;
  size_t at = 0;
  if (g_emulate[0]) at += (size_t)snprintf(text, sizeof text, "%s ", g_emulate);
  at += (size_t)snprintf(text + at, sizeof text - at, "%s ", g_program);
  for (; *line && at + sizeof g_root < sizeof text; line++) {
    if (*line == '@') at += (size_t)snprintf(text + at, sizeof text - at, "%s", g_root);
    else text[at++] = *line;
  }
  text[at] = 0;
  for (char *word = strtok_r(text, " ", &save); word && n < MAX_ARGS - 1; word = strtok_r(NULL, " ", &save))
    argv[n++] = word;
  argv[n] = NULL;
  char path[300];
  snprintf(path, sizeof path, "%s/stderr", g_root);
  (void)!truncate(path, 0); // no one reads the last program's words for this one's
  pid_t pid = fork();
  if (pid != 0) return pid;
  snprintf(path, sizeof path, "%s/stdout", g_root);
  int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
  snprintf(path, sizeof path, "%s/stderr", g_root);
  int fe = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
  if (fd < 0 || fe < 0 || dup2(fd, 1) < 0 || dup2(fe, 2) < 0) _exit(99);
  execv(argv[0], argv);
  _exit(98);
}

static void slurp(const char *name, char *text, size_t cap) {
  char path[600];
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  FILE *f = fopen(path, "rb");
  size_t n = f ? fread(text, 1, cap - 1, f) : 0;
  if (f) fclose(f);
  text[n] = 0;
}

// The exit code, or 128 + the signal.
static int finish(pid_t pid, struct rusage *use) {
  struct rusage own;
  int status = 0;
  assert_true(pid > 0);
  while (wait4(pid, &status, 0, use ? use : &own) < 0) assert_int_equal(errno, EINTR);
  slurp("stdout", g_out, sizeof g_out);
  slurp("stderr", g_err, sizeof g_err);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

static int run(const char *line) { return finish(start(line), NULL); }

static int n_lines(const char *text) {
  int n = 0;
  for (; *text; text++) n += *text == '\n';
  return n;
}

static void sleep_ms(long ms) {
  struct timespec t = {ms / 1000, ms % 1000 * 1000000};
  nanosleep(&t, NULL);
}

static bool exists(const char *name) {
  char path[600];
  struct stat st;
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  return stat(path, &st) == 0;
}

static void shell(const char *fmt, ...) {
  char command[1024];
  va_list ap;
  va_start(ap, fmt);
  vsnprintf(command, sizeof command, fmt, ap);
  va_end(ap);
  if (system(command) != 0) fail_msg("%s", command);
}

// Files in a folder of the test; a missing folder has none.
static int n_files(const char *name) {
  char path[600];
  int n = 0;
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  DIR *d = opendir(path);
  for (struct dirent *e; d && (e = readdir(d));) n += e->d_name[0] != '.';
  if (d) closedir(d);
  return n;
}

// --- bad input -----------------------------------------------------------------------------------

#define SMALL "--source sim:textured,rig=stereo,size=64x48 --exposures 2 --gaussians 100 --steps 5 "

TEST(test_bad_input) {
  static const struct {
    const char *line, *says; // says: what the one line must hold
    int code;
  } cases[] = {
      {"fly", "fly", 2},
      {"run --out @/bad", "--source", 2},
      {"run --source sim:textured", "--out", 2},
      {"run --source sim:textured --out", "--out", 2},
      {"run --source sim:textured --out --quiet", "--out needs a value", 2},
      {"run --source --out @/bad", "--source needs a value", 2},
      {"run --source sim:textured --rig= --out @/bad", "--rig needs a value", 2},
      {"run --source sim:textured --steps --out @/bad", "--steps needs a value", 2},
      {"run --source sim:atlantis --out @/bad", "atlantis", 1},
      {"run --source sim:textured,rig=octopus --out @/bad", "octopus", 1},
      {"run --source sim:textured,size=0x0 --out @/bad", "size", 1},
      {"run --source sim:textured,fault=rain --out @/bad", "rain", 1},
      {"run --source sim:textured --live --refine-poses --out @/bad", "--refine-poses", 2},
      {"run --source sim:textured,rig=multiplexed --refine-poses --out @/bad", "multiplexed", 1},
      {"run --source usb:0 --out @/bad", "usb:0", 1},
      {"run --source replay:@/nowhere --out @/bad", "nowhere", 1},
      {"run " SMALL "--imu @/nowhere --out @/bad", "--imu", 1},
      {"run " SMALL "--imu @/a_file --out @/bad", "no accelerations", 1},
      {"run --source replay:@/cut --out @/bad", "capture.json", 1},
      {"run --source replay:@/wrong_size --out @/bad", "64x48", 1},
      {"run --source replay:@/no_rig --out @/bad", "rig", 1},
      {"run --source replay:@/tiny --rig @/nowhere --out @/bad", "nowhere", 1},
      {"run --source sim:textured,rig=multiplexed,size=160x120 --sub-views v00 --out @/bad", "together", 1},
      {"run " SMALL "--gaussians 0 --out @/bad", "--gaussians 0: expected a whole number from 1 to 4000000",
       2},
      {"run " SMALL "--gaussians -3 --out @/bad", "--gaussians", 2},
      {"run " SMALL "--gaussians 4000000 --exposures 1000 --out @/bad", "MiB", 1},
      {"run " SMALL "--steps many --out @/bad", "--steps", 2},
      {"run " SMALL "--steps 99999999999999999999 --out @/bad", "--steps", 2},
      {"run " SMALL "--time-limit nan --out @/bad", "--time-limit", 2},
      {"run " SMALL "--shutter rolling --out @/bad", "does not report how long", 1},
      {"run " SMALL "--shutter slow --out @/bad", "--shutter slow", 2},
      {"run " SMALL "--threads 0 --out @/bad", "--threads", 2},
      {"run " SMALL "--scene wobbly --out @/bad", "wobbly", 2},
      {"run " SMALL "--sub-views left,middle --out @/bad", "middle", 2},
      {"run " SMALL "--colour blue --out @/bad", "--colour", 2},
      {"run " SMALL "--json=yes --out @/bad", "--json", 2},
      {"run " SMALL "--out @/a_file/sub", "a_file", 1},
      {"run " SMALL "--out /proc/subview", "/proc/subview", 1},
      {"run " SMALL "--resume --quiet --out @/torn", "checkpoint.bin", 1},
      {"capture --source sim:textured --out @/bad", "--exposures", 2},
      {"capture --source sim:atlantis --exposures 2 --out @/bad", "atlantis", 1},
      {"capture --source sim:textured,frames=1,drop=1 --exposures 2 --quiet --out @/bad_capture", "exposure",
       1},
      {"capture --source sim:textured --exposures 2 --out @/a_file/sub", "a_file", 1},
      {"capture --source sim:textured --exposures 2 --sync often --out @/bad", "--sync often", 2},
      {"capture --source sim:textured --exposures 2 --out @/tiny", "already holds a capture", 1},
      {"capture --source replay:@/tiny --exposures 2 --out @/tiny", "already holds a capture", 1},
      {"capture --source replay:@/tiny --exposures 2 --sync frame-length --out @/bad", "frame length", 1},
      {"run --source replay:@/tiny --sync trigger --out @/bad", "trigger line", 1},
      {"cameras --source-kind v4l3", "v4l3", 2},
      {"plan --size 640", "640", 2},
      {"plan --size 640x480x3", "640x480x3", 2},
      {"plan --frames 4056x3040 --size 640x400", "expected the same shape", 2},
      {"plan --frames 320x240", "expected the same shape", 2},
      {"plan --frames 4056 --size 1014x760", "--frames 4056", 2},
      {"plan --frames 4056x3040 --size 1014x760 --images 450", "reduce --gaussians or --images", 1},
      {"plan --images 0", "--images 0: expected a whole number from 1 to 100000", 2},
      {"plan --gaussians 5000000", "from 1 to 4000000", 2},
      {"plan --odometry 2 --multiplexed 3x3", "--odometry", 2},
      {"plan --multiplexed 4", "--multiplexed 4", 2},
      {"plan --multiplexed 90x90", "256", 2},
      {"plan --arena 1", "MiB", 1},
      {"selftest --loud", "--loud", 2},
  };
  int n_bad = 0;
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    int code = run(cases[i].line);
    if (code == cases[i].code && n_lines(g_err) == 1 && strstr(g_err, cases[i].says) && n_files("bad") == 0)
      continue;
    print_error("subview %s\n  exit %d, expected %d and one line with \"%s\"; %d files; stderr:\n%s\n",
                cases[i].line, code, cases[i].code, cases[i].says, n_files("bad"), g_err);
    n_bad++;
  }
  assert_int_equal(n_bad, 0);
}

// The first picture that cannot be used is named, once; the run goes on without it as long as there
// are others.
TEST(test_bad_pictures) {
  static const struct {
    const char *make, *says;
    int code;
  } cases[] = {{"rm cam1/000002.jpg", "warning: cam1/000002.jpg: cannot be read: it does not exist", 0},
               {"head -c 300 cam1/000001.jpg > x && mv x cam1/000001.jpg", "warning: cam1/000001.jpg: ", 0},
               {"rm cam0/*.jpg", "warning: cam0/000000.jpg: ", 1}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    shell("cd '%s' && rm -rf pictures && cp -r tiny pictures && cd pictures && %s", g_root, cases[i].make);
    int code = run("run --source replay:@/pictures,speed=max --gaussians 100 --steps 5 --quiet --overwrite "
                   "--out @/pictures_out");
    if (code != cases[i].code || n_lines(g_err) != 1 + code ||
        strncmp(g_err, cases[i].says, strlen(cases[i].says)) != 0)
      fail_msg("%s: exit %d: %s", cases[i].make, code, g_err);
  }
}

// A capture with more exposures than are asked for: these are spread over all of it.
TEST(test_longer_capture) {
  assert_int_equal(run("run --source replay:@/tiny --exposures 3 --check"), 0);
  assert_contains(g_err, "the capture has up to 4 exposures; using 3 spread over all of it ");
  assert_contains(g_err, "ready: ");
  assert_int_equal(run("run --source replay:@/tiny,from=1 --exposures 3 --check"), 0);
  assert_not_contains(g_err, "the capture has");
}

TEST(test_unknown_kernels) {
  setenv("SV_ISA", "abacus", 1);
  int code = run("run " SMALL "--out @/bad");
  unsetenv("SV_ISA");
  assert_int_equal(code, 2);
  assert_contains(g_err, "abacus");
  assert_int_equal(n_lines(g_err), 1);
  assert_int_equal(n_files("bad"), 0);
}

TEST(test_help) {
  static const char *const lines[] = {
      "--help",          "--version",         "run --help",        "capture --help",
      "cameras --help",  "plan --help",       "selftest --help",   "cameras",
      "run --version",   "capture --version", "cameras --version", "plan --version",
      "bench --version", "selftest --version"};
  for (size_t i = 0; i < sizeof lines / sizeof *lines; i++) {
    assert_int_equal(run(lines[i]), 0);
    assert_true(n_lines(g_out) > 0);
    // On a machine without cameras that is said, before the simulator's scenes.
    assert_int_equal(n_lines(g_err), strstr(g_err, "no camera found") != NULL);
    assert_true(!g_err[0] || !strcmp(lines[i], "cameras"));
    if (strstr(lines[i], "--version") && strncmp(g_out, "subview 0.", 10) != 0) fail_msg("%s", g_out);
  }
}

TEST(test_help_tells_defaults) {
  static const char *const names[] = {"\n  --exposures ", "\n  --gaussians ", "\n  --sh ", "\n  --threads ",
                                      "\n  --seed "};
  assert_int_equal(run("run --help"), 0);
  for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
    const char *at = strstr(g_out, names[i]), *end = at ? strstr(at + 1, "\n  --") : NULL;
    int value = 0;
    const char *bracket = end;
    while (bracket && bracket > at && *bracket != '[') bracket--;
    if (!end || sscanf(bracket, "[%d]\n", &value) != 1) fail_msg("%s in: %s", names[i], g_out);
  }
}

// --- a good run ----------------------------------------------------------------------------------

static const char *value_of(const char *json, const char *key) {
  char quoted[64];
  snprintf(quoted, sizeof quoted, "\"%s\": ", key);
  const char *at = strstr(json, quoted);
  if (!at) fail_msg("no %s in: %s", quoted, json);
  return at + strlen(quoted);
}

TEST(test_json_and_digest) {
  char digest[2][24];
  for (int i = 0; i < 2; i++) {
    assert_int_equal(run(i ? "run " SMALL "--threads 2 --quiet --json --overwrite --out @/json"
                           : "run " SMALL "--threads 1 --quiet --json --out @/json"),
                     0);
    assert_int_equal(n_lines(g_out), 1); // one object, and nothing else
    assert_int_equal(n_lines(g_err), 0);
    assert_true(g_out[0] == '{' && g_out[strlen(g_out) - 2] == '}');
    snprintf(digest[i], sizeof digest[i], "%.18s", value_of(g_out, "digest"));
  }
  assert_string_equal(digest[0], digest[1]);
  assert_int_equal(n_files("json"), 4);
}

// Peak resident memory, all pages the process ever had (program, libraries and the touched part of
// the block), against what the run took of the block. In small pages: large ones bring what lies
// beside it.
TEST(test_memory) {
  if (IS_SANITIZED || g_emulate[0]) {
    print_message("skip the peak of memory: a sanitizer or an emulator takes more than the program\n");
    skip();
  }
  struct rusage use;
  static char json[CAP_JSON];
  const char *line =
      "run --source sim:textured,rig=stereo,size=320x240 --exposures 8 --gaussians 5000 --steps 60 "
      "--quiet --out @/memory";
  prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0); // also for the program that is started
  pid_t pid = start(line);
  prctl(PR_SET_THP_DISABLE, 0, 0, 0, 0);
  assert_int_equal(finish(pid, &use), 0);
  slurp("memory/run.json", json, sizeof json);
  double used_mib = atof(value_of(json, "used_bytes")) / 1048576.0, peak_mib = (double)use.ru_maxrss / 1024.0;
  double block_mib = atof(value_of(json, "arena_bytes")) / 1048576.0;
  print_message("peak %.1f MiB resident; %.1f MiB of a block of %.0f MiB in use\n", peak_mib, used_mib,
                block_mib);
  assert_true(peak_mib <= used_mib + 8.0);
  assert_true(used_mib < 0.5 * block_mib); // else the check above would prove little
}

// --- shared sensors ------------------------------------------------------------------------------

// A grey ramp as NAME in the rig's folder.
static void put_png(const char *name, int width_px, int height_px) {
  static uint8_t px[64 * 64];
  char path[600];
  png_image im = {.version = PNG_IMAGE_VERSION,
                  .width = (png_uint_32)width_px,
                  .height = (png_uint_32)height_px,
                  .format = PNG_FORMAT_GRAY};
  for (int i = 0; i < width_px * height_px; i++) px[i] = (uint8_t)(255 - i % 200);
  snprintf(path, sizeof path, "%s/mux/rig/%s", g_root, name);
  assert_true(png_image_write_to_file(&im, path, 0, px, 0, NULL));
}

#define MUX "run --source replay:@/mux,speed=max --exposures 2 --gaussians 100 --steps 20 --quiet --json "

static void expect_mux(int code, const char *says) {
  int is = run(MUX "--out @/mux_bad");
  if (is != code || n_lines(g_err) != (code != 0) || !strstr(g_err, says))
    fail_msg("exit %d, expected %d and one line with \"%s\": %s", is, code, says, g_err);
  assert_int_equal(code == 0 ? 0 : n_files("mux_bad"), 0);
}

// A recorded shared sensor, its rig with a coverage picture: good, absent, of another size,
// damaged, no picture.
TEST(test_shared_sensor) {
  static char json[CAP_JSON];
  int w = 0, h = 0;
  char digest[2][24];
  assert_int_equal(
      run("capture --source sim:textured,rig=multiplexed,grid=2x2,size=96x72 --exposures 2 --quiet "
          "--out @/mux"),
      0);
  slurp("mux/rig/rig.json", json, sizeof json);
  const char *at = strstr(json, "\"footprint\": [0, 0, ");
  assert_true(at && sscanf(at, "\"footprint\": [0, 0, %d, %d]", &w, &h) == 2 && w * h <= 64 * 64);
  assert_int_equal(run(MUX "--out @/mux_plain"), 0);
  snprintf(digest[0], sizeof digest[0], "%.18s", value_of(g_out, "digest"));
  shell("sed -i 's/\"footprint\": .0, 0, [0-9]*, [0-9]*./&, \"coverage\": \"a.png\"/' '%s/mux/rig/rig.json'",
        g_root);
  expect_mux(1, "a.png");
  put_png("a.png", w, h - 1);
  expect_mux(1, "its footprint in rig.json has");
  shell("echo text > '%s/mux/rig/a.png'", g_root);
  expect_mux(1, "neither JPEG nor PNG");
  put_png("b.png", w, h);
  shell("cd '%s/mux/rig' && head -c 150 b.png > a.png", g_root);
  expect_mux(1, "a.png: PNG");
  shell("cd '%s/mux/rig' && cp b.png a.png", g_root);
  assert_int_equal(run(MUX "--out @/mux_covered"), 0);
  snprintf(digest[1], sizeof digest[1], "%.18s", value_of(g_out, "digest"));
  assert_string_not_equal(digest[0], digest[1]); // it matters
  // Recorded again, the coverage goes along.
  assert_int_equal(run("capture --source replay:@/mux,speed=max --exposures 2 --quiet --out @/mux2"), 0);
  assert_true(exists("mux2/rig/v00.coverage.png"));
  assert_int_equal(
      run("run --source replay:@/mux2,speed=max --exposures 2 --gaussians 100 --steps 20 --quiet "
          "--json --out @/mux_again"),
      0);
  snprintf(digest[0], sizeof digest[0], "%.18s", value_of(g_out, "digest"));
  assert_string_equal(digest[0], digest[1]);
  assert_int_equal(n_files("mux_again"), 4); // the preview among them
}

// --- signals -------------------------------------------------------------------------------------

#define LONG_RUN                                                                                             \
  "run --source sim:textured,rig=stereo,size=64x48 --exposures 2 --gaussians 200 --save-every 0.02 "

static bool wait_for(const char *name, pid_t pid) {
  for (int i = 0; i < 3000 && !exists(name); i++) {
    if (waitpid(pid, NULL, WNOHANG) != 0) return false;
    sleep_ms(10);
  }
  return exists(name);
}

// It has said where it goes on, however slowly it started.
static bool wait_for_resume(void) {
  for (int i = 0; i < 3000; i++, sleep_ms(10)) {
    slurp("stderr", g_err, sizeof g_err);
    if (strstr(g_err, "resumed at step ")) return true;
  }
  return false;
}

TEST(test_killed_run_goes_on) {
  long last_step = 0;
  for (int i = 0; i < 6; i++) {
    pid_t pid = start(LONG_RUN "--steps 5000000 --resume --out @/killed");
    if (!wait_for("killed/checkpoint.bin", pid)) fail_msg("no checkpoint came");
    if (i > 0 && !wait_for_resume()) fail_msg("it began anew: %s", g_err);
    sleep_ms(60 + 37 * i);
    assert_int_equal(kill(pid, SIGKILL), 0);
    assert_int_equal(finish(pid, NULL), 128 + SIGKILL);
    assert_false(exists("killed/model.ply")); // it was not the end
    if (i == 0) continue;
    const char *at = strstr(g_err, "resumed at step ");
    assert_non_null(at);
    long step = atol(at + strlen("resumed at step "));
    if (step < last_step) fail_msg("step %ld after step %ld", step, last_step);
    last_step = step;
  }
  assert_true(last_step > 0);
  char line[300];
  snprintf(line, sizeof line, LONG_RUN "--steps %ld --resume --out @/killed", last_step + 5000000);
  pid_t pid = start(line); // ended below by a signal that lets it save
  sleep_ms(300);
  assert_int_equal(kill(pid, SIGTERM), 0);
  assert_int_equal(finish(pid, NULL), 0);
  assert_int_equal(n_files("killed"), 5); // two checkpoints, and no half-written one
}

// What is in a folder is not touched by a run of something else that was meant for another one.
TEST(test_resume_of_another_run) {
  static char before[CAP_JSON], after[CAP_JSON];
  assert_int_equal(run("run " SMALL "--quiet --out @/again"), 0);
  slurp("again/model.ply", before, sizeof before);
  int code = run("run " SMALL "--source sim:thin,rig=stereo,size=64x48 --resume --quiet --out @/again");
  if (code != 1 || n_lines(g_err) != 1 || !strstr(g_err, "another source")) fail_msg("%d: %s", code, g_err);
  code = run("run " SMALL "--seed 7 --resume --quiet --out @/again");
  if (code != 1 || n_lines(g_err) != 1 || !strstr(g_err, "--seed 7")) fail_msg("%d: %s", code, g_err);
  slurp("again/model.ply", after, sizeof after);
  assert_memory_equal(before, after, sizeof before);
  assert_int_equal(run("run " SMALL "--resume --out @/again"), 0);
  assert_contains(g_err, "resumed at step 5 ");
  assert_int_equal(run("run " SMALL "--resume --out @/fresh"), 0);
  assert_contains(g_err, "no checkpoint.bin in the output folder");
}

static void test_interrupt_saves(void **state) {
  (void)state;
  static char json[CAP_JSON];
  // a person; a connection that drops, which is told of twice
  static const int signals[] = {SIGINT, SIGHUP};
  for (int i = 0; i < 2; i++) {
    pid_t pid = start(LONG_RUN "--steps 5000000 --quiet --out @/stopped");
    if (!wait_for("stopped/checkpoint.bin", pid)) fail_msg("no checkpoint came");
    assert_int_equal(kill(pid, signals[i]), 0);
    if (signals[i] == SIGHUP) assert_int_equal(kill(pid, SIGHUP), 0);
    assert_int_equal(finish(pid, NULL), 0);
    assert_int_equal(n_lines(g_err), 1);
    assert_contains(g_err, "saved");
    assert_int_equal(n_files("stopped"), 4 + exists("stopped/checkpoint.1.bin"));
    assert_true(exists("stopped/model.ply") && exists("stopped/preview.jpg"));
    slurp("stopped/run.json", json, sizeof json);
    assert_true(atol(value_of(json, "steps")) > 0);
    assert_int_equal(strncmp(value_of(json, "state"), "\"done\"", 6), 0);
    shell("rm -r '%s/stopped'", g_root);
  }
}

// Nobody reads what it says any more: a connection without a terminal that drops.
TEST(test_closed_output) {
  shell("%s '%s' run --source sim:textured,rig=stereo,size=64x48 --exposures 2 --gaussians 100 --steps 5 "
        "--out '%s/unread' 2>&1 | true",
        g_emulate, g_program, g_root);
  for (int i = 0; i < 500 && !exists("unread/run.json"); i++) sleep_ms(10);
  assert_int_equal(n_files("unread"), 4);
}

// --- a slow disk ---------------------------------------------------------------------------------

// A pipe in the place of the first picture: writing it lasts until somebody opens its other end,
// after `ms`. The replay's cameras go on meanwhile, at four times their speed, as does the
// capture's time.
static int capture_to_slow_disk(const char *name, const char *options, long ms) {
  char path[600], line[700];
  shell("mkdir -p '%s/%s/left' && mkfifo '%s/%s/left/000000.jpg'", g_root, name, g_root, name);
  snprintf(line, sizeof line, "capture --source replay:@/long,speed=4 %s --out @/%s --json --quiet", options,
           name);
  pid_t pid = start(line);
  sleep_ms(ms);
  snprintf(path, sizeof path, "%s/%s/left/000000.jpg", g_root, name);
  int fd = open(path, O_RDONLY | O_NONBLOCK);
  assert_true(fd >= 0);
  int code = finish(pid, NULL);
  close(fd);
  return code;
}

TEST(test_capture_on_a_slow_disk) {
  assert_int_equal(
      run("capture --source sim:textured,rig=stereo,size=32x24,fps=10 --exposures 200 --out @/long --quiet"),
      0);
  // The time that a picture took is none in which no exposure came: 12 s of the capture's, more
  // than it waits.
  int code = capture_to_slow_disk("slow", "--exposures 5", 3000);
  if (code || !strstr(g_out, "\"exposures\": 5,")) fail_msg("exit %d: %s%s", code, g_out, g_err);
  // It ends when it is told to, although exposures are ready that the disk has kept waiting.
  code = capture_to_slow_disk("short", "--duration 2", 1500);
  if (code || !strstr(g_out, "\"exposures\": 1,")) fail_msg("exit %d: %s%s", code, g_out, g_err);
}

// --- set-up --------------------------------------------------------------------------------------

static void make_captures(void) {
  static const char *const names[] = {"tiny", "cut", "wrong_size", "no_rig"};
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    shell("cp -r tests/data/capture_tiny '%s/%s'", g_root, names[i]);
  shell("head -c 700 tests/data/capture_tiny/capture.json > '%s/cut/capture.json'", g_root);
  shell("sed -i 's/.imagersize.: .64, 48./\"imagersize\": [128, 72]/' '%s'/wrong_size/rig/*.cameramodel",
        g_root);
  shell("rm -r '%s/no_rig/rig'", g_root);
  shell("echo text > '%s/a_file'", g_root);
  shell("mkdir '%s/torn' && echo SVSECT > '%s/torn/checkpoint.bin'", g_root, g_root);
}

FIXTURE(set_up) {
  const char *bin = getenv("SV_BIN"), *tmp = getenv("TMPDIR"), *emulate = getenv("SV_EMULATE");
  snprintf(g_program, sizeof g_program, "%s/subview", bin ? bin : "build/sim-x86/bin");
  snprintf(g_emulate, sizeof g_emulate, "%s", emulate ? emulate : "");
  snprintf(g_root, sizeof g_root, "%s/sv_cli_XXXXXX", tmp ? tmp : "/tmp");
  if (!mkdtemp(g_root)) return -1;
  make_captures();
  return 0;
}

FIXTURE(tear_down) {
  shell("rm -rf '%s'", g_root);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_bad_input),
      cmocka_unit_test(test_bad_pictures),
      cmocka_unit_test(test_longer_capture),
      cmocka_unit_test(test_unknown_kernels),
      cmocka_unit_test(test_help),
      cmocka_unit_test(test_help_tells_defaults),
      cmocka_unit_test(test_json_and_digest),
      cmocka_unit_test(test_memory),
      cmocka_unit_test(test_shared_sensor),
      cmocka_unit_test(test_capture_on_a_slow_disk),
      cmocka_unit_test(test_killed_run_goes_on),
      cmocka_unit_test(test_resume_of_another_run),
      cmocka_unit_test(test_interrupt_saves),
      cmocka_unit_test(test_closed_output),
  };
  const char *bin = getenv("SV_BIN");
  char path[512];
  snprintf(path, sizeof path, "%s/subview", bin ? bin : "build/sim-x86/bin");
  if (access(path, X_OK) != 0) {
    printf("%s is not built\n", path);
    return 77;
  }
  return cmocka_run_group_tests(tests, set_up, tear_down);
}
