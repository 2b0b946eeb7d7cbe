// SPDX-License-Identifier: Apache-2.0
// Writes a capture folder (format: capture.h) while the cameras run. After each frame its picture
// and its line in a sidecar (frames.N.part) are in the folder; capture.json is written from the
// sidecars every so many frames and at close, each time whole or not at all. After a kill
// sv_capture_load folds the sidecars in, so every frame that was added is there.
// Pictures are synced at close (and by recovery), not at each save: that would hold up the frames
// that come meanwhile, as long as the disk takes for what all programs wrote to it. So a power cut
// while the cameras run may leave the names of pictures whose data, of the last half minute or so,
// never reached the disk; replay delivers them as errors. Whoever writes holds a lock (flock) on
// the folder; a second writer is refused.
#ifndef SV_PLATFORM_REPLAY_CAPTURE_WRITER_H
#define SV_PLATFORM_REPLAY_CAPTURE_WRITER_H

#include "platform/codec/codec.h"
#include "platform/linux/linux.h"
#include "platform/replay/capture.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const char *dir;  // made when missing; an older capture in it is replaced
  const char *name; // "" for none
  const char *rig;  // folder of the rig relative to dir, or NULL
  int n_cameras;    // 1..SV_CAP_SUB_VIEWS
  // [n_cameras]; the names become folders (letters, digits, - _ . are kept; camera.N where one is
  // taken)
  const sv_camera_caps *caps;
  const double *scene_m; // NULL, or the scene's bounds: min x,y,z, max x,y,z
  int quality;           // of the JPEGs, 1..100; 0: 95
  bool is_chroma_halved; // 4:2:0 instead of 4:4:4: smaller, softer colours
  int save_period;       // frames between two saves of capture.json; 0: 100
} sv_capture_writer_cfg;

typedef struct {
  int fd; // -1: not open
  int64_t n_bytes;
  bool is_torn; // a failed write has left a part of a line behind them
} sv_capture_sidecar;

typedef struct {
  sv_capture_sidecar list;
  int dir_fd; // -1: not open
  uint64_t n_frames;
  char folder[48];
} sv_capture_writer_camera;

typedef struct {
  sv_capture_writer_cfg cfg; // caps, name, rig and dir are copied below
  sv_linux_store store;
  sv_codec codec;
  sv_capture_writer_camera *cameras; // [n_cameras]
  sv_camera_caps *caps;              // [n_cameras]
  uint8_t *encoded;                  // [cap_encoded]
  size_t cap_encoded;
  uint8_t *copy; // [cap_copy] between sidecar and capture.json
  size_t cap_copy;
  sv_capture_sidecar poses;
  // What became of the last capture.json, of open or of an added frame that made it due; a failure
  // costs nothing, as the sidecars have it all. The caller may tell it and set `saved` to OK.
  sv_status saved;
  sv_err save_err;
  uint64_t n_poses, n_frames, n_unsaved;
  bool is_open, is_finished;
  char name[48], rig[256];
  double scene_m[6];
} sv_capture_writer;

size_t sv_capture_writer_bytes(const sv_capture_writer_cfg *cfg); // 0 when cfg is out of range
sv_status sv_capture_writer_open(sv_capture_writer *w, const sv_capture_writer_cfg *cfg, sv_arena *arena,
                                 sv_err *err) SV_MUST_USE;
// RGB8 and GREY8 are encoded as JPEG, RGB16 as PNG without loss; JPEG and PNG frames are written as
// they are. A frame with is_error is left out (DROPPED): its gap in the sequence stays visible.
sv_status sv_capture_writer_add(sv_capture_writer *w, const sv_frame *frame, sv_err *err) SV_MUST_USE;
// Poses in order of time.
sv_status sv_capture_writer_add_pose(sv_capture_writer *w, sv_ns time_ns, const sv_pose *rig_from_world,
                                     sv_err *err) SV_MUST_USE;
// capture.json, now; the pictures are not synced.
sv_status sv_capture_writer_save(sv_capture_writer *w, sv_err *err) SV_MUST_USE;
// Syncs the pictures and saves; may be tried again.
sv_status sv_capture_writer_finish(sv_capture_writer *w, sv_err *err) SV_MUST_USE;
// The same, then removes the sidecars and gives everything back, also when it fails; the
// sidecars then stay, and the next reader folds them in.
sv_status sv_capture_writer_close(sv_capture_writer *w, sv_err *err) SV_MUST_USE;

// Whether the folder holds a capture of which frames are listed or waiting in a sidecar.
bool sv_capture_has_frames(const char *dir);

// Folds the sidecars of a killed writer into capture.json and removes them. OK also when there are
// none, when the writer still lives and when the folder cannot be written: capture.json then is
// what was saved last.
sv_status sv_capture_recover(const char *dir, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
