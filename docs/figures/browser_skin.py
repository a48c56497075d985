"""The skin to press on the first page: `python docs/figures/browser_skin.py` writes docs/skin.html.

The program `contact` goes through `cnnum export` and Zig's compiler (extra `embedded`) into
WebAssembly, which stands in the page: it asks for nothing else, and works without a network.
"""

import base64
import json
from pathlib import Path

import cnnum
from cnnum.embedded.c.files import MANIFEST
from cnnum.report.web_assembly import compiled

DOCS = Path(__file__).parents[1]
ROWS = COLS = 8
RATE = 100
COLOURS = (68, 1, 84), (59, 82, 139), (33, 144, 141), (93, 201, 99), (253, 231, 37)
"""Five of Matplotlib's viridis, red, green and blue."""

PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>A skin to press</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px system-ui, sans-serif; margin: 0; color: #767676; }
canvas { touch-action: none; cursor: crosshair; display: block; }
p { margin: 6px 0; min-height: 1.3em; }
#legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: 13px; }
#legend span { display: flex; align-items: center; gap: 6px; }
i { display: inline-block; height: 12px; background: #440154; }
svg { background: #21908d; }
#scale { width: 90px; background: linear-gradient(90deg, @GRADIENT@); }
#frame { width: 12px; outline: 2px solid #fff; outline-offset: -3px; }
</style>
<canvas id="skin" width="320" height="320"></canvas>
<p id="said"></p>
<p id="legend">
<span>compression 0 <i id="scale"></i> 4 %</span>
<span><svg width="30" height="14" fill="none">
<path d="M4 7h22m-5-4 5 4-5 4" stroke="#fff" stroke-width="5"/>
<path d="M4 7h22m-5-4 5 4-5 4" stroke="#111" stroke-width="2"/></svg>shear</span>
<span><i id="frame"></i>taxel in contact</span>
</p>
<script>
// written by docs/figures/browser_skin.py
const ROWS = @ROWS@, COLS = @COLS@, RATE = @RATE@, SCALE = @SCALE@;
const COLOURS = @COLOURS@;
const LARGEST = 0.04;  // strain at which colours and arrows end
const bytes = Uint8Array.from(atob("@WASM@"), letter => letter.charCodeAt(0));
const code = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
// the frame and the answers as contact.h has them
const fields = Object.fromEntries(["shear_x", "shear_y", "normal"].map((name, number) => [name,
  new Int16Array(code.memory.buffer, code.input() + 2 * ROWS * COLS * number, ROWS * COLS)]));
const flag = new Uint8Array(code.memory.buffer, code.output(), 1);
const map = new Uint8Array(code.memory.buffer, code.output() + 1, ROWS * COLS);
const view = { finger: null, depth: 0, frames: 0, touched: false, map, spent: 0 };

// strain under a round finger: compression, and shear towards its middle; it sinks in 0.1 s
function scan() {
  view.depth += ((view.finger ? LARGEST : 0) - view.depth) * 0.1;
  if (view.finger) view.last = view.finger;
  const [row, col] = view.last || [0, 0];
  for (let place = 0; place < ROWS * COLS; place++) {
    const y = Math.floor(place / COLS) - row, x = place % COLS - col;
    const load = view.depth * Math.exp(-(x * x + y * y) / 2.5);
    const strain = { shear_x: -0.4 * x * load, shear_y: -0.4 * y * load, normal: -load };
    for (const name in fields) {
      const noise = 2e-5 * (Math.random() + Math.random() + Math.random() - 1.5);
      const number = Math.round((strain[name] + noise) * SCALE[name]);
      fields[name][place] = Math.max(-32768, Math.min(32767, number));
    }
  }
}

const canvas = document.getElementById("skin"), brush = canvas.getContext("2d");
const side = canvas.width / COLS;
function colour(share) {
  const at = Math.min(share * (COLOURS.length - 1), COLOURS.length - 1.001), low = Math.floor(at);
  return `rgb(${COLOURS[low].map((from, part) =>
    Math.round(from + (at - low) * (COLOURS[low + 1][part] - from)))})`;
}
function arrow(x, y, along, down) {
  const length = Math.hypot(along, down);
  if (length < 3) return;
  const [p, q] = [along / length, down / length];
  const [right, low] = [x + along / 2, y + down / 2];
  brush.beginPath();
  brush.moveTo(x - along / 2, y - down / 2); brush.lineTo(right, low);
  for (const turn of [1, -1]) {
    brush.moveTo(right, low);
    brush.lineTo(right - 5 * p + 4 * turn * q, low - 5 * q - 4 * turn * p);
  }
  for (const [style, width] of [["#fff", 5], ["#111", 2]]) {
    brush.strokeStyle = style; brush.lineWidth = width; brush.stroke();
  }
}
function draw() {
  for (let place = 0; place < ROWS * COLS; place++) {
    const x = side * (place % COLS), y = side * Math.floor(place / COLS);
    const load = Math.min(1, Math.abs(fields.normal[place] / SCALE.normal) / LARGEST);
    brush.fillStyle = colour(load);
    brush.fillRect(x + 1, y + 1, side - 2, side - 2);
    if (map[place]) {
      brush.strokeStyle = "#fff"; brush.lineWidth = 3;
      brush.strokeRect(x + 3, y + 3, side - 6, side - 6);
    }
    arrow(x + side / 2, y + side / 2, ...["shear_x", "shear_y"].map(
      name => side * fields[name][place] / SCALE[name] / LARGEST));
  }
  const taxels = map.reduce((sum, taxel) => sum + taxel, 0);
  const spent = (1e3 * view.spent / view.frames).toFixed(0);
  document.getElementById("said").textContent = view.frames < RATE / 2 ? "It measures its rest."
    : (view.touched ? `contact of ${taxels} taxels` : "no contact: press the skin") +
      `; ${spent} µs per frame`;
}

let begin = performance.now();
function turn() {
  const due = Math.floor((performance.now() - begin) * RATE / 1e3);
  if (due - view.frames > RATE) begin += (due - view.frames) * 1e3 / RATE;  // the page slept
  else while (view.frames < due) {
    scan();
    const start = performance.now();
    code.step();
    view.spent += performance.now() - start;
    view.frames++;
    view.touched = flag[0] === 1;
  }
  draw();
  requestAnimationFrame(turn);
}
function point(event) {
  const box = canvas.getBoundingClientRect();
  view.finger = [(event.clientY - box.top) / side - 0.5, (event.clientX - box.left) / side - 0.5];
}
canvas.addEventListener("pointerdown", event => {
  canvas.setPointerCapture(event.pointerId);
  point(event);
});
canvas.addEventListener("pointermove", event => { if (view.finger) point(event); });
for (const end of ["pointerup", "pointercancel"])
  canvas.addEventListener(end, () => { view.finger = null; });
code.reset();
turn();
</script>
</html>
"""


def main() -> None:
    """Export, compile, and write the page."""
    needs = ("contact", "contact_map")
    exported = cnnum.export("contact", (ROWS, COLS), rate=RATE, needs=needs).packaged("wasm")
    wasm = base64.b64encode(compiled(exported, "contact")).decode()
    record = json.loads(exported.files[MANIFEST])
    scale = {part["name"]: 2 ** part["fraction"] for part in record["inputs"]}
    page = PAGE
    fills = {
        "GRADIENT": ", ".join(f"rgb{colour}" for colour in COLOURS),
        "COLOURS": [list(colour) for colour in COLOURS],
        "ROWS": ROWS,
        "COLS": COLS,
        "RATE": RATE,
        "SCALE": scale,
    }
    for key, value in fills.items():
        page = page.replace(f"@{key}@", str(value))
    (DOCS / "skin.html").write_text(page.replace("@WASM@", wasm))


if __name__ == "__main__":
    main()
