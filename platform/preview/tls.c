// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/tls.h"

#include "src/base/str.h"

#if defined(__has_include) && __has_include(<gnutls/x509.h>)
#include <errno.h>
#include <fcntl.h>
#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>
#include <gnutls/x509.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/linux.h"

// Fixed: boards without a clock would make certificates that are not valid yet.
#define VALID_FROM  1704067200 // 2024-01-01
#define VALID_UNTIL 2524607999 // 2049-12-31

typedef struct {
  gnutls_x509_privkey_t key;
  gnutls_x509_crt_t crt;
} pair;

static int open_pair(pair *p) {
  const int r = gnutls_x509_privkey_init(&p->key);
  return r < 0 ? r : gnutls_x509_crt_init(&p->crt);
}

static void close_pair(pair *p) {
  if (p->crt) gnutls_x509_crt_deinit(p->crt);
  if (p->key) gnutls_x509_privkey_deinit(p->key);
}

// --- a new one -----------------------------------------------------------------------------------

static int add_name(gnutls_x509_crt_t c, const char *name) {
  return gnutls_x509_crt_set_subject_alt_name(c, GNUTLS_SAN_DNSNAME, name, (unsigned)strlen(name),
                                              GNUTLS_FSAN_APPEND);
}

// For the names by which the page is asked for; numeric addresses change with the network.
static int add_names(gnutls_x509_crt_t c) {
  char host[128] = "", local[160];
  int r = add_name(c, "subview.local");
  if (r >= 0) r = add_name(c, "localhost");
  if (gethostname(host, sizeof host - 1) != 0 || !host[0]) return r;
  sv_fmt(local, sizeof local, "%s.local", host);
  if (r >= 0) r = add_name(c, host);
  return r < 0 ? r : add_name(c, local);
}

static int make(pair *p) {
  unsigned char serial[16];
  int r = gnutls_rnd(GNUTLS_RND_NONCE, serial, sizeof serial);
  serial[0] &= 0x7f; // positive
  if (r >= 0)
    r = gnutls_x509_privkey_generate(p->key, GNUTLS_PK_ECDSA,
                                     GNUTLS_CURVE_TO_BITS(GNUTLS_ECC_CURVE_SECP256R1), 0);
  if (r >= 0) r = gnutls_x509_crt_set_version(p->crt, 3);
  if (r >= 0) r = gnutls_x509_crt_set_serial(p->crt, serial, sizeof serial);
  if (r >= 0) r = gnutls_x509_crt_set_activation_time(p->crt, VALID_FROM);
  if (r >= 0) r = gnutls_x509_crt_set_expiration_time(p->crt, VALID_UNTIL);
  if (r >= 0) r = gnutls_x509_crt_set_dn_by_oid(p->crt, GNUTLS_OID_X520_COMMON_NAME, 0, "subview", 7);
  if (r >= 0) r = add_names(p->crt);
  if (r >= 0) r = gnutls_x509_crt_set_key(p->crt, p->key);
  if (r >= 0) r = gnutls_x509_crt_set_key_usage(p->crt, GNUTLS_KEY_DIGITAL_SIGNATURE);
  if (r >= 0) r = gnutls_x509_crt_set_key_purpose_oid(p->crt, GNUTLS_KP_TLS_WWW_SERVER, 0);
  return r < 0 ? r : gnutls_x509_crt_sign2(p->crt, p->crt, p->key, GNUTLS_DIG_SHA256, 0);
}

static int export_pair(const pair *p, pv_tls *t) {
  size_t n = sizeof t->pem - 1, m;
  int r = gnutls_x509_privkey_export(p->key, GNUTLS_X509_FMT_PEM, t->pem, &n);
  if (r < 0) return r;
  n = strlen(t->pem);
  m = sizeof t->pem - 1 - n;
  return gnutls_x509_crt_export(p->crt, GNUTLS_X509_FMT_PEM, t->pem + n, &m);
}

