// SPDX-License-Identifier: Apache-2.0
// Saving a file so that a kill, a full disk or a power cut leaves the old one or the new one.
// Every program writes its files through this module. Owns the temporary file between begin and
// commit. Never follows a symbolic link that stands in the temporary file's place, never allocates.
#ifndef SV_PLATFORM_LINUX_FILE_H
#define SV_PLATFORM_LINUX_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_LINUX_CAP_NAME 200

typedef struct {
  int dir_fd;       // the folder; the caller's, open until commit or abandon
  int fd;           // the temporary file; -1: none is open
  int error;        // errno of the first failure since begin; commit returns it again
  bool is_in_place; // commit has put the new file in place, even if it failed afterwards
  uint64_t n_bytes; // written since begin
  char name[SV_LINUX_CAP_NAME];
  char temporary[SV_LINUX_CAP_NAME + 48]; // NAME.PID-N.subview-tmp
} sv_linux_file;

// All return 0 or an errno (sv_linux_reason has its words). After a failed write, commit or abandon
// is still needed; both remove the temporary file.
int sv_linux_file_begin(sv_linux_file *f, int dir_fd, const char *name);
int sv_linux_file_write(sv_linux_file *f, const void *data, size_t bytes);
// fsync, rename, fsync of the folder.
int sv_linux_file_commit(sv_linux_file *f);
// The same for a file of which two generations are kept. is_kept: the file that was there becomes
// `older`. Otherwise it is replaced and `older` is removed.
int sv_linux_file_commit_over(sv_linux_file *f, const char *older, bool is_kept);
void sv_linux_file_abandon(sv_linux_file *f);

// Writes all bytes, however short the system's writes are. 0 or an errno.
int sv_linux_write_all(int fd, const void *data, size_t bytes, uint64_t *n_written);

// Removes temporary files of processes that no longer live. Other names are left alone.
void sv_linux_file_sweep(int dir_fd);

// Whoever writes into a folder holds its lock. The kernel releases it when the descriptor is closed
// or the process ends.
typedef enum {
  SV_LINUX_LOCK_OURS,
  SV_LINUX_LOCK_IN_USE,     // another program writes there
  SV_LINUX_LOCK_UNSUPPORTED // some network file systems
} sv_linux_lock;
sv_linux_lock sv_linux_folder_lock(int dir_fd);

#ifdef __cplusplus
}
#endif
#endif
