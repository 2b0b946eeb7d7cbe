// SPDX-License-Identifier: Apache-2.0
// subview-depth as a user runs it, with networks of ONNX that are written here, so that their
// output is known: one convolution, whose weights are asymmetric in place and color.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/common/imageio.h"

#define W 40
#define H 30

static lab_shell shell = {.cwd = ""};
static char program[512];

// --- ONNX: fields of protobuf, a key (number << 3 | type), then a varint or bytes ----------------

typedef struct {
  uint8_t at[2048];
  size_t n;
} message;

static void put_varint(message *m, uint64_t v) {
  for (; v > 127; v >>= 7) m->at[m->n++] = (uint8_t)(v | 128);
  m->at[m->n++] = (uint8_t)v;
}

static void put_int(message *m, unsigned field, uint64_t v) {
  put_varint(m, field << 3);
  put_varint(m, v);
}

static void put_bytes(message *m, unsigned field, const void *data, size_t n) {
  put_varint(m, field << 3 | 2);
  put_varint(m, n);
  assert_true(m->n + n + 16 < sizeof m->at);
  memcpy(m->at + m->n, data, n);
  m->n += n;
}

static void put_text(message *m, unsigned field, const char *text) {
  put_bytes(m, field, text, strlen(text));
}
static void put_message(message *m, unsigned field, const message *part) {
  put_bytes(m, field, part->at, part->n);
}

// A tensor of the graph: its name and shape.
static message value_info(const char *name, int n_channels, int w, int h) {
  message dims = {.n = 0}, tensor = {.n = 0}, type = {.n = 0}, info = {.n = 0};
  const int size[4] = {1, n_channels, h, w};
  for (int i = 0; i < 4; i++) {
    message dim = {.n = 0};
    put_int(&dim, 1, (uint64_t)size[i]);
    put_message(&dims, 1, &dim);
  }
  put_int(&tensor, 1, 1); // float
  put_message(&tensor, 2, &dims);
  put_message(&type, 1, &tensor);
  put_text(&info, 1, name);
  put_message(&info, 2, &type);
  return info;
}

static message weights(const char *name, const uint64_t *dims, int n_dims, const float *values) {
  message m = {.n = 0};
  size_t n = 1;
  for (int i = 0; i < n_dims; i++) {
    put_int(&m, 1, dims[i]);
    n *= dims[i];
  }
  put_int(&m, 2, 1); // float
  put_text(&m, 8, name);
  put_bytes(&m, 9, values, n * sizeof *values);
  return m;
}

static void put_ints(message *node, const char *name, const uint64_t *values, int n) {
  message a = {.n = 0};
  put_text(&a, 1, name);
  for (int i = 0; i < n; i++) put_int(&a, 8, values[i]);
  put_int(&a, 20, 7); // INTS
  put_message(node, 5, &a);
}

// "y = convolution of x, z = |y|": output channel c is c + 0.1 + the sum of `taps` over 3x3 pixels
// and 3 colors.
static void write_network(const char *name, const float taps[27], int n_out, int w, int h) {
  static const uint64_t kernel[2] = {3, 3}, pads[4] = {1, 1, 1, 1};
  const uint64_t dims[4] = {(uint64_t)n_out, 3, 3, 3};
  message conv = {.n = 0}, absolute = {.n = 0}, graph = {.n = 0}, opset = {.n = 0}, model = {.n = 0};
  float all[2 * 27], bias[2] = {0.1f, 1.1f};
  for (int i = 0; i < 27 * n_out; i++) all[i] = taps[i % 27];
  put_text(&conv, 1, "x");
  put_text(&conv, 1, "taps");
  put_text(&conv, 1, "bias");
  put_text(&conv, 2, "y");
  put_text(&conv, 3, "convolution");
  put_text(&conv, 4, "Conv");
  put_ints(&conv, "kernel_shape", kernel, 2);
  put_ints(&conv, "pads", pads, 4);
  put_text(&absolute, 1, "y");
  put_text(&absolute, 2, "z");
  put_text(&absolute, 3, "absolute");
  put_text(&absolute, 4, "Abs");
  message part = weights("taps", dims, 4, all);
  put_message(&graph, 1, &conv);
  put_message(&graph, 1, &absolute);
  put_text(&graph, 2, "depth");
  put_message(&graph, 5, &part);
  part = weights("bias", dims, 1, bias);
  put_message(&graph, 5, &part);
  part = value_info("x", 3, w, h);
  put_message(&graph, 11, &part);
  part = value_info("z", n_out, w, h);
  put_message(&graph, 12, &part);
  put_int(&model, 1, 7);
  put_message(&model, 7, &graph);
  put_int(&opset, 2, 11);
  put_message(&model, 8, &opset);
  char path[400];
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  FILE *f = fopen(path, "wb");
  assert_non_null(f);
  assert_true(fwrite(model.at, 1, model.n, f) == model.n && fclose(f) == 0);
}

