// SPDX-License-Identifier: Apache-2.0
// A capture folder: frames of synchronized cameras as files. It replays as a live source
// (replay.h); `subview capture` writes it (capture_writer.h).
//
//   DIR/capture.json
//   DIR/<folder of a camera>/<file of a frame>      JPEG or PNG
//
// capture.json (UTF-8; unknown keys are skipped; names must not hold escapes, ".." or a leading
// "/"):
//   {
//     "version": 1,
//     "name": "kitchen",                          optional
//     "rig": "rig",                               optional: folder of the rig, relative to DIR
//     "scene": {"min_m": [x,y,z], "max_m": [x,y,z]},   optional: bounds of the scene in the world
//     "cameras": [
//       {"name": "cam0", "folder": "cam0", "width": 640, "height": 480, "fps": 30,
//        "sensor": [4056, 3040],          optional: all of the sensor's pixels,
//        "area": [x, y, w, h],                and what the frames show of them
//        "bits": 8 | 16,                  default 8; 16: PNG files, played back as RGB16
//        "clock": "camera" | "monotonic" | "boottime" | "realtime",     default "monotonic"
//        "stamp": "start" | "middle" | "end",                           default "start"
//        "depth": "left_depth",           optional: folder of depth along the axis in meters, 0
//                                             where it is not known: 000000.pfm of 000000.jpg
//        "light": "free" | "told" | "locked" | "shared",                default "free"
//        "frames": [
//          {"file": "000000.jpg", "sequence": 0, "camera_ns": 100, "arrival_ns": 200,
//           "exposure_ns": 0}, ...
//        ]}, ...
//     ],
//     "poses": [                                  optional
//       {"time_ns": 100, "rig_from_world": [qw,qx,qy,qz, tx,ty,tz]}, ...
//     ]
//   }
// light: of exposure time, gain and white balance, while the frames came. told: nothing but the
// exposure time changed, and frames tell it; locked: nothing changed; shared: and all cameras of
// which this is said had the same values.
// arrival_ns never decreases. Defaults: sequence is the index in the list, arrival_ns is camera_ns,
// exposure_ns is 0. Poses are in rising order of time_ns (host time, as arrival_ns). Times are
// whole nanoseconds. x_rig = R(q) x_world + t, metres.
#ifndef SV_PLATFORM_REPLAY_CAPTURE_H
#define SV_PLATFORM_REPLAY_CAPTURE_H

#include "src/base/arena.h"
#include "src/port/port.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAPTURE_CAP_PATH 512

typedef struct {
  const char *file; // within the camera's folder, terminated
  uint32_t sequence;
  sv_ns camera_ns, arrival_ns, exposure_ns;
} sv_capture_frame;

typedef struct {
  sv_camera_caps caps; // name, size, fps, clock, stamp; format RGB8 or RGB16
  const char *folder;
  const char *depth;        // folder of depth images; NULL: none
  sv_capture_frame *frames; // [n_frames]
  int n_frames;
} sv_capture_camera;

typedef struct {
  sv_ns time_ns;
  double q_wxyz[4], t_m[3]; // rig_from_world
} sv_capture_pose;

typedef struct {
  const char *name, *rig; // "" when absent
  bool has_scene;
  double scene_min_m[3], scene_max_m[3];
  sv_capture_camera *cameras; // [n_cameras]
  int n_cameras;
  int n_frames;           // of all cameras
  sv_capture_pose *poses; // [n_poses]
  int n_poses;
  double scale_sigma; // of the poses, relative (src/base/unit.h); 0: not known
} sv_capture;

// Reads DIR/capture.json, or, without one, DIR as a folder of pictures (sv_capture_of_pictures),
// into the arena (text and lists; the parser's tokens are given back). If a
// writer was killed before it closed, its sidecars are first folded into capture.json, if the
// folder can be written; of a capture that is being written, what was saved last is read.
// Centre and radius in m of the ball that holds the scene of a capture that has one.
void sv_capture_scene(const sv_capture *c, double centre[3], double *radius);
sv_status sv_capture_load(sv_capture *c, const char *dir, sv_arena *arena, sv_err *err) SV_MUST_USE;

// Pictures without capture.json: each folder of DIR with JPEG or PNG files is a camera, in the
// order of names. The first picture of each camera is the first exposure, and so on, at ten frames
// a second. A folder with rig.json is the rig. Pictures in DIR itself: one camera.
sv_status sv_capture_of_pictures(sv_capture *c, const char *dir, sv_arena *arena, sv_err *err) SV_MUST_USE;

// The same from a text in memory. `text` [bytes] is written to (names are terminated in place) and
// must live as long as the capture. `where` names it in sentences.
sv_status sv_capture_parse(sv_capture *c, char *text, size_t bytes, const char *where, sv_arena *arena,
                           sv_err *err) SV_MUST_USE;

// The poses of the capture are replaced by those of a file {"version": 1, "poses": [as above, at
// least one]}, which `subview-calibrate pose` writes. Text and list go into the arena.
sv_status sv_capture_load_poses(sv_capture *c, const char *path, sv_arena *arena, sv_err *err) SV_MUST_USE;

// Where the rig was: between poses the rotation is interpolated on the sphere, the position on a
// line; before the first and after the last pose it stands still. E_NOT_FOUND: the capture has no
// poses.
sv_status sv_capture_pose_at(const sv_capture *c, sv_ns host_ns, sv_pose *rig_from_world) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
