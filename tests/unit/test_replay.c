// SPDX-License-Identifier: Apache-2.0
// Captures: written, killed, recovered, played back; pictures that are damaged (wrong JSON:
// test_capture_json.c). Run from the repository's root (the committed capture is
// tests/data/capture_tiny).
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "platform/replay/capture_writer.h"
#include "platform/replay/replay.h"
#include "src/base/str.h"
#include "tests/common/test.h"
#include "tests/fault/heap_count.h"

#define TINY "tests/data/capture_tiny"
static _Alignas(64) uint8_t g_block[16 << 20], g_block2[8 << 20];
static char g_dir[64];
static sv_replay g_replay;
static sv_capture_writer g_writer;

// --- replaced system calls -----------------------------------------------------------------------
static int g_die_at_unlink, g_n_syncs, g_sync_errno, g_close_errno;

int unlinkat(int dir_fd, const char *name, int flags) {
  if (g_die_at_unlink && --g_die_at_unlink == 0) raise(SIGKILL);
  return (int)syscall(SYS_unlinkat, dir_fd, name, flags);
}

int syncfs(int fd) {
  g_n_syncs++;
  errno = g_sync_errno;
  return g_sync_errno ? -1 : (int)syscall(SYS_syncfs, fd);
}

int close(int fd) {
  int r = (int)syscall(SYS_close, fd);
  if (!g_close_errno) return r;
  errno = g_close_errno;
  return -1;
}

FIXTURE(setup) {
  strcpy(g_dir, "/tmp/sv_test_replay_XXXXXX");
  return mkdtemp(g_dir) ? 0 : -1;
}

static int shell(const char *fmt, const char *arg) {
  char cmd[512];
  snprintf(cmd, sizeof cmd, fmt, arg);
  return system(cmd);
}

FIXTURE(teardown) { return shell("rm -rf '%s'", g_dir); }

static sv_status open_replay(const char *spec, sv_err *err) {
  sv_replay_cfg cfg;
  sv_status s = sv_replay_parse(spec, &cfg, err);
  if (s < 0) return s;
  sv_arena a = sv_arena_make(g_block, sizeof g_block);
  return sv_replay_init(&g_replay, &cfg, &a, err);
}

TEST(options_are_read) {
  sv_replay_cfg c;
  sv_err err;
  assert_int_equal(sv_replay_parse("a/b,speed=max,from=3,count=7", &c, &err), SV_OK);
  assert_true(c.speed == 0 && c.from == 3 && c.count == 7 && !strcmp(c.dir, "a/b"));
  assert_int_equal(sv_replay_parse("x,speed=2.5", &c, &err), SV_OK);
  assert_true(c.speed == 2.5);
  assert_int_equal(sv_replay_parse("x", &c, &err), SV_OK);
  assert_true(c.speed == 0);
  static const char *const bad[] = {
      "",         ",speed=max", "x,",        "x,speed",    "x,speed=", "x,speed=-1", "x,speed=nan",
      "x,poses=", "x,from=-1",  "x,count=0", "x,count=1x", "x,what=1", "x,speed=0",  "x,,"};
  for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
    assert_int_equal(sv_replay_parse(bad[i], &c, &err), SV_E_ARG);
}

