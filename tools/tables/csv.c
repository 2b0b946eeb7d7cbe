// SPDX-License-Identifier: Apache-2.0
// CSV: one file a table, one with the figures of each scene, one with every run. Empty cells are
// not known.
#include <math.h>
#include <stdio.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

static FILE *open_csv(const tables *t, const char *name, sv_err *err) {
  char path[SV_CAP_PATH], file[80];
  snprintf(file, sizeof file, "%s.csv", name);
  if (sv_path_join(path, sizeof path, t->o->out, file, err) != SV_OK) return NULL;
  return sv_stream_open(path, err);
}

static void put(FILE *f, double v) {
  if (isnan(v)) fprintf(f, ",");
  else fprintf(f, ",%.7g", v);
}

static sv_status write_table(const tables *t, const tables_table *b, sv_err *err) {
  FILE *f = open_csv(t, b->name, err);
  if (!f) return SV_E_IO;
  fprintf(f, "device,exposures,setting,scenes,split,psnr,ssim,lpips,abs_rel,rmse,steps,gaussians,seconds,"
             "wall_seconds,arena_bytes,peak_rss_bytes,paper_psnr,paper_ssim,paper_lpips,paper_abs_rel,"
             "paper_rmse\n");
  for (int i = 0; i < b->n; i++) {
    const tables_row *r = &b->rows[i];
    tables_mean m = tables_row_mean(t, r);
    tables_figures paper = tables_paper(r->has_paper ? r->n_exposures : 0, r->device);
    fprintf(f, "%s,%d,%s,", r->device < 0 ? "all" : tables_device_names[r->device], r->n_exposures, r->label);
    for (int k = 0; k < r->n_runs; k++)
      if (k == 0 || t->runs[r->runs[k]].set.i_scene != t->runs[r->runs[k - 1]].set.i_scene)
        fprintf(f, "%s%s", k ? " " : "", t->scenes[t->runs[r->runs[k]].set.i_scene].name);
    fprintf(f, ",%s", tables_split_names[r->split]);
    for (int k = 0; k < TABLES_N_FIGURES; k++) put(f, m.figures.of[k]);
    fprintf(f, ",%ld,%ld,%.3f,%.3f,%.0f,%.0f", m.steps, m.gaussians, m.seconds, m.wall_s, m.arena_bytes,
            m.peak_rss_bytes);
    for (int k = 0; k < TABLES_N_FIGURES; k++) put(f, paper.of[k]);
    fprintf(f, "\n");
  }
  return sv_stream_save(f, err);
}

static sv_status write_scenes(const tables *t, sv_err *err) {
  FILE *f = open_csv(t, "scenes", err);
  if (!f) return SV_E_IO;
  fprintf(f, "scene,device,exposures,split,psnr,ssim,lpips,abs_rel,rmse,steps,gaussians,seconds,wall_seconds,"
             "arena_bytes,peak_rss_bytes\n");
  const tables_table *b = &t->tables[TABLE_SUMMARY];
  for (int s = 0; s < t->n_scenes; s++)
    for (int i = 0; i < b->n; i++)
      for (int k = 0; k < b->rows[i].n_runs; k++) {
        const tables_row *r = &b->rows[i];
        const tables_run *run = &t->runs[r->runs[k]];
        const tables_result *v = &run->result;
        if (run->set.i_scene != s) continue;
        fprintf(f, "%s,%s,%d,%s", t->scenes[s].name, tables_device_names[r->device], r->n_exposures,
                tables_split_names[r->split]);
        for (int n = 0; n < TABLES_N_FIGURES; n++) put(f, v->score[r->split].of[n]);
        fprintf(f, ",%ld,%ld,%.3f,%.3f,%.0f,%.0f\n", v->steps, v->gaussians, v->seconds, v->wall_s,
                v->arena_bytes, v->peak_rss_bytes);
      }
  return sv_stream_save(f, err);
}

static sv_status write_runs(const tables *t, sv_err *err) {
  FILE *f = open_csv(t, "runs", err);
  if (!f) return SV_E_IO;
  fprintf(f,
          "key,scene,device,theta_deg,exposures,init,tv,split,psnr,ssim,lpips,abs_rel,rmse,steps,gaussians,"
          "seconds,wall_seconds,arena_bytes,peak_rss_bytes,threads,isa,digest,build\n");
  for (int i = 0; i < t->n_runs; i++)
    for (int k = 0; k < TABLES_N_SPLITS; k++) {
      const tables_run *r = &t->runs[i];
      const tables_result *v = &r->result;
      double theta = tables_file_of(t, &r->set)->theta_deg;
      if (!r->needs[k]) continue;
      fprintf(f, "%s,%s,%s", r->key, t->scenes[r->set.i_scene].name, tables_device_names[r->set.device]);
      put(f, theta < 0 ? NAN : theta);
      fprintf(f, ",%d,%s,%s,%s", r->set.n_exposures, r->set.is_cube ? "cube" : "sphere",
              r->set.is_tv_off ? "off" : "on", tables_split_names[k]);
      for (int n = 0; n < TABLES_N_FIGURES; n++) put(f, v->score[k].of[n]);
      fprintf(f, ",%ld,%ld,%.3f,%.3f,%.0f,%.0f,%d,%s,%s,%s\n", v->steps, v->gaussians, v->seconds, v->wall_s,
              v->arena_bytes, v->peak_rss_bytes, v->threads, v->isa, v->digest, v->build);
    }
  return sv_stream_save(f, err);
}

sv_status tables_write_csv(const tables *t, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < N_TABLES && s == SV_OK; i++) s = write_table(t, &t->tables[i], err);
  if (s == SV_OK) s = write_scenes(t, err);
  return s == SV_OK ? write_runs(t, err) : s;
}
