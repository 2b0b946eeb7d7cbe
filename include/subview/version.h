// SPDX-License-Identifier: Apache-2.0
// The version of subview, by semantic versioning (semver.org). This is its only place: programs,
// library and pkg-config file read it here.
// While the major version is 0, a new minor version may change the API; a new patch version does
// not.
#ifndef SUBVIEW_VERSION_H
#define SUBVIEW_VERSION_H

#define SUBVIEW_VERSION_MAJOR 0
#define SUBVIEW_VERSION_MINOR 9
#define SUBVIEW_VERSION_PATCH 0
#define SUBVIEW_VERSION       "0.9.0"

#endif
