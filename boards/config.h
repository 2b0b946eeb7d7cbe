// SPDX-License-Identifier: Apache-2.0
// --config FILE: options of a command in a file, one a line, as rpicam-apps have them:
//   # a comment
//   source=v4l2:/dev/video0
//   session
// Owns the text of the file. An option without a value after "=" is not given. The command line
// wins.
#ifndef SV_BOARDS_CONFIG_H
#define SV_BOARDS_CONFIG_H

// Replaces "--config FILE" among argv by the options of the file, before all others. 0; else the
// exit code after a message. Once in a process.
int config_expand(const char *command, int *argc, char ***argv);

#endif
