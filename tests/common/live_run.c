// SPDX-License-Identifier: Apache-2.0
#include "tests/common/live_run.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define CAP_WORDS 48

// A port that nobody has: the system chooses one.
static int free_port(void) {
  struct sockaddr_in a = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  socklen_t n = sizeof a;
  int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0 || bind(fd, (struct sockaddr *)&a, n) || getsockname(fd, (struct sockaddr *)&a, &n)) return 0;
  close(fd);
  return ntohs(a.sin_port);
}

static void read_err(live_run *r) {
  char path[320];
  snprintf(path, sizeof path, "%s/stderr", r->folder);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  ssize_t n = fd < 0 ? 0 : read(fd, r->err, sizeof r->err - 1);
  r->err[n > 0 ? n : 0] = 0;
  if (fd >= 0) close(fd);
}

// What a sanitizer has found in the run or in its server, which is started again, is a failure.
static void must_be_clean(const live_run *r) {
  static char text[64 << 10];
  static const char *const marks[] = {"Sanitizer", "runtime error:"};
  char path[320];
  snprintf(path, sizeof path, "%s/stderr", r->folder);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  ssize_t n = fd < 0 ? 0 : read(fd, text, sizeof text - 1);
  if (fd >= 0) close(fd);
  text[n > 0 ? n : 0] = 0;
  for (size_t i = 0; i < sizeof marks / sizeof *marks; i++)
    if (strstr(text, marks[i])) {
      fprintf(stderr, "%s\n", text);
      abort();
    }
}

static void exec_run(live_run *r, const char *args) {
  // the run is weighed: what it has touched, not the pages around that
  prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0);
  static char text[2048];
  char *words[CAP_WORDS], *save = NULL;
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  int n = 0, at = 0;
  at += snprintf(text, sizeof text, "%s %s/subview run --preview %s%d %s --out %s/out ",
                 emulate ? emulate : "", bin ? bin : "build/sim-x86/bin", r->is_open ? "0.0.0.0:" : "",
                 r->port, r->is_guarded ? "" : "--overwrite", r->folder);
  for (; *args && at < (int)sizeof text - 310; args++)
    if (*args == '@') at += snprintf(text + at, sizeof text - (size_t)at, "%s", r->folder);
    else text[at++] = *args;
  text[at] = 0;
  for (char *w = strtok_r(text, " ", &save); w && n < CAP_WORDS - 1; w = strtok_r(NULL, " ", &save))
    words[n++] = w;
  words[n] = NULL;
  char path[320];
  snprintf(path, sizeof path, "%s/stdout", r->folder);
  int out = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
  snprintf(path, sizeof path, "%s/stderr", r->folder);
  int err = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
  dup2(out, 1);
  dup2(err, 2);
  execv(words[0], words);
  _exit(98);
}

// Of --token-file: the log has no secret.
static bool read_token(live_run *r) {
  const char *mark = strstr(r->err, "(its token: "), *end = mark ? strchr(mark, ')') : NULL;
  char path[300];
  if (!end) return false;
  snprintf(path, sizeof path, "%.*s", (int)(end - mark) - 12, mark + 12);
  FILE *f = fopen(path, "r");
  if (!f) return false;
  const bool is_read = fscanf(f, "%32s", r->token) == 1;
  fclose(f);
  snprintf(r->link, sizeof r->link, "http://127.0.0.1:%d/#%s", r->port, r->token);
  return is_read;
}

static bool start_once(live_run *r, const char *folder, const char *args) {
  const bool is_open = r->is_open, is_guarded = r->is_guarded;
  memset(r, 0, sizeof *r);
  r->is_open = is_open;
  r->is_guarded = is_guarded;
  snprintf(r->folder, sizeof r->folder, "%s", folder);
  char old[320];
  snprintf(old, sizeof old, "%s/stderr", folder);
  (void)unlink(old); // what an earlier run said
  r->port = free_port();
  r->pid = fork();
  if (r->pid == 0) exec_run(r, args);
  for (int i = 0; i < 600; i++) {
    read_err(r);
    const char *mark = strstr(r->err, "/#"), *end = mark ? strchr(mark, '\n') : NULL;
    if (end && end - mark - 2 < (long)sizeof r->token) {
      memcpy(r->token, mark + 2, (size_t)(end - mark) - 2);
      snprintf(r->link, sizeof r->link, "http://127.0.0.1:%d/#%s", r->port, r->token);
      return true;
    }
    if (read_token(r)) return true;
    if (waitpid(r->pid, NULL, WNOHANG) == r->pid) {
      r->pid = 0;
      read_err(r);
      return false;
    }
    poll(NULL, 0, 50);
  }
  return false;
}

