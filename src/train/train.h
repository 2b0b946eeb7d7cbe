// SPDX-License-Identifier: Apache-2.0
// Training a fixed number of Gaussians on measurements. One step takes one sub-view, or one region of a sensor
// on which lens images overlap (src/rig/forward.h), compares it with what the Gaussians give, and moves those
// that it touched; renderings of views that no camera took may be smoothed along (the paper, section 3.2). Slots that went dead are relocated to where the error is (3DGS-MCMC,
// Kheradmand et al. 2024, weighted by error). All memory is carved at start.
#ifndef SV_TRAIN_TRAIN_H
#define SV_TRAIN_TRAIN_H

#include "src/deform/deform.h"
#include "src/loss/photometric.h"
#include "src/loss/tv.h"
#include "src/prior/prior.h"
#include "src/rig/forward.h"
#include "src/splat/render.h"
#include "src/dynamic/local_motion.h"
#include "src/train/poses.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { SV_BG_BLACK, SV_BG_WHITE, SV_BG_RANDOM } sv_background;

typedef struct {
  float mean_start, mean_end; // times the scene radius; log-linear over the run
  float quat, scale, logit, sh0, sh_rest;
} sv_learning_rates;

// What moves the Gaussians. Motion and poses are always Adam's.
typedef enum { SV_OPTIMIZER_ADAM, SV_OPTIMIZER_GAUSS_NEWTON } sv_optimizer;
const char *sv_optimizer_name(sv_optimizer o); // "adam", "gauss-newton"
int sv_optimizer_by_name(const char *name);    // -1 when unknown

// Diagonal Gauss-Newton (curvature.c): p -= rate m / (h + damping mean(h)), m the running mean of the gradient, h that of
// the estimates of the diagonal. No step is longer than so many of Adam's.
typedef struct {
  int first_every, first_steps; // steps from one estimate to the next, at first and for how many steps
  int every;                    // and from there on
  int half_from;                // step from which they look at half of the tiles
  float keep;                   // of the running mean, an estimate
  float rate_start,
      rate_end;         // log-linear over the run; rate_end times sv_train_haste's square, at most rate_start
  bool is_hasty;        // both rates times sv_train_haste: few pictures, whose gradients agree
  float damping;        // of the mean over 16 Gaussians
  float cap, cap_scale; // Adam's longest steps; of log-scales
} sv_newton_cfg;

#define SV_TRAIN_BLOCK_FLOATS ((SV_CAP_ROWS + 1 + SV_CAP_MROWS) * 16)

// Moving scenes (src/deform).
typedef struct {
  sv_deform_kind kind;
  float from; // progress at which things begin to move; before, one still model is trained
  sv_motion_functions_kind functions;
  sv_field_cfg field; // of FIELD
  // FIELD: so much of the run is trained as a clip, to whose motion the field then is fitted (handover.h); 0: it begins
  // at rest, with a still model, as the paper's does.
  float clip;
  float fit;    // steps of the fit, of those that the run has
  float taught; // share of the steps after it on pictures of the clip, of times between those of the others
  float find_every, find_until;       // progress between two searches for what moves, and at the last
  int n_pos, n_rot, n_colour;         // functions of clip mode
  float pos, rot, colour, window;     // learning rates; of positions times that of the means
  float reg_pos, reg_rot, reg_colour; // weights of the mean length of the coefficients; position per radius
  // Progress: until `from` one time in the middle (and what is within grow_start of it) is all there is; then others
  // come in to both sides of it, and at grow_until there are all. What moves fast is followed from picture to
  // picture, where a model of all times at once would smear it. grow_until 0: all times from the start.
  // Half of the steps until then go to the times that came in last (every front_every-th), whose pictures are taken at
  // reduced size for a progress of coarse_for. Polynomials: of higher degrees no more take part than what is there can
  // tell.
  float grow_start, grow_until, coarse_for;
  int front_every;
  int n_bodies;     // rigid bodies that are looked for, at most; with is_followed
  float body;       // learning rate of their poses, times that of the means
  bool is_followed; // what moves is looked for in the pictures of a time that comes in (follow.c); clip mode
  // Lengths of the position coefficients, those of function j counted j + 1 times, shrink by so much of the learning
  // rate in each step: what gradients do not ask for steadily stays straight, slow, still. Adam would let it wander.
  float shrink_pos;
  float least_share;  // of the turns, for views of unusual lenses (sv_train_share)
  float window_start; // half width of the windows that copies of moving slots begin with; 0: as their source
  int older_every; // live: every so many steps the view is one of all in turn, else of the newest time; 0: all in turn
  float unrest;                             // who is off by so much more at some times than at others moves
  float still_px, still_fade, still_colour; // who changes by less than all of these is still
} sv_dynamic_cfg;

