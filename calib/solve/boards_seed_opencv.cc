// SPDX-License-Identifier: Apache-2.0
// Z. Zhang's method ("A Flexible New Technique for Camera Calibration", PAMI 2000) as OpenCV has
// it, with the principal point in the middle and one distortion term: few enough unknowns to start
// from anything. Wide lenses start as equidistant ones, of the focal length that fits best.
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

// --- wide lenses ---------------------------------------------------------------------------------

constexpr int kFocals = 24;        // of those that are tried
constexpr double kNarrowest = 1.5; // focal length over the picture's longer side
constexpr double kWidest = 0.2;    // the same: 286 degrees across
constexpr double kFarthest = 0.1;  // cosine, from the board's middle to its corners

struct Equidistant {
  double f, cx, cy;
  cv::Vec3d Ray(const cv::Point2f &p) const {
    const double x = (static_cast<double>(p.x) - cx) / f, y = (static_cast<double>(p.y) - cy) / f,
                 angle = std::hypot(x, y), s = angle > 0 ? std::sin(angle) / angle : 1;
    return {s * x, s * y, std::cos(angle)};
  }
  cv::Point2d Project(const cv::Vec3d &x) const {
    const double r = std::hypot(x[0], x[1]), s = r > 0 ? f * std::atan2(r, x[2]) / r : 0;
    return {s * x[0] + cx, s * x[1] + cy};
  }
};

// The rotation that turns a direction to the optical axis.
cv::Matx33d ToAxis(const cv::Vec3d &v) {
  const cv::Vec3d z = cv::normalize(v),
                  aside = std::fabs(z[0]) < 0.9 ? cv::Vec3d(1, 0, 0) : cv::Vec3d(0, 1, 0),
                  y = cv::normalize(z.cross(aside)), x = y.cross(z);
  return {x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]};
}

// The pose of a board by the rays of its corners, turned so that a pinhole sees them all. Mean of
// the squared distances in the picture, px; a large number where there is no pose.
double PlaceBoard(const Seen &s, size_t i, const Equidistant &lens, sv_pose *out) {
  constexpr double kNone = 1e12;
  cv::Vec3d middle(0, 0, 0);
  for (const auto &p : s.image[i]) middle += lens.Ray(p);
  if (cv::norm(middle) < 1e-6) return kNone;
  const cv::Matx33d turn = ToAxis(middle);
  std::vector<cv::Point2d> seen;
  for (const auto &p : s.image[i]) {
    const cv::Vec3d r = turn * lens.Ray(p);
    if (r[2] < kFarthest) return kNone;
    seen.emplace_back(r[0] / r[2], r[1] / r[2]);
  }
  cv::Mat r, t, rot;
  if (!cv::solvePnP(s.object[i], seen, cv::Matx33d::eye(), cv::noArray(), r, t, false, cv::SOLVEPNP_IPPE))
    return kNone;
  cv::solvePnPRefineLM(s.object[i], seen, cv::Matx33d::eye(), cv::noArray(), r, t);
  cv::Rodrigues(r, rot);
  const cv::Matx33d back = turn.t() * cv::Matx33d(rot.ptr<double>());
  const cv::Vec3d at = turn.t() * cv::Vec3d(t.ptr<double>());
  double sum = 0;
  for (size_t k = 0; k < s.object[i].size(); k++) {
    const cv::Point3f &o = s.object[i][k];
    const cv::Point2d off =
        lens.Project(back * cv::Vec3d(static_cast<double>(o.x), static_cast<double>(o.y), 0) + at) -
        cv::Point2d(s.image[i][k]);
    sum += off.dot(off);
  }
  if (!(at[0] == at[0] && std::isfinite(sum))) return kNone;
  if (out) {
    for (int k = 0; k < 9; k++) out->r[k] = back.val[k];
    for (int k = 0; k < 3; k++) out->t[k] = at[k];
  }
  return sum / static_cast<double>(s.object[i].size());
}

double ErrorOf(const Seen &s, const Equidistant &lens) {
  const size_t n = s.frames.size(), n_used = std::min(n, kSeedBoards);
  double sum = 0;
  for (size_t i = 0; i < n_used; i++) sum += PlaceBoard(s, i * n / n_used, lens, nullptr);
  return sum;
}

// The focal length with which boards fit best, then finer steps about it.
bool SeedWide(const Seen &s, int w, int h, double lens[5], sv_pose *cam_from_board) {
  const double side = w > h ? w : h;
  Equidistant best = {0, 0.5 * (w - 1), 0.5 * (h - 1)};
  double least = HUGE_VAL, step = std::pow(kNarrowest / kWidest, 1.0 / (kFocals - 1)), middle = 0;
  for (int round = 0; round < 3; round++) {
    const int n = round == 0 ? kFocals : 7;
    for (int i = 0; i < n; i++) {
      const double f =
          round == 0 ? kWidest * side * std::pow(step, i) : middle * std::pow(step, (i - 3) / 3.0);
      const double e = ErrorOf(s, {f, best.cx, best.cy});
      if (!(e < least)) continue;
      least = e;
      best.f = f;
    }
    if (!(best.f > 0)) return false;
    if (round > 0) step = std::pow(step, 1.0 / 3);
    middle = best.f;
  }
  for (size_t i = 0; i < s.frames.size(); i++)
    if (PlaceBoard(s, i, best, &cam_from_board[s.frames[i]]) > side * side) return false;
  lens[0] = lens[1] = best.f;
  lens[2] = best.cx;
  lens[3] = best.cy;
  lens[4] = 0;
  return true;
}

} // namespace

bool sv_boards_seed_camera(const sv_boards *b, int i_camera, double lens[5], sv_pose *cam_from_board) {
  const Seen s = gather(b, i_camera);
  if (s.frames.empty()) return false;
  try {
    if (b->model == SV_MODEL_SPLINED)
      return SeedWide(s, b->size_px[i_camera][0], b->size_px[i_camera][1], lens, cam_from_board);
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
