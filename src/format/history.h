// SPDX-License-Identifier: Apache-2.0
// The last seconds of a model that changes as a whole: frames, coded as those of a sequence
// (sequence.h), in a ring of bytes that never grows. Each group of frames begins with a keyframe;
// when a new frame finds no room, the oldest group goes. All Gaussians change, of SH degree 0.
// Owns nothing: ring and frames are the caller's arena's. Never trains, never looks at a clock.
#ifndef SV_FORMAT_HISTORY_H
#define SV_FORMAT_HISTORY_H

#include "src/base/arena.h"
#include "src/base/time.h"
#include "src/format/sequence.h"

#ifdef __cplusplus
extern "C" {
#endif

// Bytes that a Gaussian's frame takes on average, rounded up: the ring has so many times its
// frames. Measured on the simulator's moving scene.
#define SV_HISTORY_GAUSSIAN_BYTES 18

typedef struct {
  int n;          // Gaussians. 0: no history
  int cap_frames; // frames that are kept, at least 2 groups
  sv_ns span_ns;  // A group goes when all of it is older than this. 0: only when room is needed
  float radius;   // of the scene: sets the step of positions (sv_sequence_step). Set before frames
} sv_history_cfg;

typedef struct {
  size_t at, bytes; // in the ring
  sv_ns time_ns;
} sv_history_frame;

typedef struct {
  sv_history_cfg cfg;
  uint8_t *ring; // [cap_bytes]
  size_t cap_bytes;
  sv_history_frame *frame; // [cap_frames], a ring, too
  int i_first, n_frames;
  int in_group; // frames of the newest group, 1 to SV_SEQUENCE_GROUP
  // [SV_SEQUENCE_N_MOVED][n] each: of the newest frame, the one before, and of the next
  int32_t *value[3];
  uint64_t n_added; // ever
  uint64_t n_lost;  // frames that did not fit an empty ring
} sv_history;

// Takes its memory from the arena; nothing with n = 0.
void sv_history_carve(sv_history *h, const sv_history_cfg *cfg, sv_arena *arena);
void sv_history_clear(sv_history *h);
// The model at a moment that is later than all before: get gives a value as sv_sequence_source
// does. FULL: the frame is larger than the ring, and was left out.
sv_status sv_history_add(sv_history *h, sv_ns time_ns, float (*get)(const void *self, uint32_t i, int row),
                         const void *self) SV_MUST_USE;
// The newest frame once more, for a moment from which there is no model: costs almost nothing.
sv_status sv_history_repeat(sv_history *h, sv_ns time_ns) SV_MUST_USE;
// Host time of frame k of h->n_frames, oldest first.
sv_ns sv_history_time_ns(const sv_history *h, int k);
// From the oldest frame to the newest; 0: there are none.
sv_ns sv_history_span_ns(const sv_history *h);
size_t sv_history_used_bytes(const sv_history *h); // of all frames
// Most bytes of a file of sv_history_write, and of its state, to be aligned to 8.
size_t sv_history_cap_file_bytes(const sv_history_cfg *cfg);
size_t sv_history_state_bytes(const sv_history_cfg *cfg);
// All frames as a sequence. Of `head` the caller fills what is known of the model; numbers of
// Gaussians and frames, degree, radius and duration are filled in. E_NOT_FOUND: less than two
// frames.
sv_status sv_history_write(const sv_history *h, const sv_sequence_head *head, void *state, sv_sink sink,
                           sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
