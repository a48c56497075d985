const box = document.getElementById("search");
const cards = [...document.querySelectorAll("article")];
const count = document.getElementById("count");
function search() {
  const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const card of cards) {
    const fits = words.every((word) => card.dataset.words.includes(word));
    card.hidden = !fits;
    shown += fits;
  }
  count.textContent = `${shown} of ${cards.length} templates`;
}
box.addEventListener("input", search);
box.value = decodeURIComponent(location.hash.slice(1));
search();

// a template that runs here, as WebAssembly: what is drawn on the left gives the right at once
function show(canvas, map, scale, { rows, cols }) {
  Object.assign(canvas, { width: cols, height: rows });
  const brush = canvas.getContext("2d"), image = brush.createImageData(cols, rows);
  map.forEach((value, place) => {
    const gray = 127.5 * (1 - Math.max(-1, Math.min(1, value / scale)));
    image.data.set([gray, gray, gray, 255], 4 * place);
  });
  brush.putImageData(image, 0, 0);
}
function start(live) {
  const about = JSON.parse(live.dataset.live), size = about.rows * about.cols;
  const bytes = Uint8Array.from(atob(about.wasm), (letter) => letter.charCodeAt(0));
  const code = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
  const maps = about.maps.map((map, number) => {
    const kept = new Int16Array(code.memory.buffer, code.input() + 2 * size * number, size);
    kept.set(map.map((value) => Math.round(value * about.scales[number])));
    return kept;
  });
  const answer = new Int16Array(code.memory.buffer, code.output(), size);
  const [left, right] = live.querySelectorAll("canvas");
  function run() {
    code.reset();
    code.step();
    show(left, maps[0], about.scales[0], about);
    show(right, answer, about.scale, about);
  }
  let ink = 1;
  function point(event) {
    const box = left.getBoundingClientRect();
    const row = Math.floor(((event.clientY - box.top) / box.height) * about.rows);
    const col = Math.floor(((event.clientX - box.left) / box.width) * about.cols);
    if (row < 0 || col < 0 || row >= about.rows || col >= about.cols) return;
    const place = row * about.cols + col;
    if (event.type === "pointerdown") ink = maps[0][place] > 0 ? -1 : 1;
    maps[0][place] = ink * about.scales[0];
    run();
  }
  left.addEventListener("pointerdown", (event) => { left.setPointerCapture(event.pointerId); point(event); });
  left.addEventListener("pointermove", (event) => { if (event.buttons) point(event); });
  run();
  return { code, maps, answer, about };
}
const view = { running: new Map() };
for (const live of document.querySelectorAll(".live"))
  live.addEventListener("toggle", () => {
    if (live.open && !view.running.has(live)) view.running.set(live, start(live));
  });
