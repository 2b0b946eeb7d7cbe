// SPDX-License-Identifier: Apache-2.0
#include "tests/common/test.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "tools/common/fileio.h"

char temp_folder[256];

// --- assertions ----------------------------------------------------------------------------------

void assert_near_at(double got, double expected, double tolerance, const char *what, test_place at) {
  if (fabs(got - expected) <= tolerance) return;
  print_error("%s: %.15g, expected %.15g within %g\n", what, got, expected, tolerance);
  _fail(at.file, at.line);
}

void assert_floats_near_at(const float *got, const float *expected, size_t n, double tolerance,
                           const char *what, test_place at) {
  for (size_t i = 0; i < n; i++) {
    if (fabs((double)got[i] - (double)expected[i]) <= tolerance) continue;
    print_error("%s[%zu]: %.9g, expected %.9g within %g\n", what, i, (double)got[i], (double)expected[i],
                tolerance);
    _fail(at.file, at.line);
  }
}

void assert_psnr_at(double got_db, double least_db, const char *what, test_place at) {
  if (got_db >= least_db && got_db < 100) return;
  print_error("%s: %.3f dB, expected at least %g dB\n", what, got_db, least_db);
  _fail(at.file, at.line);
}

void assert_ok_at(sv_status s, const char *message, const char *what, test_place at) {
  if (s == SV_OK) return;
  print_error("%s: %s: %s\n", what, sv_status_name(s), message);
  _fail(at.file, at.line);
}

void assert_error_at(sv_status s, sv_status expected, const char *message, const char *part, const char *what,
                     test_place at) {
  if (s == expected && strstr(message, part)) return;
  print_error("%s: %s \"%s\", expected %s with \"%s\"\n", what, sv_status_name(s), s < 0 ? message : "",
              sv_status_name(expected), part);
  _fail(at.file, at.line);
}

void assert_contains_at(const char *text, const char *part, bool is_expected, test_place at) {
  if ((strstr(text, part) != NULL) == is_expected) return;
  print_error("\"%s\" %s in: %s\n", part, is_expected ? "is missing" : "was not expected", text);
  _fail(at.file, at.line);
}

bool is_one_sentence(const char *text) {
  size_t n = strlen(text);
  if (n < 15 || n > 255) return false;
  for (size_t i = 0; i < n; i++)
    if ((unsigned char)text[i] < 32 || text[i] == 127) return false;
  return true;
}

void assert_one_sentence_at(const char *text, test_place at) {
  if (is_one_sentence(text)) return;
  print_error("not one printable sentence: \"%s\"\n", text);
  _fail(at.file, at.line);
}

void assert_digest_at(uint64_t got, uint64_t expected, const char *what, test_place at) {
  if (got == expected) return;
  print_error("%s: digest 0x%016llxull, expected 0x%016llxull\n", what, (unsigned long long)got,
              (unsigned long long)expected);
  _fail(at.file, at.line);
}

// --- files ---------------------------------------------------------------------------------------

int temp_folder_make(char *path, size_t cap, const char *name) {
  const char *tmp = getenv("TMPDIR");
  int n = snprintf(path, cap, "%s/sv_%s_XXXXXX", tmp ? tmp : "/tmp", name);
  return n > 0 && (size_t)n < cap && mkdtemp(path) ? 0 : -1;
}

int temp_folder_remove(const char *path) {
  char command[600];
  int n = snprintf(command, sizeof command, "rm -rf '%s'", path);
  return n > 0 && (size_t)n < sizeof command ? system(command) : -1;
}

int temp_folder_setup(void **state) {
  (void)state;
  return temp_folder_make(temp_folder, sizeof temp_folder, "test");
}

int temp_folder_teardown(void **state) {
  (void)state;
  return *temp_folder ? temp_folder_remove(temp_folder) : 0;
}

const char *temp_path(const char *format, ...) {
  static char paths[8][1024];
  static int i_next;
  char *path = paths[i_next++ % 8];
  int n = snprintf(path, sizeof paths[0], "%s/", temp_folder);
  va_list ap;
  va_start(ap, format);
  vsnprintf(path + n, sizeof paths[0] - (size_t)n, format, ap);
  va_end(ap);
  return path;
}

void temp_put(const char *name, const void *data, size_t bytes) {
  const char *path = temp_path("%s", name);
  char above[1024];
  sv_err err = {.text = ""};
  sv_path_folder(above, sizeof above, path);
  assert_ok(sv_path_make_folder(above, &err), &err);
  assert_ok(sv_file_write(path, data, bytes, &err), &err);
}

void temp_put_text(const char *name, const char *text) { temp_put(name, text, strlen(text)); }

char *temp_read(const char *folder, const char *name) {
  char path[1200];
  void *data;
  size_t bytes;
  sv_err err = {.text = ""};
  snprintf(path, sizeof path, "%.600s/%.500s", folder, name);
  assert_ok(sv_file_read(path, &data, &bytes, &err), &err);
  return data;
}

// --- programs ------------------------------------------------------------------------------------

void shell_ok(const char *format, ...) {
  char command[2048];
  va_list ap;
  va_start(ap, format);
  int n = vsnprintf(command, sizeof command, format, ap);
  va_end(ap);
  assert_in_range(n, 1, sizeof command - 1);
  int code = system(command);
  if (code != 0) fail_msg("status %d of: %s", code, command);
}

int shell_read(char *out, size_t cap, const char *command) {
  FILE *p = popen(command, "r");
  assert_non_null(p);
  size_t n = fread(out, 1, cap - 1, p);
  out[n] = 0;
  int status = pclose(p);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

char shell_out[16384];

int shell_run(const char *format, ...) {
  char command[1200];
  va_list ap;
  va_start(ap, format);
  vsnprintf(command, sizeof command, format, ap);
  va_end(ap);
  return shell_read(shell_out, sizeof shell_out, command);
}

double shell_number(const char *key) {
  const char *at = strstr(shell_out, key);
  if (!at) fail_msg("no %s in: %s", key, shell_out);
  return strtod(at + strlen(key), NULL);
}

const char *shell_bin(void) {
  const char *dir = getenv("SV_BIN");
  return dir ? dir : "build/sim-x86/bin";
}

bool is_emulated(void) {
  const char *emulator = getenv("SV_EMULATE");
  return emulator && *emulator;
}
