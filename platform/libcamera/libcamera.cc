// SPDX-License-Identifier: Apache-2.0
// libcamera, opening: cameras, formats, requests, the list. What differs between releases:
// shim.hpp.
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <string>
#include <sys/mman.h>

#include "platform/libcamera/module.h"
#include "platform/libcamera/shim.hpp"

using namespace libcamera;

// --- formats -------------------------------------------------------------------------------------
// In the order in which they are preferred; `name` is what format= takes (V4L2's names).
static const struct {
  const char *name;
  PixelFormat pixel;
  sv_pixel_format format;
} known[] = {
    {"NV12", formats::NV12, SV_PIX_NV12},
    {"YUYV", formats::YUYV, SV_PIX_YUYV},
    {"UYVY", formats::UYVY, SV_PIX_UYVY},
    {"RGB3", formats::BGR888, SV_PIX_RGB8}, // DRM names the bytes from the high end
    {"BGR3", formats::RGB888, SV_PIX_BGR8},
    {"XR24", formats::XRGB8888, SV_PIX_BGRX8},
    {"XB24", formats::XBGR8888, SV_PIX_RGBX8},
    {"MJPG", formats::MJPEG, SV_PIX_JPEG},
    {"GREY", formats::R8, SV_PIX_GREY8},
    {"Y10 ", formats::R10, SV_PIX_GREY10},
    {"RGGB", formats::SRGGB8, SV_PIX_RGGB8},
    {"GRBG", formats::SGRBG8, SV_PIX_GRBG8},
    {"GBRG", formats::SGBRG8, SV_PIX_GBRG8},
    {"BA81", formats::SBGGR8, SV_PIX_BGGR8},
    {"pRAA", formats::SRGGB10_CSI2P, SV_PIX_RGGB10P},
    {"pgAA", formats::SGRBG10_CSI2P, SV_PIX_GRBG10P},
    {"pGAA", formats::SGBRG10_CSI2P, SV_PIX_GBRG10P},
    {"pBAA", formats::SBGGR10_CSI2P, SV_PIX_BGGR10P},
    {"RG10", formats::SRGGB10, SV_PIX_RGGB10},
    {"BA10", formats::SGRBG10, SV_PIX_GRBG10},
    {"GB10", formats::SGBRG10, SV_PIX_GBRG10},
    {"BG10", formats::SBGGR10, SV_PIX_BGGR10},
    {"pRCC", formats::SRGGB12_CSI2P, SV_PIX_RGGB12P},
    {"pgCC", formats::SGRBG12_CSI2P, SV_PIX_GRBG12P},
    {"pGCC", formats::SGBRG12_CSI2P, SV_PIX_GBRG12P},
    {"pBCC", formats::SBGGR12_CSI2P, SV_PIX_BGGR12P},
    {"RG12", formats::SRGGB12, SV_PIX_RGGB12},
    {"BA12", formats::SGRBG12, SV_PIX_GRBG12},
    {"GB12", formats::SGBRG12, SV_PIX_GBRG12},
    {"BG12", formats::SBGGR12, SV_PIX_BGGR12},
};

static int known_index(const PixelFormat &p) {
  for (size_t i = 0; i < sizeof known / sizeof *known; i++)
    if (known[i].pixel == p) return static_cast<int>(i);
  return -1;
}

// libcamera's log would interleave with ours; set the variable to see it.
static void quieten() { setenv("LIBCAMERA_LOG_LEVELS", "*:ERROR", 0); }

// --- opening -------------------------------------------------------------------------------------
static std::shared_ptr<Camera> find_camera(sv_libcamera *s, const char *name, sv_err *err) {
  auto all = s->manager->cameras();
  long long i;
  if (sv_parse_int(name, strlen(name), &i)) {
    if (i >= 0 && i < static_cast<long long>(all.size())) return all[static_cast<size_t>(i)];
    sv_fail(err, SV_E_NOT_FOUND, "libcamera: no camera %s; it has %d ('subview cameras' lists them)", name,
            static_cast<int>(all.size()));
    return nullptr;
  }
  auto camera = s->manager->get(name);
  if (!camera) sv_fail(err, SV_E_NOT_FOUND, "libcamera: no camera \"%s\"", name);
  return camera;
}

