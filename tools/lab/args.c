// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/args.h"

#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include "src/base/str.h"
#include "src/train/train_cfg.h"
#include "tools/common/fileio.h"
#include "tools/lab/model_formats.h"

#define AT(field) offsetof(lab_options, field)
#define DATA      (LAB_TRAIN | LAB_EVAL | LAB_RENDER | LAB_COMPARE | LAB_MESH | LAB_MEASURE)
#define ALL       (DATA | LAB_EXPORT | LAB_IMPORT | LAB_BENCH | LAB_TABLES | LAB_INFO)
#define MODEL     (LAB_EVAL | LAB_RENDER | LAB_EXPORT | LAB_MESH | LAB_MEASURE)

// Rows of train, which other commands share, come last, by subject.
#define HEADING(text)                                                                                        \
  { 0, SV_OPT_HEADING, LAB_TRAIN, 0, 0, 0, text, 0, 0, 0 }

static const sv_option table[] = {
    {"data", SV_OPT_TEXT, DATA & ~LAB_TRAIN, DATA & ~(LAB_TRAIN | LAB_RENDER), AT(data), "DIR",
     "dataset: a folder with transforms JSON and images", 0, 0, 0},
    {"data", SV_OPT_TEXT, LAB_TABLES, LAB_TABLES, AT(data), "DIR[,DIR...]",
     "datasets with files transforms_train_DEVICE[_thetaT][_Nviews].json, or a folder of such datasets", 0, 0,
     0},
    {"data", SV_OPT_TEXT, LAB_INFO, 0, AT(data), "DIR", "dataset: a folder with transforms JSON and images",
     0, 0, 0},
    {"rig", SV_OPT_TEXT, LAB_INFO, 0, AT(rig), "DIR", "a rig instead", 0, 0, 0},
    {"distance", SV_OPT_REAL, LAB_INFO, 0, AT(distance_m), "M", "of what the rig looks at, in meters", 1e-6,
     1e6, 0},
    {"split", SV_OPT_TEXT, LAB_INFO, 0, AT(split), "S", "views: train, test, all, ... [train]", 0, 0, 0},
    {"quick", SV_OPT_FLAG, LAB_TABLES, 0, AT(is_quick), 0, "only the first dataset, fewer points and steps",
     0, 0, 0},
    {"plan", SV_OPT_TEXT, LAB_TABLES, 0, AT(plan), "FILE",
     "write the missing runs as jobs, one line of shell each, instead of running them", 0, 0, 0},
    {"sub-views", SV_OPT_FLAG, LAB_TABLES, 0, AT(is_sub_views), 0,
     "--data are recordings of your own (transforms.json with exposures and sub-views, of a still scene): "
     "the first camera alone against all of them, on exposures that are held out of both",
     0, 0, 0},
    {"collect", SV_OPT_FLAG, LAB_TABLES, 0, AT(is_collected), 0,
     "run nothing: make the tables of the results that are there, and tell what is missing", 0, 0, 0},
    {"jobs", SV_OPT_INT, LAB_TABLES, 0, AT(n_jobs), "N",
     "run so many jobs at a time, by GNU parallel [as many as there are CPUs for]", 1, 1024, 0},
    {"camera", SV_OPT_TEXT, LAB_EVAL, 0, AT(camera), "NAME", "only the views of this camera", 0, 0, 0},
    {"model", SV_OPT_TEXT, MODEL, MODEL, AT(model), "FILE",
     "model PLY; settings are taken from train.json beside it", 0, 0, 0},
    {"model", SV_OPT_LIST, LAB_COMPARE, LAB_COMPARE, AT(models), "A.ply B.ply ...",
     "models, in the order of the sheet's columns; settings are taken from train.json beside each", 0, 0,
     "models"},
    {"labels", SV_OPT_TEXT, LAB_COMPARE, 0, AT(labels), "A,B,...",
     "column titles [the file names or, for model.ply, the folder names]", 0, 0, 0},
    {"views", SV_OPT_INT, LAB_COMPARE, 0, AT(n_views), "N",
     "rows of the sheet: views spread evenly over the split [3]", 1, 1000, 0},
    {"prior", SV_OPT_TEXT, LAB_TABLES, 0, AT(prior), "external:CMD",
     "videos: also rows with this program, called with a folder, as a prior [none]", 0, 0, 0},
    {"gaussians", SV_OPT_INT, LAB_TABLES, 0, AT(gaussians), "N",
     "Gaussians of each run [20000; with --quick 8000]; one table has 5 times as many", 1, 8e5, 0},
    {"steps", SV_OPT_INT, LAB_TABLES, 0, AT(steps), "N", "steps of each run [2000; with --quick 400]", 1, 1e7,
     0},
    {"noise", SV_OPT_TEXT, LAB_TABLES, 0, AT(noise), "none|[prediction,]read=V,shot=V",
     "sensor noise, as train has it [datasets of simulated devices: that of the paper, "
     "read=0.0001,shot=0.0003; else none]",
     0, 0, 0},
    {"refine-poses", SV_OPT_FLAG, LAB_EVAL, 0, AT(is_refining), 0,
     "refine the pose of each view against the model before it is scored, as train --refine-poses --eval "
     "does",
     0, 0, 0},
    {"split", SV_OPT_TEXT, LAB_EVAL | LAB_RENDER | LAB_COMPARE, 0, AT(split), "S",
     "views: train, test, test_near, test_time, ... [test; test_near for a model of one exposure]", 0, 0, 0},
    {"frames", SV_OPT_INT, LAB_RENDER, 0, AT(frames), "N",
     "moving model: number of times at which the first view or one orbit is rendered", 2, 10000, 0},
    {"frames", SV_OPT_INT, LAB_EXPORT, 0, AT(frames), "N",
     "moving model: number of frames, one file each in the folder of --out [none; delta, sequence: 25, in "
     "one file]",
     2, 10000, 0},
    {"orbit", SV_OPT_INT, LAB_RENDER, 0, AT(orbit), "N",
     "N views on a circle around the scene instead of --split; also orbit.webp (builds with libwebp); "
     "without --data around the model",
     1, 100000, 0},
    {"width", SV_OPT_INT, LAB_RENDER, 0, AT(width_px), "PX",
     "orbit: image width; the aspect ratio is kept [the first camera's; without --data 640, 4:3]", 16, 8192,
     0},
    {"film", SV_OPT_WORD, LAB_RENDER, 0, AT(film), "color|depth|stereo",
     "what the frames of --out NAME.mp4, .webm or .webp show: color, depth as grey (near is white), or two "
     "eyes side by side for headsets [color]",
     0, 0, 0},
    {"depth", SV_OPT_FLAG, LAB_EVAL | LAB_RENDER, 0, AT(has_depth), 0,
     "eval: fail if the views have no ground-truth depth; render: also write 16-bit depth PNGs", 0, 0, 0},
    {"mask-with", SV_OPT_TEXT, LAB_EVAL, 0, AT(mask_with), "FILE[,FILE...]",
     "with --mask: training files of the other devices of a comparison; also score the pixels that the "
     "training views of every device see, the same for each of them",
     0, 0, 0},
    {"format", SV_OPT_WORD, LAB_EXPORT, LAB_EXPORT, AT(format),
     "ply|compressed-ply|splat|spz|sog|glb|html|delta|sequence", "output format", 0, 0, 0},
    {"for", SV_OPT_WORD, LAB_EXPORT, 0, AT(viewer), "supersplat|brush|niantic|blender",
     "turn the model to the up axis of that viewer [ply, splat: as trained]", 0, 0, 0},
    {"crop", SV_OPT_TEXT, LAB_EXPORT, 0, AT(crop), "BOX|SPHERE",
     "keep what lies in x0,y0,z0,x1,y1,z1 or in the sphere x,y,z,radius, in the model's axes and unit", 0, 0,
     0},
    {"keep-supported", SV_OPT_FLAG, LAB_EXPORT, 0, AT(is_supported), 0,
     "remove floaters: Gaussians that too few training views of --data see on the surface (--min-views)", 0,
     0, 0},
    {"data", SV_OPT_TEXT, LAB_EXPORT, 0, AT(data), "DIR",
     "the dataset that was trained on: for --keep-supported; sog of still models: colors are best where its "
     "views see them",
     0, 0, 0},
    {"up", SV_OPT_WORD, LAB_EVAL | LAB_RENDER, 0, AT(up), "x|y|z|-x|-y|-z",
     "spz and glb are Y-up: rotate the model to the dataset's up axis [the views' up]", 0, 0, 0},
    {"up", SV_OPT_WORD, LAB_EXPORT, 0, AT(up), "x|y|z|-x|-y|-z",
     "the model's up axis [from the file, else -y]", 0, 0, 0},
    {"up", SV_OPT_WORD, LAB_MESH | LAB_MEASURE, 0, AT(up), "x|y|z|-x|-y|-z",
     "models in spz and glb: rotate to the dataset's up axis [the views' up]", 0, 0, 0},
    {"split", SV_OPT_TEXT, LAB_MEASURE, 0, AT(split), "S", "views: train, test, ... [train]", 0, 0, 0},
    {"view", SV_OPT_INT, LAB_MEASURE, LAB_MEASURE, AT(view), "I", "place of the view in its split, from 0", 0,
     1e6, 0},
    {"from", SV_OPT_TEXT, LAB_MEASURE, LAB_MEASURE, AT(measure_from), "X,Y", "pixel of the first point", 0, 0,
     0},
    {"to", SV_OPT_TEXT, LAB_MEASURE, LAB_MEASURE, AT(measure_to), "X,Y", "pixel of the second point", 0, 0,
     0},
    {"voxel", SV_OPT_REAL, LAB_MESH, 0, AT(voxel), "SIZE",
     "edge of a voxel in the scene's unit [the scene's radius / 128]", 1e-9, 1e9, 0},
    {"faces", SV_OPT_INT, LAB_MESH, 0, AT(faces), "N",
     "at most N triangles: vertices that are near each other become one [all]", 4, 100000000, 0},
    {"min-views", SV_OPT_INT, LAB_MESH, 0, AT(min_views), "N",
     "views that must have seen a surface [16, or one in five of fewer than 80]", 1, 255, 0},
    {"min-views", SV_OPT_INT, LAB_EXPORT, 0, AT(min_views), "N",
     "--keep-supported: views that must have seen a Gaussian [2]", 1, 255, 0},
    {"spz-version", SV_OPT_INT, LAB_EXPORT, 0, AT(spz_version), "N",
     "spz: 4 (zstd, newest), 3 or 2 (gzip, older viewers) [4]", 2, 4, 0},
    {"from", SV_OPT_WORD, LAB_IMPORT, LAB_IMPORT, AT(from),
     "colmap|nerfstudio|blender|vggt|megasam|dust3r|capture|multicam|spatial|realsense|oak|rosbag|lenslet|"
     "lytro|lightfield-release|4cam-board|qca|kalibr|sim",
     "kind of the input (kalibr, dust3r, spatial, rosbag: a file; vggt, megasam: a folder or .npz)", 0, 0, 0},
    {"every", SV_OPT_REAL, LAB_IMPORT, 0, AT(every_s), "SEC",
     "multicam, spatial, realsense, oak: keep one exposure in so many seconds [all]", 0.001, 1e6, 0},
    {"clock", SV_OPT_WORD, LAB_IMPORT, 0, AT(clock), "auto|sound|flash|container",
     "multicam: what tells the clips' common time: sound, changes of the light, creation times; auto: the "
     "first of these that does [auto]",
     0, 0, 0},
    {"keep", SV_OPT_INT, LAB_IMPORT, 0, AT(keep), "K",
     "lenslet, lytro: keep the K x K inner sub-views [7 of 10 per side]", 1, 16, 0},
    {"baseline", SV_OPT_REAL, LAB_IMPORT, 0, AT(baseline_m), "M",
     "lenslet, lytro, spatial: baseline between sub-views in meters [0.001; lytro, spatial: from the file]",
     1e-7, 10, 0},
    {"focal", SV_OPT_REAL, LAB_IMPORT, 0, AT(focal_px), "PX",
     "lenslet, lytro, spatial: focal length in pixels [the width; lytro, spatial: from the file]", 1, 1e6, 0},
    {"focus", SV_OPT_REAL, LAB_IMPORT, 0, AT(focus_m), "M",
     "lenslet, lytro: focus distance in meters [infinity]", 1e-5, 1e6, 0},
    {"white", SV_OPT_TEXT, LAB_IMPORT, 0, AT(white), "DIR",
     "lytro: the camera's white images MOD_*.TXT and MOD_*.RAW [white/ in the folder]", 0, 0, 0},
    {"rig", SV_OPT_TEXT, LAB_IMPORT, 0, AT(rig), "DIR",
     "not for lenslet and capture: the poses are those of one camera of this rig; add all its sub-views; "
     "multicam, rosbag: the capture's rig",
     0, 0, 0},
    {"images", SV_OPT_TEXT, LAB_IMPORT, 0, AT(images), "DIR",
     "vggt, megasam, dust3r: the pictures that the network saw, in order of their names [images/ beside the "
     "file]",
     0, 0, 0},
    {"stream", SV_OPT_TEXT, LAB_IMPORT, 0, AT(stream), "NAME", "with --rig: the sub-view that has the poses",
     0, 0, 0},
    {"unit", SV_OPT_REAL, LAB_IMPORT, 0, AT(unit_m), "M",
     "with --rig: meters per unit of the poses (found from matches between the rig's cameras); realsense: "
     "meters per step of the depth [0.001]",
     1e-9, 1e9, 0},
    {"refine", SV_OPT_WORD, LAB_IMPORT, 0, AT(refine), "rig|views",
     "bundle adjustment on matches found in the images. rig: sub-views of an exposure keep their relative "
     "poses; views: each view has its own pose",
     0, 0, 0},
    {"free-lenses", SV_OPT_TEXT, LAB_IMPORT, 0, AT(free_lenses), "all|NAME[,NAME...]",
     "with --refine: cameras whose focal length and principal point are refined, too [none]", 0, 0, 0},
    {"threads", SV_OPT_INT, LAB_TABLES, 0, AT(threads), "N", "threads of each job [1]", 1, 64, 0},
    {"out", SV_OPT_TEXT, LAB_EXPORT | LAB_COMPARE | LAB_MESH, LAB_EXPORT | LAB_COMPARE | LAB_MESH, AT(out),
     "FILE", "output file", 0, 0, 0},
    {"out", SV_OPT_TEXT, LAB_RENDER, LAB_RENDER, AT(out), "PATH",
     "output folder, or a film: NAME.mp4, NAME.webm, NAME.webp", 0, 0, 0},
    HEADING("Data"),
    {"data", SV_OPT_TEXT, LAB_TRAIN, LAB_TRAIN, AT(data), "DIR",
     "dataset: a folder with transforms JSON and images, a COLMAP folder, a capture, clips or folders of "
     "pictures (one a camera) with --rig, or a .zip of one",
     0, 0, 0},
    {"transforms", SV_OPT_TEXT, DATA | LAB_INFO, 0, AT(transforms), "FILE",
     "training file [transforms_train.json, else transforms.json with every 8th view held out]", 0, 0, 0},
    {"exposures", SV_OPT_INT, LAB_TRAIN, 0, AT(exposures), "N",
     "train on N exposures: the first N, or without exposure numbers the N most dispersed views", 1, 1e6, 0},
    {"rig", SV_OPT_TEXT, LAB_TRAIN, 0, AT(rig), "DIR",
     "the rig of --data's clips (left.mp4, right.mp4) or folders of pictures (left/*.jpg, right/*.jpg), "
     "which have the names of its cameras, or of a capture without one",
     0, 0, 0},
    {"every", SV_OPT_REAL, LAB_TRAIN, 0, AT(every_s), "SEC",
     "clips: keep one exposure in so many seconds [all]", 0.001, 1e6, 0},
    {"masks", SV_OPT_TEXT, LAB_TRAIN | LAB_EVAL, 0, AT(masks), "DIR",
     "masks of the images, by the images' names: black pixels are ignored [the file's mask_path]; train "
     "--eval: held-out images use those that are there",
     0, 0, 0},
    {"scale", SV_OPT_INT, DATA, 0, AT(scale), "K", "downscale images to 1/K [1]", 1, 64, 0},
    {"background", SV_OPT_WORD, DATA, 0, AT(background), "black|white|random",
     "what is behind the model: under transparent images, and where no Gaussian is [black; without "
     "alpha a flat backdrop's color, and of up to 17 exposures of a still scene else the images' mean "
     "color]; evaluation replaces random with black",
     0, 0, 0},
    HEADING("Model and start"),
    {"model", SV_OPT_WORD, LAB_TRAIN, 0, AT(method), "3dgs|4dgs",
     "static Gaussians, or Gaussians that move with the time of the images [3dgs]", 0, 0, 0},
    {"gaussians", SV_OPT_INT, LAB_TRAIN, 0, AT(gaussians), "N",
     "number of Gaussians, fixed [" SV_TEXT_OF(SV_DEFAULT_GAUSSIANS) "]", 1, 4e6, 0},
    {"sh", SV_OPT_INT, LAB_TRAIN, 0, AT(sh), "D",
     "degree of the color's spherical harmonics [" SV_TEXT_OF(SV_DEFAULT_SH_DEGREE) "]", 0, 3, 0},
    {"init", SV_OPT_TEXT, LAB_TRAIN, 0, AT(init), "stereo|sphere|cube|points:FILE",
     "initialization [the dataset's points, except with --exposures up to 3; else stereo: depth where views "
     "overlap; else random points in a sphere]",
     0, 0, 0},
    {"motion", SV_OPT_TEXT, LAB_TRAIN, 0, AT(motion), "clip|field[,k=v...]",
     "4dgs: per-Gaussian motion (clip), or one deformation field that starts from it. Settings: bodies= "
     "most rigid bodies, pos= rot= color= functions of time; of a field preset=NAME, times= base= width= "
     "channels= levels= its sizes, clip= share of the run that trains per-Gaussian motion first (0: from a "
     "still model, as in the paper)",
     0, 0, 0},
    HEADING("Training"),
    {"steps", SV_OPT_INT, LAB_TRAIN, 0, AT(steps), "N",
     "training steps [" SV_TEXT_OF(
         SV_DEFAULT_STEPS) ", with --motion field 4000 (clip=0: 9000); subview "
                           "run: " SV_TEXT_OF(SV_DEFAULT_RUN_STEPS) ", as somebody waits beside the cameras]",
     1, 1e9, 0},
    {"time-limit", SV_OPT_REAL, LAB_TRAIN, 0, AT(time_limit_s), "SEC", "training time instead of --steps",
     0.01, 1e7, 0},
    {"optimizer", SV_OPT_WORD, LAB_TRAIN, 0, AT(optimizer), "adam|gauss-newton|mixed",
     "optimizer [gauss-newton; mixed (means by gauss-newton, the rest by adam) in "
     "moving scenes, with --init sphere or cube, and of two or three exposures of one camera]",
     0, 0, 0},
    {"loss", SV_OPT_TEXT, LAB_TRAIN, 0, AT(loss), "k=v,...",
     "ssim, tv, opacity, scale, tv_novel; novel[_every|_px|_deg], region, floor, dilation, supersample "
     "(share of the run), dropout (share of the Gaussians)",
     0, 0, 0},
    {"antialias", SV_OPT_WORD, LAB_TRAIN, 0, AT(antialias), "auto|on|off",
     "Mip-Splatting's opacity compensation; auto: on when focal lengths differ by more than 1.5 [auto]", 0, 0,
     0},
    {"noise", SV_OPT_TEXT, LAB_TRAIN, 0, AT(noise), "[prediction,]read=V,shot=V",
     "sensor noise on the training images: variance read + shot x for linear light x, then 14 bits; with "
     "prediction: on predicted multiplexed measurements in each step, standard deviation read + shot x",
     0, 0, 0},
    {"appearance", SV_OPT_WORD, LAB_TRAIN, 0, AT(appearance), "off|cameras|exposures",
     "learn the color of cameras (each its own, and its falloff; \"sub_view\" of the frames) or of exposures "
     "and cameras; the model and --eval have those of the first [off, as a dataset does not tell what its "
     "cameras locked; subview run: auto]",
     0, 0, 0},
    {"refine-poses", SV_OPT_FLAG, LAB_TRAIN, 0, AT(is_refining), 0,
     "refine the poses, of an exposure's sub-views together: by bundle adjustment on matches before training "
     "(with OpenCV), then while training; poses that explain the matches stay. Held-out views are placed "
     "against the model before they are scored. The poses are saved beside the model "
     "(transforms_refined.json)",
     0, 0, 0},
    {"prior", SV_OPT_TEXT, LAB_TRAIN, 0, AT(prior), "none|fsgs|sparsegs|[METHOD,]external:CMD",
     "for few views: the depth losses, unpooling or pruning of these methods; or "
     "a program that repairs renderings or estimates depth, called with a folder [none]",
     0, 0, 0},
    {"prior-views", SV_OPT_INT, LAB_TRAIN, 0, AT(prior_views), "N", "--prior external: views per call [8]", 1,
     256, 0},
    {"prior-calls", SV_OPT_INT, LAB_TRAIN, 0, AT(prior_calls), "N",
     "number of calls, evenly spread, besides the first one with the training images [at 5 and 10 % of the "
     "run, then every 3.3 %]",
     1, 10000, 0},
    {"prior-weight", SV_OPT_REAL, LAB_TRAIN, 0, AT(prior_weight), "W",
     "weight of the returned images, where captured images have 1 [0.2]", 0, 100, 0},
    {"prior-limit", SV_OPT_REAL, LAB_TRAIN, 0, AT(prior_limit_s), "SEC", "time limit of one call [600]", 0.01,
     1e6, 0},
    {"seed", SV_OPT_INT, LAB_TRAIN | LAB_BENCH | LAB_TABLES, 0, AT(seed), "N",
     "seed of the random numbers [" SV_TEXT_OF(SV_DEFAULT_SEED) "]", 0, 4294967295.0, 0},
    {"threads", SV_OPT_INT, DATA | LAB_BENCH, 0, AT(threads), "N",
     "threads; the result does not depend on their number [all CPUs; subview run: those that its board "
     "gives]",
     1, 64, 0},
    HEADING("Evaluation"),
    {"eval", SV_OPT_FLAG, LAB_TRAIN, 0, AT(is_eval), 0,
     "evaluate at the end on split test (test_near with --exposures 1)", 0, 0, 0},
    {"mask", SV_OPT_WORD, LAB_TRAIN | LAB_EVAL, 0, AT(mask), "covisible|supported",
     "also score the pixels that training views saw (covisible), or that show what two of them saw from "
     "directions at least 2.5 degrees apart, by the model's Gaussians (supported); train: with --eval",
     0, 0, 0},
    {"lpips", SV_OPT_FLAG, LAB_TRAIN | LAB_EVAL, 0, AT(has_lpips), 0,
     "also LPIPS (v0.1, SqueezeNet); train: with --eval", 0, 0, 0},
    {"lpips-vgg", SV_OPT_TEXT, LAB_TRAIN | LAB_EVAL, 0, AT(lpips_vgg), "FILE",
     "--lpips with VGG16, as papers have it, by these weights (made of yours by "
     "tools/weights/convert_lpips.py)",
     0, 0, 0},
    HEADING("Output"),
    {"out", SV_OPT_TEXT, LAB_TRAIN | LAB_IMPORT | LAB_TABLES, LAB_TRAIN | LAB_IMPORT | LAB_TABLES, AT(out),
     "DIR", "output folder", 0, 0, 0},
    {"open", SV_OPT_FLAG, LAB_TRAIN, 0, AT(is_opened), 0,
     "at the end, write the still model as a page, OUT/model.html, and open it in the browser (xdg-open)", 0,
     0, 0},
    {"json", SV_OPT_FLAG, LAB_TRAIN | LAB_EVAL | LAB_BENCH | LAB_MEASURE | LAB_INFO, 0, AT(is_json), 0,
     "print one JSON object on stdout", 0, 0, 0},
    {"quiet", SV_OPT_FLAG, ALL, 0, AT(is_quiet), 0, "no progress messages on stderr", 0, 0, 0},
    {"help", SV_OPT_FLAG, ALL, 0, AT(is_help), 0, "show this help", 0, 0, 0},
    {"version", SV_OPT_FLAG, ALL, 0, AT(is_version), 0, "show the version", 0, 0, 0},
    {0, SV_OPT_OPERAND, LAB_IMPORT, LAB_IMPORT, AT(input), 0, "the folder to import", 0, 0, 0},
};

