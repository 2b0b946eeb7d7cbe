// SPDX-License-Identifier: Apache-2.0
// The input is rig.json, a zero byte, and the text of every .cameramodel that it names.
#include <string.h>

#include "src/format/rig_file.h"
#include "tests/fuzz/fuzz.h"

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const char text[] =
      "{\"version\":1,\"name\":\"bench\",\"forward\":\"multiplexed\",\"sub_views\":[{\"name\":\"left\","
      "\"model\":\"a.cameramodel\",\"camera\":0,"
      "\"footprint\":[10,20,4,3],\"coverage\":\"a.png\"},{\"name\":\"right\",\"model\":\"b.cameramodel\","
      "\"camera\":1}]}\0"
      "{'lensmodel':'LENSMODEL_PINHOLE','intrinsics':[1,1,1,1],'extrinsics':[0,0,0,0,0,0],'imagersize':[4,3]"
      "}";
  if (i || sizeof text - 1 > cap) return 0;
  return memcpy(buf, text, sizeof text - 1), sizeof text - 1;
}

typedef struct {
  const uint8_t *json, *model;
  size_t n_json, n_model;
} files;

static sv_status from_input(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err) {
  const files *f = self;
  int is_json = strcmp(name, "rig.json") == 0;
  // no path from a file reaches outside its folder
  FUZZ_CHECK(!strchr(name, '/') && name[0] != '.');
  size_t n = is_json ? f->n_json : f->n_model;
  if (n > cap) return sv_fail(err, SV_E_NOMEM, "%s: too large", name);
  memcpy(buf, is_json ? f->json : f->model, n);
  *bytes = n;
  return SV_OK;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static _Alignas(64) uint8_t rig_block[8192], scratch_block[65536];
  const uint8_t *zero = bytes ? memchr(data, 0, bytes) : NULL;
  size_t n = zero ? (size_t)(zero - data) : bytes;
  files f = {data, zero ? zero + 1 : data, n, zero ? bytes - n - 1 : 0};
  sv_arena a = sv_arena_make(rig_block, sizeof rig_block),
           scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  sv_rig rig;
  sv_err err;
  FUZZ_CHECK(sv_rig_init(&rig, 4, &a) == SV_OK);
  sv_status s = sv_rig_read(&rig, &(sv_file_reader){&f, from_input}, 2, &scratch, &err);
  FUZZ_CHECK(sv_arena_mark(&scratch) == 0);
  if (s != SV_OK) return 0;
  FUZZ_CHECK(rig.n_sub_views >= 1 && rig.n_sub_views <= 4);
  for (int i = 0; i < rig.n_sub_views; i++)
    FUZZ_CHECK(rig.sub_views[i].i_camera >= 0 && rig.sub_views[i].i_camera < 2);
  char text[4096];
  sv_str out = sv_str_make(text, sizeof text);
  FUZZ_CHECK(sv_rig_json_write(&out, &rig) == SV_OK);
  // what was read can be written, and read again
  f.json = (const uint8_t *)text;
  f.n_json = out.len;
  FUZZ_CHECK(sv_rig_read(&rig, &(sv_file_reader){&f, from_input}, 2, &scratch, &err) == SV_OK);
  return 0;
}
