// SPDX-License-Identifier: Apache-2.0
// Scenes that do not end, as a user trains them: things at 1 m before a yard at 10 to 70 m. The
// background is as sharp as the views tell, and nothing hangs between the cameras and the things.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/common/imageio.h"

static lab_shell shell = {.cwd = ""};

#define N_ORBIT 36

static double number(const char *key) {
  char text[64];
  snprintf(text, sizeof text, "\"%s\": ", key);
  const char *p = strstr(shell.said, text);
  if (!p) fail_msg("no %s in: %s", key, shell.said);
  return p ? strtod(p + strlen(text), NULL) : 0;
}

// Pixels of an orbit's views that are nearer than 0.5 m: the things begin at 0.7 m.
static int n_in_between(double unit) {
  int n = 0;
  for (int i = 0; i < N_ORBIT; i++) {
    char path[400];
    sv_bitmap b;
    snprintf(path, sizeof path, "%s/orbit/orbit_%04d_depth.png", shell.root, i);
    assert_int_equal(sv_bitmap_read(path, &b, NULL), SV_OK);
    assert_int_equal(b.bits, 16);
    for (int k = 0; k < b.width_px * b.height_px; k++) n += b.u16[k] && b.u16[k] * unit < 0.5;
    sv_bitmap_free(&b);
  }
  return n;
}

FIXTURE(setup) {
  const int code = lab_shell_open(&shell, "background");
  if (code != 0) return code < 0 ? code : 0;
  shell.is_ready = true;
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

TEST(test_far_field) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "@ import --from sim field,rig=mono,size=120x90,exposures=32 --out s --quiet");
  lab_shell_run_well(&shell, "@ train --data s --gaussians 5000 --steps 400 --eval --json --quiet --out m");
  const double psnr = number("psnr");
  lab_shell_run_well(&shell, "@ render --data s --model m/model.ply --orbit 36 --depth --quiet --out orbit; "
                             "grep -o '\"depth_unit_scale_factor\": [0-9.e-]*' orbit/views.json");
  const int n = n_in_between(number("depth_unit_scale_factor"));
  print_message("held-out PSNR %.2f dB; %d pixels of an orbit before the things\n", psnr, n);
  assert_true(psnr > 24); // 16 dB when depth maps end at 4 m
  assert_true(n < N_ORBIT * 120 * 90 / 1000);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_far_field)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
