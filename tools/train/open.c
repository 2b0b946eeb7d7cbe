// SPDX-License-Identifier: Apache-2.0
#include "tools/train/open.h"

#include <spawn.h>
#include <sys/wait.h>

#include "src/base/str.h"
#include "tools/lab/export_html.h"

extern char **environ;

// xdg-open hands the page to the browser and ends.
static bool is_opened(const char *page) {
  const char *const argv[] = {"xdg-open", page, NULL};
  pid_t pid;
  int status = 0;
  if (posix_spawnp(&pid, argv[0], NULL, NULL, (char *const *)(uintptr_t)argv, environ) != 0) return false;
  while (waitpid(pid, &status, 0) < 0) continue;
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static sv_status write_page(const lab_options *o, lab_model *m, const char *page, sv_err *err) {
  lab_settings st;
  lab_options with_model = *o;
  with_model.transforms = NULL; // what train.json says holds
  sv_status s = lab_settings_for(&st, &with_model, m, err);
  return s == SV_OK ? lab_write_html(m, &st, page, err) : s;
}

sv_status lab_open_model(lab_session *se, const lab_options *o, sv_err *err) {
  char model[SV_CAP_PATH], page[SV_CAP_PATH];
  lab_options of_model = *o;
  lab_model m = {0};
  sv_status s = sv_path_join(model, sizeof model, o->out, "model.ply", err);
  if (s == SV_OK) s = sv_path_join(page, sizeof page, o->out, "model.html", err);
  if (s == SV_OK) s = lab_model_read(&m, model, err);
  if (s != SV_OK) return s;
  of_model.model = model;
  if (m.deform.kind) lab_say(se, "--open is for still models; 'subview-lab render' makes a film of this one");
  else if ((s = write_page(&of_model, &m, page, err)) == SV_OK && !is_opened(page))
    lab_say(se, "xdg-open did not open the model; open %s in a browser", page);
  lab_model_free(&m);
  return s;
}
