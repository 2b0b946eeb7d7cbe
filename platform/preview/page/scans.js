// SPDX-License-Identifier: Apache-2.0
// Earlier scans: list, look at, download, delete with undo.
"use strict";
const scans = { list: null, shown: 0 };
const formats = [["model.ply", ".ply"], ["model.spz", ".spz"], ["model.splat", ".splat"]];
const extras = [["mesh.glb", "mesh .glb"], ["mesh.ply", "mesh .ply"], ["mesh.obj", "mesh .obj"], ["motion.bin", "motion"], ["model.svseq", "sequence"]];

async function load_scans() {
  try {
    const r = await fetch("/scans");
    scans.list = r.ok ? await r.json() : { error: await r.text(), scans: [] };
    page.free_bytes = scans.list.free;
    show_scans();
  } catch (e) {
    away(true);
  }
}

async function change_scan(number, what) {
  try {
    const r = await fetch("/scan/" + number + "/" + what, { method: "POST", headers: token_header });
    if (!r.ok) say(await r.text());
    load_scans();
  } catch (e) {
    away(true);
  }
}

function button(text, action, label) {
  const b = element("button", text);
  b.onclick = action, b.setAttribute("aria-label", text + " " + label), (b.disabled = page.seat === 0 && !["View"].includes(text));
  return b;
}
// A model in a format: its size is asked for when it is not a file yet.
function link_of(scan, file, text) {
  const a = element("a", text, "button"), size = scan.files[file];
  (a.href = "/scan/" + scan.number + "/" + file), (a.download = scan.name + "-" + file);
  if (size) a.textContent += " " + bytes(size);
  else
    fetch(a.href, { method: "HEAD" }).then((r) => r.ok && (a.textContent = text + " " + bytes(+r.headers.get("Content-Length")))).catch(() => {});
  return a;
}
// A format that the device makes on request: asked for again until the file is there.
const exports = [["sog", ".sog"], ["html", ".html"], ["glb", ".glb"]], waited = new Map();
function export_of(scan, id, text) {
  const file = "model." + id, key = scan.number + "/" + id;
  if (scan.files[file]) return waited.delete(key), link_of(scan, file, text);
  const b = button(waited.has(key) ? "Making " + text : "Make " + text, () => make_export(scan, id, text), scan.name);
  b.disabled ||= waited.has(key) || page.seat === 0;
  return b;
}
async function make_export(scan, id, text) {
  const key = scan.number + "/" + id, until = Date.now() + 120000;
  waited.set(key, 1), show_scans();
  for (let i = 0; waited.has(key) && Date.now() < until; i++) {
    if (i % 5 === 0) {
      const r = await fetch("/scan/" + key, { method: "POST", headers: token_header }).catch(() => 0);
      if (r && !r.ok) return waited.delete(key), show_scans(), say(await r.text());
    }
    await new Promise((f) => setTimeout(f, 1000));
    await load_scans();
  }
  if (waited.delete(key)) show_scans(), say("The device could not make " + text + ". Its log says why.");
}
function row_of(scan) {
  const li = element("li"), text = element("div", undefined, "scan-text"), row = element("p", undefined, "row");
  const date = new Date(1000 * scan.time).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
  text.append(element("h3", scan.name), element("p", date + ", " + bytes(scan.bytes), "quiet"));
  li.id = "scan-" + scan.number;
  if (scan.deleted) {
    li.className = "deleted";
    text.append(element("p", "Deleted. It can be restored for 10 minutes.", "quiet"));
    row.append(button("Undo", () => change_scan(scan.number, "restore"), scan.name), button("Delete for good", () => change_scan(scan.number, "purge"), scan.name));
  } else {
    const image = element("img");
    if (scan.files["preview.jpg"]) (image.src = "/scan/" + scan.number + "/preview.jpg"), (image.alt = "A captured image and its rendering"), (image.loading = "lazy"), li.append(image);
    row.append(button("View", () => view_scan(scan), scan.name));
    for (const [file, name] of formats) row.append(link_of(scan, file, name));
    for (const [file, name] of extras) if (scan.files[file]) row.append(link_of(scan, file, name));
    if (scans.list.exports) for (const [id, name] of exports) row.append(export_of(scan, id, name));
    row.append(button("Delete", () => change_scan(scan.number, "delete"), scan.name));
  }
  text.append(row), li.append(text);
  return li;
}
function show_scans() {
  const { error, free, total, scans: list } = scans.list;
  set("scans-line", error ? error[0].toUpperCase() + error.slice(1) + "." : list.length + (list.length === 1 ? " scan. " : " scans. ") + bytes(free) + " free of " + bytes(total) + "." + (scans.list.exports || error ? "" : " For SOG, HTML and GLB, install the package subview-lab on the device."));
  $("scans-list").replaceChildren(...list.map(row_of));
}

// --- an earlier model in the view ---
async function view_scan(scan) {
  open_view();
  if (!view) return;
  try {
    const r = await fetch("/scan/" + scan.number + "/model");
    if (!r.ok) return say(await r.text());
    page.viewing = scan, view.clear(), view.load(await r.arrayBuffer());
    if (scan.files["model.svseq"]) view.load_sequence("/scan/" + scan.number + "/model.svseq");
    show_page("scan"), show_clip(), show_viewing();
  } catch (e) {
    away(true);
  }
}
function show_viewing() {
  const scan = page.viewing, from = scan ? "/scan/" + scan.number : "";
  $("viewing").hidden = !scan, set("viewing-line", scan ? "Scan " + scan.name : "");
  $("before").disabled = !!scan;
  for (const id of ["ply", "spz", "splat"]) {
    $("get-" + id).href = from + "/model." + id;
    document.querySelector('[data-size$="model.' + id + '"]').dataset.size = from + "/model." + id;
  }
  page.sized = "";
  if (page.state) show(page.state);
}
$("viewing-end").onclick = () => {
  page.viewing = null, (page.model_seq = -1), view.clear(), show_viewing();
};
document.addEventListener("page", (e) => e.detail === "scans" && load_scans());
entered.then(load_scans), setInterval(load_scans, 30000); // the disk fills up, too
