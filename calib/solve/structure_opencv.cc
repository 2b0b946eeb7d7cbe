// SPDX-License-Identifier: Apache-2.0
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

#include "calib/solve/align.h"
#include "calib/solve/structure.h"

namespace {

constexpr float kRatio = 0.8f; // of the best to the second best match (D. Lowe, IJCV 2004)
constexpr float kEpipolarPx = 1.5f;
constexpr int kMinInliers = 12;
constexpr double kMovePx = 2.0;    // that refinement may move a feature
constexpr double kLikeness = 0.95; // correlation of its patch in two views

struct Features {
  cv::Mat image;
  std::vector<cv::KeyPoint> keys;
  cv::Mat descriptors;
};

Features describe(const sv_structure_view &v, int n_features) {
  Features f;
  f.image = cv::Mat(v.height_px, v.width_px, CV_8UC1, const_cast<uint8_t *>(v.grey)).clone();
  cv::Mat mask;
  if (v.mask) mask = cv::Mat(v.height_px, v.width_px, CV_8UC1, const_cast<uint8_t *>(v.mask));
  cv::SIFT::create(n_features, 3, 0.01, 10, 1.2)->detectAndCompute(f.image, mask, f.keys, f.descriptors);
  for (int i = 0; i < f.descriptors.rows; i++) cv::normalize(f.descriptors.row(i), f.descriptors.row(i));
  return f;
}

// The best match of each row where it clearly is the best; -1 elsewhere. squared: distances of
// descriptors.
std::vector<int> nearest(const cv::Mat &squared) {
  std::vector<int> out(static_cast<size_t>(squared.rows), -1);
  for (int i = 0; i < squared.rows; i++) {
    const float *d = squared.ptr<float>(i);
    int best = 0;
    float first = INFINITY, second = INFINITY;
    for (int k = 0; k < squared.cols; k++)
      if (d[k] < first) {
        second = first;
        first = d[k];
        best = k;
      } else if (d[k] < second) second = d[k];
    if (first < kRatio * kRatio * second) out[static_cast<size_t>(i)] = best;
  }
  return out;
}

struct Sets { // union and find
  std::vector<int> up;
  explicit Sets(size_t n) : up(n) { std::iota(up.begin(), up.end(), 0); }
  int root(int i) {
    while (up[static_cast<size_t>(i)] != i)
      i = up[static_cast<size_t>(i)] = up[static_cast<size_t>(up[static_cast<size_t>(i)])];
    return i;
  }
  void join(int a, int b) { up[static_cast<size_t>(root(a))] = root(b); }
};

// Joins what is matched both ways and lies on one epipolar geometry.
void match(const Features &a, const Features &b, int first_a, int first_b, Sets &sets) {
  if (a.keys.size() < kMinInliers || b.keys.size() < kMinInliers) return;
  cv::Mat squared;
  cv::batchDistance(a.descriptors, b.descriptors, squared, CV_32F, cv::noArray(), cv::NORM_L2SQR);
  const std::vector<int> there = nearest(squared), back = nearest(squared.t());
  std::vector<cv::Point2f> pa, pb;
  std::vector<std::pair<int, int>> pairs;
  for (size_t i = 0; i < there.size(); i++)
    if (there[i] >= 0 && back[static_cast<size_t>(there[i])] == static_cast<int>(i)) {
      pa.push_back(a.keys[i].pt);
      pb.push_back(b.keys[static_cast<size_t>(there[i])].pt);
      pairs.emplace_back(static_cast<int>(i), there[i]);
    }
  if (pairs.size() < kMinInliers) return;
  std::vector<uchar> is_good;
  cv::findFundamentalMat(pa, pb, cv::FM_RANSAC, kEpipolarPx, 0.999, is_good);
  if (is_good.size() != pairs.size()) return;
  for (size_t i = 0; i < pairs.size(); i++)
    if (is_good[i]) sets.join(first_a + pairs[i].first, first_b + pairs[i].second);
}

double far(const sv_structure_view &a, const sv_structure_view &b) {
  double d2 = 0;
  for (int k = 0; k < 6; k++) d2 += (a.place[k] - b.place[k]) * (a.place[k] - b.place[k]);
  return std::sqrt(d2);
}

// Is b among the views nearest to a, or a among those nearest to b?
bool are_neighbours(const sv_structure_view *v, size_t n, size_t a, size_t b, size_t n_nearest) {
  const double d = far(v[a], v[b]);
  size_t nearer_a = 0, nearer_b = 0;
  for (size_t i = 0; i < n; i++) {
    if (i == a || i == b) continue;
    nearer_a += far(v[a], v[i]) < d;
    nearer_b += far(v[b], v[i]) < d;
  }
  return nearer_a < n_nearest || nearer_b < n_nearest;
}

struct Seen {
  int view;
  cv::Point2d at;
  bool is_coarse;
};

sv_align_image image_of(const Features &f) { return {f.image.cols, f.image.rows, f.image.ptr<uint8_t>()}; }

// Aligns the patch of the first view with the others: SIFT's places are good to some tenths of a
// pixel only. What does not look like it there is left out.
void refine(const std::vector<Features> &f, bool keeps_unaligned, std::vector<std::vector<Seen>> &tracks) {
  for (auto &t : tracks) {
    const sv_align_image from = image_of(f[static_cast<size_t>(t[0].view)]);
    const double at[2] = {t[0].at.x, t[0].at.y};
    for (size_t k = 1; k < t.size(); k++) {
      const sv_align_image to = image_of(f[static_cast<size_t>(t[k].view)]);
      double uv[2] = {t[k].at.x, t[k].at.y}, warp[4] = {1, 0, 0, 1};
      const double like = sv_align_patch(&from, at, &to, uv, warp);
      if (like >= kLikeness && std::hypot(uv[0] - t[k].at.x, uv[1] - t[k].at.y) <= kMovePx)
        t[k].at = cv::Point2d(uv[0], uv[1]);
      else if (keeps_unaligned) t[k].is_coarse = true;
      else t[k].view = -1;
    }
  }
}

std::vector<std::vector<Seen>> gather(const std::vector<Features> &f, const std::vector<int> &first,
                                      size_t n_seen, Sets &sets) {
  std::vector<std::vector<Seen>> by_root(sets.up.size());
  std::vector<std::vector<Seen>> out;
  for (size_t v = 0; v < f.size(); v++)
    for (size_t k = 0; k < f[v].keys.size(); k++)
      by_root[static_cast<size_t>(sets.root(first[v] + static_cast<int>(k)))].push_back(
          {static_cast<int>(v), f[v].keys[k].pt, false});
  for (auto &t : by_root) {
    bool is_one_each = t.size() >= n_seen;
    for (size_t k = 1; k < t.size() && is_one_each; k++)
      is_one_each = t[k].view != t[k - 1].view; // in order of views
    if (!is_one_each) continue;
    std::swap(t[0], t[t.size() / 2]); // a view in the middle looks least different from the others
    out.push_back(t);
  }
  return out;
}

} // namespace

