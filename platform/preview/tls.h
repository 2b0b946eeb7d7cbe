// SPDX-License-Identifier: Apache-2.0
// Key and certificate of a page over TLS, by GnuTLS: read from a PEM file, which is made when it is
// missing. Owns nothing: the caller has the text. Never sends anything, and is done before the
// sandbox.
#ifndef SV_PLATFORM_PREVIEW_TLS_H
#define SV_PLATFORM_PREVIEW_TLS_H

#include <stdbool.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  char pem[16384];      // key, then certificate
  char fingerprint[96]; // SHA-256 of the certificate, as browsers show it
  bool is_new;          // made now
} pv_tls;

// E_UNSUPPORTED: built without GnuTLS. E_FORMAT: the file has no key with its certificate. E_IO.
sv_status pv_tls_load(pv_tls *t, const char *path, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
