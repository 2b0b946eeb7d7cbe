// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/model_formats.h"

#include <stdlib.h>
#include <string.h>

#include "platform/codec/gzip.h"
#include "src/base/str.h"
#include "src/format/axes.h"
#include "src/format/bytes.h"
#include "src/format/glb.h"
#include "src/format/splat_file.h"
#include "src/format/spz.h"
#include "tools/common/fileio.h"

#if defined(__has_include) && __has_include(<zstd.h>)
#include <zstd.h>
#define HAS_ZSTD 1
#else
#define HAS_ZSTD 0
#endif

#define CAP_N 4000000u

// --- .splat --------------------------------------------------------------------------------------

typedef struct {
  float order;
  int i;
} ranked;

// largest first; equal ones stay in the model's order
static int by_order(const void *a, const void *b) {
  const ranked *x = a, *y = b;
  return x->order > y->order ? -1 : x->order < y->order ? 1 : (x->i > y->i) - (x->i < y->i);
}

sv_status lab_write_splat(const sv_gaussians *g, const char *path, sv_err *err) {
  ranked *rank = malloc((size_t)g->n * sizeof *rank);
  uint8_t *out = malloc((size_t)g->n * SV_SPLAT_BYTES);
  sv_status s = rank && out ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, g->n);
  sv_gaussian v;
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    rank[i] = (ranked){sv_splat_order(&v), i};
  }
  if (s == SV_OK) qsort(rank, (size_t)g->n, sizeof *rank, by_order);
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussians_get(g, rank[i].i, &v);
    sv_splat_encode(&v, out + (size_t)i * SV_SPLAT_BYTES);
  }
  if (s == SV_OK) s = sv_file_write(path, out, (size_t)g->n * SV_SPLAT_BYTES, err);
  free(rank);
  free(out);
  return s;
}

// --- SPZ -----------------------------------------------------------------------------------------

#if HAS_ZSTD
static sv_status write_zstd(const sv_spz *z, const uint8_t *packed, const char *path, sv_err *err) {
  uint64_t sizes[SV_SPZ_N_STREAMS] = {0};
  uint8_t head[SV_SPZ_HEAD4_BYTES],
      *body = malloc(ZSTD_compressBound(sv_spz_bytes(z)) + 1024 * SV_SPZ_N_STREAMS);
  size_t n = 0, cap = ZSTD_compressBound(sv_spz_bytes(z)) + 1024 * SV_SPZ_N_STREAMS;
  sv_status s = body ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  for (int i = 0; s == SV_OK && i < SV_SPZ_N_STREAMS; i++) {
    size_t at, bytes;
    sv_spz_stream(z, i, &at, &bytes);
    if (!bytes) continue;
    size_t got = ZSTD_compress(body + n, cap - n, packed + at, bytes, 12);
    if (ZSTD_isError(got)) s = sv_fail(err, SV_E_NOMEM, "%s: %s", path, ZSTD_getErrorName(got));
    else {
      sizes[i] = got;
      n += got;
    }
  }
  sv_file f;
  if (s == SV_OK) s = sv_file_begin(&f, path, err);
  if (s == SV_OK) {
    size_t n_head = sv_spz_head4(z, sizes, head);
    s = sv_file_append(&f, head, n_head, err);
    if (s == SV_OK) s = sv_file_append(&f, body, n, err);
    if (s == SV_OK) s = sv_file_commit(&f, err);
    else sv_file_abandon(&f);
  }
  free(body);
  return s;
}

static sv_status unpack_zstd(sv_spz *z, const sv_file_data *file, uint8_t **packed, sv_err *err) {
  const char *path = file->name;
  const uint8_t *data = file->data;
  size_t at[SV_SPZ_N_STREAMS], compressed[SV_SPZ_N_STREAMS];
  sv_status s = sv_spz_open4(z, file, at, compressed, err);
  if (s < 0) return s;
  if (z->n < 1 || z->n > CAP_N)
    return sv_fail(err, SV_E_RANGE, "%s: %u Gaussians; expected 1 to %u", path, z->n, CAP_N);
  *packed = malloc(sv_spz_bytes(z));
  if (!*packed) return sv_fail(err, SV_E_NOMEM, "%s: no memory for %u Gaussians", path, z->n);
  for (int i = 0; i < SV_SPZ_N_STREAMS; i++) {
    size_t to, bytes;
    sv_spz_stream(z, i, &to, &bytes);
    if (bytes && ZSTD_decompress(*packed + to, bytes, data + at[i], compressed[i]) != bytes)
      return sv_fail(err, SV_E_FORMAT, "%s: stream %d is damaged", path, i);
  }
  return SV_OK;
}
#else
static sv_status write_zstd(const sv_spz *z, const uint8_t *packed, const char *path, sv_err *err) {
  (void)z;
  (void)packed;
  return sv_fail(err, SV_E_UNSUPPORTED, "%s: this build has no zstd; use SPZ version 2 or 3", path);
}
static sv_status unpack_zstd(sv_spz *z, const sv_file_data *file, uint8_t **packed, sv_err *err) {
  (void)z;
  (void)packed;
  return sv_fail(err, SV_E_UNSUPPORTED, "%s: SPZ version 4 needs zstd, which this build lacks", file->name);
}
#endif

