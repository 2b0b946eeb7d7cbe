// SPDX-License-Identifier: Apache-2.0
// What is written of the tables of real cameras.
#include <math.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/plot.h"
#include "tools/tables/real.h"

#define N_CELLS 15

// A row, or the mean over the scenes of one capture.
typedef struct {
  const char *scene;
  const tables_scene *like;
  int device;
  tables_method method;
  double cell[N_CELLS];
} line;

// Columns: the two masks, whole frames, the gain over the single camera, cost, the paper.
static const char *const heads[N_CELLS] = {
    "own pixels %", "mPSNR",    "mSSIM",         "mLPIPS",        "shared pixels %", "PSNR", "SSIM", "LPIPS",
    "dB over mono", "all PSNR", "paper's mPSNR", "paper's mSSIM", "paper's mLPIPS",  "s",    "MB"};
static const int digits[N_CELLS] = {1, 2, 3, 3, 1, 2, 3, 3, 2, 2, 2, 3, 3, 1, 1};

static const tables_real_row *mono_of(const tables_real_job *j, const tables_real_row *r) {
  for (int i = 0; i < j->n; i++)
    if (j->rows[i].i_scene == r->i_scene && j->rows[i].method == r->method &&
        j->rows[i].device == TABLES_MONO)
      return &j->rows[i];
  return NULL;
}

static line line_of(const tables_real_job *j, const tables_real_row *r) {
  const tables_scene *sc = &j->t->scenes[r->i_scene];
  const tables_real_row *mono = mono_of(j, r);
  line l = {sc->subject, sc, r->device, r->method, {0}};
  for (int m = 0; m < TABLES_N_MASKS; m++) {
    l.cell[4 * m] = 100 * r->masked[m].coverage;
    for (int k = 0; k < 3; k++) l.cell[4 * m + 1 + k] = r->masked[m].of[k];
  }
  l.cell[8] = mono && mono != r ? r->masked[TABLES_SHARED].of[0] - mono->masked[TABLES_SHARED].of[0] : NAN;
  l.cell[9] = r->whole.of[TABLES_PSNR];
  for (int k = 0; k < 3; k++) l.cell[10 + k] = tables_paper_real(sc, r->device, r->method, k, false);
  l.cell[13] = r->is_done ? r->train.seconds : NAN;
  l.cell[14] = r->is_done ? r->train.arena_bytes * 1e-6 : NAN;
  return l;
}

static bool is_same_group(const tables_real_job *j, const tables_real_row *a, const tables_real_row *b) {
  return a->device == b->device && a->method == b->method &&
         sv_str_eq(j->t->scenes[a->i_scene].capture, j->t->scenes[b->i_scene].capture);
}

// The mean over scenes, beside the paper's mean; false when an earlier row stands for the group.
static bool mean_of(const tables_real_job *j, int i_row, line *out, double *deviation) {
  const tables_real_row *r = &j->rows[i_row];
  double sum = 0, squares = 0;
  int n = 0;
  for (int i = 0; i < i_row; i++)
    if (is_same_group(j, &j->rows[i], r)) return false;
  *out = line_of(j, r);
  for (int k = 0; k < N_CELLS; k++) out->cell[k] = 0;
  for (int i = i_row; i < j->n; i++) n += is_same_group(j, &j->rows[i], r);
  for (int i = i_row; i < j->n; i++) {
    if (!is_same_group(j, &j->rows[i], r)) continue;
    const line l = line_of(j, &j->rows[i]);
    for (int k = 0; k < N_CELLS; k++) out->cell[k] += l.cell[k] / n;
    sum += l.cell[1];
    squares += l.cell[1] * l.cell[1];
  }
  for (int k = 0; k < 3; k++) out->cell[10 + k] = tables_paper_real(out->like, r->device, r->method, k, true);
  *deviation = n > 1 ? sqrt(fmax(0, squares / n - sum / n * (sum / n))) : 0;
  out->scene = "mean";
  return true;
}

static void put_cell(FILE *f, double v, int n, bool is_csv) {
  if (isnan(v)) fprintf(f, is_csv ? "," : " - |");
  else if (is_csv) fprintf(f, ",%.7g", v);
  else fprintf(f, " %.*f |", n, v);
}

static void put_line(FILE *f, const line *l, bool is_csv) {
  fprintf(f, is_csv ? "%s,%s,%s,%s" : "| %s | %s | %s | %s |", l->scene, l->like->capture,
          tables_device_words[l->device], tables_method_words[l->method]);
  for (int k = 0; k < N_CELLS; k++) put_cell(f, l->cell[k], digits[k], is_csv);
  fprintf(f, "\n");
}

static void put_heads(FILE *f) {
  fprintf(f, "\n| scene | capture | device | method |");
  for (int k = 0; k < N_CELLS; k++) fprintf(f, " %s |", heads[k]);
  fprintf(f, "\n|---|---|---|---|");
  for (int k = 0; k < N_CELLS; k++) fprintf(f, "--:|");
  fprintf(f, "\n");
}

