"use strict";
// The program of a scene: its graph, and the results of the operations that are seen (cnnum/live/hub.py).
const NODES = 0xffffffff; // in the place of a picture's number
const program = { nodes: [], shown: [], selected: null, values: new Map(), boxes: new Map(), seen: new Set(), places: new Map(), time: null };

function showProgram(graph) {
  at("program").hidden = !graph;
  asked = null; // a new line to the server knows nothing of what is seen
  if (!graph || program.nodes.length) { if (graph) askNodes(); return; }
  program.nodes = graph.nodes.map((node) => ({ ...node, readers: [] }));
  // a folded step is shown by the step that reads it, which then reads what the folded one did
  const owner = (n) => graph.nodes[n].into ?? n;
  program.shown = program.nodes.filter((node) => node.into === null);
  for (const node of program.nodes) {
    const to = program.nodes[owner(node.number)];
    to.from ??= new Set();
    for (const n of node.arguments) if (owner(n) !== to.number) to.from.add(owner(n));
  }
  for (const node of program.shown) for (const n of node.from) program.nodes[n].readers.push(node.number);
  const deep = new Map(), rows = new Map();
  for (const node of program.shown) {
    const column = 1 + Math.max(-1, ...[...node.from].map((n) => deep.get(n)));
    deep.set(node.number, column);
    rows.set(column, (rows.get(column) || 0) + 1);
    program.places.set(node.number, [column, rows.get(column) - 1]);
  }
  program.columns = Math.max(...rows.keys()) + 1;
  program.rows = rows;
  const names = program.shown.flatMap((node) => node.outputs.map((name) => [name, node.number]));
  at("outputs").replaceChildren(...names.map(([name, n]) => made("option", "", name)).map((item, k) => Object.assign(item, { value: names[k][1] })));
  listNodes();
  select(Number(names.length ? names[0][1] : program.shown[program.shown.length - 1].number));
}

const title = (node) => node.outputs.join(", ") || node.operation;

function card(node) {
  const box = made("button", "node", made("b", "", title(node)), document.createElement("canvas"), made("small", "", ""));
  box.type = "button";
  box.dataset.node = node.number;
  box.title = `${node.number} · ${node.operation} (${node.origin})`;
  box.addEventListener("click", () => select(node.number));
  if (!program.boxes.has(node.number)) program.boxes.set(node.number, new Set());
  program.boxes.get(node.number).add(box);
  program.watch ??= new IntersectionObserver((entries) => {
    for (const entry of entries) {
      const n = Number(entry.target.dataset.node);
      if (entry.isIntersecting) program.seen.add(entry.target);
      else program.seen.delete(entry.target);
      if (entry.isIntersecting && program.values.has(n)) paintNode(entry.target, program.nodes[n]);
    }
    askNodes();
  });
  program.watch.observe(box);
  return box;
}

function drop(parent) {
  for (const box of parent.querySelectorAll(".node")) {
    program.watch.unobserve(box);
    program.seen.delete(box);
    program.boxes.get(Number(box.dataset.node)).delete(box);
  }
  parent.replaceChildren();
}

let asked = null;
function askNodes() { // results are sent of these alone
  const wanted = [...new Set([...program.seen].map((box) => Number(box.dataset.node)))].sort((a, b) => a - b);
  const key = wanted.join();
  if (key === asked) return;
  asked = key;
  send({ nodes: wanted });
}

function select(number) {
  const node = program.nodes[number];
  program.selected = node;
  for (const [place, numbers] of [["reads", [...node.from]], ["chosen", [number]], ["readers", node.readers]]) {
    drop(at(place));
    at(place).append(...numbers.map((n) => card(program.nodes[n])));
    if (!numbers.length) at(place).append(made("p", "soft", place === "reads" ? "reads the frame alone" : "read by no step"));
  }
  const kept = node.stores.length ? ` Kept as memory ${node.stores.join(", ")} until the next frame.` : "";
  const gives = node.outputs.length ? ` Gives ${node.outputs.join(", ")}.` : "";
  at("said").textContent = `${node.number} · ${node.operation}.${gives}${kept} From ${node.origin}.`;
  at("outputs").value = node.outputs.length ? node.number : "";
  drawGraph();
}

function listNodes() {
  const words = at("search").value.toLowerCase().split(/\s+/).filter(Boolean), parts = new Map();
  for (const node of program.shown) {
    const text = `${node.operation} ${node.outputs} ${node.stores} ${node.origin}`.toLowerCase();
    if (!words.every((word) => text.includes(word))) continue;
    const name = node.origin.split(" ")[0] || "the program itself";
    if (!parts.has(name)) parts.set(name, []);
    parts.get(name).push(node);
  }
  drop(at("steps"));
  for (const [name, nodes] of parts) {
    const box = document.createElement("details"), inside = made("div", "cards");
    box.append(made("summary", "", `${name} `, made("small", "", `${nodes.length} step${nodes.length > 1 ? "s" : ""}`)), inside);
    box.addEventListener("toggle", () => { drop(inside); if (box.open) inside.append(...nodes.map(card)); });
    box.open = words.length > 0;
    at("steps").append(box);
  }
  at("count").textContent = `${[...parts.values()].reduce((sum, nodes) => sum + nodes.length, 0)} of ${program.shown.length} steps; ${program.nodes.length - program.shown.length} of local arithmetic are folded`;
}

