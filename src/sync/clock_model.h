// SPDX-License-Identifier: Apache-2.0
// Clock model of one camera: host = camera + offset + drift * (camera - reference).
// Owns the points that the line is fitted to.
// Never reads a clock: the caller brings pairs of (camera_ns, arrival_ns).
//
// arrival - camera is the offset plus a transport delay that is never negative. So the line lies
// below all points and touches the fastest deliveries: it is the edge of the lower convex hull over
// the mean camera time, which is the line below all points with the smallest sum of distances (S.
// Moon, P. Skelly, D. Towsley, "Estimation and removal of clock skew from network delay
// measurements", INFOCOM 1999; L. Zhang, Z. Liu, C. Xia, "Clock synchronization algorithms for
// network measurements", INFOCOM 2002). The shortest delay itself cannot be measured from one side;
// it stays in the offset, less transport_ns. Cameras of one kind share it, and it cancels between
// them.
#ifndef SV_SYNC_CLOCK_MODEL_H
#define SV_SYNC_CLOCK_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/time.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CLOCK_BLOCK_FRAMES 16 // the fastest delivery of so many frames is one point
#define SV_CLOCK_CAP_BLOCKS   32 // 17 s at 30 fps
// so many slow deliveries in a row are no delays: the camera's clock went back
#define SV_CLOCK_RAISED_PAIRS 8

typedef struct {
  double x_s;  // camera time since the reference
  double d_ns; // arrival - camera, since the first one
} sv_clock_point;

typedef struct {
  bool is_common;      // the stamps are host time already: the identity
  sv_ns step_limit_ns; // a larger jump of arrival - camera is a step of the clock, not a delay
  double max_drift;    // |drift| is held to this; 1e-3 is 1000 ppm
  sv_ns transport_ns;  // known shortest delay between stamp and arrival

  bool is_started, is_estimating;
  sv_ns ref_camera_ns, ref_offset_ns; // the first pair since the last step
  sv_ns last_offset_ns;               // arrival - camera of the newest pair
  double last_x_s;                    // and its camera time
  uint64_t n_pairs;                   // since the last step
  int n_blocks, n_in_block;           // the last block is being filled
  sv_clock_point blocks[SV_CLOCK_CAP_BLOCKS];
  int n_raised;            // deliveries in a row that lie far above the line
  double raised_ns;        // smallest distance among those
  double mean_residual_ns; // running mean of the distances: what is usual
  double prior_drift;      // from before the last step; good until a slope of one's own is known
  bool has_prior;
  double offset_ns, drift; // relative to ref_offset_ns; drift is dimensionless
} sv_clock_model;

void sv_clock_model_init(sv_clock_model *m, bool is_common, sv_ns step_limit_ns, double max_drift,
                         sv_ns transport_ns);

// Learns from one pair, in order of camera time. most_set_ns: by how much the camera's clock can
// have been set since the last pair, as the spacing of its stamps tells; INT64_MAX: not known.
// Returns true when the clock has stepped (*step_ns: by how much the camera's clock jumped); the
// model then starts anew from this pair, but keeps the drift, which setting a clock does not
// change. Steps beyond the limit, and forward ones beyond 1/200 of it, are seen at once; backward
// ones beyond 1/200 of it after SV_CLOCK_RAISED_PAIRS pairs, unless delays usually vary by as much.
// The line goes along with smaller steps forward; smaller ones backward count when the old pairs
// are forgotten. A model that is common and finds stamps further than the limit from host time
// estimates until they agree again. A first pair that is late by more than the limit is taken for a
// delay. A delivery that is faster than all before while the clock cannot have been set starts the
// model anew without a step: what came before was held up on its way.
bool sv_clock_model_add(sv_clock_model *m, sv_ns camera_ns, sv_ns arrival_ns, sv_ns most_set_ns,
                        sv_ns *step_ns);

// Starts anew from this pair: the caller knows by other signs that the clock was set.
void sv_clock_model_restart(sv_clock_model *m, sv_ns camera_ns, sv_ns arrival_ns);

// Host time of a camera time, by what is known now. Increases with camera_ns.
sv_ns sv_clock_model_host_ns(const sv_clock_model *m, sv_ns camera_ns);

#ifdef __cplusplus
}
#endif
#endif
