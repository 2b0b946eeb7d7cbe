// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/options.h"

#include <stdio.h>
#include <string.h>

#include "src/base/str.h"

// Columns of --help: where the explanations begin, and where lines end.
#define HELP_AT    29
#define HELP_WIDTH 100

int sv_options_vusage(const char *program, const char *command, const char *fmt, va_list ap) {
  char text[600];
  const char *gap = command ? " " : "";
  if (!command) command = "";
  sv_vfmt(text, sizeof text, fmt, ap);
  for (char *p = text; *p; p++)
    if ((unsigned char)*p < ' ') *p = '?'; // one line, whatever stood in an argument
  fprintf(stderr, "%s%s%s: %s; try '%s%s%s --help'\n", program, gap, command, text, program, gap, command);
  return SV_OPTIONS_USAGE;
}

int sv_options_usage(const char *program, const char *command, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  int e = sv_options_vusage(program, command, fmt, ap);
  va_end(ap);
  return e;
}

// What one parse works on.
typedef struct {
  const sv_options *s;
  const sv_tool_command *c;
  char *to;
} parser;

static int refuse(const parser *p, const char *fmt, ...) SV_PRINTF(2, 3);
static int refuse(const parser *p, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  int e = sv_options_vusage(p->s->program, p->c->name, fmt, ap);
  va_end(ap);
  return e;
}

static const char *text_at(const parser *p, const sv_option *op) {
  const char *text;
  memcpy(&text, p->to + op->at, sizeof text);
  return text;
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

static int set_number(const parser *p, const sv_option *op, const char *value) {
  double x = 0;
  long long i = 0;
  bool is_int = op->kind == SV_OPT_INT;
  bool is_good = is_int ? sv_parse_int(value, strlen(value), &i) : sv_parse_double(value, strlen(value), &x);
  if (is_int) x = (double)i;
  if (!is_good || !(x >= op->lo && x <= op->hi))
    return refuse(p,
                  is_int ? "--%s %.80s: expected a whole number from %.0f to %.0f"
                         : "--%s %.80s: expected a number from %g to %g",
                  op->name, value, op->lo, op->hi);
  if (is_int) memcpy(p->to + op->at, &(long){(long)i}, sizeof(long));
  else memcpy(p->to + op->at, &x, sizeof x);
  return SV_OPTIONS_OK;
}

static int set_value(const parser *p, const sv_option *op, const char *value) {
  bool is_word = op->kind == SV_OPT_WORD;
  if (op->kind == SV_OPT_INT || op->kind == SV_OPT_REAL) return set_number(p, op, value);
  if (!*value && (!is_word || p->s->is_empty_missing)) return refuse(p, "--%s needs a value", op->name);
  if (is_word && is_among(value, op->also))
    return refuse(p, "--%s %.80s is not supported yet", op->name, value);
  if (is_word && !is_among(value, op->value))
    return refuse(p, "--%s %.80s: expected %s", op->name, value, op->value);
  if (op->kind == SV_OPT_LIST) {
    sv_option_list *list = (sv_option_list *)(void *)(p->to + op->at);
    if (list->n == SV_OPTIONS_CAP_LIST)
      return refuse(p, "more than %d %s after --%s", SV_OPTIONS_CAP_LIST, op->also, op->name);
    list->of[list->n++] = value;
  } else memcpy(p->to + op->at, &value, sizeof value);
  return SV_OPTIONS_OK;
}

// Has the command this row, and can it be given as "--name"?
static bool is_option(const sv_option *op, const sv_tool_command *c) {
  return (op->commands & c->bit) && op->kind != SV_OPT_OPERAND && op->kind != SV_OPT_HEADING;
}

// NULL: the command has no such option.
static const sv_option *find(const sv_options *s, const sv_tool_command *c, const char *name, size_t n) {
  for (int i = 0; i < s->n_rows; i++) {
    const sv_option *op = &s->rows[i];
    if (is_option(op, c) && strlen(op->name) == n && strncmp(op->name, name, n) == 0) return op;
  }
  return NULL;
}

// The flag's place; NULL: the command has no such flag.
static bool *find_flag(const parser *p, const char *name) {
  const sv_option *op = find(p->s, p->c, name, strlen(name));
  return op && op->kind == SV_OPT_FLAG ? (bool *)(p->to + op->at) : NULL;
}

// word is "--name" or "--name=value", its name n letters long.
static int refuse_unknown(const parser *p, const char *word, size_t n) {
  sv_near_name near = sv_near_make(word + 2, n);
  for (int i = 0; i < p->s->n_rows; i++)
    if (is_option(&p->s->rows[i], p->c)) sv_near_try(&near, p->s->rows[i].name);
  if (near.name) return refuse(p, "unknown option '%.80s' (did you mean --%s?)", word, near.name);
  return refuse(p, "unknown option '%.80s'", word);
}

// "--name" in a value's place is the next option, whose predecessor has lost its own;
// "--out=--name" says otherwise. "-" and "-1" are values.
static bool is_value(int argc, char **argv, int i) { return i < argc && strncmp(argv[i], "--", 2) != 0; }

// argv[*i] is "--name", "--name=value"; *i moves over values of its own.
static int take_option(const parser *p, int argc, char **argv, int *i) {
  const char *name = argv[*i] + 2, *value = strchr(name, '=');
  const sv_option *op = find(p->s, p->c, name, value ? (size_t)(value - name) : strlen(name));
  if (!op) return refuse_unknown(p, argv[*i], value ? (size_t)(value - name) : strlen(name));
  if (op->kind == SV_OPT_FLAG) {
    if (value) return refuse(p, "--%s takes no value", op->name);
    *(bool *)(p->to + op->at) = true;
    return SV_OPTIONS_OK;
  }
  if (value) return set_value(p, op, value + 1);
  if (!is_value(argc, argv, *i + 1)) return refuse(p, "--%s needs a value", op->name);
  int e = set_value(p, op, argv[++*i]);
  while (op->kind == SV_OPT_LIST && e == SV_OPTIONS_OK && is_value(argc, argv, *i + 1))
    e = set_value(p, op, argv[++*i]);
  return e;
}

static int take_operand(const parser *p, const char *word) {
  for (int i = 0; i < p->s->n_rows; i++) {
    const sv_option *op = &p->s->rows[i];
    if (!(op->commands & p->c->bit) || op->kind != SV_OPT_OPERAND) continue;
    if (text_at(p, op) || word[0] == '-') break;
    memcpy(p->to + op->at, &word, sizeof word);
    return SV_OPTIONS_OK;
  }
  return refuse(p, "unexpected argument '%.80s'", word);
}

static bool is_given(const parser *p, const sv_option *op) {
  const void *at = p->to + op->at;
  switch (op->kind) {
  case SV_OPT_FLAG: return *(const bool *)at;
  case SV_OPT_INT: return *(const long *)at >= 0;
  case SV_OPT_REAL: return *(const double *)at >= 0;
  case SV_OPT_LIST: return ((const sv_option_list *)at)->n > 0;
  case SV_OPT_TEXT:
  case SV_OPT_WORD:
  case SV_OPT_OPERAND:
  case SV_OPT_HEADING: break;
  }
  return text_at(p, op) != NULL;
}

static int check_required(const parser *p) {
  for (int i = 0; i < p->s->n_rows; i++) {
    const sv_option *op = &p->s->rows[i];
    if (!(op->required & p->c->bit) || is_given(p, op)) continue;
    if (op->kind == SV_OPT_OPERAND) return refuse(p, "%s is missing", op->help);
    return refuse(p, "--%s is missing", op->name);
  }
  return SV_OPTIONS_OK;
}

int sv_options_parse(const sv_options *s, const sv_tool_command *c, int argc, char **argv, void *to) {
  parser p = {s, c, to};
  bool *is_help = find_flag(&p, "help"), *is_version = find_flag(&p, "version");
  for (int i = 0; i < argc && is_help; i++) // help is given whatever else stands there
    if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
      *is_help = true;
      return SV_OPTIONS_OK;
    }
  for (int i = 0; i < argc; i++) {
    int e = strncmp(argv[i], "--", 2) == 0 ? take_option(&p, argc, argv, &i) : take_operand(&p, argv[i]);
    if (e != SV_OPTIONS_OK) return e;
  }
  return is_version && *is_version ? SV_OPTIONS_OK : check_required(&p);
}

