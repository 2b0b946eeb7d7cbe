// SPDX-License-Identifier: Apache-2.0
// subview-lab: trains, evaluates and renders on datasets, with the same arena-bound core as the
// runtime.
#include <stdio.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/lab/lab.h"

static const lab_command commands[] = {
    {{"train", "--data DIR --out DIR [options]", "train Gaussians on a dataset",
      "Trains a fixed number of Gaussians on a dataset and writes DIR/model.ply and DIR/train.json. With "
      "--eval\nit also scores held-out views and writes some of them (ground truth beside rendering) to "
      "DIR/eval/.\nMemory is planned from the dataset and the options and allocated once. Ctrl-C stops early "
      "and saves the\nmodel. Distorted images are undistorted while loading.",
      "  subview-lab train --data tests/data/mic_200 --gaussians 5000 --steps 2000 --eval --out out/mic\n"
      "  subview-lab eval --data tests/data/mic_200 --model out/mic/model.ply --json",
      LAB_TRAIN},
     lab_cmd_train},
    {{"eval", "--data DIR --model FILE [options]", "score a model on held-out views",
      "Renders each view of a split and compares it with the dataset's image: PSNR and SSIM per view, then "
      "the\nmean; with ground-truth depth also its relative and RMS error. Scale and background are taken "
      "from\ntrain.json beside the model unless given.",
      "  subview-lab eval --data blender_tree --model tree/model.ply --split test_near --depth --json",
      LAB_EVAL},
     lab_cmd_eval},
    {{"compare", "--data DIR --model A.ply B.ply ... --out SHEET.png [options]",
      "compare models with ground truth in one image",
      "Renders views of a split with each model and writes one sheet: a row per view, a column for the "
      "dataset's\nimages and one per model, with PSNR in the images and its mean over all views of the split "
      "above. PSNR is\nthat of eval. Scale and split are taken from the first model's train.json unless "
      "given.",
      "  subview-lab compare --data garden_data --model a/model.ply b/model.ply --labels 'before,after' "
      "--out "
      "sheet.png",
      LAB_COMPARE},
     lab_cmd_compare},
    {{"mesh", "--data DIR --model FILE --out FILE [options]", "a triangle mesh of a model",
      "Renders depth and color from the training views, fuses them into a signed distance field and writes\n"
      "its surface with a color at each vertex: a PLY, OBJ or GLB (Y-up), by the name of FILE. Parts that "
      "few\n"
      "views saw, and small loose parts, are left out.",
      "  subview-lab mesh --data blender_tree --model tree/model.ply --out tree.glb", LAB_MESH},
     lab_cmd_mesh},
    {{"measure", "--data DIR --model FILE --view I --from X,Y --to X,Y [options]",
      "a distance on the surface",
      "Renders the depth of a view and prints the distance between the surface points at two of its pixels, "
      "in\n"
      "the scene's unit (meters where the model says so), with the half width of a 90 % interval from how "
      "well\n"
      "the model tells the depth there and, where the model says so, from how well its scale is known.",
      "  subview-lab measure --data out/demo/data --model out/demo/stereo/model.ply --view 0 --from 100,120 "
      "--to "
      "200,120",
      LAB_MEASURE},
     lab_cmd_measure},
    {{"info", "--data DIR | --rig DIR --distance M [options]", "views, exposures and angular baseline",
      "Prints what a split of a dataset holds, and the angular baseline theta: the largest angle between "
      "two\n"
      "sub-views of an exposure, seen from the centroid of the dataset's points; without points from the "
      "point\nnearest to all optical axes; of a rig from the point so many meters before it.",
      "  subview-lab info --data garden_data\n"
      "  subview-lab info --rig rig --distance 1.5 --json",
      LAB_INFO},
     lab_cmd_info},
    {{"render", "[--data DIR] --model FILE --out DIR|NAME.mp4|NAME.webm|NAME.webp [options]",
      "render images of a model",
      "Writes a PNG for each view of a split, or for N views on a circle around the scene. With --depth "
      "also\n16-bit PNGs of the depth along the optical axis; views.json has their unit and each view's "
      "camera. Orbits\nand moving models are also written as an animated WebP, orbit.webp or movie.webp; "
      "--out NAME.mp4 or NAME.webm (by "
      "ffmpeg)\nor NAME.webp writes the film alone, with --film in depth or for two eyes. An orbit needs no "
      "dataset.",
      "  subview-lab render --data blender_tree --model tree/model.ply --orbit 60 --out turn\n"
      "  subview-lab render --model tree/model.ply --orbit 120 --out tree.mp4",
      LAB_RENDER},
     lab_cmd_render},
    {{"export", "--model FILE --format F --out FILE [options]", "write a model in another format",
      "Converts a model (PLY, .splat, SPZ or GLB, detected by content):\n"
      "  ply    the 3DGS format, floats\n"
      "  compressed-ply  PlayCanvas's, about a quarter of the PLY\n"
      "  splat  32 bytes per Gaussian, most visible first, without view-dependent color\n"
      "  spz    about a tenth of the PLY; axes become right-up-back, as the format requires\n"
      "  sog    PlayCanvas's images and meta.json, about a tenth; --out NAME.sog, or DIR/meta.json\n"
      "  html   one page with a viewer, for any browser, offline\n"
      "  glb    glTF with KHR_gaussian_splatting, floats; axes become left-up-forward\n"
      "Models have right-down-forward axes (as COLMAP) unless the file or --up gives the up axis. PLY\n"
      "and .splat keep them unless --for names a viewer; the others are written as their readers expect.",
      "  subview-lab export --model tree/model.ply --format sog --out tree.sog", LAB_EXPORT},
     lab_cmd_export},
    {{"import", "--from KIND DIR --out DIR [options]", "convert other data to a dataset",
      "Converts DIR to a dataset that train reads (transforms.json, images/, and points3d.ply if there are "
      "points):\n  colmap            text or binary model, also in sparse/0\n  nerfstudio, blender  "
      "transforms JSON\n  capture           a capture folder with its rig; odometry finds poses it lacks\n  "
      "multicam          a folder of "
      "clips "
      "(.mp4, .mov, ...), one a camera, to a capture folder on one clock, by ffmpeg\n  "
      "spatial           a spatial video (.mov with a left and a right eye), to a capture folder with a "
      "rig\n"
      "  realsense, oak    folders of rs-convert or of DepthAI's recorder, to a capture folder with a rig\n  "
      "lenslet           raw "
      "images of "
      "a sensor behind a microlens array, and white.png of an evenly lit field;\n                    pixel "
      "values are kept; the rig is also written to rig/\n  4cam-board, qca   recordings with "
      "camera_array.toml or a Qualisys calibration, to a capture folder with a rig\n  kalibr            a "
      "camchain.yaml, to a rig folder\n  lightfield-release  the folder of the paper's authors, prepared: "
      "a dataset for each scene and capture,\n                    which 'tables' reads\n  sim               "
      "a scene of the simulator with its options "
      "(textured, ...): the images of all devices,\n                    held-out views and depth. With "
      "rig=NAME (textured,rig=stereo,exposures=4): the exposures\n                    that 'subview run' "
      "captures, and its held-out views. Scene 'moving': a stationary rig\n                    at 25 times, "
      "every fourth held out. For curves of 'tables': exposures=50,angles=0.2+1+3\nWith --rig and --stream "
      "the poses are those of one camera of a rig; all its "
      "sub-views are added. Their\nimages have the same paths with the other names in them (left/0007.png, "
      "right/0007.png).",
      "  subview-lab import --from colmap garden --out garden_data\n"
      "  subview-lab train --data garden_data --scale 4 --eval --out garden",
      LAB_IMPORT},
     lab_cmd_import},
    {{"tables", "--data DIR[,DIR...] --out DIR [options]", "reproduce the paper's tables and curves",
      "Trains and scores all devices of the datasets (Blender scenes, those of 'import --from sim' or of "
      "'import --from\nlightfield-release', which also have recordings of real cameras) with 1 and "
      "3\nexposures, over angles, numbers of exposures, initializations, TV and numbers of Gaussians. "
      "Writes tables.md\nwith the paper's results beside ours, CSV files, plots (with gnuplot) and a contact "
      "sheet per scene. Each run is a "
      "job of its\nown, whose results stay in DIR/runs; run a stopped command again to continue. --plan "
      "writes the jobs for\nother engines: GNU parallel, make (tools/tables/jobs.mk), Slurm "
      "(tools/tables/tables.sbatch).",
      "  subview-lab import --from sim textured --out scene\n"
      "  subview-lab tables --data scene --quick --out tables\n"
      "  subview-lab tables --data scene --out tables --plan jobs.txt && parallel < jobs.txt\n"
      "  subview-lab tables --data scene --out tables --collect",
      LAB_TABLES},
     lab_cmd_tables},
    {{"bench", "[options]", "time training steps and kernels",
      "Times training steps, their stages and renderings of a synthetic scene of several sizes, on one, two "
      "and\nall threads, and each kernel in each variant that this CPU runs: medians with quartiles, and the "
      "minimum.\nOne thread and kernels are timed in CPU time, thread pools in wall time. Ratios, shares and "
      "growth compare\nminimum times. The bound is the time of the step's operations at the measured peak of "
      "fused multiply-adds,\nor of its bytes at the measured copy rate, whichever is longer; useful pairs "
      "are those that were blended.",
      "  subview-lab bench --json", LAB_BENCH},
     lab_cmd_bench},
};
#define N_COMMANDS ((int)(sizeof commands / sizeof *commands))

