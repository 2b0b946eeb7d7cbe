// SPDX-License-Identifier: Apache-2.0
#include "tests/budget/counts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kernels/kernels.h"

static const char *const stages[] = {"sv_train_step", "sv_render", "sv_photometric_loss", "sv_render_bwd",
                                     "sv_train_optimise"};
#define N_STAGES (sizeof stages / sizeof *stages)

const char *counts_compiler(void) {
#if defined(__clang__)
  return "clang " __VERSION__;
#else
  return "gcc " __VERSION__;
#endif
}

bool counts_read(counts_table *t, const char *path, char *err, size_t cap) {
  char line[200];
  FILE *f = fopen(path, "r");
  memset(t, 0, sizeof *t);
  if (!f) return snprintf(err, cap, "%s: there is no such file; make accept-counts writes it", path), false;
  for (int n = 1; fgets(line, sizeof line, f); n++) {
    counts_row *r = t->row + t->n_rows;
    unsigned long long count;
    if (line[0] == '#') {
      sscanf(line, "# compiler %79[^\n]", t->compiler);
      continue;
    }
    if (strncmp(line, "isa,", 4) == 0) continue;
    if (t->n_rows >= COUNTS_CAP_ROWS ||
        sscanf(line, "%7[^,],%63[^,],%llu", r->isa, r->function, &count) != 3) {
      snprintf(err, cap, "%s: line %d is not isa,function,instructions", path, n);
      fclose(f);
      return false;
    }
    r->instructions = count;
    t->n_rows++;
  }
  fclose(f);
  return true;
}

bool counts_write(const counts_table *t, const char *path) {
  FILE *f = fopen(path, "w");
  if (!f) return false;
  fprintf(
      f,
      "# SPDX-License-Identifier: Apache-2.0\n"
      "# Instructions of five training steps, counted by callgrind; make accept-counts writes this file.\n"
      "# compiler %s\nisa,function,instructions\n",
      t->compiler);
  for (int i = 0; i < t->n_rows; i++)
    fprintf(f, "%s,%s,%llu\n", t->row[i].isa, t->row[i].function, (unsigned long long)t->row[i].instructions);
  return fclose(f) == 0;
}

// "sv_raster_avx2" of the table's raster.
static bool is_kernel(const char *name) {
  static const char *const ops[] = {
#define OP(op) #op,
#define VARIANT(op, isa_lower, isa_upper)
#include "kernels/variants.inc"
  };
  const char *last = strrchr(name, '_');
  if (strncmp(name, "sv_", 3) != 0 || !last || last < name + 3 || sv_isa_by_name(last + 1) < 0) return false;
  for (size_t i = 0; i < sizeof ops / sizeof *ops; i++)
    if (strlen(ops[i]) == (size_t)(last - name - 3) && strncmp(ops[i], name + 3, strlen(ops[i])) == 0)
      return true;
  return false;
}

static bool is_kept(const char *name) {
  for (size_t i = 0; i < N_STAGES; i++)
    if (strcmp(name, stages[i]) == 0) return true;
  return is_kernel(name);
}

const counts_row *counts_find(const counts_table *t, const char *isa, const char *function) {
  for (int i = 0; i < t->n_rows; i++)
    if (strcmp(t->row[i].isa, isa) == 0 && strcmp(t->row[i].function, function) == 0) return t->row + i;
  return NULL;
}

static counts_row *row_of(counts_table *t, const char *isa, const char *function) {
  counts_row *r = (counts_row *)counts_find(t, isa, function);
  if (r || t->n_rows >= COUNTS_CAP_ROWS) return r;
  r = t->row + t->n_rows++;
  memset(r, 0, sizeof *r);
  snprintf(r->isa, sizeof r->isa, "%s", isa);
  snprintf(r->function, sizeof r->function, "%.63s", function);
  return r;
}

static int by_name(const void *a, const void *b) {
  const counts_row *x = a, *y = b;
  int isa = strcmp(x->isa, y->isa);
  return isa ? isa : strcmp(x->function, y->function);
}

// Below "fn=NAME" stand lines "position cost": the function's own, and after "calls=" those of what
// it called.
bool counts_add_callgrind(counts_table *t, const char *path, const char *isa) {
  char line[1000];
  counts_row *r = NULL;
  int before = t->n_rows;
  FILE *f = fopen(path, "r");
  if (!f) return false;
  while (fgets(line, sizeof line, f)) {
    unsigned long long position, cost;
    line[strcspn(line, "\n")] = 0;
    if (strncmp(line, "fn=", 3) == 0) r = is_kept(line + 3) ? row_of(t, isa, line + 3) : NULL;
    else if (r && sscanf(line, "%llu %llu", &position, &cost) == 2) r->instructions += cost;
  }
  fclose(f);
  qsort(t->row, (size_t)t->n_rows, sizeof *t->row, by_name);
  return t->n_rows > before;
}

int counts_compare(const counts_table *record, const counts_table *now, char *text, size_t cap) {
  int n_worse = 0;
  size_t at = 0;
  if (cap) text[0] = 0;
  for (int i = 0; i < now->n_rows; i++) {
    const counts_row *r = now->row + i, *was = counts_find(record, r->isa, r->function);
    if (!was || !was->instructions) continue; // new functions count in the step's sum
    double more = (double)r->instructions / (double)was->instructions - 1;
    if (more <= COUNTS_WORSE) continue;
    n_worse++;
    if (at >= cap) continue;
    int n = snprintf(
        text + at, cap - at,
        "%s: %llu instructions, %.1f %% more than the %llu on record; if they are worth it, accept them "
        "with: make accept-counts\n",
        r->function, (unsigned long long)r->instructions, 100 * more, (unsigned long long)was->instructions);
    at += n > 0 ? (size_t)n : 0;
  }
  return n_worse;
}
