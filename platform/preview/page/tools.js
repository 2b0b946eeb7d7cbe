// SPDX-License-Identifier: Apache-2.0
// What one does with the model on the page: views, measuring, a box, before and after, pictures and
// links. The model itself is view.js.
"use strict";
const tools = { picks: [], box: null, is_measuring: false, drawn: "" };

function press(id, is) {
  $(id).setAttribute("aria-pressed", String(is));
}
const unit = () => (view.is_metric ? " m" : " units");
const length = (v) => (view.is_metric && v < 0.1 ? (1000 * v).toFixed(1) + " mm" : v.toPrecision(3) + unit());

// --- the view ---
$("home").onclick = () => view && view.reset();
$("turn").onclick = () => ((view.is_turning = !view.is_turning), (view.turned_at = 0), press("turn", view.is_turning));
$("fly").onclick = () => ((view.is_flying = !view.is_flying), press("fly", view.is_flying), $("view").focus());
$("show").onchange = () => {
  view.set_show($("show").value);
  if ($("show").value === "coverage" && !view.n_eyes) say("The cameras of this model are not known: no coverage.");
};
// A phone that has no full screen for a part of a page (iOS) gets the whole window.
$("full").onclick = async () => {
  const is = !$("viewer").classList.contains("whole");
  $("viewer").classList.toggle("whole", is), press("full", is);
  try {
    if (is) await $("viewer").requestFullscreen();
    else if (document.fullscreenElement) await document.exitFullscreen();
  } catch (e) {
    // the class does
  }
};
document.addEventListener("fullscreenchange", () => {
  if (!document.fullscreenElement) $("viewer").classList.remove("whole"), press("full", false);
});

// --- measuring: the distance with the half width in which 9 of 10 true ones lie, as subview-lab
// measure has it ---
function distance(a, b) {
  const d = b.at.map((v, i) => v - a.at[i]), whole = Math.hypot(...d) || 1e-30;
  let variance = 0;
  for (const p of [a, b]) {
    const along = p.ray.reduce((s, v, i) => s + (v * d[i]) / whole, 0), ray2 = p.ray.reduce((s, v) => s + v * v, 0);
    const of_parts = 0.3 * Math.abs(p.behind - p.front), least = 2.5e-3 * p.depth, pixel = (0.29 * p.depth) / p.focal;
    const s2 = of_parts ** 2 + least ** 2 + p.spread ** 2 / 9;
    variance += along ** 2 * s2 + Math.max(0, 1 - along ** 2 / ray2) * pixel ** 2;
  }
  return { length: whole, half: 1.645 * Math.hypot(Math.sqrt(variance), whole * view.scale_sigma) };
}
function tell(text) {
  $("measured").hidden = !text, set("measured", text);
}
async function tap(x, y) {
  if (tools.picks.length === 2) tools.picks = [];
  const point = await view.pick(x, y);
  if (!point) return tell("No surface there. Tap on the object.");
  tools.picks.push(point);
  if (tools.picks.length === 1) return tell("Tap the second point.");
  const d = distance(...tools.picks);
  const is_mm = view.is_metric && d.length < 0.1, k = is_mm ? 1000 : 1, digits = Math.max(0, 1 - Math.floor(Math.log10(k * d.half)));
  tools.said = (k * d.length).toFixed(digits) + " ± " + (k * d.half).toFixed(digits) + (is_mm ? " mm" : unit());
  tell(tools.said);
}
$("measure").onclick = () => {
  tools.is_measuring = !tools.is_measuring, (tools.picks = []);
  press("measure", tools.is_measuring);
  view.on_tap = tools.is_measuring ? tap : null;
  tell(tools.is_measuring ? "Tap the first point." : "");
};

