// SPDX-License-Identifier: Apache-2.0
// Instructions of five training steps, and of a whole command to a held-out PSNR, against
// tests/budget/counts.csv. The program runs itself under callgrind:
//
//   test_budget_counts            compares
//   test_budget_counts --accept   measures, and writes the record anew (make accept-counts)
//   test_budget_counts --run ISA  the fixed run itself: one thread, 2,000 Gaussians, 160x120
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/test.h"
#include "tools/bench/bench.h"
#include "tests/budget/counts.h"
#include "tests/budget/quality.h"

#define RECORD  "tests/budget/counts.csv"
#define N_STEPS 5 // one of them estimates the curvature

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__OPTIMIZE__)
#define IS_OTHER_CODE 1
#else
#define IS_OTHER_CODE 0
#endif

static const sv_isa isas[] = {SV_ISA_SSE41, SV_ISA_AVX2}; // callgrind knows no AVX-512
#define N_ISAS (sizeof isas / sizeof *isas)

// --- the fixed run -------------------------------------------------------------------------------

static int run(const char *isa_name) {
  static sv_bench_scene scene;
  sv_bench_step size = {.n_gaussians = 2000, .width_px = 160, .height_px = 120, .n_threads = 1};
  size_t bytes = sv_bench_scene_bytes(&size) + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  sv_arena a = sv_arena_make(block, block ? bytes : 0);
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_err err = {0};
  int isa = sv_isa_by_name(isa_name);
  if (isa < 0 || !(sv_cpu_isas() & SV_ISA_BIT(isa))) return 2;
  sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
  sv_status s = sv_bench_scene_make(&scene, &size, (sv_compute){&k, &pool}, 1, &a, &err);
  for (int i = 0; i < N_STEPS && s >= 0; i++) {
    sv_step_stats st;
    s = sv_train_step(&scene.t, 0.5f, &st);
  }
  free(block);
  if (s < 0) fprintf(stderr, "%s\n", err.text);
  return s < 0;
}

// --- counting ------------------------------------------------------------------------------------

// The fixed run in the variants from `first` on.
static bool count(counts_table *t, size_t first, char *err, size_t cap) {
  char self[4096], command[14000], file[4200];
  char folder[4096];
  ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
  if (n < 0) return snprintf(err, cap, "this program does not find itself"), false;
  self[n] = 0;
  memset(t, 0, sizeof *t);
  snprintf(t->compiler, sizeof t->compiler, "%s", counts_compiler());
  if (temp_folder_make(folder, sizeof folder, "counts") < 0)
    return snprintf(err, cap, "no folder for the counts can be made"), false;
  bool is_good = true;
  for (size_t i = first; i < N_ISAS && is_good; i++) {
    const char *isa = sv_isa_name(isas[i]);
    snprintf(file, sizeof file, "%s/%s", folder, isa);
    snprintf(command, sizeof command,
             "valgrind -q --tool=callgrind --callgrind-out-file='%s' --toggle-collect=sv_train_step "
             "--dump-line=no "
             "--compress-strings=no --compress-pos=no --log-file='%s.log' '%s' --run %s",
             file, file, self, isa);
    if (system(command) != 0 || !counts_add_callgrind(t, file, isa)) {
      snprintf(err, cap, "callgrind did not count the run: %.1800s", command);
      is_good = false;
    }
  }
  if (is_good && first == 0) is_good = quality_count(t, folder, err, cap);
  temp_folder_remove(folder);
  return is_good;
}

// Why nothing can be counted here; NULL when it can.
static const char *reason_to_skip(void) {
  const char *emulator = getenv("SV_EMULATE");
  if (emulator && *emulator) return "instructions of an emulated program are not counted";
  if (IS_OTHER_CODE) return "a sanitized or unoptimised build is other code than the one on record";
  for (size_t i = 0; i < N_ISAS; i++)
    if (!(sv_cpu_isas() & SV_ISA_BIT(isas[i])))
      return "this CPU has no SSE4.1 or no AVX2, whose kernels are counted";
  if (system("valgrind --version >/dev/null 2>&1") != 0)
    return "valgrind is not installed, which counts the instructions";
  return NULL;
}

// --- tests ---------------------------------------------------------------------------------------

static counts_table record, now;

TEST(test_counts) {
  char text[2000];
  const char *why = reason_to_skip();
  if (why) {
    print_message("skip  %s\n", why);
    skip();
  }
  if (!counts_read(&record, RECORD, text, sizeof text)) fail_msg("%s", text);
  if (strcmp(record.compiler, counts_compiler()) != 0) {
    print_message("skip  %s counts the code of %s, this is that of %s\n", RECORD, record.compiler,
                  counts_compiler());
    skip();
  }
  if (!count(&now, 0, text, sizeof text)) fail_msg("%s", text);
  for (size_t i = 0; i < N_ISAS; i++) {
    const counts_row *is = counts_find(&now, sv_isa_name(isas[i]), "sv_train_step"),
                     *was = counts_find(&record, sv_isa_name(isas[i]), "sv_train_step");
    assert_non_null(is);
    if (!was)
      fail_msg("%s has no sv_train_step of %s; make accept-counts adds it", RECORD, sv_isa_name(isas[i]));
    print_message("%s: %.3f million instructions in %d steps, on record %.3f (%+.1f %%)\n", is->isa,
                  1e-6 * (double)is->instructions, N_STEPS, 1e-6 * (double)was->instructions,
                  100 * ((double)is->instructions / (double)was->instructions - 1));
  }
  if (counts_compare(&record, &now, text, sizeof text) > 0) fail_msg("%s", text);
}

