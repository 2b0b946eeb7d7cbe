// SPDX-License-Identifier: Apache-2.0
// What a compromised server could reach is taken away in this order: descriptors and the terminal
// at the start; the user, capabilities, files and all other system calls once it listens.
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <linux/capability.h>
#include <linux/types.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/preview/preview.h"

#define NOBODY 65534 // the kernel's own number for "no user of this system"

void pv_limits_set(size_t data_bytes) {
  struct rlimit files = {PV_CAP_CONNECTIONS + 32, PV_CAP_CONNECTIONS + 32}, none = {0, 0};
  struct rlimit data = {data_bytes, data_bytes};
  (void)setrlimit(RLIMIT_NOFILE, &files);
  (void)setrlimit(RLIMIT_CORE, &none);
  // AddressSanitizer's shadow memory counts as data.
  if (!PV_IS_SANITIZED) (void)setrlimit(RLIMIT_DATA, &data);
  (void)setpriority(PRIO_PROCESS, 0, 10); // after capture and training
}

// --- descriptors and session ---------------------------------------------------------------------
#ifndef SYS_close_range
#define SYS_close_range 436
#endif

// first to last, both included
static void close_between(unsigned first, unsigned last) {
  struct rlimit files;
  if (first > last || syscall(SYS_close_range, first, last, 0u) == 0) return;
  // Kernels before 5.9
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) files.rlim_cur = 65536;
  for (unsigned fd = first; fd <= last && fd < files.rlim_cur; fd++) close((int)fd);
}

sv_status pv_sandbox_begin(int a_fd, int b_fd, sv_err *err) {
  const int low = a_fd < b_fd ? a_fd : b_fd, high = a_fd < b_fd ? b_fd : a_fd;
  int null = open("/dev/null", O_RDWR);
  if (null < 0 || dup2(null, 0) != 0)
    return sv_fail(err, SV_E_DEVICE, "sandbox: /dev/null cannot be opened (%s)", sv_linux_reason(errno));
  unsigned next = 3;
  if (low >= 3) {
    close_between(next, (unsigned)low - 1);
    next = (unsigned)low + 1;
  }
  if (high >= 3 && high != low) {
    close_between(next, (unsigned)high - 1);
    next = (unsigned)high + 1;
  }
  close_between(next, ~0u);
  return SV_OK;
}

void pv_sandbox_leave_terminal(void) {
  // The leader of a process group, as a job of a shell is, cannot begin a session, its child can.
  pid_t pid = fork();
  if (pid < 0) return;
  if (pid == 0) {
    (void)setsid();
    return;
  }
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) continue;
  _exit(WIFEXITED(status) ? WEXITSTATUS(status) : 1);
}

// --- user and capabilities -----------------------------------------------------------------------

// To nobody, when this is root. False with errno: it could not be done.
static bool leave_root(void) {
  if (geteuid() != 0 && getuid() != 0) return true;
  // EPERM: in a user namespace without other groups, they are already gone
  if (setgroups(0, NULL) != 0 && errno != EPERM) return false;
  if (setresgid(NOBODY, NOBODY, NOBODY) == 0 && setresuid(NOBODY, NOBODY, NOBODY) == 0) return true;
  // EINVAL: a user namespace without that user, whose root is nobody special outside of it
  return errno == EINVAL;
}

// keeps_user: root stays root, without its powers: files of its own are all it can reach.
static bool drop_capabilities(bool keeps_user) {
  struct __user_cap_header_struct head = {.version = _LINUX_CAPABILITY_VERSION_3};
  struct __user_cap_data_struct none[2] = {{0}}, now[2];
  for (unsigned long c = 0; c < 64 && prctl(PR_CAPBSET_READ, c, 0, 0, 0) >= 0; c++)
    (void)prctl(PR_CAPBSET_DROP, c, 0, 0, 0); // only root may
  if (!keeps_user && !leave_root()) return false;
  (void)prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0);
  if (syscall(SYS_capset, &head, none) != 0 || syscall(SYS_capget, &head, now) != 0) return false;
  return !memcmp(now, none, sizeof none);
}

