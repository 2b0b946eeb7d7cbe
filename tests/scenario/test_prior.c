// SPDX-License-Identifier: Apache-2.0
// Sparse-view priors as a user runs them. This program is also the one that --prior external:
// calls: a fixer that knows the simulator's scene, as good as such a program could be.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/sim/sim.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/dataset/dataset.h"

#define SCENE "textured"

static lab_shell shell = {.cwd = ""};
static char self[512];

// --- the program that is called ------------------------------------------------------------------

typedef struct {
  sv_sim sim;
  uint8_t *rgb;
  float *depth;
} oracle;

static int write_pfm(const char *folder, int i, const sv_view *v, const float *depth) {
  char path[SV_CAP_PATH];
  snprintf(path, sizeof path, "%s/answer_%03d_depth.pfm", folder, i);
  FILE *f = fopen(path, "wb");
  if (!f) return 1;
  fprintf(f, "Pf\n%d %d\n-1.0\n", v->width_px, v->height_px);
  for (int y = v->height_px - 1; y >= 0; y--)
    fwrite(depth + (size_t)y * (size_t)v->width_px, sizeof *depth, (size_t)v->width_px, f);
  return fclose(f) != 0;
}

static int write_disparity(const char *folder, int i, const sv_view *v, const float *depth) {
  char path[SV_CAP_PATH];
  const size_t n = (size_t)v->width_px * (size_t)v->height_px;
  uint16_t *units = malloc(n * sizeof *units);
  if (!units) return 1;
  for (size_t k = 0; k < n; k++) units[k] = depth[k] > 0 ? (uint16_t)(20000.0f / depth[k] + 5000.0f) : 5000;
  const sv_bitmap b = {v->width_px, v->height_px, 1, 16, NULL, units};
  snprintf(path, sizeof path, "%s/answer_%03d_disparity.png", folder, i);
  const bool is_bad = sv_bitmap_write_png(path, &b, NULL) != SV_OK;
  free(units);
  return is_bad;
}

static int answer(oracle *o, const char *mode, const char *folder, const lab_views *views) {
  int bad = 0;
  const bool is_pictures = strcmp(views->frames[0].f.file_path, "picture_000.png") == 0;
  for (int i = 0; i < views->n; i++) {
    const sv_view *v = &views->frames[i].view;
    char path[SV_CAP_PATH];
    sv_sim_render(&o->sim, v, 0, o->rgb, o->depth);
    const sv_bitmap b = {v->width_px, v->height_px, 3, 8, o->rgb, NULL};
    snprintf(path, sizeof path, "%s/answer_%03d.png", folder, i);
    if (strstr(mode, "pictures") && !is_pictures) bad += sv_bitmap_write_png(path, &b, NULL) != SV_OK;
    if (strstr(mode, "disparity")) bad += write_disparity(folder, i, v, o->depth);
    if (strstr(mode, "metric")) bad += write_pfm(folder, i, v, o->depth);
  }
  return bad;
}

static int fix(const char *mode, const char *folder) {
  static oracle o;
  sv_err err = {0};
  sv_sim_config cfg;
  static sv_linux_pool threads;
  lab_views views;
  lab_source src = {.folder = folder, .transforms = "request.json", .split = "all", .scale = 1};
  if (sv_sim_parse(&cfg, SCENE ",rig=mono,size=640x640", &err) < 0) return 3;
  size_t bytes = sv_sim_bytes(&cfg) + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  sv_arena a = sv_arena_make(block, bytes);
  o.rgb = malloc(3 * 640 * 640);
  o.depth = malloc(640 * 640 * sizeof *o.depth);
  if (sv_sim_init(&o.sim, &cfg, &a, &err) < 0) return 3;
  if (sv_linux_pool_start(&threads, 1, 0, &err) < 0) return 3;
  sv_pool pool = sv_linux_pool_port(&threads);
  if (lab_views_open(&views, &src, &pool, &err) < 0) {
    fprintf(stderr, "%s\n", err.text);
    return 3;
  }
  int bad = answer(&o, mode, folder, &views);
  lab_views_free(&views);
  free(block);
  free(o.rgb);
  free(o.depth);
  return bad;
}

