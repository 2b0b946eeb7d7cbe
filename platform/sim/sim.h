// SPDX-License-Identifier: Apache-2.0
// The simulator: a ray-traced scene, a rig that circles it, cameras with their own clocks, and
// faults, on a virtual clock. Owns frame buffers and scratch, carved from one arena at start.
// Never reads a real clock: everything is a function of configuration and virtual time, with the
// same bits on every machine.
//
// Time. Host time is the virtual clock's, in ns; scene time is (host - SV_SIM_EPOCH_NS) in seconds.
// Slot k is the k-th period of the frame rate; its cameras expose at its middle, for an instant
// (shutter_us only moves the arrival, unless blur=on). With the default `step` trajectory the rig
// is stationary within a slot; with `path=smooth` it moves continuously along the same path; with
// `path=handheld` a hand adds up to 7 cm and 1.5 degrees. `poses=unknown` hides its poses.
//
// Space. World z is up, metres. The rig's frame is a camera's (x right, y down, z forward) whose z
// axis meets the world's origin at the scene's distance; every sub-view is aimed at that point.
#ifndef SV_SIM_SIM_H
#define SV_SIM_SIM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "calib/fisheye.h"
#include "platform/sim/optics.h"
#include "platform/sim/trace.h"
#include "src/base/arena.h"
#include "src/base/str.h"
#include "src/image/noise.h"
#include "src/port/port.h"
#include "src/rig/device.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SIM_EPOCH_NS    SV_NS_PER_S // the virtual clock's first reading
#define SV_SIM_DISTANCE_M  4.0         // of the rig from the center of most scenes
#define SV_SIM_CAP_CAMERAS 3
#define SV_SIM_CAP_BUFFERS 16
#define SV_SIM_CAP_FAULTS  8
#define SV_SIM_CAP_PENDING 6
// Azimuth of the middle of shorter arcs: the open side of the scenes with walls.
#define SV_SIM_ARC_MIDDLE_DEG 45.0
#define SV_SIM_N_HELDOUT      8 // held-out views that a run's PSNR is the mean of

// A fault of one camera at one slot. `n` depends on the kind, see faults.inc.
typedef enum {
#define X(id, name, default_n, text) SV_SIM_FAULT_##id,
#include "platform/sim/faults.inc"
#undef X
  SV_SIM_N_FAULTS
} sv_sim_fault_kind;

typedef struct {
  sv_sim_fault_kind kind;
  int i_camera, n;
  int64_t slot;
} sv_sim_fault;

typedef enum {
  SV_SIM_LENS_PINHOLE,
  SV_SIM_LENS_KB4,  // fisheyes
  SV_SIM_LENS_TILES // the same field in two by two pinholes on each sensor
} sv_sim_lens;

typedef struct {
  sv_sim_scene_id scene;
  sv_device_id rig;
  int width_px, height_px;  // of each sensor
  int grid_rows, grid_cols; // of lenses; 1 x 1 for rigs without a grid
  double overlap;           // side of a lens image / pitch
  double fps, angle_deg;    // angle: the rig's angular baseline as seen from the scene's centre
  int n_exposures;          // stops of one round of the trajectory
  int n_frames;             // the source ends after this many slots, 0 = never
  sv_sim_lens lens;         // default: pinholes
  double lens_deg;          // field across the diagonal, of other lenses
  double arc_deg;           // azimuth covered by one round
  bool is_smooth;           // moves continuously, not in steps
  bool is_handheld;         // smooth, and swayed by a hand
  bool is_swaying;          // smooth, without the rise, and swayed at these mean (RMS) speeds
  double turn_deg_s, move_m_s;
  bool has_unknown_poses; // the source does not tell the rig's pose
  uint32_t seed;
  double noise_read, noise_shot;    // variance = read + shot x in linear light; both 0: no noise
  double skew_us;                   // true delay of the last camera behind the first; the others in
                                    // between
  double jitter_us;                 // standard deviation of a camera's timestamps, told in its caps
  double drift_ppm;                 // rate error of camera clocks: +drift, -drift, +drift/2, ...
  double rate_ppm;                  // rate error of the cameras' frames, in the same shares: they
                                    // drift apart
  double offset_ms;                 // camera i's clock is (i + 1) offsets ahead at the epoch
  double delay_us, delay_jitter_us; // from the end of the exposure to the arrival: fixed, and
                                    // uniform on top
  double shutter_us;
  double drop;              // probability that the link loses a frame
  sv_sim_optics_cfg optics; // ideal by default
  bool is_deep;             // frames have 16 bits a value. Default false
  // [SV_SIM_CAP_CAMERAS] green of grey light at the same exposure time, of someone else, filled in
  // before the source starts: by it lock=shared divides exposure times. NULL: all alike.
  const float *response;
  int jpeg_quality; // 1 to 100: frames have lost what JPEG loses; 0: nothing. Default 0
  int n_buffers;
  int n_faults;
  sv_sim_fault faults[SV_SIM_CAP_FAULTS];
} sv_sim_config;

