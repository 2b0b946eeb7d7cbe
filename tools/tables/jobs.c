// SPDX-License-Identifier: Apache-2.0
#include "tools/tables/jobs.h"

#include <errno.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define TICK_NS    (50 * SV_NS_PER_MS)
#define PATIENCE_S 20 // for jobs that were asked to stop

extern char **environ;

// --- lines ---------------------------------------------------------------------------------------

sv_status tables_job_begin(tables_job *j, const tables *t, const char *key, sv_err *err) {
  char name[TABLES_CAP_KEY + 8];
  memset(j, 0, sizeof *j);
  snprintf(name, sizeof name, "runs/%s", key);
  return sv_path_join(j->folder, sizeof j->folder, t->out, name, err);
}

void tables_job_add(tables_step *s, const char *option, const char *value) {
  int n = 0;
  while (s->args[n]) n++;
  s->args[n] = option;
  s->args[n + 1] = value;
}

tables_step *tables_job_step(tables_job *j, const char *file, const char *command) {
  tables_step *s = &j->step[j->n++];
  *s = (tables_step){.file = file, .args = {command}};
  return s;
}

// As one word of shell.
static void put_word(FILE *f, const char *text) {
  fputc('\'', f);
  for (const char *p = text; *p; p++) fprintf(f, *p == '\'' ? "'\\''" : "%c", *p);
  fputc('\'', f);
}

static void put_step(FILE *f, const tables *t, const tables_step *s) {
  // What follows a training needs its model, which is removed at the end.
  fprintf(f, " && { [ -e \"$d/%s\" ]%s || { ", s->file,
          s->must_have_steps ? " && [ -e \"$d/model.ply\" ]" : "");
  put_word(f, t->program);
  for (int i = 0; s->args[i]; i++) {
    fputc(' ', f);
    if (strncmp(s->args[i], "$d", 2) == 0) fprintf(f, "\"%s\"", s->args[i]);
    else put_word(f, s->args[i]);
  }
  fprintf(f, " >\"$d/%s.part\" 2>>\"$d/log.txt\"", s->file);
  if (s->must_have_steps > 0)
    fprintf(f, " && grep -q '\"steps\": %ld,' \"$d/%s.part\"", s->must_have_steps, s->file);
  fprintf(f, " && mv \"$d/%s.part\" \"$d/%s\"; }; }", s->file, s->file);
}

void tables_job_line(const tables_job *j, const tables *t, FILE *f) {
  fprintf(f, "d=");
  put_word(f, j->folder);
  fprintf(f, "; ");
  for (int i = 0; i < j->n; i++) fprintf(f, "%s[ -e \"$d/%s\" ]", i ? " && " : "", j->step[i].file);
  fprintf(f, " || { mkdir -p \"$d\" && printf %%s %s >\"$d/build\"", t->build);
  for (int i = 0; i < j->n; i++) put_step(f, t, &j->step[i]);
  if (!j->is_model_kept) fprintf(f, " && rm -f \"$d/model.ply\""); // a hundred would fill a disk
  if (!t->o->is_quiet) {
    fprintf(f, " && echo ");
    put_word(f, j->what);
    fprintf(f, " >&2");
  }
  fprintf(f, "; }\n");
}

// --- files of a run ------------------------------------------------------------------------------

sv_status tables_job_read(const tables_job *j, const char *file, char **text, sv_err *err) {
  char path[SV_CAP_PATH];
  void *data;
  size_t bytes;
  *text = NULL;
  sv_status s = sv_path_join(path, sizeof path, j->folder, file, err);
  if (s == SV_OK && !sv_path_exists(path)) s = sv_fail(err, SV_E_NOT_FOUND, "%s: no such file", path);
  if (s == SV_OK) s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  *text = realloc(data, bytes + 1);
  if (!*text) {
    free(data);
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for it", path);
  }
  (*text)[bytes] = 0;
  return SV_OK;
}

void tables_job_drop(const tables_job *j, tables *t, const char *file, const sv_err *why) {
  char path[SV_CAP_PATH];
  if (sv_path_join(path, sizeof path, j->folder, file, NULL) != SV_OK) return;
  lab_say(&t->session, "%s: %s%s", path, why->text, t->o->is_collected ? "" : "; measuring again");
  if (!t->o->is_collected) unlink(path);
}

// --- running -------------------------------------------------------------------------------------