TEST(tiny_plays_in_order) {
  sv_err err = {.text = ""};
  assert_int_equal(open_replay(TINY ",speed=max", &err), SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  sv_clock c = sv_replay_clock(&g_replay);
  sv_camera_caps caps;
  assert_int_equal(s.n_cameras, 2);
  assert_int_equal(s.caps(s.self, 1, &caps), SV_OK);
  assert_true(caps.width_px == 64 && caps.height_px == 48 && caps.format == SV_PIX_RGB8 &&
              !strcmp(caps.name, "cam1"));
  assert_int_equal(s.caps(s.self, 2, &caps), SV_E_ARG);
  sv_frame f;
  assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_END); // not started
  for (int run = 0; run < 2; run++) {
    assert_int_equal(s.start(s.self), SV_OK);
    for (int i = 0; i < 8; i++) {
      assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_OK);
      assert_int_equal(f.i_camera, i % 2);
      assert_int_equal(f.sequence, (uint32_t)(i / 2));
      assert_int_equal(f.arrival_ns, 1000000000 + i / 2 * 100000000 + (5 + i % 2) * 1000000);
      assert_int_equal(c.now_ns(c.self), f.arrival_ns); // the virtual clock stands at the frame
      assert_false(f.is_error);
      assert_int_equal(f.data_bytes, 64 * 48 * 3);
      assert_true(f.data[0] + f.data[1] + f.data[2] > 100); // the wall is bright
      assert_int_equal(s.requeue(s.self, &f), SV_OK);
      assert_int_equal(s.requeue(s.self, &f), SV_E_ARG);
    }
    assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_END);
  }
  assert_int_equal(s.start(s.self), SV_OK);
  assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_OK);
  assert_int_equal(s.dequeue(s.self, &f, 1005500000),
                   SV_AGAIN); // the second camera is half a millisecond later
  assert_int_equal(c.now_ns(c.self), 1005500000);
  assert_int_equal(s.requeue(s.self, &f), SV_OK);
  sv_pose p;
  assert_int_equal(s.rig_pose(s.self, 1100000000, &p), SV_OK);
  assert_true(fabs(p.t[1] - 0.05) < 1e-9 && sv_rotation_error(p.r) < 1e-12);
  // between two poses, turned by nothing
  assert_int_equal(s.rig_pose(s.self, 1150000000, &p), SV_OK);
  assert_true(fabs(p.r[0] - 1) < 1e-12 && fabs(p.t[0]) < 1e-12 && fabs(p.t[1] - 0.075) < 1e-12);
  assert_int_equal(s.rig_pose(s.self, 0, &p), SV_OK);
  assert_int_equal(s.rig_pose(s.self, INT64_MAX, &p), SV_OK);
  assert_true(fabs(p.t[1] - 0.15) < 1e-9);
  assert_string_equal(g_replay.capture.rig, "rig");
  assert_true(g_replay.capture.has_scene);
  sv_replay_close(&g_replay);
}

static sv_status open_with_poses(const char *text, sv_err *err) {
  char path[128], spec[256];
  snprintf(path, sizeof path, "%s/poses.json", g_dir);
  FILE *f = fopen(path, "w");
  assert_non_null(f);
  fputs(text, f);
  fclose(f);
  snprintf(spec, sizeof spec, TINY ",speed=max,poses=%s", path);
  return open_replay(spec, err);
}

