// SPDX-License-Identifier: Apache-2.0
// `raster` on 4x4 pixel blocks. raster_ref.c is the specification: same operations, same order.
#include "kernels/raster/raster.h"
#include "kernels/simd/v16.h"

// Unused: not all instruction sets need each of them.
#define INLINE static inline __attribute__((always_inline, unused))

typedef struct {
  v16 qc, v;
  v16 rgb[3], z;
} splat16;

INLINE void load_place(splat16 *q, const sv_splat *s) {
  q->qc = v16_set1(s->qc);
  q->v = v16_set1(s->v_px);
}

INLINE void load_colours(splat16 *q, const sv_splat *s) {
  for (int c = 0; c < 3; c++) q->rgb[c] = v16_set1(s->rgb[c]);
  q->z = v16_set1(s->z);
}

// Blending a block is a chain of dependent operations longer than most cores see ahead, and so is
// the exponential before it. Where registers allow, backward begins the next block's exponential
// before the present block is finished (1), and the power of the one after that before the
// exponential, and the next intersection before the present one is finished (2).
#define V_LOOKS_AHEAD (V16_PARTS == 1 ? 2 : V16_PARTS == 2 ? 1 : 0)

// Behind the state that the blocks are blended into: pixel centres of a tile's 32 columns, then of
// its eight rows of blocks, 16 lanes each. Where blocks of several rows are worked on at once
// (V_LOOKS_AHEAD), each has those of its row in its state, too: one address instead of two.
#define CENTRES (SV_RASTER_SCRATCH_FLOATS - 160)

// Of 16 columns, of a row of blocks. Sums of such small numbers are exact.
INLINE v16 centres_x(float x0, long first) {
  return v16_add(v16_set1(x0 + ((float)first + 0.5f)), v16_iota());
}
INLINE v16 centres_y(float y0, long row) {
  static const float in_block[16] = {0.5f, 0.5f, 0.5f, 0.5f, 1.5f, 1.5f, 1.5f, 1.5f,
                                     2.5f, 2.5f, 2.5f, 2.5f, 3.5f, 3.5f, 3.5f, 3.5f};
  return v16_add(v16_set1(y0 + (float)(4 * row)), v16_load(in_block));
}

INLINE void put_centres(float *scratch, float x0, float y0) {
  for (int i = 0; i < 2; i++) v16_store(scratch + CENTRES + 16 * i, centres_x(x0, 16 * i));
  for (int i = 0; i < 8; i++) v16_store(scratch + CENTRES + 32 + 16 * i, centres_y(y0, i));
}

INLINE const float *columns_x(const float *scratch) { return scratch + CENTRES; }
INLINE const float *row_y(const float *scratch, long block) {
  return scratch + CENTRES + 32 + 16 * (block >> 3);
}

INLINE void tile_origin(const sv_raster_args *a, uint32_t tile, float *x, float *y, long *offset) {
  int tx = (int)tile % a->n_tiles_x, ty = (int)tile / a->n_tiles_x;
  *x = (float)(tx * SV_TILE_PX);
  *y = (float)(ty * SV_TILE_PX);
  *offset = (long)ty * SV_TILE_PX * a->stride + tx * SV_TILE_PX;
}

INLINE long block_offset(int block, int stride) {
  return (long)(4 * (block >> 3)) * stride + 4 * (block & 7);
}

// A tile of a plane is 64 lines of the cache, eight for a row of blocks, and the planes of a
// image do not fit the nearest caches. The line that is fetched while `block` is read or written,
// one of the row of blocks below; -8..-1: of the first row.
#define FIRST_FETCH (-8)
INLINE int is_fetching(int block) { return block < SV_TILE_BLOCKS - 8; }
INLINE long line_below(int block, int stride) {
  return block_offset((block & ~7) + 8, stride) + (long)(block >> 1 & 3) * stride + 16 * (block & 1);
}