sv_status lab_write_spz(const sv_gaussians *g, const sv_model_notes *notes, int version, const char *path,
                        sv_err *err) {
  sv_spz z = {.version = version,
              .n = (uint32_t)g->n,
              .sh_degree = g->sh_degree,
              .is_mip = notes->is_mip,
              .unit = notes->unit};
  uint8_t header[SV_SPZ_HEADER_BYTES], extra[SV_SPZ_UNIT_BYTES], *gz = NULL,
                                                                 *packed = malloc(sv_spz_bytes(&z));
  size_t bytes;
  sv_turn turn;
  sv_turn_upright(&turn, notes->up);
  if (!packed) return sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, g->n);
  for (int i = 0; i < g->n; i++) {
    sv_gaussian v;
    sv_gaussians_get(g, i, &v);
    sv_gaussian_turn_by(&v, &turn);
    sv_spz_put(&z, packed, (uint32_t)i, &v);
  }
  sv_spz_header(&z, header);
  sv_piece pieces[2] = {{header, sizeof header}, {packed, sv_spz_bytes(&z)}};
  const sv_piece unit = {extra, sv_spz_put_extra(&z, extra)};
  sv_status s =
      version == 4 ? write_zstd(&z, packed, path, err) : sv_gzip(pieces, 2, &unit, &gz, &bytes, err);
  if (s == SV_OK && version != 4) s = sv_file_write(path, gz, bytes, err);
  free(packed);
  free(gz);
  return s;
}

// --- GLB -----------------------------------------------------------------------------------------

sv_status lab_write_glb(const sv_gaussians *g, const sv_model_notes *notes, const char *path, sv_err *err) {
  sv_glb z = {.sh_degree = g->sh_degree, .unit = notes->unit};
  sv_gaussian v;
  sv_turn turn;
  sv_turn_upright(&turn, notes->up);
  for (int i = 0; i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    sv_gaussian_turn_by(&v, &turn);
    sv_glb_extend(&z, &v);
  }
  uint8_t *file = malloc(sv_glb_bytes(&z));
  if (!file) return sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, g->n);
  sv_status s = sv_glb_head(&z, file, err);
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    sv_gaussian_turn_by(&v, &turn);
    sv_glb_put(&z, file, (uint32_t)i, &v);
  }
  if (s == SV_OK) s = sv_file_write(path, file, sv_glb_bytes(&z), err);
  free(file);
  return s;
}

// --- reading -------------------------------------------------------------------------------------

static sv_status make_room(sv_gaussians *g, void **block, const char *path, uint32_t n, int degree,
                           sv_err *err) {
  if (n < 1 || n > CAP_N)
    return sv_fail(err, SV_E_RANGE, "%s: %u Gaussians; expected 1 to %u", path, n, CAP_N);
  size_t bytes = sv_gaussians_bytes((int)n, degree) + SV_ARENA_ALIGN;
  *block = malloc(bytes);
  if (!*block) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its %u Gaussians", path, n);
  sv_arena a = sv_arena_make(*block, bytes);
  sv_status s = sv_gaussians_init(g, (int)n, degree, &a);
  return s < 0 ? sv_fail(err, s, "%s: cannot hold %u Gaussians", path, n) : SV_OK;
}

static sv_status read_splat(sv_gaussians *g, void **block, const sv_file_data *file, sv_err *err) {
  const char *path = file->name;
  const uint8_t *d = file->data;
  const size_t bytes = file->bytes;
  if (bytes % SV_SPLAT_BYTES)
    return sv_fail(err, SV_E_FORMAT, "%s: %zu bytes; expected a multiple of %d", path, bytes, SV_SPLAT_BYTES);
  sv_status s = make_room(g, block, path, (uint32_t)(bytes / SV_SPLAT_BYTES), 0, err);
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussian v;
    sv_splat_decode(d + (size_t)i * SV_SPLAT_BYTES, &v);
    sv_gaussians_put(g, i, &v);
  }
  return s;
}

