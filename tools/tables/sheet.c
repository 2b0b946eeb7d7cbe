// SPDX-License-Identifier: Apache-2.0
// Contact sheets: for each device a row of truth, render, error, true depth and depth of one near
// view, from what the runs with one exposure rendered.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/json.h"
#include "tools/pictures/sheet.h"
#include "tools/tables/tables.h"

#define N_COLUMNS  5
#define ERROR_GAIN 4
#define GAP_PX     4
#define BAND_PX    (LAB_SHEET_TEXT_PX + 4) // of labels

static const uint8_t ink[3] = {0, 0, 0};

// One row's images; all of the view's size.
typedef struct {
  int w, h;
  uint8_t *truth;            // [h][w][3], over black
  float *depth_true, *depth; // [h][w], 0: none; depth_true NULL: the dataset has none
  sv_bitmap render;
} cells;

static void cells_free(cells *c) {
  free(c->truth);
  free(c->depth_true);
  free(c->depth);
  sv_bitmap_free(&c->render);
  memset(c, 0, sizeof *c);
}

// --- loading -------------------------------------------------------------------------------------

// The name of view i and the unit of depth, from the views.json that render wrote.
static sv_status read_list(const char *path, int i_view, char *name, size_t cap, double *unit, sv_err *err) {
  void *text;
  size_t bytes;
  int n_tok;
  sv_json j;
  sv_status s = sv_file_read(path, &text, &bytes, err);
  if (s != SV_OK) return s;
  jsmntok_t *tok = NULL;
  s = sv_json_count(path, text, bytes, &n_tok, err);
  if (s == SV_OK && !(tok = malloc(((size_t)n_tok + 1) * sizeof *tok)))
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its JSON tokens", path);
  if (s == SV_OK) s = sv_json_parse(&j, &(sv_file_data){path, text, bytes}, tok, n_tok, err);
  if (s == SV_OK) {
    int at = sv_json_first(&j, sv_json_get(&j, 0, "views"));
    for (int i = 0; i < i_view && at >= 0; i++) at = sv_json_next(&j, at);
    s = sv_json_get_double(&j, 0, "depth_unit_scale_factor", unit, err);
    if (s == SV_OK) s = sv_json_get_string(&j, at, "name", name, cap, err);
    if (s == SV_END)
      s = sv_fail(err, SV_E_FORMAT, "%s: does not list view %d and the unit of depth", path, i_view);
  }
  free(tok);
  free(text);
  return s;
}

static sv_status read_picture(const char *folder, const char *name, bool is_depth, const cells *c,
                              sv_bitmap *out, sv_err *err) {
  char path[SV_CAP_PATH], file[SV_CAP_PATH];
  snprintf(file, sizeof file, "%.900s%s", name, is_depth ? "_depth.png" : ".png");
  sv_status s = sv_path_join(path, sizeof path, folder, file, err);
  if (s == SV_OK) s = sv_bitmap_read(path, out, err);
  if (s != SV_OK) return s;
  if (out->width_px == c->w && out->height_px == c->h && out->bits == (is_depth ? 16 : 8) &&
      out->n_channels == (is_depth ? 1 : 3))
    return SV_OK;
  sv_bitmap_free(out);
  return sv_fail(err, SV_E_FORMAT, "%s: is not a %dx%d image written by render", path, c->w, c->h);
}

static sv_status read_render(cells *c, const char *folder, int i_view, sv_err *err) {
  char path[SV_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH];
  double unit = 0;
  sv_bitmap z;
  sv_status s = sv_path_join(path, sizeof path, folder, "views.json", err);
  if (s == SV_OK) s = read_list(path, i_view, name, sizeof name, &unit, err);
  if (s == SV_OK) s = read_picture(folder, name, false, c, &c->render, err);
  if (s == SV_OK) s = read_picture(folder, name, true, c, &z, err);
  if (s != SV_OK) return s;
  for (size_t i = 0; i < (size_t)c->w * (size_t)c->h; i++) c->depth[i] = (float)(z.u16[i] * unit);
  sv_bitmap_free(&z);
  return SV_OK;
}

