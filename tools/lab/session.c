// SPDX-License-Identifier: Apache-2.0
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "src/run/isa.h"
#include "src/base/str.h"
#include "tools/lab/lab.h"

sv_status lab_session_start(lab_session *s, long n_threads, bool is_quiet, sv_err *err) {
  long n = n_threads > 0 ? n_threads : sysconf(_SC_NPROCESSORS_ONLN);
  memset(s, 0, sizeof *s);
  s->folder_fd = -1;
  s->n_threads = (int)(n < 1 ? 1 : n > SV_LINUX_CAP_THREADS ? SV_LINUX_CAP_THREADS : n);
  sv_linux_console_init(&s->lines, 2, is_quiet);
  s->lines.live_period_ns = 3 * SV_NS_PER_S;
  s->console = sv_linux_console_port(&s->lines);
  s->clock = sv_linux_clock();
  // short work prints no progress into a log
  s->lines.last_live_ns = s->clock.now_ns(s->clock.self);
  sv_status st = sv_isa_choose(getenv("SV_ISA"), &s->isa_mask, err);
  sv_kernels_init(&s->k, s->isa_mask);
  if (st == SV_OK) st = sv_linux_pool_start(&s->threads, s->n_threads, -1, err);
  if (st == SV_OK) s->pool = sv_linux_pool_port(&s->threads);
  else s->n_threads = 0;
  return st;
}

void lab_session_stop(lab_session *s) {
  sv_linux_console_finish(&s->lines);
  if (s->n_threads) sv_linux_pool_stop(&s->threads);
  s->n_threads = 0;
  if (s->folder_fd >= 0) close(s->folder_fd);
  s->folder_fd = -1;
}

sv_status lab_session_folder(lab_session *s, const char *folder, sv_err *err) {
  return sv_path_lock_folder(folder, &s->folder_fd, err);
}

int lab_failed(lab_session *s, const sv_err *err) {
  char text[sizeof err->text];
  sv_copy(text, sizeof text, err->text);
  for (char *p = text; *p; p++)
    if ((unsigned char)*p < ' ') *p = '?'; // one line, whatever stands in a file's name
  s->console.log(s->console.self, SV_LOG_ERROR, text);
  return LAB_EXIT_FAILED;
}

double lab_seconds(const lab_session *s) { return 1e-9 * (double)s->clock.now_ns(s->clock.self); }

bool lab_is_stopped(const lab_session *s) { return s->console.is_stop_requested(s->console.self); }

long lab_peak_rss_bytes(void) {
  struct rusage u;
  return getrusage(RUSAGE_SELF, &u) == 0 ? u.ru_maxrss * 1024L : 0;
}

void lab_say(lab_session *s, const char *fmt, ...) {
  char line[400];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(line, sizeof line, fmt, ap);
  va_end(ap);
  s->console.log(s->console.self, SV_LOG_INFO, line);
}

void lab_last_line(const char *path, char *out, size_t cap) {
  void *data;
  size_t n;
  out[0] = 0;
  if (sv_file_read(path, &data, &n, NULL) != SV_OK) return;
  const char *text = data;
  while (n && (text[n - 1] == '\n' || text[n - 1] == ' ')) n--;
  size_t at = n;
  while (at && text[at - 1] != '\n' && text[at - 1] != '\r') at--;
  if (n - at > 7 && strncmp(text + at, "error: ", 7) == 0) at += 7;
  size_t k = n - at < cap - 1 ? n - at : cap - 1;
  memcpy(out, text + at, k);
  out[k] = 0;
  free(data);
}