TEST(poses_from_a_file) {
  sv_err err = {.text = ""};
  sv_pose p;
  assert_int_equal(
      open_with_poses("{\"version\": 1, \"scale_sigma\": 0.0007, \"poses\": [\n {\"time_ns\": 1000000000, "
                      "\"rig_from_world\": [1, 0, 0, 0, 4, 5, 6]},\n {\"time_ns\": 1200000000, "
                      "\"rig_from_world\": [1, 0, 0, 0, 6, 5, 6]}\n]}\n",
                      &err),
      SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  assert_int_equal(s.rig_pose(s.self, 1100000000, &p), SV_OK);
  assert_true(g_replay.capture.scale_sigma == 0.0007);
  assert_true(fabs(p.t[0] - 5) < 1e-9 && p.t[1] == 5 && p.t[2] == 6); // not the capture's own
  sv_replay_close(&g_replay);
  static const struct {
    const char *text, *word;
  } bad[] = {
      {"", "JSON object"},
      {"[]", "JSON object"},
      {"{\"version\": 2, \"poses\": []}", "version"},
      {"{\"version\": 1}", "poses"},
      {"{\"version\": 1, \"poses\": []}", "at least one"},
      {"{\"version\": 1, \"poses\": [7]}", "poses"},
      {"{\"version\": 1, \"scale_sigma\": -1, \"poses\": [{\"time_ns\": 1, \"rig_from_world\": "
       "[1,0,0,0,0,0,0]}]}",
       "scale_sigma"},
      {"{\"version\": 1, \"poses\": [{\"time_ns\": 1, \"rig_from_world\": [2,0,0,0,0,0,0]}]}", "quaternion"},
      {"{\"version\": 1, \"poses\": [{\"time_ns\": 1, \"rig_from_world\": [1,0,0,0,0,0,0]}, "
       "{\"time_ns\": 1, \"rig_from_world\": [1,0,0,0,0,0,0]}]}",
       "order of time"}};
  for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
    if (open_with_poses(bad[i].text, &err) != SV_E_FORMAT || !strstr(err.text, bad[i].word) ||
        !strstr(err.text, "poses.json"))
      fail_msg("case %zu: %s", i, err.text);
    sv_replay_close(&g_replay);
  }
  assert_int_equal(open_replay(TINY ",poses=/nowhere/poses.json", &err), SV_E_NOT_FOUND);
  sv_replay_close(&g_replay);
  assert_int_equal(open_replay("/nonexistent,speed=max", &err), SV_E_NOT_FOUND);
}

TEST(ranges_and_starving) {
  sv_err err;
  sv_frame f;
  assert_int_equal(open_replay(TINY ",speed=max,from=1,count=2", &err), SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  assert_int_equal(s.start(s.self), SV_OK);
  for (int i = 0; i < 4; i++) {
    assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_OK);
    assert_int_equal(f.sequence, (uint32_t)(1 + i / 2));
  }
  assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_END);
  sv_replay_close(&g_replay);
  assert_int_equal(open_replay(TINY ",speed=max,from=100", &err), SV_OK);
  s = sv_replay_source(&g_replay);
  assert_int_equal(s.start(s.self), SV_OK);
  assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_END);
  sv_replay_close(&g_replay);
  sv_replay_cfg cfg = {.dir = TINY, .n_buffers = 2};
  sv_arena a = sv_arena_make(g_block, sizeof g_block);
  assert_int_equal(sv_replay_init(&g_replay, &cfg, &a, &err), SV_OK);
  s = sv_replay_source(&g_replay);
  assert_int_equal(s.start(s.self), SV_OK);
  for (int i = 0; i < 4; i++) assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_OK);
  assert_int_equal(s.dequeue(s.self, &f, INT64_MAX),
                   SV_END); // none given back: the rest is lost, and counted
  assert_int_equal(g_replay.cameras[0].stats.n_starved + g_replay.cameras[1].stats.n_starved, 4);
  sv_replay_close(&g_replay);
  a = sv_arena_make(g_block, 20000);
  assert_int_equal(sv_replay_init(&g_replay, &cfg, &a, &err), SV_E_NOMEM);
}

