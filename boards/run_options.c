// SPDX-License-Identifier: Apache-2.0
#include "boards/run_options.h"

#include <string.h>

#include "boards/board_main.h"
#include "boards/config.h"
#include "platform/linux/preview.h"
#include "src/prior/methods.h"

#define AT(field) offsetof(run_options, field)
#define HISTORY_S 10 // of a live run, where nothing else is said

#define HEADING(text)                                                                                        \
  { NULL, SV_OPT_HEADING, 1, 0, 0, NULL, text, 0, 0, NULL }

static const sv_option rows[] = {
    HEADING("Cameras and exposures"),
    {"source", SV_OPT_TEXT, 1, 1, AT(source), "S",
     SOURCE_KINDS ", with options (see 'subview cameras --help')", 0, 0, NULL},
    {"rig", SV_OPT_TEXT, 1, 0, AT(rig), "DIR", "folder with rig.json, when the source has no rig of its own",
     0, 0, NULL},
    {"exposures", SV_OPT_INT, 1, 0, AT(exposures), "N",
     "exposures to capture and train on [" SV_TEXT_OF(BOARD_EXPOSURES) "]", 1, 10000, NULL},
    {"every", SV_OPT_TEXT, 1, 0, AT(every), "SEC",
     "time between exposures; 0: take each one; motion: take one when the picture has moved, at the latest "
     "after 1 s [cameras: motion; recordings: spread over all of it; 0 with --live, moving scenes and the "
     "simulator]",
     0, 0, NULL},
    {"skew-limit", SV_OPT_INT, 1, 0, AT(skew_ms), "MS",
     "largest time skew between the cameras of an exposure, ms [20]", 1, 10000, NULL},
    {"sync", SV_OPT_WORD, 1, 0, AT(sync), "free|frame-length|trigger",
     "synchronization method: none (all sources), frame lengths set by software (sim, libcamera with fps=, "
     "V4L2 drivers that can), or pulses on a line (sim, V4L2 and libcamera with trigger=) [free]",
     0, 0, NULL},
    {"imu", SV_OPT_TEXT, 1, 0, AT(imu), "FILE",
     "accelerations in the axes of the rig, which tell the way up to sources without poses; lines of "
     "seconds, x, y, z",
     0, 0, NULL},
    {"arc", SV_OPT_REAL, 1, 0, AT(arc_deg), "DEG",
     "azimuth around the scene that hints ask for while capturing, in degrees; the first exposure is in its "
     "middle [360]",
     1, 360, NULL},
    {"sub-views", SV_OPT_TEXT, 1, 0, AT(sub_views), "A,B",
     "names of the sub-views to train on; the others are only captured [all]", 0, 0, NULL},
    {"scale", SV_OPT_INT, 1, 0, AT(scale), "K",
     "train on images of 1/K of the width and height, averaged over K x K pixels [1]", 1, 64, NULL},
    {"size", SV_OPT_TEXT, 1, 0, AT(size), "WxH",
     "train on images averaged to this size, which has the shape of the frames [that of the frames]", 0, 0,
     NULL},
    {"depth", SV_OPT_WORD, 1, 0, AT(depth), "8|16",
     "bits of each value that are kept; 16: raw frames and 16-bit pictures are trained in linear light, "
     "weighted by the noise of the rig and the shutter times [8]",
     0, 0, NULL},
    {"shutter", SV_OPT_WORD, 1, 0, AT(shutter), "auto|rolling|global",
     "auto: model a rolling shutter where the rig has readout times; rolling: take missing times from the "
     "cameras (V4L2); global: ignore them [auto]",
     0, 0, NULL},
    {"keep-blurred", SV_OPT_FLAG, 1, 0, AT(is_blur_kept), NULL,
     "without poses: keep exposures less than half as sharp as those before them", 0, 0, NULL},
    HEADING("Training"),
    {"quality", SV_OPT_WORD, 1, 0, AT(quality), "draft|normal|fine",
     "end training when a second of it wins less than 1, 0.2 or 0.05 dB on held-out pixels (--hold-out 0.05 "
     "unless given), at the latest after 500, 2000 or 7000 steps (--steps) [off]",
     0, 0, NULL},
    {"steps", SV_OPT_INT, 1, 0, AT(steps), "N",
     "training steps [" SV_TEXT_OF(SV_DEFAULT_RUN_STEPS) ", as somebody waits beside the cameras, or until "
                                                         "--time-limit; subview-lab train: " SV_TEXT_OF(
                                                             SV_DEFAULT_STEPS) "]",
     1, 10000000, NULL},
    {"time-limit", SV_OPT_REAL, 1, 0, AT(time_limit), "SEC", "end training after SEC seconds [no limit]",
     0.001, 1e6, NULL},
    {"hold-out", SV_OPT_REAL, 1, 0, AT(hold_out), "SHARE",
     "share of the pixels, in blocks, that training does not see and the model is scored on [0]", 0, 0.5,
     NULL},
    {"gaussians", SV_OPT_INT, 1, 0, AT(gaussians), "N",
     "number of Gaussians, fixed for the run [" SV_TEXT_OF(BOARD_GAUSSIANS) "]", 1, 4000000, NULL},
    {"sh", SV_OPT_INT, 1, 0, AT(sh), "D",
     "degree of the color's spherical harmonics [" SV_TEXT_OF(
         BOARD_SH_DEGREE) "; 0 with --scene dynamic and "
                          "--live, whose history has degree 0]",
     0, 3, NULL},
    {"optimizer", SV_OPT_WORD, 1, 0, AT(optimizer), "adam|gauss-newton|mixed",
     "[gauss-newton; mixed (means by gauss-newton, the rest by adam) in moving "
     "scenes, and of two or three exposures of one camera]",
     0, 0, NULL},
    {"prior", SV_OPT_WORD, 1, 0, AT(prior), "none|fsgs|sparsegs",
     "sparse-view prior for static scenes (docs/priors.md) [none]", 0, 0, NULL},
    {"appearance", SV_OPT_WORD, 1, 0, AT(appearance), "auto|off|cameras|exposures",
     "learn how colors differ between cameras (cameras) and also between exposures (exposures), not at all "
     "(off), or where the source does not lock them (auto) [auto; subview-lab train: off]",
     0, 0, NULL},
    {"refine-poses", SV_OPT_FLAG, 1, 0, AT(is_refining), NULL,
     "refine the rig's poses while training; writes poses.json", 0, 0, NULL},
    {"threads", SV_OPT_INT, 1, 0, AT(threads), "N",
     "threads; the result does not depend on their number [" SV_TEXT_OF(
         BOARD_THREADS) "; fewer where "
                        "--capture-cpu N leaves fewer CPUs; subview-lab train: all CPUs]",
     1, BOARD_CAP_THREADS, NULL},
    {"seed", SV_OPT_INT, 1, 0, AT(seed), "N", "seed of the random numbers [" SV_TEXT_OF(SV_DEFAULT_SEED) "]",
     0, 1e15, NULL},
    HEADING("Scenes that move, and runs without an end"),
    {"scene", SV_OPT_WORD, 1, 0, AT(scene), "static|dynamic", "dynamic: the scene moves [static]", 0, 0,
     NULL},
    {"live", SV_OPT_FLAG, 1, 0, AT(is_continuous), NULL,
     "keep capturing while training; new exposures replace the oldest", 0, 0, NULL},
    {"exposure-time", SV_OPT_REAL, 1, 0, AT(exposure_s), "SEC",
     "with --scene dynamic and --live: training time of each exposure [0.1]", 0.01, 3600, NULL},
    {"history", SV_OPT_REAL, 1, 0, AT(history_s), "SEC",
     "with --scene dynamic and --live: keep so many seconds of the past and save them as model.svseq; 0: "
     "none [10]",
     0, 3600, NULL},
    {"capture-cpu", SV_OPT_TEXT, 1, 0, AT(capture_cpu), "N",
     "with --live: number of a CPU for the cameras alone, auto or off; training takes the others [auto: the "
     "slowest, if --threads leaves one]",
     0, 0, NULL},
    HEADING("Results"),
    {"out", SV_OPT_TEXT, 1, 0, AT(out), "DIR",
     "output folder: model.ply, run.json, preview.jpg, checkpoint.bin; required, except with --check", 0, 0,
     NULL},
    {"overwrite", SV_OPT_FLAG, 1, 0, AT(is_overwriting), NULL, "replace the model of an earlier run in DIR",
     0, 0, NULL},
    {"resume", SV_OPT_FLAG, 1, 0, AT(is_resume), NULL, "resume from checkpoint.bin in the output folder", 0,
     0, NULL},
    {"keep", SV_OPT_INT, 1, 0, AT(keep), "N",
     "keep the newest N scans in numbered folders below DIR; a scan that was interrupted is resumed", 1,
     10000, NULL},
    {"save-every", SV_OPT_REAL, 1, 0, AT(save_every), "SEC",
     "seconds between checkpoints; 0: only at the end [30]", 0, 1e6, NULL},
    {"picture-every", SV_OPT_REAL, 1, 0, AT(picture_every), "SEC",
     "seconds between updates of preview.jpg; 0: with checkpoints [5]", 0, 1e6, NULL},
    {"rescue", SV_OPT_TEXT, 1, 0, AT(rescue), "DIR",
     "folder to save to at the end if --out fails; the exit code is 3 then [a new folder in memory, "
     "/dev/shm]",
     0, 0, NULL},
    {"orbit", SV_OPT_INT, 1, 0, AT(orbit), "N",
     "render N images around the scene at the end: orbit_000.jpg, ... [0]", 0, 1000, NULL},
    {"mesh", SV_OPT_FLAG, 1, 0, AT(is_mesh), NULL,
     "at the end, write a colored triangle mesh, mesh.ply; takes memory (subview plan --mesh)", 0, 0, NULL},
    HEADING("Page and screen"),
    {"preview", SV_OPT_TEXT, 1, 0, AT(preview), "[ADDR:]PORT",
     "serve a page with cameras, model and curves [loopback unless ADDR is given]", 0, 0, NULL},
    {"session", SV_OPT_FLAG, 1, 0, AT(is_session), NULL,
     "with --preview: wait for Start on the page; after the run, New starts another one", 0, 0, NULL},
    {"token-file", SV_OPT_TEXT, 1, 0, AT(token_file), "FILE",
     "keep the page's token in FILE, so that its link stays valid; made when missing [a new token each time]",
     0, 0, NULL},
    {"tls", SV_OPT_TEXT, 1, 0, AT(tls), "FILE",
     "serve the page over TLS (https) with the key and certificate in FILE; made when missing", 0, 0, NULL},
    {"console", SV_OPT_TEXT, 1, 0, AT(console), "TTY",
     "also show the page's link and its QR code on this terminal, such as /dev/tty1 of an attached screen", 0,
     0, NULL},
    {"display", SV_OPT_TEXT, 1, 0, AT(display), "SCREEN",
     "show cameras and model on an attached screen (HDMI, DSI) without a desktop: auto, or CARD[:CONNECTOR] "
     "such as card1:HDMI-A-1",
     0, 0, NULL},
    {"feed", SV_OPT_FLAG, 1, 0, AT(has_feed), NULL, "publish for a subview-preview that you start yourself",
     0, 0, NULL},
    HEADING("Other"),
    {"check", SV_OPT_FLAG, 1, 0, AT(is_check), NULL,
     "only check cameras, rig, memory and folder, and print the result", 0, 0, NULL},
    {"config", SV_OPT_TEXT, 1, 0, AT(config), "FILE",
     "read options from FILE, name=value a line; the command line wins", 0, 0, NULL},
    {"json", SV_OPT_FLAG, 1, 0, AT(is_json), NULL, "print the results as one JSON object on stdout", 0, 0,
     NULL},
    {"quiet", SV_OPT_FLAG, 1, 0, AT(is_quiet), NULL, "no progress lines", 0, 0, NULL},
    OPTIONS_COMMON(run_options)};

