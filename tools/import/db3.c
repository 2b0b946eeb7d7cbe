// SPDX-License-Identifier: Apache-2.0
// Recordings of ROS 2 in SQLite (.db3): tables topics (id, name, type, serialization_format) and
// messages (topic_id, timestamp, data).
#include "src/base/str.h"
#include "tools/import/mcap.h"

#if defined(__has_include) && __has_include(<sqlite3.h>)
#include <sqlite3.h>
#define HAS_SQLITE 1
#else
#define HAS_SQLITE 0
#endif

bool lab_has_db3(void) { return HAS_SQLITE; }

#if HAS_SQLITE

static const char query[] =
    "SELECT t.name, t.type, m.timestamp, m.data FROM messages m JOIN topics t ON t.id = m.topic_id "
    "WHERE t.serialization_format = 'cdr' AND "
    "t.type IN ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage') ORDER BY m.timestamp, m.id";

static sv_status take_row(sqlite3_stmt *q, const lab_mcap_sink *sink, sv_err *err) {
  const char *name = (const char *)sqlite3_column_text(q, 0), *type = (const char *)sqlite3_column_text(q, 1);
  const uint8_t *data = sqlite3_column_blob(q, 3);
  char topic[LAB_MCAP_CAP_TOPIC];
  if (!name || !type || !data) return SV_OK;
  sv_copy(topic, sizeof topic, name);
  const lab_mcap_message m = {topic, sv_str_eq(type, "sensor_msgs/msg/CompressedImage"),
                              (uint64_t)sqlite3_column_int64(q, 2), data, (size_t)sqlite3_column_bytes(q, 3)};
  return sink->take(sink->self, &m, err);
}

sv_status lab_db3_read(const char *path, const lab_mcap_sink *sink, sv_err *err) {
  sqlite3 *db = NULL;
  sqlite3_stmt *q = NULL;
  sv_status s = SV_OK;
  int code = sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY, NULL);
  if (code == SQLITE_OK) code = sqlite3_prepare_v2(db, query, -1, &q, NULL);
  while (code == SQLITE_OK && s == SV_OK && (code = sqlite3_step(q)) == SQLITE_ROW) {
    s = take_row(q, sink, err);
    code = SQLITE_OK;
  }
  if (s == SV_OK && code != SQLITE_OK && code != SQLITE_DONE)
    s = sv_fail(err, SV_E_FORMAT, "%.150s: cannot be read as a recording: %.100s", path, sqlite3_errmsg(db));
  (void)sqlite3_finalize(q);
  (void)sqlite3_close(db);
  return s;
}

#else

sv_status lab_db3_read(const char *path, const lab_mcap_sink *sink, sv_err *err) {
  (void)sink;
  return sv_fail(err, SV_E_UNSUPPORTED, "%.150s: this build reads no SQLite (libsqlite3-dev was missing)",
                 path);
}

#endif