typedef struct {
  int n_gaussians, sh_degree;
  int cap_views;                     // sub-views with pictures of their own
  int cap_measurements, cap_regions; // shared sensors, and their regions together (sv_train_n_regions)
  int region_px;                     // side of a region; smaller on smaller sensors
  int cap_width_px, cap_height_px;   // of any view, region and unseen view
  size_t cap_pixels;                 // of any view, padded; 0: cap_width x cap_height
  uint32_t cap_recs;                 // 0: the renderer's default
  int n_threads;
  uint64_t seed;
  sv_background background; // matters for pictures with alpha; others are trained over black
  bool is_antialiased;
  float dilation_px2;           // sv_render_options
  bool is_supersampled;         // pixels of whole pictures are means of 2 x 2 samples (supersample.c)
  float supersample_from;       // progress; one sample a pixel before
  float weight_ssim;            // lambda of (1-l) L1 + l (1 - SSIM)
  float weight_tv;              // of the squared total variation of rendered sub-views
  float weight_tv_unseen;       // and of unseen views
  float noise_read, noise_shot; // laid over predicted measurements (sv_forward_noise); 0: none
  int n_unseen;                 // unseen views of a step, 0: none
  int unseen_every;             // steps from one with unseen views to the next
  int unseen_px;                // their larger side is reduced to at most so many pixels
  float unseen_rad;             // how far they are turned about the scene from a view that was taken
  float reg_opacity, reg_scale; // weights of mean opacity and mean scale (3DGS-MCMC)
  float dropout;                // share of the Gaussians that a step leaves out (sv_render_options)
  float dropout_until;          // progress
  sv_learning_rates lr;
  sv_optimizer optimizer;
  sv_newton_cfg newton;
  int start_scale;                     // coarse to fine: first pictures at 1/start_scale (1, 2 or 4)
  float fine_at;                       // progress at which full size is reached
  float sh_step;                       // progress between two SH degrees
  int relocate_every;                  // steps
  float relocate_from, relocate_until; // progress
  float noise;                         // multiplies the position noise of low-opacity Gaussians
  float floor_px; // least standard deviation, in pixels of the sharpest view of a Gaussian
  int steps_hint; // expected steps of the run: sets the pace (sv_train_haste)
  sv_dynamic_cfg dynamic;
  sv_train_poses_cfg poses;
  sv_prior_cfg prior; // pseudo-views and depth maps from outside
} sv_train_cfg;

typedef struct {
  sv_view view;
  sv_image_u8 image; // not copied: must live as long as the trainer
} sv_train_view;

typedef struct {
  sv_multiplexed model; // the lenses, too, must live as long as the trainer
  const uint16_t *px;   // [height][width][3] display values of 65535
  int n_x, n_y;         // regions
} sv_train_measurement;

typedef struct {
  int i_view; // of the views, then of the regions; -1: no picture, a field was fitted to a clip
  int scale;
  double loss, l1, ssim; // of this step's sub-view or region
  uint32_t n_touched;
} sv_step_stats;

typedef struct {
  sv_planes mean; // the last picture, of the size of its target
  sv_planes grad; // of its samples
  float *err;     // the same
} sv_supersample;

// Of one Gaussian, over the cameras: normal equations of its displacement in pixels, 3 x 3 symmetric by rows.
typedef struct {
  float a[6], b[3], r2;
  int n; // cameras
} sv_follow_sum;

// Of one Gaussian (member.c): where it is (world) at a knot, the bodies near it (0: no more), and by what its colour
// differs from the pictures', summed over n of them, with its own motion (a body's part: at rest) and as a part of each.
#define SV_MEMBER_BODIES 3
typedef struct {
  float x[3], err[1 + SV_MEMBER_BODIES], n[1 + SV_MEMBER_BODIES];
  uint8_t body[SV_MEMBER_BODIES], knot;
} sv_member;

