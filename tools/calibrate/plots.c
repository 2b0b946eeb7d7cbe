// SPDX-License-Identifier: Apache-2.0
// One image per camera with four panels: where corners were seen, residuals as magnified vectors,
// residuals about zero, and the projection's uncertainty over the picture.
#include <math.h>
#include <stdlib.h>

#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/gnuplot.h"

typedef struct {
  sv_file file;
  sv_status s;
  sv_err *err;
} writer;

static void begin(writer *w, const char *folder, const char *name, sv_err *err) {
  char path[SV_CAP_PATH];
  *w = (writer){.err = err};
  w->s = sv_path_join(path, sizeof path, folder, name, err);
  sv_file_init(&w->file);
  if (w->s == SV_OK) w->s = sv_file_begin(&w->file, path, err);
}

static void put(writer *w, const char *fmt, ...) SV_PRINTF(2, 3);
static void put(writer *w, const char *fmt, ...) {
  char text[2048];
  va_list ap;
  if (w->s != SV_OK) return;
  va_start(ap, fmt);
  size_t n = sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  w->s = sv_file_append(&w->file, text, n < sizeof text ? n : sizeof text - 1, w->err);
}

static sv_status end(writer *w) {
  if (w->s == SV_OK) return sv_file_commit(&w->file, w->err);
  sv_file_abandon(&w->file);
  return w->s;
}

static sv_status write_residuals(const char *folder, const cal_boards *b, const sv_boards_result *r,
                                 sv_err *err) {
  writer w;
  begin(&w, folder, "residuals.csv", err);
  put(&w, "camera,frame,column,row,u_px,v_px,du_px,dv_px,is_outlier\n");
  size_t n = (size_t)r->n_corners;
  for (int c = 0; c < b->n_cameras; c++)
    for (int f = 0; f < b->n_frames; f++) {
      size_t at = (size_t)c * (size_t)b->n_frames + (size_t)f;
      for (size_t k = 0; k < n && b->is_seen[at]; k++) {
        const double *uv = b->uv_px + 2 * (at * n + k), *d = r->residual_px + 2 * (at * n + k);
        put(&w, "%s,%s,%d,%d,%.3f,%.3f,%.4f,%.4f,%d\n", b->cameras[c].name, b->frames[f], (int)k % b->n_cols,
            (int)k / b->n_cols, uv[0], uv[1], d[0], d[1], r->is_outlier[at * n + k]);
      }
    }
  return end(&w);
}

static void put_corners(writer *w, const cal_boards *b, const sv_boards_result *r, int c, bool is_outlier) {
  size_t n = (size_t)r->n_corners;
  put(w, "%s << EOD\n", is_outlier ? "$out" : "$in");
  if (is_outlier) put(w, "-100 -100 0 0\n"); // gnuplot does not take an empty block
  for (int f = 0; f < b->n_frames; f++) {
    size_t at = (size_t)c * (size_t)b->n_frames + (size_t)f;
    for (size_t k = 0; k < n && b->is_seen[at]; k++) {
      const double *uv = b->uv_px + 2 * (at * n + k), *d = r->residual_px + 2 * (at * n + k);
      if (is_outlier == (r->is_outlier[at * n + k] != 0))
        put(w, "%.2f %.2f %.4f %.4f\n", uv[0], uv[1], d[0], d[1]);
    }
  }
  put(w, "EOD\n");
}

static void put_uncertainty(writer *w, const sv_boards_result *r, int c) {
  const sv_camera_model *m = &r->models[c];
  put(w, "$sd << EOD\n");
  for (int j = 0; j < SV_BOARDS_GRID_Y; j++)
    for (int i = 0; i < SV_BOARDS_GRID_X; i++) {
      double v = r->cameras[c].uncertainty_px[j][i];
      put(w, "%.2f %.2f %.5f\n", m->width_px * (i + 0.5) / SV_BOARDS_GRID_X,
          m->height_px * (j + 0.5) / SV_BOARDS_GRID_Y, isfinite(v) ? v : -1.0);
    }
  put(w, "EOD\n");
}

static sv_status write_script(const char *folder, const char *file, const cal_boards *b,
                              const sv_boards_result *r, int c, sv_err *err) {
  writer w;
  const sv_camera_model *m = &r->models[c];
  const sv_boards_camera *q = &r->cameras[c];
  const char *name = b->cameras[c].name;
  // a mean residual is 3 % of the width
  double zoom = q->rms_px > 0 ? 0.03 * m->width_px / q->rms_px : 1;
  begin(&w, folder, file, err);
  put_corners(&w, b, r, c, false);
  put_corners(&w, b, r, c, true);
  put_uncertainty(&w, r, c);
  put(&w,
      "set terminal svg size 1100,850 background 'white'\nset output '%s.svg'\n"
      "set multiplot layout 2,2 title '%s: %.3f px RMS, %d boards, %d corners rejected' "
      "noenhanced\n"
      "set size ratio %g\nset xrange [0:%d]\nset yrange [%d:0]\nset key off\n",
      name, name, q->rms_px, q->n_boards, q->n_outliers, (double)m->height_px / m->width_px, m->width_px,
      m->height_px);
  put(&w, "set title 'corners (red: rejected)'\nplot $in using 1:2 with points pointtype 7 pointsize 0.25 "
          "linecolor rgb "
          "'#1f5fa8', "
          "$out using 1:2 with points pointtype 2 linecolor rgb '#d02020'\n");
  put(&w,
      "set title 'residuals, enlarged %.0f times'\nplot $in using 1:2:($3*%g):($4*%g) with vectors nohead "
      "linecolor rgb '#1f5fa8', $out using 1:2:($3*%g):($4*%g) with vectors nohead linecolor rgb '#d02020'\n",
      zoom, zoom, zoom, zoom, zoom);
  put(&w, "set title 'uncertainty of the projection at infinity [px, 1 sigma]'\nset palette defined "
          "(0 '#ffffff', 1 '#f4a040', 2 '#a01030')\nset cbrange [0:*]\nplot $sd using 1:2:($3<0?NaN:$3) with "
          "image\n");
  put(&w,
      "set title 'residuals [px]'\nset size ratio 1\nset xrange [-%g:%g]\nset yrange [%g:-%g]\nset grid\n"
      "plot $in using 3:4 with points pointtype 7 pointsize 0.25 linecolor rgb '#1f5fa8'\nunset multiplot\n",
      4 * q->rms_px + 1e-6, 4 * q->rms_px + 1e-6, 4 * q->rms_px + 1e-6, 4 * q->rms_px + 1e-6);
  return end(&w);
}

sv_status cal_plots_write(const char *folder, const cal_boards *b, const sv_boards_result *r, lab_session *se,
                          sv_err *err) {
  char plots[SV_CAP_PATH], file[64];
  sv_status s = write_residuals(folder, b, r, err);
  if (s == SV_OK) s = sv_path_join(plots, sizeof plots, folder, "plots", err);
  if (s == SV_OK) s = sv_path_make_folder(plots, err);
  for (int c = 0, code = 0; c < b->n_cameras && s == SV_OK; c++) {
    sv_fmt(file, sizeof file, "%s.gp", b->cameras[c].name);
    s = write_script(plots, file, b, r, c, err);
    if (s == SV_OK && code != 127) {
      code = sv_gnuplot(plots, file, c == 0);
      if (code == 127) lab_say(se, "gnuplot not found: wrote only the plot scripts in %s", plots);
      else if (code) lab_say(se, "gnuplot failed on %s/%s; see gnuplot.log there", plots, file);
    }
  }
  return s;
}
