// SPDX-License-Identifier: Apache-2.0
// The port on Linux: clock, threads, store and console behind src/port/port.h.
// Every struct is the caller's and must not move while the port made from it is in use. Memory
// comes from the system only in the open and start calls (thread stacks). Never allocates
// afterwards.
#ifndef SV_PLATFORM_LINUX_LINUX_H
#define SV_PLATFORM_LINUX_LINUX_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "platform/linux/file.h"
#include "src/port/port.h"

// The pool's words are lock-free in C; C++ only needs to know their size, which is the same.
#ifdef __cplusplus
#define SV_LINUX_ATOMIC(type) type
extern "C" {
#else
#include <stdatomic.h>
#include <sys/types.h>
#define SV_LINUX_ATOMIC(type) _Atomic(type)
#endif

// --- clock ---------------------------------------------------------------------------------------
// CLOCK_MONOTONIC. sleep_until_ns returns early on a signal, so that Ctrl-C acts at once.
sv_clock sv_linux_clock(void);

// --- memory --------------------------------------------------------------------------------------
// Asks for pages of 2 MiB (transparent huge pages) in a block that is not touched yet: passes over
// the whole block then miss the TLB rarely. Without support the usual pages are used.
void sv_linux_large_pages(void *block, size_t bytes);
// A block of zeros from the system, for as long as the program runs; only touched pages take
// memory. NULL after a sentence in err, for example under ulimit -v.
void *sv_linux_block(size_t bytes, sv_err *err);

// --- threads -------------------------------------------------------------------------------------
#define SV_LINUX_CAP_THREADS 64

typedef struct sv_linux_pool sv_linux_pool;
typedef struct {
  sv_linux_pool *pool;
  pthread_t id;
  int i_thread;
  // Remaining tasks of this thread's share of the current job: job << 32 | first << 16 | end. Its
  // owner takes them from the front, other threads steal from the back.
  SV_LINUX_ATOMIC(uint64_t) left;
  char padding[128 - 40]; // keeps the words of two threads off one cache line
} sv_linux_worker;

// One job at a time. A share's word holds the job's number beside its tasks, so a worker that wakes
// late can never take a task of a job it did not read. No worker has to check in, and the share of
// a sleeping worker is stolen by the others.
struct sv_linux_pool {
  int n_threads;   // the caller included
  int64_t spin_ns; // how long an idle thread spins before it sleeps
  uint32_t n_jobs; // private to the caller
  SV_LINUX_ATOMIC(sv_task_fn) fn;
  SV_LINUX_ATOMIC(void *) arg;
  SV_LINUX_ATOMIC(uint32_t) i_job; // changes with each job; idle workers sleep on it
  SV_LINUX_ATOMIC(uint32_t) n_asleep;
  SV_LINUX_ATOMIC(uint32_t) n_started;
  SV_LINUX_ATOMIC(bool) is_stopping;
  char padding[64];
  // Tasks finished by threads that found no more; the caller sleeps on it.
  SV_LINUX_ATOMIC(uint32_t) n_done;
  SV_LINUX_ATOMIC(uint32_t) n_tasks;             // of the current job
  SV_LINUX_ATOMIC(uint32_t) is_waited;           // the caller sleeps
  sv_linux_worker workers[SV_LINUX_CAP_THREADS]; // [0]: the caller
};

// Makes n_threads - 1 threads (1..SV_LINUX_CAP_THREADS; with 1 none is made and tasks run in order
// on the caller). Idle threads spin spin_us before they sleep (-1: 200; it is 0 on a machine with a
// single core). Their signals are blocked: Ctrl-C goes to the main thread.
sv_status sv_linux_pool_start(sv_linux_pool *p, int n_threads, int spin_us, sv_err *err) SV_MUST_USE;
// The port's view of it. run() must not be called from inside a task nor by two threads at once.
sv_pool sv_linux_pool_port(sv_linux_pool *p);
void sv_linux_pool_stop(sv_linux_pool *p); // joins the threads

// One more thread, for the cameras. Its stack comes from the system when it starts.
typedef struct {
  pthread_t id;
  void (*fn)(void *arg);
  void *arg;
  bool is_running;
  int cpu; // its thread stays on this one; -1: on any. The caller may set it before the start
} sv_linux_background;
sv_worker sv_linux_worker_port(sv_linux_background *b);

// --- CPUs ----------------------------------------------------------------------------------------
int sv_linux_n_cpus(void); // that the calling thread may use
// The one to leave to the cameras: the slowest (cpu_capacity below sys, "/sys" or a test's folder),
// among equals the first, as interrupts of most boards go there. -1: the system does not tell.
int sv_linux_camera_cpu(const char *sys);
// The calling thread stays on this CPU.
sv_status sv_linux_take_cpu(int cpu);
// The calling thread, and what threads and programs it starts from here on, use the others. E_RANGE
// with a sentence when there are none.
sv_status sv_linux_leave_cpu(int cpu, sv_err *err) SV_MUST_USE;

// --- store ---------------------------------------------------------------------------------------
#define SV_LINUX_CAP_PATH 512

typedef struct {
  int dir_fd;                  // -1: not open
  char dir[SV_LINUX_CAP_PATH]; // for error messages
  sv_linux_file file;          // between begin and commit
} sv_linux_store;

void sv_linux_store_init(sv_linux_store *s); // not open: close does nothing
// Opens a folder; makes it (and its parents) when it is missing. Temporary files that a killed
// program has left there are removed.
sv_status sv_linux_store_open(sv_linux_store *s, const char *dir, sv_err *err) SV_MUST_USE;
// E_IO with a sentence when another program writes into the folder. Held until close.
sv_status sv_linux_store_lock(const sv_linux_store *s, sv_err *err) SV_MUST_USE;
// begin/write/commit: platform/linux/file.h.
sv_store sv_linux_store_port(sv_linux_store *s);
void sv_linux_store_close(sv_linux_store *s); // abandons a file that was not committed

// Makes a new folder in memory (/dev/shm, $XDG_RUNTIME_DIR), readable by this user alone, for what
// an output folder does not take.
sv_status sv_linux_rescue_dir(char *path, size_t cap, sv_err *err) SV_MUST_USE;

// Makes a folder and its missing parents.
sv_status sv_linux_make_dir(const char *dir, sv_err *err) SV_MUST_USE;

// Starts argv[0] with its words (the last one NULL); 0: could not. No signal is blocked or ignored
// there. It gets a process group of its own, so that Ctrl-C is for this program, which ends the
// others; or a session, which also has no terminal. The library does this by vfork and exec,
// without the heap.
pid_t sv_linux_spawn(char *const *argv, bool has_session) SV_MUST_USE;

// The system's reason for an errno, in a few words, for an error sentence. Never allocates.
const char *sv_linux_reason(int errno_value);

// --- console -------------------------------------------------------------------------------------
typedef struct {
  int fd;        // 2: stderr
  bool is_quiet; // only errors and warnings
  bool is_terminal;
  bool has_live_line; // an unfinished live line is on the terminal
  sv_ns live_period_ns, last_live_ns;
} sv_linux_console;

// Log lines go to `fd` (2: stderr) with one write each. SV_LOG_LIVE rewrites one line on a
// terminal; elsewhere it prints a line at most every 5 seconds.
void sv_linux_console_init(sv_linux_console *c, int fd, bool is_quiet);
sv_console sv_linux_console_port(sv_linux_console *c);
void sv_linux_console_finish(sv_linux_console *c); // ends a live line

// From here on the first SIGINT or SIGTERM only sets the stop flag that every console reports; the
// second one has its usual effect, so a hanging program can still be ended. SIGHUP sets it too,
// however often it comes, unless it is ignored.
sv_status sv_linux_catch_signals(sv_err *err) SV_MUST_USE;
// What every program does first: a file that grows over the limit of its size (ulimit -f) is then
// an error of a write (EFBIG), not the end of the program.
void sv_linux_begin_program(void);
// And last: what was printed must have arrived. `code`, or 1 after a sentence on stderr. A reader
// that has gone is no failure.
int sv_linux_end_program(const char *program, int code);
// write() to stdout or stderr until all is written; remembers a failure for sv_linux_end_program.
void sv_linux_print(int fd, const char *text, size_t bytes);
// From here on, output without a reader is dropped instead of ending the program (SIGPIPE).
void sv_linux_outlive_readers(void);
void sv_linux_reset_stop(void); // clears the flag (tests; a second run in one process)

#ifdef __cplusplus
}
#endif
#endif
