// SPDX-License-Identifier: Apache-2.0
// A triangle mesh from depth images: a truncated signed distance field (Curless and Levoy 1996) in
// blocks of 8x8x8 voxels that a hash finds (Niessner et al. 2013), and its zero surface by surface
// nets (Gibson 1998): one vertex a cell that the surface crosses, one quad an edge. Owns the field
// and the mesh in the arena's memory. Never renders: images come from outside.
#ifndef SV_MESH_MESH_H
#define SV_MESH_MESH_H

#include "src/base/arena.h"
#include "src/image/planes.h"
#include "src/port/port.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_MESH_SIDE         8 // voxels of a block's edge
#define SV_MESH_BLOCK_VOXELS (SV_MESH_SIDE * SV_MESH_SIDE * SV_MESH_SIDE)
#define SV_MESH_TRUNCATION   4 // voxels on both sides of a surface in which the field is kept

typedef struct {
  float centre[3], radius; // of the ball in which surfaces are fused, world units
  float voxel;             // edge of a voxel, world units
  int cap_blocks, cap_vertices, cap_triangles;
} sv_mesh_cfg;

typedef struct {
  float distance; // to the surface over the truncation: 1 in front of it, below 0 behind
  uint8_t weight; // images that saw it; 0: unknown
  uint8_t rgb[3];
} sv_voxel;

typedef struct {
  float x[3];
  uint8_t rgb[3];
} sv_mesh_vertex;

typedef struct {
  int32_t v[3];
} sv_triangle;

typedef struct {
  sv_mesh_cfg cfg;
  int32_t *slot; // [n_slots] block at a place of the hash, -1: none
  int n_slots;   // a power of two
  struct {
    int32_t x[3];                          // in blocks
  } * block;                               // [cap_blocks]
  sv_voxel (*voxel)[SV_MESH_BLOCK_VOXELS]; // [cap_blocks], x fastest
  int32_t (*cell)[SV_MESH_BLOCK_VOXELS];   // [cap_blocks] vertex of the cell above each voxel, -1
  int n_blocks;
  bool is_full;           // there was no room for a block: parts of the surface are missing
  sv_mesh_vertex *vertex; // [cap_vertices]
  int32_t *group, *size;  // [cap_vertices] scratch of sv_mesh_drop_small
  sv_triangle *triangle;  // [cap_triangles]
  int n_vertices, n_triangles;
} sv_mesh;

// One image: depth along the optical axis (of a fisheye the distance from the camera), 0 where
// there is none, in the plane layout of rgb.
typedef struct {
  const sv_view *view;
  float *depth;         // [height][rgb->stride]; fusing makes it negative at depth edges
  const sv_planes *rgb; // 0..1
} sv_mesh_image;

size_t sv_mesh_bytes(const sv_mesh_cfg *cfg);
// E_ARG: a size is not positive, or there are more than 2^28 voxels' edges in the radius; E_NOMEM.
sv_status sv_mesh_init(sv_mesh *m, const sv_mesh_cfg *cfg, sv_arena *arena) SV_MUST_USE;
// Adds an image to the field. Pixels at depth edges do not count. The same field for any number of
// threads.
void sv_mesh_fuse(sv_mesh *m, const sv_mesh_image *im, const sv_pool *pool);
// The surface of what has been fused, seen by at least min_weight images. E_FULL: it has more
// vertices or triangles than there is room for, and is cut there.
sv_status sv_mesh_extract(sv_mesh *m, int min_weight) SV_MUST_USE;
// Removes connected parts with fewer vertices than this share of the largest one: floaters.
void sv_mesh_drop_small(sv_mesh *m, float share);
// At most so many triangles, by vertex clustering. The field is its scratch: nothing follows it.
// E_ARG below 1; E_NOMEM: the field has too few blocks for so many vertices.
sv_status sv_mesh_decimate(sv_mesh *m, int max_triangles) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
