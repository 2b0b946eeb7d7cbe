// SPDX-License-Identifier: Apache-2.0
// Images frame_0000.png ... of a folder -> movie.mp4 and a contact sheet sheet.png, by ffmpeg where
// it is installed.
#include <math.h>
#include <spawn.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tools/pictures/movie.h"

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
  // H.264 wants even sides.
  const char *const make_movie[] = {
      "ffmpeg",   "-v",      "error",     "-y",  "-framerate",
      rate,       "-i",      in,          "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2",
      "-pix_fmt", "yuv420p", "-frames:v", count, movie,
      NULL};
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