bool sv_structure_available(void) { return true; }

sv_structure_options sv_structure_defaults(void) { return {800, 6, 3, false, nullptr, nullptr}; }

int sv_structure_tracks(const sv_structure_view *views, int n_views, const sv_structure_options *o,
                        sv_array_observation **observations, int *n_points) {
  *observations = nullptr;
  *n_points = 0;
  try {
    std::vector<Features> f;
    std::vector<int> first;
    int n_features = 0;
    for (int v = 0; v < n_views; v++) {
      if (o->may_run && !o->may_run(o->self)) return -1;
      f.push_back(describe(views[v], o->n_features));
      first.push_back(n_features);
      n_features += static_cast<int>(f.back().keys.size());
    }
    Sets sets(static_cast<size_t>(n_features));
    for (size_t a = 0; a < f.size(); a++) {
      if (o->may_run && !o->may_run(o->self)) return -1;
      for (size_t b = a + 1; b < f.size(); b++)
        if (are_neighbours(views, f.size(), a, b, static_cast<size_t>(o->n_neighbours)))
          match(f[a], f[b], first[a], first[b], sets);
    }
    const size_t n_seen = static_cast<size_t>(o->n_seen);
    auto tracks = gather(f, first, n_seen, sets);
    refine(f, o->keeps_unaligned, tracks);
    std::vector<sv_array_observation> all;
    for (auto &t : tracks) {
      t.erase(std::remove_if(t.begin(), t.end(), [](const Seen &s) { return s.view < 0; }), t.end());
      if (t.size() < n_seen) continue;
      for (const Seen &s : t)
        all.push_back({s.view, *n_points, {s.at.x + 0.5, s.at.y + 0.5}, false, s.is_coarse});
      (*n_points)++;
    }
    if (all.empty()) return 0;
    *observations =
        static_cast<sv_array_observation *>(std::malloc(all.size() * sizeof(sv_array_observation)));
    if (!*observations) return -1;
    std::copy(all.begin(), all.end(), *observations);
    return static_cast<int>(all.size());
  } catch (const std::exception &) {
    return -1;
  }
}

