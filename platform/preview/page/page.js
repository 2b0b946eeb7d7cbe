// SPDX-License-Identifier: Apache-2.0
// The page's states and commands. Two long connections: the state (server-sent events) and the
// camera mosaic.
"use strict";
const $ = (id) => document.getElementById(id);
// The link's token leaves the address at once: it is in no history, no copied address and on no
// screenshot. A reload of this tab keeps it.
function keep_token(token) {
  try {
    sessionStorage.setItem("token", token);
    return true;
  } catch (e) {
    return false; // private mode: it stays in the address
  }
}
function take_token() {
  const given = location.hash.slice(1);
  if (given && keep_token(given)) history.replaceState(null, "", location.pathname + location.search);
  try {
    return given || sessionStorage.getItem("token") || "";
  } catch (e) {
    return given;
  }
}
// Another link in this tab
addEventListener("hashchange", () => location.hash.length > 1 && location.reload());
const page = { token: take_token(), state: null, points: [], model_seq: -1, picture_seq: -1, is_loading: false, is_away: false, started: 0, seat: 0, id: "" };
// This page among those of one run: a reload keeps it.
try {
  page.id = sessionStorage.getItem("page") || "";
} catch (e) { /* private mode */ }
if (!page.id) page.id = [...crypto.getRandomValues(new Uint8Array(16))].map((v) => v.toString(16).padStart(2, "0")).join("");
try {
  sessionStorage.setItem("page", page.id);
} catch (e) { /* private mode */ }
const token_header = { "X-Subview-Token": page.token, "X-Subview-Page": page.id };
// The server gives a cookie for the token: images and event streams carry no headers of ours. It
// knows by this, too, that the page is still there.
async function enter() {
  if (!page.token) return;
  try {
    const r = await fetch("/enter", { method: "POST", headers: token_header });
    page.seat = r.ok ? +r.headers.get("X-Subview-Seat") : 0;
  } catch (e) {
    // the connection tells
  }
}
const entered = enter();
setInterval(enter, 5000);
entered.then(() => ($("tiles").src = "/cameras")); // first of all

const titles = {
  starting: ["Starting", "Opening cameras and memory."],
  waiting: ["Ready", "The cameras are running. Press Start to capture and train."],
  capturing: ["Capturing", "Capturing synchronized exposures."],
  training: ["Training", "The first model appears in a moment."],
  done: ["Done", ""],
  calibrating: ["Calibrating", "Show the chessboard to the cameras."],
};
const stale_text = (s) => "The " + s.stale_thread + " thread of subview makes no progress. The figures are those of " + s.stale_s + " s ago.";
const causes = { camera: "No camera", rig: "No rig", other: "The run failed" };

const number = (v, digits) => (v === null || v === undefined ? "–" : v.toFixed(digits));
const bytes = (v) => (v < 100 << 10 ? (v / 1024).toFixed(1) + " KiB" : v >= 1 << 30 ? (v / (1 << 30)).toFixed(2) + " GiB" : (v / (1 << 20)).toFixed(1) + " MiB");
const micro = (us) => (us < 1000 ? us.toFixed(0) + " µs" : (us / 1000).toFixed(2) + " ms");
function set(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}
function element(name, text, type) {
  const e = document.createElement(name);
  if (text !== undefined) e.textContent = text;
  if (type) e.className = type;
  return e;
}

// --- model and picture ---
let view = null; // made when there is something to draw: what it takes must not hold up the cameras
function open_view() {
  if (view || page.has_no_view || typeof SplatView === "undefined") return;
  try {
    view = new SplatView($("view"));
    view.on_time = show_clip, (view.on_frame = draw_marks), view.set_quality(page.quality || 1);
  } catch (e) {
    page.has_no_view = true, ($("notice").hidden = false);
    set("notice", "This browser cannot draw the model: " + e.message + ". Downloads and camera images work.");
  }
}

async function load_model(seq) {
  open_view();
  if (!view || page.viewing || page.past || page.is_loading || seq === page.model_seq) return;
  page.is_loading = true;
  try {
    const r = await fetch("/model?after=" + page.model_seq), data = await r.arrayBuffer();
    if (page.past || page.viewing) return; // pressed meanwhile: the view shows another model
    if (r.status === 200) {
      const n = +r.headers.get("X-Subview-Seq");
      const is_first = !view.n;
      if (view.load(data)) page.model_seq = n;
      if (is_first) view.go_to(new URLSearchParams(location.search).get("view"));
    } else if (r.status === 404) {
      view.clear();
      page.model_seq = seq;
    }
    show_clip();
  } catch (e) {
    // the next state asks again
  } finally {
    page.is_loading = false;
  }
}

