// SPDX-License-Identifier: Apache-2.0
// tables.md: the tables beside the paper's figures, where the order of the devices breaks, plots
// and sheets.
#include <math.h>
#include <stdio.h>

#include "src/base/str.h"
#include "tools/tables/plot.h"

typedef struct {
  const tables *t;
  FILE *f;
} page;

static void put_figure(const page *p, int figure, double v) {
  char text[40];
  tables_format(text, sizeof text, figure, v);
  fprintf(p->f, " %s |", text);
}

static const char *exposures_word(int n) { return n == 1 ? "exposure" : "exposures"; }

// --- head ----------------------------------------------------------------------------------------

static void put_measured(const page *p) {
  const tables *t = p->t;
  const tables_result *first = &t->runs[0].result;
  for (int i = 0; i < t->n_runs; i++)
    if (t->runs[i].is_done) first = &t->runs[i].result;
  double wall_s = 0;
  int n_other = 0;
  for (int i = 0; i < t->n_runs; i++) {
    wall_s += t->runs[i].result.wall_s;
    n_other += t->runs[i].is_other_build;
  }
  fprintf(p->f,
          "# The paper's tables, measured with subview\n\n"
          "Written by `subview-lab tables%s`: %d runs of %ld steps with %ld Gaussians unless a row says "
          "otherwise, %.0f minutes on %d threads (%s).\n\n",
          t->o->is_quick ? " --quick" : "", t->n_runs, t->n_steps, t->n_gaussians, wall_s / 60,
          first->threads, first->isa);
  fprintf(p->f, "| scene | near views | test views | pixels | true depth |\n|---|---|---|---|---|\n");
  for (int i = 0; i < t->n_scenes; i++) {
    const tables_scene *sc = &t->scenes[i];
    fprintf(p->f, "| %s | %d | %d | %dx%d | %s |\n", sc->name, sc->n_views[TABLES_NEAR],
            sc->n_views[TABLES_TEST], sc->width_px, sc->height_px, sc->has_depth ? "yes" : "no");
  }
  fprintf(
      p->f,
      "\n`s` is the time of the training alone, `block` the one memory block of the training and `RSS` the "
      "process's peak, both in MB and the largest of the row's runs; all other figures are means over the "
      "row's runs. LPIPS is that of SqueezeNet (v0.1). Depth: expected depth against the true one.\n");
  if (t->n_missing)
    fprintf(p->f, "\n**%d of the %d runs are missing.** Rows that need them have no figures.\n", t->n_missing,
            t->n_runs);
  if (n_other)
    fprintf(p->f,
            "\n**%d of the %d results come from another build of this program.** Remove `runs/` to measure "
            "them again.\n",
            n_other, t->n_runs);
}

static void put_differences(const page *p) {
  const tables *t = p->t;
  fprintf(
      p->f,
      "\n**What differs from the paper.** Its figures are means over the eight scenes of NeRF synthetic "
      "with 100,000 Gaussians, which densification may change, about 3,000 iterations, noise on the "
      "measurements, 200 test views (the six nearest for one exposure) and LPIPS by another network (VGG), "
      "which is not comparable with ours; it does not print its resolution. Ours: %d scene%s of our own, "
      "a fixed %ld Gaussians, %ld steps, noise %s, views as above, black behind the objects. Compare "
      "the differences between devices rather than the figures themselves.\n",
      t->n_scenes, t->n_scenes == 1 ? "" : "s", t->n_gaussians, t->n_steps,
      t->o->noise && *t->o->noise ? t->o->noise : "none");
  if (t->o->is_quick)
    fprintf(p->f, "\n**This is a quick run**: one scene, few steps and points of the curves. It shows that "
                  "everything works, and roughly the order; it is not a measurement to cite.\n");
}

// --- tables --------------------------------------------------------------------------------------

