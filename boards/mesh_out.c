// SPDX-License-Identifier: Apache-2.0
#include "boards/mesh_out.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/mesh/mesh.h"

#define VOXELS       128 // of the scene's radius
#define CAP_BLOCKS   8192
#define CAP_VERTICES 400000
#define N_TRIES      6     // each with voxels that are larger by
#define COARSER      1.26f // which halves their number
#define MIN_VIEWS    16    // that saw a surface; one in five of few
#define SMALL        0.02f // connected parts below this share of the largest are floaters

static sv_mesh_cfg field_cfg(const float centre[3], float radius) {
  sv_mesh_cfg c = {.radius = radius,
                   .voxel = radius / VOXELS,
                   .cap_blocks = CAP_BLOCKS,
                   .cap_vertices = CAP_VERTICES,
                   .cap_triangles = 2 * CAP_VERTICES};
  memcpy(c.centre, centre, sizeof c.centre);
  return c;
}

sv_status mesh_out_carve(mesh_out *m, const sv_app_cfg *cfg, sv_arena *arena, sv_err *err) {
  const sv_mesh_cfg c = field_cfg((const float[3]){0, 0, 0}, 1);
  const sv_train_cfg t = sv_app_train_cfg(cfg, 1);
  memset(m, 0, sizeof *m);
  if (cfg->rig->forward == SV_FORWARD_MULTIPLEXED)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "--mesh: not with multiplexed rigs, whose lens images are not views");
  sv_arena_part_begin(arena, "mesh");
  m->field_bytes = sv_mesh_bytes(&c) + SV_ARENA_ALIGN;
  m->field = SV_TAKE(arena, uint8_t, m->field_bytes);
  m->depth = SV_TAKE(arena, float, sv_plane_floats(t.cap_width_px, t.cap_height_px));
  return arena->status < 0 ? sv_fail(err, arena->status, "no room for a mesh (%zu MiB)", m->field_bytes >> 20)
                           : SV_OK;
}

// --- surfaces ------------------------------------------------------------------------------------

static sv_status fuse_view(mesh_out *m, sv_mesh *mesh, sv_app *app, const sv_view *v) {
  sv_trainer *t = &app->trainer;
  const sv_render_options o = sv_train_render_options(t, 1.0f, false);
  const sv_status s = sv_render(&t->render, &t->g, v, &o);
  if (s < 0) return s;
  sv_render_surface(&t->render, &t->g, v, sv_surface_slab, m->depth);
  sv_mesh_fuse(mesh, &(sv_mesh_image){v, m->depth, &t->render.rgb}, &app->port.pool);
  return s;
}

static sv_status fuse(mesh_out *m, sv_mesh *mesh, sv_app *app, float voxel, sv_err *err) {
  sv_trainer *t = &app->trainer;
  sv_arena a = sv_arena_make(m->field, m->field_bytes);
  sv_mesh_cfg c = field_cfg(t->centre, t->radius);
  c.voxel = voxel;
  sv_status s = sv_mesh_init(mesh, &c, &a);
  if (s < 0)
    return sv_fail(err, s, "a mesh of voxels of %g within %g: %s", (double)voxel, (double)c.radius,
                   sv_status_text(s));
  for (int i = 0; i < sv_driver_n_views(t) && !mesh->is_full; i++) {
    const sv_view *v = sv_driver_view(t, i);
    sv_app_beat(app);
    if (sv_app_is_stop_requested(app))
      return sv_fail(err, SV_E_INTERRUPTED, "stopped by request before the mesh was saved; the model is");
    if ((s = fuse_view(m, mesh, app, v)) < 0)
      return sv_fail(err, s, "view %d cannot be rendered for the mesh: %s", i, sv_status_text(s));
  }
  if (mesh->is_full) return SV_E_FULL;
  return sv_mesh_extract(mesh, sv_maxi(1, sv_mini(MIN_VIEWS, sv_driver_n_views(t) / 5)));
}

// --- the file ------------------------------------------------------------------------------------

#pragma pack(push, 1)
typedef struct {
  float x[3];
  uint8_t rgb[3];
} file_vertex;
typedef struct {
  uint8_t n;
  int32_t v[3];
} file_face;
#pragma pack(pop)

#define PIECE 1024 // rows that are written at once

static sv_status write_rows(const sv_store *st, const sv_mesh *m, sv_err *err) {
  static file_vertex vertex[PIECE];
  static file_face face[PIECE];
  sv_status s = SV_OK;
  for (int i = 0; s >= 0 && i < m->n_vertices; i += PIECE) {
    const int n = sv_mini(PIECE, m->n_vertices - i);
    for (int k = 0; k < n; k++) {
      memcpy(vertex[k].x, m->vertex[i + k].x, sizeof vertex[k].x);
      memcpy(vertex[k].rgb, m->vertex[i + k].rgb, sizeof vertex[k].rgb);
    }
    s = st->write(st->self, vertex, (size_t)n * sizeof *vertex, err);
  }
  for (int i = 0; s >= 0 && i < m->n_triangles; i += PIECE) {
    const int n = sv_mini(PIECE, m->n_triangles - i);
    for (int k = 0; k < n; k++) {
      face[k].n = 3;
      memcpy(face[k].v, m->triangle[i + k].v, sizeof face[k].v);
    }
    s = st->write(st->self, face, (size_t)n * sizeof *face, err);
  }
  return s;
}

static sv_status write_ply(const sv_store *st, const sv_mesh *m, sv_unit unit, sv_err *err) {
  char header[512], sigma[64] = "";
  if (unit.scale_sigma > 0)
    sv_fmt(sigma, sizeof sigma, "comment scale_sigma: %.3g\n", (double)unit.scale_sigma);
  const size_t n = sv_fmt(header, sizeof header,
                          "ply\nformat binary_little_endian 1.0\ncomment subview\n%s%s"
                          "element vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
                          "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                          "element face %d\nproperty list uchar int vertex_indices\nend_header\n",
                          unit.is_metric ? "comment unit: m\n" : "", sigma, m->n_vertices, m->n_triangles);
  sv_status s = st->begin(st->self, "mesh.ply", err);
  if (s < 0) return s;
  s = st->write(st->self, header, n, err);
  if (s >= 0) s = write_rows(st, m, err);
  if (s >= 0) return st->commit(st->self, err);
  st->abandon(st->self);
  return s;
}

sv_status mesh_out_save(mesh_out *m, sv_app *app, sv_err *err) {
  sv_trainer *t = &app->trainer;
  sv_mesh mesh;
  float voxel = t->radius / VOXELS;
  sv_status s = fuse(m, &mesh, app, voxel, err);
  for (int i = 1; s == SV_E_FULL && i < N_TRIES; i++) s = fuse(m, &mesh, app, voxel *= COARSER, err);
  if (s == SV_E_FULL)
    return sv_fail(err, s, "the surface has too many voxels of %g for the mesh's memory; the model is saved",
                   (double)voxel);
  if (s < 0) return s;
  sv_mesh_drop_small(&mesh, SMALL);
  if (!mesh.n_triangles)
    return sv_fail(err, SV_E_RANGE, "no surface was seen by enough views: no mesh; the model is saved");
  m->n_vertices = mesh.n_vertices;
  m->n_triangles = mesh.n_triangles;
  m->voxel = (double)voxel;
  return write_ply(&app->port.store, &mesh, sv_app_unit(app), err);
}
