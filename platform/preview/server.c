// SPDX-License-Identifier: Apache-2.0
// Routes and connections. libmicrohttpd runs in the one thread of the process (epoll, external
// loop); a stream that has nothing new is suspended and resumed when the feed has moved. A path of
// a request is only ever compared with the routes below.
#include "platform/preview/access.h"
#include "platform/preview/history.h"
#include "platform/preview/preview.h"
#include "platform/preview/scan_routes.h"

#if defined(__has_include) && __has_include(<microhttpd.h>)
#include <arpa/inet.h>
#include <errno.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/linux/preview.h"

#define CAP_JSON     (48u << 10)
#define MOSAIC_NS    (100 * SV_NS_PER_MS)
#define LOOP_STEP_NS (20 * SV_NS_PER_MS)

typedef enum { STREAM_EVENTS, STREAM_CAMERAS, N_STREAMS } stream_kind;

typedef struct stream {
  struct MHD_Connection *connection;
  stream_kind kind;
  pv_blob *blob; // being sent
  size_t at;
  uint64_t seq; // of the newest that was sent
  bool is_begun, is_suspended;
  struct stream *next, *previous;
} stream;

// A connection, from accept to close.
typedef struct client {
  struct MHD_Connection *connection;
  sv_ns waits_since_ns; // for the rest of a request; 0: a request is being answered
  size_t n_body;
  struct client *next, *previous;
} client;

struct pv_server {
  pv_server_cfg cfg;
  struct MHD_Daemon *daemon;
  int epoll_fd;
  char machine[128], cookie[32];
  client *clients;
  stream *streams;
  pv_pin pin;
  pv_blob *newest[N_STREAMS];
  uint64_t n_states; // that the event stream had, of the runtime or of its heartbeats
  struct {
    uint64_t seq, n_changes;
    int stale_s;
  } told; // the newest of them
  sv_ns next_mosaic_ns;
  char json[CAP_JSON];
};

static struct pv_server the_server; // one of the process

static sv_ns now_ns(void) {
  sv_clock c = sv_linux_clock();
  return c.now_ns(c.self);
}

// --- answers -------------------------------------------------------------------------------------

static void add_headers(struct MHD_Response *r, const char *type) {
  MHD_add_response_header(r, "Content-Type", type);
  MHD_add_response_header(r, "Cache-Control", "no-store");
  MHD_add_response_header(r, "X-Content-Type-Options", "nosniff");
  MHD_add_response_header(r, "X-Frame-Options", "DENY");
  MHD_add_response_header(r, "Referrer-Policy", "no-referrer");
  MHD_add_response_header(r, "Cross-Origin-Resource-Policy", "same-origin");
  MHD_add_response_header(r, "Content-Security-Policy",
                          "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
                          "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; "
                          "frame-ancestors 'none'");
}

static enum MHD_Result finish(struct MHD_Connection *c, unsigned code, struct MHD_Response *r,
                              const char *type) {
  if (!r) return MHD_NO;
  add_headers(r, type);
  enum MHD_Result done = MHD_queue_response(c, code, r);
  MHD_destroy_response(r);
  return done;
}

static enum MHD_Result say(struct MHD_Connection *c, unsigned code, const char *text) {
  return finish(c, code,
                MHD_create_response_from_buffer(strlen(text), (void *)(uintptr_t)text, MHD_RESPMEM_MUST_COPY),
                "text/plain; charset=utf-8");
}

static void drop_blob(void *b) { pv_blob_drop(b); }

static ssize_t read_blob(void *cls, uint64_t at, char *buf, size_t max) {
  const pv_blob *b = cls;
  if (at >= b->bytes) return MHD_CONTENT_READER_END_OF_STREAM;
  size_t n = b->bytes - (size_t)at < max ? b->bytes - (size_t)at : max;
  memcpy(buf, b->data + at, n);
  return (ssize_t)n;
}

static struct MHD_Response *response_of(pv_blob *b) {
  b->n_users++;
  struct MHD_Response *r = MHD_create_response_from_callback(b->bytes, 32 << 10, read_blob, b, drop_blob);
  if (!r) pv_blob_drop(b);
  return r;
}

