// SPDX-License-Identifier: Apache-2.0
// A sheet of held-out views: the truth, and beside it what each of several models shows, with PSNR
// in the pictures.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/train/evaluate.h"
#include "tools/lab/model_formats.h"
#include "tools/pictures/sheet.h"

#define N_VIEWS    3 // rows, unless --views says another number
#define GAP_PX     4
#define CAP_LABEL  120
#define FONT_WIDTH 160 // of an image, pixels for each pixel of a font unit: then 26 characters fit

static const uint8_t ink[3] = {20, 20, 20}, white[3] = {255, 255, 255}, black[3] = {0, 0, 0};

// A column of the sheet.
typedef struct {
  char label[CAP_LABEL];
  double *psnr; // [n_rows]
  double mean;  // over all views of the split
} column;

typedef struct {
  const lab_options *o;
  lab_session session;
  lab_model model; // of the column that is drawn
  lab_views views;
  const char *split;
  column *columns; // [n_models]
  int n_models, n_rows, i_model;
  int scale, head_px; // of text
  lab_sheet sheet;
} run;

// --- drawing -------------------------------------------------------------------------------------

static int cell_x(const run *r, int i_column) { return i_column * (r->views.cap_width_px + GAP_PX); }
static int cell_y(const run *r, int i_row) { return r->head_px + i_row * (r->views.cap_height_px + GAP_PX); }

// The largest scale up to the sheet's at which text fits a column.
static int fitting(const run *r, const char *text) {
  int k = r->scale;
  while (k > 1 && lab_sheet_text_width(text, k) > r->views.cap_width_px - 2 * k) k--;
  return k;
}

static void draw_head(run *r, int i_column, const char *label, const char *figure) {
  int k = fitting(r, label), line = LAB_SHEET_TEXT_PX * r->scale, x = cell_x(r, i_column) + r->scale;
  lab_sheet_text(&r->sheet, x, r->scale, k, label, ink);
  k = fitting(r, figure);
  lab_sheet_text(&r->sheet, x, r->scale + line, k, figure, ink);
}

// Text in the lower left corner of an image, on black.
static void draw_note(run *r, int i_column, int i_row, int picture_h, const char *text) {
  int k = fitting(r, text), w = lab_sheet_text_width(text, k) + 3 * k, h = (LAB_SHEET_TEXT_PX + 1) * k;
  int x = cell_x(r, i_column), y = cell_y(r, i_row) + picture_h - h;
  if (!w) return;
  lab_sheet_box(&r->sheet, x, y, w, h, black);
  lab_sheet_text(&r->sheet, x + 2 * k, y + 2 * k, k, text, white);
}

static void draw_picture(run *r, int i_column, int i_row, const float *planes, int w, int h) {
  size_t n = (size_t)w * (size_t)h;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      size_t i = (size_t)y * (size_t)w + (size_t)x;
      uint8_t rgb[3] = {lab_to_byte(planes[i]), lab_to_byte(planes[n + i]), lab_to_byte(planes[2 * n + i])};
      lab_sheet_pixel(&r->sheet, cell_x(r, i_column) + x, cell_y(r, i_row) + y, rgb);
    }
}

static void draw_view(void *of, const lab_scored_view *v) {
  run *r = of;
  char text[CAP_LABEL];
  int i_row = lab_panel_of(v->i_view, r->views.n, r->n_rows);
  const sv_view *view = &r->views.frames[v->i_view].view;
  if (i_row < 0) return;
  if (r->i_model == 0) {
    char name[SV_CAP_PATH];
    lab_view_name(&r->views, v->i_view, name, sizeof name);
    draw_picture(r, 0, i_row, v->truth, view->width_px, view->height_px);
    snprintf(text, sizeof text, "%.100s", name);
    draw_note(r, 0, i_row, view->height_px, text);
  }
  r->columns[r->i_model].psnr[i_row] = v->psnr;
  draw_picture(r, 1 + r->i_model, i_row, v->image, view->width_px, view->height_px);
  snprintf(text, sizeof text, "%.2f dB", v->psnr);
  draw_note(r, 1 + r->i_model, i_row, view->height_px, text);
}

static sv_status start_sheet(run *r, sv_err *err) {
  long w = r->views.cap_width_px, h = r->views.cap_height_px;
  r->scale = w > FONT_WIDTH ? (int)(w / FONT_WIDTH) : 1;
  r->head_px = lab_sheet_has_text() ? (2 * LAB_SHEET_TEXT_PX + 1) * r->scale : 0;
  return lab_sheet_start(&r->sheet, (1 + r->n_models) * (w + GAP_PX) - GAP_PX,
                         r->head_px + r->n_rows * (h + GAP_PX) - GAP_PX, err);
}

// --- models --------------------------------------------------------------------------------------

// Entry i of --labels. Without labels the model's file name, or its folder's for a model.ply.
static void choose_label(const run *r, int i, char *out) {
  const char *list = r->o->labels, *path = r->o->models.of[i];
  for (int k = 0; list && k < i; k++) list = strchr(list, ',') ? strchr(list, ',') + 1 : NULL;
  if (list) {
    snprintf(out, CAP_LABEL, "%.*s", (int)strcspn(list, ","), list);
    return;
  }
  char folder[SV_CAP_PATH];
  sv_path_folder(folder, sizeof folder, path);
  bool is_plain = sv_str_eq(sv_path_name(path), "model.ply") && *sv_path_name(folder);
  snprintf(out, CAP_LABEL, "%.100s", sv_path_name(is_plain ? folder : path));
}

