// SPDX-License-Identifier: Apache-2.0
// Two detectors of OpenCV: the sector based one (findChessboardCornersSB: A. Duda and U. Frese,
// "Accurate Detection and Localization of Checkerboard Corners for Calibration", BMVC 2018), and
// where it does not find the board, the one by quadrangles, refined by gradients (cornerSubPix).
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

#include "calib/solve/corners.h"

bool sv_corners_has_opencv(void) { return true; }

// Half of the shortest way from a corner to its neighbors: a larger window would see other corners.
static double half_square(const std::vector<cv::Point2f> &p, cv::Size board) {
  double least = 1e9;
  for (int j = 0; j < board.height; j++)
    for (int i = 0; i < board.width; i++) {
      const cv::Point2f &a = p[static_cast<size_t>(j * board.width + i)];
      if (i + 1 < board.width)
        least = std::min(least, cv::norm(a - p[static_cast<size_t>(j * board.width + i + 1)]));
      if (j + 1 < board.height)
        least = std::min(least, cv::norm(a - p[static_cast<size_t>((j + 1) * board.width + i)]));
    }
  return 0.5 * least;
}

static bool find_quads(const cv::Mat &image, cv::Size board, std::vector<cv::Point2f> &p) {
  const int flags = cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE;
  for (double scale : {1.0, 2.0, 0.5}) {
    cv::Mat scaled = image;
    if (scale != 1) cv::resize(image, scaled, cv::Size(), scale, scale, cv::INTER_LINEAR);
    if (!cv::findChessboardCorners(scaled, board, p, flags)) continue;
    const float shift = static_cast<float>(0.5 / scale - 0.5);
    for (cv::Point2f &q : p) q = q * static_cast<float>(1 / scale) + cv::Point2f(shift, shift);
    int window = std::max(2, std::min(11, static_cast<int>(half_square(p, board))));
    cv::cornerSubPix(image, p, cv::Size(window, window), cv::Size(-1, -1),
                     cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 60, 1e-4));
    return true;
  }
  return false;
}

bool sv_corners_opencv(const sv_corners_job *job, double *uv_px) {
  try {
    // The first detector looks for neighbors in random trees: whatever was searched before, on
    // whichever thread, an image's corners shall be the same.
    cv::setNumThreads(1);
    cv::setRNGSeed(1);
    cv::Mat image(job->height_px, job->width_px, CV_8UC1, const_cast<uint8_t *>(job->grey));
    const cv::Size board(job->n_cols, job->n_rows);
    std::vector<cv::Point2f> p;
    const int flags = cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY | cv::CALIB_CB_NORMALIZE_IMAGE;
    if (!cv::findChessboardCornersSB(image, board, p, flags) && !find_quads(image, board, p)) return false;
    if (p.size() != static_cast<size_t>(job->n_cols * job->n_rows)) return false;
    for (size_t i = 0; i < p.size(); i++) {
      if (!std::isfinite(p[i].x) || !std::isfinite(p[i].y)) return false;
      uv_px[2 * i] = p[i].x + 0.5;
      uv_px[2 * i + 1] = p[i].y + 0.5;
    }
    return true;
  } catch (const std::exception &) {
    return false; // no memory, or an image that the library cannot take
  }
}