static enum MHD_Result send_blob(struct MHD_Connection *c, pv_blob *b, const char *type, const char *file) {
  char text[96];
  if (!b) return say(c, MHD_HTTP_NOT_FOUND, "not available yet\n");
  struct MHD_Response *r = response_of(b);
  if (!r) return MHD_NO;
  if (file) {
    sv_fmt(text, sizeof text, "attachment; filename=\"subview-%llu.%s\"", (unsigned long long)b->seq, file);
    MHD_add_response_header(r, "Content-Disposition", text);
  } else {
    sv_fmt(text, sizeof text, "%llu", (unsigned long long)b->seq);
    MHD_add_response_header(r, "X-Subview-Seq", text);
  }
  return finish(c, MHD_HTTP_OK, r, type);
}

typedef void (*json_fn)(const pv_source *s, sv_str *o);
static enum MHD_Result send_json(pv_server *s, struct MHD_Connection *c, json_fn fill) {
  sv_str o = sv_str_make(s->json, sizeof s->json);
  (void)pv_state_read(s->cfg.source);
  pv_stale_read(s->cfg.source);
  fill(s->cfg.source, &o);
  return finish(c, MHD_HTTP_OK, MHD_create_response_from_buffer(o.len, s->json, MHD_RESPMEM_MUST_COPY),
                "application/json");
}

// --- streams -------------------------------------------------------------------------------------

static ssize_t read_stream(void *cls, uint64_t pos, char *buf, size_t max) {
  stream *t = cls;
  // Of the first part; each part brings that of the next one
  static const char opening[] = PV_PART_HEAD;
  (void)pos;
  if (!t->is_begun && t->kind == STREAM_CAMERAS && max >= sizeof opening) {
    t->is_begun = true;
    memcpy(buf, opening, sizeof opening - 1);
    return sizeof opening - 1;
  }
  if (!t->blob) {
    pv_blob *b = the_server.newest[t->kind];
    if (!b || b->seq == t->seq) {
      t->is_suspended = true;
      MHD_suspend_connection(t->connection);
      return 0;
    }
    b->n_users++;
    t->blob = b;
    t->at = 0;
    t->seq = b->seq;
  }
  size_t n = t->blob->bytes - t->at < max ? t->blob->bytes - t->at : max;
  memcpy(buf, t->blob->data + t->at, n);
  t->at += n;
  if (t->at == t->blob->bytes) {
    pv_blob_drop(t->blob);
    t->blob = NULL;
  }
  return (ssize_t)n;
}

static void end_stream(void *cls) {
  stream *t = cls;
  if (t->previous) t->previous->next = t->next;
  else the_server.streams = t->next;
  if (t->next) t->next->previous = t->previous;
  pv_blob_drop(t->blob);
  free(t);
}

static enum MHD_Result open_stream(pv_server *s, struct MHD_Connection *c, stream_kind kind,
                                   const char *type) {
  stream *t = calloc(1, sizeof *t);
  if (!t) return MHD_NO;
  *t = (stream){.connection = c, .kind = kind, .seq = UINT64_MAX, .next = s->streams};
  if (t->next) t->next->previous = t;
  s->streams = t;
  return finish(c, MHD_HTTP_OK,
                MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, 16 << 10, read_stream, t, end_stream),
                type);
}

static bool has_stream(const pv_server *s, stream_kind kind) {
  for (const stream *t = s->streams; t; t = t->next)
    if (t->kind == kind) return true;
  return false;
}

static void resume(pv_server *s, stream_kind kind) {
  for (stream *t = s->streams; t; t = t->next)
    if (t->kind == kind && t->is_suspended) {
      t->is_suspended = false;
      MHD_resume_connection(t->connection);
    }
}

static void renew_state(pv_server *s) {
  const pv_source *p = s->cfg.source;
  (void)pv_state_read(s->cfg.source);
  pv_stale_read(s->cfg.source);
  pv_control_step(&s->cfg.source->control, now_ns());
  if (s->told.seq != p->state_seq || s->told.stale_s != p->stale_s ||
      s->told.n_changes != p->control.n_changes)
    s->n_states++;
  s->told.seq = p->state_seq;
  s->told.n_changes = p->control.n_changes;
  s->told.stale_s = p->stale_s;
  const pv_blob *newest = s->newest[STREAM_EVENTS];
  if (!has_stream(s, STREAM_EVENTS) || (newest && newest->seq == s->n_states)) return;
  sv_str o = sv_str_make(s->json, sizeof s->json);
  sv_str_add(&o, "data: ");
  pv_state_json(s->cfg.source, &o);
  sv_str_add(&o, "\n\n");
  pv_blob *b = o.is_cut ? NULL : pv_blob_make(o.len, s->n_states);
  if (!b) return;
  memcpy(b->data, s->json, o.len);
  pv_blob_drop(s->newest[STREAM_EVENTS]);
  s->newest[STREAM_EVENTS] = b;
  resume(s, STREAM_EVENTS);
}