// Per camera, counted when time passes them:
// n_exposed = n_delivered + n_lost + n_starved + n_flushed + frames that wait for dequeue now.
// Second copies (fault dup) count nowhere but in n_duplicates.
typedef struct {
  uint64_t n_exposed;    // frames captured by the sensor
  uint64_t n_delivered;  // handed out by dequeue, first copies
  uint64_t n_duplicates; // second copies handed out
  uint64_t n_lost;       // on the link (drop=)
  uint64_t n_starved;    // no buffer was free: too many on loan or waiting
  uint64_t n_flushed;    // waiting when the source was stopped
} sv_sim_counts;

typedef enum {
  SV_SIM_EVENT_FRAME,
  SV_SIM_EVENT_COPY,
  SV_SIM_EVENT_LOST,
  SV_SIM_EVENT_UNPLUGGED
} sv_sim_event_kind;

typedef struct { // an event that reaches the host at arrival_ns
  sv_sim_event_kind kind;
  int i_camera, i_buffer;
  int64_t slot;
  uint32_t sequence;
  sv_ns true_ns, camera_ns, arrival_ns;
  bool is_damaged;
} sv_sim_event;

typedef struct {
  int64_t next_slot;
  sv_ns shift_ns,
      longer_ns; // by how much the next slot's frame is late, and each later one more
                 // (frame_duration)
  uint32_t next_sequence;
  bool is_ended;
  int n_pending;
  sv_sim_event pending[SV_SIM_CAP_PENDING]; // pending, not in order
  uint32_t is_taken;                        // one bit a buffer: waiting or on loan
  uint32_t on_loan;
  uint8_t *buffers; // [n_buffers][frame_bytes]
  sv_sim_counts counts;
} sv_sim_camera;

typedef struct {
  sv_sim_config cfg;
  sv_ns now_ns, period_ns;
  bool is_running,
      is_triggered; // triggered: all cameras expose at the slot's instant, whatever skew and rate
  int n_cameras;
  size_t frame_bytes;
  sv_rig rig;
  sv_fisheye *fisheye; // [n_sub_views] with SV_SIM_LENS_KB4
  sv_sim_scene *scene;
  sv_sim_shot *shot; // scratch of the source and of sv_sim_render
  sv_noise noise;
  sv_sim_optics optics;
  // of each camera's exposure time, by optics.lock; 1 until the source starts
  double exposure[SV_SIM_CAP_CAMERAS];
  bool is_metered;
  float *sum;          // [height][width][3] linear, for 16 bits or with optics only; else NULL
  int largest_overlap; // lens images that meet in one pixel at most, multiplexed only
  sv_sim_camera cameras[SV_SIM_CAP_CAMERAS];
  sv_sim_event *ready; // [cap_ready] arrived, oldest first
  int n_ready, cap_ready;
} sv_sim;

sv_sim_config sv_sim_defaults(void);
// Reads the part of a source string behind `sim:`, e.g.
// "thin,rig=stereo,fps=15,fault=unplug:1:20+dup". On failure `out` is untouched and the sentence
// lists the alternatives.
sv_status sv_sim_parse(sv_sim_config *out, const char *spec, sv_err *err) SV_MUST_USE;
// Distance of the rig from the scene's center, which all sub-views are aimed at.
double sv_sim_distance_m(const sv_sim_config *cfg);
// One line a scene ("sim:textured  five solids ..."), then the options.
void sv_sim_list(sv_str *out);

