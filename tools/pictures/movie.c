// SPDX-License-Identifier: Apache-2.0
// Images frame_0000.png ... of a folder -> movie.mp4 and a contact sheet sheet.png, and frames from
// memory -> one video, by ffmpeg where it is installed.
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <spawn.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "src/base/str.h"
#include "tools/pictures/movie.h"

#define EVEN_SIDES "pad=ceil(iw/2)*2:ceil(ih/2)*2" // which H.264 wants

extern char **environ;

static int run(const char *const *argv) {
  pid_t pid;
  int status;
  if (posix_spawnp(&pid, argv[0], NULL, NULL, (char *const *)(uintptr_t)argv, environ) != 0) return -1;
  while (waitpid(pid, &status, 0) < 0) continue;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

sv_status lab_movie_make(lab_session *se, const char *folder, int n_frames, double fps, sv_err *err) {
  char in[SV_CAP_PATH], movie[SV_CAP_PATH], sheet[SV_CAP_PATH], rate[32], count[16], tile[120];
  int side = (int)ceil(sqrt((double)n_frames));
  sv_status s = sv_path_join(in, sizeof in, folder, "frame_%04d.png", err);
  if (s == SV_OK) s = sv_path_join(movie, sizeof movie, folder, "movie.mp4", err);
  if (s == SV_OK) s = sv_path_join(sheet, sizeof sheet, folder, "sheet.png", err);
  if (s != SV_OK) return s;
  snprintf(rate, sizeof rate, "%g", fps);
  // The folder may hold more frames, of an earlier film.
  snprintf(count, sizeof count, "%d", n_frames);
  snprintf(tile, sizeof tile, "trim=end_frame=%d,tile=%dx%d", n_frames, side, (n_frames + side - 1) / side);
  const char *const make_movie[] = {"ffmpeg",    "-v",  "error", "-y",       "-framerate", rate,
                                    "-i",        in,    "-vf",   EVEN_SIDES, "-pix_fmt",   "yuv420p",
                                    "-frames:v", count, movie,   NULL};
  const char *const make_sheet[] = {"ffmpeg", "-v", "error",     "-y", "-i",  in,
                                    "-vf",    tile, "-frames:v", "1",  sheet, NULL};
  int code = run(make_movie);
  if (code < 0 || code == 127) {
    lab_say(se, "ffmpeg not found; no video written");
    return SV_OK;
  }
  if (code != 0 || run(make_sheet) != 0) return sv_fail(err, SV_E_DEVICE, "%s: ffmpeg failed", movie);
  lab_say(se, "%s, %s", movie, sheet);
  return SV_OK;
}

// --- from memory ---------------------------------------------------------------------------------

static int start(const char *const *argv, int input, long *pid) {
  posix_spawn_file_actions_t todo;
  pid_t child = 0;
  if (posix_spawn_file_actions_init(&todo) != 0) return ENOMEM;
  int e = posix_spawn_file_actions_adddup2(&todo, input, 0);
  if (e == 0) e = posix_spawnp(&child, argv[0], &todo, NULL, (char *const *)(uintptr_t)argv, environ);
  posix_spawn_file_actions_destroy(&todo);
  *pid = child;
  return e;
}

static int wait_for(lab_video *v) {
  int status = 0;
  close(v->pipe);
  while (waitpid((pid_t)v->pid, &status, 0) < 0 && errno == EINTR) continue;
  v->pid = 0;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

sv_status lab_video_begin(lab_video *v, const char *path, const int size_px[2], double fps, sv_err *err) {
  char size[32], rate[32];
  int ends[2];
  *v = (lab_video){.frame_bytes = 3 * (size_t)size_px[0] * (size_t)size_px[1]};
  if (!sv_copy(v->path, sizeof v->path, path)) return sv_fail(err, SV_E_RANGE, "%.80s: too long", path);
  snprintf(size, sizeof size, "%dx%d", size_px[0], size_px[1]);
  snprintf(rate, sizeof rate, "%g", fps);
  const bool is_webm = sv_str_eq(sv_path_extension(path), ".webm");
  const char *codec = is_webm ? "libvpx-vp9" : "libx264", *crf = is_webm ? "24" : "18";
  const char *option = is_webm ? "-b:v" : "-movflags", *value = is_webm ? "0" : "+faststart";
  const char *const argv[] = {"ffmpeg",   "-v",     "error",    "-y",       "-f",   "rawvideo",
                              "-pix_fmt", "rgb24",  "-s",       size,       "-r",   rate,
                              "-i",       "pipe:0", "-vf",      EVEN_SIDES, "-c:v", codec,
                              "-crf",     crf,      "-pix_fmt", "yuv420p",  "-f",   is_webm ? "webm" : "mp4",
                              option,     value,    v->path,    NULL};
  if (pipe2(ends, O_CLOEXEC) != 0) return sv_fail(err, SV_E_DEVICE, "%s: no pipe to ffmpeg", path);
  v->pipe = ends[1];
  const int e = start(argv, ends[0], &v->pid);
  close(ends[0]);
  if (e == 0) return SV_OK;
  close(v->pipe);
  v->pid = 0;
  return sv_fail(err, SV_E_NOT_FOUND, "%s: needs ffmpeg, which was not found; a name.webp does not", path);
}

sv_status lab_video_add(lab_video *v, const uint8_t *rgb, sv_err *err) {
  for (size_t at = 0; at < v->frame_bytes;) {
    const ssize_t n = write(v->pipe, rgb + at, v->frame_bytes - at);
    if (n > 0) at += (size_t)n;
    else if (errno != EINTR) return sv_fail(err, SV_E_DEVICE, "%s: ffmpeg has ended", v->path);
  }
  return SV_OK;
}

sv_status lab_video_end(lab_video *v, sv_err *err) {
  if (wait_for(v) == 0) return SV_OK;
  unlink(v->path);
  return sv_fail(err, SV_E_DEVICE, "%s: ffmpeg failed", v->path);
}

void lab_video_abandon(lab_video *v) {
  if (!v->pid) return;
  wait_for(v);
  unlink(v->path);
}
