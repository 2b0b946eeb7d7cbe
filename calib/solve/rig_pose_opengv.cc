// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <exception>
#include <memory>

#include <opengv/absolute_pose/NoncentralAbsoluteAdapter.hpp>
#include <opengv/absolute_pose/methods.hpp>
#include <opengv/sac/Ransac.hpp>
#include <opengv/sac_problems/absolute_pose/AbsolutePoseSacProblem.hpp>

#include "calib/solve/rig_pose.h"

namespace {

constexpr int kIterations = 300;
constexpr size_t kLeast = 6;

using Problem = opengv::sac_problems::absolute_pose::AbsolutePoseSacProblem;

struct Rays {
  opengv::bearingVectors_t bearings;
  opengv::points_t points;
  std::vector<int> cameras;
  opengv::translations_t offsets;
  opengv::rotations_t rotations;
  double focal_px = 0; // the shortest
};

// Offsets are the cameras' places on the rig, rotations turn camera axes into the rig's.
Rays rays_of(const sv_bundle_camera *cameras, const sv_pose_match *matches, int n) {
  Rays r;
  int n_cameras = 0;
  for (int i = 0; i < n; i++) n_cameras = std::max(n_cameras, matches[i].i_camera + 1);
  for (int i = 0; i < n_cameras; i++) {
    sv_pose rig_from_cam = sv_pose_inv(&cameras[i].cam_from_rig);
    opengv::rotation_t rotation;
    for (int k = 0; k < 9; k++) rotation(k / 3, k % 3) = rig_from_cam.r[k];
    r.rotations.push_back(rotation);
    r.offsets.emplace_back(rig_from_cam.t[0], rig_from_cam.t[1], rig_from_cam.t[2]);
    r.focal_px = i == 0 ? cameras[i].fx : std::min(r.focal_px, cameras[i].fx);
  }
  for (int i = 0; i < n; i++) {
    const sv_bundle_camera &c = cameras[matches[i].i_camera];
    opengv::bearingVector_t ray((static_cast<double>(matches[i].uv_px[0]) - c.cx) / c.fx,
                                (static_cast<double>(matches[i].uv_px[1]) - c.cy) / c.fy, 1);
    r.bearings.push_back(ray.normalized());
    r.points.emplace_back(matches[i].x[0], matches[i].x[1], matches[i].x[2]);
    r.cameras.push_back(matches[i].i_camera);
  }
  return r;
}

} // namespace

bool sv_rig_pose_has_opengv(void) { return true; }

bool sv_rig_pose_opengv(void *, const sv_bundle_camera *cameras, const sv_pose_match *matches, int n,
                        double limit_px, sv_pose *rig_from_world) {
  if (n < static_cast<int>(kLeast)) return false;
  try {
    Rays r = rays_of(cameras, matches, n);
    opengv::absolute_pose::NoncentralAbsoluteAdapter adapter(r.bearings, r.cameras, r.points, r.offsets,
                                                             r.rotations);
    opengv::sac::Ransac<Problem> ransac;
    // false: the same samples every time
    ransac.sac_model_.reset(new Problem(adapter, Problem::GP3P, false));
    ransac.threshold_ = 1 - std::cos(std::atan(limit_px / r.focal_px));
    ransac.max_iterations_ = kIterations;
    if (!ransac.computeModel(0) || ransac.inliers_.size() < kLeast) return false;
    adapter.setR(ransac.model_coefficients_.leftCols<3>());
    adapter.sett(ransac.model_coefficients_.col(3));
    opengv::transformation_t found = opengv::absolute_pose::optimize_nonlinear(adapter, ransac.inliers_);
    sv_pose world_from_rig;
    for (int i = 0; i < 3; i++) {
      for (int k = 0; k < 3; k++) world_from_rig.r[3 * i + k] = found(i, k);
      world_from_rig.t[i] = found(i, 3);
    }
    if (!found.allFinite() || sv_rotation_error(world_from_rig.r) > 1e-6) return false;
    *rig_from_world = sv_pose_inv(&world_from_rig);
    return true;
  } catch (const std::exception &) {
    return false; // no memory
  }
}