// Whole or not at all; nobody else may read it.
static sv_status save(const char *path, const char *text, sv_err *err) {
  char temporary[512];
  if (sv_fmt(temporary, sizeof temporary, "%s.tmp", path) >= sizeof temporary)
    return sv_fail(err, SV_E_RANGE, "%s: too long a path", path);
  (void)unlink(temporary);
  int fd = open(temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600),
      e = fd < 0 ? errno : 0;
  if (!e) e = sv_linux_write_all(fd, text, strlen(text), NULL);
  if (!e && fsync(fd) != 0) e = errno;
  if (fd >= 0) close(fd);
  if (!e && rename(temporary, path) != 0) e = errno;
  return e ? sv_fail(err, SV_E_IO, "%s: the certificate cannot be written: %s", path, sv_linux_reason(e))
           : SV_OK;
}

// --- an earlier one ------------------------------------------------------------------------------

// SV_AGAIN: there is none.
static sv_status read_text(pv_tls *t, const char *path, sv_err *err) {
  int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0 && errno == ENOENT) return SV_AGAIN;
  ssize_t n = fd < 0 ? -1 : read(fd, t->pem, sizeof t->pem - 1);
  if (n < 0) sv_fail(err, SV_E_IO, "%s: the certificate cannot be read: %s", path, sv_linux_reason(errno));
  if (fd >= 0) close(fd);
  if (n < 0) return SV_E_IO;
  t->pem[n] = 0;
  return SV_OK;
}

static int import_pair(pair *p, const pv_tls *t) {
  const gnutls_datum_t text = {(unsigned char *)(uintptr_t)t->pem, (unsigned)strlen(t->pem)};
  unsigned char of_key[32], of_crt[32];
  size_t n = sizeof of_key, m = sizeof of_crt;
  int r = gnutls_x509_privkey_import(p->key, &text, GNUTLS_X509_FMT_PEM);
  if (r >= 0) r = gnutls_x509_crt_import(p->crt, &text, GNUTLS_X509_FMT_PEM);
  if (r >= 0) r = gnutls_x509_privkey_get_key_id(p->key, GNUTLS_KEYID_USE_SHA256, of_key, &n);
  if (r >= 0) r = gnutls_x509_crt_get_key_id(p->crt, GNUTLS_KEYID_USE_SHA256, of_crt, &m);
  if (r < 0) return r;
  return n == m && !memcmp(of_key, of_crt, n) ? 0 : GNUTLS_E_CERTIFICATE_KEY_MISMATCH;
}

static int tell_fingerprint(const pair *p, pv_tls *t) {
  unsigned char hash[32];
  size_t n = sizeof hash;
  const int r = gnutls_x509_crt_get_fingerprint(p->crt, GNUTLS_DIG_SHA256, hash, &n);
  sv_str s = sv_str_make(t->fingerprint, sizeof t->fingerprint);
  for (size_t i = 0; r >= 0 && i < n; i++)
    sv_str_add(&s, "%s%x%x", i ? ":" : "", (unsigned)hash[i] >> 4, hash[i] & 15u);
  return r;
}

sv_status pv_tls_load(pv_tls *t, const char *path, sv_err *err) {
  pair p = {0};
  *t = (pv_tls){.is_new = false};
  sv_status s = read_text(t, path, err);
  if (s < 0) return s;
  t->is_new = s == SV_AGAIN;
  int r = open_pair(&p);
  if (r >= 0) r = t->is_new ? make(&p) : import_pair(&p, t);
  if (r >= 0 && t->is_new) r = export_pair(&p, t);
  if (r >= 0) r = tell_fingerprint(&p, t);
  close_pair(&p);
  if (r < 0)
    return sv_fail(err, SV_E_FORMAT, "%s: %s (%s); remove the file for a new one", path,
                   t->is_new ? "no certificate could be made" : "no key with its certificate",
                   gnutls_strerror(r));
  return t->is_new ? save(path, t->pem, err) : SV_OK;
}

#else
sv_status pv_tls_load(pv_tls *t, const char *path, sv_err *err) {
  *t = (pv_tls){.is_new = false};
  return sv_fail(err, SV_E_UNSUPPORTED, "--tls %s: this build has no TLS (GnuTLS was missing)", path);
}
#endif