// --capture-cpu and the default of --threads. By itself a CPU is set apart only where training does
// not need it: on the boards, real-time priority of the cameras' thread does as much for latency
// (docs/boards.md).
static int choose_cpu(run_options *o) {
  const int n_cpus = sv_linux_n_cpus();
  const bool is_auto = !strcmp(o->capture_cpu, "auto");
  const bool has_cameras = !strncmp(o->source, "v4l2:", 5) || !strncmp(o->source, "libcamera:", 10);
  long long cpu = -1;
  if (!is_auto && strcmp(o->capture_cpu, "off") != 0) {
    if (!sv_parse_int(o->capture_cpu, strlen(o->capture_cpu), &cpu) || cpu < 0 || cpu > 4095)
      return usage_error("run", "--capture-cpu %s: expected auto, off or the number of a CPU",
                         o->capture_cpu);
    if (!o->is_continuous) return usage_error("run", "--capture-cpu: only with --live");
  }
  if (!o->threads)
    o->threads = cpu >= 0 && n_cpus <= BOARD_THREADS && n_cpus > 1 ? n_cpus - 1 : BOARD_THREADS;
  if (is_auto && o->is_continuous && has_cameras && n_cpus > o->threads && n_cpus > 1)
    cpu = sv_linux_camera_cpu("/sys");
  o->i_capture_cpu = (int)cpu;
  return 0;
}

