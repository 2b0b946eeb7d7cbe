// SPDX-License-Identifier: Apache-2.0
// `subview-lab tables` as a user runs it, on a tiny simulated dataset: what it writes, going on
// after a stop and after damage, jobs by other engines, without gnuplot, and bad input. SV_BIN
// names the programs' folder. Skipped under emulation: a shell starts the program again, which an
// emulator does not do.
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#define SIDE_PX          48
#define N_RUNS           21
#define PARALLEL_SETTING "--data ../s --quick --steps 3 --gaussians 40"
#define SETTING          PARALLEL_SETTING " --jobs 1"

// Commands run in w, beside the dataset s.
static lab_shell shell = {.cwd = "", .is_stdout_apart = true};

static int run(const char *line) { return lab_shell_run(&shell, line); }
static void run_well(const char *line) { lab_shell_run_well(&shell, line); }

static int count(const char *text, const char *word) {
  int n = 0;
  for (const char *p = text; (p = strstr(p, word)); p += strlen(word)) n++;
  return n;
}

static char *slurp(const char *name) {
  char path[600];
  snprintf(path, sizeof path, "w/%.500s", name);
  return temp_read(shell.root, path);
}

static bool exists(const char *name) {
  char path[900];
  snprintf(path, sizeof path, "%s/w/%.500s", shell.root, name);
  return sv_path_exists(path);
}

// Field i of a CSV line.
static void field(const char *line, int i, char *out, size_t cap) {
  while (i-- > 0) {
    line += strcspn(line, ",\n");
    if (*line == ',') line++;
  }
  snprintf(out, cap, "%.*s", (int)strcspn(line, ",\n"), line);
}

// The figures of a table (device, exposures, setting, five figures), without what depends on time.
static void figures_of(const char *name, char *out, size_t cap) {
  char *text = slurp(name), cell[80];
  size_t at = 0;
  for (char *line = text; *line; line += strcspn(line, "\n") + 1) {
    for (int i = 0; i < 10 && at < cap; i++) {
      field(line, i, cell, sizeof cell);
      at += (size_t)snprintf(out + at, cap - at, "%s ", cell);
    }
    at += (size_t)snprintf(out + at, at < cap ? cap - at : 0, "\n");
  }
  assert_true(at < cap);
  free(text);
}

FIXTURE(setup) {
  char command[80];
  char here[500];
  int code = lab_shell_open(&shell, "tables");
  if (!getcwd(here, sizeof here - 20)) return -1;
  strcat(here, "/tools/tables");
  setenv("SV_TABLES", here, 1);
  if (code != 0) return code < 0 ? code : 0;
  if (run("mkdir w") != 0) return -1;
  shell.cwd = "w";
  snprintf(command, sizeof command, "@ import --from sim textured,size=%dx%d --out ../s --quiet", SIDE_PX,
           SIDE_PX);
  if (run(command) != 0) return -1;
  // Two angles, so that there is a curve over them.
  // All frames of one time, as renderers write them: a still scene all the same.
  if (run("sed -i 's/\"file_path\"/\"time\": 0.0, \"file_path\"/' ../s/transforms_*.json") != 0) return -1;
  if (run("for d in stereo lightfield; do mv ../s/transforms_train_$d.json "
          "../s/transforms_train_${d}_theta10.json; "
          "cp ../s/transforms_train_${d}_theta10.json ../s/transforms_train_${d}_theta2.json; done") != 0)
    return -1;
  if (run("@ tables " SETTING " --out a") != 0) {
    fprintf(stderr, "%s", shell.said);
    return -1;
  }
  shell.is_ready = true;
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

// --- what is written -----------------------------------------------------------------------------

TEST(test_rows) {
  static const struct {
    const char *file;
    int n_rows;
  } files[] = {{"a/summary.csv", 10}, {"a/depth.csv", 10}, {"a/angle.csv", 5},  {"a/exposures.csv", 10},
               {"a/init.csv", 4},     {"a/tv.csv", 4},     {"a/count.csv", 12}, {"a/scenes.csv", 10}};
  lab_shell_need(&shell);
  for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
    char *text = slurp(files[i].file), *line = text;
    if (count(text, "\n") != files[i].n_rows + 1)
      fail_msg("%s has %d lines, not %d", files[i].file, count(text, "\n"), files[i].n_rows + 1);
    int i_psnr = strcmp(files[i].file, "a/scenes.csv") == 0 ? 4 : 5;
    for (line += strcspn(line, "\n") + 1; *line; line += strcspn(line, "\n") + 1)
      for (int k = 0; k < 11; k++) { // PSNR to the process's memory: all there
        char cell[80], *end;
        field(line, i_psnr + k, cell, sizeof cell);
        double v = strtod(cell, &end);
        if (end == cell || *end || !isfinite(v) || v < 0 || (v == 0 && k != 7))
          fail_msg("%s: field %d is '%s' in %.200s", files[i].file, i_psnr + k, cell, line);
      }
    free(text);
  }
}

