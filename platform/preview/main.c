// SPDX-License-Identifier: Apache-2.0
// subview-preview: serves the page of a running subview.
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "include/subview/version.h"
#include "platform/linux/linux.h"
#include "platform/linux/preview.h"
#include "platform/preview/preview.h"
#include "platform/preview/tls.h"

#define DATA_BYTES (96u << 20) // beside what a snapshot of the model takes
#define BEAT_MS    500
#define USAGE      2

typedef struct {
  char addr[64];
  int port, feed_fd, command_fd;
  long attach_pid;
  const char *tls; // NULL: plain HTTP
  const char *scans, *scan_name;
  bool has_exports;
} options;

static void say(int fd, const char *fmt, ...) SV_PRINTF(2, 3);
static void say(int fd, const char *fmt, ...) {
  char text[4096];
  va_list ap;
  va_start(ap, fmt);
  size_t n = sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  sv_linux_print(fd, text, n < sizeof text ? n : sizeof text - 1);
}

static void help(void) {
  say(1, "usage: subview-preview --attach PID [--listen [ADDR:]PORT]\n"
         "Serves the page of a running `subview run --feed` or `subview run --preview`: cameras, model, "
         "curves,\n"
         "downloads. It runs in a sandbox, reads only shared memory, and can be stopped and started at any "
         "time.\n"
         "`subview run --preview [ADDR:]PORT` starts one by itself.\n\n"
         "options:\n"
         "  --attach PID           process id of the subview to show\n"
         "  --listen [ADDR:]PORT   where to listen [127.0.0.1:8080]; with an address other than loopback, "
         "everyone\n"
         "                         on that network can connect, and reading needs the token, too\n"
         "  --scans DIR            shows the scans DIR/0001, DIR/0002, ... and can delete them\n"
         "  --scan-name NAME       they are DIR/NAME, DIR/NAME-2, ...\n"
         "  --tls FILE             serve over TLS with the key and certificate in FILE; made when "
         "missing\n"
         "  --feed-fd N --command-fd N --exports yes   used by subview itself\n"
         "  --version              print the version\n"
         "  --help                 this text\n\n"
         "The token is SUBVIEW_PREVIEW_TOKEN (16 to 128 of A-Z a-z 0-9 - _), or random; the printed link "
         "holds it.\n\n"
         "example:\n  subview-preview --attach $(pidof subview) --listen 8081\n");
}

static int usage(const char *fmt, const char *what) {
  say(2, "subview-preview: ");
  say(2, fmt, what);
  say(2, "; try 'subview-preview --help'\n");
  return USAGE;
}

static int parse(int argc, char **argv, options *o, sv_err *err) {
  *o = (options){.addr = "127.0.0.1", .port = 8080, .feed_fd = -1, .command_fd = -1, .scan_name = ""};
  for (int i = 1; i < argc; i += 2) {
    long long v;
    const char *value = i + 1 < argc ? argv[i + 1] : "";
    if (!strcmp(argv[i], "--help") || !strcmp(argv[i], "-h")) {
      help();
      return -1;
    }
    if (!strcmp(argv[i], "--version")) {
      say(1, "subview-preview %s (feed version %u)\n", SUBVIEW_VERSION, SV_FEED_VERSION);
      return -1;
    }
    if (!strcmp(argv[i], "--listen")) {
      if (sv_linux_preview_parse(value, o->addr, sizeof o->addr, &o->port, err) < 0)
        return usage("--listen %s", err->text);
    } else if (!strcmp(argv[i], "--scans") || !strcmp(argv[i], "--scan-name")) {
      if (!*value) return usage("%s: a name is missing", argv[i]);
      *(argv[i][6] == 's' ? &o->scans : &o->scan_name) = value;
    } else if (!strcmp(argv[i], "--exports")) o->has_exports = !strcmp(value, "yes");
    else if (!strcmp(argv[i], "--tls")) {
      if (!*value) return usage("%s: expected a file", argv[i]);
      o->tls = value;
    } else if (!strcmp(argv[i], "--attach") || !strcmp(argv[i], "--feed-fd") ||
               !strcmp(argv[i], "--command-fd")) {
      if (!sv_parse_int(value, strlen(value), &v) || v < 1 || v > 1 << 30)
        return usage("%s: expected a number", argv[i]);
      if (argv[i][2] == 'a') o->attach_pid = (long)v;
      else *(argv[i][2] == 'f' ? &o->feed_fd : &o->command_fd) = (int)v;
    } else return usage("unknown option '%s'", argv[i]);
  }
  if (o->feed_fd < 0 && !o->attach_pid) return usage("%s is missing", "--attach");
  return 0;
}

