// SPDX-License-Identifier: Apache-2.0
// QR codes of all versions. zbarimg, where it is installed, reads them; the recorded digests are of
// codes that it read.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/qr.h"
#include "tests/common/test.h"

static sv_qr q;
static char root[256];

// n characters as a link has them.
static void fill(char *text, int n) {
  static const char letters[] = "0123456789abcdefghijklmnopqrstuvwxyz-_:/#.";
  for (int i = 0; i < n; i++) text[i] = letters[(7 * i + n + i * i) % 42];
  text[n] = 0;
}

static uint64_t digest(void) {
  uint64_t h = 14695981039346656037u; // FNV-1a
  for (int y = 0; y < q.side; y++)
    for (int x = 0; x < q.side; x++) h = (h ^ (q.module[y][x] & SV_QR_DARK)) * 1099511628211u;
  return h;
}

static void write_image(const char *path) {
  const int s = (q.side + 8) * 4;
  FILE *f = fopen(path, "wb");
  assert_non_null(f);
  fprintf(f, "P5\n%d %d\n255\n", s, s);
  for (int i = 0; i < s * s; i++) {
    const int x = i % s / 4 - 4, y = i / s / 4 - 4;
    const bool is_inside = x >= 0 && y >= 0 && x < q.side && y < q.side;
    fputc(is_inside && q.module[y][x] & SV_QR_DARK ? 0 : 255, f);
  }
  assert_int_equal(fclose(f), 0);
}

TEST(test_versions) {
  static const struct {
    int n, side;
    uint64_t digest;
  } codes[] = {
      {17, 21, 0x0db4a1538314ef2du},  {18, 25, 0xc9d77928969a944du},  {53, 29, 0x623df6dfe966099cu},
      {62, 33, 0x72ea36e836d6ed58u},  {106, 37, 0x4932e9c04463aa59u}, {134, 41, 0x12d51caec4e73ff2u},
      {154, 45, 0x0a943e78bde410ebu}, {192, 49, 0x3259831abfbcc8a9u}, {230, 53, 0x6261782a5b611999u}};
  char text[SV_QR_CAP_TEXT + 2], command[400], read[300];
  const bool has_reader = system("command -v zbarimg >/dev/null 2>&1") == 0;
  if (!has_reader) print_message("no zbarimg here (package zbar-tools): digests alone\n");
  for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
    fill(text, codes[i].n);
    assert_true(sv_qr_make(&q, text));
    assert_int_equal(q.side, codes[i].side);
    if (has_reader) {
      snprintf(command, sizeof command, "%s/code.pgm", root);
      write_image(command);
      snprintf(command, sizeof command, "zbarimg -q --raw -Sdisable -Sqrcode.enable %s/code.pgm 2>/dev/null",
               root);
      FILE *p = popen(command, "r");
      assert_non_null(p);
      read[fread(read, 1, sizeof read - 1, p)] = 0;
      pclose(p);
      read[strcspn(read, "\n")] = 0;
      assert_string_equal(read, text);
    }
    assert_digest(digest(), codes[i].digest, "QR code");
  }
  memset(text, 'a', sizeof text - 1);
  text[SV_QR_CAP_TEXT + 1] = 0;
  assert_false(sv_qr_make(&q, text));
}

TEST(test_pictures) {
  static char text[SV_QR_CAP_SVG];
  char longest[SV_QR_CAP_TEXT + 1];
  fill(longest, SV_QR_CAP_TEXT);
  assert_true(sv_qr_make(&q, longest));
  sv_str out = sv_str_make(text, SV_QR_CAP_LINES);
  sv_qr_lines(&q, &out);
  assert_false(out.is_cut);
  out = sv_str_make(text, sizeof text);
  sv_qr_svg(&q, &out);
  assert_false(out.is_cut);
  assert_true(sv_qr_make(&q, "A"));
  out = sv_str_make(text, sizeof text);
  sv_qr_lines(&q, &out);
  int n_lines = 0;
  for (const char *at = text; (at = strchr(at, '\n')); at++) n_lines++;
  assert_int_equal(n_lines, 15); // 21 modules and 8 of white
  // Finder: seven dark modules below white
  assert_contains(text, "    \u2588\u2580\u2580\u2580\u2580\u2580\u2588 ");
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "qr"); }
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_versions),
      cmocka_unit_test(test_pictures),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