static void put_table(const page *p, int id) {
  static const char *const settings[N_TABLES] = {
      [TABLE_ANGLE] = "angle", [TABLE_INIT] = "start", [TABLE_TV] = "TV"};
  static const int paper_from[N_TABLES] = {[TABLE_SUMMARY] = TABLES_PSNR, [TABLE_DEPTH] = TABLES_ABS_REL};
  static const int paper_n[N_TABLES] = {[TABLE_SUMMARY] = 3, [TABLE_DEPTH] = 2};
  const tables_table *b = &p->t->tables[id];
  const char *setting = settings[id];
  fprintf(p->f, "\n## %s\n\n%s\n", b->title, b->text);
  if (b->n == 0) return;
  fprintf(p->f, "\n| exposures | device |%s%s%s", setting ? " " : "", setting ? setting : "",
          setting ? " |" : "");
  for (int k = 0; k < TABLES_N_FIGURES; k++) fprintf(p->f, " %s |", tables_figure_words[k]);
  fprintf(p->f, " steps | Gaussians | s | block | RSS |");
  for (int k = 0; k < paper_n[id]; k++)
    fprintf(p->f, " paper's %s |", tables_figure_words[paper_from[id] + k]);
  fprintf(p->f, "\n|---|---|%s", setting ? "---|" : "");
  for (int k = 0; k < TABLES_N_FIGURES + 5 + paper_n[id]; k++) fprintf(p->f, "--:|");
  fprintf(p->f, "\n");
  for (int i = 0; i < b->n; i++) {
    const tables_row *r = &b->rows[i];
    tables_mean m = tables_row_mean(p->t, r);
    tables_figures paper = tables_paper(r->n_exposures, r->device);
    fprintf(p->f, "| %d | %s |", r->n_exposures,
            r->device < 0 ? "all devices" : tables_device_words[r->device]);
    if (setting) fprintf(p->f, " %s |", r->label);
    for (int k = 0; k < TABLES_N_FIGURES; k++) put_figure(p, k, m.figures.of[k]);
    fprintf(p->f, " %ld | %ld | %.1f | %.1f | %.1f |", m.steps, m.gaussians, m.seconds, m.arena_bytes * 1e-6,
            m.peak_rss_bytes * 1e-6);
    for (int k = 0; k < paper_n[id]; k++) put_figure(p, paper_from[id] + k, paper.of[paper_from[id] + k]);
    fprintf(p->f, "\n");
  }
}

static void put_scene_table(const page *p, int figure) {
  const tables *t = p->t;
  const tables_table *b = &t->tables[TABLE_SUMMARY];
  fprintf(p->f, "\n### %s\n\n| exposures | device |", tables_figure_words[figure]);
  for (int s = 0; s < t->n_scenes; s++) fprintf(p->f, " %s |", t->scenes[s].name);
  fprintf(p->f, " mean | paper's mean | paper's range |\n|---|---|");
  for (int s = 0; s < t->n_scenes + 3; s++) fprintf(p->f, "--:|");
  fprintf(p->f, "\n");
  for (int i = 0; i < b->n; i++) {
    const tables_row *r = &b->rows[i];
    double range[2];
    fprintf(p->f, "| %d | %s |", r->n_exposures, tables_device_words[r->device]);
    for (int s = 0; s < t->n_scenes; s++)
      put_figure(p, figure, tables_summary_figure(t, s, r->device, r->n_exposures, figure));
    put_figure(p, figure, tables_row_mean(t, r).figures.of[figure]);
    put_figure(p, figure, tables_paper(r->n_exposures, r->device).of[figure]);
    tables_paper_range(figure, r->n_exposures, r->device, range);
    if (isnan(range[0])) fprintf(p->f, " - |\n");
    else {
      char lo[40], hi[40];
      tables_format(lo, sizeof lo, figure, range[0]);
      tables_format(hi, sizeof hi, figure, range[1]);
      fprintf(p->f, " %s to %s |\n", lo, hi);
    }
  }
}

static void put_scenes(const page *p) {
  fprintf(p->f, "\n## Each scene\n\nThe runs of the first table. The paper's scenes are others (its table "
                "static-synthetic-per-scene): its mean and the range over its eight scenes are shown.\n");
  for (int figure = TABLES_PSNR; figure <= TABLES_ABS_REL; figure++) put_scene_table(p, figure);
}

// --- order of the devices ------------------------------------------------------------------------

