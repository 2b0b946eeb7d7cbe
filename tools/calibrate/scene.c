// SPDX-License-Identifier: Apache-2.0
// Photometric calibrations that a run of subview measured on its scene: "measured" of run.json.
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/photometry_json.h"
#include "tools/calibrate/photometry.h"
#include "tools/common/fileio.h"

static int find_name(const sv_json *j, int i_list, const char *name) {
  char other[64];
  sv_err ignored;
  for (int i = sv_json_first(j, i_list); i >= 0; i = sv_json_next(j, i))
    if (sv_json_get_string(j, i, "name", other, sizeof other, &ignored) == SV_OK && sv_str_eq(other, name))
      return i;
  return -1;
}

static sv_status take(const sv_json *j, const char *path, const sv_rig *rig, cal_photometry *out,
                      sv_err *err) {
  const int i_list = sv_json_get(j, 0, "measured");
  long long n_exposures = 0;
  if (i_list < 0)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "%s: this run measured no cameras; run subview with --appearance cameras and a rig "
                   "without \"photometric\", on a scene that all cameras see",
                   path);
  sv_status s = sv_json_get_int(j, 0, "exposures", (sv_json_range){0, 1 << 30}, &n_exposures, err);
  for (int k = 0; k < rig->n_sub_views && s >= 0; k++) {
    const int i = find_name(j, i_list, rig->sub_views[k].name);
    if (i < 0)
      return sv_fail(
          err, SV_E_NOT_FOUND,
          "%s: this run did not measure %s: the scene shows too little to it and the first camera, "
          "or the run was with another rig",
          path, rig->sub_views[k].name);
    out[k] = (cal_photometry){.n_pictures = (int)n_exposures};
    s = sv_photometry_json_read(j, i, &out[k].found, err);
  }
  return s < 0 ? s : SV_OK;
}

sv_status cal_scene_read(const char *run, const sv_rig *rig, cal_photometry *out, sv_err *err) {
  char path[SV_CAP_PATH];
  void *text = NULL;
  size_t bytes = 0;
  int n_tok = 0;
  sv_json j;
  sv_status s = sv_path_join(path, sizeof path, run, "run.json", err);
  if (s == SV_OK) s = sv_file_read(path, &text, &bytes, err);
  if (s == SV_OK) s = sv_json_count(path, text, bytes, &n_tok, err);
  jsmntok_t *tok = s == SV_OK ? calloc((size_t)n_tok + 1, sizeof *tok) : NULL;
  if (s == SV_OK && !tok) s = sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  if (s == SV_OK) s = sv_json_parse(&j, &(sv_file_data){path, text, bytes}, tok, n_tok + 1, err);
  if (s == SV_OK) s = take(&j, path, rig, out, err);
  free(tok);
  free(text);
  return s;
}
