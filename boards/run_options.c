// SPDX-License-Identifier: Apache-2.0
#include "boards/run_options.h"

#include <string.h>

#include "boards/board_main.h"
#include "platform/linux/live.h"
#include "src/prior/methods.h"

static run_options g; // what the list below points at

static const opt list[] = {
    {"--source", OPT_TEXT, &g.source, 0, 0, "S",
     SOURCE_KINDS ", with options (see 'subview cameras --help')"},
    {"--rig", OPT_TEXT, &g.rig, 0, 0, "DIR", "folder with rig.json, when the source brings none"},
    {"--scene", OPT_TEXT, &g.scene, 0, 0, "KIND",
     "static, or dynamic: what is seen moves (with --live: exposure by exposure)"},
    {"--exposure-time", OPT_REAL, &g.exposure_s, 0.01, 3600, "SEC",
     "dynamic and live: training time of each exposure (0.45)"},
    {"--exposures", OPT_INT, &g.exposures, 1, 10000, "N",
     "exposures to capture and train on (" TEXT_OF(BOARD_EXPOSURES) ")"},
    {"--sub-views", OPT_TEXT, &g.sub_views, 0, 0, "A,B",
     "train on these sub-views only (names); the others are captured"},
    {"--steps", OPT_INT, &g.steps, 1, 10000000, "N",
     "training steps (default 2000, unless a time limit is given)"},
    {"--time-limit", OPT_REAL, &g.time_limit, 0.001, 1e6, "SEC", "end training after so many seconds"},
    {"--gaussians", OPT_INT, &g.gaussians, 1, 4000000, "N",
     "Gaussians, a fixed number (" TEXT_OF(BOARD_GAUSSIANS) ")"},
    {"--sh", OPT_INT, &g.sh, 0, 3, "D",
     "degree of the colour's spherical harmonics (" TEXT_OF(BOARD_SH_DEGREE) ")"},
    {"--optimizer", OPT_TEXT, &g.optimizer, 0, 0, "NAME",
     "adam or gauss-newton (gauss-newton; where lens images overlap adam)"},
    {"--prior", OPT_TEXT, &g.prior, 0, 0, "METHOD",
     "for few views of a scene that stands still: none, fsgs or sparsegs (docs/priors.md)"},
    {"--skew-limit", OPT_INT, &g.skew_ms, 1, 10000, "MS", "largest skew within an exposure (20 ms)"},
    {"--sync", OPT_TEXT, &g.sync, 0, 0, "HOW",
     "what makes the cameras expose together: free (nothing), frame-length (software), trigger (a line)"},
    {"--live", OPT_FLAG, &g.is_continuous, 0, 0, NULL,
     "go on capturing while training: new exposures take the place of the oldest"},
    {"--refine-poses", OPT_FLAG, &g.is_refining, 0, 0, NULL,
     "training corrects where the rig was, when its poses are known to be off; poses.json has the result"},
    {"--threads", OPT_INT, &g.threads, 1, BOARD_CAP_THREADS, "N",
     "threads; the result is the same for any number (" TEXT_OF(BOARD_THREADS) ")"},
    {"--seed", OPT_INT, &g.seed, 0, 1e15, "N", "seed of everything random (1)"},
    {"--save-every", OPT_REAL, &g.save_every, 0, 1e6, "SEC",
     "checkpoint and preview while training (30; 0: at the end)"},
    {"--picture-every", OPT_REAL, &g.picture_every, 0, 1e6, "SEC",
     "preview.jpg alone while training (5; 0: with saves)"},
    {"--orbit", OPT_INT, &g.orbit, 0, 1000, "N",
     "at the end, N pictures round the scene: orbit_000.jpg, ..."},
    {"--preview", OPT_TEXT, &g.preview, 0, 0, "[ADDR:]PORT",
     "serve a page with cameras, model and curves (loopback unless ADDR is given)"},
    {"--session", OPT_FLAG, &g.is_session, 0, 0, NULL,
     "with --preview: wait for Start on the page, stay after the end; New begins again"},
    {"--feed", OPT_FLAG, &g.has_feed, 0, 0, NULL, "publish for a subview-preview that is started by hand"},
    {"--check", OPT_FLAG, &g.is_check, 0, 0, NULL,
     "only look whether everything is there, and print the list"},
    {"--resume", OPT_FLAG, &g.is_resume, 0, 0, NULL, "go on from checkpoint.bin in the output folder"},
    {"--out", OPT_TEXT, &g.out, 0, 0, "DIR", "where model.ply, run.json, preview.jpg, checkpoint.bin go"},
    {"--json", OPT_FLAG, &g.is_json, 0, 0, NULL, "print the figures as one JSON object on stdout"},
    {"--quiet", OPT_FLAG, &g.is_quiet, 0, 0, NULL, "no progress"},
};

