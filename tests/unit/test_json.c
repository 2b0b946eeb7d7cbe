// SPDX-License-Identifier: Apache-2.0
// The JSON reader: what is accepted and refused, values, and the places that errors name.
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/json.h"
#include "tests/common/test.h"

enum { CAP = 512 };
static jsmntok_t tok[CAP];
static sv_err err;

static sv_status parse(sv_json *j, const char *text) {
  return sv_json_parse(j, &(sv_file_data){"t.json", text, strlen(text)}, tok, CAP, &err);
}

TEST(test_grammar) {
  static const char *const good[] = {"{}",
                                     "[]",
                                     " [1] ",
                                     "{\"a\":1}",
                                     "[1,2,-0.5e-3,0,1E+2]",
                                     "[true,false,null,\"\"]",
                                     "{\"a\":{\"b\":[[],{}]},\"c\":[{}]}",
                                     "[\"\\u00e9\\n\\\"\\\\\\/\"]",
                                     "[\"\xc3\xa9\"]"};
  static const char *const bad[] = {"",
                                    " ",
                                    "1",
                                    "\"a\"",
                                    "{",
                                    "[",
                                    "}",
                                    "]",
                                    "[1",
                                    "[1,]",
                                    "[,1]",
                                    "[1 2]",
                                    "[1,,2]",
                                    "{\"a\"}",
                                    "{\"a\" 1}",
                                    "{\"a\":}",
                                    "{\"a\":1,}",
                                    "{,}",
                                    "{1:2}",
                                    "{\"a\":1 \"b\":2}",
                                    "{\"a\":1:2}",
                                    "[1}",
                                    "{\"a\":1]",
                                    "[01]",
                                    "[1.]",
                                    "[.5]",
                                    "[+1]",
                                    "[1e]",
                                    "[1e+]",
                                    "[-]",
                                    "[NaN]",
                                    "[Infinity]",
                                    "[-Infinity]",
                                    "[nan]",
                                    "[tru]",
                                    "[truex]",
                                    "[1x]",
                                    "[0x10]",
                                    "['a']",
                                    "[\"\\x\"]",
                                    "[\"\\u12\"]",
                                    "[\"\\u12G4\"]",
                                    "[\"a\nb\"]",
                                    "[\"a]",
                                    "[\"\\",
                                    "{} {}",
                                    "[] x",
                                    "// c\n[]",
                                    "[1]\xff",
                                    "{a:1}",
                                    "[\"a\":1]",
                                    "{\"a\":[1,{\"b\":2]}}"};
  sv_json j;
  for (size_t i = 0; i < sizeof good / sizeof *good; i++)
    if (parse(&j, good[i]) != SV_OK) fail_msg("refused %s: %s", good[i], err.text);
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
    if (parse(&j, bad[i]) != SV_E_FORMAT) fail_msg("accepted %s", bad[i]);
  assert_int_equal(sv_json_parse(&j, &(sv_file_data){"t", "[1]\0", 4}, tok, CAP, &err),
                   SV_E_FORMAT); // a NUL is text after the end
  char deep[2 * SV_JSON_CAP_DEPTH + 3] = {0};
  memset(deep, '[', SV_JSON_CAP_DEPTH);
  memset(deep + SV_JSON_CAP_DEPTH, ']', SV_JSON_CAP_DEPTH);
  assert_int_equal(parse(&j, deep), SV_OK);
  memset(deep, '[', SV_JSON_CAP_DEPTH + 1);
  memset(deep + SV_JSON_CAP_DEPTH + 1, ']', SV_JSON_CAP_DEPTH + 1);
  assert_int_equal(parse(&j, deep), SV_E_FORMAT);
  int n = 0;
  assert_int_equal(sv_json_count("t", "{\"a\":[1,2]}", 11, &n, &err), SV_OK);
  assert_int_equal(n, 5);
  assert_int_equal(sv_json_parse(&j, &(sv_file_data){"t", "{\"a\":[1,2]}", 11}, tok, 4, &err), SV_E_NOMEM);
  assert_int_equal(sv_json_parse(&j, &(sv_file_data){"t", "{\"a\":[1,2]}", 11}, tok, 5, &err), SV_OK);
}

