// SPDX-License-Identifier: Apache-2.0
// What the plots of all tables share: a gnuplot script with its data inside, drawn as SVG and PNG
// when gnuplot is there.
#ifndef SV_TOOLS_TABLES_PLOT_H
#define SV_TOOLS_TABLES_PLOT_H

#include <stdio.h>

#include "tools/tables/tables.h"

typedef struct {
  char folder[SV_CAP_PATH];
  bool is_missing, is_failed; // gnuplot; said once
  int n_tried, n_drawn;
} tables_drawing;

extern const int tables_device_colours[TABLES_N_DEVICES]; // 0xrrggbb

// Makes OUT/plots.
sv_status tables_drawing_begin(const tables *t, tables_drawing *d, sv_err *err) SV_MUST_USE;
// OUT/plots/NAME.gp, open for the data; NULL: err says why. To be closed with the plot command,
// which is run once for each picture.
FILE *tables_script_open(const tables *t, const char *name, sv_err *err);
sv_status tables_script_close(FILE *f, const char *name, const char *plot, sv_err *err) SV_MUST_USE;
// Has gnuplot draw a script; what hinders it is said once, and is no failure.
void tables_draw(tables *t, tables_drawing *d, const char *name);
// The section `Plots` of a page: the images of OUT/plots, or what draws them.
void tables_put_plots(FILE *f, const tables *t, bool has_plots);

#endif