// One exposure is scored near, three are scored all around, the curve of exposures always all
// around.
TEST(test_protocol) {
  char cell[3][40];
  lab_shell_need(&shell);
  for (int is_curve = 0; is_curve < 2; is_curve++) {
    char *text = slurp(is_curve ? "a/exposures.csv" : "a/summary.csv"), *line = text;
    for (line += strcspn(line, "\n") + 1; *line; line += strcspn(line, "\n") + 1) {
      field(line, 1, cell[0], sizeof cell[0]);
      field(line, 4, cell[1], sizeof cell[1]);
      field(line, 16, cell[2], sizeof cell[2]);
      assert_string_equal(cell[1], !is_curve && strcmp(cell[0], "1") == 0 ? "test_near" : "test");
      assert_int_equal(*cell[2] != 0, !is_curve); // the paper's PSNR
    }
    free(text);
  }
}

TEST(test_markdown) {
  static const char *const words[] = {"## Image quality, 1 and 3 exposures",
                                      "| 1 | multiplexed |",
                                      "26.39 | 0.891 | 0.098 |", // the paper's
                                      "0.0187 | 0.1098 |",
                                      "17.39 to 31.45",
                                      " of 20 comparisons hold.",
                                      "| 1 | stereo | 2 |",
                                      "all devices",
                                      "**This is a quick run**",
                                      "sheet_s.png",
                                      "What differs from the paper"};
  lab_shell_need(&shell);
  char *text = slurp("a/tables.md");
  for (size_t i = 0; i < sizeof words / sizeof *words; i++)
    if (!strstr(text, words[i])) fail_msg("tables.md does not say '%s'", words[i]);
  // 20 comparisons, those that fail listed one a line: the numbers must agree.
  int n_breaks = count(text, "does not beat"), n_held = -1;
  const char *held = strstr(text, " of 20 comparisons hold.");
  while (held > text && held[-1] >= '0' && held[-1] <= '9') held--;
  sscanf(held, "%d", &n_held);
  assert_int_equal(n_held, 20 - n_breaks);
  free(text);
}

TEST(test_pictures) {
  static const char *const plots[] = {"angle_psnr",      "angle_abs_rel", "exposures_psnr",
                                      "exposures_lpips", "summary_psnr",  "exposures_abs_rel",
                                      "summary_abs_rel"};
  char path[900];
  sv_bitmap b;
  sv_err err;
  lab_shell_need(&shell);
  snprintf(path, sizeof path, "%s/w/a/sheet_s.png", shell.root);
  assert_int_equal(sv_bitmap_read(path, &b, &err), SV_OK);
  assert_int_equal(b.width_px, 5 * (SIDE_PX + 4) - 4);
  // a line of labels above all, and one above each row
  assert_int_equal(b.height_px, 16 + 5 * (16 + SIDE_PX + 4) - 4);
  uint64_t sum[5] = {0}; // of the columns; so few faint Gaussians may have no depth
  for (int y = 0; y < b.height_px; y++)
    for (int x = 0; x < b.width_px; x++)
      if (x % (SIDE_PX + 4) < SIDE_PX && y >= 16 && (y - 16) % (16 + SIDE_PX + 4) >= 16 &&
          (y - 16) % (16 + SIDE_PX + 4) < 16 + SIDE_PX)
        sum[x / (SIDE_PX + 4)] += b.u8[3 * (y * b.width_px + x)];
  for (int i = 0; i < 4; i++) assert_in_range(sum[i], 1, (uint64_t)255 * SIDE_PX * SIDE_PX * 5 - 1);
  sv_bitmap_free(&b);
  bool has_gnuplot = run("command -v gnuplot") == 0;
  for (size_t i = 0; i < sizeof plots / sizeof *plots; i++) {
    snprintf(path, sizeof path, "a/plots/%s.gp", plots[i]);
    assert_true(exists(path));
    snprintf(path, sizeof path, "a/plots/%s.svg", plots[i]);
    assert_int_equal(exists(path), has_gnuplot);
    snprintf(path, sizeof path, "a/plots/%s.png", plots[i]);
    assert_int_equal(exists(path), has_gnuplot);
  }
}