// The counted command reaches its quality: fewer instructions for less are no gain.
TEST(test_quality) {
  char folder[4096];
  if (reason_to_skip()) skip();
  assert_int_equal(temp_folder_make(folder, sizeof folder, "quality"), 0);
  const double psnr = quality_psnr(folder);
  temp_folder_remove(folder);
  const counts_row *r = counts_find(&now, "avx2", QUALITY_ROW);
  print_message("%.2f dB, %.0f million instructions\n", psnr, r ? 1e-6 * (double)r->instructions : 0);
  assert_psnr(psnr, QUALITY_DB);
}

// Counted again, the run takes as many instructions: the measure itself is not the noise.
TEST(test_repeatable) {
  static counts_table again;
  char text[2000];
  if (now.n_rows == 0) {
    print_message("skip  nothing was counted\n");
    skip();
  }
  if (!count(&again, N_ISAS - 1, text, sizeof text)) fail_msg("%s", text);
  for (int i = 0; i < again.n_rows; i++) {
    const counts_row *r = again.row + i, *first = counts_find(&now, r->isa, r->function);
    assert_non_null(first);
    double a = (double)first->instructions, b = (double)r->instructions;
    if (b > 1.001 * a || a > 1.001 * b) fail_msg("%s: %.0f, then %.0f instructions", r->function, a, b);
  }
}

TEST(test_worse_is_red) {
  static counts_table was, is;
  char text[600];
  was.n_rows = is.n_rows = 2;
  was.row[0] = is.row[0] = (counts_row){"avx2", "sv_raster_avx2", 1000000};
  was.row[1] = is.row[1] = (counts_row){"avx2", "sv_train_step", 5000000};
  assert_int_equal(counts_compare(&was, &is, text, sizeof text), 0);
  is.row[0].instructions = 1029000;
  is.row[1].instructions = 3000000;
  assert_int_equal(counts_compare(&was, &is, text, sizeof text), 0);
  is.row[0].instructions = 1031000;
  assert_int_equal(counts_compare(&was, &is, text, sizeof text), 1);
  assert_contains(text, "sv_raster_avx2: 1031000 instructions, 3.1 % more");
  assert_contains(text, "make accept-counts");
  is.row[0].instructions = is.row[1].instructions = 9000000;
  assert_int_equal(counts_compare(&was, &is, text, 20), 2); // more than the text holds
  snprintf(is.row[0].function, sizeof is.row[0].function, "sv_new_avx2");
  assert_int_equal(counts_compare(&was, &is, text, sizeof text),
                   1); // of no record, but the step's sum has it
}

TEST(test_record) {
  static counts_table a = {"gcc 1 (of a test)", 1, {{"avx2", "sv_adam_avx2", 12345678901234ull}}}, b;
  char folder[4096], path[4200], text[5000];
  assert_int_equal(temp_folder_make(folder, sizeof folder, "counts"), 0);
  snprintf(path, sizeof path, "%s/counts.csv", folder);
  assert_false(counts_read(&b, path, text, sizeof text));
  assert_contains(text, "make accept-counts");
  assert_true(counts_write(&a, path) && counts_read(&b, path, text, sizeof text));
  assert_int_equal(b.n_rows, 1);
  assert_string_equal(b.compiler, a.compiler);
  assert_true(b.row[0].instructions == a.row[0].instructions);
  FILE *f = fopen(path, "a");
  fputs("avx2,sv_adam_avx2\n", f);
  fclose(f);
  assert_false(counts_read(&b, path, text, sizeof text));
  assert_contains(text, "line 6");
  f = fopen(path, "w");
  fputs("events: Ir\nfl=x.c\nfn=sv_adam_avx2\n0 70\ncfn=memset\ncalls=3 0\n0 30\nfn=helper\n0 "
        "9\nfn=sv_adam_avx2\n0 1\n",
        f);
  fclose(f);
  memset(&b, 0, sizeof b);
  assert_true(counts_add_callgrind(&b, path, "avx2") && b.n_rows == 1);
  assert_int_equal(b.row[0].instructions, 101);
  temp_folder_remove(folder);
}

static int accept(void) {
  char text[2000];
  const char *why = reason_to_skip();
  if (why || !count(&now, 0, text, sizeof text) || !counts_write(&now, RECORD)) {
    fprintf(stderr, "the record stays as it is: %s\n",
            why     ? why
            : *text ? text
                    : RECORD " cannot be written");
    return 1;
  }
  printf("%s: %d functions as compiled by %s\n", RECORD, now.n_rows, now.compiler);
  return 0;
}

int main(int argc, char **argv) {
  if (argc == 3 && strcmp(argv[1], "--run") == 0) return run(argv[2]);
  if (argc == 2 && strcmp(argv[1], "--accept") == 0) return accept();
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_worse_is_red), cmocka_unit_test(test_record),
                                     cmocka_unit_test(test_counts), cmocka_unit_test(test_quality),
                                     cmocka_unit_test(test_repeatable)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
