// SPDX-License-Identifier: Apache-2.0
#include <mrgingham/mrgingham.hh>

#include <cstdlib>

#include "calib/solve/corners.h"

bool sv_corners_has_mrgingham(void) { return true; }

bool sv_corners_mrgingham(const sv_corners_job *job, double *uv_px) {
  try {
    cv::Mat image(job->height_px, job->width_px, CV_8UC1, const_cast<uint8_t *>(job->grey));
    std::vector<mrgingham::PointDouble> points;
    signed char *levels = nullptr; // asks for refinement on the finer levels of the pyramid
    int level = mrgingham::find_chessboard_from_image_array(points, &levels, job->n_cols, image);
    std::free(levels);
    if (level < 0 || points.size() != static_cast<size_t>(job->n_cols) * static_cast<size_t>(job->n_rows))
      return false;
    for (size_t i = 0; i < points.size(); i++) {
      uv_px[2 * i] = points[i].x + 0.5;
      uv_px[2 * i + 1] = points[i].y + 0.5;
    }
    return true;
  } catch (const std::exception &) {
    return false; // no memory, or an image that the library cannot take
  }
}
