// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <linux/types.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/preview/preview.h"

void pv_limits_set(size_t data_bytes) {
  struct rlimit files = {PV_CAP_CONNECTIONS + 32, PV_CAP_CONNECTIONS + 32}, none = {0, 0};
  struct rlimit data = {data_bytes, data_bytes};
  (void)setrlimit(RLIMIT_NOFILE, &files);
  (void)setrlimit(RLIMIT_CORE, &none);
  (void)setrlimit(RLIMIT_DATA, &data);
  (void)setpriority(PRIO_PROCESS, 0, 10); // after capture and training
}

// --- Landlock ------------------------------------------------------------------------------------
// The numbers are the kernel's interface; headers of older distributions lack the later ones.
#ifndef SYS_landlock_create_ruleset
#define SYS_landlock_create_ruleset 444
#define SYS_landlock_restrict_self  446
#endif
typedef struct {
  __u64 handled_access_fs, handled_access_net;
} ruleset;

// A ruleset that handles all accesses and allows none. Returns the ABI, 0 when the kernel has none.
static int forbid_files(void) {
  long abi = syscall(SYS_landlock_create_ruleset, NULL, 0, 1u);
  if (abi < 1) return 0;
  ruleset r = {.handled_access_fs = abi >= 5   ? 0xffff
                                    : abi >= 3 ? 0x7fff
                                    : abi == 2 ? 0x3fff
                                               : 0x1fff,
               .handled_access_net = abi >= 4 ? 3 : 0}; // bind and connect
  long fd = syscall(SYS_landlock_create_ruleset, &r, abi >= 4 ? sizeof r : sizeof r.handled_access_fs, 0u);
  if (fd < 0) return 0;
  long done = syscall(SYS_landlock_restrict_self, (int)fd, 0u);
  close((int)fd);
  return done == 0 ? (int)abi : 0;
}

// --- seccomp -------------------------------------------------------------------------------------
#if defined(__has_include) && __has_include(<seccomp.h>)
#include <seccomp.h>

// What a server on an open socket needs, and the allocator. All else fails with EPERM.
static const int allowed[] = {SCMP_SYS(read),
                              SCMP_SYS(write),
                              SCMP_SYS(readv),
                              SCMP_SYS(writev),
                              SCMP_SYS(close),
                              SCMP_SYS(recvfrom),
                              SCMP_SYS(recvmsg),
                              SCMP_SYS(sendto),
                              SCMP_SYS(sendmsg),
                              SCMP_SYS(accept4),
                              SCMP_SYS(accept),
                              SCMP_SYS(shutdown),
                              SCMP_SYS(setsockopt),
                              SCMP_SYS(getsockopt),
                              SCMP_SYS(getsockname),
                              SCMP_SYS(getpeername),
                              SCMP_SYS(epoll_wait),
                              SCMP_SYS(epoll_pwait),
                              SCMP_SYS(epoll_ctl),
                              SCMP_SYS(poll),
                              SCMP_SYS(ppoll),
                              SCMP_SYS(fcntl),
                              SCMP_SYS(brk),
                              SCMP_SYS(munmap),
                              SCMP_SYS(mremap),
                              SCMP_SYS(madvise),
                              SCMP_SYS(futex),
                              SCMP_SYS(clock_gettime),
                              SCMP_SYS(nanosleep),
                              SCMP_SYS(gettimeofday),
                              SCMP_SYS(time),
                              SCMP_SYS(clock_nanosleep),
                              SCMP_SYS(getrandom),
                              SCMP_SYS(getpid),
                              SCMP_SYS(gettid),
                              SCMP_SYS(getppid),
                              SCMP_SYS(exit),
                              SCMP_SYS(exit_group),
                              SCMP_SYS(rt_sigreturn),
                              SCMP_SYS(rt_sigprocmask),
                              SCMP_SYS(ioctl),
                              SCMP_SYS(rt_sigaction),
                              SCMP_SYS(restart_syscall)};

static int filter(void) {
  scmp_filter_ctx c = seccomp_init(SCMP_ACT_ERRNO(EPERM));
  if (!c) return -1;
  int r = 0;
  for (size_t i = 0; r == 0 && i < sizeof allowed / sizeof *allowed; i++)
    r = seccomp_rule_add(c, SCMP_ACT_ALLOW, allowed[i], 0);
  // Memory, but never memory that runs; kill(0): is the writer of the feed still there?
  if (r == 0) r = seccomp_rule_add(c, SCMP_ACT_ALLOW, SCMP_SYS(mmap), 1, SCMP_A2(SCMP_CMP_MASKED_EQ, 4, 0));
  if (r == 0)
    r = seccomp_rule_add(c, SCMP_ACT_ALLOW, SCMP_SYS(mprotect), 1, SCMP_A2(SCMP_CMP_MASKED_EQ, 4, 0));
  if (r == 0) r = seccomp_rule_add(c, SCMP_ACT_ALLOW, SCMP_SYS(kill), 1, SCMP_A1(SCMP_CMP_EQ, 0));
  if (r == 0) r = seccomp_load(c);
  seccomp_release(c);
  return r;
}
#else
static int filter(void) { return -ENOSYS; }
#endif

sv_status pv_sandbox_enter(char *text, size_t cap, sv_err *err) {
  struct tm tm;
  time_t now = time(NULL);
  (void)gmtime_r(&now, &tm); // reads the time zone's file once, which will not be possible any more
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0)
    return sv_fail(err, SV_E_DEVICE, "sandbox: no_new_privs cannot be set (%s)", sv_linux_reason(errno));
  int abi = forbid_files();
  int r = filter();
  if (r != 0)
    return sv_fail(err, SV_E_DEVICE, "sandbox: the seccomp filter cannot be set (%s)", sv_linux_reason(-r));
  if (abi) sv_fmt(text, cap, "seccomp, no_new_privs, Landlock (ABI %d)", abi);
  else sv_fmt(text, cap, "seccomp, no_new_privs; this kernel has no Landlock");
  return SV_OK;
}