static const sv_options options = {
    .program = "subview-lab", .rows = table, .n_rows = (int)(sizeof table / sizeof *table)};

int lab_usage(const char *command, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  int e = sv_options_vusage(options.program, command, fmt, ap);
  va_end(ap);
  return e;
}

bool lab_is_film(const char *path) {
  const char *kind = sv_path_extension(path);
  return sv_str_eq(kind, ".mp4") || sv_str_eq(kind, ".webm") || sv_str_eq(kind, ".webp");
}

static int check_compare(const sv_tool_command *c, const lab_options *o) {
  int n_labels = 1;
  for (const char *p = o->labels; p && *p; p++) n_labels += *p == ',';
  if (o->labels && n_labels != o->models.n)
    return lab_usage(c->name, "--labels needs one name per model: %d, not %d", o->models.n, n_labels);
  if (!sv_str_eq(sv_path_extension(o->out), ".png"))
    return lab_usage(c->name, "--out must be an image name that ends in .png, not '%.200s'", o->out);
  return LAB_EXIT_OK;
}

static int check_import(const sv_tool_command *c, const lab_options *o) {
  const bool has_optics = o->baseline_m >= 0 || o->focal_px >= 0, has_grid = o->keep >= 0 || o->focus_m >= 0;
  const bool is_grid = !strcmp(o->from, "lenslet") || !strcmp(o->from, "lytro");
  if (is_grid || (!has_optics && !has_grid) || (!has_grid && !strcmp(o->from, "spatial"))) return LAB_EXIT_OK;
  return lab_usage(
      c->name, "--keep, --baseline, --focal and --focus need --from lenslet or lytro; --baseline and --focal "
               "also go with spatial");
}

