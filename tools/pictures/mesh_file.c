// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/mesh_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/axes.h"
#include "src/format/bytes.h"

#define CAP_HEAD 2048
#define CAP_UNIT 96

static bool ends_in(const char *path, const char *end) { return sv_str_eq(sv_path_extension(path), end); }

bool lab_mesh_is_format(const char *path) {
  return ends_in(path, ".ply") || ends_in(path, ".obj") || ends_in(path, ".glb");
}

// A line each in PLY ("comment ") and OBJ ("# "); empty where the unit is not known.
static void unit_lines(char out[CAP_UNIT], const sv_unit *u, const char *before) {
  sv_str s = sv_str_make(out, CAP_UNIT);
  if (u->is_metric) sv_str_add(&s, "%sunit: m\n", before);
  if (u->scale_sigma > 0) sv_str_add(&s, "%sscale_sigma: %.3g\n", before, (double)u->scale_sigma);
}

static sv_status write_ply(const sv_mesh *m, const sv_unit *unit, sv_file *f, sv_err *err) {
  char head[CAP_HEAD], lines[CAP_UNIT];
  unit_lines(lines, unit, "comment ");
  size_t n =
      sv_fmt(head, sizeof head,
             "ply\nformat binary_little_endian 1.0\n%selement vertex %d\nproperty float x\nproperty float "
             "y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement "
             "face %d\nproperty list uchar int vertex_indices\nend_header\n",
             lines, m->n_vertices, m->n_triangles);
  sv_status s = sv_file_append(f, head, n, err);
  for (int i = 0; i < m->n_vertices && s == SV_OK; i++) {
    uint8_t b[15];
    for (int k = 0; k < 3; k++) sv_put_lef32(b + 4 * k, m->vertex[i].x[k]);
    memcpy(b + 12, m->vertex[i].rgb, 3);
    s = sv_file_append(f, b, sizeof b, err);
  }
  for (int i = 0; i < m->n_triangles && s == SV_OK; i++) {
    uint8_t b[13] = {3};
    for (int k = 0; k < 3; k++) sv_put_le32(b + 1 + 4 * k, (uint32_t)m->triangle[i].v[k]);
    s = sv_file_append(f, b, sizeof b, err);
  }
  return s;
}

static sv_status write_obj(const sv_mesh *m, const sv_unit *unit, sv_file *f, sv_err *err) {
  char line[200], lines[CAP_UNIT];
  unit_lines(lines, unit, "# ");
  sv_status s = sv_file_append(f, lines, strlen(lines), err);
  for (int i = 0; i < m->n_vertices && s == SV_OK; i++) {
    const sv_mesh_vertex *v = &m->vertex[i];
    size_t n = sv_fmt(line, sizeof line, "v %g %g %g %.4f %.4f %.4f\n", (double)v->x[0], (double)v->x[1],
                      (double)v->x[2], v->rgb[0] / 255.0, v->rgb[1] / 255.0, v->rgb[2] / 255.0);
    s = sv_file_append(f, line, n, err);
  }
  for (int i = 0; i < m->n_triangles && s == SV_OK; i++) {
    const int32_t *v = m->triangle[i].v;
    s = sv_file_append(f, line, sv_fmt(line, sizeof line, "f %d %d %d\n", v[0] + 1, v[1] + 1, v[2] + 1), err);
  }
  return s;
}

// --- GLB: one buffer of positions, colors (RGBA, linear as glTF asks) and indices ----------------

static float linear_of(uint8_t c) {
  const float x = (float)c / 255.0f;
  return x <= 0.04045f ? x / 12.92f : powf((x + 0.055f) / 1.055f, 2.4f);
}

