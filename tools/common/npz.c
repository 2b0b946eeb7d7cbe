// SPDX-License-Identifier: Apache-2.0
#include "tools/common/npz.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "src/base/str.h"
#include "src/format/bytes.h"
#include "tools/common/fileio.h"

#define END_BYTES     22
#define CENTRAL_BYTES 46
#define LOCAL_BYTES   30
#define STORED        0
#define DEFLATED      8
#define CAP_COMMENT   65535
#define CAP_PACKING   1100 // deflate makes at most about 1,032 bytes of one

// --- .npy ----------------------------------------------------------------------------------------

// The value of a key of the header, which is the text of a Python dict: "'descr': '<f4', ...".
static const char *value_of(const char *head, const char *key) {
  char quoted[32];
  snprintf(quoted, sizeof quoted, "'%s':", key);
  const char *p = strstr(head, quoted);
  if (!p) return NULL;
  p += strlen(quoted);
  while (*p == ' ') p++;
  return p;
}

static sv_status read_type(sv_npy *a, const char *file, const char *descr, sv_err *err) {
  static const struct {
    char kind;
    int bytes[4];
  } known[] = {{'f', {2, 4, 8, 0}}, {'i', {1, 2, 4, 8}}, {'u', {1, 2, 4, 8}}, {'b', {1, 0, 0, 0}}};
  char order = 0, kind = 0;
  int bytes = 0;
  if (!descr || sscanf(descr, "'%c%c%6d'", &order, &kind, &bytes) != 3 || bytes < 1)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%s: array %s is no plain array of numbers or text (objects are not read)", file, a->name);
  if (order == '>' && bytes > 1)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: array %s is big-endian; expected little-endian", file,
                   a->name);
  bool is_known = (kind == 'U' || kind == 'S') && bytes <= 4096;
  for (size_t i = 0; i < sizeof known / sizeof *known; i++)
    for (int k = 0; k < 4; k++) is_known = is_known || (known[i].kind == kind && known[i].bytes[k] == bytes);
  if (!is_known || (order != '<' && order != '|' && order != '=' && order != '>'))
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: array %s has items of type %c%d; expected numbers or text",
                   file, a->name, kind, bytes);
  a->kind = kind;
  a->item_bytes = kind == 'U' ? 4 * bytes : bytes;
  return SV_OK;
}

static sv_status read_shape(sv_npy *a, const char *file, const char *shape, sv_err *err) {
  bool is_good = shape && *shape == '(';
  const char *p = is_good ? shape + 1 : "";
  a->n_items = 1;
  while (is_good && *p != ')') {
    unsigned long long n = 0;
    int used = 0;
    is_good = a->n_dims < SV_NPY_CAP_DIMS && *p >= '0' && *p <= '9' && sscanf(p, "%11llu%n", &n, &used) == 1;
    if (!is_good) break;
    p += used;
    is_good = n <= UINT32_MAX && (n == 0 || a->n_items <= UINT32_MAX / n);
    a->dim[a->n_dims++] = (size_t)n;
    a->n_items *= (size_t)n;
    while (*p == ',' || *p == ' ') p++;
  }
  return is_good
             ? SV_OK
             : sv_fail(err, SV_E_FORMAT, "%s: array %s has no shape of at most %d lengths below 4 GiB in all",
                       file, a->name, SV_NPY_CAP_DIMS);
}

static sv_status parse_array(sv_npy *a, const char *file, const uint8_t *p, size_t bytes, sv_err *err) {
  char head[4096];
  if (bytes < 12 || memcmp(p, "\x93NUMPY", 6) != 0 || p[6] < 1 || p[6] > 3)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s is not in NumPy's format", file, a->name);
  size_t at = p[6] == 1 ? 10 : 12, n = p[6] == 1 ? sv_le16(p + 8) : sv_le32(p + 8);
  if (n >= sizeof head || n > bytes - at)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s has a header of %zu bytes; expected at most %zu", file,
                   a->name, n, sizeof head - 1);
  memcpy(head, p + at, n);
  head[n] = 0;
  sv_status s = read_type(a, file, value_of(head, "descr"), err);
  if (s == SV_OK) s = read_shape(a, file, value_of(head, "shape"), err);
  if (s != SV_OK) return s;
  const char *order = value_of(head, "fortran_order");
  a->is_fortran = order && strncmp(order, "True", 4) == 0;
  a->data = p + at + n;
  size_t want = a->n_items * (size_t)a->item_bytes;
  return want <= bytes - at - n
             ? SV_OK
             : sv_fail(err, SV_E_FORMAT, "%s: array %s has %zu bytes of items; its shape needs %zu", file,
                       a->name, bytes - at - n, want);
}

