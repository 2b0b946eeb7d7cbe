// SPDX-License-Identifier: Apache-2.0
// Opens subview-libcamera.so when a libcamera source is asked for, and passes the calls on. Without
// the module, or without the libcamera release that it needs, each call says why; V4L2 is not
// affected. The module is looked for beside the program and in ../lib/subview from there, nowhere
// else.
#include <dlfcn.h>
#include <string.h>
#include <unistd.h>

#include "platform/libcamera/module.h"

static const sv_libcamera_table_t *table; // once it is open, it stays open

// The folder of this program, with the slash at its end.
static bool program_folder(char *out, size_t cap) {
  ssize_t n = readlink("/proc/self/exe", out, cap - 1);
  while (n > 0 && out[n - 1] != '/') n--;
  if (n <= 0) return false;
  out[n] = 0;
  return true;
}

static bool find_module(char *path, size_t cap) {
  static const char *const below[] = {"", "../lib/subview/"};
  char folder[512];
  if (!program_folder(folder, sizeof folder)) return false;
  for (size_t i = 0; i < sizeof below / sizeof *below; i++) {
    sv_fmt(path, cap, "%s%s%s", folder, below[i], SV_LIBCAMERA_MODULE);
    if (access(path, R_OK) == 0) return true;
  }
  return false;
}

static bool fits(const sv_libcamera_table_t *t) {
  static const unsigned sizes[] = SV_LIBCAMERA_SIZES;
  return !strcmp(t->revision, SV_LIBCAMERA_REVISION) && !memcmp(t->sizes, sizes, sizeof sizes);
}

static sv_status load(sv_err *err) {
  char path[640];
  if (table) return SV_OK;
  if (!find_module(path, sizeof path))
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "libcamera: " SV_LIBCAMERA_MODULE
                   " is neither beside this program nor in ../lib/subview; v4l2: works without it");
  void *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (!module) {
    const char *reason = dlerror();
    return sv_fail(err, SV_E_UNSUPPORTED, "libcamera: the module does not load (%s); v4l2: works without it",
                   reason ? reason : path);
  }
  const sv_libcamera_table_t *t = dlsym(module, SV_LIBCAMERA_TABLE);
  if (t && fits(t)) {
    table = t;
    return SV_OK;
  }
  dlclose(module);
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "libcamera: %s is of another build than this program; v4l2: works without it", path);
}

sv_status sv_libcamera_open(sv_libcamera **self, const sv_camera_options *cfg, const sv_clock *clock,
                            sv_err *err) {
  *self = NULL;
  sv_status r = load(err);
  return r < 0 ? r : table->open(self, cfg, clock, err);
}

void sv_libcamera_close(sv_libcamera *self) {
  if (self) table->close(self);
}

sv_source sv_libcamera_source(sv_libcamera *self) { return table->source(self); }

int sv_libcamera_list(sv_str *out, sv_err *err) {
  sv_status r = load(err);
  return r < 0 ? r : table->list(out, err);
}
