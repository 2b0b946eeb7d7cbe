// SPDX-License-Identifier: Apache-2.0
// A recording of ROS 2 (.mcap, .db3) of a simulated stereo rig: JPEG on one topic, raw pixels on
// the other, a depth topic and a repeated one beside them. It becomes the capture that it was made
// of.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/mcap_write.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"
#include "tools/import/mcap.h"

#if defined(__has_include) && __has_include(<sqlite3.h>)
#include <sqlite3.h>
#define HAS_SQLITE 1
#else
#define HAS_SQLITE 0
#endif

#define N_FRAMES  8
#define PERIOD_NS 50000000
#define START_NS  1700000000000000000
enum { LEFT, RIGHT, RIGHT_JPEG, DEPTH, N_TOPICS };
static const char *const topics[N_TOPICS] = {"/left/image_raw/compressed", "/right/image_raw",
                                             "/right/image_raw/compressed", "/depth/image_rect_raw"};
static const bool is_compressed[N_TOPICS] = {true, false, true, false};

static lab_shell shell = {.cwd = ""};
static sv_err err;

static void read_frame(const char *camera, int i, void **data, size_t *bytes) {
  char path[400];
  snprintf(path, sizeof path, "%s/cap/%s/%06d.jpg", shell.root, camera, i);
  assert_ok(sv_file_read(path, data, bytes, &err), &err);
}

static void save(const char *name, const void *data, size_t bytes) {
  char path[400];
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_ok(sv_file_write(path, data, bytes, &err), &err);
}

typedef void put_fn(void *to, int channel, const mcap_picture *p);
static void put_mcap(void *to, int channel, const mcap_picture *p) { mcap_put(to, channel, p); }

// The right camera's picture comes 2 ms later, by BGR with rows that are 12 bytes longer. The left
// one stops once for a frame.
static void put_exposure(void *to, int i, put_fn *put) {
  static uint8_t rows[120 * (480 + 12)];
  void *data;
  size_t bytes;
  sv_bitmap b;
  const int64_t stamp = START_NS + (int64_t)i * PERIOD_NS;
  read_frame("left", i, &data, &bytes);
  if (i != 5) put(to, LEFT, &(mcap_picture){stamp, "", 0, 0, 0, data, bytes});
  free(data);
  read_frame("right", i, &data, &bytes);
  assert_ok(sv_bitmap_decode("right", data, bytes, &b, &err), &err);
  for (int y = 0; y < 120; y++)
    for (int x = 0; x < 480; x++) rows[y * 492 + x] = b.u8[y * 480 + x / 3 * 3 + 2 - x % 3];
  const mcap_picture raw = {stamp + 2000000, "bgr8", 160, 120, 492, rows, sizeof rows};
  put(to, RIGHT, &raw);
  put(to, RIGHT, &raw); // a message that comes twice counts once
  put(to, RIGHT_JPEG, &(mcap_picture){stamp + 2000000, "", 0, 0, 0, data, bytes});
  put(to, DEPTH, &(mcap_picture){stamp, "16UC1", 160, 120, 320, rows, 38400});
  sv_bitmap_free(&b);
  free(data);
}

static void make(const char *name, bool is_packed) {
  mcap_file m = {.is_packed = is_packed};
  mcap_begin(&m);
  for (int k = 0; k < N_TOPICS; k++) mcap_topic(&m, k, topics[k], is_compressed[k]);
  for (int i = 0; i < N_FRAMES; i++) {
    put_exposure(&m, i, put_mcap);
    if (i % 3 == 2) mcap_chunk(&m);
  }
  mcap_chunk(&m);
  mcap_end(&m);
  save(name, m.file.data, m.file.bytes);
  mcap_free(&m);
}

#if HAS_SQLITE
static void put_row(void *to, int channel, const mcap_picture *p) {
  sqlite3_stmt *q;
  mcap_bytes b = {0};
  mcap_message(&b, p);
  assert_int_equal(sqlite3_prepare_v2(to, "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
                                      -1, &q, NULL),
                   SQLITE_OK);
  sqlite3_bind_int(q, 1, channel + 1);
  sqlite3_bind_int64(q, 2, p->stamp_ns + 5000000);
  sqlite3_bind_blob(q, 3, b.data, (int)b.bytes, SQLITE_TRANSIENT);
  assert_int_equal(sqlite3_step(q), SQLITE_DONE);
  sqlite3_finalize(q);
  free(b.data);
}

// As rosbag2 lays it out.
static void make_db3(const char *name) {
  char path[400], line[300];
  sqlite3 *db;
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
  assert_int_equal(
      sqlite3_exec(db,
                   "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
                   "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
                   "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp "
                   "INTEGER NOT NULL, data BLOB NOT NULL);",
                   NULL, NULL, NULL),
      SQLITE_OK);
  for (int k = 0; k < N_TOPICS; k++) {
    snprintf(line, sizeof line, "INSERT INTO topics VALUES (%d, '%s', 'sensor_msgs/msg/%s', 'cdr', '')",
             k + 1, topics[k], is_compressed[k] ? "CompressedImage" : "Image");
    assert_int_equal(sqlite3_exec(db, line, NULL, NULL, NULL), SQLITE_OK);
  }
  for (int i = 0; i < N_FRAMES; i++) put_exposure(db, i, put_row);
  assert_int_equal(sqlite3_close(db), SQLITE_OK);
}
#else
static void make_db3(const char *name) { (void)name; }
#endif

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "rosbag");
  if (r != 0) return r < 0 ? r : 0;
  lab_shell_run_well(&shell,
                     "$(dirname @)/subview capture --source sim:textured,rig=stereo,size=160x120,fps=20 "
                     "--exposures 8 --quiet --out cap");
  make("bag.mcap", false);
  shell.is_ready = true;
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