// --- Landlock ------------------------------------------------------------------------------------
// The numbers are the kernel's interface; headers of older distributions lack the later ones.
#ifndef SYS_landlock_create_ruleset
#define SYS_landlock_create_ruleset 444
#define SYS_landlock_add_rule       445
#define SYS_landlock_restrict_self  446
#endif
typedef struct {
  __u64 handled_access_fs, handled_access_net, scoped;
} ruleset;

typedef struct {
  __u64 allowed_access;
  __s32 parent_fd;
} __attribute__((packed)) below_rule;

// Bits 2 and 3; bits 4, 5 and 7: removing folders and files, making folders (a rename does)
#define READ_FILE_AND_FOLDER 0x0c
#define REMOVE_AND_MAKE_DIR  0xb0

// A ruleset that handles all accesses and allows none, or below a folder (folder_fd >= 0) reading,
// removing and renaming. Returns the ABI, 0 when the kernel has none.
static int forbid_files(int folder_fd) {
  long abi = syscall(SYS_landlock_create_ruleset, NULL, 0, 1u);
  if (abi < 1) return 0;
  ruleset r = {.handled_access_fs = abi >= 5   ? 0xffff
                                    : abi >= 3 ? 0x7fff
                                    : abi == 2 ? 0x3fff
                                               : 0x1fff,
               .handled_access_net = abi >= 4 ? 3 : 0, // bind and connect
               .scoped = abi >= 6 ? 3 : 0};            // abstract sockets and signals
  const size_t bytes = abi >= 6   ? sizeof r
                       : abi >= 4 ? offsetof(ruleset, scoped)
                                  : offsetof(ruleset, handled_access_net);
  long fd = syscall(SYS_landlock_create_ruleset, &r, bytes, 0u);
  if (fd < 0) return 0;
  const below_rule below = {READ_FILE_AND_FOLDER | REMOVE_AND_MAKE_DIR, folder_fd};
  if (folder_fd >= 0) (void)syscall(SYS_landlock_add_rule, (int)fd, 1, &below, 0u);
  long done = syscall(SYS_landlock_restrict_self, (int)fd, 0u);
  close((int)fd);
  return done == 0 ? (int)abi : 0;
}

// --- seccomp -------------------------------------------------------------------------------------
#if defined(__has_include) && __has_include(<seccomp.h>)
#include <seccomp.h>

// What a server on an open socket needs, and the allocator. All else fails with EPERM: among it
// every ioctl, so that no terminal takes input from here (TIOCSTI).
static const int allowed[] = {
    SCMP_SYS(read),         SCMP_SYS(write),          SCMP_SYS(readv),        SCMP_SYS(writev),
    SCMP_SYS(close),        SCMP_SYS(recvfrom),       SCMP_SYS(recvmsg),      SCMP_SYS(accept4),
    SCMP_SYS(accept),       SCMP_SYS(shutdown),       SCMP_SYS(getsockopt),   SCMP_SYS(getsockname),
    SCMP_SYS(getpeername),  SCMP_SYS(epoll_wait),     SCMP_SYS(epoll_pwait),  SCMP_SYS(epoll_ctl),
    SCMP_SYS(poll),         SCMP_SYS(ppoll),          SCMP_SYS(brk),          SCMP_SYS(munmap),
    SCMP_SYS(mremap),       SCMP_SYS(madvise),        SCMP_SYS(futex),        SCMP_SYS(clock_gettime),
    SCMP_SYS(nanosleep),    SCMP_SYS(gettimeofday),   SCMP_SYS(time),         SCMP_SYS(clock_nanosleep),
    SCMP_SYS(getrandom),    SCMP_SYS(getpid),         SCMP_SYS(gettid),       SCMP_SYS(getppid),
    SCMP_SYS(exit),         SCMP_SYS(exit_group),     SCMP_SYS(rt_sigreturn), SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigaction), SCMP_SYS(restart_syscall)};

