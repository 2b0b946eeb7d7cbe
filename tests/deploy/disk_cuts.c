// SPDX-License-Identifier: Apache-2.0
// What is on a disk after a power cut: QEMU has recorded each write and each flush of the disk
// (block driver blklogwrites; the format is that of Linux's dm-log-writes), and this program plays
// them back.
//
//   disk-cuts list LOG                  a line "flush" or "write" for each record
//   disk-cuts apply LOG A B SEED IMAGE  records A + 1 to B into IMAGE, a disk with the first A.
//                                       SEED above 0: each write is lost by chance, as those in a
//                                       disk's cache are, for which no flush came any more
//   disk-cuts check FOLDER              a line "torn PATH" for each saved file below FOLDER that is
//                                       not whole, "saving NAME" for each temporary file
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "src/base/rng.h"
#include "tests/common/whole.h"

#define MAGIC 0x6a736677736872ull
#define FLUSH 1u
#define FUA   2u

typedef struct {
  uint64_t sector, n_sectors, flags, n_bytes;
} record_head;

typedef struct {
  FILE *f;
  uint32_t sector_bytes;
  long next, data; // offsets of the next record, and of the data of the one that was read
} record_log;

static bool log_open(record_log *l, const char *path) {
  struct {
    uint64_t magic, version, n_records;
    uint32_t sector_bytes, padding;
  } head;
  l->f = fopen(path, "rb");
  if (!l->f || fread(&head, sizeof head, 1, l->f) != 1 || head.magic != MAGIC) return false;
  l->sector_bytes = head.sector_bytes;
  l->next = (long)l->sector_bytes;
  return l->sector_bytes >= 512;
}

// False at the end. The machine was killed, so the log's own count of records may be behind.
static bool log_next(record_log *l, record_head *r) {
  if (fseek(l->f, l->next, SEEK_SET) != 0 || fread(r, sizeof *r, 1, l->f) != 1) return false;
  if (r->n_sectors == 0 && r->flags == 0) return false;
  l->data = l->next + (long)l->sector_bytes;
  l->next = l->data + (long)(r->n_sectors * l->sector_bytes);
  return true;
}

static int list(const char *path) {
  record_log l;
  record_head r;
  if (!log_open(&l, path)) return 1;
  while (log_next(&l, &r)) puts(r.flags & FLUSH ? "flush" : "write");
  return 0;
}

static bool copy_data(const record_log *l, const record_head *r, FILE *image) {
  const size_t n = (size_t)r->n_sectors * l->sector_bytes;
  uint8_t *data = malloc(n);
  bool is_done = data && fseek(l->f, l->data, SEEK_SET) == 0 && fread(data, 1, n, l->f) == n &&
                 fseek(image, (long)(r->sector * l->sector_bytes), SEEK_SET) == 0 &&
                 fwrite(data, 1, n, image) == n;
  free(data);
  return is_done;
}

typedef struct {
  long first, end;
  uint64_t seed;
} part;

static int apply(const char *path, const part *of, const char *image_path) {
  record_log l;
  record_head r;
  sv_rng rng = sv_rng_make(of->seed, 1);
  FILE *image = fopen(image_path, "r+b");
  if (!image || !log_open(&l, path)) return 1;
  for (long i = 0; i < of->end && log_next(&l, &r); i++) {
    if (i < of->first || r.n_sectors == 0) continue;
    const bool is_lost = of->seed && !(r.flags & FUA) && sv_rng_f(&rng) < 0.5F;
    if (!is_lost && !copy_data(&l, &r, image)) return 1;
  }
  return fclose(image) != 0;
}

// True when all files are whole. Lines of a capture that was cut (frames.N.part) may be torn.
static bool check(const char *folder) {
  bool is_good = true;
  DIR *d = opendir(folder);
  for (const struct dirent *e; d && (e = readdir(d));) {
    char path[1000];
    struct stat st;
    size_t n = 0;
    if (e->d_name[0] == '.') continue;
    snprintf(path, sizeof path, "%s/%s", folder, e->d_name);
    if (lstat(path, &st) != 0) continue;
    if (S_ISDIR(st.st_mode)) {
      if (strcmp(e->d_name, "lost+found") != 0) is_good &= check(path);
      continue;
    }
    if (strstr(e->d_name, ".subview-tmp")) printf("saving %.*s\n", (int)strcspn(e->d_name, "."), e->d_name);
    if (strstr(e->d_name, ".subview-tmp") || strstr(e->d_name, ".part")) continue;
    uint8_t *data = whole_read(path, &n);
    const bool is_token = !strcmp(e->d_name, "token"), is_lens = strstr(e->d_name, ".cameramodel") != NULL;
    const bool is_whole = data && (is_token  ? n == 33 && data[32] == '\n'
                                   : is_lens ? n > 4 && data[n - 2] == '}'
                                             : whole_is(e->d_name, data, n));
    if (!is_whole) printf("torn %s\n", path);
    is_good &= is_whole;
    free(data);
  }
  if (d) closedir(d);
  return is_good;
}

int main(int argc, char **argv) {
  if (argc == 3 && !strcmp(argv[1], "list")) return list(argv[2]);
  if (argc == 7 && !strcmp(argv[1], "apply")) {
    const part of = {strtol(argv[3], NULL, 10), strtol(argv[4], NULL, 10), strtoull(argv[5], NULL, 10)};
    return apply(argv[2], &of, argv[6]);
  }
  if (argc == 3 && !strcmp(argv[1], "check")) return !check(argv[2]);
  fprintf(stderr, "usage: disk-cuts list LOG | apply LOG A B SEED IMAGE | check FOLDER\n");
  return 2;
}
