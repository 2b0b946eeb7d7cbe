// SPDX-License-Identifier: Apache-2.0
// COLMAP models: cameras, images and points3D, of 3.12 and later also rigs and frames, as .bin or
// .txt, in DIR, DIR/sparse or DIR/sparse/0; images in DIR/images or DIR.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/import.h"

typedef struct {
  char path[SV_CAP_PATH];
  void *data;
  sv_colmap c;
} part;

static sv_status open_part(part *p, const char *folder, const char *stem, sv_err *err) {
  char name[40];
  size_t bytes;
  memset(p, 0, sizeof *p);
  bool is_binary = true;
  for (int i = 0; i < 2; i++) {
    is_binary = i == 0;
    snprintf(name, sizeof name, "%s.%s", stem, is_binary ? "bin" : "txt");
    sv_status s = sv_path_join(p->path, sizeof p->path, folder, name, err);
    if (s != SV_OK) return s;
    if (sv_path_exists(p->path)) break;
  }
  sv_status s = sv_file_read(p->path, &p->data, &bytes, err);
  if (s == SV_OK) s = sv_colmap_open(&p->c, p->path, p->data, bytes, is_binary, err);
  return s;
}

// images_path: that of the model's list of images.
static bool find_model(const char *dir, char folder[SV_CAP_PATH], char images_path[SV_CAP_PATH]) {
  static const char *const places[] = {"", "sparse", "sparse/0"};
  for (int i = 0; i < 3; i++) {
    if (snprintf(folder, SV_CAP_PATH, "%s%s%s", dir, i ? "/" : "", places[i]) >= SV_CAP_PATH) return false;
    for (int k = 0; k < 2; k++)
      if (sv_path_join(images_path, SV_CAP_PATH, folder, k ? "images.txt" : "images.bin", NULL) == SV_OK &&
          sv_path_exists(images_path))
        return true;
  }
  return false;
}

static sv_status read_cameras(const char *folder, sv_colmap_camera **cameras, int *n, sv_err *err) {
  part p;
  sv_status s = open_part(&p, folder, "cameras", err);
  int cap = 0;
  while (s == SV_OK) {
    if (*n >= cap) {
      cap = cap ? 2 * cap : 16;
      void *more = realloc(*cameras, (size_t)cap * sizeof **cameras);
      if (!more) {
        s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its cameras", p.path);
        break;
      }
      *cameras = more;
    }
    s = sv_colmap_next_camera(&p.c, &(*cameras)[*n], err);
    *n += s == SV_OK;
  }
  free(p.data);
  return s == SV_END ? SV_OK : s;
}

typedef struct {
  sv_colmap_camera *at;
  int n;
} camera_list;

static sv_status add_image(lab_import *im, const char *dir, const char *model_path, const sv_colmap_image *g,
                           const camera_list *cameras, sv_err *err) {
  char pictures[SV_CAP_PATH];
  int c = 0;
  while (c < cameras->n && cameras->at[c].id != g->camera_id) c++;
  if (c == cameras->n)
    return sv_fail(err, SV_E_FORMAT, "%s: image %s refers to camera %u, which the model does not contain",
                   model_path, g->name, g->camera_id);
  lab_import_view *v = lab_import_add(im);
  if (!v) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its images", model_path);
  v->model = cameras->at[c].model;
  v->cam_from_world = g->cam_from_world;
  v->source_id = g->id;
  snprintf(v->camera, sizeof v->camera, "%u", g->camera_id);
  if (g->name[0] == '/' || strstr(g->name, "..") || !sv_copy(v->name, sizeof v->name, g->name))
    return sv_fail(err, SV_E_FORMAT, "%s: image name %s points outside the folder", model_path, g->name);
  sv_status s = sv_path_join(pictures, sizeof pictures, dir, "images", err);
  return s == SV_OK ? sv_path_join(v->source, sizeof v->source, sv_path_is_folder(pictures) ? pictures : dir,
                                   g->name, err)
                    : s;
}

// Rigs: images of one frame are one exposure, and the sub-view is the camera's place among the
// rig's cameras. A model without frames, or with one image a frame, says nothing about that.
typedef struct {
  uint32_t rig, camera;
} seat; // of a rig, in order of first appearance

static int seat_of(seat *seats, int *n, uint32_t rig, uint32_t camera) {
  int place = 0;
  for (int i = 0; i < *n; i++) {
    if (seats[i].rig != rig) continue;
    if (seats[i].camera == camera) return place;
    place++;
  }
  if (*n < SV_COLMAP_CAP_DATA) seats[(*n)++] = (seat){rig, camera};
  return place;
}

// Where the cameras of the rigs are.
typedef struct {
  uint32_t rig, camera;
  sv_pose cam_from_rig;
} mount;

