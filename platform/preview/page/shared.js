// SPDX-License-Identifier: Apache-2.0
// Around the model: pages, control among several devices, advice, a camera in full view, settings
// of this browser.
"use strict";
// For a while
function say(text) {
  $("notice").hidden = !text, set("notice", text);
  clearTimeout(page.said), (page.said = setTimeout(() => $("notice").textContent === text && ($("notice").hidden = true), 8000));
}

// --- pages ---
function show_page(name) {
  for (const p of document.querySelectorAll(".page")) p.hidden = p.id !== "page-" + name;
  for (const b of document.querySelectorAll("#pages button")) {
    if (b.dataset.page === name) b.setAttribute("aria-current", "page");
    else b.removeAttribute("aria-current");
  }
  document.dispatchEvent(new CustomEvent("page", { detail: name }));
}
for (const b of document.querySelectorAll("#pages button")) b.onclick = () => show_page(b.dataset.page);
$("details").ontoggle = () => page.state && (plots.curve($("curve"), page.points), plots.skew($("skew-plot"), page.state.skew));

// --- one device controls, the others watch ---
function show_control(s) {
  const { by, asked } = s.control, is_mine = by === page.seat, is_asked = is_mine && asked > 0;
  const is_watching = page.seat > 0 && by > 0 && !is_mine;
  $("control").hidden = !is_asked && !is_watching;
  $("ask").hidden = !is_watching, $("give").hidden = $("keep").hidden = !is_asked;
  $("ask").disabled = asked === page.seat;
  set("control-line", is_asked ? "Another device asks for control." : asked === page.seat ? "Asked for control. Waiting for an answer." : "You are watching. Another device controls this run.");
}
for (const what of ["ask", "give", "keep"]) $(what).onclick = () => ask(what);

// --- what is wrong, and what to do ---
function advice_of(s) {
  const out = [], now = Date.now(), is_live = ["waiting", "capturing"].includes(s.state);
  if (s.throttled === 1 || s.train_duty < 1)
    out.push("The board is hot" + (s.temperature ? " (" + s.temperature.toFixed(0) + " °C)" : "") + ": training slows down. Give it air or a heat sink.");
  for (const c of s.cameras) {
    const seen = (page.seen ??= {}), last = seen[c.name], n = c.captured + c.tiles;
    if (!last || last.n !== n || !is_live) seen[c.name] = { n, at: now };
    else if (now - last.at > 4000) out.push("Camera " + c.name + " sends no images. Check its cable and power; the others go on.");
  }
  if (page.free_bytes < 256 << 20) out.push("The disk is nearly full (" + bytes(page.free_bytes) + " free). Download and delete earlier scans (page Scans).");
  if (page.has_full_disk) out.push("The disk is full: the model was not saved. Download and delete earlier scans, then press Save again.");
  return out;
}
function show_advice(s) {
  const list = advice_of(s), text = list.join("\n");
  $("advice").hidden = !list.length;
  if (page.advice !== text) (page.advice = text), $("advice").firstChild.replaceChildren(...list.map((t) => element("li", t)));
}

// --- a camera in full view: how sharp it is, and what is too bright or too dark ---
const camera = { i: 0, best: 0, timer: 0 };
// The camera's image, once the device sends it; until then, and from a run without frames, its
// thumbnail.
async function fetch_camera() {
  const i = camera.i, r = await fetch("/camera?i=" + i).catch(() => 0);
  const image = r && r.ok && (await createImageBitmap(await r.blob()).catch(() => 0));
  if (!image || i !== camera.i || !$("camera").open) return;
  if (!camera.image) camera.best = 0;
  camera.image = image;
}
function draw_camera() {
  const image = $("tiles"), c = $("camera-image"), [columns, rows] = page.state.grid, s = page.state.cameras[camera.i], full = camera.image;
  if ((!image.naturalWidth && !full) || !s) return;
  const w = full ? full.width : Math.floor(image.naturalWidth / columns), h = full ? full.height : Math.floor(image.naturalHeight / rows), g = c.getContext("2d", { willReadFrequently: true });
  (c.width = w), (c.height = h);
  if (full) g.drawImage(full, 0, 0);
  else g.drawImage(image, (camera.i % columns) * w, Math.floor(camera.i / columns) * h, w, h, 0, 0, w, h);
  const p = g.getImageData(0, 0, w, h), d = p.data, luma = new Float32Array(w * h);
  let bright = 0, dark = 0, edges = 0, sum = 0;
  for (let i = 0; i < w * h; i++) {
    const o = 4 * i, most = Math.max(d[o], d[o + 1], d[o + 2]), stripe = ((i % w) + Math.floor(i / w)) % 6 < 3;
    sum += luma[i] = 0.299 * d[o] + 0.587 * d[o + 1] + 0.114 * d[o + 2];
    if (most > 250) bright++, stripe && ((d[o] = 255), (d[o + 1] = d[o + 2] = 0));
    if (most < 5) dark++, stripe && ((d[o + 2] = 255), (d[o] = d[o + 1] = 0));
  }
  for (let y = 1; y < h - 1; y++) for (let x = 1, i = y * w + 1; x < w - 1; x++, i++) edges += Math.abs(4 * luma[i] - luma[i - 1] - luma[i + 1] - luma[i - w] - luma[i + w]);
  const sharp = edges / (sum || 1), share = (n) => ((100 * n) / (w * h)).toFixed(0) + " %";
  camera.best = Math.max(camera.best, sharp);
  // Focus peaking: yellow where the image is sharpest.
  const edge = new Float32Array(w * h);
  for (let y = 1; y < h - 1; y++) for (let x = 1, i = y * w + 1; x < w - 1; x++, i++) edge[i] = Math.abs(4 * luma[i] - luma[i - 1] - luma[i + 1] - luma[i - w] - luma[i + w]);
  const peak = Math.max(40, edge.slice().sort()[Math.floor(0.97 * w * h)]);
  for (let i = 0; i < w * h; i++) if (edge[i] > peak) (d[4 * i] = 255), (d[4 * i + 1] = 220), (d[4 * i + 2] = 0);
  draw_histogram($("histogram"), luma);
  g.putImageData(p, 0, 0);
  set("camera-name", s.name + ", " + s.width + " x " + s.height);
  set("camera-figures", "Sharpness " + ((100 * sharp) / (camera.best || 1)).toFixed(0) + " % of the best so far (yellow: in focus). Too bright (red): " + share(bright) + ". Too dark (blue): " + share(dark) + ".");
}
function open_camera(i) {
  (camera.i = i), (camera.best = 0), (camera.image = null);
  $("camera").showModal(), draw_camera();
  camera.timer = setInterval(() => fetch_camera().then(draw_camera), 250);
}
$("camera-close").onclick = () => $("camera").close();
$("camera").onclose = () => clearInterval(camera.timer);

