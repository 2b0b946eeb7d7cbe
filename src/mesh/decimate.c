// SPDX-License-Identifier: Apache-2.0
// Fewer triangles by vertex clustering (Rossignac and Borrel 1993): the vertices in a cell of a
// grid become one at their mean, and triangles that lose a side are gone. The grid is the finest
// one that leaves few enough.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/mesh/mesh.h"

#define N_HALVINGS 24

// The field's memory, which a mesh that is extracted has no use for: a hash of vertices by their
// cells, and sums of the cells.
typedef struct {
  int32_t *table;
  size_t n_table; // a power of two
  float (*sum)[6];
  size_t cap_sums;
} scratch;

static scratch scratch_of(const sv_mesh *m) {
  const size_t n = (size_t)m->cfg.cap_blocks * SV_MESH_BLOCK_VOXELS;
  scratch s = {.table = m->cell[0], .n_table = 1, .sum = (float(*)[6])(void *)m->voxel};
  while (2 * s.n_table <= n) s.n_table *= 2;
  s.cap_sums = n * sizeof(sv_voxel) / sizeof *s.sum;
  return s;
}

static void cell_of(const sv_mesh *m, const float x[3], float edge, int32_t out[3]) {
  for (int k = 0; k < 3; k++) out[k] = (int32_t)floorf((x[k] - m->cfg.centre[k]) / edge);
}

// group[v]: the first vertex in the cell of v.
static void cluster(sv_mesh *m, const scratch *s, float edge) {
  for (size_t i = 0; i < s->n_table; i++) s->table[i] = -1;
  for (int v = 0; v < m->n_vertices; v++) {
    int32_t c[3], other[3];
    cell_of(m, m->vertex[v].x, edge, c);
    uint32_t h = (uint32_t)c[0] * 73856093u ^ (uint32_t)c[1] * 19349669u ^ (uint32_t)c[2] * 83492791u;
    for (h ^= h >> 15;; h++) {
      int32_t *place = &s->table[h & (s->n_table - 1)];
      if (*place < 0) *place = v;
      cell_of(m, m->vertex[*place].x, edge, other);
      if (memcmp(c, other, sizeof c) != 0) continue;
      m->group[v] = *place;
      break;
    }
  }
}

static bool is_left(const sv_mesh *m, const sv_triangle *t) {
  const int32_t a = m->group[t->v[0]], b = m->group[t->v[1]], c = m->group[t->v[2]];
  return a != b && b != c && c != a;
}

static int count(sv_mesh *m, const scratch *s, float edge) {
  int n = 0;
  cluster(m, s, edge);
  for (int t = 0; t < m->n_triangles; t++) n += is_left(m, &m->triangle[t]);
  return n;
}

// Vertices become the means of their cells; group becomes the new place of each.
static void merge_vertices(sv_mesh *m, const scratch *s) {
  int n = 0;
  for (int v = 0; v < m->n_vertices; v++) {
    const int32_t first = m->group[v];
    const int32_t to = first == v ? n++ : m->group[first];
    float *sum = s->sum[to];
    if (first == v) {
      memset(sum, 0, sizeof *s->sum);
      m->size[to] = 0;
    }
    for (int k = 0; k < 3; k++) {
      sum[k] += m->vertex[v].x[k] - m->cfg.centre[k];
      sum[3 + k] += (float)m->vertex[v].rgb[k];
    }
    m->size[to]++;
    m->group[v] = to;
  }
  for (int i = 0; i < n; i++)
    for (int k = 0; k < 3; k++) {
      const float count_of = (float)m->size[i];
      m->vertex[i].x[k] = m->cfg.centre[k] + s->sum[i][k] / count_of;
      m->vertex[i].rgb[k] = (uint8_t)(s->sum[i][3 + k] / count_of + 0.5f);
    }
  m->n_vertices = n;
}

sv_status sv_mesh_decimate(sv_mesh *m, int max_triangles) {
  const scratch s = scratch_of(m);
  float fine = 0.5f * m->cfg.voxel, coarse = 2 * m->cfg.radius;
  if (max_triangles < 1) return SV_E_ARG;
  if (m->n_triangles <= max_triangles) return SV_OK;
  if ((size_t)m->n_vertices >= s.n_table || (size_t)m->n_vertices > s.cap_sums) return SV_E_NOMEM;
  for (int i = 0; i < N_HALVINGS; i++) {
    const float edge = sqrtf(fine * coarse);
    if (count(m, &s, edge) > max_triangles) fine = edge;
    else coarse = edge;
  }
  (void)count(m, &s, coarse);
  int n = 0;
  for (int t = 0; t < m->n_triangles; t++)
    if (is_left(m, &m->triangle[t])) m->triangle[n++] = m->triangle[t];
  m->n_triangles = n;
  merge_vertices(m, &s);
  for (int t = 0; t < n; t++)
    for (int k = 0; k < 3; k++) m->triangle[t].v[k] = m->group[m->triangle[t].v[k]];
  return SV_OK;
}
