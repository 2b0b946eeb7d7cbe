// SPDX-License-Identifier: Apache-2.0
// Another device: this one shows a code with the link and a PIN; that one asks for the PIN when it
// has no link.
"use strict";
async function post_access(what, headers) {
  const r = await fetch("/" + what, { method: "POST", headers: headers || token_header });
  if (!r.ok) throw new Error(await r.text());
  return r;
}

// --- the device that has the link ---
const pairing = { until: 0, timer: 0 };
function end_pairing() {
  clearInterval(pairing.timer);
  $("pair-shown").hidden = true;
  if ($("pair-code").src) URL.revokeObjectURL($("pair-code").src);
  $("pair-code").removeAttribute("src"), set("pair-pin", "");
}
$("pair-open").onclick = async () => {
  end_pairing();
  try {
    const code = await post_access("qr"), pin = await (await post_access("pin")).json();
    $("pair-code").src = URL.createObjectURL(await code.blob());
    set("pair-pin", pin.pin.slice(0, 3) + " " + pin.pin.slice(3)), set("pair-where", location.origin);
    pairing.until = Date.now() + 1000 * pin.seconds;
    $("pair-shown").hidden = false;
    pairing.timer = setInterval(() => {
      const left = Math.round((pairing.until - Date.now()) / 1000);
      set("pair-left", left + " s");
      if (left <= 0) end_pairing();
    }, 500);
  } catch (e) {
    say(e.message);
  }
};
$("pair-close").onclick = end_pairing;

// --- the device that asks ---
$("pair").onsubmit = async (event) => {
  event.preventDefault();
  try {
    const digits = $("pair-given").value.replace(/\D/g, "");
    const r = await post_access("pair", { "X-Subview-Pin": digits });
    keep_token(await r.text());
    location.reload();
  } catch (e) {
    set("pair-answer", e.message), ($("pair-given").value = "");
  }
};
const show_pairing = () => (($("pair").hidden = page.seat > 0), ($("pair-box").hidden = !page.seat));
entered.then(show_pairing), setInterval(show_pairing, 1000);
