// SPDX-License-Identifier: Apache-2.0
#include "boards/preview.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "boards/modes.h"
#include "platform/drm/drm.h"
#include "src/format/qr.h"
#include "src/run/isa.h"

// Between two looks for cameras: often while the machine starts, as drivers and udev's permissions
// come after the service.
#define RETRY_NS       (5 * SV_NS_PER_S)
#define RETRY_FIRST_NS (SV_NS_PER_S / 2)
#define FIRST_NS       (30 * SV_NS_PER_S)

static sv_linux_preview live;
static bool is_open;
static sv_drm screen = {.fd = -1};
static char screen_link[SV_QR_CAP_TEXT]; // a phone can reach it; or empty
static sv_ns opened_ns;

static bool is_any(const char *addr) { return !strcmp(addr, "0.0.0.0") || !strcmp(addr, "::"); }

// The link as a code that a phone reads, below the link.
static void print_code(int fd, const char *link) {
  static sv_qr q;
  static char text[SV_QR_CAP_LINES];
  if (!sv_qr_make(&q, link)) return;
  sv_str lines = sv_str_make(text, sizeof text);
  sv_qr_lines(&q, &lines);
  sv_linux_print(fd, text, lines.len);
}

// Link and code on a display that is attached to the machine: a text console shows them.
static void print_on_console(const run_options *o, const char *link) {
  const int fd = open(o->console, O_WRONLY | O_NOCTTY | O_CLOEXEC);
  if (fd >= 0 && isatty(fd)) {
    sv_linux_print(fd, "\nsubview: ", 10);
    sv_linux_print(fd, link, strlen(link));
    sv_linux_print(fd, "\n", 1);
    print_code(fd, link);
  } else
    say(2, "--console %s: no link there: %s\n", o->console, fd < 0 ? sv_linux_reason(errno) : "no terminal");
  if (fd >= 0) close(fd);
}

// A link with the token goes to terminals, and to a log only where there is no other way to know
// the token: with --token-file the file has it.
static void print_link(const run_options *o, const char *addr, bool is_first) {
  // A phone cannot reach loopback
  const bool has_code = is_first && strncmp(addr, "127.", 4) != 0 && strcmp(addr, "::1") != 0;
  char link[SV_QR_CAP_TEXT], where[96];
  sv_fmt(where, sizeof where, strchr(addr, ':') ? "http%s://[%s]:%d/" : "http%s://%s:%d/", o->tls ? "s" : "",
         addr, o->preview_port);
  sv_fmt(link, sizeof link, "%s#%s", where, live.token);
  if (o->console && is_first) print_on_console(o, link);
  if (has_code) sv_copy(screen_link, sizeof screen_link, link);
  if (isatty(2)) {
    say(2, "page: %s\n", link);
    if (has_code) print_code(2, link);
  } else if (o->token_file) say(2, "page: %s (its token: %s)\n", where, o->token_file);
  else say(2, "page: %s\n", link);
}

// "all addresses" is no place to go to: the link names those that other machines see.
static void print_links(const run_options *o) {
  struct ifaddrs *list = NULL;
  int n = 0;
  if (is_any(o->preview_addr) && getifaddrs(&list) == 0) {
    for (const struct ifaddrs *i = list; i; i = i->ifa_next) {
      char text[INET_ADDRSTRLEN];
      if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET || i->ifa_flags & IFF_LOOPBACK) continue;
      const struct sockaddr_in *a = (const struct sockaddr_in *)(const void *)i->ifa_addr;
      if (!inet_ntop(AF_INET, &a->sin_addr, text, sizeof text)) continue;
      print_link(o, text, n == 0);
      n++;
    }
    freeifaddrs(list);
  }
  if (n) return;
  const char *addr = is_any(o->preview_addr) ? "127.0.0.1" : o->preview_addr;
  print_link(o, addr, true);
}

// The token of --token-file, for the page's link to stay valid. A file that holds no token is
// refused, not replaced.
static sv_status read_token(const char *path, sv_err *err) {
  char text[40] = "";
  int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0 && errno == ENOENT) return SV_OK; // made below
  ssize_t n = fd < 0 ? -1 : read(fd, text, sizeof text - 1);
  if (fd >= 0) close(fd);
  if (n < 0) return sv_fail(err, SV_E_IO, "%s: the page's token cannot be read", path);
  if (strspn(text, "0123456789abcdef") != 32 || (text[32] && text[32] != '\n'))
    return sv_fail(err, SV_E_FORMAT,
                   "%s: no token of a page (32 digits of 0-9a-f); remove the file for a new one", path);
  text[32] = 0;
  sv_copy(live.token, sizeof live.token, text);
  return SV_OK;
}