static sv_status read_truth(cells *c, const lab_frame *f, int scale, bool has_depth, sv_err *err) {
  lab_loader l = {.map = {0}};
  size_t n = (size_t)f->view.width_px * (size_t)f->view.height_px, ch = (size_t)f->n_channels;
  c->w = f->view.width_px;
  c->h = f->view.height_px;
  c->truth = malloc(4 * n);
  c->depth = malloc(n * sizeof *c->depth);
  c->depth_true = has_depth ? malloc(n * sizeof *c->depth_true) : NULL;
  if (!c->truth || !c->depth || (has_depth && !c->depth_true))
    return sv_fail(err, SV_E_NOMEM, "no memory for an image of the contact sheet");
  sv_status s = lab_picture_load(&l, f, scale, c->truth, err);
  if (s == SV_OK && has_depth) s = lab_depth_load(&l, f, scale, c->depth_true, err);
  lab_loader_free(&l);
  for (size_t i = 0; i < n && s == SV_OK && ch == 4; i++) // to three channels, over black
    for (size_t k = 0; k < 3; k++)
      c->truth[3 * i + k] = (uint8_t)((c->truth[4 * i + k] * c->truth[4 * i + 3] + 127) / 255);
  return s;
}

// --- drawing -------------------------------------------------------------------------------------

static void depth_range(const float *z, size_t n, float range[2]) {
  range[0] = range[1] = 0;
  for (size_t i = 0; i < n; i++) {
    if (z[i] <= 0) continue;
    if (range[0] == 0 || z[i] < range[0]) range[0] = z[i];
    if (z[i] > range[1]) range[1] = z[i];
  }
}

static uint8_t depth_grey(float z, const float range[2]) {
  if (z <= 0) return 0;
  float x = range[1] > range[0] ? (z - range[0]) / (range[1] - range[0]) : 0;
  x = x < 0 ? 0 : x > 1 ? 1 : x;
  return (uint8_t)(255 - 215 * x + 0.5f);
}

static void draw_row(lab_sheet *sh, const cells *c, int y0) {
  float range[2];
  depth_range(c->depth_true ? c->depth_true : c->depth, (size_t)c->w * (size_t)c->h, range);
  for (int y = 0; y < c->h; y++)
    for (int x = 0; x < c->w; x++) {
      size_t i = (size_t)y * (size_t)c->w + (size_t)x;
      const uint8_t *a = c->truth + 3 * i, *b = c->render.u8 + 3 * i;
      uint8_t error[3], grey;
      for (int k = 0; k < 3; k++) {
        int d = ERROR_GAIN * abs(a[k] - b[k]);
        error[k] = (uint8_t)(d > 255 ? 255 : d);
      }
      int step = c->w + GAP_PX;
      lab_sheet_pixel(sh, x, y0 + y, a);
      lab_sheet_pixel(sh, x + step, y0 + y, b);
      lab_sheet_pixel(sh, x + 2 * step, y0 + y, error);
      grey = c->depth_true ? depth_grey(c->depth_true[i], range) : LAB_SHEET_PAPER;
      lab_sheet_pixel(sh, x + 3 * step, y0 + y, (uint8_t[]){grey, grey, grey});
      grey = depth_grey(c->depth[i], range);
      lab_sheet_pixel(sh, x + 4 * step, y0 + y, (uint8_t[]){grey, grey, grey});
    }
}

// --- one scene -----------------------------------------------------------------------------------

static const tables_run *run_of(const tables *t, int i_scene, int device) {
  const tables_table *b = &t->tables[TABLE_SUMMARY];
  for (int i = 0; i < b->n; i++)
    for (int k = 0; k < b->rows[i].n_runs; k++) {
      const tables_run *r = &t->runs[b->rows[i].runs[k]];
      if (r->has_views && r->is_done && r->set.i_scene == i_scene && r->set.device == device) return r;
    }
  return NULL;
}