// What should beat what.
static const struct {
  int better, worse;
} order[] = {{TABLES_PHONE, TABLES_MONO},
             {TABLES_STEREO, TABLES_MONO},
             {TABLES_LIGHTFIELD, TABLES_PHONE},
             {TABLES_LIGHTFIELD, TABLES_STEREO},
             {TABLES_MULTIPLEXED, TABLES_LIGHTFIELD}};
#define N_ORDER ((int)(sizeof order / sizeof *order))

// Looks at one pair; returns 1 when it was there to be compared, and counts and prints a break.
static int put_break(const page *p, int i_scene, int n_exposures, int figure, int i_order, int *n_breaks) {
  const tables *t = p->t;
  int better = order[i_order].better, worse = order[i_order].worse;
  double a = tables_summary_figure(t, i_scene, better, n_exposures, figure),
         b = tables_summary_figure(t, i_scene, worse, n_exposures, figure);
  char x[40], y[40];
  if (isnan(a) || isnan(b)) return 0;
  if (figure == TABLES_PSNR ? a > b : a < b) return 1;
  tables_format(x, sizeof x, figure, a);
  tables_format(y, sizeof y, figure, b);
  fprintf(p->f, "- **%s**, %d %s: %s (%s) does not beat %s (%s) in %s\n", t->scenes[i_scene].name,
          n_exposures, exposures_word(n_exposures), tables_device_words[better], x,
          tables_device_words[worse], y, tables_figure_words[figure]);
  ++*n_breaks;
  return 1;
}

static void put_gains(const page *p) {
  const tables_table *b = &p->t->tables[TABLE_SUMMARY];
  fprintf(p->f, "\n| exposures | device | PSNR over monocular | paper's | AbsRel to monocular's | paper's |\n"
                "|---|---|--:|--:|--:|--:|\n");
  for (int i = 0; i < b->n; i++) {
    const tables_row *r = &b->rows[i], *mono = NULL;
    for (int k = 0; k < b->n; k++)
      if (b->rows[k].device == TABLES_MONO && b->rows[k].n_exposures == r->n_exposures) mono = &b->rows[k];
    if (!mono || r == mono) continue;
    tables_figures a = tables_row_mean(p->t, r).figures, m = tables_row_mean(p->t, mono).figures,
                   x = tables_paper(r->n_exposures, r->device), y = tables_paper(r->n_exposures, TABLES_MONO);
    const double gain = a.of[TABLES_PSNR] - m.of[TABLES_PSNR];
    char ours_db[40] = "-";
    if (!isnan(gain)) snprintf(ours_db, sizeof ours_db, "%+.2f dB", gain);
    fprintf(p->f, "| %d | %s | %s | %+.2f dB |", r->n_exposures, tables_device_words[r->device], ours_db,
            x.of[TABLES_PSNR] - y.of[TABLES_PSNR]);
    double ours = a.of[TABLES_ABS_REL] / m.of[TABLES_ABS_REL];
    if (isnan(ours)) fprintf(p->f, " - |");
    else fprintf(p->f, " x %.2f |", ours);
    fprintf(p->f, " x %.2f |\n", x.of[TABLES_ABS_REL] / y.of[TABLES_ABS_REL]);
  }
}

static void put_count_sentence(const page *p) {
  const tables_table *b = &p->t->tables[TABLE_COUNT];
  const tables_row *few = NULL, *many = NULL;
  for (int i = 0; i < b->n; i++)
    if (b->rows[i].device < 0) *(few ? &many : &few) = &b->rows[i];
  if (!few || !many) return;
  if (isnan(tables_row_mean(p->t, few).figures.of[TABLES_PSNR] +
            tables_row_mean(p->t, many).figures.of[TABLES_PSNR]))
    return;
  double a = tables_row_mean(p->t, few).figures.of[TABLES_PSNR],
         z = tables_row_mean(p->t, many).figures.of[TABLES_PSNR];
  fprintf(p->f, "\n%s Gaussians: %.2f dB, %s: %.2f dB, means over devices and scenes: fewer are %s.\n",
          few->label, a, many->label, z, a >= z ? "no worse" : "**worse**");
}