#if PV_IS_SANITIZED
// RELAXED, in builds with SAN alone: what the sanitizers' runtime calls to work and to report.
static const int sanitizer_calls[] = {SCMP_SYS(openat),      SCMP_SYS(readlink),    SCMP_SYS(readlinkat),
                                      SCMP_SYS(fstat),       SCMP_SYS(newfstatat),  SCMP_SYS(lseek),
                                      SCMP_SYS(sigaltstack), SCMP_SYS(sched_yield), SCMP_SYS(prlimit64),
                                      SCMP_SYS(getrusage),   SCMP_SYS(tgkill)};
// LeakSanitizer's search at exit is a process that traces this one.
const char *__asan_default_options(void);
const char *__asan_default_options(void) { return "detect_leaks=0"; }
#endif

static int allow(scmp_filter_ctx c, const int *calls, size_t n) {
  int r = 0;
  for (size_t i = 0; r == 0 && i < n; i++) r = seccomp_rule_add(c, SCMP_ACT_ALLOW, calls[i], 0);
  return r;
}

// Calls of which only some arguments are allowed. A list of allowed values, compared in all 64
// bits: a command with high bits set, which the kernel cuts off, is none of them.
static int allow_some(scmp_filter_ctx c) {
  static const struct {
    int call;
    struct scmp_arg_cmp args[2];
    unsigned n_args;
  } some[] = {
      // argument, comparison, its values
      // Memory, but never memory that runs
      {SCMP_SYS(mmap), {{2, SCMP_CMP_MASKED_EQ, 4, 0}}, 1},
      {SCMP_SYS(mprotect), {{2, SCMP_CMP_MASKED_EQ, 4, 0}}, 1},
      // Answers, but no connection to elsewhere (MSG_FASTOPEN with an address)
      {SCMP_SYS(sendto), {{3, SCMP_CMP_MASKED_EQ, MSG_FASTOPEN, 0}, {4, SCMP_CMP_EQ, 0}}, 2},
      {SCMP_SYS(sendmsg), {{2, SCMP_CMP_MASKED_EQ, MSG_FASTOPEN, 0}}, 1},
      // Is the writer of the feed still there?
      {SCMP_SYS(kill), {{1, SCMP_CMP_EQ, 0}}, 1},
      // Flags of a socket, but not O_ASYNC: with F_SETOWN and F_SETSIG it sends any signal to any
      // process of this user.
      {SCMP_SYS(fcntl), {{1, SCMP_CMP_EQ, F_GETFD}}, 1},
      {SCMP_SYS(fcntl), {{1, SCMP_CMP_EQ, F_SETFD}}, 1},
      {SCMP_SYS(fcntl), {{1, SCMP_CMP_EQ, F_GETFL}}, 1},
      {SCMP_SYS(fcntl), {{1, SCMP_CMP_EQ, F_SETFL}, {2, SCMP_CMP_MASKED_EQ, O_ASYNC, 0}}, 2},
      {SCMP_SYS(setsockopt), {{1, SCMP_CMP_EQ, IPPROTO_TCP}, {2, SCMP_CMP_EQ, TCP_NODELAY}}, 2},
      {SCMP_SYS(setsockopt), {{1, SCMP_CMP_EQ, IPPROTO_TCP}, {2, SCMP_CMP_EQ, TCP_CORK}}, 2},
  };
  int r = 0;
  for (size_t i = 0; r == 0 && i < sizeof some / sizeof *some; i++)
    r = seccomp_rule_add_array(c, SCMP_ACT_ALLOW, some[i].call, some[i].n_args, some[i].args);
  return r;
}