static int check_info(const sv_tool_command *c, const lab_options *o) {
  if ((o->data != NULL) == (o->rig != NULL))
    return lab_usage(c->name, "--data or --rig is needed, and not both");
  if ((o->rig != NULL) != (o->distance_m > 0))
    return lab_usage(c->name, "--rig and --distance need each other");
  return LAB_EXIT_OK;
}

static int check_tables(const sv_tool_command *c, const lab_options *o) {
  if (o->plan && o->is_collected) return lab_usage(c->name, "--plan and --collect cannot be combined");
  if (o->n_jobs > 0 && (o->plan || o->is_collected))
    return lab_usage(c->name, "--jobs has no effect with --%s", o->plan ? "plan" : "collect");
  return LAB_EXIT_OK;
}

static int check_train(const sv_tool_command *c, const lab_options *o) {
  sv_dynamic_cfg scratch = sv_dynamic_defaults();
  if (o->steps >= 0 && o->time_limit_s >= 0)
    return lab_usage(c->name, "--steps and --time-limit cannot be combined");
  if (!o->is_eval && (o->mask || o->has_lpips))
    return lab_usage(c->name, "--%s needs --eval", o->mask ? "mask" : "lpips");
  if (o->motion && !(o->method && sv_str_eq(o->method, "4dgs")))
    return lab_usage(c->name, "--motion needs --model 4dgs");
  if (o->motion && lab_parse_motion(o->motion, &scratch) != LAB_EXIT_OK)
    return lab_usage(c->name, "--motion must be clip or field, then settings ,name=number; not '%.80s'",
                     o->motion);
  return LAB_EXIT_OK;
}

