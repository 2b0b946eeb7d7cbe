// SPDX-License-Identifier: Apache-2.0
// A capture folder: capture.json, a zero byte, the picture "c/0.jpg", of which a replay delivers
// what it can. The same text is also parsed in memory.
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/replay/replay.h"
#include "tests/fuzz/fuzz.h"

#define CAP_BLOCK (8u << 20)

static _Alignas(64) uint8_t block[CAP_BLOCK];
static char dir[64];

static void remove_dir(void) {
  char path[100];
  static const char *const names[] = {"/capture.json", "/c/0.jpg", "/c", ""};
  for (int i = 0; i < 4; i++) {
    snprintf(path, sizeof path, "%s%s", dir, names[i]);
    (void)remove(path);
  }
}

static void make_dir(void) {
  char path[100];
  if (dir[0]) return;
  snprintf(dir, sizeof dir, "%s/fuzz_capture_XXXXXX", access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp");
  FUZZ_CHECK(mkdtemp(dir) != NULL);
  snprintf(path, sizeof path, "%s/c", dir);
  FUZZ_CHECK(mkdir(path, 0700) == 0);
  atexit(remove_dir);
}

static void put(const char *name, const uint8_t *data, size_t n) {
  char path[100];
  snprintf(path, sizeof path, "%s/%s", dir, name);
  const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  FUZZ_CHECK(fd >= 0 && write(fd, data, n) == (ssize_t)n);
  close(fd);
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const char head[] =
      "{\"version\":1,\"name\":\"k\",\"rig\":\"rig\",\"scene\":{\"min_m\":[-1,-1,0],\"max_m\":[1,1,2]},"
      "\"cameras\":["
      "{\"name\":\"left\",\"folder\":\"c\",\"width\":16,\"height\":8,\"fps\":10,\"clock\":\"monotonic\","
      "\"stamp\":"
      "\"middle\",\"frames\":[{\"file\":\"0.jpg\",\"sequence\":0,\"camera_ns\":100,\"arrival_ns\":200,"
      "\"exposure_ns\":5},{\"file\":\"0.jpg\",\"camera_ns\":300}]}],\"poses\":[{\"time_ns\":100,\"rig_from_"
      "world\":"
      "[1,0,0,0,0,0,1]},{\"time_ns\":300,\"rig_from_world\":[0.6,0.8,0,0,0,0,1]}]}";
  static uint8_t memory[1 << 20], px[16 * 8 * 3];
  size_t n = 0;
  if (i > 1 || cap < sizeof head + 4096) return 0;
  memcpy(buf, head, sizeof head); // with its zero byte
  if (i == 0) return sizeof head;
  sv_arena a = sv_arena_make(memory, sizeof memory);
  sv_codec codec;
  const sv_codec_cfg cfg = {16, 8, false};
  const sv_picture in = {16, 8, 48, SV_PIX_RGB8, px};
  for (size_t k = 0; k < sizeof px; k++) px[k] = (uint8_t)(k * 5);
  FUZZ_CHECK(sv_codec_init(&codec, &cfg, &a) == SV_OK);
  const sv_codec_buffer out = {buf + sizeof head, cap - sizeof head};
  FUZZ_CHECK(sv_codec_encode_jpeg(&codec, &in, (sv_jpeg_options){90, true}, out, &n, NULL) == SV_OK);
  sv_codec_close(&codec);
  return sizeof head + n;
}

// A step out of the folder.
static bool leaves_folder(const char *file) {
  for (const char *p = file; (p = strstr(p, "..")); p += 2)
    if ((p == file || p[-1] == '/') && (p[2] == '/' || !p[2])) return true;
  return file[0] == '/';
}

static void parse(const uint8_t *data, size_t n) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_capture c;
  sv_pose pose;
  sv_err err = {0};
  char *text = malloc(n + 1);
  FUZZ_CHECK(text != NULL);
  memcpy(text, data, n);
  text[n] = 0;
  const sv_status s = sv_capture_parse(&c, text, n, "f", &a, &err);
  FUZZ_CHECK(s == SV_OK || (s < 0 && err.text[0]));
  for (int i = 0; s == SV_OK && i < c.n_cameras; i++)
    for (int k = 0; k < c.cameras[i].n_frames; k++) FUZZ_CHECK(!leaves_folder(c.cameras[i].frames[k].file));
  if (s == SV_OK && sv_capture_pose_at(&c, 150, &pose) == SV_OK)
    for (int k = 0; k < 9; k++) FUZZ_CHECK(isfinite(pose.r[k]));
  free(text);
}

static void replay(void) {
  sv_arena a = sv_arena_make(block, sizeof block);
  static sv_replay r;
  sv_replay_cfg cfg = {.speed = 0, .n_buffers = 1};
  sv_err err;
  sv_frame f;
  snprintf(cfg.dir, sizeof cfg.dir, "%s", dir);
  if (sv_replay_init(&r, &cfg, &a, &err) == SV_OK) {
    sv_source s = sv_replay_source(&r);
    if (s.start(s.self) == SV_OK) {
      for (int i = 0; i < 4; i++) {
        const sv_status got = s.dequeue(s.self, &f, INT64_MAX);
        if (got == SV_END) break;
        if (got == SV_OK) FUZZ_CHECK(s.requeue(s.self, &f) == SV_OK);
      }
      FUZZ_CHECK(s.stop(s.self) == SV_OK);
    }
  }
  sv_replay_close(&r);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  const uint8_t *zero = bytes ? memchr(data, 0, bytes) : NULL;
  const size_t n = zero ? (size_t)(zero - data) : bytes;
  make_dir();
  parse(data, n);
  put("capture.json", data, n);
  put("c/0.jpg", zero ? zero + 1 : data, zero ? bytes - n - 1 : 0);
  replay();
  return 0;
}