static int choose_format(const StreamConfiguration &sc, const char *wanted) {
  auto offered = sc.formats().pixelformats();
  for (size_t k = 0; k < sizeof known / sizeof *known; k++) {
    if (wanted[0] && strcmp(known[k].name, wanted) != 0) continue;
    for (const PixelFormat &p : offered)
      if (p == known[k].pixel) return static_cast<int>(k);
  }
  return -1;
}

static bool is_raw_name(const char *name) {
  for (const auto &k : known)
    if (!strcmp(k.name, name)) return sv_pixel(k.format)->layout == SV_LAYOUT_BAYER;
  return false;
}

// What its frames show of the sensor. The crop is asked for, as releases differ in what they choose
// by themselves: the largest of the frame's shape, in the middle of what the sensor's mode reads.
static void choose_crop(Cam *c, int w, int h, bool is_raw) {
  const ControlList &p = c->camera->properties();
  auto all = p.get(properties::PixelArrayActiveAreas);
  auto most = p.get(properties::ScalerCropMaximum); // valid once the camera is configured
  c->has_crop = false;
  c->caps.area = {};
  if (!all || all->empty() || !most || most->isNull()) return;
  const Rectangle sensor = (*all)[0];
  Rectangle r = *most;
  if (!is_raw) {
    if (!has(c, controls::ScalerCrop)) return;
    const double scale = std::fmin(static_cast<double>(r.width) / w, static_cast<double>(r.height) / h);
    const auto cw = static_cast<unsigned>(scale * w + 0.5), ch = static_cast<unsigned>(scale * h + 0.5);
    r = Rectangle(r.x + static_cast<int>(r.width - cw) / 2, r.y + static_cast<int>(r.height - ch) / 2, cw,
                  ch);
    c->crop = r;
    c->has_crop = true;
  }
  c->caps.area = {static_cast<int>(sensor.width), static_cast<int>(sensor.height),
                  static_cast<double>(r.x),       static_cast<double>(r.y),
                  static_cast<double>(r.width),   static_cast<double>(r.height)};
}

static sv_status configure(sv_libcamera *s, Cam *c, const char *name, sv_err *err) {
  const sv_camera_options &o = s->cfg;
  c->config = c->camera->generateConfiguration(
      {is_raw_name(o.format) ? StreamRole::Raw : StreamRole::VideoRecording});
  if (!c->config || c->config->size() != 1)
    return sv_fail(err, SV_E_UNSUPPORTED, "libcamera:%s: it has no stream for video", name);
  StreamConfiguration &sc = c->config->at(0);
  bool is_again = c->i_format >= 0; // back after a fault: only the negotiated format is accepted
  int k = choose_format(sc, is_again ? known[c->i_format].name : o.format);
  int want_w = is_again ? c->caps.width_px : o.width_px, want_h = is_again ? c->caps.height_px : o.height_px;
  if (k < 0)
    return sv_fail(err, SV_E_UNSUPPORTED, "libcamera:%s: it does not offer %s", name,
                   o.format[0] ? o.format : "a format that is known here");
  sc.pixelFormat = known[k].pixel;
  if (want_w) sc.size = Size(static_cast<unsigned>(want_w), static_cast<unsigned>(want_h));
  sc.bufferCount = static_cast<unsigned>(o.n_buffers);
  if (c->config->validate() == CameraConfiguration::Invalid)
    return sv_fail(err, is_again ? SV_E_DEVICE : SV_E_RANGE, "libcamera:%s: no such mode", name);
  int got = known_index(sc.pixelFormat), w = static_cast<int>(sc.size.width);
  int h = static_cast<int>(sc.size.height);
  if (got != k)
    return sv_fail(err, SV_E_RANGE, "libcamera:%s: offers %s at %dx%d px, expected %s", name,
                   sc.pixelFormat.toString().c_str(), w, h, known[k].name);
  if (want_w && (w != want_w || h != want_h))
    return sv_fail(err, SV_E_RANGE, "libcamera:%s: offers %dx%d px, expected %dx%d; size=%dx%d would do",
                   name, w, h, want_w, want_h, w, h);
  if (c->camera->configure(c->config.get()) < 0)
    return sv_fail(err, SV_E_DEVICE, "libcamera:%s: it cannot be configured", name);
  c->i_format = k;
  c->stream = sc.stream();
  c->stride_bytes = static_cast<int>(sc.stride);
  c->caps.width_px = w;
  c->caps.height_px = h;
  c->caps.format = known[k].format;
  bool is_jpeg = c->caps.format == SV_PIX_JPEG;
  size_t rows = static_cast<size_t>(h) + (c->caps.format == SV_PIX_NV12 ? static_cast<size_t>(h + 1) / 2 : 0);
  c->caps.frame_bytes = is_jpeg ? sc.frameSize : static_cast<size_t>(sc.stride) * rows;
  if (sc.colorSpace) {
    bool is_full = sc.colorSpace->range == ColorSpace::Range::Full;
    bool is_709 = sc.colorSpace->ycbcrEncoding == ColorSpace::YcbcrEncoding::Rec709;
    c->caps.yuv = is_709 ? (is_full ? SV_YUV_709_FULL : SV_YUV_709) : is_full ? SV_YUV_601_FULL : SV_YUV_601;
  }
  c->caps.tone = sv_camera_tone(&o, c->caps.format);
  choose_crop(c, w, h, is_raw_name(known[k].name));
  return SV_OK;
}

