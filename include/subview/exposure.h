// SPDX-License-Identifier: Apache-2.0
// How captured images come in: as whole exposures, or frame by frame from a source.
// Owns: the form of a frame, and the interface of a frame source.
// Never: keeps a frame. The pixels are copied (and undistorted) before a call returns.
#ifndef SUBVIEW_EXPOSURE_H
#define SUBVIEW_EXPOSURE_H

#include <stddef.h>
#include <stdint.h>

#include "rig.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

// The image of one camera, in the size and layout of its subview_camera.
typedef struct {
  const uint8_t *data; // first row
  int stride_bytes;    // from one row to the next; 0: rows without padding
  // NV12 only: the plane of Cb, Cr and its stride. NULL: it follows the plane of Y, with the same
  // stride.
  const uint8_t *chroma;
  int chroma_stride_bytes;
} subview_frame;

// One frame of a source, on loan until it goes back with `requeue`.
typedef struct {
  int i_camera;        // which camera of the rig
  uint32_t sequence;   // number of the frame at its sensor; a gap means that frames were lost
  int64_t camera_ns;   // start of exposure on the camera's clock
  int64_t arrival_ns;  // time at which the frame arrived, on the host's clock; never decreases
  int64_t exposure_ns; // shutter time; 0: not known
  subview_frame frame;
  int is_damaged; // the driver delivered it, but says that it is not usable
  int i_buffer;   // the source's own number of it
} subview_source_frame;

// Cameras that run. Each needs about 6 buffers, because frames wait here for those of the other
// cameras.
typedef struct {
  void *self;
  // The next frame of any camera, in order of arrival, without waiting. SUBVIEW_AGAIN: none at the
  // moment. SUBVIEW_END: no more will come. A failure ends the capture call and is returned by it.
  subview_status (*dequeue)(void *self, subview_source_frame *out);
  // Takes a frame back. Each dequeued frame comes back exactly once.
  subview_status (*requeue)(void *self, const subview_source_frame *frame);
  // Where the rig was at a time of the host's clock. NULL: the rig stands still at the origin.
  subview_status (*rig_pose)(void *self, int64_t host_ns, subview_pose *rig_from_world);
} subview_source;

// Every frame is accounted for: captured = delivered + pending + dropped.
typedef struct {
  uint64_t captured;  // frames that the sensors took, lost ones included
  uint64_t delivered; // became part of an exposure
  uint64_t pending;   // wait for frames of other cameras
  uint64_t dropped;   // lost, late, damaged, or without a partner within the skew limit
} subview_ledger;

#ifdef __cplusplus
}
#endif
#endif
