// SPDX-License-Identifier: Apache-2.0
// Losses of rendered depth against double precision and central differences; the same bits for any
// order of tasks.
#ifndef SV_TESTS_GRAD_SURFACE_DOUBLE_H
#define SV_TESTS_GRAD_SURFACE_DOUBLE_H

void check_smooth(void);
void check_reproject(void);

#endif