// Between the choice of a port and the server's use of it another program may take it.
bool live_run_start(live_run *r, const char *folder, const char *args) {
  for (int i = 0; i < 5; i++) {
    if (start_once(r, folder, args)) return true;
    if (!strstr(r->err, "the port is in use")) return false;
  }
  return false;
}

int live_run_wait(live_run *r, double seconds) {
  int status = 0;
  if (r->pid <= 0) return -1;
  for (int i = 0; i < (int)(seconds * 20) + 1; i++) {
    if (waitpid(r->pid, &status, WNOHANG) == r->pid) {
      r->pid = 0;
      read_err(r);
      must_be_clean(r);
      return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    poll(NULL, 0, 50);
  }
  return -1;
}

int live_run_stop(live_run *r) {
  if (r->pid <= 0) return -1;
  kill(r->pid, SIGINT);
  int code = live_run_wait(r, 30);
  if (r->pid > 0) {
    kill(r->pid, SIGKILL);
    waitpid(r->pid, NULL, 0);
    r->pid = 0;
  }
  return code;
}

static long number_in(const char *path, const char *key) {
  char text[4096];
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  ssize_t n = fd < 0 ? 0 : read(fd, text, sizeof text - 1);
  if (fd >= 0) close(fd);
  text[n > 0 ? n : 0] = 0;
  const char *p = strstr(text, key);
  return p ? strtol(p + strlen(key), NULL, 10) : 0;
}

long live_run_rss_kib(const live_run *r) {
  char path[64];
  snprintf(path, sizeof path, "/proc/%d/status", (int)r->pid);
  return number_in(path, "VmRSS:");
}

pid_t live_run_server(const live_run *r) {
  DIR *d = opendir("/proc");
  pid_t found = 0;
  for (struct dirent *e; d && !found && (e = readdir(d));) {
    char path[300];
    pid_t pid = (pid_t)strtol(e->d_name, NULL, 10);
    if (pid <= 0) continue;
    snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
    if (number_in(path, "PPid:") == r->pid && number_in(path, "State:\tZ") == 0) found = pid;
  }
  if (d) closedir(d);
  return found;
}

// --- HTTP ----------------------------------------------------------------------------------------

int live_run_connect(const live_run *r) { return live_run_connect_from(r, 1); }

int live_run_connect_from(const live_run *r, int host) {
  struct sockaddr_in from = {.sin_family = AF_INET,
                             .sin_addr.s_addr = htonl(INADDR_LOOPBACK - 1 + (in_addr_t)host)};
  struct sockaddr_in a = {
      .sin_family = AF_INET, .sin_port = htons((uint16_t)r->port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  struct timeval limit = {.tv_sec = 10};
  int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return -1;
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
  if (bind(fd, (struct sockaddr *)&from, sizeof from) == 0 &&
      connect(fd, (struct sockaddr *)&a, sizeof a) == 0)
    return fd;
  close(fd);
  return -1;
}

size_t live_run_request(const live_run *r, const char *method, const char *path, const char *headers,
                        uint8_t *out, size_t cap) {
  char text[4096];
  size_t got = 0;
  out[0] = 0;
  int fd = live_run_connect(r);
  if (fd < 0) return 0;
  int n = snprintf(text, sizeof text, "%s %s HTTP/1.1\r\nConnection: close\r\n%s", method, path,
                   headers ? headers : "");
  if (!headers || !strstr(headers, "Host:"))
    n += snprintf(text + n, sizeof text - (size_t)n, "Host: 127.0.0.1:%d\r\n", r->port);
  n += snprintf(text + n, sizeof text - (size_t)n, "\r\n");
  if (send(fd, text, (size_t)n, MSG_NOSIGNAL) == n)
    for (ssize_t more; got + 1 < cap && (more = recv(fd, out + got, cap - 1 - got, 0)) > 0;)
      got += (size_t)more;
  close(fd);
  out[got] = 0;
  return got;
}

size_t live_run_get(const live_run *r, const char *path, const char *headers, uint8_t *out, size_t cap) {
  return live_run_request(r, "GET", path, headers, out, cap);
}

int live_run_code(const uint8_t *answer) {
  return !strncmp((const char *)answer, "HTTP/1.1 ", 9) ? (int)strtol((const char *)answer + 9, NULL, 10) : 0;
}

const uint8_t *live_run_body(const uint8_t *answer, size_t n) {
  for (size_t i = 0; i + 4 <= n; i++)
    if (!memcmp(answer + i, "\r\n\r\n", 4)) return answer + i + 4;
  return NULL;
}
