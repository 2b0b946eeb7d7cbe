// SPDX-License-Identifier: Apache-2.0
// Calibrate: a board to print, what the cameras have seen of it, and the rig that came out.
"use strict";
const cal = { timer: 0, is_asking: false, c: null };

// --- the board to print: its squares are as large as the paper permits ---
async function choose_board() {
  const query = "?board=" + encodeURIComponent($("cal-board").value.trim()) + "&paper=" + $("cal-paper").value;
  ($("cal-pdf").href = "/board.pdf" + query), ($("cal-svg").href = "/board.svg" + query);
  try {
    const r = await fetch("/board.svg" + query), text = await r.text();
    set("cal-said", r.ok ? "" : text);
    const found = /Squares of ([0-9.]+) mm/.exec(text);
    if (r.ok && found) $("cal-mm").value = found[1];
  } catch (e) { /* the connection tells */ }
}
$("cal-board").onchange = $("cal-paper").onchange = choose_board;

// --- what the cameras have seen ---
const cells = { x: 8, y: 6 };
const is_covered = (c, x, y) => (parseInt(c.coverage.slice(10 - 2 * y, 12 - 2 * y), 16) >> x) & 1;
function draw_board(canvas, i, c) {
  const image = $("tiles"), [columns, rows] = page.state.grid, g = canvas.getContext("2d");
  const w = Math.floor(image.naturalWidth / columns) || 192, h = Math.floor(image.naturalHeight / rows) || 144;
  (canvas.width = w), (canvas.height = h);
  if (image.naturalWidth) g.drawImage(image, (i % columns) * w, Math.floor(i / columns) * h, w, h, 0, 0, w, h);
  for (let y = 0; y < cells.y; y++)
    for (let x = 0; x < cells.x; x++) {
      g.fillStyle = is_covered(c, x, y) ? "rgba(127,217,98,.30)" : "rgba(255,122,112,.18)";
      g.fillRect((x * w) / cells.x + 1, (y * h) / cells.y + 1, w / cells.x - 2, h / cells.y - 2);
    }
  if (!c.seen) return;
  (g.strokeStyle = "#ffb454"), (g.lineWidth = 2), g.beginPath();
  for (let k = 0; k < 4; k++) g.lineTo(c.outline[2 * k] * w, c.outline[2 * k + 1] * h);
  g.closePath(), g.stroke();
}
function where_empty(c) {
  let left = 0, right = 0, up = 0, down = 0;
  for (let y = 0; y < cells.y; y++)
    for (let x = 0; x < cells.x; x++)
      if (!is_covered(c, x, y)) x < cells.x / 2 ? left++ : right++, y < cells.y / 2 ? up++ : down++;
  if (left + right < 12) return "";
  return Math.abs(left - right) > Math.abs(up - down) ? (left > right ? "left" : "right") : up > down ? "upper part" : "lower part";
}
// A result is drawn once: the cameras show other things since.
function show_views(c) {
  if (["done", "failed"].includes(c.phase) && cal.drawn === c.phase) return;
  cal.drawn = c.phase;
  const box = $("cal-views");
  while (box.children.length > c.cameras.length) box.lastChild.remove();
  c.cameras.forEach((q, i) => {
    if (!box.children[i]) {
      const f = element("figure"), canvas = element("canvas");
      canvas.setAttribute("role", "img"), f.append(canvas, element("figcaption")), box.append(f);
    }
    const [canvas, caption] = box.children[i].children, empty = where_empty(q);
    const text = q.name + ": " + q.boards + " of " + c.needed + " boards" + (empty ? "; show the board more in the " + empty : "");
    if (caption.textContent !== text) (caption.textContent = text), canvas.setAttribute("aria-label", text);
    draw_board(canvas, i, q);
  });
}

// --- what came out ---
function show_result(c) {
  const is_done = c.phase === "done", px = (v) => (v === null ? "–" : v.toFixed(2) + " px");
  $("cal-result").hidden = !is_done && c.phase !== "failed";
  if ($("cal-result").hidden) return;
  set("cal-verdict", is_done
    ? "The rig fits the board and is " + c.sentence + ". The next scan uses it." + (c.baseline_m > 0 ? " Cameras are up to " + (1000 * c.baseline_m).toFixed(1) + " mm apart." : "")
    : "No new rig: " + c.sentence + ".");
  const row = (list, name) => {
    const r = element("tr");
    return r.append(...list.map((v) => element(name, v))), r;
  };
  $("cal-table").hidden = !is_done;
  $("cal-table").replaceChildren(row(["camera", "boards", "before", "now"], "th"), ...c.cameras.map((q) => row([q.name, String(q.boards), px(q.before_px), px(q.rms_px)], "td")));
}
const texts = {
  "": "",
  looking: (c) => c.exposures + " exposures. Move the board to the red cells, and tilt it.",
  solving: () => "Calculating the lenses and the places of the cameras.",
  done: (c) => "Done in " + c.seconds.toFixed(0) + " s, with " + (c.peak / 1048576).toFixed(0) + " MiB of memory.",
  failed: () => "Not calibrated.",
};
async function look_at_calibration() {
  if (cal.is_asking) return;
  cal.is_asking = true;
  try {
    const r = await fetch("/calibration");
    if (r.ok) {
      const c = (cal.c = await r.json());
      set("cal-line", c.phase ? texts[c.phase](c) : "");
      show_views(c), show_result(c);
    }
  } catch (e) {
    // the next state asks again
  } finally {
    cal.is_asking = false;
  }
}

const needs_rig = () => page.state && page.state.state === "failed" && page.state.cause === "rig" && page.state.session;
function show_calibration(s) {
  const is_on = s.state === "calibrating", may = page.seat > 0 && [0, page.seat].includes(s.control.by);
  $("cal-start").hidden = is_on, $("cal-finish").hidden = $("cal-cancel").hidden = !is_on;
  $("cal-start").disabled = !may || !s.session || !(["waiting", "done"].includes(s.state) || needs_rig());
  $("cal-finish").disabled = $("cal-cancel").disabled = !may;
  if (needs_rig()) { // Start leads here
    ($("start").hidden = false), ($("start").disabled = !may), set("start", "Calibrate"), $("start").classList.add("main");
    set("message-text", s.sentence + ". Calibrate the cameras with a printed chessboard.");
  }
  if (!$("page-calibrate").hidden || is_on) look_at_calibration();
}
const start_run = $("start").onclick;
$("start").onclick = () => (needs_rig() ? show_page("calibrate") : start_run());
$("cal-start").onclick = () => ask("calibrate?board=" + encodeURIComponent($("cal-board").value.trim()) + "&mm=" + encodeURIComponent($("cal-mm").value.replace(",", ".")) + "&lens=" + $("cal-lens").value);
$("cal-finish").onclick = () => ask("start");
$("cal-cancel").onclick = () => ask("new");
document.addEventListener("page", (e) => e.detail === "calibrate" && (choose_board(), look_at_calibration()));