// cfg as made by defaults or parse; a value out of range is told in err. init takes
// sv_sim_bytes(cfg).
size_t sv_sim_bytes(const sv_sim_config *cfg);
sv_status sv_sim_init(sv_sim *sim, const sv_sim_config *cfg, sv_arena *arena, sv_err *err) SV_MUST_USE;

// frames: RGB8 sRGB; with depth=16 RGB16 sRGB; multiplexed: RGB16, sRGB-encoded sum of linear light
sv_source sv_sim_source(sv_sim *sim);
sv_clock sv_sim_clock(sv_sim *sim);          // only sleeping and a waiting dequeue advance it
const sv_rig *sv_sim_rig(const sv_sim *sim); // the true rig
const sv_sim_counts *sv_sim_camera_counts(const sv_sim *sim, int i_camera);
// Light of the first camera's frames over that of the scene: brackets start with 1.
float sv_sim_light(const sv_sim *sim);
void sv_sim_scene_bounds(const sv_sim *sim, double centre_m[3], double *radius_m);

sv_ns sv_sim_slot_ns(const sv_sim *sim, int64_t slot);      // host time of mid-exposure of camera 0
double sv_sim_slot_time_s(const sv_sim *sim, int64_t slot); // scene time of mid-exposure
void sv_sim_rig_pose(const sv_sim *sim, sv_ns host_ns, sv_pose *rig_from_world);
// The true view of a sub-view in a slot; view->time runs from 0 to 1 over the round's slots.
void sv_sim_view(const sv_sim *sim, int64_t slot, int i_sub_view, sv_view *view, double *time_s);
// Held-out view i of n: the rig's first sub-view, moved 3 degrees off the rig's place in one of the
// slots, mostly up or down, at that slot's time. Never a training view.
void sv_sim_heldout_view(const sv_sim *sim, int i, int n, sv_view *view, double *time_s);
// Held-out view i about where the rig is at a moment, at that moment.
void sv_sim_heldout_view_at(const sv_sim *sim, int i, sv_ns host_ns, sv_view *view);

// Noise-free image of any view at any time: rgb [height][width][3] sRGB, depth_m [height][width]
// camera z (of a fisheye the distance), 0 = background; either may be NULL. Uses the simulator's
// scratch: one call at a time.
void sv_sim_render(sv_sim *sim, const sv_view *view, double time_s, uint8_t *rgb, float *depth_m);
// The same in two steps for several threads: each prepares its own shot, then renders disjoint
// rows.
void sv_sim_prepare(const sv_sim *sim, sv_sim_shot *shot, const sv_view *view, double time_s);
void sv_sim_render_rows(const sv_sim *sim, const sv_sim_shot *shot, int y0, int y1, uint8_t *rgb,
                        float *depth_m);

// --- between the files of this folder ---
// Whether frames are RGB16.
bool sv_sim_is_deep(const sv_sim_config *cfg);
sv_view sv_sim_sub_view_at(const sv_sim *sim, const sv_sub_view *sv, sv_ns host_ns); // path.c
// jpeg.c: an RGB8 picture as it is after coding and decoding, in its place
void sv_sim_jpeg(uint8_t *rgb, int width_px, int height_px, int quality);
// sensor.c: one sensor frame
void sv_sim_expose(sv_sim *sim, const sv_sim_event *event, uint8_t *out);
// Fills in exposure by optics.lock: the mean of green becomes 18 % of the sensor's range.
void sv_sim_meter(sv_sim *sim);
sv_status sv_sim_check(const sv_sim_config *cfg, sv_err *err); // config.c
sv_device_params sv_sim_device(const sv_sim_config *cfg);      // config.c
// lens.c: sub-views of a rig with these lenses, and what becomes of the device's pinholes
int sv_sim_n_sub_views(const sv_sim_config *cfg);
sv_status sv_sim_set_lenses(sv_sim *sim, sv_err *err);

#ifdef __cplusplus
}
#endif
#endif