// Blocks side by side that are moved at once between a plane and the state.
#if V16_HAS_4X16
#define SIDE 4
INLINE void load_blocks(v16 out[SIDE], const float *p, long stride) { v16_load4x16(out, p, stride); }
INLINE void store_blocks(float *p, long stride, const v16 a[SIDE]) { v16_store4x16(p, stride, a); }
#else
#define SIDE 1
INLINE void load_blocks(v16 out[SIDE], const float *p, long stride) { out[0] = v16_load4x4(p, stride); }
INLINE void store_blocks(float *p, long stride, const v16 a[SIDE]) { v16_store4x4(p, stride, a[0]); }
#endif

// What the loop over a tile's list needs at hand: a store into an intersection might else have
// changed the arguments.
typedef struct {
  sv_intersection *intersection;
  const sv_splat *splat;
  const uint32_t *end;
} tile_list;

// Intersections and splats lie by Gaussian, a tile's anywhere. Eight intersections take half a
// microsecond or more.
#define AHEAD 8
INLINE void prefetch_ahead(const tile_list *l, const uint32_t *at, long ahead) {
  if (l->end - at > 2 * ahead) __builtin_prefetch(l->intersection + at[2 * ahead]);
  if (l->end - at > ahead) __builtin_prefetch(l->splat + l->intersection[at[ahead]].id);
}

// What a splat's power takes from the column of pixels alone: power = (qc dy + b) dy + c. Found
// once for 16 columns of a tile; all four rows of a block read the same four of them.
typedef struct {
  v16 b, c;
} column_terms;

INLINE column_terms columns_of(const sv_splat *s, v16 dx, v16 dx2) {
  return (column_terms){.b = v16_mul(v16_set1(s->qb), dx),
                        .c = v16_fma(v16_set1(s->qa), dx2, v16_set1(s->lo))};
}

#define LEFT_BLOCKS 0x0f0f0f0f0f0f0f0full // of a tile

// Of all of a tile's columns; dx2: squares.
typedef struct {
  float dx[32], dx2[32], b[32], c[32];
} splat_columns;

// Of those halves of the tile that mask has blocks in; where a half is one vector, of both: it
// takes less than a branch that cannot be foreseen. x: centres of all columns.
INLINE void find_columns(splat_columns *out, const sv_splat *s, uint64_t mask, const float *x) {
  for (int i = 0; i < 32; i += 16) {
    if (V16_REGISTERS < 32 && !(mask & LEFT_BLOCKS << i / 4)) continue;
    const v16 dx = v16_sub(v16_set1(s->u_px), v16_load(x + i)), dx2 = v16_mul(dx, dx);
    const column_terms t = columns_of(s, dx, dx2);
    v16_store(out->dx + i, dx);
    v16_store(out->dx2 + i, dx2);
    v16_store(out->b + i, t.b);
    v16_store(out->c + i, t.c);
  }
}

INLINE column_terms block_columns(const splat_columns *of, long block) {
  const long i = 4 * (block & 7);
  return (column_terms){v16_load_quad(of->b + i), v16_load_quad(of->c + i)};
}

INLINE v16 find_power(const splat16 *q, const column_terms *at, v16 dy) {
  return v16_fma(v16_fma(q->qc, dy, at->b), dy, at->c);
}

INLINE int is_other_row(long block, long other) { return (block ^ other) > 7; }

// A pointer that compilers take as it is: found as a whole, as an operand that has an index, too,
// is an instruction more within x86 cores, and to anywhere, so that what it points to is read
// there.
#define OPAQUE(pointer) __asm__("" : "+r"(pointer))

INLINE long lowest(uint64_t mask) { return (long)(uint32_t)__builtin_ctzll(mask); }

// What two loops over a splat's blocks differ in.
typedef struct {
  int has_depth;
  int has_err;  // backward: errors are summed, too
  int is_free;  // the splat's alpha stays below SV_ALPHA_MAX
  int is_small; // backward: of at most SV_RASTER_SMALL blocks
} blend_kind;

#include "kernels/raster/raster_fwd.inc"
#include "kernels/raster/raster_bwd.inc"