// Whole or not at all: a file without a token, as a power cut could leave it, would be refused.
static sv_status write_token(const char *path, sv_err *err) {
  const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
  char dir[SV_LINUX_CAP_PATH] = ".", text[40];
  if (slash && (size_t)(slash - path) + 2 > sizeof dir)
    return sv_fail(err, SV_E_RANGE, "%s: too long a path", path);
  if (slash) sv_fmt(dir, sizeof dir, "%.*s/", (int)(slash - path), path);
  int dir_fd = open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC), e = dir_fd < 0 ? errno : 0;
  sv_linux_file f = {.fd = -1};
  if (!e) e = sv_linux_file_begin(&f, dir_fd, name);
  if (!e) {
    if (fchmod(f.fd, 0600) != 0) f.error = errno;
    const size_t n = sv_fmt(text, sizeof text, "%s\n", live.token);
    (void)sv_linux_file_write(&f, text, n); // commit returns its failure
    e = sv_linux_file_commit(&f);
  }
  if (dir_fd >= 0) close(dir_fd);
  return e ? sv_fail(err, SV_E_IO, "%s: the page's token cannot be written: %s", path, sv_linux_reason(e))
           : SV_OK;
}

// Where the page finds earlier scans: --out with --keep holds them; without, DIR-2, DIR-3, ... are
// beside DIR.
static void name_scans(const run_options *o) {
  sv_err err;
  char out[SV_LINUX_CAP_PATH];
  live.scans[0] = live.scan_name[0] = 0;
  if (!o->is_session || !o->out || !sv_copy(out, sizeof out, o->out)) return;
  for (size_t n = strlen(out); n > 1 && out[n - 1] == '/'; n--) out[n - 1] = 0;
  char *slash = strrchr(out, '/');
  const char *name = slash ? slash + 1 : out, *folder = slash == out ? "/" : slash ? out : ".";
  if (o->keep > 0) folder = out;
  else {
    if (!sv_copy(live.scan_name, sizeof live.scan_name, name)) return;
    if (slash && slash != out) *slash = 0;
  }
  if (!sv_copy(live.scans, sizeof live.scans, folder) || sv_linux_make_dir(folder, &err) < 0)
    live.scans[0] = 0;
}

static sv_status open_screen(const run_options *o, sv_err *err) {
  const sv_drm_sys sys = sv_drm_linux();
  const sv_status s = sv_drm_open(&screen, o->display, &sys, err);
  if (s >= 0 || !o->is_session) return s;
  say(2, "subview: %s; the page has the pictures\n", err->text);
  return SV_OK;
}

sv_display preview_display(void) {
  if (screen.fd < 0) return (sv_display){0};
  sv_display d = sv_drm_display(&screen);
  d.link = screen_link[0] ? screen_link : NULL;
  return d;
}

sv_status preview_open(const run_options *o, sv_err *err) {
  if (!o->preview && !o->has_feed && !o->display) return SV_OK;
  const sv_app_cfg planned = {.n_exposures = (int)o->exposures,
                              .is_dynamic = o->is_dynamic,
                              .is_continuous = o->is_continuous,
                              .exposure_s = o->exposure_s,
                              .history_s = o->history_s,
                              .train = {.n_gaussians = (int)o->gaussians},
                              .dynamic = sv_dynamic_defaults()};
  const sv_history_cfg history = sv_app_history_cfg(&planned);
  const sv_dynamic_cfg motion = sv_app_dynamic_cfg(&planned);
  const size_t n = o->gaussians > 0 ? (size_t)o->gaussians : 1;
  size_t n_floats = SV_GAUSSIAN_N_FLOATS((size_t)o->sh) + sv_preview_motion_floats(&motion) +
                    (sv_preview_bodies_floats(&motion) + n - 1) / n;
  const sv_linux_preview_caps caps = {.gaussians = (uint32_t)o->gaussians,
                                      .floats = (uint32_t)n_floats,
                                      .history_bytes = sv_history_cap_file_bytes(&history)};
  sv_status s = sv_linux_preview_open(&live, &caps, err);
  is_open = s >= 0;
  sv_clock clock = sv_linux_clock();
  opened_ns = clock.now_ns(clock.self);
  const bool has_token_file = o->preview && o->token_file;
  if (s >= 0 && has_token_file) s = read_token(o->token_file, err);
  const bool is_new = !live.token[0];
  name_scans(o);
  live.tls_file = o->tls;
  if (s >= 0 && o->is_session) {
    modes_list(o->source, &live.modes);
    sv_linux_preview_show_modes(&live);
  }
  if (s >= 0 && o->preview) s = sv_linux_preview_serve(&live, NULL, o->preview_addr, o->preview_port, err);
  if (s >= 0 && has_token_file && is_new) s = write_token(o->token_file, err);
  if (s >= 0 && o->preview) print_links(o);
  if (s >= 0 && o->display) s = open_screen(o, err);
  if (s >= 0 && o->has_feed && !o->preview)
    say(2, "feed: subview-preview --attach %ld serves it\n", (long)getpid());
  return s;
}