typedef struct {
  const char *dir, *folder, *path; // path: of the frames
  camera_list cameras;
  mount *mounts;
  int n_mounts, cap_mounts;
  seat seats[SV_COLMAP_CAP_DATA];
  int n_seats;
} model;

static sv_status add_mounts(model *m, const sv_colmap_rig *g, sv_err *err) {
  for (int i = 0; i < g->n_cameras; i++) {
    if (!g->cameras[i].has_pose) continue;
    if (m->n_mounts == m->cap_mounts) {
      int cap = m->cap_mounts ? 2 * m->cap_mounts : 16;
      void *more = realloc(m->mounts, (size_t)cap * sizeof *m->mounts);
      if (!more) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its rigs", m->folder);
      m->mounts = more;
      m->cap_mounts = cap;
    }
    m->mounts[m->n_mounts++] = (mount){g->id, g->cameras[i].camera_id, g->cameras[i].cam_from_rig};
  }
  return SV_OK;
}

static sv_status read_rigs(model *m, sv_err *err) {
  part p = {0};
  sv_colmap_rig *g = malloc(sizeof *g);
  sv_status s = g ? open_part(&p, m->folder, "rigs", err)
                  : sv_fail(err, SV_E_NOMEM, "%s: no memory for its rigs", m->folder);
  bool is_absent = s == SV_E_NOT_FOUND; // COLMAP before 3.12
  while (s == SV_OK && (s = sv_colmap_next_rig(&p.c, g, err)) == SV_OK) {
    s = add_mounts(m, g, err);
    if (s != SV_OK) break;
  }
  free(p.data);
  free(g);
  return is_absent || s == SV_END ? SV_OK : s;
}

static const mount *mount_of(const model *m, uint32_t rig, uint32_t camera) {
  for (int i = 0; i < m->n_mounts; i++)
    if (m->mounts[i].rig == rig && m->mounts[i].camera == camera) return &m->mounts[i];
  return NULL;
}

// The image that a camera took in a frame without being registered in it, by COLMAP's rule for
// rigs: a frame's images have one name, in a folder for each camera. False when that gives no image
// of its own.
static bool find_picture(const lab_import *im, const model *m, const sv_colmap_camera *camera, int i_frame,
                         char *name, size_t cap) {
  const char *folder = NULL, *file = NULL;
  char id[32], path[SV_CAP_PATH], pictures[SV_CAP_PATH];
  snprintf(id, sizeof id, "%u", camera->id);
  for (int i = 0; i < im->n && !(folder && file); i++) {
    const lab_import_view *v = &im->views[i];
    if (!folder && strcmp(v->camera, id) == 0) folder = v->name;
    if (!file && v->exposure == i_frame) file = v->name;
  }
  if (!folder || !file) return false;
  int n_folder = (int)(sv_path_name(folder) - folder);
  if (snprintf(name, cap, "%.*s%s", n_folder, folder, sv_path_name(file)) >= (int)cap) return false;
  for (int i = 0; i < im->n; i++)
    if (strcmp(im->views[i].name, name) == 0) return false; // another image's
  if (sv_path_join(pictures, sizeof pictures, m->dir, "images", NULL) != SV_OK) return false;
  const char *from = sv_path_is_folder(pictures) ? pictures : m->dir;
  return sv_path_join(path, sizeof path, from, name, NULL) == SV_OK && sv_path_exists(path);
}

static sv_status add_unregistered(lab_import *im, model *m, const sv_colmap_frame *f, int i_frame,
                                  const mount *at, sv_err *err) {
  sv_colmap_image g = {.id = 0, .camera_id = at->camera};
  const sv_colmap_camera *camera = NULL;
  bool is_listed = false;
  for (int i = 0; i < m->cameras.n; i++)
    if (m->cameras.at[i].id == at->camera) camera = &m->cameras.at[i];
  for (int k = 0; k < f->n_images; k++) is_listed = is_listed || f->images[k].camera_id == at->camera;
  if (!camera || !find_picture(im, m, camera, i_frame, g.name, sizeof g.name)) {
    im->n_lost += is_listed; // not listed: the camera may have taken none
    return SV_OK;
  }
  g.cam_from_world = sv_pose_mul(&at->cam_from_rig, &f->rig_from_world);
  sv_status s = add_image(im, m->dir, m->path, &g, &m->cameras, err);
  if (s != SV_OK) return s;
  lab_import_view *v = &im->views[im->n - 1];
  v->exposure = i_frame;
  v->source_id = UINT64_MAX;
  v->sub_view = seat_of(m->seats, &m->n_seats, f->rig_id, at->camera);
  im->n_from_rig++;
  return SV_OK;
}

