// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/args.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "src/base/str.h"

typedef enum { OPT_FLAG, OPT_TEXT, OPT_WORD, OPT_INT, OPT_REAL, OPT_LATER } option_kind;

// value: what --help calls the argument; of OPT_WORD the words that may stand there. later: words of
// the contract that this build does not know yet.
typedef struct {
  const char *name;
  option_kind kind;
  int commands, required; // bits
  size_t at;
  const char *value, *help;
  double lo, hi;
  const char *later;
} option;

#define AT(field) offsetof(lab_options, field)
#define ALL       (LAB_TRAIN | LAB_EVAL | LAB_RENDER | LAB_EXPORT | LAB_IMPORT | LAB_BENCH | LAB_TABLES)
#define DATA      (LAB_TRAIN | LAB_EVAL | LAB_RENDER)

static const option table[] = {
    {"data", OPT_TEXT, DATA, DATA, AT(data), "DIR", "dataset: a folder with transforms JSON and pictures", 0,
     0, 0},
    {"data", OPT_TEXT, LAB_TABLES, LAB_TABLES, AT(data), "DIR[,DIR...]",
     "datasets with files transforms_train_DEVICE[_thetaT].json", 0, 0, 0},
    {"quick", OPT_FLAG, LAB_TABLES, 0, AT(is_quick), 0, "only the first dataset, fewer points and steps", 0,
     0, 0},
    {"transforms", OPT_TEXT, DATA, 0, AT(transforms), "FILE",
     "training file (transforms_train.json, else transforms.json with every 8th view held out)", 0, 0, 0},
    {"exposures", OPT_INT, LAB_TRAIN, 0, AT(exposures), "N",
     "train on N exposures: the first by number, or else the N most dispersed views", 1, 1e6, 0},
    {"model", OPT_WORD, LAB_TRAIN, 0, AT(method), "3dgs|4dgs",
     "what is trained: still Gaussians, or such that move with the pictures' time (3dgs)", 0, 0, 0},
    {"motion", OPT_TEXT, LAB_TRAIN, 0, AT(motion), "clip|field[,k=v...]",
     "4dgs: each Gaussian for itself, or one field for all (clip); their settings, see below", 0, 0, 0},
    {"camera", OPT_TEXT, LAB_EVAL, 0, AT(camera), "NAME", "only the views of this camera", 0, 0, 0},
    {"model", OPT_TEXT, LAB_EVAL | LAB_RENDER | LAB_EXPORT, LAB_EVAL | LAB_RENDER | LAB_EXPORT, AT(model),
     "FILE", "model PLY; settings are taken from train.json beside it", 0, 0, 0},
    {"prior", OPT_WORD, LAB_TRAIN, 0, AT(prior), "none", "sparse-view prior", 0, 0,
     "fsgs|sparsegs|external:"},
    {"gaussians", OPT_INT, LAB_TRAIN, 0, AT(gaussians), "N", "number of Gaussians, fixed (20000)", 1, 4e6, 0},
    {"gaussians", OPT_INT, LAB_TABLES, 0, AT(gaussians), "N",
     "Gaussians of each run (20000; with --quick 8000); one table has 5 times as many", 1, 8e5, 0},
    {"sh", OPT_INT, LAB_TRAIN, 0, AT(sh), "D", "degree of the view-dependent colour, 0 to 3 (1)", 0, 3, 0},
    {"steps", OPT_INT, LAB_TRAIN, 0, AT(steps), "N", "length of the training (3000)", 1, 1e9, 0},
    {"steps", OPT_INT, LAB_TABLES, 0, AT(steps), "N", "of each run (2000; with --quick 400)", 1, 1e7, 0},
    {"time-limit", OPT_REAL, LAB_TRAIN, 0, AT(time_limit_s), "SEC", "the same in seconds, instead of --steps",
     0.01, 1e7, 0},
    {"init", OPT_TEXT, LAB_TRAIN, 0, AT(init), "sphere|cube|points:FILE",
     "start (the dataset's points, else random points in a sphere)", 0, 0, 0},
    {"background", OPT_WORD, DATA, 0, AT(background), "black|white|random",
     "behind transparent pictures (black); evaluation takes black for random", 0, 0, 0},
    {"scale", OPT_INT, DATA, 0, AT(scale), "K", "pictures at 1/K of their size (1)", 1, 64, 0},
    {"loss", OPT_TEXT, LAB_TRAIN, 0, AT(loss), "k=v,...",
     "ssim, tv, opacity, scale, tv_unseen; unseen[_every|_px|_deg], region, floor, dilation", 0, 0, 0},
    {"noise", OPT_TEXT, LAB_TRAIN | LAB_TABLES, 0, AT(noise), "[prediction,]read=V,shot=V",
     "sensor noise on the training pictures: variance read + shot x of linear light x, then 14 bits; with "
     "prediction: on predicted multiplexed measurements in each step, standard deviation read + shot x",
     0, 0, 0},
    {"antialias", OPT_WORD, LAB_TRAIN, 0, AT(antialias), "auto|on|off",
     "Mip-Splatting's compensation; auto: on when focal lengths differ by more than 1.5 (auto)", 0, 0, 0},
    {"seed", OPT_INT, LAB_TRAIN | LAB_BENCH | LAB_TABLES, 0, AT(seed), "N", "of all random numbers (1)", 0,
     4294967295.0, 0},
    {"split", OPT_TEXT, LAB_EVAL | LAB_RENDER, 0, AT(split), "S",
     "views: train, test, test_near, test_time, ... (test; test_near for a model of one exposure)", 0, 0, 0},
    {"frames", OPT_INT, LAB_RENDER | LAB_EXPORT, 0, AT(frames), "N",
     "of a moving model: the first view (--orbit: one round) at N times; delta: as many frames (25)", 2,
     10000, 0},
    {"orbit", OPT_INT, LAB_RENDER, 0, AT(orbit), "N",
     "N views on a circle around the scene, instead of --split", 1, 100000, 0},
    {"depth", OPT_FLAG, LAB_EVAL | LAB_RENDER, 0, AT(has_depth), 0,
     "eval: fail when the views have no true depth; render: 16-bit depth PNGs, too", 0, 0, 0},
    {"mask", OPT_WORD, LAB_TRAIN | LAB_EVAL, 0, AT(mask), "covisible",
     "also score only the pixels that training views have seen; train: with --eval", 0, 0, 0},
    {"lpips", OPT_FLAG, LAB_TRAIN | LAB_EVAL, 0, AT(has_lpips), 0,
     "also LPIPS (v0.1, SqueezeNet); train: with --eval", 0, 0, 0},
    {"format", OPT_WORD, LAB_EXPORT, LAB_EXPORT, AT(format), "ply|splat|spz|glb|delta",
     "of the file to write", 0, 0, 0},
    {"spz-version", OPT_INT, LAB_EXPORT, 0, AT(spz_version), "N",
     "spz: 4 (zstd, newest), 3 or 2 (gzip, older viewers) (4)", 2, 4, 0},
    {"from", OPT_WORD, LAB_IMPORT, LAB_IMPORT, AT(from),
     "colmap|nerfstudio|blender|capture|lenslet|4cam-board|qca|kalibr|sim", "what DIR is (kalibr: a file)", 0,
     0, 0},
    {"keep", OPT_INT, LAB_IMPORT, 0, AT(keep), "K", "lenslet: K x K inner sub-views (7 of 10 a side)", 1, 16,
     0},
    {"baseline", OPT_REAL, LAB_IMPORT, 0, AT(baseline_m), "M", "lenslet: metres between sub-views (0.001)",
     1e-7, 10, 0},
    {"focal", OPT_REAL, LAB_IMPORT, 0, AT(focal_px), "PX", "lenslet: focal length in pixels (the width)", 1,
     1e6, 0},
    {"focus", OPT_REAL, LAB_IMPORT, 0, AT(focus_m), "M", "lenslet: distance in focus (infinity)", 1e-5, 1e6,
     0},
    {"rig", OPT_TEXT, LAB_IMPORT, 0, AT(rig), "DIR",
     "colmap, nerfstudio, blender: poses are those of one camera of this rig; place all its sub-views", 0, 0,
     0},
    {"stream", OPT_TEXT, LAB_IMPORT, 0, AT(stream), "NAME", "with --rig: that camera, a sub-view's name", 0,
     0, 0},
    {"unit", OPT_REAL, LAB_IMPORT, 0, AT(unit_m), "M", "with --rig: metres for one unit of the poses (1)",
     1e-9, 1e9, 0},
    {"threads", OPT_INT, DATA | LAB_BENCH | LAB_TABLES, 0, AT(threads), "N", "threads (all CPUs)", 1, 64, 0},
    {"eval", OPT_FLAG, LAB_TRAIN, 0, AT(is_eval), 0,
     "evaluate at the end: on the split test, after --exposures 1 on test_near", 0, 0, 0},
    {"json", OPT_FLAG, LAB_TRAIN | LAB_EVAL | LAB_BENCH, 0, AT(is_json), 0, "print one JSON object on stdout",
     0, 0, 0},
    {"quiet", OPT_FLAG, ALL, 0, AT(is_quiet), 0, "no progress on stderr", 0, 0, 0},
    {"out", OPT_TEXT, LAB_TRAIN | LAB_RENDER | LAB_EXPORT | LAB_IMPORT | LAB_TABLES,
     LAB_TRAIN | LAB_RENDER | LAB_EXPORT | LAB_IMPORT | LAB_TABLES, AT(out), "PATH",
     "folder to write (export: file)", 0, 0, 0},
    {"help", OPT_FLAG, ALL, 0, AT(is_help), 0, "this text", 0, 0, 0},
    {"version", OPT_FLAG, ALL, 0, AT(is_version), 0, "the version", 0, 0, 0},
};
#define N_OPTIONS ((int)(sizeof table / sizeof *table))