static int check_export(const sv_tool_command *c, const lab_options *o) {
  const bool is_spz = !strcmp(o->format, "spz");
  const bool is_moving = !strcmp(o->format, "delta") || !strcmp(o->format, "sequence");
  if (o->spz_version > 0 && !is_spz) return lab_usage(c->name, "--spz-version needs --format spz");
  if (o->frames > 0 && !strcmp(o->format, "html"))
    return lab_usage(c->name, "--frames has no effect with --format html");
  if (is_moving && (o->viewer || o->crop || o->is_supported))
    return lab_usage(c->name, "--%s has no effect with --format %s",
                     o->viewer ? "for"
                     : o->crop ? "crop"
                               : "keep-supported",
                     o->format);
  if (o->is_supported && !o->data) return lab_usage(c->name, "--keep-supported needs --data");
  if (o->data && !o->is_supported && !sv_str_eq(o->format, "sog"))
    return lab_usage(c->name, "--data needs --keep-supported or --format sog");
  if (o->min_views > 0 && !o->is_supported) return lab_usage(c->name, "--min-views needs --keep-supported");
  if (o->viewer && !strcmp(o->viewer, "niantic") && !is_spz)
    return lab_usage(c->name, "--for niantic needs --format spz");
  return LAB_EXIT_OK;
}

