// SPDX-License-Identifier: Apache-2.0
// The command line of a tool with commands: "PROGRAM COMMAND --name value ...". One table of rows
// says what there is; parsing, range checks, sentences and --help come from it (host).
#ifndef SV_PLATFORM_LINUX_OPTIONS_H
#define SV_PLATFORM_LINUX_OPTIONS_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_OPTIONS_OK    0
#define SV_OPTIONS_USAGE 2 // exit code: one line on stderr said what is wrong

#define SV_OPTIONS_CAP_LIST 256

#define SV_TEXT_OF_(x) #x
#define SV_TEXT_OF(x)  SV_TEXT_OF_(x) // a number, for a sentence of --help

// All words behind an option of kind LIST, up to the next option.
typedef struct {
  const char *of[SV_OPTIONS_CAP_LIST];
  int n;
} sv_option_list;

// What a row writes into the caller's struct, and what there means "not given".
typedef enum {
  SV_OPT_FLAG, // bool, false: takes no value
  SV_OPT_TEXT, // const char *, NULL: never empty
  SV_OPT_WORD, // const char *, NULL: one of the words of `value`, "a|b|c"
  SV_OPT_INT,  // long, below 0: from lo (at least 0) to hi
  SV_OPT_REAL, // double, below 0: from lo (at least 0) to hi
  SV_OPT_LIST, // sv_option_list, n = 0
  // Const char *, NULL: the one word without an option before it. Not in the list of --help
  SV_OPT_OPERAND,
  SV_OPT_HEADING // nothing: `help` stands above the options that follow, in --help
} sv_option_kind;

// One option of one or more commands. Several rows may have the same name when no command has two
// of them.
typedef struct {
  const char *name; // without dashes
  sv_option_kind kind;
  int commands, required; // bits of sv_tool_command
  size_t at;              // offset in the caller's struct
  const char *value;      // what --help calls the argument; of WORD the words. NULL for FLAG
  const char *help;       // for OPERAND what it is, in "HELP is missing"
  double lo, hi;          // of INT and REAL
  // WORD: words known to others and refused as not supported yet, one that ends in ':' stands for
  // all that begin so. LIST: what its words are, in the plural.
  const char *also;
} sv_option;

// "usage: PROGRAM NAME ARGS", then text, options and example. The tool's own command structs begin
// with it.
typedef struct {
  const char *name, *args, *summary, *text, *example;
  int bit;
} sv_tool_command;

// A program's options. Rows "help" and "version" are FLAGs of all commands.
typedef struct {
  const char *program;
  const sv_option *rows; // [n_rows]
  int n_rows;
  // An empty WORD "needs a value" like an empty TEXT; else it "is one of ..."
  bool is_empty_missing;
} sv_options;

// Parses argv[0..argc), the words after the command, into the struct at `to`, which holds the
// caller's defaults. A value that begins with "--" takes the form "--name=value". Strings stay
// where argv has them; of an option given twice the last counts. With --help or -h nothing else is
// looked at; with --version nothing is required. SV_OPTIONS_OK, or SV_OPTIONS_USAGE after one line
// on stderr.
int sv_options_parse(const sv_options *s, const sv_tool_command *c, int argc, char **argv,
                     void *to) SV_MUST_USE;
void sv_options_help(const sv_options *s, const sv_tool_command *c); // on stdout
// One line: "PROGRAM COMMAND: TEXT; try 'PROGRAM COMMAND --help'"; without COMMAND when it is NULL.
// Bytes below ' ' become '?'. Returns SV_OPTIONS_USAGE.
int sv_options_usage(const char *program, const char *command, const char *fmt, ...) SV_PRINTF(3, 4);
int sv_options_vusage(const char *program, const char *command, const char *fmt, va_list ap);

#ifdef __cplusplus
}
#endif
#endif
