// SPDX-License-Identifier: Apache-2.0
// Source strings -> cameras, clock, rig and, where it is known, the scene's place.
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "boards/board_main.h"

static sv_status read_caps(board_source *s, sv_arena *arena, sv_err *err) {
  s->caps = SV_TAKE(arena, sv_camera_caps, s->source.n_cameras);
  if (!s->caps) return sv_fail(err, SV_E_NOMEM, "no room for %d cameras", s->source.n_cameras);
  for (int i = 0; i < s->source.n_cameras; i++) {
    sv_status r = s->source.caps(s->source.self, i, &s->caps[i]);
    if (r < 0) return sv_fail(err, r, "camera %d does not tell what it can do: %s", i, sv_status_text(r));
  }
  return SV_OK;
}

static sv_status open_sim(board_source *s, const char *spec, int n_exposures, sv_arena *arena, sv_err *err) {
  sv_sim_config cfg = sv_sim_defaults();
  sv_status r = sv_sim_parse(&cfg, spec, err);
  if (r < 0) return r;
  // Unless told otherwise, the rig's round has one stop for each exposure.
  if (n_exposures > 0 && !strstr(spec, "exposures=")) cfg.n_exposures = n_exposures;
  r = sv_sim_init(&s->u.sim, &cfg, arena, err);
  if (r < 0) return r;
  s->source = sv_sim_source(&s->u.sim);
  s->clock = sv_sim_clock(&s->u.sim);
  s->rig = sv_sim_rig(&s->u.sim);
  double c[3], radius;
  sv_sim_scene_bounds(&s->u.sim, c, &radius);
  s->has_bounds = !cfg.has_unknown_poses; // without poses nobody knows where that is
  s->bounds = (sv_bounds){{(float)c[0], (float)c[1], (float)c[2]}, (float)radius};
  return SV_OK;
}

// sv_file_reader over a folder, by plain reads.
static sv_status read_in_folder(void *self, const char *name, void *buf, size_t cap, size_t *bytes,
                                sv_err *err) {
  const char *dir = self;
  char path[2 * SV_CAPTURE_CAP_PATH];
  if (strchr(name, '/')) return sv_fail(err, SV_E_ARG, "%s: a name with a folder is not allowed here", name);
  sv_fmt(path, sizeof path, "%s/%s", dir, name);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0) return sv_fail(err, SV_E_NOT_FOUND, "%s: the file cannot be opened", path);
  size_t at = 0;
  ssize_t n = 0;
  while (at < cap && (n = read(fd, (char *)buf + at, cap - at)) > 0) at += (size_t)n;
  close(fd);
  if (n < 0) return sv_fail(err, SV_E_IO, "%s: reading failed", path);
  if (at == cap)
    return sv_fail(err, SV_E_NOMEM, "%s: larger than the %zu bytes expected of it", path, cap - 1);
  *bytes = at;
  return SV_OK;
}

static sv_status read_rig(board_source *s, sv_arena *arena, sv_err *err) {
  sv_status r = sv_rig_init(&s->rig_read, SV_CAP_SUB_VIEWS, arena);
  if (r < 0) return sv_fail(err, r, "no room for a rig");
  sv_arena scratch = sv_arena_sub(arena, 1 << 20);
  sv_file_reader files = {s->rig_dir, read_in_folder};
  sv_coverage_names *names = SV_TAKE(&scratch, sv_coverage_names, 1);
  if (!names) return sv_fail(err, SV_E_NOMEM, "no room for a rig");
  memset(names, 0, sizeof *names);
  r = sv_rig_read_coverage(&s->rig_read, names, &files, "rig.json", s->source.n_cameras, &scratch, err);
  s->rig = &s->rig_read;
  return r < 0 ? r : coverage_read(&s->rig_read, names, &files, s->rig_dir, arena, err);
}

static sv_status open_replay(board_source *s, const char *spec, sv_arena *arena, sv_err *err) {
  sv_replay_cfg cfg;
  sv_status r = sv_replay_parse(spec, &cfg, err);
  if (r < 0) return r;
  r = sv_replay_init(&s->u.replay, &cfg, arena, err);
  if (r < 0) return r;
  const sv_capture *c = &s->u.replay.capture;
  s->source = sv_replay_source(&s->u.replay);
  s->clock = sv_replay_clock(&s->u.replay);
  if (c->has_scene) {
    double d2 = 0;
    s->has_bounds = true;
    for (int i = 0; i < 3; i++) {
      double e = 0.5 * (c->scene_max_m[i] - c->scene_min_m[i]);
      s->bounds.centre[i] = (float)(0.5 * (c->scene_max_m[i] + c->scene_min_m[i]));
      d2 += e * e;
    }
    s->bounds.radius = (float)sqrt(d2);
  }
  if (c->rig[0]) sv_fmt(s->rig_dir, sizeof s->rig_dir, "%s/%s", cfg.dir, c->rig);
  return SV_OK;
}

sv_status source_open(board_source *s, const char *spec, const char *rig_path, int n_exposures,
                      sv_arena *arena, sv_err *err) {
  sv_status r;
  memset(s, 0, sizeof *s);
  sv_arena_part_begin(arena, "source");
  if (!strncmp(spec, "sim:", 4)) {
    s->kind = SOURCE_SIM;
    r = open_sim(s, spec + 4, n_exposures, arena, err);
  } else if (!strncmp(spec, "replay:", 7)) {
    s->kind = SOURCE_REPLAY;
    r = open_replay(s, spec + 7, arena, err);
  } else return sv_fail(err, SV_E_ARG, "source \"%s\": expected sim:SCENE[,...] or replay:DIR", spec);
  if (r >= 0) r = read_caps(s, arena, err);
  if (r < 0) return r;
  sv_arena_part_begin(arena, "rig");
  if (rig_path) sv_copy(s->rig_dir, sizeof s->rig_dir, rig_path);
  if (s->rig_dir[0]) return read_rig(s, arena, err);
  if (!s->rig)
    return sv_fail(
        err, SV_E_NOT_FOUND,
        "source \"%s\" brings no rig; give its folder with --rig (rig.json and .cameramodel files)", spec);
  return SV_OK;
}

void source_close(board_source *s) {
  if (s->kind == SOURCE_REPLAY) sv_replay_close(&s->u.replay);
}