static void help(void) {
  printf("usage: subview-lab COMMAND [options]\n\n"
         "Trains 3D Gaussians on datasets in one fixed block of memory, and scores, renders and converts "
         "them.\n\n");
  for (int i = 0; i < N_COMMANDS; i++) printf("  %-8s %s\n", commands[i].c.name, commands[i].c.summary);
  printf(
      "\nsubview-lab COMMAND --help explains a command. SV_ISA=ref|sse41|avx2|avx512|neon pins the kernels.\n"
      "\nExample:\n  subview-lab train --data tests/data/mic_200 --steps 2000 --eval --out out/mic\n");
}

static int run_command(int argc, char **argv) {
  if (argc < 2) return lab_usage(NULL, "a command is missing");
  if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
    help();
    return LAB_EXIT_OK;
  }
  if (strcmp(argv[1], "--version") == 0) {
    printf("subview-lab %s\n", LAB_VERSION);
    return LAB_EXIT_OK;
  }
  for (int i = 0; i < N_COMMANDS; i++) {
    lab_options o;
    if (strcmp(argv[1], commands[i].c.name) != 0) continue;
    int e = lab_args_parse(&commands[i].c, argc - 2, argv + 2, &o);
    if (e != LAB_EXIT_OK) return e;
    if (o.is_help) lab_args_help(&commands[i].c);
    else if (o.is_version) printf("subview-lab %s\n", LAB_VERSION);
    else return commands[i].run(&o);
    return LAB_EXIT_OK;
  }
  sv_near_name near = sv_near_make(argv[1], strlen(argv[1]));
  for (int i = 0; i < N_COMMANDS; i++) sv_near_try(&near, commands[i].c.name);
  if (near.name) return lab_usage(NULL, "unknown command '%.80s' (did you mean %s?)", argv[1], near.name);
  return lab_usage(NULL, "unknown command '%.80s'", argv[1]);
}

int main(int argc, char **argv) {
  sv_linux_begin_program();
  return sv_linux_end_program("subview-lab", run_command(argc, argv));
}