sv_status sv_npy_parse(sv_npy *a, const sv_file_data *file, sv_err *err) {
  memset(a, 0, sizeof *a);
  const char *name = sv_path_name(file->name);
  snprintf(a->name, sizeof a->name, "%.*s", SV_NPZ_CAP_NAME - 1, name);
  return parse_array(a, file->name, (const uint8_t *)file->data, file->bytes, err);
}

void sv_npy_free(sv_npy *a) {
  free(a->block);
  memset(a, 0, sizeof *a);
}

bool sv_npy_is_shape(const sv_npy *a, int n_dims, const size_t *dim) {
  if (a->n_dims != n_dims) return false;
  for (int i = 0; i < n_dims; i++)
    if (dim[i] && a->dim[i] != dim[i]) return false;
  return true;
}

// Where item i of C's order is stored.
static const uint8_t *item_at(const sv_npy *a, size_t i) {
  size_t at = i;
  if (a->is_fortran) {
    at = 0;
    for (int k = a->n_dims - 1; k >= 0; k--) {
      size_t stride = 1;
      for (int m = 0; m < k; m++) stride *= a->dim[m];
      at += i % a->dim[k] * stride;
      i /= a->dim[k];
    }
  }
  return a->data + at * (size_t)a->item_bytes;
}

static double half(uint16_t h) {
  int e = h >> 10 & 31, m = h & 1023;
  double x = e == 31 ? (m ? (double)NAN : (double)INFINITY) : e ? ldexp(1024 + m, e - 25) : ldexp(m, -24);
  return h & 0x8000 ? -x : x;
}

double sv_npy_real(const sv_npy *a, size_t i) {
  if (i >= a->n_items) return (double)NAN;
  const uint8_t *p = item_at(a, i);
  uint64_t u = 0;
  if (a->kind == 'f')
    return a->item_bytes == 8 ? sv_lef64(p) : a->item_bytes == 4 ? (double)sv_lef32(p) : half(sv_le16(p));
  if (a->kind != 'i' && a->kind != 'u' && a->kind != 'b') return (double)NAN;
  for (int k = a->item_bytes - 1; k >= 0; k--) u = u << 8 | p[k];
  if (a->kind != 'i') return (double)u;
  uint64_t sign = (uint64_t)1 << (8 * a->item_bytes - 1);
  return u & sign ? -(double)((sign - 1) - (u & (sign - 1))) - 1 : (double)u;
}

static size_t put_utf8(char *out, uint32_t c) {
  if (c < 0x80) return out[0] = (char)c, 1;
  int n = c < 0x800 ? 2 : c < 0x10000 ? 3 : 4;
  for (int k = n - 1; k > 0; k--, c >>= 6) out[k] = (char)(0x80 | (c & 63));
  out[0] = (char)((0xF0 << (4 - n)) | (int)c);
  return (size_t)n;
}

bool sv_npy_text(const sv_npy *a, size_t i, char *out, size_t cap) {
  char one[4];
  size_t used = 0;
  if ((a->kind != 'U' && a->kind != 'S') || i >= a->n_items || cap < 1) return false;
  const uint8_t *p = item_at(a, i);
  const int step = a->kind == 'U' ? 4 : 1;
  for (int k = 0; k + step <= a->item_bytes; k += step) {
    uint32_t c = step == 4 ? sv_le32(p + k) : p[k];
    if (!c) break; // shorter texts are padded with zeros
    if (c > 0x10FFFF || (c >= 0xD800 && c < 0xE000)) return false;
    size_t n = put_utf8(one, c);
    if (used + n >= cap) return false;
    memcpy(out + used, one, n);
    used += n;
  }
  out[used] = 0;
  return true;
}

