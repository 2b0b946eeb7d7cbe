// SPDX-License-Identifier: Apache-2.0
#include "src/run/arrays.h"

#define SIDE_PX 1024
#define MANY    65536 // Gaussians: a multiple of all ranges

// The renderer's default capacity of intersections: src/splat/render.c.
#define INTERSECTIONS_PER_GAUSSIAN 8.0
#define INTERSECTIONS_PER_PIXEL    (64.0 / (SV_TILE_PX * SV_TILE_PX))

static void add(sv_arrays *f, const char *name, double per_gaussian, double per_pixel) {
  if (f->n_rows < SV_ARRAYS_CAP_ROWS && (per_gaussian > 0 || per_pixel > 0))
    f->row[f->n_rows++] = (sv_array_row){name, per_gaussian, per_pixel};
}

// Bytes that each Gaussian and each pixel adds to a trainer.
static void measure(const sv_train_cfg *cfg, double *per_gaussian, double *per_pixel) {
  sv_train_cfg c = *cfg;
  c.cap_pixels = 0;
  c.cap_width_px = c.cap_height_px = SIDE_PX;
  c.n_gaussians = MANY;
  double base = (double)sv_trainer_bytes(&c);
  c.n_gaussians = 2 * MANY;
  *per_gaussian = ((double)sv_trainer_bytes(&c) - base) / MANY;
  c.n_gaussians = MANY;
  c.cap_height_px = 2 * SIDE_PX;
  *per_pixel = ((double)sv_trainer_bytes(&c) - base) / ((double)SIDE_PX * SIDE_PX);
}

sv_arrays sv_arrays_of(const sv_train_cfg *c) {
  sv_arrays f = {0};
  const double rows = SV_N_ROWS(c->sh_degree), intersection = sizeof(sv_intersection) + sizeof(uint32_t),
               igrad = SV_IGRAD_BYTES;
  const double n_g = c->cap_intersections ? 0 : INTERSECTIONS_PER_GAUSSIAN,
               n_px = c->cap_intersections ? 0 : INTERSECTIONS_PER_PIXEL;
  const double samples = c->is_supersampled ? 4 : 1; // of a pixel
  const bool has_sum = c->cap_measurements > 0 || c->n_novel > 0;
  add(&f, "parameters", 4 * rows, 0);
  add(&f, c->optimizer == SV_OPTIMIZER_ADAM ? "Adam's moments" : "moments, curvature",
      4 * rows + (c->optimizer == SV_OPTIMIZER_ADAM ? 0 : 6), 0);
  add(&f, "errors, floors, touched", 4 + (c->min_scale_px > 0.0f ? 4 : 0) + 0.25, 0);
  add(&f, "relocation", sizeof(double) + 2 * sizeof(int32_t), 0);
  add(&f, "sum over several images", has_sum ? 4 * (rows + SV_TRAIN_SUM_MORE) + 0.5 : 0, has_sum ? 16 : 0);
  add(&f, "splats", sizeof(sv_splat), 0);
  add(&f, "depths, dropout mask", 4 + 0.125, 0);
  add(&f, "intersections", intersection * n_g, samples * intersection * n_px);
  add(&f, "intersection gradients, sort", igrad * n_g, samples * igrad * n_px);
  add(&f, "tile lists", 0, samples * 4.0 * (2 + 2 * SV_RENDER_CHUNKS) / (SV_TILE_PX * SV_TILE_PX));
  add(&f, "color, depth, transmittance", 0, samples * 20);
  add(&f, "means, their gradients", 0, c->is_supersampled ? 12 + samples * 16 : 0);
  add(&f, "target", 0, 12);
  add(&f, "gradient and error", 0, 16);
  measure(c, &f.per_gaussian, &f.per_pixel);
  double other_g = f.per_gaussian, other_px = f.per_pixel;
  for (int i = 0; i < f.n_rows; i++) {
    other_g -= f.row[i].per_gaussian;
    other_px -= f.row[i].per_pixel;
  }
  // Sums of rows of pixels and counts of ranges are too small for a row.
  if (other_g > 0.1 || other_px > 0.1)
    add(&f, "other", other_g > 0.1 ? other_g : 0, other_px > 0.1 ? other_px : 0);
  return f;
}

void sv_arrays_print(sv_str *out, const sv_arrays *f, bool is_json) {
  if (!is_json)
    sv_str_add(out, "%-28s %16s %14s\n", "training, array by array", "bytes a Gaussian", "bytes a pixel");
  for (int i = 0; i < f->n_rows; i++) {
    const sv_array_row *r = f->row + i;
    sv_str_add(out,
               is_json ? "%s{\"name\": \"%s\", \"bytes_per_gaussian\": %.2f, \"bytes_per_pixel\": %.3f}"
                       : "%s%-28s %16.2f %14.3f\n",
               is_json && i ? ", " : "", r->name, r->per_gaussian, r->per_pixel);
  }
  if (!is_json) sv_str_add(out, "%-28s %16.2f %14.3f\n", "sum", f->per_gaussian, f->per_pixel);
}