// Each descriptor of a buffer is mapped once, as far as its planes reach.
static bool map_buffer(Slot *s) {
  const auto &planes = s->buffer->planes();
  size_t n = planes.size() < 3 ? planes.size() : 3;
  for (size_t i = 0; i < n; i++) {
    size_t first = 0, offset = planes[i].offset == FrameBuffer::Plane::kInvalidOffset ? 0 : planes[i].offset;
    while (planes[first].fd.get() != planes[i].fd.get()) first++;
    if (first == i) {
      size_t end = 0;
      for (size_t k = i; k < n; k++)
        if (planes[k].fd.get() == planes[i].fd.get()) {
          size_t at = planes[k].offset == FrameBuffer::Plane::kInvalidOffset ? 0 : planes[k].offset;
          end = at + planes[k].length > end ? at + planes[k].length : end;
        }
      void *p = mmap(nullptr, end, PROT_READ, MAP_SHARED, planes[i].fd.get(), 0);
      if (p == MAP_FAILED) return false;
      s->maps[i] = {static_cast<uint8_t *>(p), end};
    }
    s->plane[i] = s->maps[first].p + offset;
    s->cap_bytes[i] = s->maps[first].bytes - offset;
  }
  return n > 0;
}

void sv_libcamera_free_slot(Slot *slot) {
  for (Mapping &m : slot->maps)
    if (m.p) munmap(m.p, m.bytes);
  *slot = Slot();
}

size_t sv_libcamera_plane_bytes(const Cam *c, int rows) {
  return static_cast<size_t>(c->stride_bytes) * static_cast<size_t>(rows - 1) +
         sv_pixel_row_bytes(c->caps.format, c->caps.width_px);
}

// Whether planes reach as far as a whole frame does.
static bool is_large_enough(const Cam *c, const Slot &s) {
  const int h = c->caps.height_px, chroma = c->caps.format == SV_PIX_NV12 ? (h + 1) / 2 : 0;
  if (c->caps.format == SV_PIX_JPEG) return true;
  if (!s.plane[1] || !chroma) return s.cap_bytes[0] >= sv_libcamera_plane_bytes(c, h + chroma);
  return s.cap_bytes[0] >= sv_libcamera_plane_bytes(c, h) &&
         s.cap_bytes[1] >= sv_libcamera_plane_bytes(c, chroma);
}

static sv_status make_requests(Cam *c, const char *name, sv_err *err) {
  c->allocator.emplace(c->camera);
  if (c->allocator->allocate(c->stream) < 0)
    return sv_fail(err, SV_E_DEVICE, "libcamera:%s: gives no buffers", name);
  const auto &buffers = c->allocator->buffers(c->stream);
  size_t n = 0;
  for (size_t i = 0; i < c->slots.size() && n < buffers.size() && n < SV_CAMERA_CAP_BUFFERS; i++) {
    Slot &s = c->slots[i];
    if (s.state != RequestState::Empty) continue;
    s.state = RequestState::Idle;
    s.buffer = buffers[n++].get();
    s.request = c->camera->createRequest(i);
    if (!s.request || s.request->addBuffer(c->stream, s.buffer) < 0 || !map_buffer(&s))
      return sv_fail(err, SV_E_DEVICE, "libcamera:%s: a buffer cannot be mapped", name);
    if (!is_large_enough(c, s))
      return sv_fail(err, SV_E_DEVICE, "libcamera:%s: its buffers are smaller than a frame of %dx%d", name,
                     c->caps.width_px, c->caps.height_px);
  }
  if (n < 3)
    return sv_fail(err, SV_E_DEVICE, "libcamera:%s: gives %d buffers, expected at least 3", name,
                   static_cast<int>(n));
  return SV_OK;
}