static int check(run_options *o) {
  sv_err err;
  if (!o->source) return usage_error("run", "--source is missing");
  if (!o->out) return usage_error("run", "--out is missing");
  o->is_dynamic = !strcmp(o->scene, "dynamic");
  if (!o->is_dynamic && strcmp(o->scene, "static"))
    return usage_error("run", "--scene %s: expected static or dynamic", o->scene);
  if (o->is_dynamic && o->is_continuous && o->is_resume)
    return usage_error("run", "--resume: a live run of a moving scene has no past to go on from");
  if (o->is_refining && (o->is_continuous || o->is_dynamic || o->is_resume))
    return usage_error("run", "--refine-poses: not with --live, --scene dynamic or --resume");
  o->i_sync = sync_mode_of(o->sync);
  if (o->i_sync < 0) return usage_error("run", "--sync %s: expected free, frame-length or trigger", o->sync);
  o->i_optimizer = o->optimizer ? sv_optimizer_by_name(o->optimizer) : -1;
  if (o->optimizer && o->i_optimizer < 0)
    return usage_error("run", "--optimizer %s: expected adam or gauss-newton", o->optimizer);
  o->i_prior = sv_prior_method_by_name(o->prior);
  if (o->i_prior < 0) return usage_error("run", "--prior %s: expected none, fsgs or sparsegs", o->prior);
  if (o->i_prior > 0 && (o->is_continuous || o->is_dynamic || o->is_resume))
    return usage_error("run", "--prior: not with --live, --scene dynamic or --resume");
  if (o->preview &&
      sv_linux_live_parse(o->preview, o->preview_addr, sizeof o->preview_addr, &o->preview_port, &err) < 0)
    return usage_error("run", "--preview %s", err.text);
  if (o->is_session && !o->preview && !o->has_feed)
    return usage_error("run", "--session takes --preview [ADDR:]PORT");
  if (!o->steps && !(o->time_limit > 0)) o->steps = 2000;
  return 0;
}

int run_options_parse(int argc, char **argv, run_options *o) {
  g = (run_options){.exposures = BOARD_EXPOSURES,
                    .gaussians = BOARD_GAUSSIANS,
                    .sh = BOARD_SH_DEGREE,
                    .skew_ms = 20,
                    .threads = BOARD_THREADS,
                    .seed = 1,
                    .save_every = 30,
                    .picture_every = 5,
                    .exposure_s = 0.45,
                    .prior = "none",
                    .scene = "static",
                    .sync = "free"};
  int r = options_parse(
      "run",
      "Captures exposures (all sub-views of one instant), trains Gaussians on all of them, and saves the "
      "model.\n"
      "While it goes on, preview.jpg in DIR shows a picture beside its rendering; --preview serves a page "
      "for any\n"
      "browser on this machine, --preview 0.0.0.0:PORT for the phone in your hand (the printed link holds a "
      "token).",
      "subview run --source sim:textured,rig=stereo --exposures 8 --out out/demo\n"
      "  subview run --source sim:textured,rig=stereo --preview 0.0.0.0:8080 --session --out out/scan\n"
      "  subview run --source replay:out/capture --check --out out/scan",
      list, sizeof list / sizeof *list, argc, argv);
  if (r) return r;
  r = check(&g);
  *o = g;
  return r;
}
