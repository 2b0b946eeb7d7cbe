// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "tools/pictures/surface.h"

#define PIXEL_SIGMA 0.29   // of a place that is known to the pixel: 1 / sqrt(12)
#define DEPTH_SIGMA 0.3    // of the difference between the depths of the two parts
#define DEPTH_FLOOR 2.5e-3 // of the depth, at least
#define NINETY      1.645

#define N_AT 3 // depths: of the surface, and of a part in front of it and one behind

typedef struct {
  double px[2], depth[N_AT], spread; // spread: of depths around it
  float ray[3];                      // of depth 1
} end_point;

typedef struct {
  const lab_options *o;
  lab_session session;
  lab_surface surface;
  end_point end[2];
} run;

static bool read_place(const char *text, double out[2]) {
  const char *comma = strchr(text, ',');
  return comma && sv_parse_double(text, (size_t)(comma - text), &out[0]) &&
         sv_parse_double(comma + 1, strlen(comma + 1), &out[1]);
}

static sv_status prepare(run *r, sv_err *err) {
  const char *split = r->o->split ? r->o->split : "train";
  sv_status s = lab_surface_open(&r->surface, r->o, &r->session, split, err);
  if (s == SV_OK && r->o->view >= r->surface.views.n)
    s = sv_fail(err, SV_E_ARG, "--view %ld: split %s has %d views", r->o->view, split, r->surface.views.n);
  return s;
}

// Depth at a place, and the standard deviation of the nine about it.
static bool look_at(const run *r, const sv_view *v, end_point *e, int i_at) {
  const long stride = r->surface.viewer.r.rgb.stride;
  const int x = (int)e->px[0], y = (int)e->px[1];
  double sum = 0, sum2 = 0;
  int n = 0;
  for (int j = sv_maxi(y - 1, 0); j <= sv_mini(y + 1, v->height_px - 1); j++)
    for (int i = sv_maxi(x - 1, 0); i <= sv_mini(x + 1, v->width_px - 1); i++) {
      const double d = (double)r->surface.depth[j * stride + i];
      if (!(d > 0)) continue;
      sum += d;
      sum2 += d * d;
      n++;
    }
  e->depth[i_at] = (double)r->surface.depth[y * stride + x];
  if (!(e->depth[i_at] > 0)) return false;
  if (i_at == 0) e->spread = sqrt(fmax(sum2 / n - sum / n * (sum / n), 0));
  return true;
}

static sv_status find_ends(run *r, const sv_view *v, sv_err *err) {
  // How far the depth depends on which part of the light decides tells how well it is known.
  const sv_depth_slab at[N_AT] = {sv_surface_slab, {0.85f, 0.75f, 0}, {0.6f, 0.5f, 0}};
  const char *names[2] = {r->o->measure_from, r->o->measure_to};
  for (int k = 0; k < 2; k++) {
    end_point *e = &r->end[k];
    const bool is_in = read_place(names[k], e->px) && e->px[0] >= 0 && e->px[1] >= 0 &&
                       e->px[0] < v->width_px && e->px[1] < v->height_px;
    if (!is_in)
      return sv_fail(err, SV_E_ARG, "--%s %.40s: expected X,Y in the view's %dx%d pixels", k ? "to" : "from",
                     names[k], v->width_px, v->height_px);
    if (!sv_view_ray(v, (float)e->px[0], (float)e->px[1], e->ray))
      return sv_fail(err, SV_E_RANGE, "--%s %.40s: the lens sees nothing there", k ? "to" : "from", names[k]);
  }
  const sv_status s = lab_surface_render(&r->surface, v, err);
  for (int i = 0; s == SV_OK && i < N_AT; i++) {
    lab_surface_depth(&r->surface, v, at[i]);
    for (int k = 0; k < 2; k++)
      if (!look_at(r, v, &r->end[k], i))
        return sv_fail(err, SV_E_NOT_FOUND, "--%s %.40s: no surface is seen there", k ? "to" : "from",
                       names[k]);
  }
  return s;
}

// Distance, and the half width that 90 % of the truths lie in.
static double distance_of(const run *r, const sv_view *v, double *half_width) {
  double d[3], length = 0, variance = 0;
  for (int k = 0; k < 3; k++) {
    d[k] = (double)r->end[1].ray[k] * r->end[1].depth[0] - (double)r->end[0].ray[k] * r->end[0].depth[0];
    length += d[k] * d[k];
  }
  length = sqrt(length);
  for (int e = 0; e < 2; e++) {
    const end_point *p = &r->end[e];
    double along = 0, ray2 = 0;
    for (int k = 0; k < 3; k++) {
      along += (double)p->ray[k] * d[k] / fmax(length, 1e-30);
      ray2 += (double)(p->ray[k] * p->ray[k]);
    }
    const double of_parts = DEPTH_SIGMA * fabs(p->depth[2] - p->depth[1]), least = DEPTH_FLOOR * p->depth[0],
                 s2 = of_parts * of_parts + least * least + p->spread * p->spread / 9;
    const double pixel = PIXEL_SIGMA * p->depth[0] / (double)v->fx,
                 across2 = fmax(1 - along * along / ray2, 0);
    variance += along * along * s2 + across2 * pixel * pixel;
  }
  const double scale = (double)r->surface.model.unit.scale_sigma * length;
  *half_width = NINETY * sqrt(variance + scale * scale);
  return length;
}

static sv_status measure(run *r, sv_err *err) {
  sv_status s = prepare(r, err);
  if (s != SV_OK) return s;
  const sv_view *v = &r->surface.views.frames[r->o->view].view;
  if ((s = find_ends(r, v, err)) != SV_OK) return s;
  double half;
  const double length = distance_of(r, v, &half);
  const char *unit = r->surface.model.unit.is_metric ? " m" : "";
  if (r->o->is_json)
    printf("{\"distance\": %.9g, \"uncertainty_90\": %.9g, \"unit\": \"%s\", \"depth\": [%.9g, %.9g]}\n",
           length, half, r->surface.model.unit.is_metric ? "m" : "scene", r->end[0].depth[0],
           r->end[1].depth[0]);
  else printf("%.6g%s +- %.2g%s (90 %%)\n", length, unit, half, unit);
  return SV_OK;
}

int lab_cmd_measure(const lab_options *o) {
  sv_err err = {0};
  run r = {.o = o};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&r.session, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = measure(&r, &err);
  if (s != SV_OK) code = lab_failed(&r.session, &err);
  lab_session_stop(&r.session);
  lab_surface_close(&r.surface);
  return code;
}