// SensorTimestamp is CLOCK_BOOTTIME by its definition, and CLOCK_MONOTONIC from handlers that pass
// V4L2's stamps on. They differ only on a machine that has slept.
static sv_clock_id stamp_clock() {
  timespec a, b;
  clock_gettime(CLOCK_MONOTONIC, &a);
  clock_gettime(CLOCK_BOOTTIME, &b);
  sv_ns d_ns = (b.tv_sec - a.tv_sec) * SV_NS_PER_S + (b.tv_nsec - a.tv_nsec);
  return d_ns < SV_NS_PER_MS ? SV_CLOCK_MONOTONIC : SV_CLOCK_BOOTTIME;
}

// By name: releases and builds differ in whether they have it and in how their headers declare it.
static unsigned id_of(const char *name) {
  for (const auto &c : controls::controls)
    if (c.second->name() == name) return c.second->id();
  return 0;
}

static sv_status check_controls(const sv_libcamera *s, const Cam *c, const char *name, sv_err *err) {
  const sv_camera_options &o = s->cfg;
  const char *missing = o.exposure_ns > 0 && !has(c, controls::ExposureTime)  ? "exposure="
                        : o.n_brackets && !has(c, controls::ExposureTime)     ? "brackets="
                        : o.gain >= 0 && !has(c, controls::AnalogueGain)      ? "gain="
                        : o.fps > 0 && !has(c, controls::FrameDurationLimits) ? "fps="
                        : o.white_k > 0                                       ? "wb="
                        : o.is_exported                                       ? "dmabuf="
                                                                              : nullptr;
  if (missing) return sv_fail(err, SV_E_UNSUPPORTED, "libcamera:%s: unsupported setting: %s", name, missing);
  const ControlInfoMap &m = c->camera->controls();
  if (sync_of(c) == SV_RPI_SYNC_OFF) return SV_OK;
  if (!s->sync_mode_id || m.find(s->sync_mode_id) == m.end())
    return sv_fail(err, SV_E_UNSUPPORTED, "libcamera:%s: no rpi.sync with libcamera %d.%d.%d (sync=)", name,
                   LIBCAMERA_VERSION_MAJOR, LIBCAMERA_VERSION_MINOR, LIBCAMERA_VERSION_PATCH);
  // It lengthens and shortens frames of a fixed rate.
  auto limits = m.find(&controls::FrameDurationLimits);
  const double us = limits == m.end() ? 0 : static_cast<double>(limits->second.min().get<int64_t>());
  if (!(o.fps > 0) || o.fps * us >= 1e6)
    return sv_fail(err, SV_E_ARG,
                   "libcamera:%s: sync= needs a frame rate below the camera's highest (%g); expected fps=",
                   name, us > 0 ? 1e6 / us : 0.0);
  return SV_OK;
}

sv_status sv_libcamera_attach(sv_libcamera *s, Cam *c, std::shared_ptr<Camera> camera, sv_err *err) {
  const char *name = s->cfg.name[c->i_camera];
  if (camera->acquire() < 0) return sv_fail(err, SV_E_DEVICE, "libcamera:%s: another program uses it", name);
  c->camera = std::move(camera);
  sv_status r = configure(s, c, name, err);
  if (r >= 0) r = check_controls(s, c, name, err);
  if (r >= 0) r = make_requests(c, name, err);
  if (r < 0) {
    sv_libcamera_detach(c);
    return r;
  }
  c->is_gone = false;
  c->camera->requestCompleted.connect(c, &Cam::requestDone);
  c->camera->disconnected.connect(c, &Cam::disconnected);
  return SV_OK;
}

void sv_libcamera_detach(Cam *c) {
  if (!c->camera) return;
  if (c->is_streaming) c->camera->stop(); // completes what is queued as cancelled before it returns
  c->is_streaming = false;
  c->camera->requestCompleted.disconnect(c);
  c->camera->disconnected.disconnect(c);
  for (Slot &slot : c->slots) {
    if (slot.state == RequestState::Empty || slot.state == RequestState::Orphan) continue;
    bool is_on_loan = slot.state == RequestState::OnLoan;
    slot.request.reset();
    slot.buffer = nullptr;
    if (is_on_loan) slot.state = RequestState::Orphan; // the mapping holds the memory
    else sv_libcamera_free_slot(&slot);
  }
  c->allocator.reset();
  c->config.reset();
  c->camera->release();
  c->camera.reset();
}

