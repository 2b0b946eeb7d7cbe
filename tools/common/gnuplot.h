// SPDX-License-Identifier: Apache-2.0
#ifndef SV_TOOLS_COMMON_GNUPLOT_H
#define SV_TOOLS_COMMON_GNUPLOT_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

// Runs gnuplot on a script in a folder; its messages go to gnuplot.log there, which is_first begins
// anew. Returns its exit code: 127 when it is not installed, 126 when it could not be started.
int sv_gnuplot(const char *folder, const char *script, bool is_first);

#ifdef __cplusplus
}
#endif
#endif
