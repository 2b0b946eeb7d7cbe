// SPDX-License-Identifier: Apache-2.0
#include "tools/common/program.h"

#include <errno.h>
#include <fcntl.h>
#include <spawn.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include "src/base/str.h"

extern char **environ;

static int start(const char *const *argv, int output, long *pid) {
  posix_spawn_file_actions_t todo;
  pid_t child = 0;
  if (posix_spawn_file_actions_init(&todo) != 0) return ENOMEM;
  int e = posix_spawn_file_actions_addopen(&todo, 0, "/dev/null", O_RDONLY, 0);
  if (e == 0) e = posix_spawn_file_actions_addopen(&todo, 2, "/dev/null", O_WRONLY, 0);
  if (e == 0) e = posix_spawn_file_actions_adddup2(&todo, output, 1);
  if (e == 0) e = posix_spawnp(&child, argv[0], &todo, NULL, (char *const *)(uintptr_t)argv, environ);
  posix_spawn_file_actions_destroy(&todo);
  *pid = child;
  return e;
}

sv_status sv_program_start(sv_program *p, const char *const *argv, sv_err *err) {
  int ends[2];
  *p = (sv_program){0};
  if (pipe2(ends, O_CLOEXEC) != 0) return sv_fail(err, SV_E_DEVICE, "%s: no pipe to it", argv[0]);
  const int e = start(argv, ends[1], &p->pid);
  close(ends[1]);
  if (e == 0) p->out = fdopen(ends[0], "rb");
  if (e == 0 && p->out) return SV_OK;
  close(ends[0]);
  if (e == 0) sv_program_end(p);
  return e == ENOENT ? sv_fail(err, SV_E_NOT_FOUND, "the program %s was not found; install it", argv[0])
                     : sv_fail(err, SV_E_DEVICE, "%s: cannot be started", argv[0]);
}

int sv_program_end(sv_program *p) {
  int status = 0;
  if (p->out) fclose(p->out);
  p->out = NULL;
  while (waitpid((pid_t)p->pid, &status, 0) < 0 && errno == EINTR) continue;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

sv_status sv_program_text(const char *const *argv, size_t cap, char **text, sv_err *err) {
  sv_program p;
  *text = NULL;
  sv_status s = sv_program_start(&p, argv, err);
  if (s != SV_OK) return s;
  size_t n = 0, room = 4096;
  char *buf = malloc(room + 1);
  while (buf && n < cap) {
    const size_t got = fread(buf + n, 1, room - n, p.out);
    n += got;
    if (got == 0) break;
    if (n < room) continue;
    room *= 2;
    char *more = realloc(buf, room + 1);
    if (!more) free(buf);
    buf = more;
  }
  const int code = sv_program_end(&p);
  if (!buf) return sv_fail(err, SV_E_NOMEM, "%s: no memory for what it prints", argv[0]);
  buf[n] = 0;
  *text = buf;
  if (code == 0 || n >= cap) return SV_OK;
  free(buf);
  *text = NULL;
  return sv_fail(err, SV_E_DEVICE, "%s failed with code %d", argv[0], code);
}
