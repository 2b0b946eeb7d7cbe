// SPDX-License-Identifier: Apache-2.0
// subview-lab train --appearance on captures of cameras that differ: scored on the views of ideal
// cameras, against a model of ideal captures; and what it refuses.
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

#define SCENE "textured,rig=stereo,size=128x96,exposures=8"
#define CAPTURE(options, name)                                                                               \
  "$(dirname @)/subview capture --source sim:" SCENE options " --exposures 8 --quiet --out " name            \
  "-cap && @ import --from capture " name "-cap --quiet --out " name " && mv " name "/transforms.json " name \
  "/transforms_train.json"

static lab_shell shell = {.cwd = ""};

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "appearance");
  if (r < 0) return -1;
  shell.is_ready = r == 0;
  if (r) return 0;
  lab_shell_run_well(&shell, CAPTURE("", "ideal"));
  lab_shell_run_well(&shell, CAPTURE(",gain=0.3,white=4500,vignetting=-0.4", "real"));
  lab_shell_run_well(&shell, "@ import --from sim " SCENE " --quiet --out truth");
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

static double psnr_of(const char *options) {
  char line[400];
  sv_fmt(
      line, sizeof line,
      "@ train %s --transforms transforms_train.json --gaussians 2000 --steps 500 --quiet --out m && @ eval "
      "--data truth --model m/model.ply --quiet --json",
      options);
  lab_shell_run_well(&shell, line);
  const char *at = strstr(shell.said, "\"psnr\": ");
  if (!at) fail_msg("no PSNR in: %s", shell.said);
  return strtod(at + 8, NULL);
}

TEST(test_cameras) {
  lab_shell_need(&shell);
  const double ideal = psnr_of("--data ideal"), off = psnr_of("--data real"),
               on = psnr_of("--data real --appearance cameras"),
               each = psnr_of("--data real --appearance exposures");
  print_message("ideal cameras %.2f dB; real ones %.2f dB, cameras learned %.2f dB, exposures %.2f dB\n",
                ideal, off, on, each);
  assert_true(off < ideal - 1 && on > ideal - 0.6 && each > ideal - 0.6);
}

TEST(test_refused) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "mkdir mono && cp -r real/images mono && sed 's/\"sub_view\": [0-9]*, //' "
                             "real/transforms_train.json >mono/transforms_train.json");
  const int code = lab_shell_run(&shell, "@ train --data mono --transforms transforms_train.json --steps 5 "
                                         "--gaussians 200 --appearance cameras --out n");
  assert_int_equal(code, 1);
  assert_non_null(strstr(shell.said, "the frames name one camera"));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_cameras), cmocka_unit_test(test_refused)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
