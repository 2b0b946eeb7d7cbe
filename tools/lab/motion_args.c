// SPDX-License-Identifier: Apache-2.0
// --motion clip|field[,k=v...].
#include <string.h>

#include "src/base/str.h"
#include "src/train/objective.h"
#include "tools/lab/lab.h"

typedef struct {
  const char *name;
  float *real;
  int *whole;
  double most;
} setting;

static int set_field(sv_dynamic_cfg *d, const char *name, size_t n) {
  char preset[16];
  if (n >= sizeof preset) return LAB_EXIT_USAGE;
  memcpy(preset, name, n);
  preset[n] = 0;
  return sv_field_preset(preset, &d->field) ? LAB_EXIT_OK : LAB_EXIT_USAGE;
}

static int set_number(const setting *known, size_t n_known, const char *p, size_t k, size_t n) {
  size_t i = 0;
  double v;
  while (i < n_known && !(strlen(known[i].name) == k && !strncmp(p, known[i].name, k))) i++;
  if (k >= n || i == n_known || !sv_parse_double(p + k + 1, n - k - 1, &v) || !(v >= 0 && v <= known[i].most))
    return LAB_EXIT_USAGE;
  if (known[i].real) *known[i].real = (float)v;
  else *known[i].whole = (int)v;
  return LAB_EXIT_OK;
}

static int parse(const char *text, bool with_preset, sv_dynamic_cfg *d) {
  const setting known[] = {{"clip", &d->distil_at, 0, 0.9},
                           {"bodies", 0, &d->n_bodies, SV_CAP_BODIES - 1},
                           {"pos", 0, &d->n_pos, SV_CAP_MOTION_FUNCTIONS},
                           {"rot", 0, &d->n_rot, SV_CAP_MOTION_FUNCTIONS},
                           {"color", 0, &d->n_colour, SV_CAP_MOTION_FUNCTIONS},
                           {"times", 0, &d->field.n_times, 1024},
                           {"base", 0, &d->field.base, 512},
                           {"width", 0, &d->field.width, SV_FIELD_CAP_WIDTH},
                           {"channels", 0, &d->field.n_channels, 32},
                           {"levels", 0, &d->field.n_levels, 3}};
  const size_t n_known = sizeof known / sizeof *known;
  size_t n = text ? strcspn(text, ",") : 0;
  d->kind = SV_DEFORM_CLIP;
  if (n == 5 && !strncmp(text, "field", 5)) d->kind = SV_DEFORM_FIELD;
  else if (text && !(n == 4 && !strncmp(text, "clip", 4))) return LAB_EXIT_USAGE;
  for (const char *p = text ? text + n : ""; *p;) {
    size_t k = strcspn(++p, "=");
    n = strcspn(p, ",");
    int e = k == 6 && k < n && !strncmp(p, "preset", 6) && d->kind == SV_DEFORM_FIELD
                ? (with_preset ? set_field(d, p + 7, n - 7) : LAB_EXIT_OK)
                : set_number(known, n_known, p, k, n);
    if (e != LAB_EXIT_OK) return e;
    p += n;
  }
  return LAB_EXIT_OK;
}

int lab_parse_motion(const char *text, sv_dynamic_cfg *d) { return parse(text, true, d); }

void lab_dynamic_cfg(const lab_options *o, int expected_steps, int n_times, sv_dynamic_cfg *d) {
  (void)parse(o->motion, true, d);
  if (n_times < 1) return;
  sv_dynamic_set_times(d, expected_steps, n_times);
  (void)parse(o->motion, false, d); // what is asked for goes before what the times ask for; presets
                                    // do not
}
