// SPDX-License-Identifier: Apache-2.0
// The user's rig as that of a capture, whose cameras it must name in their order.
#include <stdlib.h>

#include "src/base/str.h"
#include "src/format/rig_file.h"
#include "tools/import/clips.h"
#include "tools/import/import.h"

#define RIG_BYTES ((size_t)32 << 20)

static sv_status check_names(const lab_options *o, const sv_rig *rig, const sv_import_camera *cams, int n,
                             sv_err *err) {
  for (int v = 0; v < rig->n_sub_views; v++) {
    const int k = rig->sub_views[v].i_camera;
    if (k >= n || !sv_str_eq(rig->sub_views[v].name, cams[k].name))
      return sv_fail(err, SV_E_FORMAT,
                     "%s: its sub-view %s is of camera %d; the cameras in order of their names are %s ...",
                     o->rig, rig->sub_views[v].name, k, cams[0].name);
  }
  return SV_OK;
}

sv_status lab_clips_take_rig(const lab_options *o, const sv_import_camera *cams, int n, sv_err *err) {
  char out[SV_CAP_PATH];
  void *block = malloc(RIG_BYTES);
  if (!block) return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", o->rig);
  sv_arena a = sv_arena_make(block, RIG_BYTES);
  sv_arena scratch = sv_arena_sub(&a, RIG_BYTES / 2);
  const sv_file_reader files = {(void *)(uintptr_t)o->rig, sv_folder_read};
  sv_rig rig;
  sv_coverage_names names;
  sv_status s = sv_rig_init(&rig, SV_CAP_SUB_VIEWS, &a);
  if (s == SV_OK) s = sv_rig_read_coverage(&rig, &names, &files, n, &scratch, err);
  for (int v = 0; s == SV_OK && v < rig.n_sub_views; v++)
    if (*names.mask[v] || *names.name[v])
      s = sv_fail(err, SV_E_UNSUPPORTED, "%s: rigs with masks or coverage images go to 'subview run --rig'",
                  o->rig);
  if (s == SV_OK) s = check_names(o, &rig, cams, n, err);
  if (s == SV_OK) s = sv_path_join(out, sizeof out, o->out, "rig", err);
  if (s == SV_OK) s = lab_rig_write(&rig, out, err);
  free(block);
  return s;
}
