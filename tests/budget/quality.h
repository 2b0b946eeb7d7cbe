// SPDX-License-Identifier: Apache-2.0
// Instructions of a whole command that reaches a quality, loading included: the measure of "seconds
// to a PSNR" that does not depend on what else the machine does.
// Owns the fixed run; never compares (counts.h does).
#ifndef SV_TESTS_BUDGET_QUALITY_H
#define SV_TESTS_BUDGET_QUALITY_H

#include <stdbool.h>
#include <stddef.h>

#include "tests/budget/counts.h"

#define QUALITY_ROW "command to 24.3 dB" // its row in the record
#define QUALITY_DB  24.3                 // of held-out views, that the fixed run reaches

// Adds the run's row, counted by callgrind with the AVX2 kernels. False: err has a sentence.
bool quality_count(counts_table *t, const char *folder, char *err, size_t cap);
// Held-out PSNR of the same run in dB; 0 when it fails.
double quality_psnr(const char *folder);

#endif
