// SPDX-License-Identifier: Apache-2.0
#include "tests/common/browser.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define ANSWER_MS 60000
#define TRIES     3 // a loaded machine starts it late at times

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

const char *browser_program(void) {
  static const char *const paths[] = {"/usr/bin/chromium", "/usr/bin/chromium-browser",
                                      "/usr/bin/google-chrome"};
  for (size_t i = 0; i < sizeof paths / sizeof *paths; i++)
    if (access(paths[i], X_OK) == 0) return paths[i];
  return NULL;
}

static void exec_browser(const browser *b, const char *program, const char *folder, int w, int h) {
  char profile[320], size[64], home[320], log[320];
  snprintf(profile, sizeof profile, "--user-data-dir=%s", folder);
  snprintf(size, sizeof size, "--window-size=%d,%d", w, h);
  snprintf(home, sizeof home, "%s/home", folder);
  snprintf(log, sizeof log, "%s/browser.log", folder);
  setenv("HOME", home, 1);
  setenv("TMPDIR", b->sockets, 1);
  int fd = open("/dev/null", O_RDWR);
  if (fd >= 0) {
    dup2(fd, 0);
    dup2(fd, 1);
  }
  int words = open(log, O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (words >= 0) dup2(words, 2);
  execl(program, program, "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--use-gl=angle",
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run", "--disable-extensions",
        "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
        "--hide-scrollbars", profile, size, "about:blank", (char *)NULL);
  _exit(98);
}

static bool send_all(int fd, const char *text, size_t n) {
  while (n > 0) {
    ssize_t done = write(fd, text, n);
    if (done <= 0) return false;
    text += done;
    n -= (size_t)done;
  }
  return true;
}

// Sends {"id":N,"method":METHOD,"params":PARAMS} and reads until its answer is in b->message.
static bool call(browser *b, const char *method, const char *params) {
  char head[256];
  int id = ++b->i_message;
  int n = b->session[0] ? snprintf(head, sizeof head,
                                   "{\"id\":%d,\"sessionId\":\"%s\",\"method\":\"%s\",\"params\":", id,
                                   b->session, method)
                        : snprintf(head, sizeof head, "{\"id\":%d,\"method\":\"%s\",\"params\":", id, method);
  if (!send_all(b->to_fd, head, (size_t)n) || !send_all(b->to_fd, params, strlen(params)) ||
      !send_all(b->to_fd, "}", 2))
    return false;
  char wanted[32];
  snprintf(wanted, sizeof wanted, "{\"id\":%d,", id);
  double until = now_s() + ANSWER_MS * 1e-3;
  b->n_message = 0;
  while (now_s() < until) {
    struct pollfd p = {.fd = b->from_fd, .events = POLLIN};
    if (poll(&p, 1, 200) <= 0) continue;
    ssize_t got = read(b->from_fd, b->message + b->n_message, BROWSER_CAP_MESSAGE - 1 - b->n_message);
    if (got <= 0) return false;
    b->n_message += (size_t)got;
    for (char *end; (end = memchr(b->message, 0, b->n_message));) {
      size_t length = (size_t)(end - b->message) + 1;
      if (!strncmp(b->message, wanted, strlen(wanted))) return !strstr(b->message, "\"error\":{\"code\"");
      // an event, or an answer that nobody waits for
      memmove(b->message, end + 1, b->n_message - length);
      b->n_message -= length;
    }
  }
  return false;
}

// The text of "key":"..." in the last answer; escapes of JSON are undone.
static bool text_of(const browser *b, const char *key, char *out, size_t cap) {
  char mark[64];
  snprintf(mark, sizeof mark, "\"%s\":\"", key);
  const char *p = strstr(b->message, mark);
  if (!p) return false;
  size_t n = 0;
  for (p += strlen(mark); *p && *p != '"' && n + 1 < cap; p++) {
    if (*p == '\\') {
      p++;
      out[n++] = *p == 'n' ? '\n' : *p;
    } else out[n++] = *p;
  }
  out[n] = 0;
  return true;
}

static bool open_once(browser *b, const char *folder, int w, int h) {
  int to[2], from[2];
  memset(b, 0, sizeof *b);
  b->message = malloc(BROWSER_CAP_MESSAGE);
  snprintf(b->sockets, sizeof b->sockets, "/tmp/sv_browser_XXXXXX");
  if (!mkdtemp(b->sockets)) return false;
  if (!b->message || pipe2(to, O_CLOEXEC) || pipe2(from, O_CLOEXEC)) return false;
  signal(SIGPIPE, SIG_IGN);
  b->pid = fork();
  if (b->pid == 0) {
    setpgid(0, 0);
    int in = fcntl(to[0], F_DUPFD, 10), out = fcntl(from[1], F_DUPFD, 10);
    dup2(in, 3);
    dup2(out, 4);
    close(in);
    close(out);
    exec_browser(b, browser_program(), folder, w, h);
  }
  close(to[0]);
  close(from[1]);
  b->to_fd = to[1];
  b->from_fd = from[0];
  char target[64], params[128];
  if (!call(b, "Target.createTarget", "{\"url\":\"about:blank\"}") ||
      !text_of(b, "targetId", target, sizeof target))
    return false;
  snprintf(params, sizeof params, "{\"targetId\":\"%s\",\"flatten\":true}", target);
  if (!call(b, "Target.attachToTarget", params)) return false;
  char session[64];
  if (!text_of(b, "sessionId", session, sizeof session)) return false;
  memcpy(b->session, session, sizeof session);
  return browser_size(b, w, h, false);
}

// What the browser itself says last, or that it said nothing.
static void last_words(const char *folder, char *why, size_t cap) {
  char path[320], line[400];
  snprintf(path, sizeof path, "%s/browser.log", folder);
  snprintf(why, cap, "it says nothing");
  FILE *f = fopen(path, "r");
  while (f && fgets(line, sizeof line, f))
    if (line[0] != '\n') snprintf(why, cap, "%.*s", (int)strcspn(line, "\n"), line);
  if (f) fclose(f);
}

bool browser_open(browser *b, const char *folder, int w, int h, char *why, size_t cap) {
  for (int i = 0; i < TRIES; i++) {
    char own[300];
    snprintf(own, sizeof own, "%s/browser%d", folder, i);
    mkdir(own, 0700);
    if (open_once(b, own, w, h)) return true;
    browser_close(b);
    last_words(own, why, cap);
  }
  return false;
}

bool browser_goto(browser *b, const char *url) {
  char params[512];
  snprintf(params, sizeof params, "{\"url\":\"%s\"}", url);
  return call(b, "Page.navigate", params);
}

static void add_escaped(char *out, size_t cap, const char *text) {
  size_t n = strlen(out);
  for (; *text && n + 3 < cap; text++) {
    if (*text == '"' || *text == '\\') out[n++] = '\\';
    out[n++] = *text == '\n' ? ' ' : *text;
  }
  out[n] = 0;
}

bool browser_eval(browser *b, const char *expression, char *out, size_t cap) {
  static char params[32 << 10];
  snprintf(params, sizeof params,
           "{\"awaitPromise\":true,\"returnByValue\":true,\"expression\":\"(async()=>String(await(");
  add_escaped(params, sizeof params - 16, expression);
  strcat(params, ")))()\"}");
  out[0] = 0;
  if (!call(b, "Runtime.evaluate", params) || strstr(b->message, "\"exceptionDetails\"")) return false;
  return text_of(b, "value", out, cap);
}

bool browser_inject(browser *b, const char *path) {
  FILE *f = fopen(path, "rb");
  if (!f) return false;
  fseek(f, 0, SEEK_END);
  const size_t n = (size_t)ftell(f);
  rewind(f);
  char *text = calloc(1, n + 1), *params = malloc(6 * n + 64);
  bool ok = text && params && fread(text, 1, n, f) == n;
  fclose(f);
  if (ok) {
    char *o = params + sprintf(params, "{\"expression\":\"");
    for (size_t i = 0; i < n; i++)
      o += sprintf(o, text[i] == '"' || text[i] == '\\' || (unsigned char)text[i] < 32 ? "\\u%04x" : "%c",
                   text[i]);
    strcpy(o, ";0\"}");
    ok = call(b, "Runtime.evaluate", params) && !strstr(b->message, "\"exceptionDetails\"");
  }
  free(text);
  free(params);
  return ok;
}

double browser_number(browser *b, const char *expression) {
  char text[64];
  return browser_eval(b, expression, text, sizeof text) ? strtod(text, NULL) : (double)NAN;
}

bool browser_wait(browser *b, const char *expression, double seconds) {
  char text[64];
  for (double until = now_s() + seconds; now_s() < until;) {
    if (browser_eval(b, expression, text, sizeof text) && !strcmp(text, "true")) return true;
    poll(NULL, 0, 100);
  }
  return false;
}

static int digit(char c) {
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const char *p = c ? strchr(digits, c) : NULL;
  return p ? (int)(p - digits) : -1;
}

bool browser_screenshot(browser *b, const char *path) {
  const size_t n_path = strlen(path);
  const bool is_jpeg = n_path > 4 && !strcmp(path + n_path - 4, ".jpg");
  if (!call(b, "Page.captureScreenshot",
            is_jpeg ? "{\"format\":\"jpeg\",\"quality\":72}" : "{\"format\":\"png\"}"))
    return false;
  const char *p = strstr(b->message, "\"data\":\"");
  FILE *f = p ? fopen(path, "wb") : NULL;
  if (!f) return false;
  uint32_t bits = 0;
  int n = 0;
  for (p += 8; digit(*p) >= 0; p++) {
    bits = bits << 6 | (uint32_t)digit(*p);
    n += 6;
    if (n >= 8) {
      n -= 8;
      fputc((int)(bits >> n & 255), f);
    }
  }
  return fclose(f) == 0;
}

static bool mouse(browser *b, const char *type, double x, double y, bool is_down) {
  char params[256];
  snprintf(params, sizeof params,
           "{\"type\":\"%s\",\"x\":%g,\"y\":%g,\"button\":\"%s\",\"buttons\":%d,\"clickCount\":1}", type, x,
           y, "left", is_down);
  return call(b, "Input.dispatchMouseEvent", params);
}

bool browser_drag(browser *b, double x0, double y0, double x1, double y1, int n) {
  bool ok = mouse(b, "mousePressed", x0, y0, true);
  for (int i = 1; ok && i <= n; i++)
    ok = mouse(b, "mouseMoved", x0 + (x1 - x0) * i / n, y0 + (y1 - y0) * i / n, true);
  return mouse(b, "mouseReleased", x1, y1, false) && ok;
}

bool browser_click(browser *b, const char *selector) {
  char script[700], place[64];
  // Layout and scrolling settle late on a loaded machine, and after the window has another size
  snprintf(script, sizeof script,
           "(async()=>{for(let k=0;k<20;k++){const e=document.querySelector('%s');"
           "if(e){e.scrollIntoView({block:'center',inline:'center'});"
           "for(let i=0;i<3;i++)await new Promise(requestAnimationFrame);"
           "const r=e.getBoundingClientRect(),x=r.x+r.width/2,y=r.y+r.height/2,"
           "t=document.elementFromPoint(x,y);if(!e.disabled&&t&&(e===t||e.contains(t)))return x+' '+y}"
           "await new Promise((f)=>setTimeout(f,50))}throw new Error('covered')})()",
           selector);
  if (!browser_eval(b, script, place, sizeof place)) return false;
  char *end;
  const double x = strtod(place, &end), y = strtod(end, NULL);
  return browser_drag(b, x, y, x, y, 0);
}

bool browser_size(browser *b, int w, int h, bool is_phone) {
  char params[256];
  snprintf(params, sizeof params, "{\"width\":%d,\"height\":%d,\"deviceScaleFactor\":1,\"mobile\":%s}", w, h,
           is_phone ? "true" : "false");
  return call(b, "Emulation.setDeviceMetricsOverride", params);
}

void browser_close(browser *b) {
  if (b->pid > 0) {
    kill(-b->pid, SIGKILL); // its own group: all its processes
    while (waitpid(b->pid, NULL, 0) < 0 && errno == EINTR) continue;
    close(b->to_fd);
    close(b->from_fd);
  }
  char command[64];
  snprintf(command, sizeof command, "rm -rf '%s'", b->sockets);
  if (b->sockets[0] && system(command) != 0) perror(b->sockets);
  free(b->message);
  memset(b, 0, sizeof *b);
}
