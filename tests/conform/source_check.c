// SPDX-License-Identifier: Apache-2.0
// The source-conformance suite on cameras that are there: source-check v4l2:/dev/video0[,...] or
// libcamera:0[,...]. Runs on the virtual board, or by hand on a real one. One line a check; exit 1
// when one failed.
#include <stdio.h>
#include <string.h>

#include "platform/libcamera/libcamera.h"
#include "platform/linux/linux.h"
#include "platform/v4l2/v4l2.h"
#include "tests/common/source_suite.h"

static _Alignas(64) uint8_t block[4 << 20];
static sv_v4l2 v4l2;
static sv_libcamera *libcamera;

static sv_status open_source(const char *spec, source_suite *s, sv_err *err) {
  sv_camera_options o;
  sv_arena arena = sv_arena_make(block, sizeof block);
  bool is_v4l2 = !strncmp(spec, "v4l2:", 5);
  const char *rest = strchr(spec, ':');
  memset(s, 0, sizeof *s);
  s->clock = sv_linux_clock();
  s->may_lose = true;
  if (!rest || (!is_v4l2 && strncmp(spec, "libcamera:", 10)))
    return sv_fail(err, SV_E_ARG, "%s: expected v4l2:... or libcamera:...", spec);
  sv_status r = sv_camera_parse(is_v4l2 ? "v4l2" : "libcamera", rest + 1, &o, err);
  if (r < 0) return r;
  o.settle_ns = 0; // the suite starts and stops a hundred times
  if (is_v4l2) {
    sv_v4l2_sys sys = sv_v4l2_linux();
    r = sv_v4l2_init(&v4l2, &o, &sys, &s->clock, &arena, err);
    s->source = sv_v4l2_source(&v4l2);
  } else {
    r = sv_libcamera_open(&libcamera, &o, &s->clock, err);
    if (r >= 0) s->source = sv_libcamera_source(libcamera);
  }
  return r;
}

static void close_source(void) {
  sv_v4l2_close(&v4l2);
  sv_libcamera_close(libcamera);
  libcamera = NULL;
}

int main(int argc, char **argv) {
  static const struct {
    const char *name;
    bool (*run)(source_suite *s, int n);
  } kinds[] = {{"capture", source_suite_capture},
               {"start_stop", source_suite_start_stop},
               {"unbalanced_stop", source_suite_unbalanced}};
  source_suite s;
  sv_err err;
  int n_passed = 0, n_failed = 0;
  setvbuf(stdout, NULL, _IOLBF, 0);
  if (argc != 2) {
    fprintf(stderr, "usage: source-check v4l2:/dev/videoN[,...] | libcamera:N[,...]\n");
    return 2;
  }
  if (open_source(argv[1], &s, &err) < 0) {
    fprintf(stderr, "source-check: %s\n", err.text);
    return 1;
  }
  for (int k = 0; k <= 3; k++)
    for (int i = 0; i < (k < 3 ? SOURCE_SUITE_N_COUNTS : 1); i++) {
      int n = source_suite_counts[i];
      s.why[0] = 0;
      bool is_good = k < 3 ? kinds[k].run(&s, n) : source_suite_bad_calls(&s);
      if (!is_good) (void)s.source.stop(s.source.self);
      printf("%s %s %d%s%s\n", is_good ? "ok  " : "FAIL", k < 3 ? kinds[k].name : "bad_calls", k < 3 ? n : 0,
             is_good ? "" : ": ", s.why);
      n_passed += is_good;
      n_failed += !is_good;
    }
  close_source();
  printf("%d passed, %d failed; %llu frames of %d cameras\n", n_passed, n_failed,
         (unsigned long long)s.n_seen, s.source.n_cameras);
  return n_failed != 0;
}