static void renew_cameras(pv_server *s, sv_ns now) {
  if (now < s->next_mosaic_ns || !has_stream(s, STREAM_CAMERAS)) return;
  pv_source *p = s->cfg.source;
  s->next_mosaic_ns = now + MOSAIC_NS;
  (void)pv_mosaic_read(p);
  if (!p->mosaic || p->mosaic == s->newest[STREAM_CAMERAS]) return;
  pv_blob_drop(s->newest[STREAM_CAMERAS]);
  p->mosaic->n_users++;
  s->newest[STREAM_CAMERAS] = p->mosaic;
  resume(s, STREAM_CAMERAS);
}

// --- requests ------------------------------------------------------------------------------------

static const char *header(struct MHD_Connection *c, const char *name) {
  return MHD_lookup_connection_value(c, MHD_HEADER_KIND, name);
}

static const char *scheme_of(const pv_server *s) { return s->cfg.tls_pem ? "https" : "http"; }

static const char *page_of(struct MHD_Connection *c) { return header(c, "X-Subview-Page"); }

static bool has_token(const pv_server *s, struct MHD_Connection *c, bool is_to_read) {
  if (pv_token_is(header(c, "X-Subview-Token"), s->cfg.token)) return true;
  return is_to_read &&
         pv_token_is(MHD_lookup_connection_value(c, MHD_COOKIE_KIND, s->cookie), s->cfg.read_key);
}

static enum MHD_Result refuse_token(struct MHD_Connection *c) {
  return say(c, MHD_HTTP_FORBIDDEN, "the token is missing or wrong: open the link that subview printed\n");
}

// For links that show and cannot control: what reading takes, where it takes anything.
static enum MHD_Result get_look_key(const pv_server *s, struct MHD_Connection *c) {
  if (!has_token(s, c, false)) return refuse_token(c);
  return say(c, MHD_HTTP_OK, s->cfg.is_private ? s->cfg.read_key : "");
}

static enum MHD_Result refuse_watcher(struct MHD_Connection *c) {
  return say(c, MHD_HTTP_LOCKED, "another device controls this run: ask for control first\n");
}

// Scripts cannot read the cookie, other sites' requests do not carry it, and it allows reading
// alone.
static enum MHD_Result enter(pv_server *s, struct MHD_Connection *c) {
  char text[PV_CAP_TOKEN + 96];
  const bool has_all = has_token(s, c, false);
  if (!has_all && !pv_token_is(header(c, "X-Subview-Token"), s->cfg.read_key)) return refuse_token(c);
  const uint32_t seat = has_all ? pv_control_enter(&s->cfg.source->control, page_of(c), now_ns()) : 0;
  struct MHD_Response *r = MHD_create_response_from_buffer(0, (void *)(uintptr_t) "", MHD_RESPMEM_PERSISTENT);
  sv_fmt(text, sizeof text, "%s=%s; Path=/; HttpOnly; SameSite=Strict%s", s->cookie, s->cfg.read_key,
         s->cfg.tls_pem ? "; Secure" : "");
  if (r && s->cfg.read_key[0]) MHD_add_response_header(r, "Set-Cookie", text);
  sv_fmt(text, sizeof text, "%u", seat);
  if (r) MHD_add_response_header(r, "X-Subview-Seat", text);
  return finish(c, MHD_HTTP_NO_CONTENT, r, "text/plain; charset=utf-8");
}

// Asking for control, and the answers of the page that has it.
static enum MHD_Result post_control(pv_server *s, struct MHD_Connection *c, const char *url) {
  pv_control *control = &s->cfg.source->control;
  const bool is_ask = !strcmp(url, "/ask");
  const bool is_done = is_ask ? pv_control_ask(control, page_of(c), now_ns())
                              : pv_control_answer(control, page_of(c), !strcmp(url, "/give"));
  if (is_done) return say(c, MHD_HTTP_OK, "done\n");
  return say(c, MHD_HTTP_CONFLICT, is_ask ? "this page has to be opened first\n" : "nobody asks this page\n");
}