typedef struct {
  sv_train_cfg cfg;
  sv_compute compute;
  sv_gaussians g;
  // bfloat16, laid out as g.param: running means of the gradient, and of its squares (Adam) or the curvature
  uint16_t *m, *v;
  float *err;   // [cap] running mean of each Gaussian's blended error
  float *block; // [n_threads][SV_TRAIN_BLOCK_FLOATS] gradients of one block: Gaussians, error, motion
  float *sum;   // [cap / 16][n_rows + 1][16] of a step with several pictures, last row: error. Or NULL
  uint32_t *sum_touched;    // [cap / 16][2] lanes with a gradient, lanes with an error
  float *floor;             // [cap] least log-scales, NULL without floor_px
  double *cum;              // [cap] cumulative relocation weights
  int32_t *copies, *source; // [cap] of a relocation
  uint32_t *touched_of;     // [cap / 16 / blocks a task + 1]
  sv_deform deform;
  sv_gaussians teacher; // the clip's, as they were when it handed over (handover.h)
  float time;           // of the last picture
  float newest;         // largest time of a picture
  float middle;         // time of a picture, the closest to 0.5
  float usual_sr;       // solid angle of the pictures, their median, in the small-angle form
  float usual_fx_px;    // focal length of that picture
  float find_at;        // progress of the next search
  uint32_t field_step;  // of the field's stage
  uint32_t fit_left;    // steps of the field's fit to a clip (handover.h)
  uint8_t *is_moving;   // [cap]
  // [cap] each, of the search for what moves: frames that saw a Gaussian, mean and squared deviations of its
  // residual over them, largest deviation over the cameras; pixels of the current frame, their residuals' sum
  float *n_seen, *res_mean, *res_dev, *unrest, *weight, *residual;
  sv_follow_sum *follow;               // [cap], NULL unless times come in one by one
  sv_local_motion *near;               // as follow
  float (*body_sum)[SV_CAP_BODIES][6]; // [tasks of the optimiser] gradients of the poses; NULL without bodies
  sv_member *member;                   // [cap], NULL without bodies
  float followed;                      // progress up to which the times that came in were followed
  sv_renderer render;
  sv_photometric photometric;
  sv_tv tv;
  sv_forward forward; // of regions
  sv_supersample supersample;
  sv_train_poses poses;
  sv_prior prior;
  float tended; // progress up to which what the prior does of its own is done
  sv_planes target, grad;
  sv_planes aux; // gradient of one picture of several
  float *err_plane, *aux_err, *unpack_scratch;
  sv_train_view *views;               // [cap_views]
  sv_train_measurement *measurements; // [cap_measurements]
  int *order;                         // [cap_views + cap_regions] this epoch's order
  int n_views, n_measurements, n_regions, i_order;
  float jitter[2];         // this epoch's shift of the regions, of a region
  float centre[3], radius; // of the scene
  uint32_t step;
  uint32_t n_relocated, n_renewed; // ever
  double trained_s;                // kept for a caller who trains by time: what a run that is resumed has had
  uint64_t
      origin; // likewise: what is trained on, as a number that a checkpoint must have in common with a resumed run
  sv_rng rng;
} sv_trainer;

sv_train_cfg sv_train_defaults(void);
size_t sv_trainer_bytes(const sv_train_cfg *cfg);
// E_ARG names a bad setting in err. Kernels and pool must outlive the trainer.
sv_status sv_trainer_init(sv_trainer *t, const sv_train_cfg *cfg, sv_compute compute, sv_arena *arena,
                          sv_err *err) SV_MUST_USE;

// E_FULL beyond cap_views, E_RANGE when picture and view differ in size or exceed the caps.
sv_status sv_train_add_view(sv_trainer *t, const sv_view *view, const sv_image_u8 *image,
                            sv_err *err) SV_MUST_USE;
// Instead of picture i_view one of the same size from another pose.
void sv_train_replace_view(sv_trainer *t, int i_view, const sv_view *view, const sv_image_u8 *image);
// View i_view, added before, is one of exposure i_pose, whose pose training refines. Of each exposure all views; of one
// the pose is held. Kept apart from the view's own pose: cam_from_rig and rig_from_world as they are now.
void sv_train_refine_view(sv_trainer *t, int i_view, int i_pose, const sv_pose *cam_from_rig,
                          const sv_pose *rig_from_world, bool is_held);
