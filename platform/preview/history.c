// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/history.h"

#if defined(__has_include) && __has_include(<microhttpd.h>)
#include <microhttpd.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/preview.h"
#include "platform/preview/range.h"
#include "src/format/axes.h"
#include "src/format/ply.h"
#include "src/format/sequence.h"

#define PIECE (32 << 10)
#define BYTES "application/octet-stream"

static pv_answer say(unsigned code, const char *text) {
  return (pv_answer){
      MHD_create_response_from_buffer(strlen(text), (void *)(uintptr_t)text, MHD_RESPMEM_MUST_COPY), code,
      "text/plain; charset=utf-8"};
}

// The newest snapshot, NULL: there is none.
static pv_blob *newest(pv_source *s) {
  const uint64_t seq = sv_feed_newest(&s->reader, SV_FEED_HISTORY);
  const size_t cap = (size_t)s->reader.ring[SV_FEED_HISTORY].slot_bytes;
  if (seq == 0 || (s->history && s->history->seq == seq)) return s->history;
  pv_blob *b = pv_blob_make(cap, 0);
  if (!b) return s->history;
  if (sv_feed_read(&s->reader, SV_FEED_HISTORY, &b->seq, b->data, cap, &b->bytes) != SV_OK) {
    pv_blob_drop(b);
    return s->history;
  }
  pv_blob_drop(s->history);
  return s->history = b;
}

// --- a part of the file --------------------------------------------------------------------------

typedef struct {
  pv_blob *blob;
  uint64_t from;
} part;

static ssize_t read_part(void *cls, uint64_t at, char *buf, size_t max) {
  const part *p = cls;
  const uint64_t left = p->blob->bytes - p->from - at;
  const size_t n = left < max ? (size_t)left : max;
  if (n == 0) return MHD_CONTENT_READER_END_OF_STREAM;
  memcpy(buf, p->blob->data + p->from + at, n);
  return (ssize_t)n;
}

static void drop_part(void *cls) {
  part *p = cls;
  pv_blob_drop(p->blob);
  free(p);
}

static pv_answer send_part(pv_blob *b, const pv_range *range, const char *file_name) {
  const uint64_t n = pv_range_bytes(range, b->bytes);
  if (n == 0) return say(MHD_HTTP_RANGE_NOT_SATISFIABLE, "the file ends before this\n");
  part *p = malloc(sizeof *p);
  pv_answer a = {NULL, range->is_part ? MHD_HTTP_PARTIAL_CONTENT : MHD_HTTP_OK, BYTES};
  if (!p) return a;
  *p = (part){b, pv_range_begin(range, b->bytes)};
  b->n_users++;
  a.response = MHD_create_response_from_callback(n, PIECE, read_part, p, drop_part);
  if (!a.response) {
    drop_part(p);
    return a;
  }
  pv_range_headers(range, b->bytes, a.response);
  MHD_add_response_header(a.response, "Content-Disposition", file_name);
  return a;
}

// --- the model at an instant ---------------------------------------------------------------------

static sv_status append(void *self, const void *data, size_t bytes, sv_err *err) {
  pv_blob *b = self; // `seq` is what is written so far
  if (bytes > b->bytes - b->seq) return sv_fail(err, SV_E_FULL, "the file is larger than planned");
  memcpy(b->data + b->seq, data, bytes);
  b->seq += bytes;
  return SV_OK;
}

static pv_blob *ply_of_frame(const sv_sequence_reader *r) {
  static sv_ply_writer w;
  sv_err err;
  const sv_ply_options o = {.n = r->head.n,
                            .sh_degree = r->head.sh_degree,
                            .is_mip = r->head.is_mip,
                            .has_normals = true,
                            .unit = r->head.unit,
                            .dilation_px2 = r->head.dilation_px2,
                            .up = *r->head.up ? r->head.up : SV_UP_DEFAULT};
  pv_blob *b = pv_blob_make(sv_ply_file_bytes(&o), 0);
  if (!b) return NULL;
  sv_status s = sv_ply_write_begin(&w, (sv_sink){b, append}, &o, &err);
  for (uint32_t i = 0; s >= 0 && i < r->head.n; i++) {
    sv_gaussian g;
    sv_sequence_get(r, i, &g);
    s = sv_ply_write_gaussian(&w, &g, &err);
  }
  if (s >= 0) s = sv_ply_write_end(&w, &err);
  if (s >= 0) return b;
  pv_blob_drop(b);
  return NULL;
}

// at: 0 to 1 from the first to the last frame.
static pv_answer send_ply(const pv_blob *file, double at) {
  sv_sequence_reader r;
  sv_err err;
  pv_blob *b = NULL;
  if (sv_sequence_open(&r, &(sv_file_data){"history", file->data, file->bytes}, &err) < 0)
    return say(MHD_HTTP_INTERNAL_SERVER_ERROR, "the history is damaged\n");
  void *state = malloc(sv_sequence_reader_bytes(&r.head));
  const uint32_t k = (uint32_t)(at * (double)(r.head.n_frames - 1) + 0.5);
  if (state && sv_sequence_read_base(&r, state, &err) >= 0 && sv_sequence_read_frame(&r, k, &err) >= 0)
    b = ply_of_frame(&r);
  free(state);
  if (!b) return say(MHD_HTTP_SERVICE_UNAVAILABLE, "no memory for this file\n");
  const pv_answer a =
      send_part(b, &(pv_range){0, UINT64_MAX, false}, "attachment; filename=\"subview-past.ply\"");
  pv_blob_drop(b); // the answer has it now
  return a;
}

// --- requests ------------------------------------------------------------------------------------

// Looking at the past changes nothing in the run, so it needs no control.
static pv_answer ask(pv_source *s) {
  const char byte = SV_PREVIEW_HISTORY;
  if (!(s->state.history_s > 0)) return say(MHD_HTTP_NOT_FOUND, "this run keeps no history\n");
  if (write(s->command_fd, &byte, 1) != 1)
    return say(MHD_HTTP_SERVICE_UNAVAILABLE, "the run accepts no commands at the moment\n");
  return say(MHD_HTTP_OK, "asked\n");
}

pv_answer pv_history_get(pv_source *s, struct MHD_Connection *c, const char *url, const char *range) {
  const char *n = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "n"),
             *at = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "at");
  const bool is_ply = !strcmp(url, "/history.ply");
  long long seq = 0;
  double t = 1;
  if (!strcmp(url, "/history")) return ask(s);
  if (!is_ply && strcmp(url, "/history.svseq") != 0) return say(MHD_HTTP_NOT_FOUND, "no such page\n");
  pv_blob *b = newest(s);
  const bool is_it = b && (!n || (sv_parse_int(n, strlen(n), &seq) && (uint64_t)seq == b->seq));
  if (!is_it) return say(MHD_HTTP_NOT_FOUND, "this part of the past is not there; ask for it again\n");
  if (at && !(sv_parse_double(at, strlen(at), &t) && t >= 0 && t <= 1))
    return say(MHD_HTTP_BAD_REQUEST, "expected at=T, a number from 0 to 1\n");
  if (is_ply) return send_ply(b, t);
  const pv_range r = pv_range_of(range);
  return send_part(b, &r, "attachment; filename=\"subview-past.svseq\"");
}
#endif