// Another device: its code, its PIN, and the token for the PIN.
static enum MHD_Result post_access(pv_server *s, struct MHD_Connection *c, const char *url) {
  const char *token = s->cfg.token;
  pv_answer a;
  if (!strcmp(url, "/pair")) a = pv_pair(&s->pin, header(c, "X-Subview-Pin"), token, now_ns());
  else if (!has_token(s, c, false)) return refuse_token(c);
  else if (!strcmp(url, "/pin")) a = pv_pin_new(&s->pin, now_ns());
  else a = pv_link_code(scheme_of(s), header(c, "Host"), token);
  return finish(c, a.code, a.response, a.type);
}

static enum MHD_Result post_scan(pv_server *s, struct MHD_Connection *c, const char *url) {
  if (!has_token(s, c, false)) return refuse_token(c);
  if (!pv_control_may(&s->cfg.source->control, page_of(c))) return refuse_watcher(c);
  const pv_answer a = pv_scan_post(s->cfg.source, url);
  return finish(c, a.code, a.response, a.type);
}

static enum MHD_Result post_command(pv_server *s, struct MHD_Connection *c, const void *bytes, size_t n) {
  if (!has_token(s, c, false)) return refuse_token(c);
  if (!pv_control_may(&s->cfg.source->control, page_of(c))) return refuse_watcher(c);
  if (write(s->cfg.command_fd, bytes, n) == (ssize_t)n) return say(c, MHD_HTTP_OK, "asked\n");
  return say(c, MHD_HTTP_SERVICE_UNAVAILABLE, "the run accepts no commands at the moment\n");
}

static enum MHD_Result post(pv_server *s, struct MHD_Connection *c, const char *url) {
  static const struct {
    const char *url;
    char byte;
  } commands[] = {{"/start", SV_PREVIEW_START}, {"/pause", SV_PREVIEW_PAUSE}, {"/save", SV_PREVIEW_SAVE},
                  {"/new", SV_PREVIEW_NEW},     {"/draft", SV_PREVIEW_DRAFT}, {"/normal", SV_PREVIEW_NORMAL},
                  {"/fine", SV_PREVIEW_FINE}};
  if (!strcmp(url, "/enter")) return enter(s, c);
  if (!strncmp(url, "/scan/", 6)) return post_scan(s, c, url);
  if (!strcmp(url, "/pair") || !strcmp(url, "/pin") || !strcmp(url, "/qr")) return post_access(s, c, url);
  if (!strcmp(url, "/ask") || !strcmp(url, "/give") || !strcmp(url, "/keep"))
    return has_token(s, c, false) ? post_control(s, c, url) : refuse_token(c);
  for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
    if (!strcmp(url, commands[i].url)) return post_command(s, c, &commands[i].byte, 1);
  if (!strcmp(url, "/mode")) {
    const char *text = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "i");
    long long i;
    if (!text || !sv_parse_int(text, strlen(text), &i) || i < 0 || i >= SV_FEED_CAP_MODES)
      return say(c, MHD_HTTP_BAD_REQUEST, "expected i=N, the number of a mode\n");
    return post_command(s, c, (const uint8_t[]){SV_PREVIEW_MODE, (uint8_t)i}, 2);
  }
  if (!strcmp(url, "/calibrate")) {
    uint8_t bytes[6];
    if (!has_token(s, c, false)) return refuse_token(c);
    if (!pv_calibrate_command(c, bytes))
      return say(c, MHD_HTTP_BAD_REQUEST, "expected board=9x6, mm=24 and lens=normal or fisheye\n");
    return post_command(s, c, bytes, sizeof bytes);
  }
  return say(c, MHD_HTTP_NOT_FOUND, "no such page\n");
}

static enum MHD_Result get_model(pv_server *s, struct MHD_Connection *c) {
  const char *after = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "after");
  long long seen = -1;
  if (after && !sv_parse_int(after, strlen(after), &seen)) seen = -1;
  pv_blob *b = pv_model_compact(s->cfg.source);
  if (b && seen >= 0 && (uint64_t)seen == b->seq)
    return finish(c, MHD_HTTP_NO_CONTENT,
                  MHD_create_response_from_buffer(0, (void *)(uintptr_t) "", MHD_RESPMEM_PERSISTENT),
                  "application/octet-stream");
  return send_blob(c, b, "application/octet-stream", NULL);
}

