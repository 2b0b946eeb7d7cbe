// SPDX-License-Identifier: Apache-2.0
// A program for --prior external: that estimates depth with OpenCV's DNN module. The network and
// its description are the user's (tools/prior/network.h); docs/priors.md has the protocol.
#include <opencv2/core.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "include/subview/version.h"
#include "src/format/json.h"
#include "tools/common/imageio.h"
#include "tools/prior/network.h"

namespace {

const char *const help =
    "usage: subview-depth DESCRIPTION FOLDER\n"
    "Estimates depth with a neural network, as the program of `subview-lab train --prior external:CMD`.\n"
    "FOLDER holds the request that subview-lab wrote; it passes FOLDER itself. The network is a file that "
    "you\n"
    "bring: ONNX (MiDaS, Depth Anything), or TensorFlow Lite with OpenCV 4.8 or newer.\n"
    "\n"
    "DESCRIPTION is a text file, a word and its values on each line:\n"
    "  network FILE         the network; relative to the description's folder\n"
    "  size WIDTHxHEIGHT    its input; images are resized to it\n"
    "  output KIND          disparity (inverse depth, near is large) or depth; unknown scale and offset\n"
    "  mean R G B           input = (value in 0..1 - mean) / std [0 0 0]\n"
    "  std R G B            [1 1 1]\n"
    "  order ORDER          rgb or bgr [rgb]\n"
    "  layer NAME           the output to take [the last one]\n"
    "\n"
    "options:\n"
    "  --version            print the version\n"
    "  --help               this text\n"
    "\n"
    "example:\n"
    "  subview-lab train --data DIR --exposures 1 --prior 'external:subview-depth midas.txt' --out "
    "out/model\n";

// cv::Exception has several lines; the sentence is in the first.
std::string first_line(const cv::Exception &e) {
  const std::string text = e.err.empty() ? e.what() : e.err;
  return text.substr(0, std::min<size_t>(text.find('\n'), 200));
}

class estimator {
public:
  explicit estimator(const sv_network &n) : n_(n) {
    net_ = cv::dnn::readNet(n.path);
    if (net_.empty()) throw cv::Exception(0, "it has no layers", "", "", 0);
  }

  // The output as floats of the image's size.
  cv::Mat run(const sv_bitmap &b) {
    const cv::Mat image(b.height_px, b.width_px, CV_8UC3, b.u8);
    cv::Mat input;
    const cv::Size size(n_.width_px, n_.height_px);
    const bool is_smaller = size.width < b.width_px || size.height < b.height_px;
    cv::resize(image, input, size, 0, 0, is_smaller ? cv::INTER_AREA : cv::INTER_CUBIC);
    input.convertTo(input, CV_32FC3, 1.0 / 255);
    input = (input - cv::Scalar(n_.mean[0], n_.mean[1], n_.mean[2]));
    cv::divide(input, cv::Scalar(n_.deviation[0], n_.deviation[1], n_.deviation[2]), input);
    net_.setInput(cv::dnn::blobFromImage(input, 1, cv::Size(), cv::Scalar(), n_.is_bgr));
    const cv::Mat map = as_map(net_.forward(layer_name()));
    cv::Mat out;
    cv::resize(map, out, image.size(), 0, 0, cv::INTER_LINEAR);
    return out;
  }

private:
  // OpenCV puts "onnx_node!" or the like before the names of ONNX. Empty: the last layer.
  std::string layer_name() const {
    const std::string wanted = n_.layer;
    if (wanted.empty()) return wanted;
    for (const std::string &name : net_.getLayerNames())
      if (name == wanted || name.substr(name.find('!') + 1) == wanted) return name;
    throw cv::Exception(0, "it has no layer '" + wanted + "'", "", "", 0);
  }

  // Networks give [1][H][W], [1][1][H][W] or [1][H][W][1].
  static cv::Mat as_map(const cv::Mat &blob) {
    std::vector<int> sides;
    for (int i = 0; i < blob.dims; i++)
      if (blob.size[i] > 1) sides.push_back(blob.size[i]);
    if (sides.size() != 2 || blob.depth() != CV_32F) {
      std::string shape;
      for (int i = 0; i < blob.dims; i++) shape += (i ? "x" : "") + std::to_string(blob.size[i]);
      throw cv::Exception(0, "its output is " + shape + ", expected one map of floats", "", "", 0);
    }
    return cv::Mat(sides[0], sides[1], CV_32F, const_cast<uchar *>(blob.ptr())).clone();
  }

