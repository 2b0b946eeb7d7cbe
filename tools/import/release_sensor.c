// SPDX-License-Identifier: Apache-2.0
#include "tools/import/release_sensor.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

double lab_srgb_decode(double x) { return x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4); }
double lab_srgb_encode(double x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055; }

static void put_lens(FILE *f, const lab_sensor_lens *l) {
  const lab_import_view *v = &l->view;
  const sv_pose w = sv_pose_inv(&v->cam_from_world);
  fprintf(f, "  {\"file_path\": \"images/e%02d_s%03d.png\", \"w\": %d, \"h\": %d", v->exposure, v->sub_view,
          v->model.width_px, v->model.height_px);
  fprintf(f, ", \"fl_x\": %.17g, \"fl_y\": %.17g, \"cx\": %.17g, \"cy\": %.17g", v->model.p[0], v->model.p[1],
          v->model.p[2], v->model.p[3]);
  fprintf(f, ", \"split\": \"train\", \"exposure\": %d, \"sub_view\": %d, \"footprint\": [%d, %d, %d, %d]",
          v->exposure, v->sub_view, v->crop.x0_px, v->crop.y0_px, v->crop.width_px, v->crop.height_px);
  if (*l->coverage) fprintf(f, ", \"coverage_path\": \"%s\"", l->coverage);
  fprintf(f, ", \"transform_matrix\": [");
  for (int i = 0; i < 3; i++) // OpenGL's axes
    fprintf(f, "[%.17g, %.17g, %.17g, %.17g], ", w.r[3 * i], -w.r[3 * i + 1], -w.r[3 * i + 2], w.t[i]);
  fprintf(f, "[0, 0, 0, 1]]}");
}

sv_status lab_sensor_write(const lab_sensor_file *s, const char *folder, const char *transforms,
                           sv_err *err) {
  char path[SV_CAP_PATH], name[80];
  sv_status st = sv_path_join(path, sizeof path, folder, transforms, err);
  if (st != SV_OK) return st;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  fprintf(f, "{\n");
  if (s->points) fprintf(f, "\"ply_file_path\": \"%s\",\n", s->points);
  fprintf(f, "\"composites_linear\": [");
  for (int e = 0; e < s->n_exposures; e++) {
    snprintf(name, sizeof name, "%.60s_e%02d.png", s->measurement, e);
    fprintf(f, "%s{\"exposure\": %d, \"file_path\": \"%s\", \"M_max\": %.9g}", e ? ", " : "", e, name,
            s->max_overlap);
  }
  fprintf(f, "],\n\"frames\": [\n");
  for (int i = 0; i < s->n; i++) {
    put_lens(f, &s->lenses[i]);
    fprintf(f, "%s\n", i + 1 < s->n ? "," : "");
  }
  fprintf(f, "]\n}\n");
  return sv_stream_save(f, err);
}
