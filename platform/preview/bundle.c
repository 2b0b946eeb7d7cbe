// SPDX-License-Identifier: Apache-2.0
// The page as part of the program: nothing to find at run time. Paths are from the root of the
// tree, where the compiler is started.
#include "platform/preview/bundle.h"

#define EMBED(name, file)                                                                                    \
  extern const char pv_##name[], pv_##name##_end[];                                                          \
  __asm__(".pushsection .rodata\n"                                                                           \
          ".global pv_" #name ", pv_" #name "_end\n"                                                         \
          "pv_" #name ":\n"                                                                                  \
          ".incbin \"platform/preview/page/" file "\"\n"                                                     \
          "pv_" #name "_end:\n"                                                                              \
          ".byte 0\n"                                                                                        \
          ".popsection\n")

EMBED(page_html, "page.html");
EMBED(page_css, "page.css");
EMBED(page_js, "page.js");
EMBED(view_js, "view.js");
EMBED(plots_js, "plots.js");
EMBED(tools_js, "tools.js");
EMBED(shared_js, "shared.js");
EMBED(past_js, "past.js");
EMBED(scans_js, "scans.js");
EMBED(dome_js, "dome.js");
EMBED(pair_js, "pair.js");
EMBED(calibrate_js, "calibrate.js");
EMBED(paint_js, "paint.js");
EMBED(sorter_js, "sorter.js");
EMBED(raster_js, "raster.js");
EMBED(sequence_js, "sequence.js");
EMBED(icon_svg, "icon.svg");
EMBED(viewer_html, "viewer.html");

const pv_page *pv_bundle(int i) {
  static pv_page pages[] = {{"/", "text/html; charset=utf-8", pv_page_html, 0},
                            {"/page.css", "text/css; charset=utf-8", pv_page_css, 0},
                            {"/page.js", "text/javascript; charset=utf-8", pv_page_js, 0},
                            {"/view.js", "text/javascript; charset=utf-8", pv_view_js, 0},
                            {"/plots.js", "text/javascript; charset=utf-8", pv_plots_js, 0},
                            {"/tools.js", "text/javascript; charset=utf-8", pv_tools_js, 0},
                            {"/past.js", "text/javascript; charset=utf-8", pv_past_js, 0},
                            {"/scans.js", "text/javascript; charset=utf-8", pv_scans_js, 0},
                            {"/dome.js", "text/javascript; charset=utf-8", pv_dome_js, 0},
                            {"/shared.js", "text/javascript; charset=utf-8", pv_shared_js, 0},
                            {"/pair.js", "text/javascript; charset=utf-8", pv_pair_js, 0},
                            {"/calibrate.js", "text/javascript; charset=utf-8", pv_calibrate_js, 0},
                            {"/paint.js", "text/javascript; charset=utf-8", pv_paint_js, 0},
                            {"/raster.js", "text/javascript; charset=utf-8", pv_raster_js, 0},
                            {"/sequence.js", "text/javascript; charset=utf-8", pv_sequence_js, 0},
                            {"/sorter.js", "text/javascript; charset=utf-8", pv_sorter_js, 0},
                            {"/icon.svg", "image/svg+xml", pv_icon_svg, 0}};
  static const char *const ends[] = {
      pv_page_html_end, pv_page_css_end,     pv_page_js_end,  pv_view_js_end,   pv_plots_js_end,
      pv_tools_js_end,  pv_past_js_end,      pv_scans_js_end, pv_dome_js_end,   pv_shared_js_end,
      pv_pair_js_end,   pv_calibrate_js_end, pv_paint_js_end, pv_raster_js_end, pv_sequence_js_end,
      pv_sorter_js_end, pv_icon_svg_end};
  if (i < 0 || i >= (int)(sizeof pages / sizeof *pages)) return NULL;
  pages[i].bytes = (size_t)(ends[i] - pages[i].text);
  return &pages[i];
}

const char *pv_viewer(void) { return pv_viewer_html; }
