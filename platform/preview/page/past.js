// SPDX-License-Identifier: Apache-2.0
// The last seconds of a live run: the runtime hands out a snapshot of its history, which the view
// plays by ranges; the slider's right end is the moment of the snapshot. Downloads are then of the
// past. Press again for the present.
"use strict";
page.past = null; // { before: the snapshot that was there, seq: ours, 0 until it is there }

async function open_past() {
  const before = page.state.history.seq;
  try {
    const r = await fetch("/history");
    if (!r.ok) return say(await r.text());
    page.past = { before, seq: 0 }, show(page.state);
  } catch (e) {
    away(true);
  }
}
function close_past() {
  page.past = null, (page.model_seq = -1);
  for (const kind of ["ply", "svseq"]) $("get-" + kind).href = kind === "ply" ? "/model.ply" : "/history.svseq";
  show(page.state);
}
// Downloads of the moment that is shown.
function point_to_past() {
  const of = "n=" + page.past.seq;
  $("get-ply").href = "/history.ply?" + of + "&at=" + view.time.toFixed(3), ($("get-svseq").href = "/history.svseq?" + of);
}
function show_past(s) {
  const p = page.past, has = s.history.seconds > 0 && !page.viewing && view && view.n > 0;
  $("past").hidden = !has, $("past").setAttribute("aria-pressed", String(!!p));
  $("past").textContent = p ? "Live" : "Past";
  $("past-files").hidden = !p || !p.seq;
  for (const kind of ["spz", "splat"]) $("get-" + kind).parentNode.hidden = !!p;
  if (!p || p.seq || s.history.seq <= p.before) return;
  p.seq = s.history.seq, view.play(false), view.set_time(1);
  view.load_sequence("/history.svseq?n=" + p.seq), point_to_past();
}
$("past").onclick = () => (page.past ? close_past() : open_past());
