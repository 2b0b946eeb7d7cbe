// SPDX-License-Identifier: Apache-2.0
#include "platform/v4l2/format.h"

#include <linux/videodev2.h>

const sv_v4l2_format sv_v4l2_formats[] = {
    {"NV12", SV_PIX_NV12},    {"NM12", SV_PIX_NV12},    {"YUYV", SV_PIX_YUYV},    {"UYVY", SV_PIX_UYVY},
    {"RGB3", SV_PIX_RGB8},    {"BGR3", SV_PIX_BGR8},    {"XR24", SV_PIX_BGRX8},   {"MJPG", SV_PIX_JPEG},
    {"JPEG", SV_PIX_JPEG},    {"RGGB", SV_PIX_RGGB8},   {"GRBG", SV_PIX_GRBG8},   {"GBRG", SV_PIX_GBRG8},
    {"BA81", SV_PIX_BGGR8},   {"pRAA", SV_PIX_RGGB10P}, {"pgAA", SV_PIX_GRBG10P}, {"pGAA", SV_PIX_GBRG10P},
    {"pBAA", SV_PIX_BGGR10P}, {"RG10", SV_PIX_RGGB10},  {"BA10", SV_PIX_GRBG10},  {"GB10", SV_PIX_GBRG10},
    {"BG10", SV_PIX_BGGR10},  {"pRCC", SV_PIX_RGGB12P}, {"pgCC", SV_PIX_GRBG12P}, {"pGCC", SV_PIX_GBRG12P},
    {"pBCC", SV_PIX_BGGR12P}, {"RG12", SV_PIX_RGGB12},  {"BA12", SV_PIX_GRBG12},  {"GB12", SV_PIX_GBRG12},
    {"BG12", SV_PIX_BGGR12},  {"RG16", SV_PIX_RGGB16},  {"GR16", SV_PIX_GRBG16},  {"GB16", SV_PIX_GBRG16},
    {"BYR2", SV_PIX_BGGR16},  {"GREY", SV_PIX_GREY8},   {"Y10P", SV_PIX_GREY10P}, {"Y12P", SV_PIX_GREY12P},
    {"Y10 ", SV_PIX_GREY10},  {"Y12 ", SV_PIX_GREY12},  {"Y16 ", SV_PIX_GREY16},
};
const int sv_v4l2_n_formats = sizeof sv_v4l2_formats / sizeof *sv_v4l2_formats;

uint32_t sv_v4l2_fourcc(const char name[5]) {
  uint32_t f = 0;
  for (int i = 0; i < 4; i++) f |= (uint32_t)(uint8_t)name[i] << 8 * i;
  return f;
}

void sv_v4l2_fourcc_name(uint32_t fourcc, char out[5]) {
  for (int i = 0; i < 4; i++) {
    uint8_t c = (uint8_t)(fourcc >> 8 * i);
    out[i] = c >= ' ' && c < 127 ? (char)c : '?';
  }
  out[4] = 0;
}

int sv_v4l2_format_index(uint32_t fourcc) {
  for (int i = 0; i < sv_v4l2_n_formats; i++)
    if (sv_v4l2_fourcc(sv_v4l2_formats[i].name) == fourcc) return i;
  return -1;
}

uint32_t sv_v4l2_format_planes(uint32_t fourcc) { return fourcc == V4L2_PIX_FMT_NV12M ? 2 : 1; }