int lab_usage(const char *command, const char *fmt, ...) {
  char text[600];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  for (char *p = text; *p; p++)
    if ((unsigned char)*p < ' ') *p = '?'; // one line, whatever stood in an argument
  fprintf(stderr, "subview-lab%s%s: %s; try 'subview-lab%s%s --help'\n", command ? " " : "",
          command ? command : "", text, command ? " " : "", command ? command : "");
  return LAB_EXIT_USAGE;
}

// Is text one of the words "a|b|c"? A word that ends in ':' stands for all texts that begin so.
static bool is_among(const char *text, const char *words) {
  size_t n = strlen(text);
  while (words && *words) {
    size_t w = strcspn(words, "|");
    if (w && words[w - 1] == ':' && strncmp(text, words, w) == 0) return true;
    if (w == n && strncmp(text, words, w) == 0) return true;
    words += w + (words[w] == '|');
  }
  return false;
}

static int set_number(const lab_command *c, const option *op, const char *value, lab_options *o) {
  double x = 0;
  long long i = 0;
  bool is_int = op->kind == OPT_INT;
  bool is_good = is_int ? sv_parse_int(value, strlen(value), &i) : sv_parse_double(value, strlen(value), &x);
  if (is_int) x = (double)i;
  if (!is_good || !(x >= op->lo && x <= op->hi))
    return lab_usage(c->name, "--%s needs a%s number from %g to %g, not '%.80s'", op->name,
                     is_int ? " whole" : "", op->lo, op->hi, value);
  if (is_int) memcpy((char *)o + op->at, &(long){(long)i}, sizeof(long));
  else memcpy((char *)o + op->at, &x, sizeof x);
  return LAB_EXIT_OK;
}

