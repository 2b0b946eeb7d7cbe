// SPDX-License-Identifier: Apache-2.0
// A deformation field that all moving Gaussians share, as in 4D Gaussian Splatting (Wu et al.
// 2024): six multi-resolution planes over x y z t, their samples multiplied (HexPlane, Cao &
// Johnson 2023), a linear trunk and heads of two layers, whose outputs are added to the stored
// values. Kernels: kernels/field/field.h.
//
// Two differences from the authors' implementation: time covers the whole plane (theirs uses the
// upper half), and the bounding box is that of the Gaussians when they begin to move. And one
// addition: what rigid bodies (bodies.h) carry, the field deforms in the body's own frame. Without
// bodies, which a field that was not distilled has none of, it is as in the paper.
// Owns parameters, moments and scratch. Never chooses which Gaussians move.
#ifndef SV_DEFORM_FIELD_H
#define SV_DEFORM_FIELD_H

#include "src/base/arena.h"
#include "src/deform/bodies.h"
#include "src/port/compute.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_FIELD_CAP_HEADS 5
#define SV_FIELD_CAP_WIDTH 128
#define SV_FIELD_TASK      32 // blocks whose gradients of the layers are summed together

typedef struct {
  int n_channels; // 16 or 32 per level
  int n_levels, mult[SV_FIELD_CAP_LEVELS];
  int base;        // grid points a side of level 1
  int n_times;     // grid points along time, the same on all levels: about the number of training
                   // times. Further points are determined by the smoothness loss alone.
  int width;       // of the layers, a multiple of 16
  bool is_shared;  // one head for position, rotation and scale; else one each
  bool has_colour; // heads for opacity and SH, too; not with is_shared
  float start;     // scale of the output layers' Xavier initialization; the authors' is 1
  // Weights: second differences along the second axis of planes of space, as the reference computes
  // them; second differences along time; distance of time planes from 1.
  float tv, smooth, l1_time;
  float lr_planes, lr_planes_end, lr_layers, lr_layers_end; // times the scene's radius
  bool has_grad;
  int n_threads;
  int cap_knots; // of rigid bodies; 0: there are none
} sv_field_cfg;

// By name: tiny, small, medium, dnerf, dynerf, hypernerf, dycheck, multiview (sizes and weights of
// the authors' configurations; the first three are for boards; n_times is set by the caller). False
// for others; *cfg then is untouched.
bool sv_field_preset(const char *name, sv_field_cfg *cfg);

typedef struct {
  int row, n;            // rows of a Gaussian to which its output is added
  size_t w1, b1, w2, b2; // offsets into param
} sv_field_head;

typedef struct {
  sv_field_cfg cfg;
  int cap, n_gaussian_rows, n_moving, n_heads, n_feature;
  sv_field_head head[SV_FIELD_CAP_HEADS];
  size_t plane_at[SV_FIELD_CAP_LEVELS][SV_FIELD_PLANES], plane_n[SV_FIELD_CAP_LEVELS][SV_FIELD_PLANES];
  // parameters: planes first, then the layers; multiples of 16
  size_t trunk_w, trunk_b, n_planes, n_param;
  float *param; // [n_param]
  // [n_param] as in kernels/adam/adam.h; NULL without has_grad
  uint16_t *m, *v;
  float *grad;       // [n_planes] of the planes, of one step
  float *layers;     // [cap / 16 / SV_FIELD_TASK + 1][n_param - n_planes] of the layers, by task
  float *part;       // [cap/16][16][n_levels][6][n_channels] of the planes' samples
  uint32_t *touched; // [cap/16]
  float *coord;      // [cap/16][4][16] of the last sv_field_at
  float *feature;    // [cap/16][n_feature][16] as coord
  float *moved;      // [cap/16][n_gaussian_rows][16]
  float *scratch;    // [n_threads][..]
  size_t n_scratch;
  float lo[3], inv[3]; // box: c = (x - lo) inv
  sv_bodies bodies;    // those of the motion that was distilled
} sv_field;

// E_ARG: a size is out of range; err names it.
sv_status sv_field_check(const sv_field_cfg *cfg, sv_err *err) SV_MUST_USE;
// E_ARG as sv_field_check.
sv_status sv_field_init(sv_field *f, const sv_field_cfg *cfg, const sv_gaussians *g,
                        sv_arena *arena) SV_MUST_USE;
// Random layers, planes of space in 0.1..0.5, planes of time at 1; the box: mean and three standard
// deviations of g.
void sv_field_reset(sv_field *f, const sv_gaussians *g, uint64_t seed);
// As sv_motion_at.
void sv_field_at(sv_field *f, const sv_compute *c, sv_gaussians *g, float t);
// One block at a time of its own, without the bodies' poses: fills f->moved and f->coord, which
// sv_field_bwd_block reads.
void sv_field_at_block(sv_field *f, const sv_kernels *k, const sv_gaussians *g, int block, int i_thread,
                       float t);

// Field backward of one block: adds to grad [rows][16] of the moved Gaussians the gradient of their
// positions through the field, and keeps the field's own gradients until sv_field_step. Gradients
// of what bodies carry are in the bodies' frames (sv_bodies_carry_bwd). Tasks of SV_FIELD_TASK
// blocks call it for each of their blocks in order, also when touched is 0.
void sv_field_bwd_block(sv_field *f, const sv_kernels *k, int block, int i_thread, uint32_t touched,
                        float *grad);
// Adam on planes and layers after all blocks; step counts from 1; progress 0..1 of the stage.
void sv_field_step(sv_field *f, const sv_compute *c, uint32_t step, float progress, float radius);
// The plane losses of one plane of one level; their gradient is added to grad [plane_n].
double sv_field_plane_loss(const sv_field *f, int level, int plane);
void sv_field_plane_loss_bwd(const sv_field *f, int level, int plane, float *grad);

#ifdef __cplusplus
}
#endif
#endif