// A sensor on which lens images overlap, with its measurement px[height][width][3], display values of 65535.
sv_status sv_train_add_measurement(sv_trainer *t, const sv_multiplexed *model, const uint16_t *px,
                                   sv_err *err) SV_MUST_USE;
// Starting Gaussians; the scene's centre and radius are taken from cfg (random) or from the points.
sv_status sv_train_start(sv_trainer *t, const sv_init_cfg *init, const sv_point *point, int n_points,
                         sv_arena *scratch) SV_MUST_USE;
// Known scene bounds instead of what the start gave.
void sv_train_set_scene(sv_trainer *t, const float centre[3], float radius);

// One step. progress in [0, 1]: step/steps, or time/time limit. E_ARG without views and measurements. A field that follows
// a clip is fitted to it first, in several calls that are no steps (i_view -1).
sv_status sv_train_step(sv_trainer *t, float progress, sv_step_stats *out) SV_MUST_USE;

// Options with which a view is rendered at a progress (1 for evaluation).
sv_render_options sv_train_render_options(const sv_trainer *t, float progress, bool has_depth);
// A digest of all parameters, FNV-1a over their bits in slot order.
uint64_t sv_train_digest(const sv_trainer *t);

// Has t->g drawn as it is at a time 0..1. Nothing to do for still scenes.
void sv_train_set_time(sv_trainer *t, float time);
bool sv_train_is_dynamic(const sv_trainer *t);

// --- pieces, for tests ---------------------------------------------------------------------------
float sv_train_mean_lr(const sv_train_cfg *cfg, float progress); // per unit of scene radius
// Runs of less than 2,000 steps, of scenes that stand still, have higher rates of scales, opacities and colours (with
// Adam alone), and end with higher ones of means: by sqrt(2000 / steps_hint), at most 2.5; the means' by its square.
float sv_train_haste(const sv_train_cfg *cfg);
int sv_train_scale_at(const sv_trainer *t, const sv_view *view, float progress);
// Least log-scales from the views that see each Gaussian: the log of floor_px z / f at the highest f / z. What is
// smaller was never measured (Mip-Splatting, Yu et al. 2024, eq. 7), and would look thin from nearer cameras.
void sv_train_set_floors(sv_trainer *t);
// Whether the run begins as a clip: motion of each Gaussian for itself.
bool sv_train_has_clip(const sv_train_cfg *c);
// At the start nothing moves.
void sv_train_start_moving(sv_trainer *t);
// When times come in between the progresses `before` and `progress`, what moves is looked for in their pictures from
// the times next to them (follow.c).
sv_status sv_train_follow(sv_trainer *t, float before, float progress) SV_MUST_USE;
// Functions of position that take part: no more than the times that are there can tell.
int sv_train_n_functions(const sv_trainer *t, float progress);
// A picture as planes at 1/scale in t->target, laid over the background; t->grad gets its size.
void sv_train_load_target(sv_trainer *t, const sv_image_u8 *im, int scale, const float bg[3]);
// A relocated slot gets the motion of its source, in a window of its own.
void sv_train_copy_motion(sv_trainer *t, int to, int from);
// Renders a training view, at half size at most, and leaves its residual in err_plane; no gradients.
sv_status sv_train_residual(sv_trainer *t, int i_view, float progress) SV_MUST_USE;
// Adds each Gaussian's share of that picture, in pixels, to t->weight, and of its residual to t->residual. The target
// is gone afterwards.
#define SV_TRAIN_WEIGHT_MIN 1.0f // pixels: who covers less of a picture has no say about it
sv_status sv_train_share_residual(sv_trainer *t) SV_MUST_USE;
void sv_train_clear_shares(sv_trainer *t);
// Whether a time is trained on already.
bool sv_train_has_time(const sv_trainer *t, float time, float progress);
// Reduction at which the pictures of a time that came in a moment ago are taken; 1: as progress says.
int sv_train_new_time_scale(const sv_trainer *t, float time, float progress);
// A picture of a moving scene whose lens sees less of it than is usual, or sees it smaller, gets fewer turns: the ratio
// of its focal length to the usual one, or the reverse, at least cfg.dynamic.least_share of a turn. A phone's long lens
// would take a third of the steps for a ninth of what is to be seen, and what its short one sees another sees larger.
float sv_train_share(const sv_trainer *t, const sv_view *view);
// In a turn a picture counts by the same ratio where its lens is narrower than is usual, else in full. A loss is the
// mean of a picture's pixels, so a long lens says as much of a ninth of what is seen as others say of all: Adam's steps
// and relocation would follow it, and shorten the steps for the others.
float sv_train_weight(const sv_trainer *t, const sv_view *view);
// Multiplies t->grad, and the errors of the picture, where they are not NULL.
void sv_train_weigh(sv_trainer *t, float weight, float *err);
// Looks at every training time with the model as it is: a Gaussian whose residual changes with time, in any of
// the cameras, by more than cfg.dynamic.unrest (root mean square, display values) is to move from now on.
sv_status sv_train_find_moving(sv_trainer *t, float progress) SV_MUST_USE;
// Who moves is learnt: slots whose motion is not worth it come to rest, the moving ones are put first.
void sv_train_sort_moving(sv_trainer *t);
// Gradients of a block of moving Gaussians, from those of the moved ones, and their step. touched: lanes.
void sv_train_move_block(sv_trainer *t, const sv_motion_args *a, const sv_adam_args *adam, int block,
                         uint32_t touched, float *grad, float *scratch);