static int check_render(const sv_tool_command *c, const lab_options *o) {
  const bool is_film = lab_is_film(o->out), is_orbit = o->orbit >= 0;
  if (is_orbit && o->split) return lab_usage(c->name, "--split and --orbit cannot be combined");
  if (!o->data && !is_orbit) return lab_usage(c->name, "--data is missing; only --orbit renders without it");
  if (is_film && !is_orbit && o->frames < 0)
    return lab_usage(c->name, "--out %.200s needs --orbit or --frames", o->out);
  if (is_film && o->has_depth)
    return lab_usage(c->name, "--depth needs a folder as --out; --film depth makes a film of it");
  if (o->film && !is_film)
    return lab_usage(c->name, "--film needs a film as --out: NAME.mp4, NAME.webm or NAME.webp");
  if (o->width_px > 0 && !is_orbit) return lab_usage(c->name, "--width needs --orbit");
  return LAB_EXIT_OK;
}

// What no row can say for itself: what options ask of each other.
static int check_together(const sv_tool_command *c, const lab_options *o) {
  static const struct {
    int command;
    int (*check)(const sv_tool_command *, const lab_options *);
  } checks[] = {{LAB_IMPORT, check_import},  {LAB_INFO, check_info},     {LAB_TABLES, check_tables},
                {LAB_TRAIN, check_train},    {LAB_EXPORT, check_export}, {LAB_RENDER, check_render},
                {LAB_COMPARE, check_compare}};
  if (o->mask_with && !(o->mask && sv_str_eq(o->mask, "covisible")))
    return lab_usage(c->name, "--mask-with needs --mask covisible");
  if (o->lpips_vgg && !o->has_lpips) return lab_usage(c->name, "--lpips-vgg needs --lpips");
  if (c->bit != LAB_EXPORT && o->up && o->data && !lab_is_upright(o->model))
    return lab_usage(c->name, "--up needs a model that ends in .spz or .glb");
  for (size_t i = 0; i < sizeof checks / sizeof *checks; i++)
    if (c->bit == checks[i].command) return checks[i].check(c, o);
  return LAB_EXIT_OK;
}