TEST(test_values) {
  sv_json j;
  assert_int_equal(parse(&j,
                         "{\"d\":-1.25e2,\"i\":42,\"f\":540.0,\"s\":\"a\\u00e9\\ud83d\\ude00\\n\",\"b\":true,"
                         "\"n\":null,\"a\":[1,2,3],\"big\":1e999,\"x\":{\"d\":7},\"h\":\"\\ud83d\",\"z\":"
                         "\"a\\u0000\",\"t\":1e-999}"),
                   SV_OK);
  double d = 0, a[3];
  long long i = 0;
  bool b = false;
  char s[16] = "keep";
  assert_int_equal(sv_json_get_double(&j, 0, "d", &d, &err), SV_OK);
  assert_true(d == -125);
  assert_int_equal(sv_json_get_double(&j, 0, "t", &d, &err), SV_OK);
  assert_true(d == 0);
  assert_int_equal(sv_json_get_int(&j, 0, "i", (sv_json_range){0, 100}, &i, &err), SV_OK);
  assert_int_equal(i, 42);
  assert_int_equal(sv_json_get_int(&j, 0, "f", (sv_json_range){0, 1000}, &i, &err), SV_OK);
  assert_int_equal(i, 540);
  assert_int_equal(sv_json_get_int(&j, 0, "i", (sv_json_range){0, 41}, &i, &err), SV_E_RANGE);
  assert_int_equal(sv_json_get_string(&j, 0, "s", s, sizeof s, &err), SV_OK);
  assert_string_equal(s, "a\xc3\xa9\xf0\x9f\x98\x80\n");
  assert_int_equal(sv_json_get_string(&j, 0, "s", s, 8, &err), SV_E_RANGE); // needs 9 with its end
  assert_int_equal(sv_json_get_string(&j, 0, "s", s, 9, &err), SV_OK);
  assert_int_equal(sv_json_get_string(&j, 0, "h", s, sizeof s, &err), SV_E_RANGE);
  assert_int_equal(sv_json_get_string(&j, 0, "z", s, sizeof s, &err), SV_E_RANGE);
  assert_int_equal(sv_json_bool(&j, sv_json_get(&j, 0, "b"), &b, &err), SV_OK);
  assert_true(b);
  assert_int_equal(sv_json_bool(&j, sv_json_get(&j, 0, "n"), &b, &err), SV_E_FORMAT);
  assert_int_equal(sv_json_get_double(&j, 0, "n", &d, &err), SV_END);
  assert_int_equal(sv_json_get_double(&j, 0, "absent", &d, &err), SV_END);
  assert_int_equal(sv_json_get_double(&j, 0, "big", &d, &err), SV_E_RANGE);
  assert_int_equal(sv_json_get_double(&j, 0, "s", &d, &err), SV_E_FORMAT);
  assert_int_equal(sv_json_doubles(&j, sv_json_get(&j, 0, "a"), a, 3, &err), SV_OK);
  assert_true(a[0] == 1 && a[1] == 2 && a[2] == 3);
  assert_int_equal(sv_json_doubles(&j, sv_json_get(&j, 0, "a"), a, 2, &err), SV_E_FORMAT);
  // a key inside a value is not a key of the outer object
  assert_int_equal(sv_json_get(&j, sv_json_get(&j, 0, "x"), "i"), -1);
  assert_int_equal(sv_json_get(&j, -1, "i"), -1);
  assert_int_equal(sv_json_size(&j, sv_json_get(&j, 0, "x")), 1);
}

TEST(test_places) {
  sv_json j;
  double d;
  assert_int_equal(parse(&j, "{\"frames\": [\n {\"fl_x\": 1},\n {\"m\": [[1, 2], [3, true]]}\n]}"), SV_OK);
  int f = sv_json_next(&j, sv_json_first(&j, sv_json_get(&j, 0, "frames")));
  int row = sv_json_next(&j, sv_json_first(&j, sv_json_get(&j, f, "m")));
  assert_int_equal(sv_json_double(&j, sv_json_next(&j, sv_json_first(&j, row)), &d, &err), SV_E_FORMAT);
  assert_string_equal(err.text, "t.json:3: frames[1].m[1][1]: a number was expected, found true or false");
  assert_int_equal(sv_json_next(&j, f), -1);
  assert_int_equal(sv_json_missing(&j, f, "k", &err), SV_E_NOT_FOUND);
  assert_string_equal(err.text, "t.json:3: frames[1]: \"k\" is missing");
  assert_int_equal(parse(&j, "{\n\"a\": 1,\n\"b\" 2}"), SV_E_FORMAT);
  assert_string_equal(err.text, "t.json:3: not JSON: ':' was expected after a key");
  assert_int_equal(sv_json_first(&j, 0), -1);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_grammar), cmocka_unit_test(test_values),
                                     cmocka_unit_test(test_places)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
