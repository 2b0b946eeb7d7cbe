// SPDX-License-Identifier: Apache-2.0
#include "src/format/photometry_json.h"

static sv_status read_doubles(const sv_json *j, int i_object, const char *key, double *out, int n,
                              sv_err *err) {
  const int i = sv_json_get(j, i_object, key);
  return i < 0 ? SV_OK : sv_json_doubles(j, i, out, n, err);
}

static sv_status check(const sv_json *j, int i, const sv_photometry *p, sv_err *err) {
  double inverse[9];
  if (!(p->corner > 0 && p->corner < 100))
    return sv_json_fail(j, sv_json_get(j, i, "corner"), err, SV_E_RANGE,
                        "a distance of the corner of 0 to 100 focal lengths was expected");
  if (!sv_photometry_has_light(p))
    return sv_json_fail(j, i, err, SV_E_RANGE,
                        "the falloff leaves less than 5 %% or more than 150 %% of the light somewhere");
  if (!sv_photometry_inverse(p, inverse))
    return sv_json_fail(j, sv_json_get(j, i, "color"), err, SV_E_RANGE,
                        "a color matrix whose inverse is at most 10 was expected");
  return SV_OK;
}

sv_status sv_photometry_json_read(const sv_json *j, int i_object, sv_photometry *p, sv_err *err) {
  const int i = sv_json_get(j, i_object, "photometric");
  if (i < 0) return SV_OK;
  if (!sv_json_is_object(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "a photometric calibration is an object with \"color\"");
  if (sv_json_get(j, i, "color") < 0) return sv_json_missing(j, i, "color", err);
  if (sv_json_get(j, i, "corner") < 0) return sv_json_missing(j, i, "corner", err);
  p->is_known = true;
  sv_status s = read_doubles(j, i, "color", p->color, 9, err);
  if (s == SV_OK) s = read_doubles(j, i, "falloff", p->falloff, 3, err);
  if (s == SV_OK) s = read_doubles(j, i, "color_sigma", p->color_sigma, 3, err);
  if (s == SV_OK) s = sv_json_get_double(j, i, "corner", &p->corner, err);
  if (s >= 0) s = sv_json_get_double(j, i, "mix_sigma", &p->mix_sigma, err);
  if (s >= 0) s = sv_json_get_double(j, i, "falloff_sigma", &p->falloff_sigma, err);
  return s < 0 ? s : check(j, i, p, err);
}

static void add_doubles(sv_str *out, const char *key, const double *v, int n) {
  sv_str_add(out, ", \"%s\": [", key);
  for (int i = 0; i < n; i++) sv_str_add(out, "%s%.6g", i ? ", " : "", v[i]);
  sv_str_add(out, "]");
}

void sv_photometry_json_write(sv_str *out, const sv_photometry *p) {
  if (!p->is_known) return;
  sv_str_add(out, "\"photometric\": {\"corner\": %.6g", p->corner);
  add_doubles(out, "color", p->color, 9);
  add_doubles(out, "falloff", p->falloff, 3);
  add_doubles(out, "color_sigma", p->color_sigma, 3);
  if (p->mix_sigma > 0) sv_str_add(out, ", \"mix_sigma\": %.3g", p->mix_sigma);
  sv_str_add(out, ", \"falloff_sigma\": %.3g}", p->falloff_sigma);
}
