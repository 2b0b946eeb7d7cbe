// SPDX-License-Identifier: Apache-2.0
#include "platform/camera/options.h"

#include <string.h>

#include "src/base/str.h"

sv_camera_options sv_camera_defaults(void) {
  return (sv_camera_options){.n_buffers = 8,
                             .gain = -1,
                             .n_bracket_delay = 4,
                             .settle_ns = 500 * SV_NS_PER_MS,
                             .stall_ns = SV_NS_PER_S,
                             .tone = {.gain_r = 1, .gain_b = 1}};
}

typedef struct {
  const char *key, *value;
  size_t n_key, n_value;
} pair;

static bool is_key(const pair *p, const char *key) {
  return strlen(key) == p->n_key && !memcmp(key, p->key, p->n_key);
}
static bool is_value(const pair *p, const char *value) {
  return strlen(value) == p->n_value && !memcmp(value, p->value, p->n_value);
}

static bool number(const pair *p, double lo, double hi, double *out) {
  return sv_parse_double(p->value, p->n_value, out) && *out >= lo && *out <= hi;
}
static bool integer(const pair *p, long long lo, long long hi, long long *out) {
  return sv_parse_int(p->value, p->n_value, out) && *out >= lo && *out <= hi;
}

static int choice(const pair *p, const char *const *words, int n) {
  for (int i = 0; i < n; i++)
    if (is_value(p, words[i])) return i;
  return -1;
}

static bool read_size(const pair *p, sv_camera_options *o) {
  const char *x = memchr(p->value, 'x', p->n_value);
  long long w, h;
  if (!x || !sv_parse_int(p->value, (size_t)(x - p->value), &w) ||
      !sv_parse_int(x + 1, p->n_value - (size_t)(x - p->value) - 1, &h))
    return false;
  if (w < 16 || h < 16 || w > 16384 || h > 16384) return false;
  o->width_px = (int)w;
  o->height_px = (int)h;
  return true;
}

static bool read_format(const pair *p, sv_camera_options *o) {
  if (p->n_value < 1 || p->n_value > 4) return false;
  memset(o->format, ' ', 4); // short names are padded with spaces, as V4L2 does
  memcpy(o->format, p->value, p->n_value);
  return true;
}

static bool read_numbers(const pair *p, sv_camera_options *o) {
  double f;
  long long n;
  if (is_key(p, "fps")) return number(p, 0.1, 1000, &o->fps);
  if (is_key(p, "gain")) return number(p, 0, 1e6, &o->gain);
  if (is_key(p, "red")) return number(p, 0.01, 100, &f) && (o->tone.gain_r = (float)f, true);
  if (is_key(p, "blue")) return number(p, 0.01, 100, &f) && (o->tone.gain_b = (float)f, true);
  if (is_key(p, "exposure"))
    return number(p, 1, 1e7, &f) && (o->exposure_ns = (sv_ns)(f * (double)SV_NS_PER_US), true);
  if (is_key(p, "buffers")) return integer(p, 3, SV_CAMERA_CAP_BUFFERS, &n) && (o->n_buffers = (int)n, true);
  if (is_key(p, "wb")) return integer(p, 1000, 20000, &n) && (o->white_k = (int)n, true);
  if (is_key(p, "settle")) return integer(p, 0, 10000, &n) && (o->settle_ns = (sv_ns)n * SV_NS_PER_MS, true);
  if (is_key(p, "bracket-delay")) return integer(p, 0, 16, &n) && (o->n_bracket_delay = (int)n, true);
  if (is_key(p, "stall")) return integer(p, 20, 60000, &n) && (o->stall_ns = (sv_ns)n * SV_NS_PER_MS, true);
  return is_key(p, "black") && integer(p, 0, 65534, &n) && (o->tone.black = (int)n, true);
}

static bool read_brackets(const pair *p, sv_camera_options *o) {
  const char *end = p->value + p->n_value;
  o->n_brackets = 0;
  for (const char *word = p->value;; word++) {
    const char *colon = memchr(word, ':', (size_t)(end - word));
    const pair one = {p->key, word, p->n_key, (size_t)((colon ? colon : end) - word)};
    if (o->n_brackets == SV_CAMERA_CAP_BRACKET || !number(&one, 1e-3, 1e3, &o->bracket[o->n_brackets]))
      return false;
    o->n_brackets++;
    if (!colon) return o->n_brackets > 1;
    word = colon;
  }
}

