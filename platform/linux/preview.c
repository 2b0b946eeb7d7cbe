// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/preview.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/memfd.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

#ifndef F_SEAL_FUTURE_WRITE
#define F_SEAL_FUTURE_WRITE 0x0010
#endif

#define LOOK_NS    (50 * SV_NS_PER_MS)
#define HANG_NS    (5 * SV_NS_PER_S) // without a beat
#define READY_NS   (3 * SV_NS_PER_S)
#define LOOKED_NS  (2 * SV_NS_PER_S)    // after the last request for a camera's full view
#define RESTART_NS (100 * SV_NS_PER_MS) // from one start to the next at least

static sv_ns now_ns(void) {
  sv_clock c = sv_linux_clock();
  return c.now_ns(c.self);
}

// --- the feed ------------------------------------------------------------------------------------

static sv_status make_feed(sv_linux_preview *l, const sv_linux_preview_caps *caps, sv_err *err) {
  l->block_bytes = sv_feed_bytes(caps->gaussians, caps->floats, caps->history_bytes);
  l->feed_fd = (int)syscall(SYS_memfd_create, "subview-feed", MFD_ALLOW_SEALING | MFD_CLOEXEC);
  if (l->feed_fd < 0 || ftruncate(l->feed_fd, (off_t)l->block_bytes) < 0)
    return sv_fail(err, SV_E_NOMEM, "preview: no shared memory of %zu bytes (%s)", l->block_bytes,
                   sv_linux_reason(errno));
  l->block = mmap(NULL, l->block_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, l->feed_fd, 0);
  if (l->block == MAP_FAILED) {
    l->block = NULL;
    return sv_fail(err, SV_E_NOMEM, "preview: %zu bytes cannot be mapped (%s)", l->block_bytes,
                   sv_linux_reason(errno));
  }
  // Nobody else can write to it or change its size; kernels before 5.1 lack the first of the two.
  if (fcntl(l->feed_fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE) < 0)
    (void)fcntl(l->feed_fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW);
  sv_status s =
      sv_feed_init(&l->feed, l->block, l->block_bytes, caps->gaussians, caps->floats, caps->history_bytes);
  return s < 0 ? sv_fail(err, s, "preview: the feed cannot be laid out") : s;
}

sv_status sv_linux_preview_open(sv_linux_preview *l, const sv_linux_preview_caps *caps, sv_err *err) {
  *l = (sv_linux_preview){.feed_fd = -1, .pipe_fd = {-1, -1}};
  sv_status s = make_feed(l, caps, err);
  if (s >= 0 && pipe2(l->pipe_fd, O_NONBLOCK | O_CLOEXEC) < 0)
    s = sv_fail(err, SV_E_DEVICE, "preview: no pipe (%s)", sv_linux_reason(errno));
  if (s < 0) {
    sv_linux_preview_close(l);
    return s;
  }
  l->feed.header->writer_pid = (int32_t)getpid();
  l->feed.header->command_fd = l->pipe_fd[1];
  return SV_OK;
}

// --- the server ----------------------------------------------------------------------------------

// What the child is to find is put where it looks beforehand. We end it when we are done.
static void start_server(sv_linux_preview *l) {
  l->started_ns = l->beat_ns = now_ns();
  l->next_start_ns = l->started_ns + RESTART_NS;
  fcntl(l->feed_fd, F_SETFD, 0);
  fcntl(l->pipe_fd[1], F_SETFD, 0);
  l->pid = sv_linux_spawn(l->argv, true);
  fcntl(l->feed_fd, F_SETFD, FD_CLOEXEC);
  fcntl(l->pipe_fd[1], F_SETFD, FD_CLOEXEC);
}

