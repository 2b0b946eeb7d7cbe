// SPDX-License-Identifier: Apache-2.0
// subview-lab: trains, evaluates and renders on datasets, with the same arena-bound core as the runtime.
#include <stdio.h>
#include <string.h>

#include "tools/lab/lab.h"

static const lab_command commands[] = {
    {{"train", "--data DIR --out DIR [options]", "train Gaussians on a dataset",
      "Trains a fixed number of Gaussians on a dataset and writes DIR/model.ply and DIR/train.json; with "
      "--eval\n"
      "also the scores on held-out views and pictures of some of them (truth beside rendering) in "
      "DIR/eval/.\n"
      "Memory is planned from the dataset and the options, taken once, and then fixed. Ctrl-C stops early "
      "and\n"
      "saves what was trained. Pictures of lenses with distortion are undistorted while loading.",
      "  subview-lab train --data nerf_mic_400 --gaussians 5000 --steps 2000 --eval --out mic\n"
      "  subview-lab eval --data nerf_mic_400 --model mic/model.ply --json",
      LAB_TRAIN},
     lab_cmd_train},
    {{"eval", "--data DIR --model FILE [options]", "score a model on held-out views",
      "Renders each view of a split and compares it with the dataset's picture: PSNR and SSIM per view, then "
      "the\n"
      "mean; with true depth also its relative and RMS error. Scale and background are those of train.json\n"
      "beside the model unless given.",
      "  subview-lab eval --data blender_tree --model tree/model.ply --split test_near --depth --json",
      LAB_EVAL},
     lab_cmd_eval},
    {{"compare", "--data DIR --model A.ply B.ply ... --out SHEET.png [options]",
      "put models beside the truth in one picture",
      "Renders views of a split with each model and writes one sheet: a row for each view, a column for the\n"
      "dataset's pictures and one for each model, with PSNR in the pictures and its mean over all views of "
      "the\n"
      "split above. PSNR is that of eval. Views, their scale and split are those of the first model's "
      "train.json\n"
      "unless given.",
      "  subview-lab compare --data garden_data --model a/model.ply b/model.ply --labels 'before,after' "
      "--out "
      "sheet.png",
      LAB_COMPARE},
     lab_cmd_compare},
    {{"render", "--data DIR --model FILE --out DIR [options]", "write pictures of a model",
      "Writes a PNG for each view of a split, or for N views on a circle around the scene. With --depth "
      "also\n"
      "16-bit PNGs of the depth along the optical axis; views.json tells their unit and each view's camera.\n"
      "Views on a circle and frames of a moving model are also written as one animated WebP, orbit.webp or\n"
      "movie.webp, which browsers play in a loop.",
      "  subview-lab render --data blender_tree --model tree/model.ply --orbit 60 --out turn", LAB_RENDER},
     lab_cmd_render},
    {{"export", "--model FILE --format F --out FILE [options]", "write a model in another format",
      "Converts a model (PLY, .splat, SPZ or GLB; told by its first bytes):\n"
      "  ply    as 3DGS tools read it, floats\n"
      "  splat  32 bytes a Gaussian, most visible first, without view-dependent colour\n"
      "  spz    about a tenth of PLY; axes become right-up-back, as the format says\n"
      "  glb    glTF with KHR_gaussian_splatting, floats; axes become left-up-forward\n"
      "Models are taken as right-down-forward (COLMAP's axes) unless they say or --up says what is up:\n"
      "spz and glb then stand upright.",
      "  subview-lab export --model tree/model.ply --format splat --out tree.splat", LAB_EXPORT},
     lab_cmd_export},
    {{"import", "--from KIND DIR --out DIR [options]", "turn other data into a dataset",
      "Turns DIR into a dataset that train reads (transforms.json, images/, points3d.ply when there are "
      "points):\n"
      "colmap (text or binary model, also in sparse/0), nerfstudio and blender (transforms JSON), capture "
      "(a\n"
      "capture folder with its rig), lenslet (raw pictures of a sensor behind a microlens array, and\n"
      "white.png of an even field; values are kept as they are, the rig also goes to rig/). 4cam-board and "
      "qca\n"
      "make a capture folder with a rig instead, from recordings\n"
      "with camera_array.toml or a Qualisys calibration; kalibr makes a rig folder from a camchain.yaml.\n"
      "sim takes a scene of the simulator (textured, ..., with its options): the devices' pictures, held-out "
      "views\n"
      "and depth; with rig=NAME (textured,rig=stereo,exposures=4) what 'subview run' captures from that "
      "source and\n"
      "the held-out views that it is measured on; of the scene moving a rig that stands still, 25 times, one "
      "in "
      "four\n"
      "of them held out.\n"
      "With --rig and --stream the poses are those of one camera of a rig: all its sub-views are placed. "
      "Their\n"
      "pictures have its paths with the other names in them (left/0007.png, right/0007.png).",
      "  subview-lab import --from colmap garden --out garden_data\n"
      "  subview-lab train --data garden_data --scale 4 --eval --out garden",
      LAB_IMPORT},
     lab_cmd_import},
    {{"tables", "--data DIR[,DIR...] --out DIR [options]", "measure the paper's tables and curves",
      "Trains and scores all devices of the datasets (Blender scenes, or what 'import --from sim' writes) "
      "with "
      "1 and 3\n"
      "exposures, over angles, numbers of exposures, starts, TV and numbers of Gaussians, and writes "
      "tables.md "
      "with the\n"
      "paper's figures beside ours, CSV files, plots (with gnuplot) and a contact sheet per scene. Each "
      "run's "
      "result\n"
      "stays in DIR/runs: a command that was stopped goes on from there.",
      "  subview-lab import --from sim textured --out scene\n"
      "  subview-lab tables --data scene --quick --out tables",
      LAB_TABLES},
     lab_cmd_tables},
    {{"bench", "[options]", "time whole steps and kernels",
      "Times training steps, their stages and renderings of a synthetic scene for several sizes, on one\n"
      "thread, two and all, and each kernel in each variant that this CPU runs: medians with quartiles, and\n"
      "the least. One thread and kernels are timed by CPU time, pools by real time. Ratios, shares and "
      "growth are of the least times. The bound is what the step's operations\n"
      "take at the measured peak of fused multiply-adds, or its bytes at the measured rate of copying,\n"
      "whichever is longer; useful pairs are those that were blended.",
      "  subview-lab bench --json", LAB_BENCH},
     lab_cmd_bench},
};
#define N_COMMANDS ((int)(sizeof commands / sizeof *commands))

static void help(void) {
  printf("usage: subview-lab COMMAND [options]\n\n"
         "Trains 3D Gaussians on datasets in one fixed block of memory, and scores, renders and converts "
         "them.\n\n");
  for (int i = 0; i < N_COMMANDS; i++) printf("  %-8s %s\n", commands[i].c.name, commands[i].c.summary);
  printf("\nsubview-lab COMMAND --help tells more. SV_ISA=ref|sse41|avx2|avx512|neon pins the kernels.\n"
         "\nExample:\n  subview-lab train --data nerf_mic_400 --steps 2000 --eval --out mic\n");
}

int main(int argc, char **argv) {
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
  return lab_usage(NULL, "unknown command '%.80s'", argv[1]);
}
