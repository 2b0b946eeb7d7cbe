// SPDX-License-Identifier: Apache-2.0
// Rigs in and out of the importers: Kalibr's camera chains, and rig folders.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/cameramodel.h"
#include "src/format/kalibr.h"
#include "src/format/rig_file.h"
#include "tools/import/import.h"

static sv_status write_text(const char *folder, const char *name, const sv_str *text, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, folder, name, err);
  return s == SV_OK ? sv_file_write(path, text->buf, text->len, err) : s;
}

sv_status lab_rig_write(const sv_rig *rig, const char *folder, sv_err *err) {
  static char text[SV_CAP_SUB_VIEWS * 256];
  char name[64];
  sv_status s = sv_path_make_folder(folder, err);
  for (int i = -1; s == SV_OK && i < rig->n_sub_views; i++) {
    const sv_sub_view *v = &rig->sub_views[i < 0 ? 0 : i];
    sv_str out = sv_str_make(text, sizeof text);
    snprintf(name, sizeof name, i < 0 ? "rig.json" : "%s.cameramodel", v->name);
    s = i < 0 ? sv_rig_json_write(&out, rig) : sv_cameramodel_write(&out, &v->model, &v->cam_from_rig);
    s = s == SV_OK ? write_text(folder, name, &out, err)
                   : sv_fail(err, s, "%s/%s: the rig does not fit its text", folder, name);
  }
  return s;
}

sv_status lab_import_kalibr(const char *file, const char *out, int *n_cameras, sv_err *err) {
  sv_sub_view *views = calloc(SV_CAP_SUB_VIEWS, sizeof *views);
  sv_rig rig = {.sub_views = views, .cap_sub_views = SV_CAP_SUB_VIEWS};
  void *text = NULL;
  size_t bytes = 0;
  sv_status s =
      views ? sv_file_read(file, &text, &bytes, err) : sv_fail(err, SV_E_NOMEM, "%s: no memory", file);
  if (s == SV_OK) s = sv_kalibr_read(&rig, file, text, bytes, err);
  if (s == SV_OK) s = lab_rig_write(&rig, out, err);
  *n_cameras = rig.n_sub_views;
  free(text);
  free(views);
  return s;
}