TEST(test_without_gnuplot) {
  lab_shell_need(&shell);
  run_well("cp -r a g && rm -f g/plots/*.png g/plots/*.svg && PATH=/nowhere @ tables " SETTING " --out g");
  assert_int_equal(count(shell.said, "gnuplot not found"), 1);
  assert_true(exists("g/plots/summary_psnr.gp"));
  assert_false(exists("g/plots/summary_psnr.png"));
  char *text = slurp("g/tables.md");
  assert_contains(text, "gnuplot was not found");
  free(text);
}

// --- going on ------------------------------------------------------------------------------------

static void assert_done(int n_before, int n_made) {
  char text[80];
  snprintf(text, sizeof text, "%d runs, %d already done", N_RUNS, n_before);
  if (!strstr(shell.said, text)) fail_msg("'%s' is not in: %s", text, shell.said);
  assert_int_equal(count(shell.said, " Gaussians"), n_made);
}

TEST(test_nothing_is_done_twice) {
  lab_shell_need(&shell);
  char *before = slurp("a/runs.csv");
  run_well("@ tables " SETTING " --out a");
  assert_done(N_RUNS, 0);
  char *after = slurp("a/runs.csv");
  assert_string_equal(before, after); // times included: they are the results'
  free(before);
  free(after);
  run_well(
      // other settings: others
      "cp -r a n && @ tables --data ../s --quick --steps 2 --gaussians 40 --jobs 1 --out n --quiet");
  assert_string_equal(shell.said, "");
}

// Cut, emptied, taken away, without its pictures, with a score missing.
TEST(test_damage) {
  static char before[8192], after[8192];
  lab_shell_need(&shell);
  figures_of("a/summary.csv", before, sizeof before);
  run_well("cp -r a d && rm d/summary.csv && cd d/runs && truncate -s -40 "
           "s_stereo_theta10_e1_g40_s3_[0-9a-f]*/train.out.json && "
           "rm s_phone_e1_g40_s3_[0-9a-f]*/near.out.json && "
           "rm s_multiplexed_e3_g40_s3_[0-9a-f]*/train.out.json && "
           "rm -r s_multiplexed_e1_g40_s3_[0-9a-f]*/views && "
           "truncate -s 0 s_mono_e1_g200_s3_[0-9a-f]*/near.out.json");
  run_well("@ tables " SETTING " --out d");
  assert_done(N_RUNS - 5, 5);
  assert_int_equal(count(shell.said, "; measuring again"), 3);
  assert_int_equal(count(shell.said, "its images are missing"), 1);
  figures_of("d/summary.csv", after, sizeof after);
  assert_string_equal(before, after);
}

// --- jobs ----------------------------------------------------------------------------------------

// The same figures by whoever runs the lines; what is missing is told; a line that runs again does
// nothing.
TEST(test_jobs) {
  static char ours[8192], theirs[8192];
  lab_shell_need(&shell);
  figures_of("a/summary.csv", ours, sizeof ours);
  run_well("@ tables " PARALLEL_SETTING " --out j --plan jobs.txt");
  assert_contains(shell.said, "jobs.txt: 21 jobs, one a line");
  run_well("test $(wc -l < jobs.txt) = 21 && ! test -e j/tables.md && head -5 jobs.txt | sh");
  run_well("@ tables " PARALLEL_SETTING " --out j --collect");
  assert_contains(shell.said, "16 of 21 runs are missing, the first: s, ");
  char *text = slurp("j/tables.md");
  assert_contains(text, "**16 of the 21 runs are missing.**");
  assert_contains(text, " - | - |");
  free(text);
  // Twice the same line at once, as two machines might: one lets the other be.
  run_well("SLURM_ARRAY_TASK_ID=7 $SV_TABLES/tables.sbatch jobs.txt && rm -f x.log && "
           "SLURM_ARRAY_TASK_ID=7 $SV_TABLES/tables.sbatch jobs.txt 2>x.log && ! test -s x.log");
  run_well("MAKEFLAGS= make -s -j2 -f $SV_TABLES/jobs.mk JOBS=jobs.txt");
  run_well("@ tables " PARALLEL_SETTING " --out j --collect");
  figures_of("j/summary.csv", theirs, sizeof theirs);
  assert_string_equal(ours, theirs);
  assert_int_equal(count(shell.said, "missing"), 0);
}