// --- the archive ---------------------------------------------------------------------------------

static const uint8_t *find_end(const sv_file_data *f) {
  const uint8_t *data = (const uint8_t *)f->data;
  if (f->bytes < END_BYTES) return NULL;
  size_t lowest = f->bytes > END_BYTES + CAP_COMMENT ? f->bytes - END_BYTES - CAP_COMMENT : 0;
  for (size_t at = f->bytes - END_BYTES + 1; at-- > lowest;)
    if (sv_le32(data + at) == 0x06054b50) return data + at;
  return NULL;
}

// One entry of the central directory; *at moves behind it.
static sv_status read_entry(sv_npz *z, size_t *at, size_t end, sv_err *err) {
  const uint8_t *p = (const uint8_t *)z->file.data + *at;
  const char *path = z->file.name;
  if (end - *at < CENTRAL_BYTES || sv_le32(p) != 0x02014b50)
    return sv_fail(err, SV_E_FORMAT, "%s: its list of files is damaged", path);
  size_t n_name = sv_le16(p + 28), total = CENTRAL_BYTES + n_name + sv_le16(p + 30) + sv_le16(p + 32);
  if (total > end - *at) return sv_fail(err, SV_E_FORMAT, "%s: its list of files is damaged", path);
  *at += total;
  if (n_name < 5 || memcmp(p + CENTRAL_BYTES + n_name - 4, ".npy", 4) != 0) return SV_OK;
  if (z->n_items == SV_NPZ_CAP_ITEMS)
    return sv_fail(err, SV_E_RANGE, "%s: has more than %d arrays", path, SV_NPZ_CAP_ITEMS);
  if (n_name - 4 >= SV_NPZ_CAP_NAME)
    return sv_fail(err, SV_E_RANGE, "%s: an array has a name longer than %d bytes", path,
                   SV_NPZ_CAP_NAME - 1);
  sv_npz_item *it = &z->item[z->n_items++];
  *it = (sv_npz_item){.method = sv_le16(p + 10),
                      .crc = sv_le32(p + 16),
                      .packed_bytes = sv_le32(p + 20),
                      .bytes = sv_le32(p + 24),
                      .local = sv_le32(p + 42)};
  memcpy(it->name, p + CENTRAL_BYTES, n_name - 4);
  if (sv_le16(p + 8) & 1) return sv_fail(err, SV_E_UNSUPPORTED, "%s: is encrypted", path);
  if (it->bytes == UINT32_MAX || it->packed_bytes == UINT32_MAX || it->local == UINT32_MAX)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: array %s is larger than 4 GiB", path, it->name);
  return SV_OK;
}

sv_status sv_npz_parse(sv_npz *z, const sv_file_data *file, sv_err *err) {
  memset(z, 0, sizeof *z);
  z->file = *file;
  const uint8_t *end = find_end(file);
  if (!end) return sv_fail(err, SV_E_FORMAT, "%s: is no .npz archive, or is cut off", file->name);
  size_t n = sv_le16(end + 10), bytes = sv_le32(end + 12), at = sv_le32(end + 16);
  size_t limit = (size_t)(end - (const uint8_t *)file->data);
  if (at > limit || bytes > limit - at)
    return sv_fail(err, SV_E_FORMAT, "%s: its list of files is damaged", file->name);
  sv_status s = SV_OK;
  for (size_t i = 0; i < n && s == SV_OK; i++) s = read_entry(z, &at, limit, err);
  return s;
}

sv_status sv_npz_open(sv_npz *z, const char *path, sv_err *err) {
  void *data = NULL;
  size_t bytes = 0;
  memset(z, 0, sizeof *z);
  sv_status s = sv_file_read(path, &data, &bytes, err);
  const sv_file_data file = {path, data, bytes};
  if (s == SV_OK) s = sv_npz_parse(z, &file, err);
  if (s == SV_OK) z->block = data;
  else free(data);
  return s;
}