function moment_text(clip) {
  if (page.past) return ((1 - view.time) * clip.seconds).toFixed(2) + " of " + clip.seconds.toFixed(2) + " s ago";
  return (view.time * clip.seconds).toFixed(2) + " of " + clip.seconds.toFixed(2) + " s";
}

// The time slider, of a model that moves.
function show_clip() {
  const clip = view && view.n ? view.clip : null;
  $("clip").hidden = !clip;
  if (!clip) return;
  set("play", view.is_playing ? "\u25a0" : "\u25b6"), set("moment-line", moment_text(clip));
  if (page.past) point_to_past();
  const at = String(Math.round(1000 * view.time));
  if ($("moment").value !== at) $("moment").value = at;
}

async function load_picture(seq) {
  if (seq === page.picture_seq || page.is_picturing) return;
  page.is_picturing = true;
  try {
    const r = await fetch("/picture.jpg");
    const has = r.status === 200;
    if (has) {
      const old = $("picture").src;
      $("picture").src = URL.createObjectURL(await r.blob());
      if (old) URL.revokeObjectURL(old);
    }
    $("picture").hidden = $("picture-box").hidden = !has;
    page.picture_seq = seq;
  } catch (e) {
    // likewise
  } finally {
    page.is_picturing = false;
  }
}

async function load_history() {
  try {
    page.points = await (await fetch("/curve")).json();
    plots.curve($("curve"), page.points);
  } catch (e) {
    page.points = [];
  }
}

async function load_events() {
  try {
    const list = await (await fetch("/events")).json();
    const last = (words) => list.map((e) => words.test(e.text)).lastIndexOf(true);
    page.has_full_disk = last(/no space left|disk is full/i) > last(/^saved /);
    $("events").replaceChildren(
      ...list.reverse().map((e) => element("li", e.seconds.toFixed(1) + " s  " + e.text, e.level < 2 ? "bad" : ""))
    );
  } catch (e) {
    // the next state asks again
  }
}

// --- what the state says ---
function show_message(s) {
  const has_model = view && view.n > 0;
  let [title, text] = titles[s.state] || ["", ""];
  if (s.state === "failed") (title = causes[s.cause] || causes.other), (text = s.sentence);
  $("message").hidden = has_model && s.state !== "failed";
  if (s.stale_s) (title = "Stale since " + s.stale_s + " s"), (text = stale_text(s));
  if (s.state === "failed" && s.session) text += ". Fix this and press New to try again.";
  set("message-title", title), set("message-text", text);
  $("figures").hidden = $("tools").hidden = !has_model;
  // Before there is a model the cameras are what there is to see.
  const place = !has_model && s.cameras.length && s.state !== "failed" ? $("message") : $("cameras-box");
  if ($("mosaic").parentNode !== place) place.append($("mosaic"));
  $("cameras-box").hidden = place === $("message") || !s.cameras.length;
  // What cannot say anything yet takes no room.
  $("training-box").hidden = !s.cameras.length || (s.step === 0 && !has_model && s.state === "waiting");
  // What this state has no use for is not there: before the run that leaves one button.
  $("start").hidden = !["waiting", "paused", "starting"].includes(s.state);
  $("pause").hidden = $("save").hidden = !["training", "paused", "saving"].includes(s.state);
  $("new").hidden = ["waiting", "calibrating"].includes(s.state) || !s.session;
  $("files-box").hidden = !has_model && !s.step;
  $("machine-box").hidden = $("frames-box").hidden = !s.cameras.length;
}

// Over a model there is no room for a message: a line below the header says it.
function show_stale(s) {
  if (s.stale_s) {
    page.is_stale = true;
    $("notice").hidden = false;
    set("notice", stale_text(s));
  } else if (page.is_stale) {
    page.is_stale = false;
    $("notice").hidden = true;
  }
}