static sv_status open_camera(sv_libcamera *s, int i, sv_err *err) {
  const char *name = s->cfg.name[i];
  s->cams.push_back(std::make_unique<Cam>());
  Cam *c = s->cams.back().get();
  c->i_camera = i;
  c->owner = s;
  auto camera = find_camera(s, name, err);
  if (!camera) return SV_E_NOT_FOUND;
  c->id = camera->id();
  sv_status r = sv_libcamera_attach(s, c, std::move(camera), err);
  if (r < 0) return r;
  sv_fmt(c->caps.name, sizeof c->caps.name, "camera%d", i);
  c->caps.fps = s->cfg.fps;
  c->caps.clock = s->cfg.has_clock ? s->cfg.clock : stamp_clock();
  c->caps.stamp = s->cfg.has_stamp ? s->cfg.stamp : SV_STAMP_START; // of the first row
  return SV_OK;
}

extern "C" sv_status sv_libcamera_open(sv_libcamera **self, const sv_camera_options *cfg,
                                       const sv_clock *clock, sv_err *err) {
  auto *s = new sv_libcamera;
  *self = nullptr;
  s->cfg = *cfg;
  s->clock = *clock;
  quieten();
  s->manager = std::make_unique<CameraManager>();
  sv_status r = SV_OK;
  if (s->manager->start() < 0) {
    s->manager.reset();
    r = sv_fail(err, SV_E_DEVICE, "libcamera: its camera manager does not start");
  }
  s->sync_mode_id = id_of("SyncMode");
  s->sync_ready_id = id_of("SyncReady");
  for (int i = 0; r >= 0 && i < cfg->n_cameras; i++) r = open_camera(s, i, err);
  if (r < 0) {
    sv_libcamera_close(s);
    return r;
  }
  *self = s;
  return SV_OK;
}

extern "C" void sv_libcamera_close(sv_libcamera *s) {
  if (!s) return;
  for (auto &c : s->cams) {
    sv_libcamera_detach(c.get());
    for (Slot &slot : c->slots) sv_libcamera_free_slot(&slot);
  }
  s->cams.clear();
  if (s->manager) s->manager->stop();
  delete s;
}

// --- the list ------------------------------------------------------------------------------------
static void list_one(sv_str *out, int i, Camera *camera) {
  sv_str_add(out, "libcamera:%d  %s", i, camera->id().c_str());
  auto config = camera->generateConfiguration({StreamRole::VideoRecording});
  if (!config || config->size() != 1) {
    sv_str_add(out, "  no stream for video\n");
    return;
  }
  const StreamFormats &f = config->at(0).formats();
  for (const PixelFormat &p : f.pixelformats()) {
    int k = known_index(p);
    if (k < 0) continue;
    int n = known[k].name[3] == ' ' ? 3 : 4;
    sv_str_add(out, "  %.*s", n, known[k].name);
    auto sizes = f.sizes(p);
    for (size_t z = 0; z < sizes.size() && z < 16; z++)
      sv_str_add(out, " %ux%u", sizes[z].width, sizes[z].height);
  }
  const ControlInfoMap &m = camera->controls();
  auto limits = m.find(&controls::FrameDurationLimits);
  if (limits != m.end() && limits->second.min().get<int64_t>() > 0)
    sv_str_add(out, "  up to %.0f fps", 1e6 / static_cast<double>(limits->second.min().get<int64_t>()));
  sv_str_add(out, "\n");
}

extern "C" int sv_libcamera_list(sv_str *out, sv_err *err) {
  quieten();
  CameraManager manager;
  if (manager.start() < 0) return sv_fail(err, SV_E_DEVICE, "libcamera: its camera manager does not start");
  int n = 0;
  {
    auto all = manager.cameras();
    for (auto &camera : all) list_one(out, n++, camera.get());
  }
  manager.stop();
  return n;
}

// --- the module ----------------------------------------------------------------------------------
extern "C" {
__attribute__((visibility("default"))) extern const sv_libcamera_table_t sv_libcamera_table;
const sv_libcamera_table_t sv_libcamera_table = {
    SV_LIBCAMERA_REVISION, SV_LIBCAMERA_SIZES,  sv_libcamera_open,
    sv_libcamera_close,    sv_libcamera_source, sv_libcamera_list,
};
}
