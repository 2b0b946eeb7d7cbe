// SPDX-License-Identifier: Apache-2.0
// The options of the tools: what lands in the caller's struct, each sentence that refuses, and
// --help.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/options.h"
#include "tests/common/test.h"

enum { RUN = 1, LOOK = 2, CAP_WORDS = 300 };

typedef struct {
  const char *name, *mode, *place;
  long n;
  double x;
  sv_option_list many;
  bool is_fast, is_help, is_version;
} values;

#define AT(field) offsetof(values, field)

static const sv_option rows[] = {
    {"name", SV_OPT_TEXT, RUN | LOOK, RUN, AT(name), "NAME", "what it is called", 0, 0, 0},
    {"mode", SV_OPT_WORD, RUN, 0, AT(mode), "slow|quick", "pace (slow)", 0, 0, "later|by:"},
    {"n", SV_OPT_INT, RUN, 0, AT(n), "N", "how many (3)", 0, 8, 0},
    {"x", SV_OPT_REAL, RUN, 0, AT(x), "X", "how much", 0.5, 1e3, 0},
    {"x", SV_OPT_REAL, LOOK, LOOK, AT(x), "A_LONG_ARGUMENT_OF_ITS_OWN", "another row", 0, 1, 0},
    {0, SV_OPT_HEADING, LOOK, 0, 0, 0, "Birds", 0, 0, 0},
    {"many", SV_OPT_LIST, LOOK, LOOK, AT(many), "A B ...",
     "as many of them as there are in the garden, in the order in which they have come there", 0, 0, "birds"},
    {"fast", SV_OPT_FLAG, RUN, 0, AT(is_fast), 0, "no waiting", 0, 0, 0},
    {"help", SV_OPT_FLAG, RUN | LOOK, 0, AT(is_help), 0, "show this help", 0, 0, 0},
    {"version", SV_OPT_FLAG, RUN | LOOK, 0, AT(is_version), 0, "the version", 0, 0, 0},
    {0, SV_OPT_OPERAND, RUN, RUN, AT(place), 0, "the place", 0, 0, 0},
};
static const sv_tool_command run = {"run", "PLACE [options]", "runs", "Runs.", "  prog run here", RUN},
                             look = {"look", "[options]", "looks", "Looks.", "  prog look", LOOK};
static sv_options options = {.program = "prog", .rows = rows, .n_rows = sizeof rows / sizeof *rows};

static values got;
static char said[4096]; // on the stream that was caught
static char line[512], *words[CAP_WORDS];

// Whatever is written to a stream goes to a file until end_catch reads it back.
static int begin_catch(FILE *stream, FILE *to) {
  fflush(stream);
  int kept = dup(fileno(stream));
  assert_true(kept >= 0 && dup2(fileno(to), fileno(stream)) >= 0);
  return kept;
}
static void end_catch(FILE *stream, FILE *to, int kept) {
  fflush(stream);
  assert_true(dup2(kept, fileno(stream)) >= 0);
  close(kept);
  rewind(to);
  said[fread(said, 1, sizeof said - 1, to)] = 0;
  fclose(to);
}

static int parse_words(const sv_tool_command *c, int n) {
  FILE *f = tmpfile();
  assert_non_null(f);
  got = (values){.n = -1, .x = -1};
  int kept = begin_catch(stderr, f), code = sv_options_parse(&options, c, n, words, &got);
  end_catch(stderr, f, kept);
  return code;
}

// text: words with a blank between them; "_" is an empty word.
static int parse(const sv_tool_command *c, const char *text) {
  int n = 0;
  snprintf(line, sizeof line, "%s", text);
  for (char *w = strtok(line, " "); w; w = strtok(NULL, " ")) words[n++] = strcmp(w, "_") == 0 ? w + 1 : w;
  return parse_words(c, n);
}

static void refused(const sv_tool_command *c, const char *text, const char *sentence) {
  char whole[1024];
  assert_int_equal(parse(c, text), SV_OPTIONS_USAGE);
  snprintf(whole, sizeof whole, "prog %s: %s; try 'prog %s --help'\n", c->name, sentence, c->name);
  assert_string_equal(said, whole);
}

TEST(test_values) {
  assert_int_equal(parse(&run, "--name a --n=7 here --mode quick --x 2.5 --fast"), SV_OPTIONS_OK);
  assert_string_equal(said, "");
  assert_string_equal(got.name, "a");
  assert_string_equal(got.mode, "quick");
  assert_string_equal(got.place, "here");
  assert_true(got.n == 7 && got.x == 2.5 && got.is_fast && !got.is_help && got.many.n == 0);
  // the last one counts
  assert_int_equal(parse(&run, "here --name a --n 0 --name b=c"), SV_OPTIONS_OK);
  assert_string_equal(got.name, "b=c");
  assert_int_equal(parse(&run, "here --name --name=--fast"), SV_OPTIONS_USAGE);
  assert_int_equal(parse(&run, "here --name=--fast"), SV_OPTIONS_OK); // meant so
  assert_string_equal(got.name, "--fast");
  assert_false(got.is_fast);
  assert_int_equal(parse(&run, "here --name -"), SV_OPTIONS_OK);
  assert_string_equal(got.name, "-");
  assert_int_equal(parse(&run, "here --name -1 --n 0"), SV_OPTIONS_OK);
  assert_string_equal(got.name, "-1");
  assert_true(got.n == 0 && got.x == -1 && !got.mode && !got.is_fast);
}