// Looking is reading, so that it needs no control; the runtime is told a few times a second.
static enum MHD_Result get_camera(pv_server *s, struct MHD_Connection *c) {
  const char *text = MHD_lookup_connection_value(c, MHD_GET_ARGUMENT_KIND, "i");
  pv_source *p = s->cfg.source;
  long long i;
  if (!text || !sv_parse_int(text, strlen(text), &i) || i < 0 || i >= SV_FEED_CAP_TILES)
    return say(c, MHD_HTTP_BAD_REQUEST, "expected i=N, the number of a camera\n");
  const uint8_t look[2] = {SV_PREVIEW_LOOK, (uint8_t)i};
  if (now_ns() >= p->next_look_ns[i] && write(s->cfg.command_fd, look, 2) == 2)
    p->next_look_ns[i] = now_ns() + SV_NS_PER_S / 2;
  return send_blob(c, pv_camera_jpeg(p, (int)i), "image/jpeg", NULL);
}

static enum MHD_Result get(pv_server *s, struct MHD_Connection *c, const char *url) {
  pv_source *p = s->cfg.source;
  const pv_page *page;
  for (int i = 0; (page = pv_bundle(i)); i++)
    if (!strcmp(url, page->path))
      return finish(
          c, MHD_HTTP_OK,
          MHD_create_response_from_buffer(page->bytes, (void *)(uintptr_t)page->text, MHD_RESPMEM_PERSISTENT),
          page->type);
  if (!strcmp(url, "/look-key")) return get_look_key(s, c);
  if (!strcmp(url, "/board.svg") || !strcmp(url, "/board.pdf")) {
    const pv_answer a = pv_board(c, !strcmp(url, "/board.pdf"));
    return finish(c, a.code, a.response, a.type);
  }
  const bool is_scan = !strncmp(url, "/scan", 5);
  if (is_scan || !strncmp(url, "/history", 8)) {
    if (s->cfg.is_private && !has_token(s, c, true)) return refuse_token(c);
    const char *range = header(c, "Range");
    const pv_answer a = is_scan ? pv_scan_get(p, url, range) : pv_history_get(p, c, url, range);
    return finish(c, a.code, a.response, a.type);
  }
  static const char *const data[] = {"/state",       "/curve",       "/events", "/stream",
                                     "/cameras",     "/picture.jpg", "/model",  "/model.ply",
                                     "/model.splat", "/model.spz",   "/camera", "/calibration"};
  size_t i = 0;
  while (i < sizeof data / sizeof *data && strcmp(url, data[i])) i++;
  if (i == sizeof data / sizeof *data) return say(c, MHD_HTTP_NOT_FOUND, "no such page\n");
  if (s->cfg.is_private && !has_token(s, c, true)) return refuse_token(c);
  switch (i) {
  case 0: return send_json(s, c, pv_state_json);
  case 1: return send_json(s, c, pv_curve_json);
  case 2: return send_json(s, c, pv_events_json);
  case 3: return open_stream(s, c, STREAM_EVENTS, "text/event-stream");
  case 4: return open_stream(s, c, STREAM_CAMERAS, "multipart/x-mixed-replace; boundary=frame");
  case 5: return send_blob(c, pv_picture_jpeg(p), "image/jpeg", NULL);
  case 6: return get_model(s, c);
  case 7: return send_blob(c, pv_model_file(p, PV_PLY), "application/octet-stream", "ply");
  case 8: return send_blob(c, pv_model_file(p, PV_SPLAT), "application/octet-stream", "splat");
  case 9: return send_blob(c, pv_model_file(p, PV_SPZ), "application/octet-stream", "spz");
  case 10: return get_camera(s, c);
  default: return send_json(s, c, pv_calibration_json);
  }
}