TEST(realtime_keeps_the_time) {
  sv_err err;
  sv_frame f;
  assert_int_equal(open_replay(TINY ",speed=4", &err), SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  sv_clock m = sv_linux_clock(), c = sv_replay_clock(&g_replay);
  assert_int_equal(s.start(s.self), SV_OK);
  sv_ns t0 = m.now_ns(m.self);
  int n = 0;
  for (sv_status st = SV_OK; st != SV_END;) {
    st = s.dequeue(s.self, &f, c.now_ns(c.self) + 20000000);
    if (st != SV_OK) continue;
    assert_true(c.now_ns(c.self) >= f.arrival_ns);
    assert_int_equal(s.requeue(s.self, &f), SV_OK);
    n++;
  }
  sv_ns dt = m.now_ns(m.self) - t0;
  assert_int_equal(n, 8);
  assert_true(dt >= 75000000 && dt < 2000000000); // 301 ms four times as fast
  sv_replay_close(&g_replay);
}

TEST(no_heap_call_a_frame) {
  sv_err err;
  sv_frame f;
  assert_int_equal(open_replay(TINY ",speed=max", &err), SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  sv_heap_arm();
  for (int run = 0; run < 50; run++) {
    assert_int_equal(s.start(s.self), SV_OK);
    while (s.dequeue(s.self, &f, INT64_MAX) == SV_OK) assert_int_equal(s.requeue(s.self, &f), SV_OK);
  }
  sv_heap_disarm();
  sv_heap_report();
  assert_int_equal(sv_heap_count(), 0);
  sv_replay_close(&g_replay);
}

// --- the writer ----------------------------------------------------------------------------------
static uint8_t g_rgb[2][40 * 30 * 3];

static sv_status open_named(sv_capture_writer *w, const char *dir, const char *name0, const char *name1) {
  sv_camera_caps caps[2] = {{.width_px = 40,
                             .height_px = 30,
                             .fps = 25,
                             .clock = SV_CLOCK_CAMERA,
                             .stamp = SV_STAMP_END,
                             .is_light_locked = true,
                             .is_light_shared = true,
                             .is_exposure_told = true,
                             .area = {100, 80, 10, 10, 80, 60.5}},
                            {.width_px = 40,
                             .height_px = 30,
                             .fps = 25,
                             .clock = SV_CLOCK_BOOTTIME,
                             .is_exposure_told = true,
                             .is_light_shared = true,
                             .n_brackets = 3}};
  sv_capture_writer_cfg cfg = {.dir = dir, .name = "t", .n_cameras = 2, .caps = caps, .save_period = 7};
  sv_copy(caps[0].name, sizeof caps[0].name, name0);
  sv_copy(caps[1].name, sizeof caps[1].name, name1);
  size_t need = sv_capture_writer_bytes(&cfg);
  sv_arena a = sv_arena_make(w == &g_writer ? g_block2 : g_block, need);
  sv_err err = {.text = ""};
  sv_status s = sv_capture_writer_open(w, &cfg, &a, &err);
  if (s < 0) print_message("%s\n", err.text);
  assert_true(s < 0 || a.used_bytes == need);
  return s;
}

static sv_status open_writer(const char *dir) { return open_named(&g_writer, dir, "left cam", "left cam"); }

static sv_frame make_frame(int k, int c) {
  for (int i = 0; i < 40 * 30 * 3; i++) g_rgb[c][i] = (uint8_t)(60 + k * 10 + c * 50);
  return (sv_frame){.i_camera = c,
                    .sequence = (uint32_t)(k * 2),
                    .camera_ns = -5000 + k * 40000000LL,
                    .arrival_ns = k * 40000000LL + c,
                    .exposure_ns = 1000,
                    .width_px = 40,
                    .height_px = 30,
                    .stride_bytes = 120,
                    .format = SV_PIX_RGB8,
                    .data = g_rgb[c],
                    .data_bytes = 3600};
}

static void write_frames(int n) {
  sv_err err = {.text = ""};
  for (int k = 0; k < n; k++) {
    for (int c = 0; c < 2; c++) {
      sv_frame f = make_frame(k, c);
      assert_int_equal(sv_capture_writer_add(&g_writer, &f, &err), SV_OK);
    }
    sv_pose p = sv_pose_identity();
    p.t[0] = k * 0.1;
    assert_int_equal(sv_capture_writer_add_pose(&g_writer, k * 40000000LL, &p, &err), SV_OK);
  }
}

static void expect_frames(const char *dir, int n) {
  sv_err err = {.text = ""};
  char spec[200];
  sv_fmt(spec, sizeof spec, "%s,speed=max", dir);
  sv_status st = open_replay(spec, &err);
  if (st < 0) print_message("%s\n", err.text);
  assert_int_equal(st, SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  assert_int_equal(s.start(s.self), SV_OK);
  sv_frame f;
  for (int k = 0; k < n; k++)
    for (int c = 0; c < 2; c++) {
      assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_OK);
      sv_frame want = make_frame(k, c);
      assert_false(f.is_error);
      assert_true(f.i_camera == c && f.sequence == want.sequence && f.camera_ns == want.camera_ns);
      assert_true(f.arrival_ns == want.arrival_ns && f.exposure_ns == 1000);
      assert_true(abs((int)f.data[1000] - (int)want.data[1000]) <= 1);
      assert_int_equal(s.requeue(s.self, &f), SV_OK);
    }
  assert_int_equal(s.dequeue(s.self, &f, INT64_MAX), SV_END);
  assert_int_equal(g_replay.capture.n_poses, n);
  assert_true(g_replay.capture.cameras[0].caps.clock == SV_CLOCK_CAMERA);
  assert_true(g_replay.capture.cameras[0].caps.stamp == SV_STAMP_END);
  const sv_camera_caps *light[2] = {&g_replay.capture.cameras[0].caps, &g_replay.capture.cameras[1].caps};
  assert_true(light[0]->is_light_locked && light[0]->is_light_shared && light[0]->is_exposure_told);
  assert_true(!light[1]->is_light_locked && light[1]->is_light_shared && light[1]->is_exposure_told);
  assert_true(light[0]->n_brackets == 0 && light[1]->n_brackets == 3);
  const sv_sensor_area *a = &g_replay.capture.cameras[0].caps.area;
  assert_true(a->sensor_width_px == 100 && a->sensor_height_px == 80 && a->x0_px == 10 &&
              a->height_px == 60.5);
  assert_int_equal(g_replay.capture.cameras[1].caps.area.sensor_width_px, 0);
  assert_string_not_equal(g_replay.capture.cameras[0].folder, g_replay.capture.cameras[1].folder);
  sv_replay_close(&g_replay);
}

TEST(writer_round_trip) {
  char dir[100], cmd[200];
  sv_err err;
  sv_fmt(dir, sizeof dir, "%s/w", g_dir);
  assert_int_equal(open_writer(dir), SV_OK);
  sv_heap_arm();
  write_frames(10);
  sv_heap_disarm();
  sv_heap_report();
  assert_int_equal(sv_heap_count(), 0);
  sv_frame f = make_frame(10, 0);
  f.is_error = true;
  assert_int_equal(sv_capture_writer_add(&g_writer, &f, &err), SV_DROPPED);
  f.is_error = false;
  f.width_px = 41;
  assert_int_equal(sv_capture_writer_add(&g_writer, &f, &err), SV_E_ARG);
  f.i_camera = 2;
  assert_int_equal(sv_capture_writer_add(&g_writer, &f, &err), SV_E_ARG);
  assert_int_equal(sv_capture_writer_close(&g_writer, &err), SV_OK);
  assert_int_equal(sv_capture_writer_close(&g_writer, &err), SV_OK);
  expect_frames(dir, 10);
  sv_fmt(cmd, sizeof cmd, "ls %s/*.part %s/*.tmp >/dev/null 2>&1", dir, dir);
  assert_int_not_equal(system(cmd), 0); // nothing is left over
}

TEST(no_two_cameras_share_a_folder) {
  static const char *const names[][2] = {
      {"camera.1", "camera.1"},   {"rig", "RIG"},   {"frames.0.part", "camera.0"},
      {"camera.0", "poses.part"}, {"Left", "left"}, {"capture.json", "x.tmp"}};
  char dir[100];
  sv_err err;
  sv_fmt(dir, sizeof dir, "%s/names", g_dir);
  for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
    assert_int_equal(open_named(&g_writer, dir, names[i][0], names[i][1]), SV_OK);
    assert_true(strcasecmp(g_writer.cameras[0].folder, g_writer.cameras[1].folder));
    for (int c = 0; c < 2; c++) assert_true(strcasecmp(g_writer.cameras[c].folder, "rig"));
    write_frames(2);
    assert_int_equal(sv_capture_writer_close(&g_writer, &err), SV_OK);
    expect_frames(dir, 2);
  }
}

TEST(pictures_are_synced_at_close) {
  char dir[100];
  sv_err err;
  sv_fmt(dir, sizeof dir, "%s/s", g_dir);
  g_n_syncs = 0;
  assert_int_equal(open_writer(dir), SV_OK);
  write_frames(10);
  assert_int_equal(g_n_syncs, 0); // frames come, and are not held up
  sv_frame f = make_frame(10, 0);
  g_close_errno = EDQUOT;
  sv_status s = sv_capture_writer_add(&g_writer, &f, &err);
  g_close_errno = 0;
  assert_int_equal(s, SV_E_IO); // and the picture is not listed
  assert_contains(err.text, "quota");
  g_sync_errno = EIO;
  assert_int_equal(sv_capture_writer_close(&g_writer, &err), SV_E_IO);
  assert_true(g_n_syncs == 1 && strstr(err.text, "I/O error"));
  g_sync_errno = 0;
  expect_frames(dir, 10); // from the sidecars
  assert_int_equal(g_n_syncs, 2);
}

// A process of its own writes n frames and is killed: at the unlink_no-th file that it removes at
// close, or (0) before.
static void write_and_die(const char *dir, int n, int unlink_no) {
  int status;
  sv_err err;
  pid_t pid = fork();
  assert_true(pid >= 0);
  if (pid == 0) {
    if (open_writer(dir) < 0) _exit(1);
    write_frames(n);
    g_die_at_unlink = unlink_no;
    if (unlink_no && sv_capture_writer_close(&g_writer, &err) < 0) _exit(1);
    raise(SIGKILL);
  }
  waitpid(pid, &status, 0);
  assert_true(WIFSIGNALED(status));
}

TEST(a_killed_writer_loses_nothing) {
  char dir[100];
  sv_fmt(dir, sizeof dir, "%s/k", g_dir);
  for (int n = 0; n < 12; n++) {
    write_and_die(dir, n, 0);
    if (n % 2) // a power cut may also cut a line
      assert_int_equal(shell("printf ',{\"file\":\"0000' >> '%s/frames.1.part'", dir), 0);
    expect_frames(dir, n);
    assert_int_not_equal(shell("ls '%s'/*.part > /dev/null 2>&1", dir),
                         0); // later edits are nobody's to undo
    expect_frames(dir, n);   // recovering twice changes nothing
  }
  for (int i = 1; i <= 4; i++) {
    write_and_die(dir, 3, i);
    assert_int_equal(shell("test -e '%s/frames.0.part'", dir) == 0, i == 1); // the sign goes first
    expect_frames(dir, 3);
  }
  write_and_die(dir, 3, 1); // capture.json is whole; what only it lists stays
  assert_int_equal(shell("cd '%s' && rm poses.part && : > frames.1.part", dir), 0);
  expect_frames(dir, 3);
}

static int count_frames(const char *dir) {
  sv_capture c;
  sv_err err = {.text = ""};
  sv_arena a = sv_arena_make(g_block, sizeof g_block);
  sv_status s = sv_capture_load(&c, dir, &a, &err);
  if (s < 0) print_message("%s\n", err.text);
  return s < 0 ? s : c.n_frames;
}

TEST(a_living_writer_is_left_alone) {
  static sv_capture_writer other;
  char dir[100];
  sv_err err;
  sv_fmt(dir, sizeof dir, "%s/l", g_dir);
  assert_int_equal(open_writer(dir), SV_OK);
  write_frames(4);
  assert_int_equal(open_named(&other, dir, "a", "b"), SV_E_IO);
  assert_int_equal(count_frames(dir), 7); // the last save
  assert_int_equal(sv_capture_writer_close(&g_writer, &err), SV_OK);
  expect_frames(dir, 4);
}

TEST(what_cannot_be_written_is_read) {
  char dir[100];
  int status;
  sv_fmt(dir, sizeof dir, "%s/r", g_dir);
  write_and_die(dir, 4, 0);
  assert_int_equal(shell("chmod -R a+rX '%s'", g_dir) | shell("chmod a-w '%s'", dir), 0);
  pid_t pid = fork();
  // root may write anywhere
  if (pid == 0) _exit(getuid() == 0 && setuid(65534) < 0 ? 99 : count_frames(dir));
  waitpid(pid, &status, 0);
  assert_int_equal(shell("chmod u+w '%s'", dir), 0);
  if (WEXITSTATUS(status) == 99) skip();
  assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 7); // the last save
  expect_frames(dir, 4);
}

