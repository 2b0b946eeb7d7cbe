// SPDX-License-Identifier: Apache-2.0
#ifndef SV_TOOLS_CALIBRATE_GNUPLOT_H
#define SV_TOOLS_CALIBRATE_GNUPLOT_H

// Runs gnuplot on a script in a folder; its messages go to gnuplot.log there. Returns its exit code: 127 when it
// is not installed, 126 when it could not be started.
int cal_gnuplot(const char *folder, const char *script);

#endif