// Exposure i of folder `out` is frame `frame` of the recording: files as they were, pixels exactly.
static void check_exposure(const char *out, int i, int frame) {
  char path[400];
  void *want, *got;
  size_t n_want, n_got;
  sv_bitmap a, b;
  read_frame("left", frame, &want, &n_want);
  snprintf(path, sizeof path, "%s/%s/left/%06d.jpg", shell.root, out, i);
  assert_ok(sv_file_read(path, &got, &n_got, &err), &err);
  assert_int_equal(n_got, n_want);
  assert_memory_equal(got, want, n_want);
  free(want);
  free(got);
  read_frame("right", frame, &want, &n_want);
  assert_ok(sv_bitmap_decode("right", want, n_want, &a, &err), &err);
  snprintf(path, sizeof path, "%s/%s/right/%06d.png", shell.root, out, i);
  assert_ok(sv_bitmap_read(path, &b, &err), &err);
  assert_true(b.width_px == 160 && b.height_px == 120 && b.n_channels == 3);
  assert_memory_equal(a.u8, b.u8, 160 * 120 * 3);
  sv_bitmap_free(&a);
  sv_bitmap_free(&b);
  free(want);
}

static void expect(int code, const char *part, const char *line) {
  assert_int_equal(lab_shell_run(&shell, line), code);
  assert_contains(shell.said, part);
}

TEST(test_recording) {
  lab_shell_need(&shell);
  expect(0, "7 exposures of 2 cameras; pictures of one exposure are up to 2.0 ms apart",
         "@ import --from rosbag bag.mcap --rig cap/rig --out a");
  assert_contains(shell.said, "/depth/image_rect_raw: left out");
  for (int i = 0; i < 7; i++) check_exposure("a", i, i < 5 ? i : i + 1);
  lab_shell_run_well(&shell,
                     "$(dirname @)/subview run --source replay:a --exposures 7 --steps 20 --gaussians 300 "
                     "--out run");
  expect(0, "4 exposures",
         "mkdir one && cp bag.mcap one/bag_0.mcap && @ import --from rosbag one --every 0.1 --out b");
  check_exposure("b", 1, 2);
  expect(0, "", "ls b/rig || true");
  assert_contains(shell.said, "No such file");
}

TEST(test_packed) {
  lab_shell_need(&shell);
  if (!mcap_can_pack()) skip();
  make("packed.mcap", true);
  expect(0, "7 exposures of 2 cameras", "@ import --from rosbag packed.mcap --out c");
  for (int i = 0; i < 7; i++) check_exposure("c", i, i < 5 ? i : i + 1);
}

TEST(test_sqlite) {
  lab_shell_need(&shell);
  if (!lab_has_db3()) skip();
  make_db3("bag.db3");
  expect(0, "7 exposures of 2 cameras", "@ import --from rosbag bag.db3 --out e");
  for (int i = 0; i < 7; i++) check_exposure("e", i, i < 5 ? i : i + 1);
  expect(1, "cannot be read as a recording",
         "head -c 50000 bag.db3 >cut.db3; @ import --from rosbag cut.db3 --out f");
  expect(1, "cannot be read as a recording",
         "cp cap/left/000000.jpg odd.db3; @ import --from rosbag odd.db3 --out f");
  expect(1, "cannot be read as a recording", "@ import --from rosbag absent.db3 --out f");
}

TEST(test_hostile) {
  lab_shell_need(&shell);
  expect(1, "cannot be read", "@ import --from rosbag absent.mcap --out d");
  expect(1, "is not an MCAP file", "@ import --from rosbag cap/left/000000.jpg --out d");
  expect(1, "is not an MCAP file", "true >empty.mcap; @ import --from rosbag empty.mcap --out d");
  expect(1, "ends within a record",
         "head -c 200000 bag.mcap >cut.mcap; @ import --from rosbag cut.mcap --out d");
  if (mcap_can_pack()) {
    make("packed.mcap", true);
    expect(1, "compressed by lz4",
           "sed 's/\\x04\\x00\\x00\\x00zstd/\\x04\\x00\\x00\\x00lz4 /' packed.mcap >lz4.mcap; "
           "@ import --from rosbag lz4.mcap --out d");
  }
  expect(
      1, "has no pictures that can be read",
      "sed 's/bgr8/yuv9/g; s/\\xff\\xd8\\xff/\\xff\\xd7\\xff/g' bag.mcap >odd.mcap; @ import --from rosbag "
      "odd.mcap --out d");
  expect(1, "has 2 files .mcap or .db3; name one",
         "mkdir two && cp bag.mcap two/a_0.mcap && cp bag.mcap two/a_1.mcap && @ import --from rosbag two "
         "--out d");
  expect(2, "--rig and --stream must be given together",
         "@ import --from rosbag bag.mcap --rig cap/rig --stream left --out d");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_recording), cmocka_unit_test(test_packed),
                                     cmocka_unit_test(test_sqlite), cmocka_unit_test(test_hostile)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
