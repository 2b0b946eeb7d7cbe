// SPDX-License-Identifier: Apache-2.0
// OUT/plots: a gnuplot script with its data inside for each plot; gnuplot, when it is there, draws
// SVG and PNG.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/common/gnuplot.h"
#include "tools/tables/plot.h"

typedef struct {
  const char *name, *title, *x_label;
  tables_id table;
  int figure;
  bool is_log_x;
} curve_plot;

static const curve_plot curves[] = {
    {"angle_psnr", "PSNR over the angular baseline; 1 exposure: near views, 3: all around",
     "angle between the outermost views (degrees)", TABLE_ANGLE, TABLES_PSNR, true},
    {"angle_abs_rel", "Depth error over the angular baseline; 1 exposure: near views, 3: all around",
     "angle between the outermost views (degrees)", TABLE_ANGLE, TABLES_ABS_REL, true},
    {"exposures_psnr", "PSNR over the number of exposures", "exposures", TABLE_EXPOSURES, TABLES_PSNR, false},
    {"exposures_lpips", "LPIPS over the number of exposures", "exposures", TABLE_EXPOSURES, TABLES_LPIPS,
     false},
    {"exposures_abs_rel", "Depth error over the number of exposures", "exposures", TABLE_EXPOSURES,
     TABLES_ABS_REL, false}};
const int tables_device_colours[TABLES_N_DEVICES] = {0x555555, 0x0072b2, 0x009e73,
                                                     0xe69f00, 0xd55e00, 0xcc79a7};
static const struct {
  int figure;
  const char *name;
} bars[] = {{TABLES_PSNR, "summary_psnr"}, {TABLES_ABS_REL, "summary_abs_rel"}};

static const char *axis_word(int figure) {
  return figure == TABLES_PSNR ? "PSNR (dB)" : tables_figure_words[figure];
}

FILE *tables_script_open(const tables *t, const char *name, sv_err *err) {
  char path[SV_CAP_PATH], file[80];
  snprintf(file, sizeof file, "plots/%s.gp", name);
  if (sv_path_join(path, sizeof path, t->o->out, file, err) != SV_OK) return NULL;
  FILE *f = sv_stream_open(path, err);
  if (!f) return NULL;
  fprintf(f, "# Draws %s.svg and %s.png. Written by subview-lab tables.\n", name, name);
  return f;
}

// The plot command, once for each picture.
sv_status tables_script_close(FILE *f, const char *name, const char *plot, sv_err *err) {
  fprintf(f, "set terminal svg size 800,500 background 'white'\nset output '%s.svg'\n%s\n", name, plot);
  fprintf(f, "set terminal pngcairo size 800,500\nset output '%s.png'\n%s\nset output\n", name, plot);
  return sv_stream_save(f, err);
}

// --- curves --------------------------------------------------------------------------------------

// The scatter over the scenes of a row.
static double deviation(const tables *t, const tables_row *r, int figure) {
  double sum = 0, squares = 0;
  for (int i = 0; i < r->n_runs; i++) {
    const double v = t->runs[r->runs[i]].result.score[r->split].of[figure];
    sum += v / r->n_runs;
    squares += v * v / r->n_runs;
  }
  return sqrt(fmax(0, squares - sum * sum));
}

// Points of one device as a data block; returns how many. A curve of the exposures has all of them,
// one of the angles those of one number of exposures.
static int put_points(FILE *f, const tables *t, const curve_plot *c, int device, int n_exposures) {
  const tables_table *b = &t->tables[c->table];
  int n = 0;
  for (int i = 0; i < b->n; i++) {
    const tables_row *r = &b->rows[i];
    if (r->device != device || (n_exposures && r->n_exposures != n_exposures)) continue;
    double v = tables_row_mean(t, r).figures.of[c->figure];
    if (isnan(v)) continue;
    if (n == 0) fprintf(f, "$%s_%d << EOD\n", tables_device_names[device], n_exposures);
    fprintf(f, "%.6g %.7g %.3g\n", r->x, v, deviation(t, r, c->figure));
    n++;
  }
  if (n) fprintf(f, "EOD\n");
  return n;
}