// The server is not to be trusted: what is no board is none.
static bool read_board(sv_linux_preview *l) {
  uint8_t b[5];
  if (read(l->pipe_fd[0], b, sizeof b) != (ssize_t)sizeof b) return false;
  const int tenths = b[2] << 8 | b[3];
  if (b[0] < 3 || b[0] > 64 || b[1] < 3 || b[1] > 64 || tenths < 10 || b[4] > 1) return false;
  l->board.n_cols = b[0];
  l->board.n_rows = b[1];
  l->board.spacing_m = 1e-4 * tenths;
  l->board.is_fisheye = b[4];
  return true;
}

static void look_at(sv_linux_preview *l) {
  uint8_t i;
  const size_t n = sizeof l->looked_until_ns / sizeof *l->looked_until_ns;
  if (read(l->pipe_fd[0], &i, 1) == 1 && i < n) l->looked_until_ns[i] = now_ns() + LOOKED_NS;
}

void sv_linux_preview_show_modes(sv_linux_preview *l) {
  memcpy(sv_feed_begin(&l->feed, SV_FEED_MODES), &l->modes, sizeof l->modes);
  sv_feed_commit(&l->feed, SV_FEED_MODES, sizeof l->modes);
}

static sv_command choose_mode(sv_linux_preview *l) {
  uint8_t i;
  if (read(l->pipe_fd[0], &i, 1) != 1 || i >= l->modes.n || i == l->modes.i_mode) return SV_COMMAND_NONE;
  l->modes.i_mode = i;
  sv_linux_preview_show_modes(l);
  return SV_COMMAND_MODE;
}

// A scan's folder has the name that the page's server finds it by (platform/preview/scans.h).
static void export_scan(sv_linux_preview *l) {
  uint8_t b[5];
  char folder[700];
  if (read(l->pipe_fd[0], b, sizeof b) != (ssize_t)sizeof b || !l->scans[0]) return;
  const uint32_t number = (uint32_t)b[1] << 24 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 8 | b[4];
  if (number == 0 || number > 99999999) return;
  if (!l->scan_name[0]) sv_fmt(folder, sizeof folder, "%s/%04u", l->scans, number);
  else if (number == 1) sv_fmt(folder, sizeof folder, "%s/%s", l->scans, l->scan_name);
  else sv_fmt(folder, sizeof folder, "%s/%s-%u", l->scans, l->scan_name, number);
  (void)sv_linux_exporter_make(&l->exporter, folder, b[0]); // the page asks again
}

static uint32_t looked_at(void *self) {
  const sv_linux_preview *l = self;
  const sv_ns now = now_ns();
  uint32_t cameras = 0;
  for (uint32_t i = 0; i < sizeof l->looked_until_ns / sizeof *l->looked_until_ns; i++)
    cameras |= (uint32_t)(now < l->looked_until_ns[i]) << i;
  return cameras;
}

static sv_command command_of(sv_linux_preview *l, char byte) {
  switch (byte) {
  case SV_PREVIEW_LOOK: look_at(l); return SV_COMMAND_NONE;
  case SV_PREVIEW_MODE: return choose_mode(l);
  case SV_PREVIEW_EXPORT: export_scan(l); return SV_COMMAND_NONE;
  case SV_PREVIEW_START: return SV_COMMAND_START;
  case SV_PREVIEW_PAUSE: return SV_COMMAND_PAUSE;
  case SV_PREVIEW_SAVE: return SV_COMMAND_SAVE;
  case SV_PREVIEW_HISTORY: return SV_COMMAND_HISTORY;
  case SV_PREVIEW_NEW: return SV_COMMAND_NEW;
  case SV_PREVIEW_CALIBRATE: return read_board(l) ? SV_COMMAND_CALIBRATE : SV_COMMAND_NONE;
  case SV_PREVIEW_DRAFT: return SV_COMMAND_DRAFT;
  case SV_PREVIEW_NORMAL: return SV_COMMAND_NORMAL;
  case SV_PREVIEW_FINE: return SV_COMMAND_FINE;
  case SV_PREVIEW_REFUSED: l->is_refused = true; return SV_COMMAND_NONE;
  case SV_PREVIEW_READY: l->is_served = true; return SV_COMMAND_NONE;
  default: return SV_COMMAND_NONE;
  }
}

