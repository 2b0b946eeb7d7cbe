// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// Earlier scans of the page: which folders are scans, their files, delete and restore, and what the
// helper process never reaches.
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/preview/preview.h"
#include "tests/common/test.h"

static pv_scans_answer a;
static int folder_fd;

static int ask(const char *base, pv_scans_op op, uint32_t number, uint32_t file) {
  int fd;
  pv_scans_do(folder_fd, base, &(pv_scans_ask){.op = op, .number = number, .file = file}, &a, &fd);
  return fd;
}

FIXTURE(make) {
  if (temp_folder_setup(state) != 0) return -1;
  shell_ok(
      "cd '%s' && mkdir 0001 0002 0010 00011 12 0003 other && echo ply >0001/model.ply && echo long >0002/"
      "model.ply && echo p >0002/preview.jpg && echo m >0010/model.ply && echo x >00011/model.ply && echo "
      "x >12/model.ply && echo x >other/model.ply && ln -s other 0004 && ln -s /etc/passwd 0001/run.json && "
      "mkdir out out-2 out-02 && echo a >out/model.ply && echo b >out-2/model.ply && echo c >out-02/"
      "model.ply",
      temp_folder);
  folder_fd = open(temp_folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  return folder_fd < 0 ? -1 : 0;
}
FIXTURE(unmake) {
  close(folder_fd);
  return temp_folder_teardown(state);
}

TEST(test_list) {
  ask("", PV_SCANS_LIST, 0, 0);
  assert_int_equal(a.error, 0);
  assert_int_equal(a.n, 3); // 0003 has no model, 0004 is a link, 12 and 00011 are other spellings
  assert_int_equal(a.scan[0].number, 10);
  assert_int_equal(a.scan[1].number, 2);
  assert_int_equal(a.scan[1].file_bytes[0], 5);
  assert_int_equal(a.scan[1].file_bytes[1], 2);
  assert_int_equal(a.scan[1].bytes, 7);
  assert_int_equal(a.scan[2].number, 1);
  assert_int_equal(a.scan[2].file_bytes[2], 0); // a link
  assert_true(a.free_bytes > 0 && a.total_bytes >= a.free_bytes);
  ask("out", PV_SCANS_LIST, 0, 0);
  assert_int_equal(a.n, 2);
  assert_int_equal(a.scan[0].number, 2);
}

TEST(test_files) {
  char text[8] = "";
  int fd = ask("", PV_SCANS_OPEN, 2, 0);
  assert_true(fd >= 0);
  assert_int_equal(a.file_bytes, 5);
  assert_int_equal(read(fd, text, sizeof text), 5);
  assert_string_equal(text, "long\n");
  close(fd);
  assert_int_equal(ask("", PV_SCANS_OPEN, 2, PV_N_SCAN_FILE), -1);
  assert_int_equal(a.error, EINVAL);
  assert_int_equal(ask("", PV_SCANS_OPEN, 1, 2), -1); // the link to another file
  assert_int_not_equal(a.error, 0);
  assert_int_equal(ask("", PV_SCANS_OPEN, 4, 0), -1); // the link to another folder
  assert_int_not_equal(a.error, 0);
  assert_int_equal(ask("", PV_SCANS_OPEN, 0, 0), -1);
  fd = ask("out", PV_SCANS_OPEN, 2, 0);
  assert_true(fd >= 0);
  close(fd);
}

TEST(test_delete) {
  ask("", PV_SCANS_DELETE, 2, 0);
  assert_int_equal(a.error, 0);
  ask("", PV_SCANS_LIST, 0, 0);
  assert_int_equal(a.n, 3);
  assert_true(a.scan[1].number == 2 && a.scan[1].is_deleted);
  shell_ok("test ! -e '%s/0002'", temp_folder);
  ask("", PV_SCANS_RESTORE, 2, 0);
  assert_int_equal(a.error, 0);
  shell_ok("test -s '%s/0002/model.ply'", temp_folder);
  ask("", PV_SCANS_PURGE, 2, 0); // only what was deleted before
  assert_int_equal(a.error, ENOENT);
  ask("", PV_SCANS_DELETE, 2, 0);
  shell_ok("mkdir '%s/0002'", temp_folder);
  ask("", PV_SCANS_RESTORE, 2, 0);
  assert_int_equal(a.error, EEXIST);
  ask("", PV_SCANS_PURGE, 2, 0);
  assert_int_equal(a.error, 0);
  shell_ok("test ! -e '%s/.deleted-0002'", temp_folder);
  shell_ok("mkdir '%s/0010/own'", temp_folder); // a folder of somebody else keeps it
  ask("", PV_SCANS_DELETE, 10, 0);
  ask("", PV_SCANS_PURGE, 10, 0);
  assert_int_equal(a.error, ENOTEMPTY);
  ask("", PV_SCANS_DELETE, 7, 0);
  assert_int_equal(a.error, ENOENT);
}

// The process: it answers over its socket, and the server reads what it opens.
TEST(test_helper) {
  sv_err err;
  char text[64] = "", json[4096];
  int fd;
  pv_scans s = {.place = {temp_folder, ""}, .fd = -1};
  assert_int_equal(pv_scans_request(&s, (pv_scans_ask){0}, &fd), SV_E_NOT_FOUND);
  // The helper keeps no descriptor but its own, and reports nowhere
  signal(SIGPIPE, SIG_IGN);
  const int null = open("/dev/null", O_RDWR);
  const int was = dup(0);
  assert_true(dup2(null, 0) == 0);
  assert_ok(pv_scans_start(&s.place, &s.fd, &err), &err);
  dup2(was, 0);
  close(was);
  close(null);
  const pv_scans_ask open_it = {.op = PV_SCANS_OPEN, .number = 1};
  const sv_status r = pv_scans_request(&s, open_it, &fd);
  if (r == SV_E_IO) {
    print_message("skip the helper's process: no sandbox here\n");
    skip();
  }
  assert_int_equal(r, SV_OK);
  assert_int_equal(read(fd, text, sizeof text), 4);
  assert_string_equal(text, "ply\n");
  close(fd);
  sv_str o = sv_str_make(json, sizeof json);
  pv_scans_json(&s, &o);
  assert_contains(json, "\"number\":1,\"name\":\"0001\",\"deleted\":false,");
  assert_contains(json, "\"files\":{\"model.ply\":4}");
  assert_int_equal(pv_scans_request(&s, (pv_scans_ask){.op = PV_SCANS_DELETE, .number = 1}, NULL), SV_OK);
  assert_int_equal(s.answer.error, 0);
  assert_int_equal(pv_scans_request(&s, (pv_scans_ask){.op = PV_SCANS_PURGE, .number = 1}, NULL), SV_OK);
  assert_int_equal(s.answer.error, 0);
  shell_ok("test ! -e '%s/.deleted-0001'", temp_folder);
  close(s.fd);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test_setup_teardown(test_list, make, unmake),
                                     cmocka_unit_test_setup_teardown(test_files, make, unmake),
                                     cmocka_unit_test_setup_teardown(test_delete, make, unmake),
                                     cmocka_unit_test_setup_teardown(test_helper, make, unmake)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