TEST(test_list) {
  assert_int_equal(parse(&look, "--many a -b c --x 1 --many=d"), SV_OPTIONS_OK);
  assert_int_equal(got.many.n, 4);
  assert_string_equal(got.many.of[1], "-b");
  assert_string_equal(got.many.of[3], "d");
  refused(&look, "--x 1 --many", "--many needs a value");
  refused(&look, "--x 1 --many a _", "--many needs a value");
  words[0] = "--x=1";
  words[1] = "--many";
  for (int i = 2; i < CAP_WORDS; i++) words[i] = "w";
  assert_int_equal(parse_words(&look, 2 + SV_OPTIONS_CAP_LIST), SV_OPTIONS_OK);
  assert_int_equal(got.many.n, SV_OPTIONS_CAP_LIST);
  assert_int_equal(parse_words(&look, 3 + SV_OPTIONS_CAP_LIST), SV_OPTIONS_USAGE);
  assert_string_equal(said, "prog look: more than 256 birds after --many; try 'prog look --help'\n");
}

TEST(test_sentences) {
  refused(&run, "here", "--name is missing");
  refused(&run, "--name a", "the place is missing");
  refused(&look, "--x 1", "--many is missing");
  refused(&look, "--many a", "--x is missing");
  refused(&run, "--name a here there", "unexpected argument 'there'");
  refused(&run, "--name a -x", "unexpected argument '-x'");
  refused(&look, "here", "unexpected argument 'here'");
  refused(&run, "--nam a", "unknown option '--nam' (did you mean --name?)");
  refused(&run, "--bogus=1", "unknown option '--bogus=1'");
  refused(&look, "--Birds", "unknown option '--Birds'"); // a heading
  refused(&look, "--fast", "unknown option '--fast'");   // of the other command
  refused(&run, "--name", "--name needs a value");
  refused(&run, "--name=", "--name needs a value");
  // what follows is an option, known or not
  refused(&run, "--name --fast here", "--name needs a value");
  refused(&run, "--mode --fast --name a here", "--mode needs a value");
  refused(&run, "--n --bogus", "--n needs a value");
  refused(&run, "--x --", "--x needs a value");
  refused(&look, "--x 1 --many --x 1", "--many needs a value");
  refused(&run, "--fast=1", "--fast takes no value");
  refused(&run, "--help=1", "--help takes no value");
  refused(&run, "--mode swift", "--mode swift: expected slow|quick");
  refused(&run, "--mode slo", "--mode slo: expected slow|quick");
  refused(&run, "--mode later", "--mode later is not supported yet");
  refused(&run, "--mode by:me", "--mode by:me is not supported yet");
  refused(&run, "--n 9", "--n 9: expected a whole number from 0 to 8");
  refused(&run, "--n 1.5", "--n 1.5: expected a whole number from 0 to 8");
  refused(&run, "--n -1", "--n -1: expected a whole number from 0 to 8");
  refused(&run, "--x 0.4", "--x 0.4: expected a number from 0.5 to 1000");
  refused(&run, "--x nan", "--x nan: expected a number from 0.5 to 1000");
  refused(&run, "--x 1e", "--x 1e: expected a number from 0.5 to 1000");
  refused(&run, "--name a\nb --n \x1b[2J", "--n ?[2J: expected a whole number from 0 to 8");
  refused(&run, "--mode _", "--mode : expected slow|quick");
  options.is_empty_missing = true;
  refused(&run, "--mode _", "--mode needs a value");
  options.is_empty_missing = false;
}

TEST(test_help_and_version) {
  assert_int_equal(parse(&run, "--n wrong --bogus -h"), SV_OPTIONS_OK);
  assert_true(got.is_help && !got.is_version);
  assert_int_equal(parse(&run, "--help"), SV_OPTIONS_OK);
  assert_true(got.is_help);
  assert_int_equal(parse(&run, "--version"), SV_OPTIONS_OK); // nothing is required
  assert_true(got.is_version && !got.is_help);
  refused(&run, "--version --bogus", "unknown option '--bogus'");
  FILE *f = tmpfile();
  assert_non_null(f);
  int kept = begin_catch(stdout, f);
  sv_options_help(&options, &look);
  end_catch(stdout, f, kept);
  assert_string_equal(said, "usage: prog look [options]\n\nLooks.\n\nOptions (defaults in brackets):\n"
                            "  --name NAME                what it is called\n"
                            "  --x A_LONG_ARGUMENT_OF_ITS_OWN\n"
                            "                             another row; required\n"
                            "\nBirds:\n"
                            "  --many A B ...             as many of them as there are in the garden, in the "
                            "order in which they\n"
                            "                             have come there; required\n"
                            "  --help                     show this help\n"
                            "  --version                  the version\n"
                            "\nExample:\n  prog look\n");
}

TEST(test_usage_without_a_command) {
  FILE *f = tmpfile();
  assert_non_null(f);
  int kept = begin_catch(stderr, f), code = sv_options_usage("prog", NULL, "%d\n%s", 1, "x");
  end_catch(stderr, f, kept);
  assert_int_equal(code, SV_OPTIONS_USAGE);
  assert_string_equal(said, "prog: 1?x; try 'prog --help'\n");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_values),
      cmocka_unit_test(test_list),
      cmocka_unit_test(test_sentences),
      cmocka_unit_test(test_help_and_version),
      cmocka_unit_test(test_usage_without_a_command),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
