// SPDX-License-Identifier: Apache-2.0
// Moving scenes in the host tool, run as a user runs it: a dataset of the simulator, its tables,
// frames and films, the model as a PLY of differences.
#include <stdio.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

static lab_shell shell = {.cwd = ""};

static int run(const char *line) { return lab_shell_run(&shell, line); }
static void run_well(const char *line) { lab_shell_run_well(&shell, line); }

static void says(const char *line, const char *expected) {
  run_well(line);
  if (!strstr(shell.said, expected)) fail_msg("%s: '%s' is not in: %s", line, expected, shell.said);
}

FIXTURE(setup) {
  int code = lab_shell_open(&shell, "moving");
  if (code != 0) return code < 0 ? code : 0;
  shell.is_ready =
      run("@ import --from sim moving,size=48x36,fps=15 --out s --quiet && "
          "@ train --data s --transforms transforms_train_stereo.json --model 4dgs --gaussians 150 "
          "--steps 60 --eval --json --quiet --out m > m.json") == 0;
  if (!shell.is_ready) fprintf(stderr, "%s", shell.said);
  return shell.is_ready ? 0 : -1;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

// One time in four of the training cameras is held out, and four cameras that no device has, over
// all times.
TEST(test_dataset) {
  lab_shell_need(&shell);
  says("grep -c '\"split\": \"train\"' s/transforms_train_mono.json", "19");
  says("grep -c '\"split\": \"test_time\"' s/transforms_train_stereo.json", "12");
  says("grep -c '\"split\": \"train\"' s/transforms_train_phone.json", "57");
  says("grep -c '\"split\": \"test_view\"' s/transforms_test.json", "100");
  run_well("cmp s/frames/mono_right/f007.png s/frames/stereo_right/f007.png"); // the same camera
  run_well("cmp s/frames/mono_right/f007.png s/frames/phone_wide/f007.png");
  // it moves
  assert_int_equal(run("cmp s/frames/mono_right/f007.png s/frames/mono_right/f010.png"), 1);
  says("cat m.json", "\"time_psnr\"");
  says("@ import --from sim moving,noise=read:0.001 --out n || true", "are written without noise");
}

TEST(test_tables) {
  lab_shell_need(&shell);
  run_well("@ tables --data s --steps 3 --gaussians 60 --out t --quiet");
  says("wc -l < t/dynamic.csv", "7"); // the head, three devices in two forms of motion
  says("grep -c 'stereo,clip\\|phone,field' t/dynamic.csv", "2");
  says("head -1 t/dynamic.csv", "times dB over mono");
  // Noise makes other runs, and reaches them; threads reach the scoring, too.
  run_well("cp -r t u && @ tables --data s --steps 3 --gaussians 60 --noise shot=0.01 --threads 1 --out u "
           "--quiet");
  says("grep -l '\"noise_shot\": 0.01' u/runs/*/train.json | wc -l", "6");
  says("ls u/runs | wc -l", "12");
  says("grep -l '\"threads\": 1[,}]' u/runs/*_noise_0_*/time.out.json | wc -l", "6");
}

// A bar for each device, a group for each form of motion; pictures where there is gnuplot, and the
// page shows them.
TEST(test_plots) {
  static const char *const plots[] = {"dynamic_cameras_psnr", "dynamic_frames_psnr"};
  char line[200];
  lab_shell_need(&shell);
  bool has_gnuplot = run("command -v gnuplot") == 0;
  for (int i = 0; i < 2; i++) {
    snprintf(line, sizeof line, "grep -cE '^\"s, (clip|field)\"( [0-9.]+){3}$' t/plots/%s.gp", plots[i]);
    says(line, "2");
    snprintf(line, sizeof line, "ls t/plots/%s.* | wc -l", plots[i]);
    says(line, has_gnuplot ? "3" : "1");
    snprintf(line, sizeof line, "grep -c '!\\[%s.png\\](plots/%s.png)' t/tables.md", plots[i], plots[i]);
    if (has_gnuplot) says(line, "1");
  }
  // The PSNR of the plot is that of the table.
  says("v=$(sed -n 's/^\"s, field\" [0-9.]* \\([0-9.]*\\) .*/\\1/p' t/plots/dynamic_frames_psnr.gp) && "
       "awk -F, -v v=$v '$2 == \"stereo\" && $3 == \"field\" { d = $8 - v; exit !(d < 0.01 && d > -0.01) }' "
       "t/dynamic.csv && echo the same",
       "the same");
  run_well("cp -r t g && rm -f g/plots/*.png g/plots/*.svg && "
           "PATH=/nowhere @ tables --data s --steps 3 --gaussians 60 --out g");
  if (!strstr(shell.said, "gnuplot not found")) fail_msg("nothing about gnuplot: %s", shell.said);
  says("ls g/plots; cat g/tables.md", "gnuplot was not found");
}

// A still model in the folder of a moving one, and a file of viewers beside a moving one, do not
// move.
TEST(test_still_after_moving) {
  lab_shell_need(&shell);
  run_well("mkdir still && cp m/model.ply m/motion.bin still && "
           "@ train --data s --transforms transforms_train_stereo.json --gaussians 60 --steps 3 --quiet "
           "--out still && "
           "test ! -e still/motion.bin && @ export --model still/model.ply --format splat --out "
           "m/still.splat --quiet && "
           "@ render --data s --transforms transforms_train_stereo.json --model still/model.ply --orbit 1 "
           "--out still/o && "
           "@ render --data s --transforms transforms_train_stereo.json --model m/still.splat --orbit 1 "
           "--out still/p");
}

// Files of viewers are Y-up; a dataset's views see them as they see the model that they were
// made of.
TEST(test_upright) {
  lab_shell_need(&shell);
  run_well("@ train --data s --transforms transforms_train_stereo.json --gaussians 60 --steps 40 --quiet "
           "--out up && "
           "@ export --model up/model.ply --format spz --out up/model.spz --quiet");
  run_well("psnr() { @ eval --data s --transforms transforms_train_stereo.json --split test_time --model "
           "up/$1 $2 $3 "
           "--quiet --json | grep -o '\"psnr\": [0-9.]*' | sed 's/.* //;q'; } && "
           "echo $(psnr model.ply) $(psnr model.spz) $(psnr model.spz --up -y) | "
           "tee up/psnr | awk '{ d = $1 - $2; exit !($1 > 5 && d < 0.1 && d > -0.1 && $1 > $3 + 1) }' || "
           "{ cat up/psnr; false; }");
  assert_int_equal(run("@ eval --data s --model up/model.ply --up z"), 2);
}

// A disk that is full before all is written leaves the older model with its motion and settings,
// and nothing beside.
TEST(test_full_disk) {
  lab_shell_need(&shell);
  run_well("cp -r m full");
  assert_int_equal(
      run("trap '' XFSZ; ulimit -f 8; " // 4 or 8 kB: enough for this model, but not for its planes
          "@ train --data s --transforms transforms_train_stereo.json --model 4dgs --motion field,clip=0.3 "
          "--gaussians 20 --steps 3 --quiet --out full"),
      1);
  if (!strstr(shell.said, "motion.bin: cannot write")) fail_msg("nothing about motion.bin: %s", shell.said);
  run_well("diff -r m full");
}

TEST(test_frames) {
  lab_shell_need(&shell);
  run_well(
      "@ render --data s --transforms transforms_train_stereo.json --model m/model.ply --frames 5 --out f");
  says("ls f/frame_*.png | wc -l", "5");
  run_well("@ export --model m/model.ply --format delta --frames 3 --out m/delta.ply --quiet");
  says("head -c 3 m/delta.ply", "ply");
  says("grep -a -c '^property float opacity' m/delta.ply", "4"); // of the base, and of each frame
}

// Numbered models are still ones, as the model is at their times; a sequence renders as the model
// that it was made from.
TEST(test_sequences) {
  lab_shell_need(&shell);
  run_well("@ export --model m/model.ply --format ply --frames 3 --out frames --quiet");
  says("ls frames | tr '\\n' ' '", "frame_0000.ply frame_0001.ply frame_0002.ply");
  assert_int_equal(run("cmp frames/frame_0000.ply frames/frame_0002.ply"), 1);
  run_well("@ export --model m/model.ply --format sequence --frames 25 --out m/model.svseq --quiet");
  run_well("for f in model.ply model.svseq; do @ eval --data s --model m/$f --quiet --json | "
           "grep -o '\"psnr\": [0-9.]*' | sed 's/.* //;q'; done > m/psnr; "
           "tr '\\n' ' ' < m/psnr | awk '{ d = $1 - $2; exit !($1 > 10 && d < 0.05 && d > -0.05) }' || "
           "{ cat m/psnr; false; }");
  run_well("@ export --model m/model.svseq --format spz --frames 2 --out again --quiet");
  says("ls again | tr '\\n' ' '", "frame_0000.spz frame_0001.spz");
  says("@ export --model frames/frame_0000.ply --format sequence --out x.svseq || true", "is static");
  says("head -c 9000 m/model.svseq > m/cut.svseq; @ eval --data s --model m/cut.svseq || true", "cut off");
}

TEST(test_film) {
  lab_shell_need(&shell);
  if (run("command -v ffmpeg") != 0) {
    print_message("skip: ffmpeg is not installed\n");
    skip();
  }
  says("ffmpeg -v error -i f/movie.mp4 -f null - && ls f", "sheet.png");
  // A shorter film in the same folder has no frames of the longer one.
  run_well(
      "@ render --data s --transforms transforms_train_stereo.json --model m/model.ply --frames 2 --out f");
  says("ffmpeg -v error -i f/movie.mp4 -f framemd5 - | grep -vc '^#'", "2");
  says("ffmpeg -v error -i f/sheet.png -f framemd5 - | grep '#dimensions'", " 96x36");
  // Films alone: two eyes side by side, which differ; depth without color.
  run_well("@ render --model m/model.ply --orbit 3 --width 48 --frames 3 --film stereo --out eyes.webm");
  says("ffmpeg -v error -i eyes.webm -f framemd5 - | grep '#dimensions'", " 96x36");
  run_well(
      "for x in 0 48; do ffmpeg -v error -y -i eyes.webm -vf crop=48:36:$x:0 -frames:v 1 eye$x.png; done");
  assert_int_equal(run("cmp eye0.png eye48.png"), 1);
  run_well("@ render --model m/model.ply --orbit 3 --width 48 --film depth --out depth.mp4");
  says("ffmpeg -v error -i depth.mp4 -vf signalstats,metadata=print:key=lavfi.signalstats.SATMAX:file=- -f "
       "null - | "
       "grep SATMAX | sort -u",
       "SATMAX=0");
  says("@ render --model m/model.ply --orbit 3 --film depth --out x || true", "--film needs a film");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_dataset),  cmocka_unit_test(test_tables),
      cmocka_unit_test(test_plots),    cmocka_unit_test(test_still_after_moving),
      cmocka_unit_test(test_frames),   cmocka_unit_test(test_sequences),
      cmocka_unit_test(test_film),     cmocka_unit_test(test_upright),
      cmocka_unit_test(test_full_disk)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
