// SPDX-License-Identifier: Apache-2.0
#include "tests/common/source_suite.h"

#include <string.h>

#include "src/base/str.h"

#define CAP_CAMERAS 16
#define CAP_LOAN    256

const int source_suite_counts[SOURCE_SUITE_N_COUNTS] = {1, 2, 3, 5, 8, 13, 21, 34, 55, 89};

typedef struct {
  sv_ns last_arrival_ns;
  bool has_last[CAP_CAMERAS];
  uint32_t last_sequence[CAP_CAMERAS];
  sv_ns last_camera_ns[CAP_CAMERAS];
} stream;

static bool check(source_suite *s, bool is_good, const char *what, long long got, long long want) {
  if (is_good || s->why[0]) return is_good;
  sv_fmt(s->why, sizeof s->why, "%s: %lld, expected %lld", what, got, want);
  return false;
}
#define CHECK(cond, what)                                                                                    \
  if (!check(s, (cond), what, 0, 1)) return false
#define SAME(got, want, what)                                                                                \
  do {                                                                                                       \
    long long g_ = (long long)(got), w_ = (long long)(want);                                                 \
    if (!check(s, g_ == w_, what, g_, w_)) return false;                                                     \
  } while (0)

static bool check_pixels(source_suite *s, const sv_frame *f, const sv_camera_caps *c) {
  bool is_coded = sv_pixel(f->format)->layout == SV_LAYOUT_CODED;
  CHECK(f->data && f->data_bytes > 0, "the frame has data");
  CHECK(f->data_bytes <= c->frame_bytes || is_coded, "the frame is not larger than told");
  if (!is_coded) {
    size_t row = sv_pixel_row_bytes(f->format, f->width_px);
    CHECK(f->stride_bytes >= 0 && (size_t)f->stride_bytes >= row, "the stride holds a row");
    CHECK(f->data_bytes >= (size_t)f->stride_bytes * (size_t)(f->height_px - 1) + row, "all rows are there");
  }
  uint32_t sum = 0; // every byte may be read, and it is a picture
  for (size_t i = 0; i < f->data_bytes; i++) sum += f->data[i];
  CHECK(sum > 0, "the picture is not black");
  return true;
}

static bool check_frame(source_suite *s, stream *st, const sv_frame *f) {
  sv_camera_caps c;
  int k = f->i_camera;
  CHECK(k >= 0 && k < s->source.n_cameras && k < CAP_CAMERAS, "the frame's camera exists");
  SAME(s->source.caps(s->source.self, k, &c), SV_OK, "caps");
  SAME(f->width_px, c.width_px, "width");
  SAME(f->height_px, c.height_px, "height");
  SAME(f->format, c.format, "format");
  CHECK(s->may_lose || !f->is_error, "the frame is whole");
  if (!f->is_error && !check_pixels(s, f, &c)) return false;
  CHECK(f->arrival_ns >= st->last_arrival_ns, "arrivals are in order");
  CHECK(f->arrival_ns <= s->clock.now_ns(s->clock.self), "the arrival is not in the future");
  if (st->has_last[k]) {
    CHECK(f->sequence > st->last_sequence[k], "the sequence number grows");
    CHECK(f->camera_ns > st->last_camera_ns[k], "the camera's stamp grows");
  }
  st->last_arrival_ns = f->arrival_ns;
  st->has_last[k] = true;
  st->last_sequence[k] = f->sequence;
  st->last_camera_ns[k] = f->camera_ns;
  s->n_seen++;
  return true;
}

// A camera that was started again counts from 0, and says so before its next frame.
static void note_restarts(source_suite *s, stream *st) {
  sv_camera_event e;
  while (s->source.event && s->source.event(s->source.self, &e) == SV_OK)
    if ((e.kind == SV_CAMERA_RESTARTED || e.kind == SV_CAMERA_RETURNED) && e.i_camera >= 0 &&
        e.i_camera < CAP_CAMERAS)
      st->has_last[e.i_camera] = false;
}