// --- pictures and answers ------------------------------------------------------------------------

static uint8_t picture[H][W][3];

static void write_text(const char *name, const char *text) {
  char path[400];
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  FILE *f = fopen(path, "w");
  assert_non_null(f);
  assert_true(fputs(text, f) >= 0 && fclose(f) == 0);
}

static void write_request(void) {
  char path[400];
  snprintf(path, sizeof path, "%s/call/picture_000.png", shell.root);
  const sv_bitmap b = {W, H, 3, 8, &picture[0][0][0], NULL};
  lab_shell_run_well(&shell, "rm -rf call; mkdir call");
  assert_int_equal(sv_bitmap_write_png(path, &b, NULL), SV_OK);
  write_text("call/request.json",
             "{\"kind\": \"pictures\", \"frames\": [{\"file_path\": \"picture_000.png\"}]}");
}

static int run(const char *description) {
  char line[700];
  write_text("net.txt", description);
  snprintf(line, sizeof line, "'%s' net.txt call", program);
  return lab_shell_run(&shell, line);
}

static sv_bitmap answer(const char *kind) {
  char path[400];
  sv_bitmap b;
  snprintf(path, sizeof path, "%s/call/answer_000_%s.png", shell.root, kind);
  assert_int_equal(sv_bitmap_read(path, &b, NULL), SV_OK);
  assert_true(b.width_px == W && b.height_px == H && b.n_channels == 1 && b.bits == 16);
  return b;
}

// Red of the pixel to the right, green of this one, blue of the one below.
static const float TAPS[27] = {0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0,    0, -1,
                               0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.5f, 0};

static double expected(int x, int y, bool is_bgr) {
  static const double mean[3] = {0.4, 0.5, 0.3}, deviation[3] = {0.2, 0.25, 0.5};
  double c[3];
  const int xs[3] = {x + 1, x, x}, ys[3] = {y, y, y + 1};
  for (int i = 0; i < 3; i++) {
    const int k = is_bgr ? 2 - i : i;
    c[i] = xs[i] < W && ys[i] < H ? (picture[ys[i]][xs[i]][k] / 255.0 - mean[k]) / deviation[k] : 0;
  }
  return 2 * c[0] - c[1] + 0.5 * c[2] + 0.1;
}