// The views are those of the first model.
static sv_status open_views(run *r, const lab_settings *st, sv_err *err) {
  r->split = r->o->split ? r->o->split : lab_default_split(st->n_exposures);
  lab_source src = {.folder = r->o->data,
                    .transforms = st->transforms,
                    .told_by = st->told_by,
                    .refined = st->refined,
                    .split = r->split,
                    .n_exposures = sv_str_eq(r->split, "test_near") ? st->n_exposures : 0,
                    .scale = st->scale};
  sv_status s = lab_views_open(&r->views, &src, &r->session.pool, err);
  if (s != SV_OK) return s;
  long wanted = r->o->n_views > 0 ? r->o->n_views : N_VIEWS;
  r->n_rows = wanted < r->views.n ? (int)wanted : r->views.n;
  for (int i = 0; i < r->n_models; i++)
    if (!(r->columns[i].psnr = calloc((size_t)r->n_rows, sizeof(double))))
      return sv_fail(err, SV_E_NOMEM, "no memory for the scores of %d views", r->n_rows);
  return start_sheet(r, err);
}

static sv_status add_model(run *r, int i, sv_err *err) {
  char text[CAP_LABEL];
  lab_options one = *r->o;
  lab_settings st;
  lab_scores scores;
  column *c = &r->columns[i];
  r->i_model = i;
  one.model = r->o->models.of[i];
  sv_status s = lab_model_read(&r->model, one.model, err);
  if (s == SV_OK) s = lab_settings_for(&st, &one, &r->model, err);
  if (s == SV_OK && i == 0) s = open_views(r, &st, err);
  if (s != SV_OK) return s;
  lab_turn_back(&r->model, &r->session, one.model, NULL, &r->views);
  lab_eval_job job = {.session = &r->session,
                      .g = &r->model.g,
                      .motion = lab_model_motion(&r->model),
                      .on_view = draw_view,
                      .of = r,
                      .render = lab_render_options(&st, r->model.g.sh_degree, false)};
  s = lab_evaluate(&r->views, &job, &scores, err);
  lab_model_free(&r->model);
  if (s != SV_OK) return s;
  c->mean = scores.psnr;
  choose_label(r, i, c->label);
  snprintf(text, sizeof text, "mean of %d views: %.2f dB", r->views.n, c->mean);
  draw_head(r, 1 + i, c->label, text);
  return SV_OK;
}

static sv_status compare(run *r, sv_err *err) {
  char text[CAP_LABEL];
  sv_status s = SV_OK;
  r->n_models = r->o->models.n;
  r->columns = calloc((size_t)r->n_models, sizeof *r->columns);
  if (!r->columns) return sv_fail(err, SV_E_NOMEM, "no memory for %d models", r->n_models);
  for (int i = 0; i < r->n_models && s == SV_OK; i++) s = add_model(r, i, err);
  if (s != SV_OK) return s;
  snprintf(text, sizeof text, "split %.80s", r->split);
  draw_head(r, 0, "truth", text);
  return lab_sheet_write(&r->sheet, r->o->out, err);
}

// A line a view of the sheet, a column a model.
static void print(const run *r) {
  char name[SV_CAP_PATH];
  printf("PSNR, dB          ");
  for (int i = 0; i < r->n_models; i++) printf("  %16s", r->columns[i].label);
  for (int v = 0; v < r->views.n; v++) {
    int i_row = lab_panel_of(v, r->views.n, r->n_rows);
    if (i_row < 0) continue;
    lab_view_name(&r->views, v, name, sizeof name);
    printf("\n%-18s", name);
    for (int i = 0; i < r->n_models; i++) printf("  %16.2f", r->columns[i].psnr[i_row]);
  }
  snprintf(name, sizeof name, "mean of %d views", r->views.n);
  printf("\n%-18s", name);
  for (int i = 0; i < r->n_models; i++) printf("  %16.2f", r->columns[i].mean);
  printf("\n");
}

int lab_cmd_compare(const lab_options *o) {
  sv_err err = {0};
  run r = {.o = o};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&r.session, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = compare(&r, &err);
  sv_linux_console_finish(&r.session.lines);
  if (s == SV_OK) print(&r);
  if (s == SV_OK) lab_say(&r.session, "sheet of %d views: %s", r.n_rows, o->out);
  if (s == SV_OK && !lab_sheet_has_text())
    lab_say(&r.session, "built without stb_easy_font.h (Debian: libstb-dev): no text in the sheet");
  if (s != SV_OK) code = lab_failed(&r.session, &err);
  lab_session_stop(&r.session);
  for (int i = 0; r.columns && i < r.n_models; i++) free(r.columns[i].psnr);
  free(r.columns);
  lab_sheet_free(&r.sheet);
  lab_views_free(&r.views);
  lab_model_free(&r.model);
  return code;
}