// Finds the feed among the open files of another process, and the way its commands take.
static sv_status attach(options *o, sv_err *err) {
  char path[64], link[64];
  sv_fmt(path, sizeof path, "/proc/%ld/fd", o->attach_pid);
  int dir = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (dir < 0)
    return sv_fail(err, SV_E_NOT_FOUND, "--attach %ld: cannot access this process (%s)", o->attach_pid,
                   sv_linux_reason(errno));
  for (int fd = 3; fd < 256 && o->feed_fd < 0; fd++) {
    sv_fmt(path, sizeof path, "%d", fd);
    ssize_t n = readlinkat(dir, path, link, sizeof link - 1);
    if (n > 0 && !strncmp(link, "/memfd:subview-feed", 19))
      o->feed_fd = openat(dir, path, O_RDONLY | O_CLOEXEC);
  }
  sv_feed_header h;
  if (o->feed_fd < 0 || pread(o->feed_fd, &h, sizeof h, 0) != (ssize_t)sizeof h) {
    close(dir);
    return sv_fail(err, SV_E_NOT_FOUND,
                   "--attach %ld: no feed there; is it a `subview run --preview` or --feed?", o->attach_pid);
  }
  sv_fmt(path, sizeof path, "%d", h.command_fd);
  o->command_fd = openat(dir, path, O_WRONLY | O_NONBLOCK | O_CLOEXEC);
  close(dir);
  return SV_OK;
}

static sv_status map_feed(const options *o, pv_source *s, sv_err *err) {
  struct stat st;
  if (fstat(o->feed_fd, &st) < 0) return sv_fail(err, SV_E_NOT_FOUND, "the feed is not open");
  void *block = mmap(NULL, (size_t)st.st_size, PROT_READ, MAP_SHARED, o->feed_fd, 0);
  if (block == MAP_FAILED)
    return sv_fail(err, SV_E_NOMEM, "the feed cannot be mapped (%s)", sv_linux_reason(errno));
  sv_status r = sv_feed_attach(&s->reader, block, (size_t)st.st_size, err);
  close(o->feed_fd);
  return r;
}

// 128 random bits as text. Empty: the system gives none.
static void make_key(char key[static PV_CAP_TOKEN + 1]) {
  uint8_t r[16];
  key[0] = 0;
  if (getrandom(r, sizeof r, 0) != (ssize_t)sizeof r) return;
  for (int i = 0; i < 16; i++) sv_fmt(key + 2 * i, 3, "%x%x", r[i] >> 4, r[i] & 15);
}

static sv_status make_token(char token[static PV_CAP_TOKEN + 1], sv_err *err) {
  const char *given = getenv("SUBVIEW_PREVIEW_TOKEN");
  make_key(token);
  if (!given || !*given) return SV_OK;
  sv_status s = pv_token_check(given, err);
  if (s >= 0) sv_copy(token, PV_CAP_TOKEN + 1, given);
  return s;
}

static bool is_loopback(const char *addr) { return !strncmp(addr, "127.", 4) || !strcmp(addr, "::1"); }

// What is on the way to the runtime is a byte; a full pipe means that it is not listening, which is
// its right.
static bool tell(const options *o, char byte) {
  return o->command_fd < 0 || write(o->command_fd, &byte, 1) == 1 || errno == EAGAIN || errno == EINTR;
}

