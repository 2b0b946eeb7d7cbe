// SPDX-License-Identifier: Apache-2.0
// Z. Zhang's method ("A Flexible New Technique for Camera Calibration", PAMI 2000) as OpenCV has
// it, with the principal point in the middle and one distortion term: few enough unknowns to start
// from anything.
#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>

#include "calib/solve/boards.h"

static void to_pose(const cv::Mat &rvec, const cv::Mat &tvec, sv_pose *out) {
  double w[3];
  for (int k = 0; k < 3; k++) {
    w[k] = rvec.at<double>(k);
    out->t[k] = tvec.at<double>(k);
  }
  sv_rodrigues(out->r, w);
}

namespace {

constexpr size_t kSeedBoards =
    16; // that the lens is seeded with: the cost grows with the cube of their number

struct Seen {
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
  std::vector<int> frames;
};

Seen gather(const sv_boards *b, int i_camera) {
  const size_t n = static_cast<size_t>(b->n_cols) * static_cast<size_t>(b->n_rows);
  const size_t first = static_cast<size_t>(i_camera) * static_cast<size_t>(b->n_frames);
  Seen s;
  for (int f = 0; f < b->n_frames; f++) {
    if (!b->is_seen[first + static_cast<size_t>(f)]) continue;
    const double *uv = b->uv_px + 2 * n * (first + static_cast<size_t>(f));
    std::vector<cv::Point3f> o;
    std::vector<cv::Point2f> p;
    for (size_t k = 0; k < n; k++) {
      o.emplace_back(
          static_cast<float>(static_cast<double>(k % static_cast<size_t>(b->n_cols)) * b->spacing_m),
          static_cast<float>(static_cast<double>(k / static_cast<size_t>(b->n_cols)) * b->spacing_m), 0.0f);
      p.emplace_back(static_cast<float>(uv[2 * k] - 0.5), static_cast<float>(uv[2 * k + 1] - 0.5));
    }
    s.object.push_back(o);
    s.image.push_back(p);
    s.frames.push_back(f);
  }
  return s;
}

// The lens from some of the boards, evenly over the list.
bool seed_lens(const Seen &s, int w, int h, cv::Mat &k, cv::Mat &d) {
  const int flags = cv::CALIB_FIX_PRINCIPAL_POINT | cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST |
                    cv::CALIB_FIX_K2 | cv::CALIB_FIX_K3 | cv::CALIB_USE_INTRINSIC_GUESS;
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
  const size_t n = s.frames.size(), n_used = std::min(n, kSeedBoards);
  for (size_t i = 0; i < n_used; i++) {
    object.push_back(s.object[i * n / n_used]);
    image.push_back(s.image[i * n / n_used]);
  }
  k = cv::initCameraMatrix2D(object, image, cv::Size(w, h), 1.0);
  d = cv::Mat::zeros(1, 5, CV_64F);
  const double focal = k.at<double>(0, 0), side = w > h ? w : h;
  if (!(focal > 0.2 * side && focal < 20 * side)) k.at<double>(0, 0) = k.at<double>(1, 1) = side;
  k.at<double>(0, 2) = 0.5 * (w - 1);
  k.at<double>(1, 2) = 0.5 * (h - 1);
  std::vector<cv::Mat> r, t;
  return std::isfinite(cv::calibrateCamera(object, image, cv::Size(w, h), k, d, r, t, flags));
}

} // namespace

bool sv_boards_seed_camera(const sv_boards *b, int i_camera, double lens[5], sv_pose *cam_from_board) {
  const Seen s = gather(b, i_camera);
  if (s.frames.empty()) return false;
  try {
    cv::Mat k, d, r, t;
    if (!seed_lens(s, b->size_px[i_camera][0], b->size_px[i_camera][1], k, d)) return false;
    for (size_t i = 0; i < s.frames.size(); i++) {
      // A small board far away has two poses that look alike: IPPE compares both, from which
      // Gauss-Newton goes on.
      if (!cv::solvePnP(s.object[i], s.image[i], k, d, r, t, false, cv::SOLVEPNP_IPPE)) return false;
      cv::solvePnPRefineLM(s.object[i], s.image[i], k, d, r, t);
      to_pose(r, t, &cam_from_board[s.frames[i]]);
    }
    lens[0] = k.at<double>(0, 0);
    lens[1] = k.at<double>(1, 1);
    lens[2] = k.at<double>(0, 2);
    lens[3] = k.at<double>(1, 2);
    lens[4] = d.at<double>(0);
    return lens[0] > 0 && std::isfinite(lens[0]);
  } catch (const std::exception &) {
    return false; // corners that no camera can see so
  }
}
