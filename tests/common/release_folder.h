// SPDX-License-Identifier: Apache-2.0
// Makes a small folder of exactly the form of the paper's authors' release and of what their
// `prepare` leaves, from scenes of the simulator. It owns the pictures while they grow; it never
// reads what it wrote.
#ifndef SV_TESTS_COMMON_RELEASE_FOLDER_H
#define SV_TESTS_COMMON_RELEASE_FOLDER_H

#ifdef __cplusplus
extern "C" {
#endif

// Sizes of its pictures, and counts.
#define RELEASE_LF_W     216 // sub-views of the light field, 9 x 9 of them
#define RELEASE_LF_H     162
#define RELEASE_PHOTO_W  64 // photos and videos
#define RELEASE_PHOTO_H  48
#define RELEASE_SIDE     96 // synthetic
#define RELEASE_N_EVAL   4  // frames of an evaluation video
#define RELEASE_N_TRAIN  8  // of each training video
#define RELEASE_N_FRAMES 19 // of each moving stream: no multiple of 8
#define RELEASE_N_TEST   12 // synthetic test views
#define RELEASE_SENSOR_W 516
#define RELEASE_SENSOR_H 400
#define RELEASE_N_LENSES 4

// ROOT/data/{casual,dynamic,multiplexed,synthetic} with one scene, toy. Fails the test when it
// cannot be written.
void release_folder_make(const char *root);

#ifdef __cplusplus
}
#endif
#endif