// Rigid bodies (bodies.c, where the formulas are). Whether a run of this kind looks for them.
bool sv_train_has_bodies(const sv_train_cfg *c);
static inline int sv_train_body_of(const sv_trainer *t, int i) {
  const sv_bodies *b = &t->deform.motion.bodies;
  return b->n > 1 ? b->of[i] : 0;
}
// Knots for all times that are there, and for a new one, at which all bodies go on as they went.
void sv_train_expect_bodies(sv_trainer *t, float to, float progress);
// From t->near, places at time `from` and displacements to `to`: the bodies' poses at `to`, and new bodies.
// Adds what one camera saw of a displacement: r pixels, with dpixel/dplace jac [2][3].
void sv_train_add_seen(sv_follow_sum *s, const float jac[6], const float r[2]);
// Place (world) and quaternion (or NULL) of slot i by its own functions, whose values are f.
void sv_train_own_place(const sv_trainer *t, int i, const sv_motion_values *f, float x[3], float q[4]);
// Slot i becomes a part of a body, at x and q of its frame and with no motion of its own; of body 0: at rest.
void sv_train_settle(sv_trainer *t, int i, int body, const float x[3], const float q[4]);
// Who is a part of which body (member.c): before the first picture of a search, after each was rendered with depth and
// with its target, after the last.
void sv_train_begin_members(sv_trainer *t);
void sv_train_look_at_members(sv_trainer *t, int i_view);
void sv_train_end_members(sv_trainer *t);
// Moves the poses of the bodies at a time, expected there, to what its pictures show (track.c).
sv_status sv_train_track_bodies(sv_trainer *t, float time, float progress) SV_MUST_USE;
void sv_train_follow_bodies(sv_trainer *t, float from, float to, float px_per_unit);
// One step of the bodies' poses at the time of the last picture, from t->body_sum, which is cleared before.
void sv_train_clear_body_sums(sv_trainer *t);
void sv_train_move_bodies(sv_trainer *t, float mean_lr);
// Adam's learning rates of the motion's rows, and the kernel's arguments, for one step.
void sv_train_motion_rates(const sv_trainer *t, float progress, float mean_lr, double bias1,
                           float lr[SV_CAP_MROWS]);
