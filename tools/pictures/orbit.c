// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/orbit.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/format/axes.h"

#define MAX_RISE 0.9  // of the distance
#define WIDTH_PX 640  // without cameras: 4:3
#define FOCAL    1.25 // of the width: 33 degrees from top to bottom
#define FILLED   0.9  // of half the height of the image, by the model's sphere
#define FROM_DEG 20.0 // above the horizon
#define DEG      (SV_PI / 180)

static int scaled(int px, double k) { return sv_maxi(1, (int)(k * px + 0.5)); }

lab_orbit lab_orbit_of_views(const lab_views *v, long width_px) {
  const sv_view *first = &v->frames[0].view;
  const double k = width_px > 0 ? (double)width_px / first->width_px : 1;
  const double pinhole[4] = {k * (double)first->fx, k * (double)first->fy, k * (double)first->cx,
                             k * (double)first->cy};
  lab_orbit o = {.scene = lab_scene_of(v)};
  o.lens = sv_view_make(scaled(first->width_px, k), scaled(first->height_px, k), pinhole,
                        &v->frames[0].f.cam_from_world);
  for (int i = 0; i < v->n; i++) {
    double p[3];
    sv_pose_centre(p, &v->frames[i].f.cam_from_world);
    for (int a = 0; a < 3; a++) o.height += (p[a] - (double)o.scene.centre[a]) * (double)o.scene.up[a] / v->n;
  }
  const double most = MAX_RISE * (double)o.scene.distance;
  o.height = fmin(fmax(o.height, -most), most);
  return o;
}

lab_orbit lab_orbit_of_model(const lab_model *m, const lab_settings *st, long width_px) {
  const int w = width_px > 0 ? (int)width_px : WIDTH_PX, h = scaled(w, 0.75);
  const double f = FOCAL * w, half_angle = atan(FILLED * h / (2 * f));
  const sv_pose none = {.r = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  lab_orbit o = {.lens = sv_view_make(w, h, (const double[]){f, f, w / 2.0, h / 2.0}, &none)};
  double up[3];
  if (!sv_up_axis(m->up, up)) sv_up_axis(SV_UP_DEFAULT, up);
  for (int a = 0; a < 3; a++) o.scene.up[a] = (float)up[a];
  memcpy(o.scene.centre, st->centre, sizeof o.scene.centre);
  o.scene.radius = st->radius;
  o.scene.distance = (float)((double)st->radius / sin(half_angle));
  o.height = (double)o.scene.distance * sin(FROM_DEG * DEG);
  return o;
}

sv_status lab_orbit_view(const lab_orbit *orbit, double turn, sv_view *out, sv_err *err) {
  const lab_scene *sc = &orbit->scene;
  const sv_view *lens = &orbit->lens;
  double up[3], side[3], ahead[3], eye[3], c[3], d = (double)sc->distance;
  for (int k = 0; k < 3; k++) {
    up[k] = (double)sc->up[k];
    c[k] = (double)sc->centre[k];
  }
  const double axis[3] = {fabs(up[0]) < 0.9, fabs(up[0]) >= 0.9, 0}; // any direction across `up`
  sv_cross3(side, up, axis);
  const double n = sv_norm3(side), flat = sqrt(d * d - orbit->height * orbit->height),
               angle = 2 * SV_PI * turn;
  for (int k = 0; k < 3; k++) side[k] /= n;
  sv_cross3(ahead, up, side);
  for (int k = 0; k < 3; k++)
    eye[k] = c[k] + orbit->height * up[k] + flat * (sv_cos(angle) * side[k] + sv_sin(angle) * ahead[k]);
  sv_pose pose;
  if (!sv_pose_look_at(&pose, eye, c, up))
    return sv_fail(err, SV_E_RANGE, "the cameras do not define an orbit");
  const double pinhole[4] = {(double)lens->fx, (double)lens->fy, (double)lens->cx, (double)lens->cy};
  *out = sv_view_make(lens->width_px, lens->height_px, pinhole, &pose);
  return SV_OK;
}