TEST(test_parallel) {
  static char ours[8192], theirs[8192];
  lab_shell_need(&shell);
  if (run("parallel --minversion 20130000") != 0) {
    print_message("no GNU parallel here\n");
    skip();
  }
  figures_of("a/summary.csv", ours, sizeof ours);
  run_well("@ tables " PARALLEL_SETTING " --threads 1 --jobs 2 --out k");
  figures_of("k/summary.csv", theirs, sizeof theirs);
  assert_string_equal(ours, theirs);
  run_well("mkdir -p only && ln -sf /bin/* only/ && rm -f only/parallel && PATH=$PWD/only @ "
           "tables " PARALLEL_SETTING " --jobs 2 --out l");
  assert_int_equal(count(shell.said, "GNU parallel not found"), 1);
  assert_int_equal(run("rm -r ../s2; cp -r ../s ../s2 && : > ../s2/train/mono/e00_s00.png && "
                       "@ tables --data ../s2 --quick --steps 3 --gaussians 40 --jobs 2 --out bad"),
                   1);
  assert_contains(shell.said, "e00_s00.png");
}

// A dataset with the same poses and other pictures is another one.
TEST(test_other_pictures) {
  lab_shell_need(&shell);
  run_well("cp -r ../s ../other && rm -r ../other/test_near && cp -r ../other/test ../other/test_near && "
           "mkdir -p o && cp -r a/runs o && mkdir -p x && mv ../other x/s && "
           "@ tables --data x/s --quick --steps 3 --gaussians 40 --jobs 1 --out o");
  assert_done(0, N_RUNS);
}

// Noise on the predicted measurements makes other runs than the same figures on the pictures, and
// none of the devices that have pictures only.
TEST(test_noise_is_a_setting) {
  lab_shell_need(&shell);
  run_well("mkdir -p p && cp -r a/runs p && @ tables " SETTING " --noise prediction,read=0,shot=0 --out p");
  assert_int_equal(count(shell.said, "skipping other devices"), 1);
  assert_int_equal(count(shell.said, ", 0 already done"), 1);
  assert_true(count(shell.said, " Gaussians") > 0 &&
              count(shell.said, " Gaussians") == count(shell.said, "s, multiplexed"));
  run_well("grep -l 'noise_on_prediction\": true' p/runs/*/train.json");
  assert_int_equal(
      run("mkdir -p q/s && cp -r ../s/* q/s && rm q/s/*multiplexed* && @ tables --data q/s --quick "
          "--noise prediction,read=0,shot=0 --out p2"),
      1);
  assert_int_equal(count(shell.said, "no transforms_train_multiplexed.json"), 1);
}

// One's own recording: the first camera alone against all, on whole exposures held out of both.
TEST(test_sub_views) {
  lab_shell_need(&shell);
  run_well(
      "rm -rf ../own && @ import --from sim textured,rig=stereo,size=64x48,exposures=10 --out ../own --quiet "
      "&& rm ../own/transforms_test.json && mv ../own/transforms_train.json ../own/transforms.json");
  run_well("@ tables --data ../own --sub-views --steps 3 --gaussians 60 --jobs 1 --out v");
  assert_contains(shell.said, "../own: 8 views of one camera, 16 of all, 4 held out");
  char *text = slurp("v/real.csv"), cell[2][40];
  const char *mono = strstr(text, "\nown,own,monocular,3DGS,"),
             *rig = strstr(text, "\nown,own,all cameras,3DGS,");
  assert_true(mono && rig);
  for (int i = 5; i < 12; i++) {
    field(mono + 1, i, cell[0], sizeof cell[0]);
    field(rig + 1, i, cell[1], sizeof cell[1]);
    assert_true(strtod(cell[0], NULL) > 0 && strtod(cell[1], NULL) > 0);
    if (i == 8) assert_string_equal(cell[0], cell[1]); // the shared pixels
  }
  free(text);
  assert_int_equal(run("@ tables --data ../s --sub-views --out v2"), 1);
  assert_contains(shell.said, "has neither transforms_train.json nor transforms.json");
}