static int check_quality(run_options *o) {
  static const struct {
    const char *name;
    double least_db_per_s;
    long steps;
  } presets[] = {{"draft", 1, 500}, {"normal", 0.2, SV_DEFAULT_RUN_STEPS}, {"fine", 0.05, 7000}};
  if (!o->quality) return 0;
  if (o->is_continuous) return usage_error("run", "--quality: not with --live, which has no end of its own");
  int i = 0;
  while (strcmp(o->quality, presets[i].name) != 0) i++;
  o->least_db_per_s = presets[i].least_db_per_s;
  if (!o->steps) o->steps = presets[i].steps;
  o->is_held_released = !(o->hold_out > 0);
  if (o->is_held_released) o->hold_out = 0.05;
  return 0;
}

static int check_exposures(run_options *o) {
  o->is_by_motion = o->every && !strcmp(o->every, "motion");
  if (o->every && !o->is_by_motion &&
      !(sv_parse_double(o->every, strlen(o->every), &o->every_s) && o->every_s >= 0 && o->every_s <= 3600))
    return usage_error("run", "--every %s: expected a number of seconds from 0 to 3600, or motion", o->every);
  if (o->is_by_motion && o->is_continuous)
    return usage_error("run", "--every motion: not with --live; give a number of seconds");
  if (o->depth && !strcmp(o->depth, "16") && o->is_dynamic)
    return usage_error("run", "--depth 16: not with --scene dynamic");
  if (o->size && o->scale > 1) return usage_error("run", "--size and --scale: expected one of them");
  o->reduction = (sv_reduction){.k = o->size ? 0 : (int)o->scale};
  if (o->size && !size_of(o->size, &o->reduction.width_px, &o->reduction.height_px))
    return usage_error("run", "--size %s: expected WxH, such as 640x480", o->size);
  o->i_sync = sync_mode_of(o->sync);
  return 0;
}