static int set_value(const lab_command *c, const option *op, const char *value, lab_options *o) {
  if (op->kind == OPT_INT || op->kind == OPT_REAL) return set_number(c, op, value, o);
  if (op->kind == OPT_WORD && is_among(value, op->later))
    return lab_usage(c->name, "--%s %.80s is not supported yet", op->name, value);
  if (op->kind == OPT_WORD && !is_among(value, op->value))
    return lab_usage(c->name, "--%s is one of %s, not '%.80s'", op->name, op->value, value);
  if (!*value) return lab_usage(c->name, "--%s needs a value", op->name);
  memcpy((char *)o + op->at, &value, sizeof value);
  return LAB_EXIT_OK;
}

static const option *find(const lab_command *c, const char *name, size_t n) {
  for (int i = 0; i < N_OPTIONS; i++)
    if ((table[i].commands & c->bit) && strlen(table[i].name) == n && strncmp(table[i].name, name, n) == 0)
      return &table[i];
  return NULL;
}

// argv[*i] is "--name", "--name=value"; *i moves over a value of its own.
static int take_option(const lab_command *c, int argc, char **argv, int *i, lab_options *o) {
  const char *name = argv[*i] + 2, *value = strchr(name, '=');
  const option *op = find(c, name, value ? (size_t)(value - name) : strlen(name));
  if (!op) return lab_usage(c->name, "unknown option '%.80s'", argv[*i]);
  if (op->kind == OPT_LATER) return lab_usage(c->name, "--%s is not supported yet", op->name);
  if (op->kind == OPT_FLAG) {
    if (value) return lab_usage(c->name, "--%s takes no value", op->name);
    *(bool *)((char *)o + op->at) = true;
    return LAB_EXIT_OK;
  }
  if (value) return set_value(c, op, value + 1, o);
  if (*i + 1 >= argc) return lab_usage(c->name, "--%s needs a value", op->name);
  return set_value(c, op, argv[++*i], o);
}