static void add_curve(sv_str *plot, const tables *t, const curve_plot *c, int device, int n_exposures) {
  char title[80];
  if (c->table == TABLE_ANGLE)
    snprintf(title, sizeof title, "%s, %d exposure%s", tables_device_words[device], n_exposures,
             n_exposures == 1 ? "" : "s");
  else sv_copy(title, sizeof title, tables_device_words[device]);
  sv_str_add(plot, "%s", plot->len ? ", " : "plot ");
  if (c->table == TABLE_ANGLE && device == TABLES_MONO) // one point: the same for every angle
    sv_str_add(plot, "real(word($mono_%d[1], 2)) with lines", n_exposures);
  else
    sv_str_add(plot, "$%s_%d with %s pt 7 ps 0.6", tables_device_names[device], n_exposures,
               t->n_scenes > 1 ? "yerrorlines" : "linespoints");
  sv_str_add(plot, " lw 2 dt %d lc rgb '#%06x' title '%s'", n_exposures == 1 ? 2 : 1,
             tables_device_colours[device], title);
}

// A logarithmic axis from the smallest to the largest x, where the curve asks for one.
static void put_x_axis(FILE *f, const tables *t, const curve_plot *c) {
  const tables_table *b = &t->tables[c->table];
  double least = INFINITY, most = 0;
  for (int i = 0; i < b->n; i++) {
    most = fmax(most, b->rows[i].x);
    if (b->rows[i].x > 0) least = fmin(least, b->rows[i].x); // one camera has no angle
  }
  if (!c->is_log_x && most <= 12) fprintf(f, "set xtics 1\n");
  else
    fprintf(f,
            "set logscale x\nset xrange [%g:%g]\n"
            "set xtics (0.1, 0.2, 0.5, 1, 2, 3, 5, 10, 20, 50, 100)\n",
            least / 1.1, most * 1.1);
}

static sv_status write_curve(const tables *t, const curve_plot *c, bool *is_written, sv_err *err) {
  char text[2000];
  sv_str plot = sv_str_make(text, sizeof text);
  bool is_angle = c->table == TABLE_ANGLE;
  FILE *f = tables_script_open(t, c->name, err);
  if (!f) return SV_E_IO;
  fprintf(f, "set title \"%s%s\"\nset xlabel '%s'\nset ylabel '%s'\n", c->title,
          t->n_scenes > 1 ? "; bars: standard deviation over the scenes" : "", c->x_label,
          axis_word(c->figure));
  // the legend has room of its own above the curves
  fprintf(f, "set grid\nset key inside top left maxrows %d opaque\nset offsets 0, 0, graph %s, graph 0.05\n",
          is_angle ? TABLES_RIG : 3, is_angle ? "0.5" : "0.35");
  put_x_axis(f, t, c);
  int n_most = 0;
  for (int e = is_angle ? 1 : 0; e <= (is_angle ? 3 : 0); e += 2)
    for (int d = 0; d < TABLES_N_DEVICES; d++) {
      int n = put_points(f, t, c, d, e);
      if (n) add_curve(&plot, t, c, d, e);
      if (n > n_most) n_most = n;
    }
  *is_written = n_most > 0 && !plot.is_cut && !(is_angle && n_most < 2);
  return tables_script_close(f, c->name, *is_written ? text : "# nothing to draw", err);
}

// --- bars: ours and the paper's ------------------------------------------------------------------

// Where the bars begin: PSNR has no natural 0, and differences between devices are small beside it.
static const char *bottom_of(const tables *t, int figure, char out[16]) {
  const tables_table *b = &t->tables[TABLE_SUMMARY];
  double least = INFINITY;
  for (int i = 0; i < b->n; i++) {
    least = fmin(least, tables_row_mean(t, &b->rows[i]).figures.of[figure]);
    least = fmin(least, tables_paper(b->rows[i].n_exposures, b->rows[i].device).of[figure]);
  }
  snprintf(out, 16, "%.0f", figure == TABLES_PSNR && least < 100 ? fmax(0, floor(least) - 2) : 0);
  return out;
}

