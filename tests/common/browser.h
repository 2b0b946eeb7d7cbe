// SPDX-License-Identifier: Apache-2.0
// A headless Chromium in a test, driven over its debugging pipe (Chrome DevTools Protocol): no
// other tool is needed.
#ifndef SV_TESTS_COMMON_BROWSER_H
#define SV_TESTS_COMMON_BROWSER_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#ifdef __cplusplus
extern "C" {
#endif

#define BROWSER_CAP_MESSAGE (24u << 20)

typedef struct {
  pid_t pid;
  int to_fd, from_fd, i_message;
  char session[64];
  char sockets[32]; // a folder with a short name: the path of a socket has room for 108 characters
  char *message;    // [BROWSER_CAP_MESSAGE] the last answer
  size_t n_message;
} browser;

// The program's path, NULL when there is none.
const char *browser_program(void);
// Starts it with a window of that size, a profile below the folder. False: it does not start; why:
// its last words.
bool browser_open(browser *b, const char *folder, int width_px, int height_px, char *why, size_t cap_why);
bool browser_goto(browser *b, const char *url);
// What an expression (or its promise) gives, as text. False when it throws.
bool browser_eval(browser *b, const char *expression, char *out, size_t cap);
double browser_number(browser *b, const char *expression); // NaN when it throws
// Asks every 100 ms until the expression is true.
bool browser_wait(browser *b, const char *expression, double seconds);
bool browser_screenshot(browser *b, const char *path); // PNG, or JPEG where the name ends so
// Presses at x0, y0, moves to x1, y1 in steps, lets go.
bool browser_drag(browser *b, double x0, double y0, double x1, double y1, int n_steps);
// A click in the middle of the element. False: it is not there, disabled or covered.
bool browser_click(browser *b, const char *selector);
// Runs a script of any length from a file.
bool browser_inject(browser *b, const char *path);
bool browser_size(browser *b, int width_px, int height_px, bool is_phone);
void browser_close(browser *b);

#ifdef __cplusplus
}
#endif
#endif