static int check_required(const lab_command *c, const lab_options *o) {
  for (int i = 0; i < N_OPTIONS; i++) {
    if (!(table[i].required & c->bit)) continue;
    const char *value;
    memcpy(&value, (const char *)o + table[i].at, sizeof value);
    if (!value) return lab_usage(c->name, "--%s is missing", table[i].name);
  }
  if (c->bit == LAB_IMPORT && !o->input) return lab_usage(c->name, "the folder to import is missing");
  bool has_optics = o->keep >= 0 || o->baseline_m >= 0 || o->focal_px >= 0 || o->focus_m >= 0;
  if (has_optics && strcmp(o->from, "lenslet") != 0)
    return lab_usage(c->name, "--keep, --baseline, --focal and --focus belong to --from lenslet");
  if (o->steps >= 0 && o->time_limit_s >= 0)
    return lab_usage(c->name, "--steps and --time-limit exclude each other");
  if (c->bit == LAB_TRAIN && !o->is_eval && (o->mask || o->has_lpips))
    return lab_usage(c->name, "--%s needs --eval", o->mask ? "mask" : "lpips");
  sv_train_cfg scratch = sv_train_defaults();
  if (o->motion && !(o->method && strcmp(o->method, "4dgs") == 0))
    return lab_usage(c->name, "--motion needs --model 4dgs");
  if (o->motion && lab_parse_motion(o->motion, &scratch) != LAB_EXIT_OK)
    return lab_usage(c->name, "--motion is clip or field, then settings ,name=number; not '%.80s'",
                     o->motion);
  if (o->orbit >= 0 && o->split) return lab_usage(c->name, "--split and --orbit exclude each other");
  return LAB_EXIT_OK;
}

static int parse_loss(const lab_command *c, lab_options *o) {
  const struct {
    const char *name;
    float *to;
    double most;
  } known[] = {{"ssim", &o->ssim, 1},
               {"tv", &o->tv, 1e6},
               {"tv_unseen", &o->tv_unseen, 1e6},
               {"unseen", &o->n_unseen, 16},
               {"unseen_every", &o->unseen_every, 1e6},
               {"unseen_px", &o->unseen_px, 4096},
               {"unseen_deg", &o->unseen_deg, 180},
               {"region", &o->region_px, 4096},
               {"floor", &o->floor_px, 10},
               {"dilation", &o->dilation_px2, 10},
               {"opacity", &o->opacity, 1e6},
               {"scale", &o->size, 1e6}};
  enum { N = sizeof known / sizeof *known };
  for (const char *p = o->loss; p && *p;) {
    size_t n = strcspn(p, ","), k = strcspn(p, "=");
    int i = 0;
    double v;
    while (i < N && !(strlen(known[i].name) == k && strncmp(p, known[i].name, k) == 0)) i++;
    if (k >= n || i == N)
      return lab_usage(c->name,
                       "--loss is a list of ssim=, tv=, tv_unseen=, unseen=, unseen_every=, unseen_px=, "
                       "unseen_deg=, region=, floor=, dilation=, opacity= and scale=, not '%.80s'",
                       o->loss);
    if (!sv_parse_double(p + k + 1, n - k - 1, &v) || !(v >= 0 && v <= known[i].most))
      return lab_usage(c->name, "--loss %s needs a number from 0 to %g", known[i].name, known[i].most);
    *known[i].to = (float)v;
    p += n + (p[n] == ',');
  }
  return LAB_EXIT_OK;
}

