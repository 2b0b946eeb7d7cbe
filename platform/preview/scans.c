// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/scans.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define ANSWER_MS 2000

const char *pv_scan_file_name(int i) {
  static const char *const names[PV_N_SCAN_FILE] = {"model.ply", "preview.jpg", "run.json", "motion.bin",
                                                    "mesh.ply",  "mesh.glb",    "mesh.obj", "model.svseq",
                                                    "model.sog", "model.html",  "model.glb"};
  return i < 0 || i >= PV_N_SCAN_FILE ? NULL : names[i];
}

bool pv_scan_folder_name(const pv_scans_place *p, uint32_t number, char *out, size_t cap) {
  if (!p->name[0]) return sv_fmt(out, cap, "%04u", number) < cap;
  if (number == 1) return sv_copy(out, cap, p->name);
  return sv_fmt(out, cap, "%s-%u", p->name, number) < cap;
}

static bool receive(pv_scans *s, int *file_fd) {
  union {
    struct cmsghdr head;
    char room[CMSG_SPACE(sizeof(int))];
  } control;
  struct iovec part = {&s->answer, sizeof s->answer};
  struct msghdr m = {
      .msg_iov = &part, .msg_iovlen = 1, .msg_control = control.room, .msg_controllen = sizeof control.room};
  struct pollfd p = {.fd = s->fd, .events = POLLIN};
  if (poll(&p, 1, ANSWER_MS) != 1) return false;
  const ssize_t n = recvmsg(s->fd, &m, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
  const struct cmsghdr *c = n > 0 ? CMSG_FIRSTHDR(&m) : NULL;
  if (c && c->cmsg_level == SOL_SOCKET && c->cmsg_type == SCM_RIGHTS) {
    int fd;
    memcpy(&fd, CMSG_DATA(c), sizeof fd);
    if (file_fd) *file_fd = fd;
    else close(fd);
  }
  return n == (ssize_t)sizeof s->answer && s->answer.n <= PV_CAP_SCANS;
}

sv_status pv_scans_request(pv_scans *s, pv_scans_ask ask, int *file_fd) {
  if (file_fd) *file_fd = -1;
  if (s->fd < 0) return SV_E_NOT_FOUND;
  if (write(s->fd, &ask, sizeof ask) == (ssize_t)sizeof ask && receive(s, file_fd)) return SV_OK;
  // A late answer would be taken for that of the next question
  if (file_fd && *file_fd >= 0) close(*file_fd);
  close(s->fd);
  s->fd = -1;
  return SV_E_IO;
}

void pv_scans_json(pv_scans *s, sv_str *o) {
  const sv_status r = pv_scans_request(s, (pv_scans_ask){.op = PV_SCANS_LIST}, NULL);
  const pv_scans_answer *a = &s->answer;
  if (r != SV_OK || a->error) {
    sv_str_add(o, "{\"error\":\"%s\",\"scans\":[]}",
               r == SV_E_NOT_FOUND ? "this run keeps no scans" : "the folder of the scans cannot be read");
    return;
  }
  sv_str_add(o, "{\"free\":%llu,\"total\":%llu,\"exports\":%s,\"scans\":[", (unsigned long long)a->free_bytes,
             (unsigned long long)a->total_bytes, s->has_exports ? "true" : "false");
  for (uint32_t i = 0; i < a->n; i++) {
    const pv_scan *v = &a->scan[i];
    char name[300];
    if (!pv_scan_folder_name(&s->place, v->number, name, sizeof name)) continue;
    sv_str_add(o, "%s{\"number\":%u,\"name\":\"", i ? "," : "", v->number);
    sv_str_add_json(o, name);
    sv_str_add(o, "\",\"deleted\":%s,\"time\":%lld,\"bytes\":%llu,\"files\":{",
               v->is_deleted ? "true" : "false", (long long)v->time_s, (unsigned long long)v->bytes);
    for (int k = 0, n = 0; k < PV_N_SCAN_FILE; k++)
      if (v->file_bytes[k])
        sv_str_add(o, "%s\"%s\":%llu", n++ ? "," : "", pv_scan_file_name(k),
                   (unsigned long long)v->file_bytes[k]);
    sv_str_add(o, "}}");
  }
  sv_str_add(o, "]}");
}
