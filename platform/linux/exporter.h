// SPDX-License-Identifier: Apache-2.0
// Files of a scan in other formats, made when the page asks for them: by subview-lab, in a process
// of its own with limited memory and the lowest priority. Owns that process; one at a time. Nothing
// allocates.
#ifndef SV_PLATFORM_LINUX_EXPORTER_H
#define SV_PLATFORM_LINUX_EXPORTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  char program[512], model[768], made[768], part[768]; // program: empty without subview-lab
  char *argv[16];
  pid_t pid; // 0: not running
} sv_linux_exporter;

// A format of the page's downloads ("sog"); NULL beyond the last.
const char *sv_linux_export_format(int i);
// Looks for subview-lab beside this program. False: it is not installed.
bool sv_linux_exporter_open(sv_linux_exporter *e);
// Makes FOLDER/model.FORMAT of FOLDER/model.ply, unless it is there and newer. The file appears
// when it is whole. False: another one is being made, or it cannot begin.
bool sv_linux_exporter_make(sv_linux_exporter *e, const char *folder, int i_format);
void sv_linux_exporter_step(sv_linux_exporter *e); // takes the end of the process
void sv_linux_exporter_close(sv_linux_exporter *e);

#ifdef __cplusplus
}
#endif
#endif