// Words of text from column HELP_AT on, in lines of at most HELP_WIDTH columns; the first line has
// begun already.
static void print_wrapped(const char *text) {
  int column = HELP_AT;
  while (*text) {
    int n = (int)strcspn(text, " ");
    if (column > HELP_AT && column + 1 + n > HELP_WIDTH) {
      printf("\n%*s", HELP_AT, "");
      column = HELP_AT;
    }
    column += printf("%s%.*s", column > HELP_AT ? " " : "", n, text);
    text += n + (text[n] == ' ');
  }
  printf("\n");
}

static void print_option(const sv_option *op, bool is_required) {
  char left[240], text[600];
  int n =
      snprintf(left, sizeof left, "  --%s%s%s", op->name, op->value ? " " : "", op->value ? op->value : "");
  if (n + 2 <= HELP_AT) printf("%-*s", HELP_AT, left);
  else printf("%s\n%*s", left, HELP_AT, "");
  snprintf(text, sizeof text, "%s%s", op->help, is_required ? "; required" : "");
  print_wrapped(text);
}

void sv_options_help(const sv_options *s, const sv_tool_command *c) {
  printf("usage: %s %s %s\n\n%s\n\nOptions (defaults in brackets):\n", s->program, c->name, c->args, c->text);
  for (int i = 0; i < s->n_rows; i++) {
    const sv_option *op = &s->rows[i];
    if (is_option(op, c)) print_option(op, op->required & c->bit);
    else if ((op->commands & c->bit) && op->kind == SV_OPT_HEADING) printf("\n%s:\n", op->help);
  }
  printf("\nExample:\n%s\n", c->example);
}
