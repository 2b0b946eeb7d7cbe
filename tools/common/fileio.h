// SPDX-License-Identifier: Apache-2.0
// Files for host tools: whole-file reads, atomic writes, folders. Sentences name the file.
#ifndef SV_TOOLS_COMMON_FILEIO_H
#define SV_TOOLS_COMMON_FILEIO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "platform/linux/file.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_PATH 1024

// Opens a plain file for reading; *fd is the caller's to close. E_NOT_FOUND, E_IO, E_FORMAT (a
// folder, pipe or device: reading those may never end).
sv_status sv_file_open(const char *path, int *fd, size_t *bytes, sv_err *err) SV_MUST_USE;

// The whole file in a malloc'ed block, the caller frees it; one zero byte follows the content.
// E_NOMEM, and what sv_file_open returns.
sv_status sv_file_read(const char *path, void **data, size_t *bytes, sv_err *err) SV_MUST_USE;

// Atomic (platform/linux/file.h). After a failure the old file is still there.
sv_status sv_file_write(const char *path, const void *data, size_t bytes, sv_err *err) SV_MUST_USE;

// The same in pieces. begin, write (the shape of sv_sink.write with self = the file), then commit
// or abandon. After a failed write call abandon.
typedef struct {
  sv_linux_file file;
  int dir_fd; // -1 when closed
  char path[SV_CAP_PATH];
} sv_file;
void sv_file_init(sv_file *f); // not open: abandon does nothing
sv_status sv_file_begin(sv_file *f, const char *path, sv_err *err) SV_MUST_USE;
sv_status sv_file_append(void *file, const void *data, size_t bytes, sv_err *err) SV_MUST_USE;
sv_status sv_file_commit(sv_file *f, sv_err *err) SV_MUST_USE;
void sv_file_abandon(sv_file *f);

// The same for printf. NULL: a failure with its sentence.
FILE *sv_stream_open(const char *path, sv_err *err);
// Closes it. Nothing is saved when a write failed.
sv_status sv_stream_save(FILE *f, sv_err *err) SV_MUST_USE;

// "folder/name"; an absolute name stands alone. E_RANGE when it does not fit cap.
sv_status sv_path_join(char *out, size_t cap, const char *folder, const char *name, sv_err *err) SV_MUST_USE;
// The folder of a path, "." when it has none.
void sv_path_folder(char *out, size_t cap, const char *path);
const char *sv_path_name(const char *path);      // after the last '/'
const char *sv_path_extension(const char *path); // with the dot, "" when none
bool sv_path_exists(const char *path);
bool sv_path_is_folder(const char *path);
// Makes a folder and those above it.
sv_status sv_path_make_folder(const char *path, sv_err *err) SV_MUST_USE;

// Makes a folder and holds its lock until *fd is closed. E_IO: another program writes there.
sv_status sv_path_lock_folder(const char *path, int *fd, sv_err *err) SV_MUST_USE;

// Names in a folder, sorted by bytes, without those that start with '.'. Free with sv_names_free.
typedef struct {
  char **names;
  int n;
} sv_names;
sv_status sv_folder_list(const char *folder, sv_names *out, sv_err *err) SV_MUST_USE;
void sv_names_free(sv_names *names);

// An sv_file_reader (src/format/rig_file.h) over a folder: self is the folder's path.
sv_status sv_folder_read(void *folder, const char *name, void *buf, size_t cap, size_t *bytes,
                         sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