// --- the start -----------------------------------------------------------------------------------
namespace {

struct Rays { // observations by point, as directions on z = 1
  std::vector<std::vector<std::pair<int, cv::Point2d>>> of;
};

Rays rays_of(const sv_lens_array *b) {
  Rays r;
  r.of.resize(static_cast<size_t>(b->n_points));
  for (int i = 0; i < b->n_observations; i++) {
    const sv_array_observation &o = b->observations[i];
    const double *p = b->models[o.view].p;
    r.of[static_cast<size_t>(o.point)].push_back(
        {o.view, cv::Point2d((o.uv_px[0] - p[2]) / p[0], (o.uv_px[1] - p[3]) / p[1])});
  }
  return r;
}

const cv::Point2d *seen_by(const Rays &r, int point, int view) {
  for (const auto &o : r.of[static_cast<size_t>(point)])
    if (o.first == view) return &o.second;
  return nullptr;
}

// Linear triangulation from all views that are placed. False when it lies behind one of them.
bool triangulate(const Rays &r, int point, const std::vector<bool> &is_placed, const sv_pose *poses,
                 double x[3]) {
  cv::Mat a(0, 4, CV_64F);
  for (const auto &o : r.of[static_cast<size_t>(point)]) {
    if (!is_placed[static_cast<size_t>(o.first)]) continue;
    const sv_pose &p = poses[o.first];
    for (int k = 0; k < 2; k++) {
      const double c = k ? o.second.y : o.second.x;
      cv::Mat row(1, 4, CV_64F);
      for (int j = 0; j < 3; j++) row.at<double>(j) = c * p.r[6 + j] - p.r[3 * k + j];
      row.at<double>(3) = c * p.t[2] - p.t[k];
      a.push_back(row);
    }
  }
  if (a.rows < 4) return false;
  cv::Mat h;
  cv::SVD::solveZ(a, h);
  const double w = h.at<double>(3);
  if (std::fabs(w) < 1e-12) return false;
  for (int k = 0; k < 3; k++) x[k] = h.at<double>(k) / w;
  for (const auto &o : r.of[static_cast<size_t>(point)]) {
    if (!is_placed[static_cast<size_t>(o.first)]) continue;
    double c[3];
    sv_pose_apply(c, &poses[o.first], x);
    if (!(c[2] > 1e-9)) return false;
  }
  return true;
}

sv_pose pose_of(const cv::Mat &r, const cv::Mat &t) {
  sv_pose p;
  for (int i = 0; i < 9; i++) p.r[i] = r.at<double>(i / 3, i % 3);
  for (int i = 0; i < 3; i++) p.t[i] = t.at<double>(i);
  return p;
}

// View 0 and the partner with which most points are seen in front of both, from the far side of the
// array first.
int first_pair(const sv_lens_array *b, const Rays &r, sv_pose *pose) {
  int best = -1;
  double best_score = 0;
  const double f = b->models[0].p[0];
  for (int v = 1; v < b->n_views; v++) {
    std::vector<cv::Point2d> p, q;
    for (int i = 0; i < b->n_points; i++) {
      const cv::Point2d *a = seen_by(r, i, 0), *c = seen_by(r, i, v);
      if (a && c) {
        p.push_back(*a);
        q.push_back(*c);
      }
    }
    if (p.size() < kMinInliers) continue;
    cv::Mat mask, rot, t;
    cv::Mat e = cv::findEssentialMat(p, q, 1.0, cv::Point2d(0, 0), cv::RANSAC, 0.9999, 1.0 / f, mask);
    if (e.rows != 3 || e.cols != 3) continue;
    const int n = cv::recoverPose(e, p, q, rot, t, 1.0, cv::Point2d(0, 0), mask);
    std::vector<double> shift; // how far points moved about their mean: parallax
    cv::Point2d mean(0, 0);
    for (size_t i = 0; i < p.size(); i++) mean += (q[i] - p[i]) * (1.0 / static_cast<double>(p.size()));
    for (size_t i = 0; i < p.size(); i++) shift.push_back(cv::norm(q[i] - p[i] - mean));
    std::nth_element(shift.begin(), shift.begin() + static_cast<long>(shift.size() / 2), shift.end());
    const double score = std::min(n, 150) * shift[shift.size() / 2];
    if (n >= kMinInliers && score > best_score) {
      best_score = score;
      best = v;
      *pose = pose_of(rot, t);
    }
  }
  return best;
}

bool place(const sv_lens_array *b, const Rays &r, const std::vector<bool> &has_point, int view,
           sv_pose *pose) {
  std::vector<cv::Point3d> x;
  std::vector<cv::Point2d> q;
  for (int i = 0; i < b->n_points; i++) {
    const cv::Point2d *a = seen_by(r, i, view);
    if (!a || !has_point[static_cast<size_t>(i)]) continue;
    x.emplace_back(b->points[i][0], b->points[i][1], b->points[i][2]);
    q.push_back(*a);
  }
  if (x.size() < kMinInliers) return false;
  cv::Mat rvec, t, rot;
  std::vector<int> inliers;
  if (!cv::solvePnPRansac(x, q, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rvec, t, false, 500,
                          static_cast<float>(3 / b->models[view].p[0]), 0.999, inliers, cv::SOLVEPNP_EPNP))
    return false;
  if (inliers.size() < kMinInliers) return false;
  cv::Rodrigues(rvec, rot);
  *pose = pose_of(rot, t);
  return true;
}

void spread_points(sv_lens_array *b, const Rays &r, const std::vector<bool> &is_placed,
                   std::vector<bool> &has_point) {
  for (int i = 0; i < b->n_points; i++)
    has_point[static_cast<size_t>(i)] = triangulate(r, i, is_placed, b->cam_from_rig, b->points[i]);
}

} // namespace