// What the helper of the scans needs beside: files below its folder (Landlock) and its socket.
static const int folder_calls[] = {
    SCMP_SYS(openat),  SCMP_SYS(getdents64), SCMP_SYS(newfstatat), SCMP_SYS(fstat),    SCMP_SYS(statx),
    SCMP_SYS(fstatfs), SCMP_SYS(renameat),   SCMP_SYS(renameat2),  SCMP_SYS(unlinkat), SCMP_SYS(lseek)};

static int filter(bool has_folder) {
  scmp_filter_ctx c = seccomp_init(SCMP_ACT_ERRNO(EPERM));
  if (!c) return -ENOMEM;
  int r = allow(c, allowed, sizeof allowed / sizeof *allowed);
  if (r == 0) r = allow_some(c);
  if (r == 0 && has_folder) r = allow(c, folder_calls, sizeof folder_calls / sizeof *folder_calls);
#if PV_IS_SANITIZED
  if (r == 0) r = allow(c, sanitizer_calls, sizeof sanitizer_calls / sizeof *sanitizer_calls);
#endif
  if (r == 0) r = seccomp_load(c);
  seccomp_release(c);
  return r;
}
#else
static int filter(bool has_folder) {
  (void)has_folder;
  return -ENOSYS;
}
#endif

// The filter, with nothing behind 1 and 2 any more. When it cannot be set, 2 is back to say so.
static int shut(void) {
  // Sanitizers report on 2.
  if (PV_IS_SANITIZED) return filter(false);
  int was = fcntl(2, F_DUPFD_CLOEXEC, 3);
  dup2(0, 1); // 0 is /dev/null
  dup2(0, 2);
  int r = filter(false);
  if (was >= 0 && r != 0) dup2(was, 2);
  if (was >= 0) close(was);
  return r;
}

sv_status pv_sandbox_enter(char *text, size_t cap, sv_err *err) {
  struct tm tm;
  time_t now = time(NULL);
  (void)gmtime_r(&now, &tm); // reads the time zone's file once, which will not be possible any more
  const pid_t parent = getppid();
  if (!drop_capabilities(false))
    return sv_fail(err, SV_E_DEVICE, "sandbox: root and its capabilities cannot be left (%s)",
                   sv_linux_reason(errno));
  // Leaving root has cleared the first of the two and set the second.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1); // it ended in between
  if (prctl(PR_SET_DUMPABLE, PV_IS_SANITIZED, 0, 0, 0) != 0 || prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0)
    return sv_fail(err, SV_E_DEVICE, "sandbox: no_new_privs cannot be set (%s)", sv_linux_reason(errno));
  int abi = forbid_files(-1);
  int r = shut();
  if (r != 0)
    return sv_fail(err, SV_E_DEVICE, "sandbox: the seccomp filter cannot be set (%s)", sv_linux_reason(-r));
  sv_str s = sv_str_make(text, cap);
  sv_str_add(&s, "seccomp, no_new_privs, no capabilities");
  if (abi) sv_str_add(&s, ", Landlock (ABI %d)", abi);
  else sv_str_add(&s, "; this kernel has no Landlock");
  if (PV_IS_SANITIZED) sv_str_add(&s, "; relaxed for sanitizers");
  return SV_OK;
}

bool pv_sandbox_enter_folder(int folder_fd, int socket_fd) {
  const int low = folder_fd < socket_fd ? folder_fd : socket_fd, high = folder_fd ^ socket_fd ^ low;
  if (!PV_IS_SANITIZED) {
    dup2(0, 1); // 0 is /dev/null
    dup2(0, 2);
  }
  if (low > 3) close_between(3, (unsigned)low - 1);
  if (high > low + 1) close_between((unsigned)low + 1, (unsigned)high - 1);
  close_between((unsigned)high + 1, ~0u);
  if (!drop_capabilities(true)) return false;
  if (prctl(PR_SET_DUMPABLE, PV_IS_SANITIZED, 0, 0, 0) != 0 || prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0)
    return false;
  (void)forbid_files(folder_fd);
  return filter(true) == 0;
}