static sv_status read_spz(sv_gaussians *g, sv_model_notes *notes, void **block, const sv_file_data *file,
                          sv_err *err) {
  const char *path = file->name;
  sv_spz z;
  uint8_t *raw = NULL, *packed = NULL;
  size_t bytes;
  sv_status s;
  if (sv_spz_is_4(file->data, file->bytes)) s = unpack_zstd(&z, file, &packed, err);
  else {
    s = sv_gunzip(file, (size_t)CAP_N * 65 + SV_SPZ_HEADER_BYTES, &raw, &bytes, err);
    if (s == SV_OK) s = sv_spz_open(&z, &(sv_file_data){path, raw, bytes}, err);
    uint8_t extra[SV_GZIP_CAP_EXTRA];
    if (s == SV_OK) sv_spz_get_extra(&z, extra, sv_gzip_extra(file, extra));
  }
  if (s == SV_OK) s = make_room(g, block, path, z.n, z.sh_degree, err);
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussian v;
    sv_spz_get(&z, packed ? packed : raw + SV_SPZ_HEADER_BYTES, (uint32_t)i, &v);
    sv_gaussians_put(g, i, &v);
  }
  if (s == SV_OK) *notes = (sv_model_notes){.is_mip = z.is_mip, .unit = z.unit};
  free(raw);
  free(packed);
  return s;
}

static sv_status read_glb(sv_gaussians *g, sv_model_notes *notes, void **block, const sv_file_data *file,
                          sv_err *err) {
  const char *path = file->name;
  sv_glb_reader r;
  jsmntok_t *tok = malloc(SV_GLB_CAP_TOKENS * sizeof *tok);
  if (!tok) return sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  sv_status s = sv_glb_open(&r, file, tok, err);
  if (s == SV_OK) s = make_room(g, block, path, r.n, r.sh_degree, err);
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    sv_gaussian v;
    sv_glb_get(&r, (uint32_t)i, &v);
    sv_gaussians_put(g, i, &v);
  }
  if (s == SV_OK) notes->unit = r.unit;
  free(tok);
  return s;
}

static bool is_glb(const uint8_t *d, size_t n) { return n >= 4 && !memcmp(d, "glTF", 4); }
static bool is_spz(const uint8_t *d, size_t n) {
  return sv_spz_is_4(d, n) || (n >= 2 && d[0] == 0x1f && d[1] == 0x8b);
}

bool lab_is_viewer_format(const char *path, const void *data, size_t bytes) {
  return is_glb(data, bytes) || is_spz(data, bytes) || sv_str_eq(sv_path_extension(path), ".splat");
}

bool lab_is_upright(const char *path) {
  const char *kind = sv_path_extension(path);
  return sv_str_eq(kind, ".spz") || sv_str_eq(kind, ".glb");
}

void lab_turn_back(lab_model *m, lab_session *s, const char *path, const char *up, const lab_views *views) {
  sv_turn there, back;
  double r[9];
  if (!lab_is_upright(path)) return;
  if (!up) {
    const lab_scene scene = lab_scene_of(views);
    up = sv_up_name(scene.up);
  }
  sv_turn_upright(&there, up);
  if (there.is_none) return;
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) r[3 * i + k] = there.r[3 * k + i];
  sv_turn_make(&back, r);
  for (int i = 0; i < m->g.n; i++) {
    sv_gaussian g;
    sv_gaussians_get(&m->g, i, &g);
    sv_gaussian_turn_by(&g, &back);
    sv_gaussians_put(&m->g, i, &g);
  }
  lab_say(s, "%s: file is Y-up; rotated to the dataset's up axis %s (--up -y keeps it)", path, up);
}

sv_status lab_read_viewer_format(sv_gaussians *g, sv_model_notes *notes, void **block,
                                 const sv_file_data *file, sv_err *err) {
  *notes = (sv_model_notes){.is_mip = false};
  *block = NULL;
  sv_status s = is_glb(file->data, file->bytes)   ? read_glb(g, notes, block, file, err)
                : is_spz(file->data, file->bytes) ? read_spz(g, notes, block, file, err)
                                                  : read_splat(g, block, file, err);
  // Numbers that no model has: a file of another kind, or damage that the format cannot show.
  for (int i = 0; s == SV_OK && i < g->n; i++)
    for (int k = 0; k < g->n_rows; k++) {
      float v = *sv_gaussians_at(g, i, k);
      if (!(v > -1e30f && v < 1e30f))
        s = sv_fail(err, SV_E_FORMAT, "%s: Gaussian %d has values that are not finite", file->name, i);
    }
  if (s == SV_OK) return s;
  free(*block);
  *block = NULL;
  return s;
}