static int check_training(run_options *o) {
  o->i_optimizer = o->optimizer ? sv_optimizer_by_name(o->optimizer) : -1;
  o->i_prior = sv_prior_method_by_name(o->prior);
  o->appearance_mode = (sv_appearance_mode)sv_appearance_mode_by_name(o->appearance);
  if (o->appearance_mode == SV_APPEARANCE_EXPOSURES && o->is_continuous)
    return usage_error("run", "--appearance exposures: not with --live, which replaces exposures");
  const bool is_whole_still_run = !o->is_continuous && !o->is_dynamic && !o->is_resume;
  if (o->is_refining && !is_whole_still_run)
    return usage_error("run", "--refine-poses: not with --live, --scene dynamic or --resume");
  if (o->i_prior > 0 && !is_whole_still_run)
    return usage_error("run", "--prior: not with --live, --scene dynamic or --resume");
  if (o->is_mesh && o->is_dynamic) return usage_error("run", "--mesh: not with --scene dynamic");
  const int r = check_quality(o);
  if (!o->steps && !(o->time_limit > 0)) o->steps = SV_DEFAULT_RUN_STEPS;
  return r;
}

// Of moving scenes that are captured while training.
static int check_history(run_options *o) {
  const bool is_live = o->is_dynamic && o->is_continuous;
  if (is_live && o->is_resume)
    return usage_error(
        "run", "--resume: not with --live and --scene dynamic, whose checkpoint holds no older exposures");
  if (o->history_s > 0 && !is_live)
    return usage_error("run", "--history: only with --scene dynamic and --live");
  if (o->history_s < 0) o->history_s = HISTORY_S;
  if (o->sh < 0) o->sh = is_live ? 0 : BOARD_SH_DEGREE;
  return 0;
}