// --- the box: along the axes of the view's orbit ---
const sides = ["left", "right", "front", "back", "bottom", "top"];
function box_of_sliders() {
  const { axes, low, high } = tools.extent, value = (i) => +$("side-" + sides[i]).value / 1000;
  const at = (k, t) => low[k] - 0.25 * (high[k] - low[k]) + 1.5 * t * (high[k] - low[k]);
  return { axes, low: [0, 1, 2].map((k) => at(k, Math.min(value(2 * k), value(2 * k + 1)))), high: [0, 1, 2].map((k) => at(k, Math.max(value(2 * k), value(2 * k + 1)))) };
}
function show_box() {
  tools.box = box_of_sliders();
  const size = tools.box.high.map((v, k) => length(v - tools.box.low[k]));
  set("box-line", "Width " + size[0] + ", depth " + size[1] + ", height " + size[2]);
  view.set_box($("box-crop").checked ? tools.box : null);
}
async function open_box() {
  const axes = view.axes();
  tools.extent = { axes, ...(await view.ask({ axes })) };
  if (!$("side-left")) {
    for (const side of sides) {
      const label = element("label", side), slider = element("input");
      Object.assign(slider, { type: "range", min: 0, max: 1000, id: "side-" + side, oninput: show_box });
      label.append(slider), $("box-sliders").append(label);
    }
  }
  sides.forEach((side, i) => ($("side-" + side).value = i % 2 ? 833 : 167));
  show_box();
}
$("box").onclick = async () => {
  const is = $("box-panel").hidden;
  $("box-panel").hidden = !is, press("box", is);
  if (is) return open_box();
  tools.box = null, view.set_box(null);
};
$("box-crop").onchange = show_box;
// Rows of a PLY whose place is in the box; the header's number is what changes.
function crop_ply(bytes, box) {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, 8192)), end = text.indexOf("end_header\n") + 11;
  const head = text.slice(0, end), names = [...head.matchAll(/^property float (\S+)$/gm)].map((p) => p[1]);
  const n = +/^element vertex (\d+)$/m.exec(head)[1], stride = 4 * names.length, data = new DataView(bytes.buffer, bytes.byteOffset + end);
  const at = ["x", "y", "z"].map((v) => 4 * names.indexOf(v)), parts = [];
  for (let i = 0; i < n; i++) {
    const p = at.map((o) => data.getFloat32(i * stride + o, true)), along = (a) => a[0] * p[0] + a[1] * p[1] + a[2] * p[2];
    if (box.axes.every((a, k) => along(a) >= box.low[k] && along(a) <= box.high[k])) parts.push(bytes.subarray(end + i * stride, end + (i + 1) * stride));
  }
  return new Blob([head.replace(/^element vertex \d+$/m, "element vertex " + parts.length), ...parts]);
}
function download(blob, name) {
  const a = element("a");
  (a.href = URL.createObjectURL(blob)), (a.download = name), a.click();
  setTimeout(() => URL.revokeObjectURL(a.href), 10000);
  tools.downloaded = { name, bytes: blob.size };
}
$("box-ply").onclick = async () => {
  try {
    const r = await fetch($("get-ply").href);
    if (!r.ok) return say(await r.text());
    download(crop_ply(new Uint8Array(await r.arrayBuffer()), box_of_sliders()), "subview-part.ply");
  } catch (e) {
    away(true);
  }
};

// --- marks over the model, drawn when they move ---
function draw_marks() {
  const c = $("marks"), picks = tools.picks.map((p) => view.project(p.at)), b = tools.box;
  const corner = (i) => view.project([0, 1, 2].map((k) => b.axes.reduce((s, a, j) => s + a[k] * (i & (1 << j) ? b.high[j] : b.low[j]), 0)));
  const corners = b && view.camera ? [0, 1, 2, 3, 4, 5, 6, 7].map(corner) : [];
  const key = JSON.stringify([picks, corners, c.clientWidth, c.clientHeight, tools.said]);
  if (key === tools.drawn) return;
  tools.drawn = key;
  const ratio = Math.min(devicePixelRatio || 1, 2), g = c.getContext("2d");
  (c.width = ratio * c.clientWidth), (c.height = ratio * c.clientHeight);
  g.scale(ratio, ratio), (g.lineWidth = 2), (g.strokeStyle = g.fillStyle = "#5ccfe6"), (g.font = "600 14px system-ui, sans-serif");
  const line = (p, q) => p && q && (g.beginPath(), g.moveTo(p.x, p.y), g.lineTo(q.x, q.y), g.stroke());
  for (let i = 0; i < corners.length; i++) for (let k = 1; k < 8; k *= 2) if (!(i & k)) line(corners[i], corners[i | k]);
  for (const p of picks) if (p) g.beginPath(), g.arc(p.x, p.y, 5, 0, 7), g.stroke();
  if (picks.length < 2 || !picks[0] || !picks[1]) return;
  line(...picks);
  const x = (picks[0].x + picks[1].x) / 2 + 8, y = (picks[0].y + picks[1].y) / 2 - 10, w = g.measureText(tools.said).width;
  (g.fillStyle = "#0e151ce6"), g.fillRect(x - 6, y - 16, w + 12, 22), (g.fillStyle = "#5ccfe6"), g.fillText(tools.said, x, y);
}

// --- before and after: the left half of the picture over the right one ---
function draw_both() {
  const image = $("picture"), c = $("both"), w = image.naturalWidth >> 1, h = image.naturalHeight, edge = +$("edge").value / 1000;
  if (!w) return;
  const g = c.getContext("2d");
  (c.width = w), (c.height = h);
  g.drawImage(image, w, 0, w, h, 0, 0, w, h);
  g.drawImage(image, 0, 0, edge * w, h, 0, 0, edge * w, h);
  (g.fillStyle = "#fff"), g.fillRect(edge * w - 1, 0, 2, h);
}
$("before").onclick = () => {
  const is = $("compare").hidden;
  if (is && $("picture").hidden) return say("The comparison appears while it trains.");
  $("compare").hidden = !is, press("before", is), draw_both();
};
$("edge").oninput = draw_both;
$("picture").onload = () => $("compare").hidden || draw_both();

// --- pictures and links ---
$("shot").onclick = async () => download(await view.picture(), "subview.png");
// A link that shows, and cannot control: on a network it has the key that reading takes.
async function view_link() {
  const r = await fetch("/look-key", { headers: token_header }), key = r.ok ? await r.text() : "";
  return location.origin + "/?view=" + encodeURIComponent(view.place()) + (key ? "#" + key : "");
}
$("share").onclick = async () => {
  tools.link = await view_link();
  try {
    if (navigator.share) await navigator.share({ title: "subview", url: tools.link });
    else await navigator.clipboard.writeText(tools.link), say("The link to this view is in the clipboard. Who opens it watches and cannot control.");
  } catch (e) {
    say("Link to this view: " + tools.link); // no clipboard over plain HTTP
  }
};
