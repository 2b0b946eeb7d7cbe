// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/format/json.h"
#include "tests/fuzz/fuzz.h"

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const char *const texts[] = {
      "{\"a\":[1,-2.5e3,true,false,null],\"b\":{\"c\":\"x\\u00e9\\ud83d\\ude00\\n\\\"\",\"d\":[]},\"e\":{}}",
      "[[[[[[1]]]]],{\"k\":[{\"k\":[{\"k\":0}]}]},\"\",0,1E+10]", " [ ] "};
  if (i >= 3 || strlen(texts[i]) > cap) return 0;
  return memcpy(buf, texts[i], strlen(texts[i])), strlen(texts[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static jsmntok_t tok[4096];
  sv_json j;
  sv_err err;
  int n = 0;
  sv_status s = sv_json_count("f", (const char *)data, bytes, &n, &err);
  if (s != SV_OK) {
    FUZZ_CHECK(s < 0 && strncmp(err.text, "f:", 2) == 0);
    FUZZ_CHECK(sv_json_parse(&j, &(sv_file_data){"f", data, bytes}, tok, 4096, &err) == s);
    return 0;
  }
  if (n > 4096) return 0;
  // n tokens are enough
  FUZZ_CHECK(sv_json_parse(&j, &(sv_file_data){"f", data, bytes}, tok, n, &err) == SV_OK);
  if (n > 1) FUZZ_CHECK(sv_json_parse(&j, &(sv_file_data){"f", data, bytes}, tok, n - 1, &err) == SV_E_NOMEM);
  FUZZ_CHECK(sv_json_parse(&j, &(sv_file_data){"f", data, bytes}, tok, n, &err) == SV_OK);
  for (int i = 0; i < j.n_tok; i++) {
    double d = 0, v[3];
    long long k;
    bool b;
    char text[32];
    s = sv_json_double(&j, i, &d, &err);
    FUZZ_CHECK(s < 0 || isfinite(d));
    s = sv_json_int(&j, i, -5, 5, &k, &err);
    FUZZ_CHECK(s < 0 || (k >= -5 && k <= 5));
    s = sv_json_string(&j, i, text, sizeof text, &err);
    FUZZ_CHECK(s < 0 || strlen(text) < sizeof text);
    FUZZ_CHECK(sv_json_bool(&j, i, &b, &err) <= 0 && sv_json_doubles(&j, i, v, 3, &err) <= 0);
    int count = 0;
    for (int e = sv_json_first(&j, i); e >= 0; e = sv_json_next(&j, e)) count++;
    if (sv_json_is_array(&j, i)) FUZZ_CHECK(count == sv_json_size(&j, i));
    (void)sv_json_get(&j, i, "k");
  }
  return 0;
}
