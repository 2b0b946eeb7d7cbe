// SPDX-License-Identifier: Apache-2.0
// A folder of pictures as a capture: one folder a camera, or pictures of one camera.
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/codec/codec.h"
#include "platform/linux/linux.h"
#include "platform/replay/capture.h"
#include "src/base/str.h"

#define FPS            10
#define CAP_NAME       256
#define MAX_FILE_BYTES (256u << 20)

typedef struct {
  const char **names;
  int n;
} name_list;

static bool is_picture(const char *name) {
  const char *dot = strrchr(name, '.');
  return dot && name[0] != '.' &&
         (!strcasecmp(dot, ".jpg") || !strcasecmp(dot, ".jpeg") || !strcasecmp(dot, ".png"));
}

static bool is_folder(const char *dir, const char *name) {
  char path[SV_CAPTURE_CAP_PATH + CAP_NAME];
  struct stat st;
  sv_fmt(path, sizeof path, "%s/%s", dir, name);
  return name[0] != '.' && stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

static int by_name(const void *a, const void *b) {
  return strcmp(*(const char *const *)a, *(const char *const *)b);
}

// Pictures of a folder, or its folders, sorted. Names that are not UTF-8 do not count.
static sv_status list(const char *dir, bool is_folders, name_list *out, sv_arena *arena, sv_err *err) {
  *out = (name_list){0};
  for (int pass = 0; pass < 2; pass++) {
    DIR *d = opendir(dir);
    if (!d) return sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be listed: %s", dir, sv_linux_reason(errno));
    int n = 0;
    for (const struct dirent *e; (e = readdir(d));) {
      if (!sv_is_utf8(e->d_name) || !(is_folders ? is_folder(dir, e->d_name) : is_picture(e->d_name)))
        continue;
      if (pass && n < out->n) {
        char *name = SV_TAKE(arena, char, strlen(e->d_name) + 1);
        if (name) strcpy(name, e->d_name);
        out->names[n] = name;
      }
      n++;
    }
    closedir(d);
    if (pass) out->n = n < out->n ? n : out->n; // files may have come or gone meanwhile
    else if (!n) return SV_OK;
    else {
      out->n = n;
      out->names = SV_TAKE(arena, const char *, n);
    }
    if (arena->status < 0)
      return sv_fail(err, arena->status, "%s: the memory left does not hold its %d names", dir, n);
  }
  qsort(out->names, (size_t)out->n, sizeof *out->names, by_name);
  return SV_OK;
}

// Size and kind of pixels, by the first picture.
static sv_status probe(const char *path, sv_camera_caps *caps, sv_arena *arena, sv_err *err) {
  struct stat st;
  sv_codec_info info;
  const size_t mark = sv_arena_mark(arena);
  int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be opened: %s", path, sv_linux_reason(errno));
  sv_status s = SV_OK;
  if (fstat(fd, &st) < 0 || !S_ISREG(st.st_mode) || (uint64_t)st.st_size > MAX_FILE_BYTES)
    s = sv_fail(err, SV_E_FORMAT, "%s: not a regular file of up to %u bytes", path, MAX_FILE_BYTES);
  uint8_t *data = s == SV_OK ? SV_TAKE(arena, uint8_t, (size_t)st.st_size + 1) : NULL;
  if (s == SV_OK && !data) s = sv_fail(err, SV_E_NOMEM, "%s: does not fit into the memory left", path);
  size_t got = 0;
  for (ssize_t n = 1; s == SV_OK && n > 0 && got<(size_t)st.st_size; got += n> 0 ? (size_t)n : 0)
    n = read(fd, data + got, (size_t)st.st_size - got);
  close(fd);
  if (s == SV_OK && (s = sv_codec_probe(data, got, &info, err)) < 0) {
    const sv_err why = *err;
    sv_fail(err, s, "%s: %s", path, why.text);
  }
  sv_arena_reset(arena, mark);
  if (s < 0) return s;
  caps->width_px = info.width_px;
  caps->height_px = info.height_px;
  caps->format = info.bits == 16 ? SV_PIX_RGB16 : SV_PIX_RGB8;
  caps->frame_bytes = (size_t)info.width_px * (size_t)info.height_px * (info.bits == 16 ? 6 : 3);
  return SV_OK;
}

// A folder with a rig may hold pictures, too: of coverage and masks.
static bool has_rig(const char *dir, const char *folder) {
  char path[SV_CAPTURE_CAP_PATH + CAP_NAME + 16];
  sv_fmt(path, sizeof path, "%s/%s/rig.json", dir, folder);
  return access(path, F_OK) == 0;
}

static sv_status add_camera(sv_capture *c, const char *dir, const char *folder, sv_arena *arena,
                            sv_err *err) {
  char path[SV_CAPTURE_CAP_PATH + 2 * CAP_NAME];
  name_list files;
  sv_fmt(path, sizeof path, "%s/%s", dir, folder);
  sv_status s = list(path, false, &files, arena, err);
  if (s < 0 || !files.n) return s;
  sv_capture_camera *cc = &c->cameras[c->n_cameras];
  *cc = (sv_capture_camera){.folder = folder,
                            .n_frames = files.n,
                            .frames = SV_TAKE(arena, sv_capture_frame, files.n),
                            .caps = {.fps = FPS, .clock = SV_CLOCK_MONOTONIC, .stamp = SV_STAMP_START}};
  if (!cc->frames) return sv_fail(err, SV_E_NOMEM, "%s: the memory left does not hold its frames", path);
  (void)sv_copy(cc->caps.name, sizeof cc->caps.name, strcmp(folder, ".") != 0 ? folder : "camera");
  for (int i = 0; i < files.n; i++) {
    const sv_ns t_ns = i * (SV_NS_PER_S / FPS);
    cc->frames[i] = (sv_capture_frame){
        .file = files.names[i], .sequence = (uint32_t)i, .camera_ns = t_ns, .arrival_ns = t_ns};
  }
  if (c->n_cameras && files.n != c->cameras[0].n_frames)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: %s has %d pictures and %s has %d; expected one of each camera for every exposure",
                   dir, c->cameras[0].folder, c->cameras[0].n_frames, folder, files.n);
  if (strcmp(folder, ".") != 0) sv_fmt(path, sizeof path, "%s/%s/%s", dir, folder, files.names[0]);
  else sv_fmt(path, sizeof path, "%s/%s", dir, files.names[0]);
  if ((s = probe(path, &cc->caps, arena, err)) < 0) return s;
  c->n_cameras++;
  c->n_frames += files.n;
  return SV_OK;
}

sv_status sv_capture_of_pictures(sv_capture *c, const char *dir, sv_arena *arena, sv_err *err) {
  name_list folders;
  *c = (sv_capture){.name = "", .rig = ""};
  sv_status s = list(dir, true, &folders, arena, err);
  if (s < 0) return s;
  c->cameras = SV_TAKE(arena, sv_capture_camera, SV_CAP_SUB_VIEWS);
  if (!c->cameras) return sv_fail(err, SV_E_NOMEM, "%s: the memory left does not hold its cameras", dir);
  for (int i = 0; i < folders.n && s == SV_OK && c->n_cameras < SV_CAP_SUB_VIEWS; i++)
    if (has_rig(dir, folders.names[i])) c->rig = folders.names[i];
    else s = add_camera(c, dir, folders.names[i], arena, err);
  if (s == SV_OK && !c->n_cameras) s = add_camera(c, dir, ".", arena, err);
  if (s == SV_OK && !c->n_cameras)
    s = sv_fail(
        err, SV_E_NOT_FOUND,
        "%s: holds neither capture.json nor pictures; expected a folder of JPEG or PNG files for each camera",
        dir);
  return s;
}