void sv_npz_close(sv_npz *z) {
  free(z->block);
  memset(z, 0, sizeof *z);
}

static const sv_npz_item *find_item(const sv_npz *z, const char *name) {
  for (int i = 0; i < z->n_items; i++)
    if (sv_str_eq(z->item[i].name, name)) return &z->item[i];
  return NULL;
}

bool sv_npz_has(const sv_npz *z, const char *name) { return find_item(z, name) != NULL; }

static sv_status inflate_item(const sv_npz *z, const sv_npz_item *it, const uint8_t *packed, void **out,
                              sv_err *err) {
  // A size that deflate cannot reach is not believed, so that small files ask for little memory.
  if (it->bytes / CAP_PACKING > it->packed_bytes)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s is damaged: its size cannot be right", z->file.name,
                   it->name);
  z_stream s = {.next_in = (Bytef *)(uintptr_t)packed, .avail_in = (uInt)it->packed_bytes};
  *out = malloc(it->bytes + 1);
  if (!*out || inflateInit2(&s, -MAX_WBITS) != Z_OK)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the %zu bytes of array %s", z->file.name, it->bytes,
                   it->name);
  s.next_out = *out;
  s.avail_out = (uInt)it->bytes;
  int r = inflate(&s, Z_FINISH);
  size_t n = s.total_out;
  inflateEnd(&s);
  return r == Z_STREAM_END && n == it->bytes
             ? SV_OK
             : sv_fail(err, SV_E_FORMAT, "%s: array %s is damaged and cannot be inflated", z->file.name,
                       it->name);
}

static sv_status load_item(const sv_npz *z, const sv_npz_item *it, sv_npy *a, sv_err *err) {
  const uint8_t *data = (const uint8_t *)z->file.data;
  const size_t bytes = z->file.bytes;
  const char *path = z->file.name;
  snprintf(a->name, sizeof a->name, "%s", it->name);
  if (it->local > bytes || bytes - it->local < LOCAL_BYTES || sv_le32(data + it->local) != 0x04034b50)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s is not where the list of files says", path, it->name);
  size_t at = it->local + LOCAL_BYTES;
  size_t skip = (size_t)sv_le16(data + it->local + 26) + sv_le16(data + it->local + 28);
  if (skip > bytes - at || it->packed_bytes > bytes - at - skip)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s is cut off", path, it->name);
  const uint8_t *content = data + at + skip;
  if (it->method != STORED && it->method != DEFLATED)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: array %s is packed by method %d; expected stored or deflated",
                   path, it->name, it->method);
  if (it->method == STORED && it->bytes != it->packed_bytes)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s has two sizes", path, it->name);
  if (it->method == DEFLATED) {
    sv_status s = inflate_item(z, it, content, &a->block, err);
    if (s != SV_OK) return s;
    content = a->block;
  }
  if (crc32(0, content, (uInt)it->bytes) != it->crc)
    return sv_fail(err, SV_E_FORMAT, "%s: array %s is damaged: its checksum is wrong", path, it->name);
  return parse_array(a, path, content, it->bytes, err);
}

sv_status sv_npz_get(const sv_npz *z, const char *name, sv_npy *a, sv_err *err) {
  memset(a, 0, sizeof *a);
  const sv_npz_item *it = find_item(z, name);
  if (!it) {
    char text[200];
    sv_str list = sv_str_make(text, sizeof text);
    for (int i = 0; i < z->n_items && i < 6; i++) {
      if (i) sv_str_add(&list, ", ");
      sv_str_add(&list, "%s", z->item[i].name);
    }
    return sv_fail(err, SV_E_NOT_FOUND, "%s: has no array %s (it has: %s)", z->file.name, name,
                   z->n_items ? text : "none");
  }
  sv_status s = load_item(z, it, a, err);
  if (s != SV_OK) sv_npy_free(a);
  return s;
}