function show_buttons(s) {
  const may = page.seat > 0 && [0, page.seat].includes(s.control.by) && !page.is_away && !s.stale_s, on = (id, is) => ($(id).disabled = !(may && is));
  set("start", s.state === "paused" ? "Resume" : "Start");
  on("start", s.state === "waiting" || s.state === "paused");
  on("pause", s.state === "training");
  on("save", s.state === "training" || s.state === "paused");
  on("new", s.session && s.state !== "saving" && s.state !== "waiting");
  $("start").classList.toggle("main", s.state === "waiting" || s.state === "paused");
  for (const id of ["get-ply", "get-splat", "get-spz"]) $(id).classList.toggle("off", !(view ? view.n : s.step));
  if (!page.seat && $("notice").hidden) {
    $("notice").hidden = false;
    set("notice", "View only. To control the run, open the link that subview printed.");
  }
}

function show_cameras(s) {
  const [columns, rows] = s.grid, count = Math.min(s.cameras.length, columns * rows);
  set("skew", s.n_skew ? "skew " + micro(s.skew_p50_us) + " median, " + micro(s.skew_max_us) + " max" : "");
  const labels = $("labels");
  while (labels.children.length > count) labels.lastChild.remove();
  for (let i = 0; i < count; i++) {
    const c = s.cameras[i], line = c.name + "  " + c.fps.toFixed(0) + " fps" + (c.dropped ? "  " + c.dropped + " dropped" : "");
    if (!labels.children[i]) {
      const b = element("button");
      b.onclick = () => open_camera(i);
      labels.append(b);
    }
    const d = labels.children[i];
    d.style.cssText = `left:${(100 * (i % columns)) / columns}%;top:${(100 * Math.floor(i / columns)) / rows}%;width:${100 / columns}%;height:${100 / rows}%`;
    if (d.textContent !== line) d.replaceChildren(element("span", line)), d.setAttribute("aria-label", line + ": full view");
    d.className = c.dropped > 0.05 * c.captured ? "late" : "";
  }
}

function show_ledger(s) {
  const reasons = [...new Set(s.cameras.flatMap((c) => Object.keys(c.dropped_by)))];
  const row = (cells, name) => {
    const r = element("tr");
    r.append(...cells.map((c) => element(name, c)));
    return r;
  };
  const text = (r) => r.replaceAll("_", " ");
  $("ledger").replaceChildren(
    row(["camera", "captured", "used", "waiting", ...reasons.map(text)], "th"),
    ...s.cameras.map((c) => row([c.name, c.captured, c.delivered, c.pending, ...reasons.map((r) => c.dropped_by[r] || 0)], "td"))
  );
}

function show_memory(s) {
  const m = s.memory, hues = [32, 190, 110, 265, 350, 60, 220, 150, 300, 10];
  $("memory").replaceChildren(
    ...m.parts.map((p, i) => {
      const e = element("i");
      e.style.cssText = `width:${(100 * p.bytes) / (m.cap || 1)}%;background:hsl(${hues[i % 10]} 60% 55%)`;
      e.title = p.name + ": " + bytes(p.bytes);
      return e;
    })
  );
  set("memory-line", m.cap ? bytes(m.used) + " of " + bytes(m.cap) + " used; fixed for the whole run" : "");
  const rests = s.train_duty < 1 ? ", training at " + (100 * s.train_duty).toFixed(0) + " %" : "";
  const hot = (s.throttled === 1 ? ", throttled" : "") + rests;
  set("threads-line", s.heartbeats.map((t) => t.name + " " + t.age_s.toFixed(1) + " s").join(", "));
  set("machine-line", [s.board, s.temperature !== null ? s.temperature.toFixed(0) + " °C" + hot : ""].filter(Boolean).join(", "));
}

function time_left(s) {
  if (s.state === "capturing") return s.exposures + " of " + s.cap_exposures + " exposures";
  if (s.state !== "training") return s.state === "done" ? "ready" : s.state;
  const limit = s.time_limit ? s.time_limit - s.seconds : Infinity, left = Math.min(limit, s.steps && s.steps_per_s > 0 ? (s.steps - s.step) / s.steps_per_s : Infinity);
  if (!isFinite(left)) return "training";
  return left < 90 ? Math.ceil(left) + " s left" : Math.ceil(left / 60) + " min left";
}