static int parse_noise(const lab_command *c, lab_options *o) {
  for (const char *p = o->noise; p && *p;) {
    size_t n = strcspn(p, ",");
    bool is_read = strncmp(p, "read=", 5) == 0, is_shot = strncmp(p, "shot=", 5) == 0;
    double v;
    if (n == 10 && strncmp(p, "prediction", n) == 0) {
      o->is_noise_on_prediction = true;
      p += n + (p[n] == ',');
      continue;
    }
    if ((!is_read && !is_shot) || !sv_parse_double(p + 5, n - 5, &v) || !(v >= 0 && v <= 1))
      return lab_usage(c->name, "--noise is [prediction,]read=V,shot=V with values from 0 to 1, not '%.80s'",
                       o->noise);
    *(is_read ? &o->noise_read : &o->noise_shot) = (float)v;
    p += n + (p[n] == ',');
  }
  return LAB_EXIT_OK;
}

int lab_args_parse(const lab_command *c, int argc, char **argv, lab_options *o) {
  *o = (lab_options){.exposures = -1,
                     .gaussians = -1,
                     .sh = -1,
                     .steps = -1,
                     .scale = -1,
                     .seed = -1,
                     .threads = -1,
                     .orbit = -1,
                     .frames = -1,
                     .keep = -1,
                     .spz_version = -1,
                     .baseline_m = -1,
                     .focal_px = -1,
                     .focus_m = -1,
                     .time_limit_s = -1,
                     .tv_unseen = -1,
                     .n_unseen = -1,
                     .unseen_every = -1,
                     .unseen_px = -1,
                     .unseen_deg = -1,
                     .region_px = -1,
                     .floor_px = -1,
                     .ssim = -1,
                     .tv = -1,
                     .opacity = -1,
                     .size = -1};
  for (int i = 0; i < argc; i++) // help is given whatever else stands there
    if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
      o->is_help = true;
      return LAB_EXIT_OK;
    }
  for (int i = 0; i < argc; i++) {
    int e = LAB_EXIT_OK;
    if (strncmp(argv[i], "--", 2) == 0) e = take_option(c, argc, argv, &i, o);
    else if (c->bit == LAB_IMPORT && !o->input && argv[i][0] != '-') o->input = argv[i];
    else e = lab_usage(c->name, "unexpected argument '%.80s'", argv[i]);
    if (e != LAB_EXIT_OK) return e;
  }
  if (o->is_version) return LAB_EXIT_OK;
  int e = check_required(c, o);
  if (e == LAB_EXIT_OK) e = parse_noise(c, o);
  return e != LAB_EXIT_OK ? e : parse_loss(c, o);
}

void lab_args_help(const lab_command *c) {
  printf("usage: subview-lab %s %s\n\n%s\n\nOptions (defaults in brackets):\n", c->name, c->args, c->text);
  for (int i = 0; i < N_OPTIONS; i++) {
    const option *op = &table[i];
    if (!(op->commands & c->bit) || op->kind == OPT_LATER) continue;
    char left[80];
    snprintf(left, sizeof left, "--%s %s", op->name, op->value ? op->value : "");
    printf("  %-26s %s%s%s\n", left, strlen(left) > 26 ? "\n                             " : "", op->help,
           op->required & c->bit ? "; needed" : "");
  }
  printf("\nExample:\n%s\n", c->example);
}
