// SPDX-License-Identifier: Apache-2.0
// What a user has, as a dataset: a folder or a .zip that is not one yet is recognized by its files
// and imported beside the output. Never writes into what it was given.
#ifndef SV_TOOLS_IMPORT_FIND_H
#define SV_TOOLS_IMPORT_FIND_H

#include "tools/lab/lab.h"

// The folder with the dataset of --data: o->data itself, when it has a transforms JSON or
// --transforms is given; else OUT/data, imported now, or earlier from the same files. Tells what
// was recognized in one line. E_NOT_FOUND names the files found and those expected.
sv_status lab_find_dataset(const lab_options *o, char folder[SV_CAP_PATH], sv_err *err) SV_MUST_USE;

#endif
