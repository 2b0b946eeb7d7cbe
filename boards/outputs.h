// SPDX-License-Identifier: Apache-2.0
// C only: sv_app is.
// Where a run's files go: the output folder, the second place for what that does not take at the
// end, and the pictures for people. Owns both folders and the JPEG encoder's buffers. Never ends a
// run because a picture could not be saved.
#ifndef SV_BOARDS_OUTPUTS_H
#define SV_BOARDS_OUTPUTS_H

#include "boards/board_main.h"
#include "boards/run_options.h"

typedef struct {
  sv_linux_store store, rescue; // the second one is opened when it is needed
  const char *rescue_option;    // --rescue; NULL: a memory-backed folder
  const sv_app *app;
  sv_console console;
  sv_codec codec;
  uint8_t *jpeg;
  size_t cap_jpeg;
  sv_err picture_err; // of the newest picture; its status OK: it is saved
  int n_failed;       // pictures in a row
  sv_ns retry_ns;     // of the machine's clock: none is tried before, until the end
  bool has_preview, is_preview_rescued;
} outputs;

// Not open: outputs_close does nothing.
void outputs_init(outputs *o);
// Buffers for pictures of width x height.
sv_status outputs_carve(outputs *o, sv_arena *arena, int width_px, int height_px, sv_err *err) SV_MUST_USE;
// A model or a checkpoint is in this folder.
bool outputs_has_model(const char *dir);
// Opens and locks the folder of --out. E_ARG: it holds a model, which this run may not replace.
sv_status outputs_open(outputs *o, const run_options *opt, const sv_app *app, sv_console console,
                       sv_err *err) SV_MUST_USE;
// Saves a picture as NAME.jpg.
void outputs_publish(outputs *o, const char *name, int width_px, int height_px, const uint8_t *rgb);
// store and rescue of the port.
void outputs_port(outputs *o, sv_port *port);
// "saved: DIR/model.ply ..." on stdout: what is there, and where.
void outputs_say(const outputs *o);
void outputs_close(outputs *o);

#endif