static void turned(const sv_turn *t, const float x[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = t->is_none ? x[k]
                        : (float)(t->r[3 * k] * (double)x[0] + t->r[3 * k + 1] * (double)x[1] +
                                  t->r[3 * k + 2] * (double)x[2]);
}

static size_t glb_json(const sv_mesh *m, const sv_turn *t, const sv_unit *unit, char text[CAP_HEAD]) {
  float lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY}, x[3];
  for (int i = 0; i < m->n_vertices; i++) {
    turned(t, m->vertex[i].x, x);
    for (int k = 0; k < 3; k++) {
      lo[k] = fminf(lo[k], x[k]);
      hi[k] = fmaxf(hi[k], x[k]);
    }
  }
  const int n = m->n_vertices, faces = m->n_triangles;
  sv_str s = sv_str_make(text, CAP_HEAD);
  sv_str_add(&s, "{\"asset\":{\"version\":\"2.0\",\"generator\":\"subview\"");
  if (unit->is_metric) sv_str_add(&s, ",\"extras\":{\"unit\":\"m\"");
  if (unit->is_metric && unit->scale_sigma > 0)
    sv_str_add(&s, ",\"scale_sigma\":%.3g", (double)unit->scale_sigma);
  if (unit->is_metric) sv_str_add(&s, "}");
  sv_str_add(
      &s,
      "},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
      "\"nodes\":[{"
      "\"mesh\":0}],\"materials\":[{\"pbrMetallicRoughness\":{\"metallicFactor\":0,\"roughnessFactor\":1}}],"
      "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"COLOR_0\":1},\"indices\":2,"
      "\"material\":0}]}],"
      "\"buffers\":[{\"byteLength\":%d}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":%d,\"target\":34962},"
      "{\"buffer\":0,\"byteOffset\":%d,\"byteLength\":%d,\"target\":34962},{\"buffer\":0,\"byteOffset\":%d,"
      "\"byteLength\":%d,\"target\":34963}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,"
      "\"count\":%d,"
      "\"type\":\"VEC3\",\"min\":[%.9g,%.9g,%.9g],\"max\":[%.9g,%.9g,%.9g]},{\"bufferView\":1,"
      "\"componentType\":5121,"
      "\"normalized\":true,\"count\":%d,\"type\":\"VEC4\"},{\"bufferView\":2,\"componentType\":5125,"
      "\"count\":%d,"
      "\"type\":\"SCALAR\"}]}",
      16 * n + 12 * faces, 12 * n, 12 * n, 4 * n, 16 * n, 12 * faces, n, (double)lo[0], (double)lo[1],
      (double)lo[2], (double)hi[0], (double)hi[1], (double)hi[2], n, 3 * faces);
  return s.len;
}

static sv_status write_glb(const sv_mesh *m, const sv_model_notes *notes, sv_file *f, sv_err *err) {
  char json[CAP_HEAD];
  uint8_t head[20];
  sv_turn t;
  sv_turn_between(&t, notes->up ? notes->up : SV_UP_DEFAULT, "y");
  size_t n = glb_json(m, &t, &notes->unit, json);
  while (n % 4) json[n++] = ' ';
  const size_t bytes = 16 * (size_t)m->n_vertices + 12 * (size_t)m->n_triangles;
  sv_put_le32(head, 0x46546c67);
  sv_put_le32(head + 4, 2);
  sv_put_le32(head + 8, (uint32_t)(sizeof head + n + 8 + bytes));
  sv_put_le32(head + 12, (uint32_t)n);
  sv_put_le32(head + 16, 0x4e4f534a);
  sv_status s = sv_file_append(f, head, sizeof head, err);
  if (s == SV_OK) s = sv_file_append(f, json, n, err);
  sv_put_le32(head, (uint32_t)bytes);
  sv_put_le32(head + 4, 0x004e4942);
  if (s == SV_OK) s = sv_file_append(f, head, 8, err);
  for (int i = 0; i < m->n_vertices && s == SV_OK; i++) {
    uint8_t b[12];
    float x[3];
    turned(&t, m->vertex[i].x, x);
    for (int k = 0; k < 3; k++) sv_put_lef32(b + 4 * k, x[k]);
    s = sv_file_append(f, b, sizeof b, err);
  }
  for (int i = 0; i < m->n_vertices && s == SV_OK; i++) {
    uint8_t b[4] = {0, 0, 0, 255};
    for (int k = 0; k < 3; k++) b[k] = (uint8_t)(255.0f * linear_of(m->vertex[i].rgb[k]) + 0.5f);
    s = sv_file_append(f, b, sizeof b, err);
  }
  for (int i = 0; i < m->n_triangles && s == SV_OK; i++) {
    uint8_t b[12];
    for (int k = 0; k < 3; k++) sv_put_le32(b + 4 * k, (uint32_t)m->triangle[i].v[k]);
    s = sv_file_append(f, b, sizeof b, err);
  }
  return s;
}

sv_status lab_mesh_write(const sv_mesh *m, const sv_model_notes *notes, const char *path, sv_err *err) {
  sv_file f;
  if (m->n_vertices > 100000000 || m->n_triangles > 100000000)
    return sv_fail(err, SV_E_RANGE, "%s: %d vertices are too many for a file", path, m->n_vertices);
  sv_status s = sv_file_begin(&f, path, err);
  if (s != SV_OK) return s;
  s = ends_in(path, ".obj")   ? write_obj(m, &notes->unit, &f, err)
      : ends_in(path, ".glb") ? write_glb(m, notes, &f, err)
                              : write_ply(m, &notes->unit, &f, err);
  if (s == SV_OK) return sv_file_commit(&f, err);
  sv_file_abandon(&f);
  return s;
}