static sv_status load_row(const tables *t, const tables_run *r, cells *c, sv_err *err) {
  const tables_scene *sc = &t->scenes[r->set.i_scene];
  char folder[SV_CAP_PATH], name[TABLES_CAP_KEY + 16];
  lab_views v;
  sv_pool serial = sv_pool_serial();
  lab_source src = {.folder = sc->folder,
                    .transforms = tables_file_of(t, &r->set)->transforms,
                    .split = tables_split_names[TABLES_NEAR],
                    .n_exposures = 1,
                    .scale = 1};
  sv_status s = lab_views_open(&v, &src, &serial, err);
  if (s != SV_OK) return s;
  int i_view = v.n / 3; // neither the nearest nor the farthest
  s = read_truth(c, &v.frames[i_view], v.scale, sc->has_depth, err);
  lab_views_free(&v);
  snprintf(name, sizeof name, "runs/%s/views", r->key);
  if (s == SV_OK) s = sv_path_join(folder, sizeof folder, t->o->out, name, err);
  return s == SV_OK ? read_render(c, folder, i_view, err) : s;
}

static void label_columns(lab_sheet *sh, const cells *c) {
  static const char *const columns[N_COLUMNS] = {"truth", "render", "error x4", "true depth", "depth"};
  for (int k = 0; k < N_COLUMNS; k++) lab_sheet_text(sh, k * (c->w + GAP_PX), 2, 1, columns[k], ink);
}

// Above the images of a row: the device, and its scores over all near views.
static void label_row(lab_sheet *sh, const tables_run *r, int y0) {
  char text[120];
  const double *of = r->result.score[TABLES_NEAR].of;
  int n =
      snprintf(text, sizeof text, "%s: PSNR %.2f dB", tables_device_words[r->set.device], of[TABLES_PSNR]);
  if (!isnan(of[TABLES_ABS_REL]))
    snprintf(text + n, sizeof text - (size_t)n, ", depth AbsRel %.4f", of[TABLES_ABS_REL]);
  lab_sheet_text(sh, 0, y0 + 2, 1, text, ink);
}

static sv_status write_sheet(const tables *t, int i_scene, sv_err *err) {
  char path[SV_CAP_PATH], file[TABLES_CAP_NAME + 16];
  lab_sheet sh = {.px = NULL};
  sv_status s = SV_OK;
  int n_rows = 0, i_row = 0;
  for (int d = 0; d < TABLES_N_DEVICES; d++) n_rows += run_of(t, i_scene, d) != NULL;
  for (int d = 0; d < TABLES_N_DEVICES && s == SV_OK; d++) {
    const tables_run *r = run_of(t, i_scene, d);
    cells c = {.truth = NULL};
    if (!r) continue;
    s = load_row(t, r, &c, err);
    const int step = BAND_PX + c.h + GAP_PX;
    if (s == SV_OK && !sh.px) {
      s = lab_sheet_start(&sh, N_COLUMNS * (c.w + GAP_PX) - GAP_PX, BAND_PX + n_rows * step - GAP_PX, err);
      if (s == SV_OK) label_columns(&sh, &c);
    }
    if (s == SV_OK) label_row(&sh, r, BAND_PX + i_row * step);
    if (s == SV_OK) draw_row(&sh, &c, 2 * BAND_PX + i_row++ * step);
    cells_free(&c);
  }
  snprintf(file, sizeof file, "sheet_%s.png", t->scenes[i_scene].name);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, t->o->out, file, err);
  if (s == SV_OK && sh.px) s = lab_sheet_write(&sh, path, err);
  lab_sheet_free(&sh);
  return s;
}

sv_status tables_write_sheets(tables *t, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < t->n_scenes && s == SV_OK; i++) s = write_sheet(t, i, err);
  return s;
}