static client *client_of(struct MHD_Connection *c) {
  const union MHD_ConnectionInfo *i = MHD_get_connection_info(c, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
  return i ? i->socket_context : NULL;
}

static enum MHD_Result answer(void *cls, struct MHD_Connection *c, const char *url, const char *method,
                              const char *version, const char *body, size_t *n_body, void **request) {
  static int seen;
  pv_server *s = cls;
  client *cl = client_of(c);
  (void)version, (void)body;
  if (!cl) return MHD_NO;
  if (!*request) { // headers are here, a body may follow
    *request = &seen;
    cl->n_body = 0;
    return MHD_YES;
  }
  if (*n_body) { // no request of ours has one
    cl->n_body += *n_body;
    *n_body = 0;
    return cl->n_body > PV_CAP_BODY ? MHD_NO : MHD_YES;
  }
  cl->waits_since_ns = 0;
  const char *host = header(c, "Host");
  if (!pv_host_is_ours(host, s->cfg.port, s->machine))
    return say(c, MHD_HTTP_FORBIDDEN, "unknown host name: open the link that subview printed\n");
  const char *site = header(c, "Sec-Fetch-Site");
  if (!pv_origin_is_ours(header(c, "Origin"), scheme_of(s), host) ||
      (site && !strcmp(site, "cross-site") && strcmp(url, "/")))
    return say(c, MHD_HTTP_FORBIDDEN, "refused: the request comes from another site\n");
  if (!strcmp(method, "GET") || !strcmp(method, "HEAD")) return get(s, c, url);
  if (!strcmp(method, "POST")) return post(s, c, url);
  return say(c, MHD_HTTP_METHOD_NOT_ALLOWED, "GET or POST\n");
}

// --- connections ---------------------------------------------------------------------------------

static void on_connection(void *cls, struct MHD_Connection *c, void **context,
                          enum MHD_ConnectionNotificationCode code) {
  pv_server *s = cls;
  if (code == MHD_CONNECTION_NOTIFY_STARTED) {
    client *cl = calloc(1, sizeof *cl);
    *context = cl;
    if (!cl) return;
    *cl = (client){.connection = c, .waits_since_ns = now_ns(), .next = s->clients};
    if (cl->next) cl->next->previous = cl;
    s->clients = cl;
    return;
  }
  client *cl = *context;
  if (!cl) return;
  if (cl->previous) cl->previous->next = cl->next;
  else s->clients = cl->next;
  if (cl->next) cl->next->previous = cl->previous;
  free(cl);
  *context = NULL;
}

static void on_completed(void *cls, struct MHD_Connection *c, void **request,
                         enum MHD_RequestTerminationCode code) {
  client *cl = client_of(c);
  (void)cls, (void)request, (void)code;
  if (cl) cl->waits_since_ns = now_ns(); // the next request of this connection
}

// The library's own time limit starts anew with every byte; a client that sends one now and then
// would stay.
static void end_slow_clients(pv_server *s, sv_ns now) {
  for (client *cl = s->clients; cl; cl = cl->next) {
    if (!cl->waits_since_ns || now - cl->waits_since_ns < PV_REQUEST_S * SV_NS_PER_S) continue;
    const union MHD_ConnectionInfo *i =
        MHD_get_connection_info(cl->connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    if (i) shutdown(i->connect_fd, SHUT_RDWR);
    cl->waits_since_ns = now; // once
  }
}

// Paths are compared as they were sent: ours have nothing to unescape, and an escaped one is not
// ours.
static size_t keep_escapes(void *cls, struct MHD_Connection *c, char *text) {
  (void)cls, (void)c;
  return strlen(text);
}

static void no_log(void *cls, const char *fmt, va_list ap) { (void)cls, (void)fmt, (void)ap; }

static int listen_on(const pv_server_cfg *cfg, sv_err *err) {
  bool is_v6 = strchr(cfg->addr, ':') != NULL;
  struct sockaddr_in a4 = {.sin_family = AF_INET, .sin_port = htons((uint16_t)cfg->port)};
  struct sockaddr_in6 a6 = {.sin6_family = AF_INET6, .sin6_port = htons((uint16_t)cfg->port)};
  const void *where = is_v6 ? (const void *)&a6 : (const void *)&a4;
  if (inet_pton(is_v6 ? AF_INET6 : AF_INET, cfg->addr,
                is_v6 ? (void *)&a6.sin6_addr : (void *)&a4.sin_addr) != 1) {
    sv_fail(err, SV_E_ARG, "%s: not a numeric address", cfg->addr);
    return -1;
  }
  int fd = socket(is_v6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0), on = 1;
  if (fd >= 0) setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (fd >= 0 && bind(fd, where, is_v6 ? sizeof a6 : sizeof a4) == 0 && listen(fd, 64) == 0) return fd;
  const bool is_low = errno == EACCES && cfg->port < 1024;
  sv_fail(err, SV_E_DEVICE, is_v6 ? "[%s]:%d: cannot listen: %s%s" : "%s:%d: cannot listen: %s%s", cfg->addr,
          cfg->port, sv_linux_reason(errno), is_low ? " for ports below 1024" : "");
  if (fd >= 0) close(fd);
  return -1;
}

sv_status pv_server_open(pv_server **out, const pv_server_cfg *cfg, sv_err *err) {
  pv_server *s = *out = &the_server;
  s->cfg = *cfg;
  if (gethostname(s->machine, sizeof s->machine - 1) != 0) s->machine[0] = 0;
  sv_fmt(s->cookie, sizeof s->cookie, "subview-%d", cfg->port);
  int fd = listen_on(cfg, err);
  if (fd < 0) return SV_E_DEVICE;
  const struct MHD_OptionItem tls[] = {{MHD_OPTION_HTTPS_MEM_KEY, 0, (void *)(uintptr_t)cfg->tls_pem},
                                       {MHD_OPTION_HTTPS_MEM_CERT, 0, (void *)(uintptr_t)cfg->tls_pem},
                                       {MHD_OPTION_END, 0, NULL}},
                              none[] = {{MHD_OPTION_END, 0, NULL}};
  if (cfg->tls_pem && MHD_is_feature_supported(MHD_FEATURE_TLS) != MHD_YES) {
    close(fd);
    return sv_fail(err, SV_E_UNSUPPORTED, "--tls: the HTTP server of this machine was built without TLS");
  }
  s->daemon = MHD_start_daemon(
      (cfg->tls_pem ? MHD_USE_TLS : 0u) | MHD_USE_EPOLL | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG,
      (uint16_t)cfg->port, NULL, NULL, answer, s, MHD_OPTION_EXTERNAL_LOGGER, no_log, NULL,
      MHD_OPTION_UNESCAPE_CALLBACK, keep_escapes, NULL, MHD_OPTION_LISTEN_SOCKET, fd,
      MHD_OPTION_CONNECTION_LIMIT, (unsigned)PV_CAP_CONNECTIONS, MHD_OPTION_PER_IP_CONNECTION_LIMIT,
      (unsigned)PV_CAP_PER_ADDRESS, MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)PV_CONNECTION_MEM,
      MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)PV_IDLE_S, MHD_OPTION_NOTIFY_CONNECTION, on_connection, s,
      MHD_OPTION_NOTIFY_COMPLETED, on_completed, s, MHD_OPTION_ARRAY, cfg->tls_pem ? tls : none,
      MHD_OPTION_END);
  const union MHD_DaemonInfo *i = s->daemon ? MHD_get_daemon_info(s->daemon, MHD_DAEMON_INFO_EPOLL_FD) : NULL;
  if (!i) {
    close(fd);
    return sv_fail(err, SV_E_DEVICE, "%s:%d: the HTTP server did not start", cfg->addr, cfg->port);
  }
  s->epoll_fd = i->epoll_fd;
  return SV_OK;
}

