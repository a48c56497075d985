"""The skin to press on the first page: `python docs/figures/browser_skin.py` writes docs/skin.html.

The program `contact` goes through `cnnum export` and Zig's compiler (extra `embedded`) into
WebAssembly, which stands in the page: it asks for nothing else, and works without a network.
"""

import base64
import re
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parents[1]
ROWS = COLS = 8
RATE = 100

PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>A skin to press</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px system-ui, sans-serif; margin: 0; color: #767676; }
canvas { touch-action: none; cursor: crosshair; display: block; }
p { margin: 6px 0; min-height: 1.3em; }
</style>
<canvas id="skin" width="320" height="320"></canvas><p id="said"></p>
<script>
// written by docs/figures/browser_skin.py
const ROWS = @ROWS@, COLS = @COLS@, RATE = @RATE@, SCALE = @SCALE@;
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
  view.depth += ((view.finger ? 0.04 : 0) - view.depth) * 0.1;
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
function draw() {
  for (let place = 0; place < ROWS * COLS; place++) {
    const x = side * (place % COLS), y = side * Math.floor(place / COLS);
    const load = Math.min(1, Math.abs(fields.normal[place] / SCALE.normal) / 0.04);
    brush.fillStyle = `hsl(${220 - 190 * load} 70% ${22 + 38 * load}%)`;
    brush.fillRect(x + 1, y + 1, side - 2, side - 2);
    if (map[place]) {
      brush.strokeStyle = "#fff"; brush.lineWidth = 3;
      brush.strokeRect(x + 3, y + 3, side - 6, side - 6);
    }
  }
  document.getElementById("said").textContent = view.frames < RATE / 2 ? "It measures its rest."
    : (view.touched ? "contact" : "no contact: press the skin") +
      `; a frame takes ${(1e3 * view.spent / view.frames).toFixed(0)} µs here`;
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
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "c"
        command = [sys.executable, "-m", "cnnum", "export", "contact", "--shape", f"{ROWS}x{COLS}"]
        command += ["--rate", str(RATE), "--needs", "contact,contact_map", "--package", "wasm"]
        subprocess.run([*command, "--out", str(folder)], check=True)
        write(folder)


def write(folder: Path) -> None:
    """Compile an export, and write the page."""
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding", "-Os"]
    command += ["-nostdlib", "-ffp-contract=off", "-Wl,--no-entry", "-Wl,--strip-all"]
    sources = ["-o", "skin.wasm", "wasm.c", "contact.c"]
    subprocess.run([*command, *sources], cwd=folder, check=True)
    wasm = base64.b64encode((folder / "skin.wasm").read_bytes()).decode()
    head = (folder / "contact.h").read_text()
    scale = {
        channel.lower(): 2 ** int(bits)
        for channel, bits in re.findall(r"CONTACT_IN_(\w+)_FRACTION (\d+)", head)
    }
    page = PAGE
    for key, value in {"ROWS": ROWS, "COLS": COLS, "RATE": RATE, "SCALE": scale}.items():
        page = page.replace(f"@{key}@", str(value))
    (DOCS / "skin.html").write_text(page.replace("@WASM@", wasm))


if __name__ == "__main__":
    main()