// Relocates slots of opacity <= SV_OPACITY_DEAD; returns how many.
uint32_t sv_train_relocate(sv_trainer *t);
// A slot becomes a copy of another, with running means of its own.
void sv_train_copy_slot(sv_trainer *t, int to, int from);
// Opacity and scale factor of n copies that together look like one Gaussian of opacity o: 1 - (1-o)^(1/n)
// and o / K (3DGS-MCMC eq. 9).
void sv_relocation_split(double o, int n, double *o_new, double *scale_factor);
// Regions of a sensor, whose measurement is not larger than 16384 a side.
int sv_train_n_regions(int width_px, int height_px, int region_px);
// Region i of a measurement under this epoch's shift; all have the same size, and together they cover the sensor.
sv_region sv_train_region(const sv_trainer *t, const sv_train_measurement *c, int i);
// Renders a region of a measurement as it would be measured, into t->forward.predicted. *n_px: pixels of lens images
// that were rendered; *last: the lens whose part the renderer still holds, -1 when none lights the region. Both may
// be NULL.
sv_status sv_train_predict(sv_trainer *t, const sv_multiplexed *c, const sv_region *region,
                           const sv_render_options *o, int *last, size_t *n_px) SV_MUST_USE;
// Of a trainer with these settings.
sv_renderer_cfg sv_train_renderer_cfg(const sv_train_cfg *c);
// Supersampling (supersample.c). Whether a picture at 1/scale has more than one sample a pixel.
bool sv_train_is_supersampled(const sv_trainer *t, int scale, float progress);
// Whether this step's errors are added to the Gaussians' running means, which relocation asks for. One step of each
// four, drawn: the means change slowly, and a backward pass without them is shorter. None when nobody relocates any more.
#define SV_TRAIN_ERROR_EVERY 4u
bool sv_train_is_error_due(const sv_trainer *t, float progress);
// Whether this step estimates the curvature.
bool sv_train_is_probe_due(const sv_trainer *t);
// After the loss of a picture whose mean |residual| is l1: the target, which has done its duty, becomes the probe, whose
// gradients are squared into the running means. Those of all tiles, from cfg.newton.half_from on of half.
sv_status sv_train_curvature(sv_trainer *t, double l1, bool is_supersampled) SV_MUST_USE;
// The same of several pictures that together are one measurement, always of all: the probe, then for each its gradients
// (sv_render_bwd) and collect, then apply.
void sv_train_make_probe(sv_trainer *t, double l1);
void sv_train_collect_curvature(sv_trainer *t);
void sv_train_apply_curvature(sv_trainer *t);
void sv_train_supersample_carve(sv_supersample *s, size_t px,
                                sv_arena *a); // px: of the largest picture, padded
// Renders 2 x 2 samples a pixel of a view; their means go to t->supersample.mean.
sv_status sv_train_supersample(sv_trainer *t, const sv_view *view, const sv_render_options *o) SV_MUST_USE;
// A view as it is measured at this progress, with one sample a pixel or more. *out is the trainer's, until it renders
// again.
sv_status sv_train_measure(sv_trainer *t, const sv_view *view, const sv_render_options *o,
                           bool is_supersampled, const sv_planes **out) SV_MUST_USE;
// Spreads the gradient, returned, and the error (or NULL) of the means over the samples.
const sv_planes *sv_train_spread(sv_trainer *t, const sv_planes *grad, const float *err);
// From them back to the Gaussians.
sv_status sv_train_supersample_bwd(sv_trainer *t, const sv_planes *grad, const float *err) SV_MUST_USE;
// A view from beside those that were taken, turned about the scene's centre; reduced in size.
sv_view sv_train_unseen_view(sv_trainer *t);
// A view turned about the scene's centre by up to `rad`, in any direction.
sv_view sv_train_turned_view(const sv_trainer *t, const sv_view *v, float rad, sv_rng *rng);
// t->target and t->grad for a picture of this size, their padding cleared.
void sv_train_size_target(sv_trainer *t, int width_px, int height_px);
// Gradients of the last picture -> parameters for all touched blocks; returns the touched Gaussians.
uint32_t sv_train_optimise(sv_trainer *t, float progress);
// The same in two halves, for steps with several pictures: add the last picture's gradients, with reg_share of
// the regularisers, to the sum; then use the sum.
void sv_train_collect(sv_trainer *t, float reg_share, bool has_err);
uint32_t sv_train_apply(sv_trainer *t, float progress);
// Moves the pose of the view that was the last picture, by the first n_sums of poses.sum (poses.c).
void sv_train_move_pose(sv_trainer *t, int i_view, float progress, int n_sums);
int sv_train_n_tasks(const sv_trainer *t); // of an optimiser's step

#ifdef __cplusplus
}
#endif
#endif
