// SPDX-License-Identifier: Apache-2.0
// The renderer and its backward pass: projection, binning, sorting and rasterization over a thread
// pool. Every stage works on ranges that do not depend on the thread count, and sums are folded in
// index order: the same bits for any number of threads.
// Owns intersections, per-intersection gradients and image planes, carved at init. Never changes a
// Gaussian.
#ifndef SV_SPLAT_RENDER_H
#define SV_SPLAT_RENDER_H

#include "src/image/planes.h"
#include "src/port/compute.h"
#include "src/rig/rig.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_RENDER_CHUNKS 16 // ranges of Gaussians that are binned independently

typedef struct {
  int cap_gaussians;
  int cap_width_px, cap_height_px; // each of any view
  size_t cap_pixels;               // of any view, padded: sv_plane_floats; 0: cap_width x
                                   // cap_height
  uint32_t cap_intersections;      // (splat, tile) pairs; 0: a default from the two above
  int n_threads;                   // scratch is per thread
  bool has_grad;                   // room for backward
} sv_renderer_cfg;

typedef struct {
  uint32_t n_visible, n_intersections;
  uint32_t n_dropped; // splats left out because cap_intersections was reached (the farthest ones)
} sv_render_stats;

typedef struct {
  sv_renderer_cfg cfg;
  sv_compute compute;
  sv_splat *splat;     // [cap]
  uint32_t *depth_key; // [cap]
  // [cap / 512 + 1] visible splats per range of 512 Gaussians, and their intersections
  uint32_t *n_in_range, *n_intersections_in_range;
  uint16_t *dropout_mask; // [cap / 16] a bit for each Gaussian that dropout leaves out
  // [cap_intersections and padding] by Gaussian; those of a splat lie side by side
  sv_intersection *intersection;
  // [cap_intersections] depth and intersection by tile, and scratch of the sort. Both lie in
  // `igrad`, which only the backward pass fills.
  sv_pair *pair, *tmp;
  uint32_t *list;       // [cap_intersections] intersections by tile, front to back
  uint32_t *tile_begin; // [n_tiles + 1]
  uint32_t *tile_order; // [n_tiles] tile of each task of the rasterization
  // [SV_RENDER_CHUNKS][n_tiles] counts, then write positions
  uint32_t *write_offset;
  uint32_t *write_end; // the same, where the positions end
  // a chunk's first intersection; where they and their padding end
  uint32_t chunk_begin[SV_RENDER_CHUNKS + 1];
  // as intersection, [SV_IGRAD_BYTES] each, NULL without has_grad
  uint8_t *igrad;
  float *scratch;       // [n_threads][SV_RASTER_SCRATCH_FLOATS]
  sv_planes rgb;        // the last image
  float *depth, *trans; // planes: sum of w z; 1 - alpha
  int n_tiles_x, n_tiles;
  sv_project_args project; // of the last forward pass
  sv_project_args moved;   // the same for the moved blocks [0, n_moved_blocks)
  int n_moved_blocks;
  sv_raster_args raster;
  sv_render_stats stats;
} sv_renderer;

size_t sv_renderer_bytes(const sv_renderer_cfg *cfg);
sv_status sv_renderer_init(sv_renderer *r, const sv_renderer_cfg *cfg, sv_compute compute,
                           sv_arena *arena) SV_MUST_USE;

typedef struct {
  int sh_degree;       // in use, at most the model's
  float near_z;        // world units
  bool is_antialiased; // Mip-Splatting's 2D compensation
  float dilation_px2;  // low-pass of the pixel grid; 0: SV_DILATION_PX2
  bool has_depth;      // fill r->depth and r->trans
  float bg[3];
  // Probability with which each Gaussian is dropped, in steps of 1/256; the opacities of the others
  // are divided by 1 - dropout (DropGaussian, Park et al. 2025).
  float dropout;
  uint32_t dropout_seed;
} sv_render_options;

// Renders into r->rgb; with has_depth, into r->depth and r->trans, too. E_RANGE when the view is
// larger than the caps.
sv_status sv_render(sv_renderer *r, const sv_gaussians *g, const sv_view *view,
                    const sv_render_options *o) SV_MUST_USE;

// Rasterization backward: gradients of the last image's planes to per-intersection gradients.
// g_depth and g_trans (with has_depth only) and err may be NULL. The planes have the image's
// stride; padding must be 0. Then call sv_render_bwd_block for each block of 16 Gaussians.
sv_status sv_render_bwd(sv_renderer *r, const sv_planes *g_rgb, const float *g_depth, const float *g_trans,
                        const float *err) SV_MUST_USE;
// The same for the tiles of one color of a checkerboard, at half the cost: 0 (that of the first
// tile) or 1. The per-intersection gradients of the other tiles are 0, as if
// g_rgb were 0 there.
sv_status sv_render_bwd_half(sv_renderer *r, const sv_planes *g_rgb, uint32_t colour) SV_MUST_USE;
// Regularisers added to the gradients of touched Gaussians: opacity sum(o) + scale sum(s).
typedef struct {
  float opacity, scale;
} sv_regularisers;

// Where the gradients of one block of 16 Gaussians go.
typedef struct {
  float *param; // [n_rows][16]
  float *err;   // [16]
  float *pose;  // [6], dL/d(omega, v) of a twist on cam_from_world. Or NULL
} sv_block_grads;

// reg may be NULL. i_thread picks the scratch. Returns the bits of the touched lanes.
uint32_t sv_render_bwd_block(const sv_renderer *r, int block, int i_thread, const sv_regularisers *reg,
                             const sv_block_grads *out);

// Pixel-splat pairs that the last image evaluated: 16 for each block of a mask.
uint64_t sv_render_count_pairs(const sv_renderer *r);

// Expected depth of the last image: sum w z / max(alpha, 1e-10), 0 where alpha <= alpha_min. out:
// plane with the image's stride.
void sv_render_expected_depth(const sv_renderer *r, float alpha_min, float *out);

// What the depth of a surface is taken from (kernels/surface/surface.h): what lies between two
// transmittances; then what is in front of the second, within this share of that depth (0: no such
// second pass).
typedef struct {
  float from, to, near;
} sv_depth_slab;
// Of surfaces: 0.75 to 0.6, then 2 %. A quarter of the light may go to floaters, and no more than
// the next 15 % decide: where there is little texture, much of what follows lies behind the surface
// (docs/notes/quality.md).
extern const sv_depth_slab sv_surface_slab;
// Depth of the surface in the last image, which showed g, a model that stands still, in the same
// view; 0: there is none. out: plane with the image's stride, padded as the image. No backward pass
// may follow: the splats lose their colors.
void sv_render_surface(sv_renderer *r, const sv_gaussians *g, const sv_view *view, sv_depth_slab slab,
                       float *out);

#ifdef __cplusplus
}
#endif
#endif
