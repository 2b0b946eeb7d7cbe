// SPDX-License-Identifier: Apache-2.0
#include "tools/calibrate/args.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "src/base/str.h"

typedef enum { OPT_FLAG, OPT_TEXT, OPT_WORD, OPT_INT, OPT_REAL, OPT_LIST } option_kind;

// value: what --help calls the argument; of OPT_WORD the words that may stand there.
typedef struct {
  const char *name;
  option_kind kind;
  int commands, required; // bits
  size_t at;
  const char *value, *help;
  double lo, hi;
} option;

#define AT(field) offsetof(cal_options, field)
#define ALL       (CAL_BOARD | CAL_LENSLETS | CAL_POSE | CAL_CHECK)

static const option table[] = {
    {"images", OPT_LIST, CAL_BOARD | CAL_CHECK, CAL_BOARD, 0, "CAM0 CAM1 ...",
     "per camera a quoted pattern ('left*.jpg') or a folder; what the wildcards stand for numbers the frames",
     0, 0},
    {"board", OPT_TEXT, CAL_BOARD, CAL_BOARD, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0, 0},
    {"isolated", OPT_TEXT, CAL_LENSLETS, CAL_LENSLETS, AT(isolated), "DIR",
     "pictures with one lens open: LENS.png, LENS/*.png (exposures by name) or EXPOSURE/LENS.png", 0, 0},
    {"white", OPT_TEXT, CAL_LENSLETS, CAL_LENSLETS, AT(white), "DIR",
     "the same of an even bright field: LENS.png, one for each lens", 0, 0},
    {"pitch", OPT_REAL, CAL_LENSLETS, 0, AT(pitch_m), "M",
     "metres between neighbouring lenses: sets the scale (1, in unknown units)", 1e-9, 1e3},
    {"focal", OPT_REAL, CAL_LENSLETS, 0, AT(focal_px), "PX",
     "mean focal length of the lenses, when it is known (estimated; a narrow array knows it badly)", 1, 1e6},
    {"dark", OPT_REAL, CAL_LENSLETS, 0, AT(dark), "V", "level of no light, 0 to 1 (measured)", 0, 1},
    {"linear", OPT_FLAG, CAL_LENSLETS, 0, AT(is_linear), 0, "values are linear light, not sRGB-encoded", 0,
     0},
    {"board", OPT_TEXT, CAL_LENSLETS, 0, AT(board), "WxH",
     "the object is a chessboard with so many inner corners, in several exposures", 0, 0},
    {"spacing", OPT_REAL, CAL_LENSLETS, 0, AT(spacing_m), "M", "side of its squares in metres", 1e-6, 100},
    {"board", OPT_TEXT, CAL_CHECK, 0, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0, 0},
    {"spacing", OPT_REAL, CAL_BOARD, CAL_BOARD, AT(spacing_m), "M", "side of a square in metres", 1e-6, 100},
    {"spacing", OPT_REAL, CAL_CHECK, 0, AT(spacing_m), "M", "side of a square in metres", 1e-6, 100},
    {"model", OPT_WORD, CAL_BOARD, 0, AT(model),
     "LENSMODEL_PINHOLE|LENSMODEL_OPENCV4|LENSMODEL_OPENCV5|LENSMODEL_OPENCV8",
     "lens model (LENSMODEL_OPENCV5)", 0, 0},
    {"flat", OPT_FLAG, CAL_BOARD, 0, AT(is_flat), 0, "take the board as flat: do not estimate its bend", 0,
     0},
    {"name", OPT_TEXT, CAL_BOARD | CAL_LENSLETS, 0, AT(name), "NAME", "of the rig (the name of the folder)",
     0, 0},
    {"rig", OPT_TEXT, CAL_CHECK, CAL_CHECK, AT(rig), "RIG", "rig: a folder with rig.json", 0, 0},
    {"threads", OPT_INT, ALL, 0, AT(threads), "N", "threads (all CPUs)", 1, 64},
    {"json", OPT_FLAG, ALL, 0, AT(is_json), 0, "print one JSON object on stdout", 0, 0},
    {"quiet", OPT_FLAG, ALL, 0, AT(is_quiet), 0, "no progress on stderr", 0, 0},
    {"out", OPT_TEXT, CAL_BOARD | CAL_LENSLETS, CAL_BOARD | CAL_LENSLETS, AT(out), "RIG", "folder to write",
     0, 0},
    {"rig", OPT_TEXT, CAL_POSE, CAL_POSE, AT(rig), "RIG", "folder with rig.json", 0, 0},
    {"capture", OPT_TEXT, CAL_POSE, CAL_POSE, AT(capture), "DIR", "capture folder", 0, 0},
    {"out", OPT_TEXT, CAL_POSE, CAL_POSE, AT(out), "POSES", "folder to write", 0, 0},
    {"help", OPT_FLAG, ALL, 0, AT(is_help), 0, "this text", 0, 0},
    {"version", OPT_FLAG, ALL, 0, AT(is_version), 0, "the version", 0, 0},
};
#define N_OPTIONS ((int)(sizeof table / sizeof *table))

