// SPDX-License-Identifier: Apache-2.0
#include "boards/calibrate.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/fs.h>
#include <linux/memfd.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "src/port/calibration.h"

#define EVERY_S    "0.3" // between exposures: time to move the board
#define CAP_IMAGES "60"  // exposures
#define MEMORY_MIB "512" // of the calibration; its peak on the simulator is 120 MiB
#define LOOK_NS    (50 * SV_NS_PER_MS)
#define END_NS     (5 * SV_NS_PER_S) // for a process that was asked to end

static struct {
  char work[SV_LINUX_CAP_PATH], capture[SV_LINUX_CAP_PATH + 16], rig[SV_LINUX_CAP_PATH + 16];
  char installed[SV_LINUX_CAP_PATH], program[SV_LINUX_CAP_PATH], self[SV_LINUX_CAP_PATH];
  sv_calibration_block *block;
  int fd;
  pid_t capture_pid, live_pid; // 0: not running
  int live_code;
  uint32_t seen;
  sv_feed_calibration now;
  sv_feed_tiles tiles;
} cal;

static sv_ns now_ns(void) {
  sv_clock c = sv_linux_clock();
  return c.now_ns(c.self);
}

static void rest(void) {
  sv_clock c = sv_linux_clock();
  c.sleep_until_ns(c.self, c.now_ns(c.self) + LOOK_NS);
}

// --- what the page sees --------------------------------------------------------------------------

static void show(const run_options *o, sv_feed *feed) {
  sv_feed_state *s = sv_feed_begin(feed, SV_FEED_STATE);
  memset(s, 0, sizeof *s);
  s->status = SV_FEED_STATUS_CALIBRATING;
  s->is_session = true;
  s->temperature_c = NAN;
  s->is_throttled = -1;
  s->train_duty = 1;
  sv_copy(s->board, sizeof s->board, BOARD_NAME);
  sv_copy(s->source, sizeof s->source, o->source);
  s->n_cameras = cal.now.n_cameras;
  for (int i = 0; i < cal.now.n_cameras && i < SV_CALIBRATION_CAP_CAMERAS; i++) {
    const sv_calibration_camera *q = &cal.now.camera[i];
    sv_copy(s->cameras[i].name, sizeof s->cameras[i].name, q->name);
    s->cameras[i].width_px = q->width_px;
    s->cameras[i].height_px = q->height_px;
    s->cameras[i].captured = s->cameras[i].delivered = (uint64_t)cal.now.n_exposures;
    if (i < SV_FEED_CAP_TILES) s->cameras[i].n_tiles = cal.tiles.tile[i].n;
  }
  sv_feed_commit(feed, SV_FEED_STATE, sizeof *s);
  memcpy(sv_feed_begin(feed, SV_FEED_CALIBRATION), &cal.now, sizeof cal.now);
  sv_feed_commit(feed, SV_FEED_CALIBRATION, sizeof cal.now);
  memcpy(sv_feed_begin(feed, SV_FEED_TILES), &cal.tiles, sizeof cal.tiles);
  sv_feed_commit(feed, SV_FEED_TILES, sizeof cal.tiles);
}

// --- processes -----------------------------------------------------------------------------------

// True when it is no longer there. code: of its exit, -1 after a signal.
static bool has_ended(pid_t *pid, int *code) {
  int status;
  if (*pid <= 0) return true;
  if (waitpid(*pid, &status, WNOHANG) != *pid) return false;
  *pid = 0;
  *code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return true;
}

static void end(pid_t *pid, sv_heartbeats *beats) {
  int code;
  if (*pid > 0) kill(*pid, SIGINT);
  for (const sv_ns until = now_ns() + END_NS; !has_ended(pid, &code); rest()) {
    sv_beat(beats, SV_BEAT_MAIN);
    if (now_ns() > until) kill(*pid, SIGKILL);
  }
}

