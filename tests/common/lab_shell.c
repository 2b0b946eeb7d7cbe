// SPDX-License-Identifier: Apache-2.0
#include "tests/common/lab_shell.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/common/test.h"

int lab_shell_open(lab_shell *s, const char *name) {
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  char here[256];
  if (!bin || (emulate && *emulate) || !getcwd(here, sizeof here)) return 1;
  snprintf(s->lab, sizeof s->lab, "%s%s%s/subview-lab", *bin == '/' ? "" : here, *bin == '/' ? "" : "/", bin);
  if (access(s->lab, X_OK) != 0) return 1;
  return temp_folder_make(s->root, sizeof s->root, name);
}

int lab_shell_close(lab_shell *s) { return *s->root ? temp_folder_remove(s->root) : 0; }

int lab_shell_run(lab_shell *s, const char *line) {
  char command[4096];
  size_t at = (size_t)snprintf(command, sizeof command, "cd '%s/%s' && { ", s->root, s->cwd);
  for (; *line && at + sizeof s->lab < sizeof command; line++) {
    if (*line == '@') at += (size_t)snprintf(command + at, sizeof command - at, "'%s'", s->lab);
    else command[at++] = *line;
  }
  snprintf(command + at, sizeof command - at, "; } 2>&1 %s</dev/null", s->is_stdout_apart ? ">out.txt " : "");
  FILE *p = popen(command, "r");
  assert_non_null(p);
  size_t n = fread(s->said, 1, sizeof s->said - 1, p);
  s->said[n] = 0;
  int code = pclose(p);
  return WIFEXITED(code) ? WEXITSTATUS(code) : 128 + WTERMSIG(code);
}

void lab_shell_run_well(lab_shell *s, const char *line) {
  int code = lab_shell_run(s, line);
  if (code != 0) fail_msg("%s: exit %d: %s", line, code, s->said);
}

void lab_shell_need(const lab_shell *s) {
  if (s->is_ready) return;
  print_message("skipped: subview-lab is not built for this machine (SV_BIN), or runs under emulation\n");
  skip();
}