// --- tests ---------------------------------------------------------------------------------------

// A training of one camera's only exposure; `prior` stands for its options, # in it for this
// program as a fixer.
static int train(const char *out, const char *prior) {
  char line[2048];
  size_t at =
      (size_t)snprintf(line, sizeof line,
                       "@ train --data s --transforms transforms_train_mono.json --exposures 1 --gaussians "
                       "1500 --steps 300 --quiet --json --eval --out %s ",
                       out);
  for (; *prior && at + sizeof self + 16 < sizeof line; prior++) {
    if (*prior == '#') at += (size_t)snprintf(line + at, sizeof line - at, "%s --fix", self);
    else line[at++] = *prior;
  }
  line[at] = 0;
  return lab_shell_run(&shell, line);
}

static double number(const char *key) {
  char text[64];
  snprintf(text, sizeof text, "\"%s\": ", key);
  const char *p = strstr(shell.said, text);
  if (!p) fail_msg("no %s in: %s", key, shell.said);
  return p ? strtod(p + strlen(text), NULL) : 0;
}

static double psnr_of(const char *out, const char *prior) {
  if (train(out, prior) != 0) fail_msg("%s: %s", prior, shell.said);
  return number("psnr");
}

FIXTURE(setup) {
  const int code = lab_shell_open(&shell, "prior");
  if (code != 0) return code < 0 ? code : 0;
  const ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
  self[n > 0 ? n : 0] = 0;
  shell.is_ready =
      n > 0 && lab_shell_run(&shell, "@ import --from sim " SCENE ",size=96x72 --out s --quiet") == 0;
  if (!shell.is_ready) fprintf(stderr, "%s", shell.said);
  return shell.is_ready ? 0 : -1;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

// From views that a fixer completed the model learns what one camera could not see.
TEST(test_pictures) {
  lab_shell_need(&shell);
  const double none = psnr_of("none", "");
  const double fixed =
      psnr_of("fixed", "--prior 'external:# pictures' --prior-calls 6 --prior-weight 1 --prior-views 4");
  assert_int_equal((int)number("prior_calls"), 7);
  assert_int_equal((int)number("prior_pictures"), 24);
  assert_int_equal((int)number("prior_depths"), 0);
  print_message("held-out PSNR %.2f dB, with a fixer %.2f\n", none, fixed);
  if (!(fixed > none + 1.5)) fail_msg("a fixer that knows the scene: %.2f dB, %.2f without", fixed, none);
  lab_shell_run_well(&shell, "cd fixed/prior/call_03 && ls render_003.png depth_003.png reference_003.png "
                             "answer_003.png request.json log.txt");
}

// What only says how far things are, too: in units of its own, or in the scene's.
TEST(test_depth) {
  lab_shell_need(&shell);
  const double none = psnr_of("none", "");
  const double depth_off = number("abs_rel");
  const double metric = psnr_of("metric", "--prior 'external:# metric' --prior-calls 1 --prior-views 1");
  const double metric_off = number("abs_rel");
  // without a picture, no pseudo-view to have depth
  assert_int_equal((int)number("prior_depths"), 1);
  const double relative =
      psnr_of("relative", "--prior 'external:# disparity' --prior-calls 1 --prior-views 1");
  const double relative_off = number("abs_rel");
  print_message("PSNR and AbsRel %.2f, %.4f; with metric depth %.2f, %.4f; with disparity %.2f, %.4f\n", none,
                depth_off, metric, metric_off, relative, relative_off);
  assert_true(metric_off < 0.7 * depth_off && relative_off < 0.9 * depth_off);
}

// The same answers give the same model, for any number of threads.
TEST(test_same_bits) {
  char first[64];
  lab_shell_need(&shell);
  (void)psnr_of("a", "--threads 2 --prior 'external:# pictures,disparity' --prior-calls 2 --prior-views 2");
  snprintf(first, sizeof first, "%.30s",
           strstr(shell.said, "\"digest\"") ? strstr(shell.said, "\"digest\"") : "");
  (void)psnr_of("b", "--threads 1 --prior 'external:# pictures,disparity' --prior-calls 2 --prior-views 2");
  assert_contains(shell.said, first);
}

// A program that fails before the first step stops the run; later on, training continues without
// it.
TEST(test_failures) {
  lab_shell_need(&shell);
  assert_int_equal(train("f", "--prior 'external:echo no such net; exit 7;'"), 1);
  assert_contains(shell.said, "exit code 7: no such net");
  assert_int_equal(train("f", "--prior 'external:sleep 60;' --prior-limit 0.2"), 1);
  assert_contains(shell.said, "stopped after 0.2 s");
  assert_int_equal(train("f", "--prior 'external:kill -9 $$;'"), 1);
  assert_contains(shell.said, "signal 9");
  const char *const later = "--prior 'external:test ! -e f/prior/call_01 ||' --prior-calls 2";
  assert_int_equal(train("f", later), 0);
  assert_contains(shell.said, "training continues without");
  assert_contains(shell.said, "\"psnr\"");
  lab_shell_run_well(&shell, "grep -c '\"prior_failed\": true' f/train.json");
  const char *const damaged = "--prior 'external:head -c 99 s/test/r_000.png > "
                              "f/prior/call_00/answer_000_depth.png; :' --prior-calls 2";
  assert_int_equal(train("f", damaged), 1);
  assert_contains(shell.said, "answer_000_depth.png");
  const char *const odd = "--prior 'external:cp s/test/r_000.png f/prior/call_00/answer_000_depth.png; :'";
  assert_int_equal(train("f", odd), 1);
  assert_contains(shell.said, "3 channels, expected one");
  const char *const pfm =
      "--prior 'external:printf \"Pf\\n9 9\\n-1\\n\" > f/prior/call_00/answer_000_depth.pfm; :'";
  assert_int_equal(train("f", pfm), 1);
  assert_contains(shell.said, "9x9 pixels, expected the 96x72");
}

// FSGS and SparseGS on a stereo pair, whose views tell of depth themselves; and on one camera with
// estimated depth, from a program or from files that the dataset names.
TEST(test_methods) {
  lab_shell_need(&shell);
  static const char *const names[] = {"fsgs", "sparsegs"};
  lab_shell_run_well(&shell,
                     "@ train --data s --transforms transforms_train_stereo.json --exposures 1 --gaussians "
                     "1500 --steps 300 --quiet --json --eval --out m");
  const double stereo = number("psnr");
  for (int i = 0; i < 2; i++) {
    char line[512];
    snprintf(line, sizeof line,
             "@ train --data s --transforms transforms_train_stereo.json --exposures 1 --gaussians 1500 "
             "--steps 300 --quiet "
             "--json --eval --out m --prior %s",
             names[i]);
    lab_shell_run_well(&shell, line);
    assert_int_equal((int)number("prior_depth_maps"), 2);
    // FSGS warps depth, and pruning needs a second opinion about it: no map is given.
    assert_true((number("prior_warped") > 10) == (i == 1));
    assert_true(number("prior_pruned") == 0);
    print_message("stereo, %s: PSNR %.2f dB, AbsRel %.4f\n", names[i], number("psnr"), number("abs_rel"));
    assert_true(number("psnr") > stereo - 0.3);
    lab_shell_run_well(&shell, i ? "grep -q '\"prior\": \"sparsegs\"' m/train.json"
                                 : "grep -q '\"prior\": \"fsgs\"' m/train.json");
  }
  const double db = psnr_of("n", "");
  const double off = number("abs_rel");
  (void)psnr_of("d", "--prior 'fsgs,external:# disparity' --prior-calls 1 --prior-views 1");
  assert_int_equal((int)number("prior_depths"), 1);
  const double prior_off = number("abs_rel"), prior_db = number("psnr");
  print_message("one camera: PSNR and AbsRel %.2f, %.4f, with FSGS and estimated depth %.2f, %.4f\n", db, off,
                prior_db, prior_off);
  assert_true(prior_off < 0.5 * off && prior_db > db + 2.5);
  lab_shell_run_well(&shell, "cp d/prior/call_00/answer_000_disparity.png s/e0.png && sed "
                             "'s/\"camera\"/\"disparity_prior\": \"e0.png\", \"camera\"/' "
                             "s/transforms_train_mono.json > s/with.json");
  lab_shell_run_well(
      &shell, "@ train --data s --transforms with.json --exposures 1 --gaussians 1500 --steps 30 --quiet "
              "--json --out w --prior sparsegs");
  assert_int_equal((int)number("prior_depth_files"), 1);
  assert_int_equal(
      lab_shell_run(&shell, "rm s/e0.png; @ train --data s --transforms with.json --exposures 1 --steps 30 "
                            "--quiet --out w --prior sparsegs"),
      1);
  assert_contains(shell.said, "e0.png");
}

// The runtime itself, on the simulator: the same model from any number of threads, in the block
// that was planned.
TEST(test_run) {
  static const char *const methods[] = {"fsgs", "sparsegs"};
  char line[600];
  lab_shell_need(&shell);
  for (int i = 0; i < 2; i++) {
    for (int n = 1; n <= 2; n++) {
      snprintf(
          line, sizeof line,
          "$(dirname @)/subview run --source sim:textured,rig=stereo,size=96x72 --exposures 2 --steps 120 "
          "--gaussians "
          "800 --threads %d --prior %s --overwrite --out r%d --quiet && grep -h '\"digest\"' r%d/run.json > "
          "digest%d",
          n, methods[i], n, n, n);
      lab_shell_run_well(&shell, line);
    }
    lab_shell_run_well(&shell, "test -s digest1 && cmp digest1 digest2");
    snprintf(line, sizeof line, "grep -q '\"prior\": \"%s\"' r1/run.json && grep -q '\"priors\"' r1/run.json",
             methods[i]);
    lab_shell_run_well(&shell, line);
    snprintf(line, sizeof line, "$(dirname @)/subview plan --prior %s | grep priors", methods[i]);
    lab_shell_run_well(&shell, line);
  }
  assert_int_equal(
      lab_shell_run(&shell, "$(dirname @)/subview run --source sim:textured,rig=multiplexed --exposures 1 "
                            "--steps 5 --gaussians 500 --prior fsgs --out r3 --quiet"),
      1);
  assert_contains(shell.said, "not on multiplexed sensors");
  assert_int_equal(
      lab_shell_run(&shell, "$(dirname @)/subview run --source sim:textured --prior fsgs --live --out r1"),
      2);
  assert_int_equal(
      lab_shell_run(&shell, "$(dirname @)/subview run --source sim:textured --prior magic --out r1"), 2);
}

TEST(test_refusals) {
  lab_shell_need(&shell);
  assert_int_equal(lab_shell_run(&shell,
                                 "@ train --data s --transforms transforms_train_multiplexed.json --steps 5 "
                                 "--quiet --out m --prior external:true"),
                   1);
  assert_contains(shell.said, "not on multiplexed sensors");
  assert_int_equal(lab_shell_run(&shell,
                                 "@ train --data s --transforms transforms_train_multiplexed.json --steps 5 "
                                 "--quiet --out m --prior fsgs"),
                   1);
  assert_contains(shell.said, "not on multiplexed sensors");
  assert_int_equal(train("f", "--prior external:"), 2);
  assert_int_equal(train("f", "--prior magic"), 2);
  assert_int_equal(train("f", "--prior-views 3"), 2);
  assert_contains(shell.said, "need --prior external");
  assert_int_equal(train("f", "--prior external:true --model 4dgs"), 2);
}

int main(int argc, char **argv) {
  if (argc == 4 && strcmp(argv[1], "--fix") == 0) return fix(argv[2], argv[3]);
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_pictures),  cmocka_unit_test(test_depth),
                                     cmocka_unit_test(test_same_bits), cmocka_unit_test(test_failures),
                                     cmocka_unit_test(test_methods),   cmocka_unit_test(test_run),
                                     cmocka_unit_test(test_refusals)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