int cal_usage(const char *command, const char *fmt, ...) {
  char text[600];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  for (char *p = text; *p; p++)
    if ((unsigned char)*p < ' ') *p = '?'; // one line, whatever stood in an argument
  fprintf(stderr, "subview-calibrate%s%s: %s; try 'subview-calibrate%s%s --help'\n", command ? " " : "",
          command ? command : "", text, command ? " " : "", command ? command : "");
  return CAL_EXIT_USAGE;
}

// Is text one of the words "a|b|c"?
static bool is_among(const char *text, const char *words) {
  size_t n = strlen(text);
  while (words && *words) {
    size_t w = strcspn(words, "|");
    if (w == n && strncmp(text, words, w) == 0) return true;
    words += w + (words[w] == '|');
  }
  return false;
}

static int set_number(const cal_command *c, const option *op, const char *value, cal_options *o) {
  double x = 0;
  long long i = 0;
  bool is_int = op->kind == OPT_INT;
  bool is_good = is_int ? sv_parse_int(value, strlen(value), &i) : sv_parse_double(value, strlen(value), &x);
  if (is_int) x = (double)i;
  if (!is_good || !(x >= op->lo && x <= op->hi))
    return cal_usage(c->name, "--%s needs a%s number from %g to %g, not '%.80s'", op->name,
                     is_int ? " whole" : "", op->lo, op->hi, value);
  if (is_int) memcpy((char *)o + op->at, &(long){(long)i}, sizeof(long));
  else memcpy((char *)o + op->at, &x, sizeof x);
  return CAL_EXIT_OK;
}

static int set_value(const cal_command *c, const option *op, const char *value, cal_options *o) {
  if (op->kind == OPT_INT || op->kind == OPT_REAL) return set_number(c, op, value, o);
  if (!*value) return cal_usage(c->name, "--%s needs a value", op->name);
  if (op->kind == OPT_WORD && !is_among(value, op->value))
    return cal_usage(c->name, "--%s is one of %s, not '%.80s'", op->name, op->value, value);
  if (op->kind == OPT_LIST) {
    if (o->n_images == CAL_CAP_IMAGES)
      return cal_usage(c->name, "more than %d cameras after --%s", CAL_CAP_IMAGES, op->name);
    o->images[o->n_images++] = value;
  } else memcpy((char *)o + op->at, &value, sizeof value);
  return CAL_EXIT_OK;
}

static const option *find(const cal_command *c, const char *name, size_t n) {
  for (int i = 0; i < N_OPTIONS; i++)
    if ((table[i].commands & c->bit) && strlen(table[i].name) == n && strncmp(table[i].name, name, n) == 0)
      return &table[i];
  return NULL;
}