static bool read_sync(const pair *p, sv_camera_options *o) {
  static const char *const syncs[] = {"off", "server", "client"};
  const char *end = p->value + p->n_value;
  o->n_sync = 0;
  for (const char *word = p->value;; word++) {
    const char *colon = memchr(word, ':', (size_t)(end - word));
    const pair one = {p->key, word, p->n_key, (size_t)((colon ? colon : end) - word)};
    const int i = choice(&one, syncs, 3);
    if (i < 0 || o->n_sync == SV_CAMERA_CAP_CAMERAS) return false;
    o->sync[o->n_sync++] = (sv_rpi_sync)i;
    if (!colon) return true;
    word = colon;
  }
}

static bool read_words(const pair *p, sv_camera_options *o) {
  static const char *const clocks[] = {"camera", "monotonic", "boottime", "realtime"};
  static const char *const stamps[] = {"start", "middle", "end"}, *const lights[] = {"display", "linear"};
  static const char *const switches[] = {"off", "on"}, *const locks[] = {"off", "on", "shared"};
  int i;
  if (is_key(p, "clock"))
    return (i = choice(p, clocks, 4)) >= 0 && (o->clock = (sv_clock_id)i, o->has_clock = true);
  if (is_key(p, "stamp"))
    return (i = choice(p, stamps, 3)) >= 0 && (o->stamp = (sv_stamp_source)i, o->has_stamp = true);
  if (is_key(p, "light"))
    return (i = choice(p, lights, 2)) >= 0 && (o->tone.is_linear = i, o->has_light = true);
  if (is_key(p, "lock")) {
    if ((i = choice(p, locks, 3)) < 0) return false;
    o->is_unlocked = i == 0;
    o->is_shared = i == 2;
    return true;
  }
  if (is_key(p, "brackets")) return read_brackets(p, o);
  if (is_key(p, "dmabuf")) return (i = choice(p, switches, 2)) >= 0 && (o->is_exported = i, true);
  return is_key(p, "sync") && read_sync(p, o);
}

static sv_status read_item(const char *kind, const char *item, size_t n, sv_camera_options *o, sv_err *err) {
  const char *eq = memchr(item, '=', n);
  if (!eq || item[0] == '/') { // ids of cameras may hold anything but a comma
    if (!n)
      return sv_fail(err, SV_E_ARG, "%s: no camera is named, expected names with commas between them", kind);
    if (n >= SV_CAMERA_CAP_NAME)
      return sv_fail(err, SV_E_ARG, "%s: the name of a camera has %zu characters, expected 1 to %d", kind, n,
                     SV_CAMERA_CAP_NAME - 1);
    if (o->n_cameras == SV_CAMERA_CAP_CAMERAS)
      return sv_fail(err, SV_E_ARG, "%s: more than %d cameras are named", kind, SV_CAMERA_CAP_CAMERAS);
    for (int i = 0; i < o->n_cameras; i++)
      if (strlen(o->name[i]) == n && !memcmp(o->name[i], item, n))
        return sv_fail(err, SV_E_ARG, "%s: camera %s is named twice", kind, o->name[i]);
    memcpy(o->name[o->n_cameras], item, n);
    o->name[o->n_cameras++][n] = 0;
    return SV_OK;
  }
  pair p = {item, eq + 1, (size_t)(eq - item), n - (size_t)(eq - item) - 1};
  bool is_good = is_key(&p, "size")     ? read_size(&p, o)
                 : is_key(&p, "format") ? read_format(&p, o)
                                        : read_numbers(&p, o) || read_words(&p, o);
  if (is_good) return SV_OK;
  return sv_fail(
      err, SV_E_ARG,
      "%s: \"%.*s\" is not an option or its value is out of range; there are size=WxH, format=FOURCC, "
      "fps, buffers, exposure=US, gain, wb=K, lock, brackets=F:F, bracket-delay, settle=MS, stall=MS, clock, "
      "stamp, black, red, blue, light, dmabuf, sync",
      kind, (int)(n < 60 ? n : 60), item);
}

// One word becomes one for each camera; on one board, and network, there is one server.
static sv_status complete_sync(const char *kind, sv_camera_options *o, sv_err *err) {
  int n_servers = 0;
  if (!o->n_sync) return SV_OK;
  if (o->n_sync != 1 && o->n_sync != o->n_cameras)
    return sv_fail(err, SV_E_ARG, "%s: sync= has %d words for %d cameras, expected one, or one for each",
                   kind, o->n_sync, o->n_cameras);
  for (int i = o->n_sync; i < o->n_cameras; i++)
    o->sync[i] = o->sync[0] == SV_RPI_SYNC_SERVER ? SV_RPI_SYNC_CLIENT : o->sync[0];
  o->n_sync = o->n_cameras;
  for (int i = 0; i < o->n_cameras; i++) n_servers += o->sync[i] == SV_RPI_SYNC_SERVER;
  if (n_servers > 1)
    return sv_fail(err, SV_E_ARG, "%s: sync= names %d servers, expected one; the others are clients", kind,
                   n_servers);
  return SV_OK;
}

