// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <stdlib.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

// Of a processor whose capacity is not told; the fastest of a machine has this one.
#define USUAL_CAPACITY 1024

static long capacity_of(const char *sys, int cpu) {
  char path[300], text[32];
  sv_fmt(path, sizeof path, "%s/devices/system/cpu/cpu%d/cpu_capacity", sys, cpu);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  ssize_t n = fd < 0 ? 0 : read(fd, text, sizeof text - 1);
  if (fd >= 0) close(fd);
  text[n > 0 ? n : 0] = 0;
  long capacity = strtol(text, NULL, 10);
  return capacity > 0 ? capacity : USUAL_CAPACITY;
}

int sv_linux_n_cpus(void) {
  cpu_set_t set;
  return sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
}

int sv_linux_camera_cpu(const char *sys) {
  cpu_set_t set;
  long least = 0;
  int best = -1;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return -1;
  for (int i = 0; i < CPU_SETSIZE; i++) {
    if (!CPU_ISSET(i, &set)) continue;
    const long capacity = capacity_of(sys, i);
    if (best >= 0 && capacity >= least) continue;
    best = i;
    least = capacity;
  }
  return best;
}

sv_status sv_linux_take_cpu(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (cpu < 0 || cpu >= CPU_SETSIZE) return SV_E_ARG;
  CPU_SET(cpu, &set);
  return sched_setaffinity(0, sizeof set, &set) == 0 ? SV_OK : SV_E_RANGE;
}

sv_status sv_linux_leave_cpu(int cpu, sv_err *err) {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof set, &set) != 0)
    return sv_fail(err, SV_E_UNSUPPORTED, "the system does not tell its CPUs: %s", sv_linux_reason(errno));
  if (cpu < 0 || cpu >= CPU_SETSIZE || !CPU_ISSET(cpu, &set))
    return sv_fail(err, SV_E_RANGE, "CPU %d: not one of the %d that this program may use", cpu,
                   CPU_COUNT(&set));
  CPU_CLR(cpu, &set);
  if (CPU_COUNT(&set) == 0)
    return sv_fail(err, SV_E_RANGE, "CPU %d is the only one that this program may use", cpu);
  if (sched_setaffinity(0, sizeof set, &set) != 0)
    return sv_fail(err, SV_E_UNSUPPORTED, "CPU %d cannot be left to the cameras: %s", cpu,
                   sv_linux_reason(errno));
  return SV_OK;
}
