// SPDX-License-Identifier: Apache-2.0
// The header every test begins with: cmocka, assertions that print what they saw, a temporary
// folder, shell commands, and kernels with a thread pool. It owns the folder and the threads; it
// never knows what is tested.
#ifndef SV_TESTS_COMMON_TEST_H
#define SV_TESTS_COMMON_TEST_H

// cmocka.h needs the first lines before it.
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "src/base/status.h"
#include "src/port/compute.h"

#ifdef __cplusplus
extern "C" {
#endif

// A test function, and a function that cmocka calls before or after tests (it returns 0 when all is
// well).
#define TEST(name)    static void name(__attribute__((unused)) void **state)
#define FIXTURE(name) static int name(__attribute__((unused)) void **state)

// --- assertions ----------------------------------------------------------------------------------

// Where an assertion stands.
typedef struct {
  const char *file;
  int line;
} test_place;
#define TEST_HERE ((test_place){__FILE__, __LINE__})

// |got - expected| <= tolerance. Fails for NaN.
#define assert_near(got, expected, tolerance) assert_near_at(got, expected, tolerance, #got, TEST_HERE)
// All values of two float arrays.
#define assert_floats_near(got, expected, n, tolerance)                                                      \
  assert_floats_near_at(got, expected, n, tolerance, #got, TEST_HERE)
// The PSNR in dB, expected in [least, 100).
#define assert_psnr(got_db, least_db) assert_psnr_at(got_db, least_db, #got_db, TEST_HERE)
// A call that returns no failure. err: the sv_err that the call fills.
#define assert_ok(call, err) assert_ok_at(call, (err)->text, #call, TEST_HERE)
// A call that is refused with this status and a message that contains `part`.
#define assert_error(call, expected, err, part)                                                              \
  assert_error_at(call, expected, (err)->text, part, #call, TEST_HERE)
#define assert_contains(text, part)     assert_contains_at(text, part, true, TEST_HERE)
#define assert_not_contains(text, part) assert_contains_at(text, part, false, TEST_HERE)
// A message for users: one line of 15 to 255 characters.
#define assert_one_sentence(text) assert_one_sentence_at(text, TEST_HERE)
// Prints an unexpected digest so that it can be pasted.
#define assert_digest(got, expected, what) assert_digest_at(got, expected, what, TEST_HERE)

void assert_near_at(double got, double expected, double tolerance, const char *what, test_place at);
void assert_floats_near_at(const float *got, const float *expected, size_t n, double tolerance,
                           const char *what, test_place at);
void assert_psnr_at(double got_db, double least_db, const char *what, test_place at);
void assert_ok_at(sv_status s, const char *message, const char *what, test_place at);
void assert_error_at(sv_status s, sv_status expected, const char *message, const char *part, const char *what,
                     test_place at);
void assert_contains_at(const char *text, const char *part, bool is_expected, test_place at);
void assert_one_sentence_at(const char *text, test_place at);
void assert_digest_at(uint64_t got, uint64_t expected, const char *what, test_place at);

bool is_one_sentence(const char *text);

// --- files ---------------------------------------------------------------------------------------

// Makes TMPDIR/sv_NAME_ and six characters and writes its path. 0; -1: it cannot be made, or cap is
// too small.
int temp_folder_make(char *path, size_t cap, const char *name);
int temp_folder_remove(const char *path); // with its contents; 0 when it is gone

// The program's own folder, as fixtures of a group of tests; temp_folder is "" before.
extern char temp_folder[256];
int temp_folder_setup(void **state);
int temp_folder_teardown(void **state);

// A path below the folder. Valid until eight more have been asked for.
const char *temp_path(const char *format, ...) SV_PRINTF(1, 2);
// Writes a file below the folder, and the folders it needs.
void temp_put(const char *name, const void *data, size_t bytes);
void temp_put_text(const char *name, const char *text);
// The whole file FOLDER/NAME, ended by a zero byte; the caller frees it. Fails the test when it
// cannot be read.
char *temp_read(const char *folder, const char *name);

// --- programs ------------------------------------------------------------------------------------

// A shell command that must succeed.
void shell_ok(const char *format, ...) SV_PRINTF(1, 2);
// A shell command's exit code, or 128 + its signal; what it prints to stdout goes to out.
int shell_read(char *out, size_t cap, const char *command);
// The same into shell_out, of a formatted command.
extern char shell_out[16384];
int shell_run(const char *format, ...) SV_PRINTF(1, 2);
// The number behind a key in shell_out; fails the test when the key is not there.
double shell_number(const char *key);
// The folder of the programs under test.
const char *shell_bin(void);
// SV_EMULATE runs foreign programs; tests that cannot work under it ask here.
bool is_emulated(void);

// --- computing -----------------------------------------------------------------------------------

// The fastest kernels on the calling thread alone.
sv_compute compute_serial(void);
// Kernels of these instruction sets and a pool of n threads, both valid until compute_end or the
// next call.
sv_compute compute_start(uint32_t isa_mask, int n_threads);
void compute_end(void);

#ifdef __cplusplus
}
#endif
#endif
