// SPDX-License-Identifier: Apache-2.0
// The two small plots: PSNR and loss over training time, and the histogram of skews.
"use strict";
const plots = (() => {
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function begin(canvas) {
    const ratio = Math.min(devicePixelRatio || 1, 2), w = canvas.clientWidth, h = canvas.clientHeight;
    const width = Math.max(1, Math.round(w * ratio)), height = Math.max(1, Math.round(h * ratio));
    if (canvas.width !== width || canvas.height !== height) (canvas.width = width), (canvas.height = height);
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, w, h);
    g.font = "11px system-ui, sans-serif";
    return { g, w, h };
  }

  function line(p, points, x, y, style) {
    p.g.strokeStyle = style;
    p.g.lineWidth = 2;
    p.g.beginPath();
    points.forEach((v, i) => (i ? p.g.lineTo(x(v), y(v)) : p.g.moveTo(x(v), y(v))));
    p.g.stroke();
  }

  function range(values) {
    let lo = Math.min(...values), hi = Math.max(...values);
    if (hi - lo < 1e-9) (lo -= 0.5), (hi += 0.5);
    return [lo, hi];
  }

  function curve(canvas, points) {
    const p = begin(canvas), g = p.g, left = 34, right = p.w - 46, top = 16, bottom = p.h - 18;
    g.fillStyle = colour("--quiet");
    const shown = points.filter((v) => v.psnr > 0);
    if (shown.length < 2) {
      g.fillText("the curve appears while it trains", left, p.h / 2);
      return;
    }
    const t = range(shown.map((v) => v.seconds)), q = range(shown.map((v) => v.psnr));
    const l = range(shown.map((v) => Math.log10(Math.max(v.loss, 1e-5))));
    const x = (v) => left + ((v.seconds - t[0]) / (t[1] - t[0])) * (right - left);
    const scale = (v, r) => bottom - ((v - r[0]) / (r[1] - r[0])) * (bottom - top);
    g.strokeStyle = colour("--line");
    g.lineWidth = 1;
    for (let i = 0; i <= 2; i++) {
      const y = top + ((bottom - top) * i) / 2;
      g.beginPath(), g.moveTo(left, y), g.lineTo(right, y), g.stroke();
      g.fillStyle = colour("--main");
      g.fillText((q[1] + ((q[0] - q[1]) * i) / 2).toFixed(1), 2, y + 4);
      g.fillStyle = colour("--cool");
      g.fillText((10 ** (l[1] + ((l[0] - l[1]) * i) / 2)).toPrecision(2), right + 6, y + 4);
    }
    line(p, shown, x, (v) => scale(Math.log10(Math.max(v.loss, 1e-5)), l), colour("--cool"));
    line(p, shown, x, (v) => scale(v.psnr, q), colour("--main"));
    g.fillStyle = colour("--main"), g.fillText("training PSNR, dB", left, 10);
    g.fillStyle = colour("--cool"), g.fillText("loss", right - 22, 10);
    g.fillStyle = colour("--quiet"), g.fillText(t[0].toFixed(0) + " s", left, p.h - 4);
    g.fillText(t[1].toFixed(0) + " s", right - 20, p.h - 4);
  }

  // Bins of a quarter of an octave from 1 microsecond; the first has what is less, too.
  function skew(canvas, bins) {
    const p = begin(canvas), g = p.g, most = Math.max(...bins);
    if (!(most > 0)) return;
    let first = bins.findIndex((n) => n > 0), last = bins.length - 1;
    while (last > first && !bins[last]) last--;
    first = Math.max(0, first - 2), last = Math.min(bins.length - 1, last + 2);
    const w = p.w / (last - first + 1), micro = (b) => 2 ** (b / 4);
    const name = (us) => (us < 1000 ? us.toFixed(0) + " µs" : (us / 1000).toFixed(us < 10000 ? 1 : 0) + " ms");
    g.fillStyle = colour("--cool");
    for (let b = first; b <= last; b++) {
      const h = (bins[b] / most) * (p.h - 18);
      g.fillRect((b - first) * w + 1, p.h - 16 - h, Math.max(1, w - 2), h);
    }
    g.fillStyle = colour("--quiet");
    g.fillText(first ? name(micro(first)) : "0", 0, p.h - 3);
    const end = name(micro(last + 1));
    g.fillText(end, p.w - g.measureText(end).width, p.h - 3);
  }
  return { curve, skew };
})();