static void put_order(const page *p) {
  int n = 0, n_breaks = 0;
  fprintf(p->f,
          "\n## Order of the devices\n\nExpected on every scene, in PSNR and in AbsRel: phone and stereo "
          "beat monocular, light field beats both, multiplexed beats light field. Where that does not "
          "hold:\n\n");
  for (int e = 1; e <= 3; e += 2)
    for (int s = 0; s < p->t->n_scenes; s++)
      for (int k = 0; k < N_ORDER; k++) {
        n += put_break(p, s, e, TABLES_PSNR, k, &n_breaks);
        n += put_break(p, s, e, TABLES_ABS_REL, k, &n_breaks);
      }
  if (!n_breaks) fprintf(p->f, "Nowhere.\n");
  fprintf(p->f, "\n%d of %d comparisons hold.\n", n - n_breaks, n);
  put_gains(p);
  put_count_sentence(p);
}

// TV that the objective does not have cannot be taken away.
static void put_tv_sentence(const page *p) {
  const tables_table *b = &p->t->tables[TABLE_TV];
  for (int i = 0; i + 1 < b->n; i += 2) {
    const tables_row *on = &b->rows[i], *off = &b->rows[i + 1];
    bool is_same = on->n_runs == off->n_runs;
    for (int k = 0; k < on->n_runs && is_same; k++)
      is_same = p->t->runs[on->runs[k]].is_done &&
                sv_str_eq(p->t->runs[on->runs[k]].result.digest, p->t->runs[off->runs[k]].result.digest);
    if (is_same)
      fprintf(p->f, "\nThe two models of the %s are the same: its objective had no TV to take away.\n",
              tables_device_words[on->device]);
  }
}

// --- images and runs ---------------------------------------------------------------------------

static void put_sheets(const page *p) {
  fprintf(p->f, "\n## Renderings\n\nOne exposure. Rows: ");
  for (int d = 0; d < TABLES_RIG; d++) fprintf(p->f, "%s%s", d ? ", " : "", tables_device_words[d]);
  fprintf(p->f,
          " (those that the scene has). Columns: truth, render, error (times 4), true depth, depth (near is "
          "bright; true depth: where the dataset has it).\n\n");
  for (int i = 0; i < p->t->n_scenes; i++)
    fprintf(p->f, "### %s\n\n![%s](sheet_%s.png)\n\n", p->t->scenes[i].name, p->t->scenes[i].name,
            p->t->scenes[i].name);
}

static void put_runs(const page *p) {
  const tables *t = p->t;
  char what[200];
  fprintf(p->f, "## Every run\n\n| run | split |");
  for (int k = 0; k < TABLES_N_FIGURES; k++) fprintf(p->f, " %s |", tables_figure_words[k]);
  fprintf(p->f,
          " steps | Gaussians | s | block | RSS |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n");
  for (int i = 0; i < t->n_runs; i++)
    for (int k = 0; k < TABLES_N_SPLITS; k++) {
      const tables_run *r = &t->runs[i];
      const tables_result *v = &r->result;
      if (!r->needs[k]) continue;
      tables_describe(t, r, what, sizeof what);
      fprintf(p->f, "| %s | %s |", what, tables_split_names[k]);
      for (int n = 0; n < TABLES_N_FIGURES; n++) put_figure(p, n, v->score[k].of[n]);
      fprintf(p->f, " %ld | %ld | %.1f | %.1f | %.1f |\n", v->steps, v->gaussians, v->seconds,
              v->arena_bytes * 1e-6, v->peak_rss_bytes * 1e-6);
    }
}

sv_status tables_write_markdown(const tables *t, bool has_plots, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, t->o->out, "tables.md", err);
  if (s != SV_OK) return s;
  page p = {t, sv_stream_open(path, err)};
  if (!p.f) return SV_E_IO;
  put_measured(&p);
  put_differences(&p);
  put_table(&p, TABLE_SUMMARY);
  put_table(&p, TABLE_DEPTH);
  put_order(&p);
  put_scenes(&p);
  for (int id = TABLE_ANGLE; id < N_TABLES; id++) {
    put_table(&p, id);
    if (id == TABLE_TV) put_tv_sentence(&p);
  }
  tables_put_plots(p.f, t, has_plots);
  put_sheets(&p);
  put_runs(&p);
  return sv_stream_save(p.f, err);
}
