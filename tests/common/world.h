// SPDX-License-Identifier: Apache-2.0
// C only: the runtime's counters are atomic.
// A whole runtime in a test: the simulator on its virtual clock, a store in memory, a machine clock
// that ticks by itself, and a port that fails on demand. One world at a time: they share one block.
#ifndef SV_TESTS_COMMON_WORLD_H
#define SV_TESTS_COMMON_WORLD_H

#include "platform/linux/linux.h"
#include "platform/replay/replay.h"
#include "platform/sim/sim.h"
#include "src/run/app.h"
#include "src/train/train_stats.h"

#define WORLD_CAP_FILES 8
#define WORLD_CAP_FILE  (10u << 20)
#define WORLD_CAP_LINES 64

// --- a store in memory, atomic as the port asks --------------------------------------------------
typedef struct {
  char name[32];
  size_t bytes;
  uint8_t *data; // [WORLD_CAP_FILE], static
} world_file;

typedef struct {
  int n_files;
  world_file file[WORLD_CAP_FILES];
  bool is_open;
  char open_name[32];
  size_t open_bytes;
  uint8_t *open_data;
} world_store;

// --- calls of the port, counted and failed -------------------------------------------------------
typedef enum {
  WORLD_START,
  WORLD_DEQUEUE,
  WORLD_REQUEUE,
  WORLD_STOP,
  WORLD_RIG_POSE,
  WORLD_EVENT,
  WORLD_SET_CONTROL,
  WORLD_TRIGGER,
  WORLD_WORKER, // the start of the cameras' thread
  WORLD_BEGIN,
  WORLD_WRITE,
  WORLD_COMMIT,
  WORLD_READ,
  WORLD_DECODE, // when the test sets port.decoder = world_decoder(w)
  WORLD_N_CALLS
} world_call;
const char *world_call_name(world_call c);

typedef struct {
  world_call call;
  long at;               // the at-th call fails (1: the first); 0: none
  bool is_lasting;       // and all later ones, too
  long n[WORLD_N_CALLS]; // calls so far
  bool was_hit;
} world_fault;

typedef struct {
  sv_sim sim;
  sv_replay replay;
  bool is_replay; // then `sim` is empty
  sv_rig rig;     // of the replay
  sv_app app;
  sv_app_cfg cfg;
  sv_kernels k;
  sv_linux_pool pool;
  sv_arena arena;
  sv_port port, inner; // the app's, and what it wraps
  world_store store, second;
  world_fault fault;
  sv_linux_background background; // the cameras' thread, when the test sets port.worker =
                                  // world_worker(w)
  long n_out, n_back;             // frames that dequeue gave, and that were handed back (whether or
                                  // not that failed)
  sv_camera_caps caps[4];
  sv_err err;
  sv_ns machine_ns, machine_tick_ns; // each reading of the machine's clock adds a tick
  uint32_t stop_at_step;             // the stop request comes when so many steps are done; 0: never
  bool is_stop_at_once;              // the stop request is there from the start
  int n_lines;                       // what was logged
  char line[WORLD_CAP_LINES][256];
  sv_log_level level[WORLD_CAP_LINES];
  int n_images, image_width_px, image_height_px;
} world;

// Fills in everything but the app: simulator of `spec`, kernels of isa_mask, a pool of n_threads,
// cfg with sensible values (1 ms a tick). Change w->cfg, then world_init. False: w->err tells why.
bool world_open(world *w, const char *spec, int n_exposures, uint32_t isa_mask, int n_threads);
// The same with the capture in a folder, its own rig and scene bounds.
bool world_open_replay(world *w, const char *dir, int n_exposures, uint32_t isa_mask, int n_threads);
sv_status world_init(world *w);                  // sv_app_init in what is left of the block
sv_status world_init_in(world *w, size_t bytes); // the same in so many bytes of it
// open, init and run; the run's status.
sv_status world_run(world *w);
// The cameras' thread for a live run; the simulator then runs as fast as it can beside the
// training.
sv_worker world_worker(world *w);
// A second place for what the store does not take, for port.rescue; its files are in w->second.
sv_store world_rescue(world *w);
// A decoder of compressed frames that can fail; `inner` does the work.
sv_decoder world_decoder(world *w, const sv_decoder *inner);
void world_close(world *w);                                     // ends the threads; the files stay
void world_forget_files(world *w);                              // an empty store
const world_file *world_find(const world *w, const char *name); // NULL: no such file
// Has a log line with this text been written?
bool world_has_line(const world *w, const char *text);
// Bytes that an app of this cfg takes.
size_t world_app_bytes(world *w);
// Mean PSNR over n held-out views of the simulator.
double world_heldout_psnr(world *w, int n);

// The same as without _well, but a failure fails the test with its message; after run_well the app
// is done.
void world_open_well(world *w, const char *spec, int n_exposures, uint32_t isa_mask, int n_threads);
void world_run_well(world *w);
// What the trainer has done, the digest of its parameters, and the PSNR of the images that it
// trains on.
sv_train_stats world_stats(const world *w);
uint64_t world_digest(const world *w);
double world_training_psnr(world *w);

#endif