void pv_server_step(pv_server *s, int timeout_ms) {
  sv_ns until = now_ns() + timeout_ms * SV_NS_PER_MS;
  for (sv_ns now = now_ns(); now < until; now = now_ns()) {
    struct pollfd p = {.fd = s->epoll_fd,
                       .events = POLLIN}; // not epoll_wait: it would take the library's edges
    MHD_UNSIGNED_LONG_LONG due;
    int wait_ms = (int)(LOOP_STEP_NS / SV_NS_PER_MS);
    if (timeout_ms < wait_ms) wait_ms = timeout_ms;
    if (MHD_get_timeout(s->daemon, &due) == MHD_YES && due < (MHD_UNSIGNED_LONG_LONG)wait_ms)
      wait_ms = (int)due;
    (void)poll(&p, 1, wait_ms);
    renew_state(s);
    renew_cameras(s, now);
    end_slow_clients(s, now);
    (void)MHD_run(s->daemon);
  }
}

#else
sv_status pv_server_open(pv_server **server, const pv_server_cfg *cfg, sv_err *err) {
  (void)server, (void)cfg;
  return sv_fail(err, SV_E_UNSUPPORTED, "this build has no HTTP server (libmicrohttpd was missing)");
}
void pv_server_step(pv_server *s, int timeout_ms) { (void)s, (void)timeout_ms; }
#endif