static sv_status write_csv(const tables_real_job *j, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, j->t->o->out, "real.csv", err);
  if (s != SV_OK) return s;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  fprintf(f, "scene,capture,device,method,own_coverage,mpsnr,mssim,mlpips_squeeze,shared_coverage,psnr,ssim,"
             "lpips_squeeze,gain_db,whole_psnr,paper_mpsnr,paper_mssim,paper_mlpips,seconds,megabytes\n");
  for (int i = 0; i < j->n; i++) {
    const line l = line_of(j, &j->rows[i]);
    put_line(f, &l, true);
  }
  return sv_stream_save(f, err);
}

// Means with the scatter over the scenes, ours beside the paper's.
static sv_status write_bars(const tables_real_job *j, const char *name, sv_err *err) {
  FILE *f = tables_script_open(j->t, name, err);
  line l;
  double deviation;
  int n = 0;
  if (!f) return SV_E_IO;
  fprintf(f,
          "set title \"Masked PSNR, means over the scenes; bars: standard deviation over the scenes\"\n"
          "set ylabel 'mPSNR (dB)'\nset grid y\nset style data histograms\n"
          "set style histogram errorbars gap 2 lw 1\nset style fill solid 0.8\nset key top left\n"
          "set offsets 0, 0, graph 0.15, graph 0.15\nset yrange [*:*]\nset xtics rotate by -30 noenhanced\n"
          "set datafile missing '?'\n$bars << EOD\n");
  for (int i = 0; i < j->n; i++) {
    if (!mean_of(j, i, &l, &deviation) || isnan(l.cell[1])) continue;
    fprintf(f, "\"%s %s %s\" %.7g %.7g ", l.like->capture, tables_device_words[l.device],
            tables_method_words[l.method], l.cell[1], deviation);
    if (isnan(l.cell[10])) fprintf(f, "? ?\n");
    else fprintf(f, "%.7g 0\n", l.cell[10]);
    n++;
  }
  fprintf(f, "EOD\n");
  return tables_script_close(f, name,
                             n ? "plot $bars using 2:3:xtic(1) lc rgb '#0072b2' title 'ours', "
                                 "$bars using 4:5 lc rgb '#bbbbbb' title 'paper'"
                               : "# nothing to draw",
                             err);
}

static void put_caption(FILE *f, const tables_real_job *j) {
  const tables *t = j->t;
  const bool is_static = t->scenes[0].kind == TABLES_STATIC;
  fprintf(f,
          "# %s\n\nWritten by `subview-lab tables`: %ld Gaussians, %ld steps, on all training views of each "
          "file, from the recording's points.\n\n",
          is_static ? "One exposure of real cameras" : "Videos of real cameras", t->n_gaussians, t->n_steps);
  if (t->n_missing) fprintf(f, "**%d of the %d runs are missing.**\n\n", t->n_missing, t->n_runs);
  fprintf(
      f,
      "Each device beside its own single camera. `own pixels`: the share of the held-out pixels that the "
      "model's own training views see; mPSNR, mSSIM and mLPIPS are over these, as in the paper. `shared "
      "pixels`: those that the device and its single camera both see, the same for both; PSNR, SSIM, LPIPS "
      "and the gain in dB are over these. Compare devices by the shared pixels, and with the paper by the "
      "own ones.\n\n**What differs from the paper.** LPIPS is that of SqueezeNet; the paper's is that of "
      "%s, which is not comparable. Co-visibility by our own optical flow instead of RAFT. A fixed number "
      "of Gaussians with relocation instead of densification, poses as imported.%s\n",
      is_static ? "VGG" : "AlexNet",
      is_static ? " FSGS and SparseGS with their losses on; in the authors' release those of SparseGS are "
                  "off."
      : t->o->prior ? " The prior is the program that --prior names; the paper's is Difix."
                    : " Rows with a prior need --prior external:CMD.");
}

sv_status tables_real_write(const tables_real_job *j, sv_err *err) {
  char path[SV_CAP_PATH];
  tables_drawing d;
  line l;
  double deviation;
  sv_status s = write_csv(j, err);
  if (s == SV_OK) s = tables_drawing_begin(j->t, &d, err);
  if (s == SV_OK) s = write_bars(j, "real_mpsnr", err);
  if (s == SV_OK) tables_draw(j->t, &d, "real_mpsnr");
  if (s == SV_OK) s = sv_path_join(path, sizeof path, j->t->o->out, "tables.md", err);
  if (s != SV_OK) return s;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  put_caption(f, j);
  fprintf(f, "\n## Means over the scenes\n");
  put_heads(f);
  for (int i = 0; i < j->n; i++)
    if (mean_of(j, i, &l, &deviation)) put_line(f, &l, false);
  fprintf(f, "\n## Each scene\n");
  put_heads(f);
  for (int i = 0; i < j->n; i++) {
    l = line_of(j, &j->rows[i]);
    put_line(f, &l, false);
  }
  tables_put_plots(f, j->t, d.n_drawn > 0);
  return sv_stream_save(f, err);
}