static int parse_loss(const sv_tool_command *c, lab_options *o) {
  const struct {
    const char *name;
    float *to;
    double least, most;
  } known[] = {{"ssim", &o->ssim, 0, 1},
               {"tv", &o->tv, 0, 1e6},
               {"tv_novel", &o->tv_novel, 0, 1e6},
               {"novel", &o->n_novel, 0, 16},
               {"novel_every", &o->novel_every, 1, 1e6},
               {"novel_px", &o->novel_px, 8, 4096},
               {"novel_deg", &o->novel_deg, 0, 180},
               {"region", &o->region_px, 16, 4096},
               {"floor", &o->min_scale_px, 0, 10},
               {"dilation", &o->dilation_px2, 0.001, 10},
               {"supersample", &o->supersample, 0, 1},
               {"opacity", &o->opacity, 0, 1e6},
               {"scale", &o->size, 0, 1e6},
               {"dropout", &o->dropout, 0, 0.9}};
  enum { N = sizeof known / sizeof *known };
  for (const char *p = o->loss; p && *p;) {
    size_t n = strcspn(p, ","), k = strcspn(p, "=");
    int i = 0;
    double v;
    while (i < N && !(strlen(known[i].name) == k && strncmp(p, known[i].name, k) == 0)) i++;
    if (k >= n || i == N)
      return lab_usage(
          c->name,
          "--loss is a list of ssim=, tv=, tv_novel=, novel=, novel_every=, novel_px=, "
          "novel_deg=, region=, floor=, dilation=, supersample=, opacity=, scale= and dropout=, not '%.80s'",
          o->loss);
    if (!sv_parse_double(p + k + 1, n - k - 1, &v) || !(v >= known[i].least && v <= known[i].most))
      return lab_usage(c->name, "--loss %s needs a number from %g to %g", known[i].name, known[i].least,
                       known[i].most);
    *known[i].to = (float)v;
    p += n + (p[n] == ',');
  }
  return LAB_EXIT_OK;
}

