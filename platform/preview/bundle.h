// SPDX-License-Identifier: Apache-2.0
// The page's files as part of the program, and the page of a model alone (viewer.html).
#ifndef SV_PLATFORM_PREVIEW_BUNDLE_H
#define SV_PLATFORM_PREVIEW_BUNDLE_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const char *path, *type;
  const char *text;
  size_t bytes;
} pv_page;
// Page i of the bundle; NULL after the last.
const pv_page *pv_bundle(int i);
// A page without a server: {{title}}, {{worker}}, {{code}} and {{model}} in it are to be replaced,
// the last one by the compact form in base64. Terminated.
const char *pv_viewer(void);

#ifdef __cplusplus
}
#endif
#endif
