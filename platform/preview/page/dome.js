// SPDX-License-Identifier: Apache-2.0
// Guidance on the page: which directions around the scene are covered, what to do next, and how
// many exposures are good. The dome is seen from above: its rim is near the ground, its bottom is
// where the first exposure was taken.
"use strict";

function draw_dome(c, g) {
  const size = (c.width = c.height = 2 * Math.round(c.clientWidth || 180)), x = c.getContext("2d"), middle = size / 2, outer = 0.47 * size;
  const at = (i) => ({ sector: i % g.sectors, band: Math.floor(i / g.sectors) });
  const radius = (band) => outer * (1 - band / (g.bands + 0.6)), turn = (sector) => Math.PI / 2 - (2 * Math.PI * sector) / g.sectors;
  const path = (i) => {
    const { sector, band } = at(i), half = Math.PI / g.sectors;
    x.beginPath();
    x.arc(middle, middle, radius(band) - 2, turn(sector) - half + 0.015, turn(sector) + half - 0.015);
    x.arc(middle, middle, radius(band + 1), turn(sector) + half - 0.015, turn(sector) - half + 0.015, true);
    x.closePath();
  };
  g.cells.forEach((v, i) => {
    path(i);
    x.fillStyle = v < 0 ? "rgba(128,128,128,.12)" : "hsl(" + (v * 1.3 + 5).toFixed(0) + " 65% 45%)";
    x.fill();
  });
  const mark = (i, color, text) => {
    if (i < 0) return;
    const { sector, band } = at(i), r = (radius(band) + radius(band + 1)) / 2, a = turn(sector);
    path(i), (x.lineWidth = size / 60), (x.strokeStyle = color), x.stroke();
    (x.fillStyle = "#fff"), (x.font = size / 16 + "px sans-serif"), (x.textAlign = "center"), (x.textBaseline = "middle");
    x.fillText(text, middle + r * Math.cos(a), middle + r * Math.sin(a));
  };
  mark(g.target, "#ffb000", "+"), mark(g.cell, "#3aa0ff", "●");
}

function show_dome(s) {
  const g = s.guidance, box = $("guide-box"), is_on = Boolean(g && g.kept > 0);
  box.hidden = !is_on;
  if (!is_on) return;
  const place = s.state === "capturing" ? $("message") : $("cameras-box").parentNode;
  if (box.parentNode !== place) place === $("message") ? place.append(box) : $("cameras-box").after(box);
  const percent = (100 * g.coverage).toFixed(0) + " %", has_dome = g.coverage >= 0;
  set("guide-hint", s.state === "capturing" ? g.hint : "");
  set("guide-line", g.good + " good of " + g.kept + " exposures" + (has_dome ? ", " + percent + " of the directions covered" : ""));
  $("dome").hidden = $("dome-key").hidden = !has_dome;
  if (!has_dome) return;
  $("dome").setAttribute("aria-label", "Directions around the scene from above: " + percent + " covered");
  draw_dome($("dome"), g);
}

// Brightness of a camera's image, dark to bright, as bars.
function draw_histogram(c, luma) {
  const n = 32, bins = new Array(n).fill(0), x = c.getContext("2d");
  for (const v of luma) bins[Math.min(n - 1, Math.floor((v * n) / 256))]++;
  const most = Math.max(...bins, 1);
  (c.width = 4 * n), (c.height = 48), (x.fillStyle = getComputedStyle(c).color);
  bins.forEach((v, i) => x.fillRect(4 * i, 48 - (46 * v) / most, 3, (46 * v) / most));
}