// --- the budget of the next run: the page keeps it, and tells the run before Start. Seconds follow
// from the rate of the newest scan ---
const budgets = { draft: 0.25, normal: 1, fine: 3 }, budget_names = ["normal", "draft", "fine"];
async function learn_rate() {
  const scan = scans.list && scans.list.scans.find((v) => !v.deleted && v.files["run.json"]);
  if (!scan || scan.number === page.rate_of) return;
  page.rate_of = scan.number;
  try {
    const r = await (await fetch("/scan/" + scan.number + "/run.json")).json();
    page.step_s = r.steps_per_second > 0 ? 1 / r.steps_per_second : 0;
  } catch (e) {
    page.step_s = 0;
  }
}
function show_budget(s) {
  $("budget").hidden = s.state !== "waiting" || s.budget < 0 || $("start").disabled;
  if ($("budget").hidden) return;
  const wish = document.querySelector("[name=budget]:checked").value;
  if (budget_names[s.budget] !== wish && page.told !== wish + s.seq) (page.told = wish + s.seq), ask(wish);
  for (const input of document.querySelectorAll("[name=budget]")) {
    const k = budgets[input.value], base = s.time_limit ? s.time_limit : s.steps * (page.step_s || 0), seconds = k * base;
    const text = !seconds ? s.steps ? Math.round(k * s.steps) + " steps" : "" : seconds < 90 ? "about " + Math.max(1, Math.round(seconds)) + " s" : "about " + Math.round(seconds / 60) + " min";
    if (input.nextElementSibling.textContent !== text) input.nextElementSibling.textContent = text;
  }
}
let stored_budget = null;
try { stored_budget = localStorage.getItem("budget"); } catch (e) { /* private mode */ }
for (const input of document.querySelectorAll("[name=budget]")) {
  if (input.value === stored_budget) input.checked = true;
  input.onchange = () => {
    try { localStorage.setItem("budget", input.value); } catch (e) { /* private mode */ }
    ask(input.value);
  };
}

// --- settings ---
$("mode").onchange = (e) => (ask("mode?i=" + e.target.value), e.target.blur());
function show_settings(s) {
  if ($("page-settings").hidden) return;
  const modes = $("mode"), names = ["As started", ...s.modes.map((m) => m.replace("x", " x ").replace("@", ", ") + (m.includes("@") ? " a second" : ""))];
  $("mode-box").hidden = !s.session || !s.modes.length;
  if (modes.options.length !== names.length) modes.replaceChildren(...names.map((n, i) => Object.assign(element("option", n), { value: i - 1, disabled: !i })));
  if (document.activeElement !== modes) modes.value = s.mode;
  modes.disabled = page.seat === 0;
  const row = (cells, name) => {
    const r = element("tr");
    r.append(...cells.map((c) => element(name, c)));
    return r;
  };
  const key = JSON.stringify(s.cameras.map((c) => [c.name, c.width, c.height, c.fps.toFixed(0)]));
  if (key === page.table) return;
  page.table = key;
  $("camera-table").replaceChildren(row(["camera", "size", "images a second"], "th"), ...s.cameras.map((c) => row([c.name, c.width + " x " + c.height, c.fps.toFixed(1)], "td")));
  set("camera-source", "Source: " + s.source + (s.rig ? ", rig " + s.rig : "") + ". Sizes and rates are set where subview is started.");
}
document.addEventListener("page", () => page.state && show_settings(page.state));
function remember(id, apply) {
  let stored = null;
  try { stored = localStorage.getItem(id); } catch (e) { /* private mode */ }
  if (stored && [...$(id).options].some((o) => o.value === stored)) $(id).value = stored;
  $(id).onchange = () => {
    try { localStorage.setItem(id, $(id).value); } catch (e) { /* private mode */ }
    apply($(id).value);
  };
  apply($(id).value);
}
remember("preview-quality", (v) => ((page.quality = +v), view && view.set_quality(+v)));

// --- sizes of the downloads: asked for when the model changes and someone looks ---
async function show_sizes(s) {
  const key = s.state + Math.floor(Date.now() / 10000);
  if (!view || !view.n || s.state === "training" || key === page.sized || $("page-scan").hidden) return;
  page.sized = key;
  for (const e of document.querySelectorAll("[data-size]")) {
    try {
      const r = await fetch(e.dataset.size, { method: "HEAD" }), n = +r.headers.get("Content-Length");
      e.textContent = r.ok && n ? bytes(n) : "";
    } catch (x) {
      e.textContent = "";
    }
  }
}
function show_around(s) {
  show_control(s), show_advice(s), show_settings(s), show_sizes(s), show_calibration(s);
  show_budget(s), learn_rate();
}