double sv_camera_exposure_share(const sv_camera_options *o, int i) {
  return o->response ? (double)o->response[0] / (double)o->response[i] : 1;
}

bool sv_camera_is_light_shared(const sv_camera_options *o) {
  const bool is_given = o->exposure_ns > 0 && o->gain >= 0 && o->white_k > 0;
  return !o->is_unlocked && (o->is_shared || is_given || o->n_cameras == 1);
}

bool sv_camera_has_sync(const sv_camera_options *o) {
  for (int i = 0; i < o->n_sync; i++)
    if (o->sync[i] != SV_RPI_SYNC_OFF) return true;
  return false;
}

sv_status sv_camera_parse(const char *kind, const char *spec, sv_camera_options *o, sv_err *err) {
  *o = sv_camera_defaults();
  for (const char *p = spec;; p++) {
    size_t n = strcspn(p, ",");
    sv_status s = read_item(kind, p, n, o, err);
    if (s < 0) return s;
    p += n;
    if (!*p) break;
  }
  if (!o->n_cameras) return sv_fail(err, SV_E_ARG, "%s: expected a camera before the options", kind);
  if (o->n_brackets && o->is_unlocked)
    return sv_fail(err, SV_E_ARG,
                   "%s: brackets= are factors of a fixed exposure time; expected lock=on or shared", kind);
  return complete_sync(kind, o, err);
}

sv_raw_tone sv_camera_tone(const sv_camera_options *o, sv_pixel_format f) {
  sv_raw_tone t = o->tone;
  if (!o->has_light) t.is_linear = sv_pixel(f)->layout == SV_LAYOUT_BAYER;
  return t;
}

// --- events --------------------------------------------------------------------------------------
void sv_camera_events_add(sv_camera_events *e, sv_camera_event_kind kind, int i_camera, sv_ns host_ns,
                          int64_t detail) {
  if (e->n == SV_CAMERA_CAP_EVENTS) {
    e->i_first = (e->i_first + 1) % SV_CAMERA_CAP_EVENTS;
    e->n--;
  }
  e->event[(e->i_first + e->n++) % SV_CAMERA_CAP_EVENTS] =
      (sv_camera_event){kind, i_camera, host_ns, detail, NULL};
  e->count[kind]++;
}

void sv_camera_events_starved(sv_camera_events *e, int i, sv_ns host_ns) {
  if (e->n_starved[i]++ && host_ns - e->starved_ns[i] < SV_NS_PER_S) return;
  e->starved_ns[i] = host_ns;
  sv_camera_events_add(e, SV_CAMERA_STARVED, i, host_ns, (int64_t)e->n_starved[i]);
}

sv_status sv_camera_events_pop(sv_camera_events *e, sv_camera_event *out) {
  if (!e->n) return SV_AGAIN;
  *out = e->event[e->i_first];
  e->i_first = (e->i_first + 1) % SV_CAMERA_CAP_EVENTS;
  e->n--;
  return SV_OK;
}

// --- JPEG ----------------------------------------------------------------------------------------
bool sv_camera_jpeg_look(const uint8_t *p, size_t n, int *w, int *h, bool *has_end) {
  if (n < 4 || p[0] != 0xff || p[1] != 0xd8) return false;
  *w = *h = 0;
  for (size_t i = 2; i + 9 <= n;) {
    uint8_t m = p[i + 1];
    if (p[i] != 0xff) return false;
    if (m == 0xff) {
      i++;
      continue;
    }
    if (m >= 0xc0 && m <= 0xcf && m != 0xc4 && m != 0xc8 && m != 0xcc) {
      *h = p[i + 5] << 8 | p[i + 6];
      *w = p[i + 7] << 8 | p[i + 8];
      break;
    }
    if (m == 0xda || m == 0xd9) return false;
    i += 2 + (size_t)(p[i + 2] << 8 | p[i + 3]);
  }
  // Webcams pad their images with zeros.
  while (n > 2 && p[n - 1] == 0) n--;
  *has_end = p[n - 2] == 0xff && p[n - 1] == 0xd9;
  return *w > 0 && *h > 0;
}
