// SPDX-License-Identifier: Apache-2.0
// Who may ask: names of this machine, pages of this server, holders of the token.
#include <arpa/inet.h>
#include <string.h>
#include <strings.h>

#include "platform/preview/preview.h"

// Splits "name[:port]" or "[v6][:port]". False when it is neither.
static bool split_host(const char *host, char *name, size_t cap, int *port) {
  const char *end, *rest;
  *port = 80;
  if (*host == '[') {
    end = strchr(host, ']');
    if (!end) return false;
    host++;
    rest = end + 1;
  } else {
    end = host + strcspn(host, ":");
    rest = end;
  }
  size_t n = (size_t)(end - host);
  if (n == 0 || n >= cap) return false;
  memcpy(name, host, n);
  name[n] = 0;
  if (!*rest) return true;
  long long v;
  if (*rest != ':' || !sv_parse_int(rest + 1, strlen(rest + 1), &v) || v < 1 || v > 65535) return false;
  *port = (int)v;
  return true;
}

// A page of a foreign name that was made to point here (DNS rebinding) sends that name; numbers
// cannot be rebound.
bool pv_host_is_ours(const char *host, int port, const char *machine_name) {
  char name[256], local[256];
  unsigned char raw[16];
  int given;
  if (!host || !split_host(host, name, sizeof name, &given) || given != port) return false;
  if (inet_pton(AF_INET, name, raw) == 1 || inet_pton(AF_INET6, name, raw) == 1) return true;
  sv_fmt(local, sizeof local, "%s.local", machine_name);
  // .local is asked of this network alone (mDNS)
  return !strcasecmp(name, "localhost") || !strcasecmp(name, "subview.local") ||
         (*machine_name && !strcasecmp(name, machine_name)) || (*machine_name && !strcasecmp(name, local));
}

bool pv_origin_is_ours(const char *origin, const char *scheme, const char *host) {
  const size_t n = strlen(scheme);
  return !origin ||
         (!strncmp(origin, scheme, n) && !strncmp(origin + n, "://", 3) && !strcasecmp(origin + n + 3, host));
}

bool pv_token_is(const char *given, const char *token) {
  const size_t n = strlen(token), n_given = given ? strlen(given) : 0;
  if (n == 0) return false;
  size_t differs = n ^ n_given;
  for (size_t i = 0; i < n; i++) differs |= (size_t)((i < n_given ? given[i] : 0) ^ token[i]);
  return differs == 0;
}

sv_status pv_token_check(const char *token, sv_err *err) {
  static const char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
  const size_t n = strlen(token), n_good = strspn(token, alphabet);
  if (n >= PV_MIN_TOKEN && n <= PV_CAP_TOKEN && n_good == n) return SV_OK;
  if (n_good < n)
    return sv_fail(err, SV_E_ARG,
                   "SUBVIEW_PREVIEW_TOKEN: character %zu is none of A-Z a-z 0-9 - _; choose another token",
                   n_good + 1);
  return sv_fail(err, SV_E_ARG, "SUBVIEW_PREVIEW_TOKEN has %zu characters; expected %d to %d", n,
                 PV_MIN_TOKEN, PV_CAP_TOKEN);
}