static int check_page(run_options *o) {
  sv_err err;
  if (o->preview &&
      sv_linux_preview_parse(o->preview, o->preview_addr, sizeof o->preview_addr, &o->preview_port, &err) < 0)
    return usage_error("run", "--preview %s", err.text);
  if (o->is_session && !o->preview && !o->has_feed)
    return usage_error("run", "--session takes --preview [ADDR:]PORT");
  return 0;
}

// The first check that fails has said why.
static int check(run_options *o) {
  static int (*const checks[])(run_options *) = {check_history, check_exposures, check_training, check_page,
                                                 choose_cpu};
  if (!o->out && (!o->is_check || o->keep > 0)) return usage_error("run", "--out is missing");
  o->is_dynamic = !strcmp(o->scene, "dynamic");
  int r = 0;
  for (size_t i = 0; i < sizeof checks / sizeof *checks && !r; i++) r = checks[i](o);
  return r;
}

static const sv_tool_command command = {
    .name = "run",
    .args = "--source S --out DIR [options]",
    .text =
        "Captures synchronized exposures, trains Gaussians on them and saves the model.\n"
        "During the run, preview.jpg in DIR shows a captured image beside its rendering. --preview serves a\n"
        "page for any browser on this machine; --preview 0.0.0.0:PORT for a phone on the same network. The\n"
        "printed link holds a token.",
    .example =
        "  "
        "subview run --source sim:textured,rig=stereo --exposures 8 --out out/demo\n"
        "  subview run --source sim:textured,rig=stereo --preview 0.0.0.0:8080 --session --out out/scan\n"
        "  subview run --source replay:out/capture --check",
    .bit = 1};

int run_options_parse(int argc, char **argv, run_options *o) {
  *o = (run_options){.exposures = BOARD_EXPOSURES,
                     .gaussians = BOARD_GAUSSIANS,
                     .sh = -1,
                     .history_s = -1,
                     .scale = 1,
                     .skew_ms = 20,
                     .capture_cpu = "auto",
                     .seed = SV_DEFAULT_SEED,
                     .save_every = 30,
                     .picture_every = 5,
                     .exposure_s = SV_EXPOSURE_S,
                     .shutter = "auto",
                     .prior = "none",
                     .scene = "static",
                     .appearance = "auto",
                     .sync = "free"};
  int r = config_expand("run", &argc, &argv);
  if (!r) r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, o);
  if (r) return r;
  return check(o);
}