static void look_after(sv_linux_preview *l, sv_ns now) {
  sv_linux_exporter_step(&l->exporter);
  if (l->pid > 0) {
    if (waitpid(l->pid, NULL, WNOHANG) == l->pid) l->pid = 0;
    else if (now - l->beat_ns > HANG_NS) kill(l->pid, SIGKILL);
  }
  if (l->pid == 0 && l->program[0] && !l->is_refused && now >= l->next_start_ns) {
    l->n_restarts++;
    start_server(l);
  }
}

static sv_command next_command(void *self) {
  sv_linux_preview *l = self;
  sv_ns now = now_ns();
  if (now < l->next_look_ns) return SV_COMMAND_NONE;
  char byte;
  while (read(l->pipe_fd[0], &byte, 1) == 1) {
    l->beat_ns = now;
    sv_command c = command_of(l, byte);
    if (c != SV_COMMAND_NONE) return c; // the next one at the next call
  }
  l->next_look_ns = now + LOOK_NS;
  look_after(l, now);
  return SV_COMMAND_NONE;
}

static sv_status find_program(sv_linux_preview *l, const char *program, sv_err *err) {
  if (program) {
    if (!sv_copy(l->program, sizeof l->program, program))
      return sv_fail(err, SV_E_RANGE, "%s: too long a path", program);
  } else {
    ssize_t n = readlink("/proc/self/exe", l->program, sizeof l->program - 32);
    if (n <= 0)
      return sv_fail(err, SV_E_NOT_FOUND, "preview: subview-preview was not found beside this program");
    while (n > 0 && l->program[n - 1] != '/') n--;
    sv_copy(l->program + n, sizeof l->program - (size_t)n, "subview-preview");
  }
  if (access(l->program, X_OK) == 0) return SV_OK;
  sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be started (%s); it is built and installed beside subview",
          l->program, sv_linux_reason(errno));
  l->program[0] = 0;
  return SV_E_NOT_FOUND;
}

static void make_token(char token[static 40]) {
  static const char digits[] = "0123456789abcdef";
  uint8_t r[16];
  if (getrandom(r, sizeof r, 0) != (ssize_t)sizeof r) {
    token[0] = 0; // then nothing can be asked for
    return;
  }
  for (int i = 0; i < 16; i++) {
    token[2 * i] = digits[r[i] >> 4];
    token[2 * i + 1] = digits[r[i] & 15];
  }
  token[32] = 0;
}

sv_status sv_linux_preview_serve(sv_linux_preview *l, const char *program, const char *addr, int port,
                                 sv_err *err) {
  static char feed_text[16], pipe_text[16]; // argv's words outlive this call
  sv_status s = find_program(l, program, err);
  if (s < 0) return s;
  sv_fmt(l->listen, sizeof l->listen, strchr(addr, ':') ? "[%s]:%d" : "%s:%d", addr, port);
  sv_fmt(feed_text, sizeof feed_text, "%d", l->feed_fd);
  sv_fmt(pipe_text, sizeof pipe_text, "%d", l->pipe_fd[1]);
  if (!l->token[0]) make_token(l->token);
  // Not among the words, which every user of the machine can read: the environment is the owner's.
  if (setenv("SUBVIEW_PREVIEW_TOKEN", l->token, 1) != 0)
    return sv_fail(err, SV_E_NOMEM, "preview: no room for its token");
  char *argv[] = {l->program, "--listen", l->listen, "--feed-fd", feed_text, "--command-fd", pipe_text, NULL};
  size_t n = sizeof argv / sizeof *argv - 1;
  memcpy(l->argv, argv, sizeof argv);
  if (l->tls_file) {
    l->argv[n++] = "--tls";
    l->argv[n++] = (char *)(uintptr_t)l->tls_file;
    l->argv[n] = NULL;
  }
  if (l->scans[0]) {
    l->argv[n++] = "--scans";
    l->argv[n++] = l->scans;
  }
  if (l->scans[0] && l->scan_name[0]) {
    l->argv[n++] = "--scan-name";
    l->argv[n++] = l->scan_name;
  }
  if (l->scans[0] && sv_linux_exporter_open(&l->exporter)) {
    l->argv[n++] = "--exports";
    l->argv[n++] = "yes";
  }
  l->argv[n] = NULL;
  start_server(l);
  while (now_ns() - l->started_ns < READY_NS && !l->is_served && !l->is_refused && l->pid > 0) {
    struct pollfd p = {.fd = l->pipe_fd[0], .events = POLLIN};
    (void)poll(&p, 1, 50);
    char byte;
    while (read(l->pipe_fd[0], &byte, 1) == 1) (void)command_of(l, byte);
    if (waitpid(l->pid, NULL, WNOHANG) == l->pid) l->pid = 0;
  }
  for (char byte; read(l->pipe_fd[0], &byte, 1) == 1;)
    (void)command_of(l, byte); // its last word before it ended
  if (l->is_served) return SV_OK;
  if (l->is_refused) { // it has said why
    if (err) *err = (sv_err){.status = SV_E_DEVICE};
    return SV_E_DEVICE;
  }
  return sv_fail(err, SV_E_DEVICE, "preview: subview-preview %s on %s",
                 l->pid == 0 ? "does not serve" : "did not answer within 3 s", l->listen);
}