static int parse_noise(const sv_tool_command *c, lab_options *o) {
  if (o->noise && strcmp(o->noise, "none") == 0) return LAB_EXIT_OK;
  for (const char *p = o->noise; p && *p;) {
    size_t n = strcspn(p, ",");
    bool is_read = strncmp(p, "read=", 5) == 0, is_shot = strncmp(p, "shot=", 5) == 0;
    double v;
    if (n == 10 && strncmp(p, "prediction", n) == 0) {
      o->is_noise_on_prediction = true;
      p += n + (p[n] == ',');
      continue;
    }
    if ((!is_read && !is_shot) || !sv_parse_double(p + 5, n - 5, &v) || !(v >= 0 && v <= 1))
      return lab_usage(c->name, "--noise is [prediction,]read=V,shot=V with values from 0 to 1, not '%.80s'",
                       o->noise);
    *(is_read ? &o->noise_read : &o->noise_shot) = (float)v;
    p += n + (p[n] == ',');
  }
  return LAB_EXIT_OK;
}

int lab_args_parse(const sv_tool_command *c, int argc, char **argv, lab_options *o) {
  *o = (lab_options){.exposures = -1,
                     .gaussians = -1,
                     .sh = -1,
                     .steps = -1,
                     .scale = -1,
                     .seed = -1,
                     .threads = -1,
                     .orbit = -1,
                     .frames = -1,
                     .n_views = -1,
                     .width_px = -1,
                     .keep = -1,
                     .every_s = -1,
                     .spz_version = -1,
                     .voxel = -1,
                     .view = -1,
                     .min_views = -1,
                     .n_jobs = -1,
                     .baseline_m = -1,
                     .focal_px = -1,
                     .focus_m = -1,
                     .time_limit_s = -1,
                     .prior_views = -1,
                     .prior_calls = -1,
                     .prior_limit_s = -1,
                     .prior_weight = -1,
                     .tv_novel = -1,
                     .n_novel = -1,
                     .novel_every = -1,
                     .novel_px = -1,
                     .novel_deg = -1,
                     .dropout = -1,
                     .region_px = -1,
                     .min_scale_px = -1,
                     .supersample = -1,
                     .ssim = -1,
                     .tv = -1,
                     .opacity = -1,
                     .size = -1};
  int e = sv_options_parse(&options, c, argc, argv, o);
  if (o->is_help || o->is_version) return e;
  if (e == LAB_EXIT_OK) e = check_together(c, o);
  if (e == LAB_EXIT_OK) e = parse_noise(c, o);
  return e != LAB_EXIT_OK ? e : parse_loss(c, o);
}

void lab_args_help(const sv_tool_command *c) { sv_options_help(&options, c); }