static sv_status write_bars(const tables *t, int figure, const char *name, bool *is_written, sv_err *err) {
  const tables_table *b = &t->tables[TABLE_SUMMARY];
  char bottom[16];
  FILE *f = tables_script_open(t, name, err);
  if (!f) return SV_E_IO;
  fprintf(f,
          "set title \"%s, ours beside the paper's (other scenes)\"\nset ylabel '%s'\nset grid y\n"
          "set style data histograms\nset style histogram clustered gap 1\nset style fill solid 0.8\n"
          "set yrange [%s:*]\nset key inside top left\nset offsets 0, 0, graph 0.15, 0\n"
          "set xtics rotate by -30\nset datafile missing '?'\n$bars << EOD\n",
          tables_figure_words[figure], axis_word(figure), bottom_of(t, figure, bottom));
  *is_written = false;
  for (int i = 0; i < b->n; i++) {
    double ours = tables_row_mean(t, &b->rows[i]).figures.of[figure],
           paper = tables_paper(b->rows[i].n_exposures, b->rows[i].device).of[figure];
    if (isnan(ours) || isnan(paper)) continue;
    fprintf(f, "\"%s, %d\" %.7g %.7g\n", tables_device_words[b->rows[i].device], b->rows[i].n_exposures, ours,
            paper);
    *is_written = true;
  }
  fprintf(f, "EOD\n");
  return tables_script_close(f, name,
                             *is_written ? "plot $bars using 2:xtic(1) lc rgb '#0072b2' title 'ours', "
                                           "$bars using 3 lc rgb '#bbbbbb' title 'paper'"
                                         : "# nothing to draw",
                             err);
}

// --- gnuplot -------------------------------------------------------------------------------------

sv_status tables_drawing_begin(const tables *t, tables_drawing *d, sv_err *err) {
  *d = (tables_drawing){.n_drawn = 0};
  sv_status s = sv_path_join(d->folder, sizeof d->folder, t->o->out, "plots", err);
  return s == SV_OK ? sv_path_make_folder(d->folder, err) : s;
}

void tables_draw(tables *t, tables_drawing *d, const char *name) {
  char script[80];
  if (d->is_missing) return;
  snprintf(script, sizeof script, "%s.gp", name);
  int code = sv_gnuplot(d->folder, script, d->n_tried++ == 0);
  if (code == 0) d->n_drawn++;
  else if (code == 127) {
    d->is_missing = true;
    lab_say(&t->session, "gnuplot not found: wrote only the plot scripts in %s", d->folder);
  } else if (!d->is_failed) {
    d->is_failed = true;
    lab_say(&t->session, "gnuplot failed on %s/%s; see gnuplot.log there", d->folder, script);
  }
}

sv_status tables_write_plots(tables *t, bool *has_pictures, sv_err *err) {
  tables_drawing d;
  bool is_written;
  *has_pictures = false;
  sv_status s = tables_drawing_begin(t, &d, err);
  for (size_t i = 0; i < sizeof curves / sizeof *curves && s == SV_OK; i++)
    if ((s = write_curve(t, &curves[i], &is_written, err)) == SV_OK && is_written)
      tables_draw(t, &d, curves[i].name);
  for (size_t i = 0; i < sizeof bars / sizeof *bars && s == SV_OK; i++)
    if ((s = write_bars(t, bars[i].figure, bars[i].name, &is_written, err)) == SV_OK && is_written)
      tables_draw(t, &d, bars[i].name);
  *has_pictures = d.n_drawn > 0;
  return s;
}

void tables_put_plots(FILE *f, const tables *t, bool has_plots) {
  char path[SV_CAP_PATH];
  sv_names names;
  fprintf(f, "\n## Plots\n\n");
  if (!has_plots) {
    fprintf(f, "gnuplot was not found; run `gnuplot *.gp` in `plots/` to draw them.\n");
    return;
  }
  if (sv_path_join(path, sizeof path, t->o->out, "plots", NULL) != SV_OK ||
      sv_folder_list(path, &names, NULL) != SV_OK)
    return;
  for (int i = 0; i < names.n; i++)
    if (sv_str_eq(sv_path_extension(names.names[i]), ".png"))
      fprintf(f, "![%s](plots/%s)\n", names.names[i], names.names[i]);
  sv_names_free(&names);
}