static sv_status find_programs(sv_err *err) {
  ssize_t n = readlink("/proc/self/exe", cal.self, sizeof cal.self - 32);
  if (n <= 0) return sv_fail(err, SV_E_NOT_FOUND, "this program was not found");
  cal.self[n] = 0;
  sv_copy(cal.program, sizeof cal.program, cal.self);
  char *slash = strrchr(cal.program, '/');
  if (!slash) return sv_fail(err, SV_E_NOT_FOUND, "%s: no folder of this program", cal.program);
  sv_copy(slash + 1, sizeof cal.program - (size_t)(slash + 1 - cal.program), "subview-calibrate");
  if (access(cal.program, X_OK) == 0) return SV_OK;
  return sv_fail(err, SV_E_NOT_FOUND, "%s cannot be started (%s): install the package subview-calibrate",
                 cal.program, sv_linux_reason(errno));
}

static sv_status start_capture(const run_options *o, sv_err *err) {
  char *argv[16] = {cal.self,  "capture",   "--source",    (char *)(uintptr_t)o->source,
                    "--every", EVERY_S,     "--exposures", CAP_IMAGES,
                    "--out",   cal.capture, "--quiet"};
  int n = 11;
  if (o->sync) {
    argv[n++] = "--sync";
    argv[n++] = (char *)(uintptr_t)o->sync;
  }
  cal.capture_pid = sv_linux_spawn(argv, false);
  return cal.capture_pid ? SV_OK : sv_fail(err, SV_E_DEVICE, "%s: cannot be started", cal.self);
}

static sv_status start_live(const run_options *o, sv_err *err) {
  char board[16], spacing[24], fd[16];
  const preview_calibration b = preview_board();
  sv_fmt(board, sizeof board, "%dx%d", b.n_cols, b.n_rows);
  sv_fmt(spacing, sizeof spacing, "%g", b.spacing_m);
  sv_fmt(fd, sizeof fd, "%d", cal.fd);
  char *argv[20] = {cal.program, "live",      "--capture", cal.capture, "--board",
                    board,       "--spacing", spacing,     "--memory",  MEMORY_MIB,
                    "--feed-fd", fd,          "--out",     cal.rig,     "--quiet"};
  int n = 15;
  if (o->rig) {
    argv[n++] = "--rig";
    argv[n++] = (char *)(uintptr_t)o->rig;
  }
  if (b.is_fisheye) {
    argv[n++] = "--model";
    argv[n++] = "LENSMODEL_SPLINED_STEREOGRAPHIC";
  }
  cal.live_pid = sv_linux_spawn(argv, false);
  return cal.live_pid ? SV_OK : sv_fail(err, SV_E_DEVICE, "%s: cannot be started", cal.program);
}

// --- folders -------------------------------------------------------------------------------------

static sv_status make_work(const char *folder, sv_err *err) {
  if (strlen(folder) + 32 > sizeof cal.work) return sv_fail(err, SV_E_RANGE, "%s: too long a path", folder);
  for (int i = 1;; i++) {
    sv_fmt(cal.work, sizeof cal.work, "%s-calibration/%04d", folder, i);
    if (access(cal.work, F_OK) != 0) break;
  }
  sv_fmt(cal.capture, sizeof cal.capture, "%s/capture", cal.work);
  sv_fmt(cal.rig, sizeof cal.rig, "%s/rig", cal.work);
  return sv_linux_make_dir(cal.work, err);
}

static void name_installed(const run_options *o, const char *folder) {
  if (o->rig) sv_copy(cal.installed, sizeof cal.installed, o->rig);
  else sv_fmt(cal.installed, sizeof cal.installed, "%s-rig", folder);
}

// In one step; the earlier rig is then where the new one was.
static sv_status install(sv_err *err) {
  const bool has_earlier = access(cal.installed, F_OK) == 0;
  const long done = has_earlier ? syscall(SYS_renameat2, AT_FDCWD, cal.rig, AT_FDCWD, cal.installed,
                                          (unsigned)RENAME_EXCHANGE)
                                : rename(cal.rig, cal.installed);
  if (done == 0) return SV_OK;
  return sv_fail(err, SV_E_IO, "the rig cannot be installed as %s (%s); it is in %s", cal.installed,
                 sv_linux_reason(errno), cal.rig);
}

void calibrate_use_rig(run_options *o, const char *folder) {
  char path[SV_LINUX_CAP_PATH + 16];
  if (o->rig || !folder || !o->is_session || strlen(folder) + 8 > sizeof cal.installed) return;
  name_installed(o, folder);
  sv_fmt(path, sizeof path, "%s/rig.json", cal.installed);
  if (access(path, F_OK) != 0) return;
  o->rig = cal.installed;
  say(2, "subview: the rig is %s, as it was calibrated from the page\n", cal.installed);
}