// --- wrong files ---------------------------------------------------------------------------------
TEST(damaged_pictures_are_delivered_as_errors) {
  char dir[100], cmd[400];
  sv_err err;
  sv_fmt(dir, sizeof dir, "%s/d", g_dir);
  assert_int_equal(open_writer(dir), SV_OK);
  write_frames(6);
  assert_int_equal(sv_capture_writer_close(&g_writer, &err), SV_OK);
  const char *f0 = g_writer.cameras[0].folder;
  sv_fmt(cmd, sizeof cmd,
         "cd '%s/%s' && rm 000000.jpg && truncate -s 300 000001.jpg && : > 000002.jpg && echo hello > "
         "000003.jpg",
         dir, f0);
  assert_int_equal(system(cmd), 0);
  // 64x48, not 40x30
  sv_fmt(cmd, sizeof cmd, "cp " TINY "/cam0/000000.jpg '%s/%s/000004.jpg'", dir, f0);
  assert_int_equal(system(cmd), 0);
  sv_fmt(cmd, sizeof cmd, "%s,speed=max", dir);
  assert_int_equal(open_replay(cmd, &err), SV_OK);
  sv_source s = sv_replay_source(&g_replay);
  assert_int_equal(s.start(s.self), SV_OK);
  sv_frame f;
  int n = 0;
  while (s.dequeue(s.self, &f, INT64_MAX) == SV_OK) {
    assert_int_equal(f.is_error, f.i_camera == 0 && n / 2 < 5);
    assert_int_equal(s.requeue(s.self, &f), SV_OK);
    n++;
  }
  assert_int_equal(n, 12);
  assert_int_equal(g_replay.cameras[0].stats.n_errors, 5);
  assert_int_equal(g_replay.cameras[1].stats.n_errors, 0);
  assert_contains(g_replay.last_err.text, "64x48"); // said what, where and what was expected
  assert_contains(g_replay.last_err.text, "000004.jpg");
  sv_camera_event e; // the first one, once
  assert_int_equal(s.event(s.self, &e), SV_OK);
  assert_true(e.kind == SV_CAMERA_FILE && e.i_camera == 0);
  assert_contains(e.text, "000000.jpg: cannot be read");
  assert_int_equal(s.event(s.self, &e), SV_AGAIN);
  sv_replay_close(&g_replay);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(options_are_read),
      cmocka_unit_test(tiny_plays_in_order),
      cmocka_unit_test(poses_from_a_file),
      cmocka_unit_test(ranges_and_starving),
      cmocka_unit_test(realtime_keeps_the_time),
      cmocka_unit_test(no_heap_call_a_frame),
      cmocka_unit_test(writer_round_trip),
      cmocka_unit_test(no_two_cameras_share_a_folder),
      cmocka_unit_test(pictures_are_synced_at_close),
      cmocka_unit_test(a_killed_writer_loses_nothing),
      cmocka_unit_test(a_living_writer_is_left_alone),
      cmocka_unit_test(what_cannot_be_written_is_read),
      cmocka_unit_test(damaged_pictures_are_delivered_as_errors),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