bool sv_structure_start(sv_lens_array *b) {
  try {
    const Rays r = rays_of(b);
    std::vector<bool> is_placed(static_cast<size_t>(b->n_views));
    std::vector<bool> has_point(static_cast<size_t>(b->n_points));
    sv_pose second;
    cv::setRNGSeed(1); // RANSAC draws the same on every run
    const int v = first_pair(b, r, &second);
    if (v < 0) return false;
    b->cam_from_rig[0] = sv_pose_identity();
    b->cam_from_rig[v] = second;
    is_placed[0] = is_placed[static_cast<size_t>(v)] = true;
    spread_points(b, r, is_placed, has_point);
    for (int n = 2; n < b->n_views;) {
      const int before = n;
      for (int c = 0; c < b->n_views; c++)
        if (!is_placed[static_cast<size_t>(c)] && place(b, r, has_point, c, &b->cam_from_rig[c])) {
          is_placed[static_cast<size_t>(c)] = true;
          n++;
        }
      if (n == before) return false;
      spread_points(b, r, is_placed, has_point);
    }
    // a point without a place: before view 0, all that sees it left out
    for (int i = 0; i < b->n_points; i++)
      if (!has_point[static_cast<size_t>(i)]) {
        b->points[i][0] = b->points[i][1] = 0;
        b->points[i][2] = 1;
      }
    for (int i = 0; i < b->n_observations; i++)
      b->observations[i].is_outlier = !has_point[static_cast<size_t>(b->observations[i].point)];
    return true;
  } catch (const std::exception &) {
    return false;
  }
}