// --- from start to end ---------------------------------------------------------------------------

static sv_status open_block(sv_err *err) {
  // Stays open in the other program
  cal.fd = (int)syscall(SYS_memfd_create, "subview-calibration", 0u);
  if (cal.fd < 0 || ftruncate(cal.fd, (off_t)sizeof *cal.block) < 0)
    return sv_fail(err, SV_E_NOMEM, "no shared memory for the calibration (%s)", sv_linux_reason(errno));
  void *block = mmap(NULL, sizeof *cal.block, PROT_READ | PROT_WRITE, MAP_SHARED, cal.fd, 0);
  if (block == MAP_FAILED)
    return sv_fail(err, SV_E_NOMEM, "no memory for the calibration (%s)", sv_linux_reason(errno));
  cal.block = block;
  return SV_OK;
}

static void close_block(void) {
  if (cal.block) munmap(cal.block, sizeof *cal.block);
  if (cal.fd >= 0) close(cal.fd);
  cal.block = NULL;
  cal.fd = -1;
}

static sv_status watch(const run_options *o, const calibrate_cfg *cfg, sv_publish *page, sv_err *err) {
  int capture_code = 0;
  for (;; rest()) {
    sv_beat(cfg->beats, SV_BEAT_MAIN);
    const bool is_over = has_ended(&cal.live_pid, &cal.live_code);
    const sv_command c = page->command(page->self);
    if (c == SV_COMMAND_NEW || cfg->console.is_stop_requested(cfg->console.self))
      return sv_fail(err, SV_E_INTERRUPTED, "the calibration was stopped; the rig is as before");
    if (c == SV_COMMAND_START || has_ended(&cal.capture_pid, &capture_code))
      atomic_store(&cal.block->is_enough, 1);
    if (sv_calibration_read(cal.block, &cal.seen, &cal.now, &cal.tiles)) show(o, page->feed);
    if (cal.now.phase >= SV_CALIBRATION_SOLVING && cal.capture_pid > 0) kill(cal.capture_pid, SIGINT);
    if (is_over) break;
  }
  if (cal.live_code == 0) return SV_OK;
  cal.now.sentence[sizeof cal.now.sentence - 1] = 0;
  if (cal.now.sentence[0]) return sv_fail(err, SV_E_DEVICE, "%s", cal.now.sentence);
  if (capture_code) return sv_fail(err, SV_E_DEVICE, "the cameras could not be recorded: see the log");
  return sv_fail(err, SV_E_DEVICE, "the calibration ended early: more than %s MiB of memory?", MEMORY_MIB);
}

sv_status calibrate_rig(run_options *o, const calibrate_cfg *cfg, sv_err *err) {
  sv_publish page = {0};
  preview_publish(&page);
  cal.now = (sv_feed_calibration){.phase = SV_CALIBRATION_LOOKING};
  cal.fd = -1;
  cal.seen = 0;
  memset(&cal.tiles, 0, sizeof cal.tiles);
  show(o, page.feed);
  sv_status s = find_programs(err);
  if (s >= 0) s = make_work(cfg->folder, err);
  if (s >= 0) s = open_block(err);
  if (s >= 0) s = start_capture(o, err);
  if (s >= 0) s = start_live(o, err);
  if (s >= 0) s = watch(o, cfg, &page, err);
  end(&cal.capture_pid, cfg->beats);
  end(&cal.live_pid, cfg->beats);
  close_block();
  name_installed(o, cfg->folder);
  if (s >= 0) s = install(err);
  if (s >= 0) {
    o->rig = cal.installed;
    sv_fmt(cal.now.sentence, sizeof cal.now.sentence, "installed as %s", cal.installed);
    say(2, "subview: the rig was calibrated and %s\n", cal.now.sentence);
  } else sv_copy(cal.now.sentence, sizeof cal.now.sentence, err->text);
  cal.now.phase = s >= 0 ? SV_CALIBRATION_DONE : SV_CALIBRATION_FAILED;
  show(o, page.feed);
  return s;
}