// $1: the lines, $2: so many at a time, $3: parallel's log. moreutils has another program
// `parallel`.
static const char *const runner =
    "[ \"$2\" = 1 ] && exec sh -e \"$1\"; "
    "if parallel --minversion 20130000 >/dev/null 2>&1; then "
    "exec parallel --will-cite --jobs \"$2\" --halt soon,fail=1 --termseq TERM,20000,KILL,50 "
    "--joblog \"$3\" <\"$1\"; fi; "
    "echo 'GNU parallel not found (Debian: parallel): one job after the other' >&2; "
    "exec sh -e \"$1\"";

// Asks the group of processes to end until it has.
static void stop(tables *t, pid_t group) {
  const sv_clock *c = &t->session.clock;
  const int64_t until = c->now_ns(c->self) + PATIENCE_S * SV_NS_PER_S;
  kill(-group, SIGTERM);
  waitpid(group, NULL, 0);
  while (kill(-group, 0) == 0 && c->now_ns(c->self) < until)
    c->sleep_until_ns(c->self, c->now_ns(c->self) + TICK_NS);
  kill(-group, SIGKILL);
}

static sv_status write_or_count(tables *t, tables_look_fn *look, void *of, const char *path, int *n_done,
                                sv_err *err) {
  if (t->o->is_collected) return look(of, NULL, n_done, err);
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  sv_status s = look(of, f, n_done, err);
  const sv_status saved = sv_stream_save(f, err);
  return s == SV_OK ? saved : s;
}

sv_status tables_make_jobs(tables *t, tables_look_fn *look, void *of, int n, sv_err *err) {
  char path[SV_CAP_PATH];
  int n_done = 0;
  sv_status s = sv_path_join(path, sizeof path, t->out, "jobs.txt", err);
  if (s == SV_OK && t->o->plan && !sv_copy(path, sizeof path, t->o->plan))
    s = sv_fail(err, SV_E_RANGE, "--plan %.80s: too long", t->o->plan);
  if (s == SV_OK) s = write_or_count(t, look, of, path, &n_done, err);
  if (s != SV_OK) return s;
  t->n_missing = n - n_done;
  lab_say(&t->session, "%d runs, %d already done", n, n_done);
  if (t->o->plan || t->o->is_collected || !t->n_missing) return SV_OK;
  s = tables_jobs_run(t, path, err);
  sv_err other;
  if (look(of, NULL, &n_done, &other) == SV_OK) t->n_missing = n - n_done;
  if (s == SV_E_INTERRUPTED)
    return sv_fail(err, s,
                   "stopped by request with %d of %d runs done; run the same command again to continue",
                   n_done, n);
  if (s == SV_OK && !t->n_missing) return SV_OK;
  return sv_fail(err, SV_E_DEVICE, "%d of %d runs failed: see log.txt of each in %.150s/runs", t->n_missing,
                 n, t->o->out);
}

sv_status tables_jobs_run(tables *t, const char *path, sv_err *err) {
  char n_jobs[24], log[SV_CAP_PATH];
  const sv_console *con = &t->session.console;
  const sv_clock *c = &t->session.clock;
  posix_spawnattr_t how;
  pid_t pid = 0;
  int status = 0;
  sv_status s = sv_path_join(log, sizeof log, t->out, "jobs.log", err);
  if (s != SV_OK) return s;
  snprintf(n_jobs, sizeof n_jobs, "%ld", t->n_jobs);
  const char *const argv[] = {"sh", "-c", runner, "sh", path, n_jobs, log, NULL};
  if (posix_spawnattr_init(&how) != 0) return sv_fail(err, SV_E_NOMEM, "no memory for a process");
  // Ctrl-C on the terminal is ours, and is passed on once.
  posix_spawnattr_setflags(&how, POSIX_SPAWN_SETPGROUP);
  int e = posix_spawn(&pid, "/bin/sh", NULL, &how, (char *const *)(uintptr_t)argv, environ);
  posix_spawnattr_destroy(&how);
  if (e != 0) return sv_fail(err, SV_E_DEVICE, "/bin/sh cannot be started: %s", sv_linux_reason(e));
  while ((e = waitpid(pid, &status, WNOHANG)) == 0) {
    if (con->is_stop_requested(con->self)) {
      stop(t, pid);
      return sv_fail(err, SV_E_INTERRUPTED, "stopped by request");
    }
    c->sleep_until_ns(c->self, c->now_ns(c->self) + TICK_NS);
  }
  if (e == pid && WIFEXITED(status) && WEXITSTATUS(status) == 0) return SV_OK;
  return sv_fail(err, SV_E_DEVICE, "a job failed");
}