static bool capture(source_suite *s, int n, bool is_balanced) {
  static sv_frame on_loan[CAP_LOAN];
  sv_source *src = &s->source;
  stream st = {.last_arrival_ns = INT64_MIN};
  sv_frame f;
  int n_loan = 0;
  sv_ns wait_ns = s->wait_ns ? s->wait_ns : 10 * SV_NS_PER_S;
  SAME(src->start(src->self), SV_OK, "start");
  for (int i = 0; i < n; i++) {
    // No buffer may be free: then nothing can come, and there is no need to wait long for it.
    sv_ns w = !is_balanced && i > 8 && wait_ns > SV_NS_PER_S ? SV_NS_PER_S : wait_ns;
    sv_status r = src->dequeue(src->self, &f, s->clock.now_ns(s->clock.self) + w);
    if (s->n_frames && i >= s->n_frames) {
      SAME(r, SV_END, "dequeue at the end");
      continue;
    }
    if (!is_balanced && (r == SV_AGAIN || r == SV_END)) break;
    SAME(r, SV_OK, "dequeue");
    if (s->may_lose) note_restarts(s, &st);
    if (!check_frame(s, &st, &f)) return false;
    if (!is_balanced) {
      CHECK(n_loan < CAP_LOAN, "the source has a bounded number of buffers");
      on_loan[n_loan++] = f;
      continue;
    }
    SAME(src->requeue(src->self, &f), SV_OK, "requeue");
    CHECK(src->requeue(src->self, &f) < 0, "a second requeue is refused");
  }
  for (int i = 0; i < n_loan; i++) // what is on loan keeps its pictures until the stop
    for (int k = 0; k < i; k++)
      CHECK(on_loan[i].data != on_loan[k].data || on_loan[i].coded_x0_px != on_loan[k].coded_x0_px ||
                on_loan[i].coded_y0_px != on_loan[k].coded_y0_px,
            "frames on loan have buffers of their own");
  SAME(src->stop(src->self), SV_OK, "stop");
  SAME(src->dequeue(src->self, &f, INT64_MAX / 2), SV_END, "dequeue after stop");
  return true;
}

bool source_suite_capture(source_suite *s, int n) { return capture(s, n, true); }

bool source_suite_start_stop(source_suite *s, int n) {
  for (int k = 0; k < 3; k++)
    if (!capture(s, n, true)) return false;
  return true;
}

bool source_suite_unbalanced(source_suite *s, int n) {
  SAME(s->source.stop(s->source.self), SV_OK, "stop before any start");
  if (!capture(s, n, false)) return false;
  SAME(s->source.stop(s->source.self), SV_OK, "a second stop");
  return capture(s, n, true); // the buffers are all there again
}

bool source_suite_bad_calls(source_suite *s) {
  sv_source *src = &s->source;
  sv_camera_caps caps;
  sv_camera_event e;
  sv_frame f = {.i_camera = 0, .i_buffer = 0};
  CHECK(src->caps(src->self, -1, &caps) < 0, "caps of camera -1 are refused");
  CHECK(src->caps(src->self, src->n_cameras, &caps) < 0, "caps of a camera too many are refused");
  SAME(src->start(src->self), SV_OK, "start");
  CHECK(src->requeue(src->self, &f) < 0, "a frame that is not on loan is refused");
  f.i_camera = 99;
  CHECK(src->requeue(src->self, &f) < 0, "a frame of no camera is refused");
  f.i_camera = 0;
  f.i_buffer = 1000;
  CHECK(src->requeue(src->self, &f) < 0, "a frame of no buffer is refused");
  f.i_buffer = -1;
  CHECK(src->requeue(src->self, &f) < 0, "buffer -1 is refused");
  sv_status r = src->dequeue(src->self, &f, s->clock.now_ns(s->clock.self) - 1);
  CHECK(r == SV_OK || r == SV_AGAIN || r == SV_END, "a deadline that has passed is no failure");
  if (src->set_control)
    CHECK(src->set_control(src->self, -1, SV_CONTROL_EXPOSURE_NS, 1000000, NULL) < 0,
          "a control of camera -1 is refused");
  SAME(src->stop(src->self), SV_OK, "stop");
  for (int i = 0; src->event && i < 1000; i++) {
    if (src->event(src->self, &e) == SV_AGAIN) break;
    CHECK(i < 999, "events come to an end");
  }
  return true;
}