  const sv_network &n_;
  cv::dnn::Net net_;
};

// To 1..65535, as 0 is unknown depth. Outliers (some networks have spots at borders) must not take
// the range: beyond the 1st and 99th percentile by more than their distance, values are clamped.
sv_status scale_to_16(const cv::Mat &map, std::vector<uint16_t> &out, sv_err *err) {
  std::vector<float> values(map.begin<float>(), map.end<float>());
  for (float v : values)
    if (!std::isfinite(v)) return sv_fail(err, SV_E_FORMAT, "the network's output is not finite");
  std::sort(values.begin(), values.end());
  const size_t last = values.size() - 1;
  const double p1 = values[last / 100], p99 = values[last - last / 100], span = p99 - p1;
  const double lo = std::max<double>(values[0], p1 - span), hi = std::min<double>(values[last], p99 + span);
  if (!(hi > lo)) return sv_fail(err, SV_E_FORMAT, "the network's output is the same value everywhere");
  out.clear();
  for (auto it = map.begin<float>(); it != map.end<float>(); ++it) {
    const double at = (std::clamp<double>(*it, lo, hi) - lo) / (hi - lo);
    out.push_back(static_cast<uint16_t>(1 + std::lround(65534 * at)));
  }
  return SV_OK;
}

sv_status answer(estimator &e, const sv_network &n, const std::string &folder, const char *picture, int i,
                 sv_err *err) {
  sv_bitmap b;
  std::vector<uint16_t> units;
  const std::string path = folder + "/" + picture;
  sv_status s = sv_bitmap_read(path.c_str(), &b, err);
  if (s != SV_OK) return s;
  s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&b, 3, err);
  if (s == SV_OK) {
    try {
      s = scale_to_16(e.run(b), units, err);
    } catch (const cv::Exception &x) {
      s = sv_fail(err, SV_E_FORMAT, "%s: the network failed: %s", n.path, first_line(x).c_str());
    }
  }
  if (s == SV_OK) {
    char name[64];
    const sv_bitmap map = {b.width_px, b.height_px, 1, 16, nullptr, units.data()};
    snprintf(name, sizeof name, "/answer_%03d_%s.png", i, n.is_disparity ? "disparity" : "depth");
    s = sv_bitmap_write_png((folder + name).c_str(), &map, err);
  }
  sv_bitmap_free(&b);
  return s;
}

// The names of the training images; none for requests of another kind, as depth of novel views
// counts only beside a repaired image.
sv_status read_request(const std::string &folder, std::vector<std::string> &pictures, sv_err *err) {
  const std::string path = folder + "/request.json";
  void *data;
  size_t bytes;
  int n = 0;
  sv_json j;
  char kind[32], name[256];
  sv_status s = sv_file_read(path.c_str(), &data, &bytes, err);
  if (s != SV_OK) return s;
  s = sv_json_count(path.c_str(), static_cast<const char *>(data), bytes, &n, err);
  std::vector<jsmntok_t> tokens(static_cast<size_t>(std::max(n, 1)));
  const sv_file_data file = {path.c_str(), data, bytes};
  if (s == SV_OK) s = sv_json_parse(&j, &file, tokens.data(), n, err);
  if (s == SV_OK) s = sv_json_get_string(&j, 0, "kind", kind, sizeof kind, err);
  if (s == SV_END) s = sv_json_missing(&j, 0, "kind", err);
  const bool is_pictures = s == SV_OK && strcmp(kind, "pictures") == 0;
  for (int f = is_pictures ? sv_json_first(&j, sv_json_get(&j, 0, "frames")) : -1; f >= 0 && s == SV_OK;
       f = sv_json_next(&j, f)) {
    s = sv_json_get_string(&j, f, "file_path", name, sizeof name, err);
    if (s == SV_END) s = sv_json_missing(&j, f, "file_path", err);
    if (s == SV_OK) pictures.push_back(name);
  }
  free(data);
  return s;
}

sv_status run(const char *description, const std::string &folder, sv_err *err) {
  sv_network n;
  std::vector<std::string> pictures;
  sv_status s = sv_network_read(description, &n, err);
  if (s == SV_OK) s = read_request(folder, pictures, err);
  if (s != SV_OK || pictures.empty()) return s;
  if (!sv_path_exists(n.path))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: the network %s is not there", description, n.path);
  try {
    estimator e(n);
    for (size_t i = 0; i < pictures.size() && s == SV_OK; i++)
      s = answer(e, n, folder, pictures[i].c_str(), static_cast<int>(i), err);
  } catch (const cv::Exception &x) {
    return sv_fail(err, SV_E_FORMAT, "%s: OpenCV %s cannot read this network: %s", n.path, CV_VERSION,
                   first_line(x).c_str());
  }
  return s;
}

} // namespace

int main(int argc, char **argv) {
  sv_err err = {};
  if (argc == 2 && strcmp(argv[1], "--help") == 0) return fputs(help, stdout) < 0;
  if (argc == 2 && strcmp(argv[1], "--version") == 0)
    return printf("subview-depth %s, OpenCV %s\n", SUBVIEW_VERSION, CV_VERSION) < 0;
  if (argc != 3 || argv[1][0] == '-') {
    fputs("subview-depth: expected a description and a folder (subview-depth --help)\n", stderr);
    return 2;
  }
  if (run(argv[1], argv[2], &err) == SV_OK) return 0;
  fprintf(stderr, "subview-depth: %s\n", err.text);
  return 1;
}