void preview_publish(sv_publish *p) {
  if (is_open) sv_linux_preview_publish(&live, p);
}

sv_beat_of *preview_beats(void) { return is_open ? live.feed.header->beats : NULL; }

preview_answer preview_failed(const run_options *o, const preview_failure *why, const sv_console *console,
                              sv_heartbeats *beats) {
  if (!is_open) return PREVIEW_STOP;
  sv_publish p = {0};
  sv_clock clock = sv_linux_clock();
  preview_publish(&p);
  sv_preview_show_failure(p.feed, why->cause, BOARD_NAME, o->source, o->is_session, why->sentence);
  const sv_display display = preview_display();
  sv_screen_message(&display, why->sentence);
  const bool is_retrying = o->keep > 0 && why->cause == SV_CAUSE_CAMERA;
  const sv_ns now_ns = clock.now_ns(clock.self);
  const sv_ns retry_ns = now_ns + (now_ns - opened_ns < FIRST_NS ? RETRY_FIRST_NS : RETRY_NS);
  while (o->is_session && !console->is_stop_requested(console->self)) {
    sv_beat(beats, SV_BEAT_MAIN);
    const sv_command c = p.command(p.self);
    if (c == SV_COMMAND_NEW) return PREVIEW_NEW;
    if (c == SV_COMMAND_CALIBRATE) return PREVIEW_CALIBRATE;
    if (c == SV_COMMAND_MODE) return PREVIEW_RETRY;
    if (is_retrying && clock.now_ns(clock.self) > retry_ns) return PREVIEW_RETRY;
    clock.sleep_until_ns(clock.self, clock.now_ns(clock.self) + 50 * SV_NS_PER_MS);
  }
  return PREVIEW_STOP;
}

const char *preview_source(const char *source) {
  return is_open ? modes_apply(source, &live.modes, live.modes.i_mode) : source;
}

preview_calibration preview_board(void) {
  return (preview_calibration){live.board.n_cols, live.board.n_rows, live.board.spacing_m,
                               live.board.is_fisheye};
}

void preview_close(void) {
  sv_drm_close(&screen);
  if (is_open) sv_linux_preview_close(&live);
  is_open = false;
}

// --- the first run -------------------------------------------------------------------------------

void check_list_fails(const char *what, const char *sentence) {
  say(2, "[--] %s: %s\nnot ready: the scan cannot start before this is mended\n", what, sentence);
}

static void check_rig(const board_source *src) {
  char text[128] = "";
  sv_str s = sv_str_make(text, sizeof text);
  const sv_sub_view *v = &src->rig->sub_views[0];
  if (v->source_width_px) sv_str_add(&s, ", trained at %dx%d", v->model.width_px, v->model.height_px);
  say(2, "[ok] rig %s: %d sub-views%s\n", src->rig->name, src->rig->n_sub_views, text);
  const sv_trigger *t = &src->pulses.trigger;
  s = sv_str_make(text, sizeof text);
  sv_trigger_add_line(&s, t);
  if (t->kind != SV_LINE_NONE)
    say(2, "[ok] trigger %s: a pulse of %g ms every %g ms\n", text, sv_ns_to_ms(t->width_ns),
        sv_ns_to_ms(t->period_ns));
}

void check_list(const run_options *o, const board_source *src, const sv_arena *arena, const sv_kernels *k) {
  static const char *const formats[] = {"none", "grey", "RGB", "RGBA", "16-bit RGB", "JPEG", "PNG"};
  struct statvfs fs;
  say(2, "[ok] board %s: %ld threads, %s kernels\n", BOARD_NAME, o->threads, sv_isa_name(k->isa));
  for (int i = 0; i < src->source.n_cameras; i++) {
    const sv_camera_caps *c = &src->caps[i];
    const char *format = (size_t)c->format < sizeof formats / sizeof *formats ? formats[c->format] : "raw";
    say(2, "[ok] camera %d %s: %dx%d, %s, %.4g fps\n", i, c->name, c->width_px, c->height_px, format, c->fps);
  }
  check_rig(src);
  say(2, "[ok] memory: %.1f of the block's %.1f MiB\n", (double)arena->used_bytes / 1048576.0,
      (double)arena->cap_bytes / 1048576.0);
  if (o->out && statvfs(o->out, &fs) == 0)
    say(2, "[ok] folder %s: writable, %.1f GiB free\n", o->out,
        (double)fs.f_bavail * (double)fs.f_frsize / 1073741824.0);
  if (screen.fd >= 0)
    say(2, "[ok] display: %s, %dx%d at %.4g Hz\n", screen.name, screen.width_px, screen.height_px,
        screen.rate_hz);
  if (o->preview) say(2, "[ok] page: served on %s port %d\n", o->preview_addr, o->preview_port);
  if (o->is_check) say(2, "ready: nothing speaks against a scan with these options\n");
}
