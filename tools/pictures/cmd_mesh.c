// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/mesh/mesh.h"
#include "tools/pictures/mesh_file.h"
#include "tools/pictures/surface.h"

#define VOXELS       128   // of the scene's radius, without --voxel
#define CAP_BLOCKS   60000 // 6 KiB each, as far as they are used
#define MIN_VIEWS    16    // that saw a surface; one in five of few
#define CAP_VERTICES 6000000
#define SMALL        0.02f // connected parts below this share of the largest are floaters

typedef struct {
  const lab_options *o;
  lab_session session;
  lab_surface surface;
  sv_mesh mesh;
  void *block;
} run;

static sv_status prepare(run *r, sv_err *err) {
  const lab_settings *st = &r->surface.settings;
  sv_status s = lab_surface_open(&r->surface, r->o, &r->session, "train", err);
  if (s != SV_OK) return s;
  sv_mesh_cfg c = {.radius = st->radius,
                   .voxel = r->o->voxel > 0 ? (float)r->o->voxel : st->radius / VOXELS,
                   .cap_blocks = CAP_BLOCKS,
                   .cap_vertices = CAP_VERTICES,
                   .cap_triangles = 2 * CAP_VERTICES};
  memcpy(c.centre, st->centre, sizeof c.centre);
  const size_t bytes = sv_mesh_bytes(&c) + SV_ARENA_ALIGN;
  r->block = malloc(bytes);
  if (!r->block) return sv_fail(err, SV_E_NOMEM, "no memory for a mesh (%zu bytes)", bytes);
  sv_arena a = sv_arena_make(r->block, bytes);
  s = sv_mesh_init(&r->mesh, &c, &a);
  return s < 0 ? sv_fail(err, s, "a mesh of voxels of %g within %g: %s", (double)c.voxel, (double)c.radius,
                         sv_status_text(s))
               : SV_OK;
}

static sv_status fuse(run *r, sv_err *err) {
  lab_surface *u = &r->surface;
  sv_console *c = &r->session.console;
  for (int i = 0; i < r->surface.views.n; i++) {
    const sv_view *v = &r->surface.views.frames[i].view;
    char line[80];
    if (c->is_stop_requested(c->self))
      return sv_fail(err, SV_E_INTERRUPTED, "stopped by request at view %d of %d", i, r->surface.views.n);
    const sv_status s = lab_surface_render(u, v, err);
    if (s != SV_OK) return s;
    lab_surface_depth(u, v, sv_surface_slab);
    sv_mesh_fuse(&r->mesh, &(sv_mesh_image){v, u->depth, &u->viewer.r.rgb}, &r->session.pool);
    sv_fmt(line, sizeof line, "fused %d of %d views, %d blocks", i + 1, r->surface.views.n, r->mesh.n_blocks);
    c->log(c->self, SV_LOG_LIVE, line);
  }
  return SV_OK;
}

static sv_status make(run *r, sv_err *err) {
  sv_mesh *m = &r->mesh;
  if (!lab_mesh_is_format(r->o->out))
    return sv_fail(err, SV_E_ARG, "%s: expected a name that ends in .ply, .obj or .glb", r->o->out);
  sv_status s = prepare(r, err);
  if (s == SV_OK && (r->surface.model.deform.kind || r->surface.model.sequence))
    s = sv_fail(err, SV_E_UNSUPPORTED, "%s: moves; meshes are of still models", r->o->model);
  if (s == SV_OK) s = fuse(r, err);
  if (s != SV_OK) return s;
  if (m->is_full)
    return sv_fail(err, SV_E_FULL, "the scene has more than %d blocks of voxels of %g: give a larger --voxel",
                   CAP_BLOCKS, (double)m->cfg.voxel);
  s = sv_mesh_extract(m, r->o->min_views > 0 ? (int)r->o->min_views
                                             : sv_maxi(1, sv_mini(MIN_VIEWS, r->surface.views.n / 5)));
  if (s < 0)
    return sv_fail(err, s, "the mesh has more than %d vertices: give a larger --voxel", CAP_VERTICES);
  sv_mesh_drop_small(m, SMALL);
  if (!m->n_triangles) return sv_fail(err, SV_E_RANGE, "no surface was seen by enough views");
  if (r->o->faces > 0 && (s = sv_mesh_decimate(m, (int)r->o->faces)) < 0)
    return sv_fail(err, s, "%d vertices are too many for --faces: give a larger --voxel", m->n_vertices);
  const sv_model_notes notes = lab_model_notes(&r->surface.model);
  s = lab_mesh_write(m, &notes, r->o->out, err);
  if (s == SV_OK)
    lab_say(&r->session, "%s: %d vertices, %d triangles, voxels of %g", r->o->out, m->n_vertices,
            m->n_triangles, (double)m->cfg.voxel);
  return s;
}

int lab_cmd_mesh(const lab_options *o) {
  sv_err err = {0};
  run r = {.o = o};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&r.session, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = make(&r, &err);
  sv_linux_console_finish(&r.session.lines);
  if (s != SV_OK) code = lab_failed(&r.session, &err);
  lab_session_stop(&r.session);
  free(r.block);
  lab_surface_close(&r.surface);
  return code;
}