function show(s) {
  page.state = s;
  set("state", s.stale_s ? "stale since " + s.stale_s + " s" : s.state), ($("state").className = "chip " + (s.stale_s ? "stale" : s.state));
  show_stale(s);
  set("where", [s.source, s.rig && "rig " + s.rig].filter(Boolean).join("  ·  "));
  const part = s.state === "done" ? 1 : s.steps ? s.step / s.steps : s.time_limit ? s.seconds / s.time_limit : 0;
  const taken = s.cap_exposures ? s.exposures / s.cap_exposures : 0;
  const percent = 100 * Math.min(1, s.state === "capturing" ? taken : part);
  $("progress").style.width = percent + "%", $("bar").setAttribute("aria-valuenow", percent.toFixed(0));
  set("f-eta", time_left(s));
  set("f-psnr", s.psnr > 0 ? number(s.psnr, 1) : "–"), set("f-step", String(s.step));
  set("f-rate", s.steps_per_s > 0 ? number(s.steps_per_s, 0) : "–"), set("f-count", String(view && view.n ? view.n : 0));
  set("train-line", s.exposures + " of " + s.cap_exposures + " exposures" + (s.saves ? ", saved " + s.saves + " times" : ""));
  set("fps", view && view.n && view.fps ? view.fps.toFixed(0) + " fps" : "");
  set("sandbox", s.sandbox ? "server sandbox: " + s.sandbox : "");
  set("skew-line", s.n_skew ? "skew over " + s.n_skew + " exposures: median " + micro(s.skew_p50_us) + ", 99 % " + micro(s.skew_p99_us) : "no exposures yet");
  show_message(s), show_buttons(s), show_cameras(s), show_ledger(s), show_memory(s), show_around(s), show_dome(s);
  plots.skew($("skew-plot"), s.skew);
  show_past(s), load_model(s.model_seq), load_picture(s.picture_seq);
  if (s.state !== page.last_state || Date.now() - page.started > 3000) {
    page.started = Date.now(), page.last_state = s.state;
    load_history(), load_events();
  }
}

// --- connections ---
function away(is) {
  if (page.is_away === is) return;
  page.is_away = is;
  if (is) {
    set("state", "not connected"), ($("state").className = "chip away");
    $("message").hidden = !!(view && view.n);
    set("message-title", "No connection to subview"), set("message-text", "Retrying. Check that subview is still running.");
    for (const id of ["start", "pause", "save", "new"]) $(id).disabled = true;
  } else $("tiles").src = "/cameras?" + Date.now();
}
// Links are of one run: a bookmark of an earlier one is refused, and an event stream does not tell
// why it ends. A server that was started again has new cookies.
async function look_for_refusal() {
  try {
    if ((await fetch("/state")).status !== 403) return;
    await enter();
    if ((await fetch("/state")).status !== 403) return;
    set("message-title", "This link belongs to another run"), set("message-text", "Open the newest link that subview printed.");
  } catch (e) {
    // nobody answers at all
  }
}
function connect() {
  const events = new EventSource("/stream");
  events.onmessage = (e) => {
    away(false);
    show(JSON.parse(e.data));
  };
  events.onerror = () => {
    away(true);
    if (events.readyState !== EventSource.CLOSED) return;
    look_for_refusal();
    setTimeout(connect, 1000);
  };
}
$("tiles").onerror = () => setTimeout(() => ($("tiles").src = "/cameras?" + Date.now()), 1000);

async function ask(what) {
  try {
    const r = await fetch("/" + what, { method: "POST", headers: token_header });
    if (r.ok) return;
    $("notice").hidden = false;
    set("notice", await r.text());
  } catch (e) {
    away(true);
  }
}
for (const what of ["start", "pause", "save"]) $(what).onclick = () => ask(what);
$("new").onclick = () => { // what the next run saves replaces what this one saved: twice
  const b = $("new");
  if (b.classList.toggle("sure")) {
    b.textContent = "Discard?";
    setTimeout(() => (b.classList.remove("sure"), (b.textContent = "New")), 3000);
  } else {
    b.textContent = "New";
    ask("new");
  }
};
$("play").onclick = () => (view.play(!view.is_playing), show_clip());
$("moment").oninput = () => (view.play(false), view.set_time($("moment").value / 1000), show_clip());
function theme(is_light) {
  document.documentElement.classList.toggle("light", is_light);
  if (page.state) plots.curve($("curve"), page.points), plots.skew($("skew-plot"), page.state.skew);
}
$("theme").onclick = () => {
  const is_light = !document.documentElement.classList.contains("light");
  theme(is_light);
  try {
    localStorage.setItem("theme", is_light ? "light" : "dark");
  } catch (e) { /* private mode */ }
};
let stored = null;
try { stored = localStorage.getItem("theme"); } catch (e) { /* private mode */ }
theme(stored ? stored === "light" : matchMedia("(prefers-color-scheme: light)").matches);
// The other scripts are there then.
addEventListener("DOMContentLoaded", () => entered.then(connect));
