// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// Bytes of a client to the page's server, without its sandbox, over a connection on loopback.
// "00000" in the input stands for the server's port, as its checks of host and origin want it.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/fuzz/page_feed.h"

#define TOKEN   "0123456789abcdef0123456789abcdef"
#define N_STEPS 6

static pv_server *server;
static int port, commands[2];

static void make(void) {
  static pv_server_cfg cfg;
  sv_err err;
  if (server) return;
  page_make();
  FUZZ_CHECK(pipe(commands) == 0 && fcntl(commands[0], F_SETFL, O_NONBLOCK) == 0 &&
             fcntl(commands[1], F_SETFL, O_NONBLOCK) == 0);
  for (int i = 0; i < 50; i++) {
    port = 20000 + (int)((unsigned)getpid() * 7 + (unsigned)i * 131) % 40000;
    cfg = (pv_server_cfg){.source = &page_source,
                          .addr = "127.0.0.1",
                          .port = port,
                          .command_fd = commands[1],
                          .token = TOKEN,
                          .read_key = TOKEN,
                          .is_private = true};
    if (pv_server_open(&server, &cfg, &err) == SV_OK) return;
  }
  abort();
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
#define HOST " HTTP/1.1\r\nHost: 127.0.0.1:00000\r\nX-Subview-Token: " TOKEN "\r\n"
  static const char *const texts[] = {
      "GET /" HOST "\r\n",
      "GET /state" HOST "Connection: close\r\n\r\n",
      "GET /model?after=1" HOST "\r\nGET /model.spz" HOST "\r\nGET /model.ply" HOST "\r\n",
      "GET /stream" HOST "\r\n",
      "GET /cameras" HOST "\r\n",
      "GET /camera?i=1" HOST "\r\n",
      "GET /picture.jpg" HOST "Accept: */*\r\n\r\n",
      "POST /start" HOST "Content-Length: 2\r\nOrigin: http://127.0.0.1:00000\r\n\r\nab",
      "POST /enter" HOST "Content-Length: 0\r\n\r\nHEAD /curve" HOST "Cookie: subview-00000=" TOKEN
      "\r\n\r\n",
      "POST /enter" HOST "X-Subview-Page: " TOKEN "\r\n\r\nPOST /keep" HOST "X-Subview-Page: " TOKEN
      "\r\n\r\n",
      "POST /ask" HOST "X-Subview-Page: abcdefghijklmnopq\r\n\r\nPOST /give" HOST "\r\n",
      "POST /pin" HOST "\r\nPOST /pair" HOST "X-Subview-Pin: 123456\r\n\r\nPOST /qr" HOST "\r\n",
      "POST /calibrate?board=9x6&mm=24&lens=fisheye" HOST "\r\nGET /calibration" HOST "\r\n",
      "GET /board.pdf?board=9x6&paper=a4" HOST "\r\nGET /board.svg?board=64x3" HOST "\r\n",
      "GET /scans" HOST "\r\nGET /scan/1/model.spz" HOST "\r\nGET /scan/12/preview.jpg" HOST "\r\n",
      "POST /scan/1/delete" HOST "\r\nPOST /scan/1/restore" HOST "\r\nPOST /scan/99999999/purge" HOST "\r\n",
      "POST /draft" HOST "\r\nPOST /fine" HOST "\r\n",
      "PUT /x HTTP/1.0\r\nHost: evil\r\nSec-Fetch-Site: cross-site\r\n\r\n",
      "POST /save" HOST "Transfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n"};
  if (i >= (int)(sizeof texts / sizeof *texts) || strlen(texts[i]) > cap) return 0;
  memcpy(buf, texts[i], strlen(texts[i]));
  return strlen(texts[i]);
}

static size_t with_port(const uint8_t *data, size_t bytes, char *out, size_t cap) {
  const size_t n = bytes < cap ? bytes : cap;
  char digits[8];
  snprintf(digits, sizeof digits, "%05d", port);
  if (n) memcpy(out, data, n);
  for (size_t i = 0; i + 5 <= n; i++)
    if (memcmp(out + i, "00000", 5) == 0) memcpy(out + i, digits, 5);
  return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static char text[1 << 16], answer[1 << 16];
  make();
  const size_t n = with_port(data, bytes, text, sizeof text);
  const struct sockaddr_in a = {
      .sin_family = AF_INET, .sin_port = htons((uint16_t)port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  const struct linger now = {1, 0};
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  FUZZ_CHECK(fd >= 0 && connect(fd, (const struct sockaddr *)&a, sizeof a) == 0);
  setsockopt(fd, SOL_SOCKET, SO_LINGER, &now, sizeof now);
  fcntl(fd, F_SETFL, O_NONBLOCK);
  (void)!send(fd, text, n, MSG_NOSIGNAL);
  shutdown(fd, SHUT_WR);
  for (int i = 0; i < N_STEPS; i++) {
    pv_server_step(server, 1);
    const ssize_t got = recv(fd, answer, sizeof answer - 1, 0);
    if (got == 0) break;
    if (got < 12) continue;
    answer[got] = 0;
    if (i == 0) FUZZ_CHECK(strncmp(answer, "HTTP/1.", 7) == 0 || n == 0);
  }
  close(fd);
  pv_server_step(server, 1);
  char byte[64];
  while (read(commands[0], byte, sizeof byte) > 0) continue; // what it told the runtime
  return 0;
}
