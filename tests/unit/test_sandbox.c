// SPDX-License-Identifier: Apache-2.0
// The sandbox of subview-preview from the inside: a process enters it and then tries what a
// compromised server would. Each attempt must fail, and the process outside that it aims at must
// live. Runs as root, as another user, and as root of a user namespace.
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "platform/preview/preview.h"
#include "tests/common/test.h"

#define USER       65533 // some user, who is neither root nor nobody
#define FIRST_LEAK 40    // descriptors that a parent forgot to close

typedef enum { AS_ROOT, AS_USER, AS_ROOT_OF_NAMESPACE } starter;

// What the process in the sandbox has at hand. All of it is opened before it enters.
typedef struct {
  pid_t victim;     // a process outside, of the same user when this was not root
  int tty;          // a terminal: it was controlling before
  int socket, peer; // connected
  int unconnected;
  void *page; // of data
} inside;

static inside in;

// --- attempts ------------------------------------------------------------------------------------
// Each returns what the system call did: below 0 is a failure.

static long type_into_terminal(void) { return ioctl(in.tty, TIOCSTI, "x"); }
// The kernel takes 32 bits of a command, a filter sees 64.
static long type_with_high_bits(void) {
  return syscall(SYS_ioctl, in.tty, (unsigned long)TIOCSTI | 1ul << 32, "x");
}
static long set_terminal(void) {
  struct winsize w = {.ws_row = 1, .ws_col = 1};
  return ioctl(in.tty, TIOCSWINSZ, &w);
}
static long own(void) { return fcntl(in.socket, F_SETOWN, in.victim); }
static long choose_signal(void) { return fcntl(in.socket, F_SETSIG, SIGKILL); }
static long send_signals(void) { return fcntl(in.socket, F_SETFL, O_NONBLOCK | O_ASYNC); }
static long own_ex(void) {
  struct f_owner_ex o = {.type = F_OWNER_PID, .pid = in.victim};
  return fcntl(in.socket, F_SETOWN_EX, &o);
}
static long own_with_high_bits(void) {
  return syscall(SYS_fcntl, in.socket, (unsigned long)F_SETOWN | 1ul << 32, in.victim);
}
static long own_by_ioctl(void) { return ioctl(in.socket, FIOSETOWN, &in.victim); }
static long send_signals_by_ioctl(void) {
  int on = 1;
  return ioctl(in.socket, FIOASYNC, &on);
}
static long lease(void) { return fcntl(in.socket, F_SETLEASE, F_RDLCK); }
static long copy_descriptor(void) { return fcntl(in.socket, F_DUPFD, 60); }
static long kill_victim(void) { return kill(in.victim, SIGKILL); }
static long kill_thread(void) { return syscall(SYS_tgkill, in.victim, in.victim, SIGKILL); }
static long kill_all(void) { return kill(-1, SIGKILL); }
static long queue_signal(void) {
  siginfo_t info = {.si_signo = SIGKILL, .si_code = SI_QUEUE};
  return syscall(SYS_rt_sigqueueinfo, in.victim, SIGKILL, &info);
}
static long open_pidfd(void) { return syscall(434, in.victim, 0); } // pidfd_open
static long open_file(void) { return syscall(SYS_openat, AT_FDCWD, "/etc/passwd", O_RDONLY); }
static long make_file(void) { return syscall(SYS_openat, AT_FDCWD, "/tmp/x", O_RDWR | O_CREAT, 0600); }
static long open_file_2(void) {
  uint64_t how[3] = {O_RDONLY};
  return syscall(437, AT_FDCWD, "/etc/passwd", how, sizeof how); // openat2
}
static long make_memory_file(void) { return syscall(SYS_memfd_create, "x", 0); }
static long make_socket(void) { return socket(AF_INET, SOCK_STREAM, 0); }
static long make_unix_socket(void) { return socket(AF_UNIX, SOCK_STREAM, 0); }
static long make_pair(void) {
  int fd[2];
  return socketpair(AF_UNIX, SOCK_STREAM, 0, fd);
}
static long connect_elsewhere(void) {
  struct sockaddr_in a = {
      .sin_family = AF_INET, .sin_port = htons(9), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  long r = connect(in.unconnected, (struct sockaddr *)&a, sizeof a);
  return r < 0 && errno == ECONNREFUSED ? 0 : r; // refused by the other end: it was reached
}
static long fast_open_elsewhere(void) { // connects by sending
  struct sockaddr_in a = {
      .sin_family = AF_INET, .sin_port = htons(9), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  long r = sendto(in.unconnected, "x", 1, MSG_FASTOPEN | MSG_NOSIGNAL, (struct sockaddr *)&a, sizeof a);
  return r < 0 && errno == ECONNREFUSED ? 0 : r;
}
static long fast_open_by_message(void) {
  struct sockaddr_in a = {
      .sin_family = AF_INET, .sin_port = htons(9), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  struct iovec part = {"x", 1};
  struct msghdr m = {.msg_name = &a, .msg_namelen = sizeof a, .msg_iov = &part, .msg_iovlen = 1};
  long r = sendmsg(in.unconnected, &m, MSG_FASTOPEN | MSG_NOSIGNAL);
  return r < 0 && errno == ECONNREFUSED ? 0 : r;
}
static long bind_port(void) {
  struct sockaddr_in a = {.sin_family = AF_INET};
  return bind(in.unconnected, (struct sockaddr *)&a, sizeof a);
}
static long listen_more(void) { return listen(in.unconnected, 1); }
static long set_option(void) {
  int on = 1;
  return setsockopt(in.socket, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
}
static long run_program(void) {
  char *words[] = {"/bin/true", NULL};
  return execve("/bin/true", words, words + 1);
}
static long make_process(void) {
  long pid = syscall(SYS_clone, SIGCHLD, NULL, NULL, NULL, NULL);
  if (pid == 0) _exit(0);
  return pid;
}
static long trace(void) { return ptrace(PTRACE_ATTACH, in.victim, NULL, NULL); }
static long read_memory(void) {
  char text[8];
  struct iovec here = {text, sizeof text}, there = {in.page, sizeof text};
  return syscall(SYS_process_vm_readv, in.victim, &here, 1, &there, 1, 0);
}
static long map_code(void) {
  void *p = mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return p == MAP_FAILED ? -1 : 0;
}
static long make_code(void) { return mprotect(in.page, 4096, PROT_READ | PROT_EXEC); }
static long become_root(void) { return syscall(SYS_setresuid, 0, 0, 0); }
static long set_dumpable(void) { return prctl(PR_SET_DUMPABLE, 1, 0, 0, 0); }
static long leave_namespace(void) { return syscall(SYS_unshare, CLONE_NEWUSER); }
static long mount_something(void) { return syscall(SYS_mount, "none", "/tmp", "tmpfs", 0, NULL); }
static long change_root(void) { return syscall(SYS_chroot, "/"); }
static long load_program(void) { return syscall(SYS_bpf, 0, NULL, 0); }
static long make_uring(void) {
  char p[120] = {0};
  return syscall(425, 1, p); // io_uring_setup
}
static long raise_limit(void) {
  struct {
    uint64_t now, most;
  } l = {1 << 20, 1 << 20};
  return syscall(SYS_prlimit64, 0, 7, &l, NULL); // RLIMIT_NOFILE
}

typedef struct {
  const char *name;
  long (*fn)(void);
  bool is_relaxed; // for sanitizers
} attempt;
static const attempt attempts[] = {
    {"TIOCSTI", type_into_terminal, false},
    {"TIOCSTI with high bits", type_with_high_bits, false},
    {"TIOCSWINSZ", set_terminal, false},
    {"F_SETOWN", own, false},
    {"F_SETSIG", choose_signal, false},
    {"F_SETFL with O_ASYNC", send_signals, false},
    {"F_SETOWN_EX", own_ex, false},
    {"F_SETOWN with high bits", own_with_high_bits, false},
    {"FIOSETOWN", own_by_ioctl, false},
    {"FIOASYNC", send_signals_by_ioctl, false},
    {"F_SETLEASE", lease, false},
    {"F_DUPFD", copy_descriptor, false},
    {"kill", kill_victim, false},
    {"tgkill", kill_thread, true},
    {"kill of all", kill_all, false},
    {"rt_sigqueueinfo", queue_signal, false},
    {"pidfd_open", open_pidfd, false},
    {"open", open_file, true},
    {"create", make_file, true},
    {"openat2", open_file_2, false},
    {"memfd_create", make_memory_file, false},
    {"socket", make_socket, false},
    {"Unix socket", make_unix_socket, false},
    {"socketpair", make_pair, false},
    {"connect", connect_elsewhere, false},
    {"bind", bind_port, false},
    {"listen", listen_more, false},
    {"setsockopt", set_option, false},
    {"execve", run_program, false},
    {"clone", make_process, false},
    {"ptrace", trace, false},
    {"process_vm_readv", read_memory, false},
    {"mmap of code", map_code, false},
    {"mprotect to code", make_code, false},
    {"setresuid to root", become_root, false},
    {"PR_SET_DUMPABLE", set_dumpable, false},
    {"unshare", leave_namespace, false},
    {"mount", mount_something, false},
    {"chroot", change_root, false},
    {"bpf", load_program, false},
    {"io_uring_setup", make_uring, false},
    {"prlimit64", raise_limit, true},
    {"sendto with MSG_FASTOPEN", fast_open_elsewhere, false},
    {"sendmsg with MSG_FASTOPEN", fast_open_by_message, false},
};
#define N_ATTEMPTS (sizeof attempts / sizeof *attempts)

// --- the process in the sandbox ------------------------------------------------------------------

typedef struct {
  sv_status status;
  char text[256];
  long result[N_ATTEMPTS];
  int reason[N_ATTEMPTS];
  bool can_serve; // what the server needs still works
} report_t;

typedef struct {
  pid_t pid, victim;
  int from_fd, go_fd; // it sends its report, then waits until go_fd closes
} prisoner;

static void write_file(const char *path, const char *text) {
  int fd = open(path, O_WRONLY | O_CLOEXEC);
  if (fd < 0 || write(fd, text, strlen(text)) < 0) _exit(96);
  close(fd);
}

// A test that is not root's runs as its own user.
static int user_id(void) { return geteuid() == 0 ? USER : (int)geteuid(); }

// False: this machine does not allow it.
static bool become(starter who) {
  const gid_t id = USER;
  if (who == AS_ROOT || (who == AS_USER && geteuid() != 0)) return true;
  if (who == AS_USER)
    return setgroups(0, NULL) == 0 && setresgid(id, id, id) == 0 && setresuid(id, id, id) == 0;
  char map[32];
  snprintf(map, sizeof map, "0 %d 1", (int)geteuid());
  if (unshare(CLONE_NEWUSER) != 0) return false;
  write_file("/proc/self/setgroups", "deny");
  write_file("/proc/self/uid_map", map);
  return true;
}

// Sockets that the server has, beside a terminal that it should not have.
static void open_all(int peer) {
  int sockets[2], controller;
  if (openpty(&controller, &in.tty, NULL, NULL, NULL) != 0) _exit(95);
  in.socket = socket(AF_INET, SOCK_STREAM, 0);
  in.unconnected = socket(AF_INET, SOCK_STREAM, 0);
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, sockets) != 0) _exit(95);
  dup2(sockets[0], in.socket);
  close(sockets[0]);
  dup2(sockets[1], peer);
  in.peer = peer;
  in.page = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
}

static bool can_serve(void) {
  char byte = 'x';
  int flags = fcntl(in.socket, F_GETFL);
  struct pollfd p = {.fd = in.socket, .events = POLLIN};
  void *memory = mmap(NULL, 1 << 20, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  int on = 1;
  return flags >= 0 && fcntl(in.socket, F_SETFL, flags | O_NONBLOCK) == 0 &&
         send(in.socket, &byte, 1, 0) == 1 && poll(&p, 1, 0) >= 0 && memory != MAP_FAILED &&
         setsockopt(in.unconnected, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on) == 0 && kill(getpid(), 0) == 0;
}

static void live_in_sandbox(starter who, int report_fd, int go_fd) {
  static report_t r;
  sv_err err = {0};
  char byte;
  setsid();
  for (int i = 0; i < 3; i++) (void)open("/etc/passwd", O_RDONLY); // what a parent forgot
  dup2(0, FIRST_LEAK);
  dup2(0, 251);
  if (!become(who)) _exit(94);
  r.status = pv_sandbox_begin(report_fd, go_fd, &err);
  open_all(FIRST_LEAK + 1);
  ioctl(in.tty, TIOCSCTTY, 0);
  if (r.status >= 0) r.status = pv_sandbox_enter(r.text, sizeof r.text, &err);
  if (r.status < 0) snprintf(r.text, sizeof r.text, "%.200s", err.text);
  r.can_serve = can_serve();
  for (size_t i = 0; r.status >= 0 && i < N_ATTEMPTS; i++) {
    if (PV_IS_SANITIZED && attempts[i].is_relaxed) {
      r.result[i] = -1;
      continue;
    }
    errno = 0;
    r.result[i] = attempts[i].fn();
    r.reason[i] = errno;
  }
  // With F_SETOWN, F_SETSIG and O_ASYNC in effect, this byte would kill the victim.
  (void)!write(in.peer, "x", 1);
  (void)!write(report_fd, &r, sizeof r);
  (void)!read(go_fd, &byte, 1);
  _exit(0);
}

static void imprison(prisoner *p, starter who, report_t *r) {
  int from[2], go[2];
  p->victim = fork();
  if (p->victim == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (who == AS_USER) (void)become(who);
    for (;;) pause();
  }
  in.victim = p->victim;
  assert_int_equal(pipe(from), 0);
  assert_int_equal(pipe(go), 0);
  fcntl(from[1], F_SETPIPE_SZ, 1 << 16);
  p->pid = fork();
  if (p->pid == 0) {
    close(go[1]);
    live_in_sandbox(who, from[1], go[0]);
  }
  close(from[1]);
  close(go[0]);
  p->from_fd = from[0];
  p->go_fd = go[1];
  size_t n = 0;
  for (ssize_t more; n < sizeof *r && (more = read(p->from_fd, (char *)r + n, sizeof *r - n)) > 0;)
    n += (size_t)more;
  if (n < sizeof *r) r->status = 1; // it ended before
}

static int release(prisoner *p) {
  int status;
  close(p->go_fd);
  close(p->from_fd);
  waitpid(p->pid, &status, 0);
  kill(p->victim, SIGKILL);
  waitpid(p->victim, NULL, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// --- from outside --------------------------------------------------------------------------------

static void must_say(pid_t pid, const char *key, const char *want) {
  char path[64], line[256];
  snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
  FILE *f = fopen(path, "r");
  assert_non_null(f);
  bool is_found = false;
  while (fgets(line, sizeof line, f))
    if (!strncmp(line, key, strlen(key))) {
      is_found = true;
      line[strcspn(line, "\n")] = 0;
      if (strncmp(line + strlen(key), want, strlen(want)) != 0)
        fail_msg("%s, expected %s%s", line, key, want);
    }
  fclose(f);
  assert_true(is_found);
}

static void check_identity(const prisoner *p, starter who) {
  static const char *const sets[] = {"CapInh:\t", "CapPrm:\t", "CapEff:\t", "CapAmb:\t"};
  static const char none[] = "0000000000000000";
  char user[64];
  int id = who == AS_USER ? user_id() : 65534;
  snprintf(user, sizeof user, "%d\t%d\t%d\t%d", id, id, id, id);
  if (who != AS_ROOT_OF_NAMESPACE) {
    must_say(p->pid, "Uid:\t", user);
    if (geteuid() == 0) must_say(p->pid, "Gid:\t", user);
    if (geteuid() == 0) must_say(p->pid, "Groups:\t", " ");
  }
  for (int i = 0; i < 4; i++) must_say(p->pid, sets[i], none);
  if (who == AS_ROOT) must_say(p->pid, "CapBnd:\t", none);
  must_say(p->pid, "NoNewPrivs:\t", "1");
  must_say(p->pid, "Seccomp:\t", "2");
  assert_int_equal(getsid(p->pid), p->pid);
  // Of a process that cannot be dumped or traced, all of /proc is root's.
  struct stat st;
  char path[64];
  snprintf(path, sizeof path, "/proc/%d/environ", (int)p->pid);
  assert_int_equal(stat(path, &st), 0);
  if (!PV_IS_SANITIZED) assert_int_equal(st.st_uid, 0);
}

// Only what was kept and what was opened since.
static void check_descriptors(const prisoner *p) {
  char path[64], target[128];
  for (int fd = 0; fd < 300; fd++) {
    snprintf(path, sizeof path, "/proc/%d/fd/%d", (int)p->pid, fd);
    ssize_t n = readlink(path, target, sizeof target - 1);
    if (n < 0) continue;
    target[n] = 0;
    if (strstr(target, "/etc/passwd") || fd == FIRST_LEAK || fd == 251)
      fail_msg("%d is open: %s", fd, target);
    if (fd > 0 && (fd > 2 || PV_IS_SANITIZED)) continue;
    assert_string_equal(target, "/dev/null");
  }
}

static void check(starter who) {
  static report_t r;
  prisoner p;
  int n_failed = 0;
  const char *emulate = getenv("SV_EMULATE");
  if ((emulate && *emulate) || (who == AS_ROOT && geteuid() != 0)) {
    print_message("skip sandbox: %s\n", who == AS_ROOT ? "needs root" : "an emulator has no seccomp");
    skip();
  }
  imprison(&p, who, &r);
  if (r.status == 1) {
    int code = release(&p);
    if (code != 94) fail_msg("the process in the sandbox ended with %d", code);
    print_message("skip sandbox: this machine has no user namespaces\n");
    skip();
  }
  if (r.status < 0) fail_msg("%s", r.text);
  assert_true(r.can_serve);
  for (size_t i = 0; i < N_ATTEMPTS; i++) {
    if (r.result[i] < 0) continue;
    print_message("%s succeeds in the sandbox\n", attempts[i].name);
    n_failed++;
  }
  bool is_alive = waitpid(p.victim, NULL, WNOHANG) == 0;
  print_message("%s: %d of %d attempts succeed, the process outside %s\n", r.text, n_failed, (int)N_ATTEMPTS,
                is_alive ? "lives" : "was killed");
  check_identity(&p, who);
  if (geteuid() == 0) check_descriptors(&p);
  assert_int_equal(release(&p), 0);
  assert_int_equal(n_failed, 0);
  assert_true(is_alive);
}

TEST(test_as_root) { check(AS_ROOT); }
TEST(test_as_user) { check(AS_USER); }
TEST(test_as_root_of_namespace) { check(AS_ROOT_OF_NAMESPACE); }

// The other interface for system calls of the same processor: the process ends.
#if defined(__x86_64__) && !PV_IS_SANITIZED
TEST(test_32_bit_calls) {
  sv_err err;
  char text[256];
  pid_t pid = fork();
  if (pid == 0) {
    long r = 20;                    // getpid
    (void)signal(SIGSEGV, SIG_DFL); // of kernels without that interface; cmocka would catch it
    if (pv_sandbox_begin(-1, -1, &err) < 0 || pv_sandbox_enter(text, sizeof text, &err) < 0) _exit(1);
    __asm__ volatile("int $0x80" : "+a"(r) : : "memory", "r8", "r9", "r10", "r11");
    _exit(r > 0 ? 2 : 3);
  }
  int status;
  waitpid(pid, &status, 0);
  if (!WIFSIGNALED(status)) fail_msg("a 32-bit call came back: exit %d", WEXITSTATUS(status));
}
#endif

int main(void) {
  const struct CMUnitTest tests[] = {
    cmocka_unit_test(test_as_root),
    cmocka_unit_test(test_as_user),
    cmocka_unit_test(test_as_root_of_namespace),
#if defined(__x86_64__) && !PV_IS_SANITIZED
    cmocka_unit_test(test_32_bit_calls),
#endif
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