TEST(test_stop) {
  lab_shell_need(&shell);
  // The first run is long enough to be stopped in; SIGTERM reaches the program only, Ctrl-C would
  // do the same.
  int code = run("@ tables --data ../s --quick --steps 2000000 --gaussians 40 --out i & p=$!; "
                 "for i in $(seq 200); do ls i/runs/*/log.txt >/dev/null 2>&1 && break; sleep 0.05; done; "
                 "sleep 0.3; kill -TERM $p; wait $p");
  assert_int_equal(code, 1);
  assert_int_equal(count(shell.said, "stopped by request with 0 of 21 runs done; run the same command again"),
                   1);
  assert_false(exists("i/tables.md"));
  assert_int_equal(run("ls i/runs/*/train.out.json"), 2); // none
  // No child is left: each would hold its log open.
  assert_int_equal(
      run("for f in /proc/[0-9]*/fd/2; do case $(readlink $f) in \"$PWD\"/i/runs/*) exit 9;; esac; done"), 0);
}

// --- bad input -----------------------------------------------------------------------------------

TEST(test_bad_input) {
  static const struct {
    const char *args;
    int code;
    const char *says;
  } cases[] = {
      {"--data ../s", 2, "--out is missing"},
      {"--out b", 2, "--data is missing"},
      {"--data ../s --steps 0 --out b", 2, "--steps 0: expected a whole number"},
      {"--data ../s --gaussians 1000000 --out b", 2, "--gaussians 1000000: expected a whole number"},
      {"--data ../s --noise loud --out b", 2, "--noise is [prediction,]read=V,shot=V"},
      {"--data ../s --plan x --collect --out b", 2, "--plan and --collect cannot be combined"},
      {"--data ../s --plan x --jobs 2 --out b", 2, "--jobs has no effect with --plan"},
      {"--data ../s --json --out b", 2, "unknown option '--json'"},
      {"--data ../s extra --out b", 2, "unexpected argument 'extra'"},
      {"--data nowhere --out b", 1, "nowhere: no such folder"},
      {"--data ../s, --out b", 1, "one of them is empty"},
      {"--data ../s,../s/../s --out b", 1, "twice"},
      {"--data ../s/test --out b", 1, "has no file transforms_train_DEVICE.json"},
      {"--data bad_json --out b", 1, "transforms_train_mono.json:2: not JSON"},
      {"--data no_picture --out b", 1, "image not found"},
      {"--data no_test --out b", 1, "has no transforms_test.json"},
      {"--data ../s --quick --steps 3 --gaussians 40 --out file", 1, "file"},
  };
  lab_shell_need(&shell);
  run_well("mkdir bad_json && echo '{\"frames\": [' > bad_json/transforms_train_mono.json && "
           "cp -r ../s no_picture && rm no_picture/train/mono/e01_s00.png && "
           "mkdir no_test && cp -r ../s/train ../s/transforms_train_mono.json no_test && : > file");
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    char line[300];
    snprintf(line, sizeof line, "@ tables %s", cases[i].args);
    int code = run(line);
    if (code != cases[i].code || count(shell.said, "\n") != 1 || !strstr(shell.said, cases[i].says))
      fail_msg("%s: exit %d, not %d with '%s': %s", line, code, cases[i].code, cases[i].says, shell.said);
    assert_false(exists("b"));
  }
}

// Many more Gaussians than depth maps give points: the plan has room for what depth maps give,
// however many are asked for.
TEST(test_many_start_on_the_surface) {
  lab_shell_need(&shell);
  if (run("@ train --data ../s --transforms transforms_train_stereo_theta10.json --exposures 1 "
          "--gaussians 18000 --init stereo --steps 1 --out many") != 0)
    fail_msg("%s", shell.said);
  if (!strstr(shell.said, "points from depth maps of 2 views")) fail_msg("%s", shell.said);
  assert_true(exists("many/model.ply"));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_many_start_on_the_surface),
                                     cmocka_unit_test(test_rows),
                                     cmocka_unit_test(test_protocol),
                                     cmocka_unit_test(test_markdown),
                                     cmocka_unit_test(test_pictures),
                                     cmocka_unit_test(test_without_gnuplot),
                                     cmocka_unit_test(test_nothing_is_done_twice),
                                     cmocka_unit_test(test_damage),
                                     cmocka_unit_test(test_jobs),
                                     cmocka_unit_test(test_parallel),
                                     cmocka_unit_test(test_other_pictures),
                                     cmocka_unit_test(test_noise_is_a_setting),
                                     cmocka_unit_test(test_sub_views),
                                     cmocka_unit_test(test_stop),
                                     cmocka_unit_test(test_bad_input)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