// EPERM: it is another user's, or behind Landlock, and there.
static bool is_gone(pid_t writer) { return kill(writer, 0) != 0 && errno == ESRCH; }

static int serve(options *o, pv_source *source, sv_err *err) {
  static char token[PV_CAP_TOKEN + 1], read_key[PV_CAP_TOKEN + 1];
  bool is_child = !o->attach_pid;
  static pv_tls tls;
  pv_server *server;
  sv_status s = make_token(token, err);
  if (s >= 0 && o->tls) s = pv_tls_load(&tls, o->tls, err);
  if (s >= 0 && o->tls)
    say(2, "certificate: %sSHA-256 %s\n", tls.is_new ? "new, browsers ask once; " : "", tls.fingerprint);
  make_key(read_key);
  source->command_fd = o->command_fd;
  source->scans.has_exports = o->has_exports;
  pv_server_cfg cfg = {.source = source,
                       .addr = o->addr,
                       .port = o->port,
                       .command_fd = o->command_fd,
                       .token = token,
                       .tls_pem = o->tls ? tls.pem : NULL,
                       .read_key = read_key,
                       .is_private = !is_loopback(o->addr)};
  long writer = source->reader.header->writer_pid;
  if (s >= 0) s = pv_server_open(&server, &cfg, err);
  if (s >= 0 && !is_child)
    say(2, strchr(o->addr, ':') ? "page: http%s://[%s]:%d/#%s\n" : "page: http%s://%s:%d/#%s\n",
        o->tls ? "s" : "", o->addr, o->port, token);
  if (s >= 0) s = pv_sandbox_enter(source->sandbox, sizeof source->sandbox, err);
  if (s < 0) {
    say(2, "subview-preview: %s\n", err->text);
    if (is_child) (void)tell(o, SV_PREVIEW_REFUSED);
    return 1;
  }
  if (is_child) (void)tell(o, SV_PREVIEW_READY);
  for (;;) {
    pv_server_step(server, BEAT_MS);
    if (is_child ? !tell(o, SV_PREVIEW_BEAT) : is_gone((pid_t)writer)) return 0;
  }
}

// Without them, the page shows the run alone.
static void start_scans(const options *o, pv_source *s) {
  sv_err err = {0};
  s->scans = (pv_scans){.place = {o->scans ? o->scans : "", o->scan_name}, .fd = -1};
  if (o->scans && pv_scans_start(&s->scans.place, &s->scans.fd, &err) < 0)
    say(2, "subview-preview: %s\n", err.text);
}

int main(int argc, char **argv) {
  static pv_source source;
  options o;
  sv_err err = {0};
  int r = parse(argc, argv, &o, &err);
  if (r) return sv_linux_end_program("subview-preview", r < 0 ? 0 : r);
  signal(SIGPIPE, SIG_IGN);
  sv_status s = pv_sandbox_begin(o.feed_fd, o.command_fd, &err);
  if (s >= 0 && o.attach_pid) pv_sandbox_leave_terminal();
  if (s >= 0 && o.attach_pid) s = attach(&o, &err);
  if (s >= 0) s = map_feed(&o, &source, &err);
  if (s >= 0) start_scans(&o, &source);
  if (s >= 0)
    pv_limits_set(DATA_BYTES + 6 * (size_t)source.reader.ring[SV_FEED_MODEL].slot_bytes +
                  2 * (size_t)source.reader.ring[SV_FEED_HISTORY].slot_bytes);
  if (s >= 0) s = pv_pictures_open(&source, &err);
  if (s >= 0) s = pv_model_open(&source, &err);
  if (s < 0) {
    say(2, "subview-preview: %s\n", err.text);
    if (!o.attach_pid) (void)tell(&o, SV_PREVIEW_REFUSED);
    return 1;
  }
  return serve(&o, &source, &err);
}