// magic u32, count u32, time f64; then numbers (u32), then their values (f32)
function nodesCame(buffer) {
  const head = new DataView(buffer), count = head.getUint32(4, true);
  const numbers = new Uint32Array(buffer, 16, count), values = new Float32Array(buffer, 16 + 4 * count);
  let first = 0;
  for (const n of numbers) {
    const size = program.nodes[n].shape.reduce((product, side) => product * side, 1);
    program.values.set(n, values.subarray(first, first + size));
    first += size;
  }
  program.time = head.getFloat64(8, true);
  at("of").textContent = `results at ${program.time.toFixed(3)} s`;
  document.body.dataset.nodes = program.time;
  for (const box of program.seen) if (program.values.has(Number(box.dataset.node))) paintNode(box, program.nodes[Number(box.dataset.node)]);
}

function paintNode(box, node) {
  const values = program.values.get(node.number), canvas = box.children[1], note = box.children[2];
  canvas.hidden = !node.shape.length;
  if (!node.shape.length) { note.textContent = String(Number(values[0].toPrecision(4))); note.className = "figure"; return; }
  const [rows, cols] = node.shape.slice(-2), maps = node.shape.length > 2 ? node.shape[0] : 1;
  const across = Math.ceil(Math.sqrt(maps)), down = Math.ceil(maps / across);
  const width = across * (cols + 1) - 1, height = down * (rows + 1) - 1, image = new ImageData(width, height);
  let top = 0;
  for (const value of values) top = Math.max(top, Math.abs(value));
  for (let n = 0; n < values.length; n += 1) {
    const map = Math.floor(n / (rows * cols)), r = Math.floor(n / cols) % rows, c = n % cols;
    const x = (map % across) * (cols + 1) + c, y = Math.floor(map / across) * (rows + 1) + r;
    const [red, green, blue] = values[n] > 0 ? colours.above : colours.below, share = top ? Math.abs(values[n]) / top : 0;
    image.data.set([red, green, blue, Math.round(255 * share)], 4 * (y * width + x));
  }
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext("2d").putImageData(image, 0, 0);
  note.textContent = `${maps > 1 ? `${maps} maps, ` : ""}±${Number(top.toPrecision(3))}`;
}

// ---- the graph as a whole: a dot for each step, to the right of all that it reads ----------------

function ancestors(number, way) {
  const known = new Set(), waiting = [number];
  while (waiting.length) for (const n of way(program.nodes[waiting.pop()])) if (!known.has(n)) { known.add(n); waiting.push(n); }
  return known;
}

function spot(number) {
  const [column, row] = program.places.get(number), canvas = at("graph");
  const width = canvas.clientWidth - 16, height = canvas.clientHeight - 16, many = program.rows.get(column);
  return [8 + (width * (column + 0.5)) / program.columns, 8 + (height * (row + 0.5)) / many];
}

function drawGraph() {
  const canvas = at("graph"), density = devicePixelRatio || 1;
  if (!program.selected || !canvas.clientWidth) return;
  Object.assign(canvas, { width: canvas.clientWidth * density, height: canvas.clientHeight * density });
  const pen = canvas.getContext("2d"), { number } = program.selected;
  pen.scale(density, density);
  const before = ancestors(number, (node) => node.from), after = ancestors(number, (node) => node.readers);
  const near = (n) => n === number || before.has(n) || after.has(n);
  for (const lit of [false, true]) {
    pen.strokeStyle = lit ? colours.r3 : colours.rule;
    pen.lineWidth = lit ? 1.2 : 0.7;
    for (const node of program.shown) for (const n of node.from) {
      const both = (before.has(n) && (before.has(node.number) || node.number === number)) || (after.has(node.number) && (after.has(n) || n === number));
      if (both !== lit) continue;
      const [x0, y0] = spot(n), [x1, y1] = spot(node.number), bend = (x1 - x0) / 2;
      pen.beginPath(); pen.moveTo(x0, y0); pen.bezierCurveTo(x0 + bend, y0, x1 - bend, y1, x1, y1); pen.stroke();
    }
  }
  for (const node of program.shown) {
    const [x, y] = spot(node.number), size = node.number === number ? 5.5 : node.outputs.length ? 4 : 2.6;
    pen.fillStyle = node.number === number ? colours.gross : node.template ? colours.contact : near(node.number) ? colours.r3 : colours.soft;
    pen.beginPath(); pen.arc(x, y, size, 0, 7); pen.fill();
  }
}

at("graph").addEventListener("pointerdown", (event) => {
  const box = at("graph").getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
  const far = (node) => { const [a, b] = spot(node.number); return Math.hypot(a - x, b - y); };
  select(program.shown.reduce((best, node) => (far(node) < far(best) ? node : best)).number);
});
at("graph").addEventListener("keydown", (event) => {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!step || !program.selected) return;
  event.preventDefault();
  const next = program.shown.indexOf(program.selected) + step;
  select(program.shown[Math.min(program.shown.length - 1, Math.max(0, next))].number);
});
at("search").addEventListener("input", listNodes);
at("outputs").addEventListener("change", (event) => select(Number(event.target.value)));
addEventListener("resize", drawGraph);