FIXTURE(setup) {
  const int code = lab_shell_open(&shell, "depth-network");
  if (code != 0) return code < 0 ? code : 0;
  snprintf(program, sizeof program, "%.*sdepth", (int)(strlen(shell.lab) - strlen("lab")), shell.lab);
  shell.is_ready = access(program, X_OK) == 0;
  uint32_t r = 1;
  for (int i = 0; i < W * H * 3; i++) {
    r = r * 1664525u + 1013904223u;
    (&picture[0][0][0])[i] = (uint8_t)(r >> 24);
  }
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

static void need(void) {
  if (shell.is_ready) return;
  print_message("skipped: this build has no subview-depth (libopencv-dnn-dev)\n");
  skip();
}

#define PREPARED "size 40x30 # of the input\nmean 0.4 0.5 0.3\nstd 0.2 0.25 0.5\n"

// The answer is the known output, scaled and shifted to 1..65535.
static void check_values(const char *kind, bool is_bgr) {
  double lo = INFINITY, hi = -INFINITY;
  sv_bitmap b = answer(kind);
  for (int i = 0; i < W * H; i++) {
    lo = fmin(lo, expected(i % W, i / W, is_bgr));
    hi = fmax(hi, expected(i % W, i / W, is_bgr));
  }
  for (int i = 0; i < W * H; i++) {
    const double want = 1 + 65534 * (expected(i % W, i / W, is_bgr) - lo) / (hi - lo);
    if (!(fabs(want - b.u16[i]) < 2)) fail_msg("pixel %d: %d, expected %.1f", i, b.u16[i], want);
  }
  sv_bitmap_free(&b);
}

TEST(test_known_output) {
  need();
  write_network("shift.onnx", TAPS, 1, W, H);
  write_request();
  if (run("network shift.onnx\noutput disparity\nlayer convolution\n" PREPARED) != 0)
    fail_msg("%s", shell.said);
  check_values("disparity", false);
  if (run("network shift.onnx\n\noutput depth\norder bgr\nlayer convolution\n" PREPARED) != 0)
    fail_msg("%s", shell.said);
  check_values("depth", true);
  // the last layer, which takes the absolute value, has other values
  if (run("network shift.onnx\noutput depth\n" PREPARED) != 0) fail_msg("%s", shell.said);
  sv_bitmap b = answer("depth");
  assert_true(b.u16[0] > 0);
  sv_bitmap_free(&b);
}

// An input of another size; one pixel that is far from all others does not take the range.
TEST(test_size_and_outlier) {
  static const float green[27] = {[9 + 4] = 1};
  need();
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++)
      for (int c = 0; c < 3; c++) picture[y][x][c] = (uint8_t)(100 + x / 2);
  picture[5][5][1] = 255;
  write_network("green.onnx", green, 1, 20, 15);
  write_request();
  if (run("network green.onnx\nsize 20x15\noutput depth\n") != 0) fail_msg("%s", shell.said);
  sv_bitmap b = answer("depth");
  const int left = b.u16[20 * W], right = b.u16[21 * W - 1];
  for (int x = 1; x < W; x++) assert_true(b.u16[20 * W + x] >= b.u16[20 * W + x - 1]);
  print_message("left %d, right %d, outlier %d\n", left, right, b.u16[5 * W + 5]);
  assert_true(left <= 100 && right > 30000 && b.u16[5 * W + 5] > right);
  sv_bitmap_free(&b);
}

TEST(test_errors) {
  need();
  write_network("two.onnx", TAPS, 2, W, H);
  write_text("bad.onnx", "this is not a network");
  write_request();
  static const struct {
    const char *description, *says;
  } cases[] = {
      {"size 9x9\noutput depth\n", "net.txt: 'network' is missing"},
      {"network none.onnx\nsize 9x9\n", "net.txt: 'output' is missing"},
      {"network none.onnx\noutput depth\n", "net.txt: 'size' is missing"},
      {"network none.onnx\nsize 9x9\noutput depth\n", "none.onnx is not there"},
      {"\nsize 9 by 9\n", "net.txt:2: 'size' expects WIDTHxHEIGHT"},
      {"std 1 0 1\n", "net.txt:1: 'std' expects"},
      {"mean 1 2\n", "net.txt:1: 'mean' expects three numbers"},
      {"output near\n", "net.txt:1: 'output' expects disparity or depth"},
      {"scale 3\n", "net.txt:1: unknown word 'scale'"},
      {"network bad.onnx\noutput depth\n" PREPARED, "cannot read this network"},
      {"network two.onnx\noutput depth\n" PREPARED, "1x2x30x40, expected one map"},
      {"network two.onnx\nlayer none\noutput depth\n" PREPARED, "it has no layer 'none'"},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    assert_int_equal(run(cases[i].description), 1);
    assert_contains(shell.said, cases[i].says);
  }
  write_text("call/request.json", "{\"kind\": \"pictures\", \"frames\": [{}]}");
  assert_int_equal(run("network two.onnx\noutput depth\n" PREPARED), 1);
  assert_contains(shell.said, "file_path");
}

// As the program of a training: the network's output enters as depth of the training view.
TEST(test_training) {
  static const float red[27] = {[4] = 1};
  need();
  write_network("red.onnx", red, 1, 96, 72);
  write_text("red.txt", "network red.onnx\nsize 96x72\noutput disparity\n");
  lab_shell_run_well(&shell, "@ import --from sim textured,rig=mono,size=96x72 --out s --quiet");
  char line[900];
  snprintf(line, sizeof line,
           "@ train --data s --exposures 1 --gaussians 1000 --steps 60 --quiet --json --out m --prior "
           "\"external:'%s' red.txt\"",
           program);
  lab_shell_run_well(&shell, line);
  assert_contains(shell.said, "\"prior_depths\": 1,");
  assert_contains(shell.said, "\"prior_failed\": false");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_known_output),
      cmocka_unit_test(test_size_and_outlier),
      cmocka_unit_test(test_errors),
      cmocka_unit_test(test_training),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
