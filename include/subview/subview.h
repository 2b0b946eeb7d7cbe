// SPDX-License-Identifier: Apache-2.0
// Trains Gaussians from the images of synchronized cameras, in one fixed block of memory. C11 and
// C++17.
// Owns: an instance, which lives inside the caller's block together with everything that it uses.
// Never: allocates memory, calls the operating system, prints, or keeps state outside of the block.
//
//   subview_config c = subview_defaults();        cameras, exposures, Gaussians, steps
//   subview_bytes(&c, &bytes, &error);            how large the block has to be
//   subview_init(&s, &c, block, bytes, &error);
//   subview_push_exposure(s, frames, &rig_from_world, &error);      once per exposure
//   subview_start(s, &error);                     the first Gaussians
//   while (subview_step(s, &stats, &error) == SUBVIEW_OK) ...
//   subview_render(s, &view, rgb, 0, &error);     subview_save(s, SUBVIEW_FILE_PLY, sink, &error);
//
// There is no call to end: when the caller reuses the block, the instance is gone. Instances are
// independent. One thread at a time may use an instance. The same input gives the same bits on
// every machine with a fused multiply-add, for any number of threads.
#ifndef SUBVIEW_SUBVIEW_H
#define SUBVIEW_SUBVIEW_H

#include <stddef.h>
#include <stdint.h>

#include "arena.h"
#include "exposure.h"
#include "gaussians.h"
#include "port.h"
#include "rig.h"
#include "status.h"
#include "version.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct subview subview;

// Settings of an instance. Start from subview_defaults().
typedef struct {
  // The rig's cameras, [n_cameras]; subview_init copies them. Required.
  const subview_camera *cameras;
  // Number of cameras of the rig, 1 to 256. Required.
  int n_cameras;
  // Exposures kept, 1 or more; a full instance replaces its oldest one. Default: 1.
  int n_exposures;
  // Gaussians of the model, 1 to 4,000,000; their number is fixed. Default: 20,000.
  int n_gaussians;
  // Degree of the spherical harmonics (view-dependent colour), 0 to 3. Default: 1.
  int sh_degree;
  // Training steps planned, 1 or more; they set the pace. Default: 3,000.
  int n_steps;
  // Seed of all random choices. Default: 1.
  uint64_t seed;
  // Whether `centre` and `radius` are known. Default: 0, they are found from the cameras.
  int has_bounds;
  // A ball around the scene, in metres of the world. Used with has_bounds only.
  float centre[3], radius;
  // Size of the largest view to be rendered, px, if larger than the cameras' own. Default: 0.
  int render_width_px, render_height_px;
  // Longest time between two frames of one exposure in subview_capture, seconds. Default: 0.002.
  double skew_limit_s;
  // Whether each camera stamps by a clock of its own, which subview_capture then estimates.
  // Default: 0, all stamps are on the host's clock.
  int has_own_clocks;
  // Threads. Default: none, everything runs on the caller's thread.
  subview_pool pool;
} subview_config;

// What one step did.
typedef struct {
  uint32_t step;  // steps done, this one included
  double loss;    // of this step's image
  int i_exposure; // of this step's image
  int i_camera;
} subview_step_stats;

const char *subview_version(void); // "0.9.0" of the library, not of the header
subview_config subview_defaults(void);

// Bytes of a block for these settings, whatever its alignment.
subview_status subview_bytes(const subview_config *config, size_t *bytes, subview_error *error);
// Makes an instance inside `block`. The block must stay in place. E_ARG, E_RANGE: a setting;
// E_NOMEM: too small.
subview_status subview_init(subview **out, const subview_config *config, void *block, size_t bytes,
                            subview_error *error);
// Entry i of the memory map; E_RANGE after the last.
subview_status subview_memory_part(const subview *s, int i, subview_part *out);

// Copies one exposure: frames [n_cameras]. rig_from_world is the rig's pose (NULL: identity). A
// full instance replaces its oldest exposure, also after the start, while training goes on.
subview_status subview_push_exposure(subview *s, const subview_frame *frames,
                                     const subview_pose *rig_from_world, subview_error *error);
// Takes the frames that a source has, puts synchronized ones together and pushes these exposures.
// OK: at least one was pushed; AGAIN: none yet; END: the source has ended, and all frames are back.
subview_status subview_capture(subview *s, const subview_source *source, subview_error *error);
subview_ledger subview_capture_ledger(const subview *s);
int subview_n_exposures(const subview *s); // exposures held

// Makes the first Gaussians from the exposures held: on surfaces where views overlap, else along
// pixel rays. E_NOT_FOUND without an exposure. Calling it again starts anew.
subview_status subview_start(subview *s, subview_error *error);
// One training step on one image. END after n_steps. `stats` may be NULL.
subview_status subview_step(subview *s, subview_step_stats *stats, subview_error *error);
// The same at a given progress, 0 to 1, for training by time: elapsed time / time limit. Never END.
subview_status subview_step_at(subview *s, float progress, subview_step_stats *stats, subview_error *error);

// The view of a camera in an exposure held, after undistortion: the size differs from the frame's
// then. Of a fisheye, which is trained on as it is, a pinhole view with its focal length and size.
subview_status subview_view_of(const subview *s, int i_exposure, int i_camera, subview_view *out);
// Renders a view into rgb[height_px][stride_bytes], 3 bytes per pixel. stride_bytes 0: rows without
// padding.
subview_status subview_render(subview *s, const subview_view *view, uint8_t *rgb, int stride_bytes,
                              subview_error *error);
// Mean PSNR over the training images, dB.
subview_status subview_psnr(subview *s, double *psnr_db, subview_error *error);

int subview_n_gaussians(const subview *s);
subview_status subview_get_gaussian(const subview *s, int i, subview_gaussian *out);
subview_status subview_save(subview *s, subview_file file, subview_sink sink, subview_error *error);
// FNV-1a over the bits of all parameters. Equal digests mean equal models.
uint64_t subview_digest(const subview *s);

#ifdef __cplusplus
}
#endif
#endif