static sv_status add_frame(lab_import *im, model *m, const sv_colmap_frame *f, int i_frame, sv_err *err) {
  uint8_t *has = calloc((size_t)m->n_mounts + 1, 1); // a view of the frame by mount
  sv_status s = has ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for its frames", m->path);
  for (int k = 0; s == SV_OK && k < f->n_images; k++)
    for (int i = 0; i < im->n; i++) {
      lab_import_view *v = &im->views[i];
      if (v->source_id != f->images[k].image_id) continue;
      const mount *at = mount_of(m, f->rig_id, f->images[k].camera_id);
      v->exposure = i_frame;
      v->sub_view = seat_of(m->seats, &m->n_seats, f->rig_id, f->images[k].camera_id);
      if (at) {
        has[at - m->mounts] = 1;
        v->cam_from_world = sv_pose_mul(&at->cam_from_rig, &f->rig_from_world);
      }
    }
  for (int i = 0; s == SV_OK && i < m->n_mounts; i++)
    if (m->mounts[i].rig == f->rig_id && !has[i]) s = add_unregistered(im, m, f, i_frame, &m->mounts[i], err);
  free(has);
  return s;
}

static sv_status read_frames(lab_import *im, model *m, sv_err *err) {
  part p = {0};
  int n_frames = 0;
  bool is_rig = false;
  sv_colmap_frame *f = malloc(sizeof *f);
  sv_status s = f ? open_part(&p, m->folder, "frames", err)
                  : sv_fail(err, SV_E_NOMEM, "%s: no memory for its frames", m->folder);
  bool is_absent = s == SV_E_NOT_FOUND;
  m->path = p.path;
  while (s == SV_OK && (s = sv_colmap_next_frame(&p.c, f, err)) == SV_OK) {
    s = add_frame(im, m, f, n_frames++, err);
    is_rig = is_rig || f->n_images > 1 || im->n_from_rig;
  }
  for (int i = 0; i < im->n && !is_rig; i++) im->views[i].exposure = im->views[i].sub_view = -1;
  free(p.data);
  free(f);
  return is_absent || s == SV_END ? SV_OK : s;
}

static int by_name(const void *a, const void *b) {
  return strcmp(((const lab_import_view *)a)->name, ((const lab_import_view *)b)->name);
}

static sv_status read_images(lab_import *im, const char *dir, const char *folder, const camera_list *cameras,
                             sv_err *err) {
  part p;
  sv_colmap_image g;
  sv_status s = open_part(&p, folder, "images", err);
  while (s == SV_OK && (s = sv_colmap_next_image(&p.c, &g, err)) == SV_OK)
    s = add_image(im, dir, p.path, &g, cameras, err);
  free(p.data);
  return s < 0 ? s : SV_OK;
}

static sv_status read_points(lab_import *im, const char *folder, sv_err *err) {
  part p;
  sv_colmap_point g;
  sv_status s = open_part(&p, folder, "points3D", err);
  if (s == SV_E_NOT_FOUND) { // poses alone are a dataset, too
    free(p.data);
    return SV_OK;
  }
  while (s == SV_OK && (s = sv_colmap_next_point(&p.c, &g, err)) == SV_OK) {
    sv_point *q = lab_import_add_point(im);
    if (!q) {
      s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its points", p.path);
      break;
    }
    for (int k = 0; k < 3; k++) {
      q->mean[k] = (float)g.xyz[k];
      q->rgb[k] = (float)g.rgb[k] / 255.0f;
    }
  }
  free(p.data);
  return s < 0 ? s : SV_OK;
}

bool lab_import_colmap_model(const char *dir, char images_path[SV_CAP_PATH]) {
  char folder[SV_CAP_PATH];
  return find_model(dir, folder, images_path);
}

sv_status lab_import_colmap(lab_import *im, const char *dir, sv_err *err) {
  char folder[SV_CAP_PATH], images_path[SV_CAP_PATH];
  camera_list cameras = {0};
  if (!find_model(dir, folder, images_path))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: no images.bin or images.txt in it, in sparse/ or in sparse/0/",
                   dir);
  sv_status s = read_cameras(folder, &cameras.at, &cameras.n, err);
  if (s == SV_OK) s = read_images(im, dir, folder, &cameras, err);
  model *m = calloc(1, sizeof *m);
  if (s == SV_OK && !m) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its rigs", dir);
  if (m) {
    m->dir = dir;
    m->folder = folder;
    m->cameras = cameras;
  }
  if (s == SV_OK) s = read_rigs(m, err);
  if (s == SV_OK) s = read_frames(im, m, err);
  if (s == SV_OK) s = read_points(im, folder, err);
  if (s == SV_OK && im->n > 1) // "every 8th view" then means what others mean by it
    qsort(im->views, (size_t)im->n, sizeof *im->views, by_name);
  if (m) free(m->mounts);
  free(m);
  free(cameras.at);
  return s;
}