// argv[*i] is "--name", "--name=value"; *i moves over values of its own.
static int take_option(const cal_command *c, int argc, char **argv, int *i, cal_options *o) {
  const char *name = argv[*i] + 2, *value = strchr(name, '=');
  const option *op = find(c, name, value ? (size_t)(value - name) : strlen(name));
  if (!op) return cal_usage(c->name, "unknown option '%.80s'", argv[*i]);
  if (op->kind == OPT_FLAG) {
    if (value) return cal_usage(c->name, "--%s takes no value", op->name);
    *(bool *)((char *)o + op->at) = true;
    return CAL_EXIT_OK;
  }
  if (value) return set_value(c, op, value + 1, o);
  if (*i + 1 >= argc) return cal_usage(c->name, "--%s needs a value", op->name);
  int e = set_value(c, op, argv[++*i], o);
  while (op->kind == OPT_LIST && e == CAL_EXIT_OK && *i + 1 < argc && strncmp(argv[*i + 1], "--", 2) != 0)
    e = set_value(c, op, argv[++*i], o);
  return e;
}

static int check_required(const cal_command *c, const cal_options *o) {
  for (int i = 0; i < N_OPTIONS; i++) {
    const option *op = &table[i];
    bool is_given = true;
    if (!(op->required & c->bit)) continue;
    if (op->kind == OPT_LIST) is_given = o->n_images > 0;
    else if (op->kind == OPT_REAL) is_given = *(const double *)((const char *)o + op->at) >= 0;
    else {
      const char *value;
      memcpy(&value, (const char *)o + op->at, sizeof value);
      is_given = value != NULL;
    }
    if (!is_given) return cal_usage(c->name, "--%s is missing", op->name);
  }
  return CAL_EXIT_OK;
}

static int parse_board(const cal_command *c, cal_options *o) {
  if (!o->board) return CAL_EXIT_OK;
  size_t n = strcspn(o->board, "xX");
  long long w, h;
  if (!o->board[n] || !sv_parse_int(o->board, n, &w) ||
      !sv_parse_int(o->board + n + 1, strlen(o->board + n + 1), &h) || w < 3 || h < 3 ||
      w > SV_BOARD_CAP_SIDE || h > SV_BOARD_CAP_SIDE)
    return cal_usage(c->name, "--board is WxH inner corners, each from 3 to %d, not '%.80s'",
                     SV_BOARD_CAP_SIDE, o->board);
  o->n_cols = (int)w, o->n_rows = (int)h;
  return CAL_EXIT_OK;
}

int cal_args_parse(const cal_command *c, int argc, char **argv, cal_options *o) {
  *o = (cal_options){.spacing_m = -1, .pitch_m = -1, .focal_px = -1, .dark = -1, .threads = -1};
  for (int i = 0; i < argc; i++) // help is given whatever else stands there
    if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
      o->is_help = true;
      return CAL_EXIT_OK;
    }
  for (int i = 0; i < argc; i++) {
    int e = strncmp(argv[i], "--", 2) == 0 ? take_option(c, argc, argv, &i, o)
                                           : cal_usage(c->name, "unexpected argument '%.80s'", argv[i]);
    if (e != CAL_EXIT_OK) return e;
  }
  if (o->is_version) return CAL_EXIT_OK;
  int e = check_required(c, o);
  if (e == CAL_EXIT_OK && (o->board != NULL) != (o->spacing_m >= 0))
    e = cal_usage(c->name, "--board and --spacing belong together");
  return e != CAL_EXIT_OK ? e : parse_board(c, o);
}

void cal_args_help(const cal_command *c) {
  printf("usage: subview-calibrate %s %s\n\n%s\n\nOptions (defaults in brackets):\n", c->name, c->args,
         c->text);
  for (int i = 0; i < N_OPTIONS; i++) {
    const option *op = &table[i];
    if (!(op->commands & c->bit)) continue;
    char left[120];
    snprintf(left, sizeof left, "--%s %s", op->name, op->value ? op->value : "");
    printf("  %-26s %s%s%s\n", left, strlen(left) > 26 ? "\n                             " : "", op->help,
           op->required & c->bit ? "; needed" : "");
  }
  printf("\nExample:\n%s\n", c->example);
}