void sv_linux_preview_publish(sv_linux_preview *l, sv_publish *p) {
  p->feed = &l->feed;
  p->self = l;
  p->command = next_command;
  p->looked_at = looked_at;
}

void sv_linux_preview_close(sv_linux_preview *l) {
  sv_linux_exporter_close(&l->exporter);
  if (l->pid > 0) {
    kill(l->pid, SIGTERM);
    for (int i = 0; i < 40 && l->pid > 0; i++) {
      if (waitpid(l->pid, NULL, WNOHANG) == l->pid) l->pid = 0;
      else poll(NULL, 0, 25);
    }
    if (l->pid > 0) {
      kill(l->pid, SIGKILL);
      waitpid(l->pid, NULL, 0);
    }
  }
  if (l->block) munmap(l->block, l->block_bytes);
  int *fds[] = {&l->feed_fd, &l->pipe_fd[0], &l->pipe_fd[1]};
  for (size_t i = 0; i < sizeof fds / sizeof *fds; i++) {
    if (*fds[i] >= 0) close(*fds[i]);
    *fds[i] = -1;
  }
  l->block = NULL;
  l->pid = 0;
}

sv_status sv_linux_preview_parse(const char *text, char *addr, size_t cap_addr, int *port, sv_err *err) {
  const char *colon = strrchr(text, ':'), *number = colon ? colon + 1 : text;
  long long v;
  unsigned char raw[16];
  if (!sv_parse_int(number, strlen(number), &v) || v < 1 || v > 65535)
    return sv_fail(err, SV_E_ARG, "%s: expected [ADDR:]PORT with a port from 1 to 65535", text);
  *port = (int)v;
  sv_copy(addr, cap_addr, "127.0.0.1");
  if (!colon) return SV_OK;
  const char *from = text, *to = colon;
  if (from < to && *from == '[' && to[-1] == ']') {
    from++;
    to--;
  }
  if ((size_t)(to - from) + 1 > cap_addr) return sv_fail(err, SV_E_ARG, "%s: the address is too long", text);
  memcpy(addr, from, (size_t)(to - from));
  addr[to - from] = 0;
  if (sv_str_eq(addr, "localhost")) sv_copy(addr, cap_addr, "127.0.0.1");
  if (inet_pton(AF_INET, addr, raw) != 1 && (from == text || inet_pton(AF_INET6, addr, raw) != 1))
    return sv_fail(err, SV_E_ARG, "%s: expected [ADDR:]PORT with a numeric address, such as 0.0.0.0:8080",
                   text);
  return SV_OK;
}
