"use strict";
// The page of a template: what is changed is asked of the server (cnnum/live/studio.py) at once.
const at = (id) => document.getElementById(id);
const NEAR = ["nw", "n", "ne", "w", "c", "e", "sw", "s", "se"];
const FIELDS = { boundary: "rim", input_boundary: "input_rim", initial: "x0", duration: "duration" };
const CHOICES = { boundary: "boundary", input_boundary: "input_boundary", initial: "initial", duration: "until" };

const view = {
  template: null, rows: 32, cols: 32, picture: new Int8Array(32 * 32), film: null, moment: 32, cell: [16, 16],
  past: [], future: [], chosen: "z", other: null, otherFilm: null, facts: null, flips: null, saved: "", took: [],
  asked: {}, due: false, wait: 500, playing: 0,
};

// ---- questions and answers -----------------------------------------------------------------------

function connect() {
  const socket = new WebSocket(`ws://${location.host}/studio${location.search}`);
  socket.binaryType = "arraybuffer";
  view.socket = socket;
  socket.onopen = () => { view.wait = 500; view.asked = {}; };
  socket.onmessage = ({ data }) => (typeof data === "string" ? answered(JSON.parse(data)) : filmed(data));
  socket.onclose = () => {
    say("The connection is lost; trying again…");
    setTimeout(connect, view.wait);
    view.wait = Math.min(5000, 2 * view.wait);
  };
}

let numbers = 0;
// one question of a kind is on its way; what changes meanwhile is asked once it is answered
function ask(kind, parts) {
  const known = (view.asked[kind] ??= {});
  if (known.id) { known.next = parts; return; }
  known.id = numbers += 1;
  known.next = null;
  known.sent = performance.now();
  if (view.socket.readyState === WebSocket.OPEN) view.socket.send(JSON.stringify({ do: kind, id: known.id, ...parts() }));
}

function done(kind) {
  const known = view.asked[kind];
  known.id = 0;
  if (known.next) ask(kind, known.next);
}

const drawn = () => ({
  template: view.template, rows: view.rows, cols: view.cols,
  picture: btoa(String.fromCharCode(...new Uint8Array(view.picture.buffer))),
});

let later = 0;
const LAST = 32; // number of the last time of a film
// the place in a film of the time that is shown: a short one holds the start and that time alone
const frame = (film) => (film.times.length === 2 ? Math.min(1, view.moment) : view.moment);

function askFilms(alone) {
  const which = () => (alone ? { moment: view.moment || LAST } : {});
  ask("run", () => ({ ...drawn(), ...which() }));
  if (view.other) ask("other", () => ({ ...drawn(), ...which(), template: view.other, do: "run" }));
}

function changed() {
  askFilms(true); // the other times come once nothing changes
  clearTimeout(later);
  view.due = true;
  later = setTimeout(() => {
    view.due = false;
    askFilms(false);
    ask("facts", drawn);
    countFlips();
    if (view.other) ask("compare", () => ({ template: view.template, other: view.other }));
  }, 200);
}

const bits = () => (Number(at("bits").value) > 16 ? 0 : Number(at("bits").value)); // 0 is all

function countFlips() {
  view.flips = null;
  at("flips").textContent = "counting…";
  ask("flips", () => ({ ...drawn(), mismatch: Number(at("mismatch").value) / 100, bits: bits() }));
}

const saying = {};
function say(text, kind = "run") { // a run that went well does not take back what the facts said
  saying[kind] = text;
  at("said").textContent = saying.run || saying.facts || "";
}

function answered(message) {
  if (message.kind === "hello") { greet(message); return; }
  const kind = Object.keys(view.asked).find((name) => view.asked[name].id === message.id);
  if (!kind) return;
  if (message.error) {
    if (kind === "design") at("ruled").textContent = message.error;
    else if (kind === "flips") { at("flips").textContent = "–"; at("of").textContent = message.error; }
    else if (kind === "facts") { view.facts = null; at("facts").replaceChildren(); say(message.error, kind); }
    else say(message.error);
  } else if (kind === "facts") showFacts(message);
  else if (kind === "flips") showFlips(message);
  else if (kind === "compare") showCompared(message);
  else if (kind === "design") designed(message);
  else if (kind === "load") { keep(); view.template = message.template; filled(); }
  else if (kind === "second") { view.other = message.template; changed(); }
  else if (kind === "save") save(message.toml);
  else if (kind === "live") sensed(message);
  done(kind);
}

function filmed(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const film = { ...head, states: new Float32Array(buffer, 4 + length) };
  const kind = view.asked.other && view.asked.other.id === head.id ? "other" : "run";
  if (kind === "other") view.otherFilm = film;
  else {
    say("");
    view.film = film;
    if (view.facts && film.times.length > 2) showFacts(view.facts);
    view.cell = [Math.min(view.cell[0], film.rows - 1), Math.min(view.cell[1], film.cols - 1)];
  }
  draw();
  if (kind === "run") {
    view.took.push(performance.now() - view.asked.run.sent);
    document.body.dataset.films = view.took.length;
  }
  done(kind);
}

function greet(hello) {
  say("");
  const list = hello.names.map((name) => Object.assign(document.createElement("option"), { textContent: name }));
  at("library").replaceChildren(...list.map((item) => item.cloneNode(true)));
  at("second").replaceChildren(Object.assign(document.createElement("option"), { textContent: "none", value: "" }), ...list);
  if (!view.template) { view.template = hello.template; shapes(); }
  at("library").value = view.template.name;
  at("source").hidden = !hello.live;
  filled();
  if (hello.live) ask("live", () => ({}));
}

let sensedLast = -1;
function sensed(message) { // the newest loads of an array
  if (!at("live").checked) return;
  if (message.number !== sensedLast && message.picture) {
    sensedLast = message.number;
    const cells = Int8Array.from(atob(message.picture), (c) => c.charCodeAt(0));
    if (cells.length !== view.picture.length || cells.some((v, n) => v !== view.picture[n])) {
      Object.assign(view, { picture: cells, rows: message.rows, cols: message.cols });
      draw();
      changed();
    }
  }
  if (message.ended) say(message.ended);
  else setTimeout(() => ask("live", () => ({})), 40);
}

// ---- the template and its fields -----------------------------------------------------------------

const round = (value) => Number(value.toPrecision(6));
const label = (name) => (name.includes("[") ? name : { z: "z", tau: "τ", rim: "state beyond the rim", input_rim: "input beyond", x0: "start" }[name]);

function keep() {
  const now = JSON.stringify([view.template, view.rows, view.cols, [...view.picture]]);
  if (view.past[view.past.length - 1] !== now) view.past.push(now);
  if (view.past.length > 200) view.past.shift();
  view.future = [];
  buttons();
}

function step(from, to) {
  if (!from.length) return;
  to.push(JSON.stringify([view.template, view.rows, view.cols, [...view.picture]]));
  const [template, rows, cols, picture] = JSON.parse(from.pop());
  Object.assign(view, { template, rows, cols, picture: Int8Array.from(picture) });
  at("side").value = String(rows);
  filled();
}

function buttons() {
  at("undo").disabled = !view.past.length;
  at("redo").disabled = !view.future.length;
}

function kernel(part) {
  const box = at(part);
  for (let n = 0; n < 9; n += 1) {
    const field = Object.assign(document.createElement("input"), { type: "number", step: "any", id: `${part}${n}` });
    field.setAttribute("aria-label", `${part} of ${NEAR[n]}`);
    field.dataset.number = `${part}[${Math.floor(n / 3)}, ${n % 3}]`;
    box.append(field);
  }
}

function number(name) {
  const t = view.template, found = /^([AB])\[(\d), (\d)\]$/.exec(name);
  if (found) return t[found[1]] ? t[found[1]][found[2]][found[3]] : 0;
  return { z: t.z, tau: t.tau, rim: Number(at("rim").value), input_rim: Number(at("input_rim").value), x0: Number(at("x0").value) }[name];
}

function put(name, value) {
  const t = view.template, found = /^([AB])\[(\d), (\d)\]$/.exec(name);
  if (found) {
    t[found[1]] ??= [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
    t[found[1]][found[2]][found[3]] = value;
  } else if (name === "z" || name === "tau") t[name] = value;
  else t[Object.keys(FIELDS).find((key) => FIELDS[key] === name)] = value;
}

function choose(name) {
  view.chosen = name;
  for (const field of document.querySelectorAll("[data-number]")) field.classList.toggle("chosen", field.dataset.number === name);
  const value = number(name), span = name === "tau" ? [0.1, 5] : [-1, 1].map((sign) => sign * Math.max(4, Math.ceil(2 * Math.abs(value))));
  Object.assign(at("slider"), { min: span[0], max: span[1] });
  at("slider").value = value;
  at("chosen").textContent = `${label(name)} = ${round(value)}`;
}

function tint(field, value) {
  const strength = Math.min(0.75, 0.12 + 0.1 * Math.abs(value));
  field.style.backgroundColor = value ? `rgba(var(--${value > 0 ? "plus" : "minus"}), ${value ? strength : 0})` : "";
}

function filled() {
  const t = view.template;
  at("name").value = t.name;
  for (const part of ["A", "B"]) for (let n = 0; n < 9; n += 1) {
    const value = t[part] ? t[part][Math.floor(n / 3)][n % 3] : 0, field = at(`${part}${n}`);
    if (document.activeElement !== field) field.value = round(value);
    tint(field, value);
  }
  for (const name of ["z", "tau"]) if (document.activeElement !== at(name)) at(name).value = round(t[name]);
  for (const key of Object.keys(FIELDS)) {
    const value = t[key], plain = typeof value === "number", field = at(FIELDS[key]);
    at(CHOICES[key]).value = plain ? "number" : value;
    field.hidden = !plain;
    if (plain && document.activeElement !== field) field.value = round(value);
  }
  at("rule").value = t.rule || "";
  at("hint").hidden = Boolean(t.rule);
  at("given").textContent = t.B ? "Input" : "Start";
  showStencil();
  choose(view.chosen);
  buttons();
  changed();
}

function edited(field) {
  const value = Number(field.value);
  if (field.value === "" || !Number.isFinite(value)) return;
  put(field.dataset.number, value);
  filled();
}

// ---- what it should do -----------------------------------------------------------------------------

function cells(rule) {
  const found = /^match\(["']([#o.]{3})\/([#o.]{3})\/([#o.]{3})["']\)$/.exec((rule || "").trim());
  return found ? [...found.slice(1).join("")] : Array(9).fill(".");
}

function stamp(box, signs) {
  signs.forEach((sign, n) => { box.children[n].className = { "#": "black", o: "white", ".": "" }[sign]; });
}

function showStencil() { stamp(at("stencil"), cells(view.template.rule)); }

function designed(message) {
  keep();
  Object.assign(view.template, message.template);
  const worst = message.worst === null ? "" : `; no cell is wrong while all numbers are off by less than ${percent(message.worst)}`;
  filled();
  at("ruled").textContent = `largest margin there is: ${percent(message.relative)} of the sum of all weights${worst}`;
}

const percent = (share) => `${Number((100 * share).toPrecision(2))} %`;

function showFlips(message) {
  view.flips = message;
  at("flips").textContent = `${percent(message.flipped)} of chips flip a cell`;
  at("of").textContent = `${message.draws} chips against ${message.of}; 95 % interval ${percent(message.low)} to ${percent(message.high)}`;
}

function fact(name, value) {
  const item = document.createElement("div");
  item.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
  return item;
}

// when all outputs are within 0.01 of those at the end of the film
function settled() {
  const { states, rows, cols, times } = view.film, size = rows * cols, last = (times.length - 1) * size;
  for (let k = times.length - 2; k >= 0; k -= 1)
    for (let n = 0; n < size; n += 1)
      if (Math.abs(clip(states[k * size + n]) - clip(states[last + n])) > 0.01) return times[k + 1];
  return 0;
}

function showFacts(message) {
  say("", "facts");
  view.facts = message;
  if (!view.film) return; // they are shown with it
  const time = settled(), moving = time === view.film.times[view.film.times.length - 1];
  const list = [
    ["stability class", message.stability],
    ["outputs rest from", view.film.times.length === 2 ? "…" : moving ? "not in this film" : `${Number(time.toPrecision(3))} ${view.template.tau === 1 ? "τ" : ""}`],
    ["black cells at the end", `${message.black} of ${view.rows * view.cols}`],
    ["products per cell", `${message.products} a step, ${message.once} once`],
    ["steps of the film", `${Number(view.film.step.toPrecision(2))}${view.template.tau === 1 ? " τ" : ""}, Runge–Kutta`],
    ["wrong cells of its rule", message.wrong === undefined ? "no rule" : message.wrong === 0 ? "none" : percent(message.wrong)],
  ];
  at("facts").replaceChildren(...list.map(([name, value]) => fact(name, value)));
  at("facts").title = message.why;
  at("nearest").replaceChildren(...(message.nearest || []).map((one) => neighbourhood(one.cells, `${one.margin > 0 ? "black" : "white"} by ${round(Math.abs(one.margin))}`)));
  const first = message.nearest && message.nearest[0];
  at("weak").textContent = first
    ? `${first.weakest} is the weakest number of B and z: ${first.share === null ? "no change" : percent(first.share)} off by itself flips the first of these. Gray cells do not matter.`
    : "Cells see each other's outputs here, so that no list of neighbourhoods decides.";
}

function neighbourhood(values, text) {
  const item = document.createElement("li"), box = document.createElement("div");
  box.className = "stamp";
  for (const value of values.flat()) {
    const cell = document.createElement("span");
    cell.className = value > 0 ? "black" : value < 0 ? "white" : "";
    box.append(cell);
  }
  item.append(box, text);
  return item;
}

function showCompared(message) {
  const names = [view.template.name, view.other.name], what = message.exhaustive ? "neighbourhoods" : "cells of random pictures";
  at("unlike").textContent = message.unlike
    ? `They answer ${message.unlike} of ${message.cases} ${what} differently; they differ in ${message.differs.join(", ")}.`
    : `They answer all ${message.cases} ${what} alike${message.differs.length ? `, and differ in ${message.differs.join(", ")}` : ""}.`;
  at("cases").replaceChildren(...message.inputs.map((values, n) => neighbourhood(values, `${names[message.answers[0][n] ? 0 : 1]} only`)));
  at("cases").title = "black in one of the two only";
}

// ---- pictures --------------------------------------------------------------------------------------

const clip = (x) => Math.min(1, Math.max(-1, x));

function paint(canvas, values, rows, cols) {
  const image = new ImageData(cols, rows);
  for (let n = 0; n < rows * cols; n += 1) {
    const gray = Math.round(127.5 * (1 - clip(values(n)))); // +1 is black
    image.data.set([gray, gray, gray, 255], 4 * n);
  }
  if (canvas.width !== cols || canvas.height !== rows) Object.assign(canvas, { width: cols, height: rows });
  canvas.getContext("2d").putImageData(image, 0, 0);
}

function outputs(film) { // at the time that is shown
  const first = frame(film) * film.rows * film.cols;
  return (n) => film.states[first + n];
}

function draw() {
  paint(at("picture"), (n) => view.picture[n] / 100, view.rows, view.cols);
  const film = view.film;
  if (!film) return;
  paint(at("film"), outputs(film), film.rows, film.cols);
  if (view.other && view.otherFilm) {
    paint(at("film1"), outputs(film), film.rows, film.cols);
    paint(at("film2"), outputs(view.otherFilm), view.otherFilm.rows, view.otherFilm.cols);
  }
  at("one").textContent = view.other ? view.template.name : "";
  at("two").textContent = view.other ? view.other.name : "";
  document.querySelector("#compare .pair").hidden = !view.other;
  at("scrub").value = view.moment;
  at("when").textContent = `t = ${film.times[frame(film)].toFixed(2)}${view.template.tau === 1 ? " τ" : ""}`;
  at("place").textContent = `row ${view.cell[0]}, column ${view.cell[1]}`;
  drawCourse();
  drawPhase();
  mark();
}

function mark() { // the chosen cell, in its own colour
  const canvas = at("film"), pen = canvas.getContext("2d");
  pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--now").trim();
  const [row, col] = view.cell, dark = outputs(view.film)(row * view.film.cols + col) > 0;
  pen.globalAlpha = dark ? 0.75 : 0.55;
  pen.fillRect(col, row, 1, 1);
  pen.globalAlpha = 1;
}

function cellOf(event, canvas, rows, cols) {
  const box = canvas.getBoundingClientRect();
  const inside = (share, count) => Math.min(count - 1, Math.max(0, Math.floor(share * count)));
  return [inside((event.clientY - box.top) / box.height, rows), inside((event.clientX - box.left) / box.width, cols)];
}

function shapes() { // a ring, triangles that point up and down, a bar, a step and a dot
  const n = view.rows, inside = (r, c) => {
    const y = (r + 0.5) / n, x = (c + 0.5) / n, ring = Math.max(Math.abs(y - 0.27), Math.abs(x - 0.27));
    const up = y > 0.56 && y < 0.9 && Math.abs(x - 0.27) < 0.62 * (y - 0.56);
    const down = y > 0.1 && y < 0.44 && Math.abs(x - 0.73) < 0.62 * (0.44 - y);
    const bar = y > 0.6 && y < 0.68 && x > 0.56 && x < 0.94, block = y > 0.76 && y < 0.9 && x > 0.56 && x < 0.76;
    return (ring < 0.18 && ring > 0.08) || up || down || bar || block || (r === Math.floor(0.84 * n) && c === Math.floor(0.88 * n));
  };
  view.picture = Int8Array.from({ length: n * n }, (_, k) => (inside(Math.floor(k / n), k % n) ? 100 : -100));
}

async function loaded(file) {
  let image;
  try { image = await createImageBitmap(file); } catch { say(`'${file.name}' is no picture that this browser reads.`); return; }
  keep();
  const paper = new OffscreenCanvas(view.cols, view.rows), pen = paper.getContext("2d");
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, view.cols, view.rows);
  pen.drawImage(image, 0, 0, view.cols, view.rows);
  const { data } = pen.getImageData(0, 0, view.cols, view.rows);
  view.picture = Int8Array.from({ length: view.rows * view.cols }, (_, n) => Math.round(100 - (200 / 255) * (0.299 * data[4 * n] + 0.587 * data[4 * n + 1] + 0.114 * data[4 * n + 2])));
  filled();
}

// ---- one cell --------------------------------------------------------------------------------------

function sheet(canvas, [x0, x1], [y0, y1], xs, ys) {
  const density = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  Object.assign(canvas, { width: width * density, height: height * density });
  const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  pen.scale(density, density);
  const left = 46, bottom = 34, top = 10, right = 10;
  const x = (v) => left + ((v - x0) / (x1 - x0)) * (width - left - right), y = (v) => height - bottom - ((v - y0) / (y1 - y0)) * (height - bottom - top);
  pen.font = "12px system-ui, sans-serif";
  pen.lineWidth = 1;
  pen.strokeStyle = colour("rule");
  pen.fillStyle = colour("soft");
  for (const v of ticks(x0, x1)) { line(pen, [[x(v), y(y0)], [x(v), y(y1)]]); pen.textAlign = "center"; pen.fillText(String(round(v)), x(v), height - bottom + 14); }
  for (const v of ticks(y0, y1)) { line(pen, [[x(x0), y(v)], [x(x1), y(v)]]); pen.textAlign = "right"; pen.fillText(String(round(v)), left - 5, y(v) + 4); }
  pen.textAlign = "center";
  pen.fillText(xs, (left + width - right) / 2, height - 4);
  pen.save();
  pen.translate(11, (height - bottom + top) / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText(ys, 0, 0);
  pen.restore();
  return { pen, x, y, colour };
}

function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const size = [1, 2, 5, 10].map((m) => m * power).find((m) => m >= rough), found = [];
  for (let v = Math.ceil(low / size) * size; v <= high + 1e-9; v += size) found.push(Math.abs(v) < 1e-12 ? 0 : v);
  return found;
}

function line(pen, points) {
  pen.beginPath();
  points.forEach(([a, b], n) => (n ? pen.lineTo(a, b) : pen.moveTo(a, b)));
  pen.stroke();
}

function dot(pen, a, b, fill, edge, size = 4.5) {
  pen.beginPath();
  pen.arc(a, b, size, 0, 7);
  pen.fillStyle = fill; pen.fill();
  pen.strokeStyle = edge; pen.lineWidth = 2; pen.stroke();
}

function state(film, moment, row, col) { return film.states[(moment * film.rows + row) * film.cols + col]; }

function drawCourse() {
  const film = view.film, [row, col] = view.cell;
  const course = film.times.map((t, k) => state(film, k, row, col)), reach = Math.max(1.2, ...course.map(Math.abs));
  view.course = course;
  const unit = view.template.tau === 1 ? "time, τ" : "time", { pen, x, y, colour } = sheet(at("course"), [0, film.end], [-reach, reach], unit, "state x");
  pen.setLineDash([4, 4]);
  pen.strokeStyle = colour("soft");
  for (const v of [-1, 1]) line(pen, [[x(0), y(v)], [x(film.end), y(v)]]);
  pen.setLineDash([]);
  pen.strokeStyle = colour("curve"); pen.lineWidth = 2;
  line(pen, course.map((v, k) => [x(film.times[k]), y(v)]));
  dot(pen, x(film.times[frame(film)]), y(course[frame(film)]), colour("now"), colour("now"), 3.5);
}

// what a cell sees beyond the rim, and within it
function seen(values, row, col, rim) {
  const { rows, cols } = view.film, inside = row >= 0 && col >= 0 && row < rows && col < cols;
  if (inside) return values(row * cols + col);
  if (rim === "periodic") return values(((row + rows) % rows) * cols + ((col + cols) % cols));
  if (rim === "zero-flux") return values(Math.min(rows - 1, Math.max(0, row)) * cols + Math.min(cols - 1, Math.max(0, col)));
  return rim;
}

// a cell τ dx/dt = −x + a f(x) + w, with its neighbours as they are at this time
function cellNow() {
  const t = view.template, [row, col] = view.cell, now = outputs(view.film);
  let w = t.z;
  for (let n = 0; n < 9; n += 1) {
    const i = Math.floor(n / 3), j = n % 3, r = row + i - 1, c = col + j - 1;
    if (n !== 4 && t.A[i][j]) w += t.A[i][j] * clip(seen((k) => clip(now(k)), r, c, t.boundary));
    if (t.B && t.B[i][j]) w += t.B[i][j] * seen((k) => view.picture[k] / 100, r, c, t.input_boundary);
  }
  const a = t.A[1][1], rate = (x) => (-x + a * clip(x) + w) / t.tau, rests = [];
  if (w - a <= -1) rests.push({ x: w - a, stable: w - a < -1 || a <= 1 });
  if (a !== 1 && Math.abs(w / (1 - a)) < 1) rests.push({ x: w / (1 - a), stable: a < 1 });
  if (w + a >= 1) rests.push({ x: w + a, stable: w + a > 1 || a <= 1 });
  return { a, w, rate, rests };
}

function drawPhase() {
  const { rate, rests } = cellNow(), now = view.course[frame(view.film)];
  view.rests = rests;
  const reach = 1.15 * Math.max(1.5, Math.abs(now), ...rests.map((r) => Math.abs(r.x)));
  const bends = [-reach, -1, 1, reach], high = 1.1 * Math.max(0.5, ...bends.map((v) => Math.abs(rate(v))));
  const { pen, x, y, colour } = sheet(at("phase"), [-reach, reach], [-high, high], "state x", view.template.tau === 1 ? "dx/dt, 1/τ" : "dx/dt");
  pen.strokeStyle = colour("soft");
  line(pen, [[x(-reach), y(0)], [x(reach), y(0)]]);
  pen.strokeStyle = colour("curve"); pen.lineWidth = 2;
  line(pen, bends.map((v) => [x(v), y(rate(v))]));
  for (const rest of rests) dot(pen, x(rest.x), y(0), rest.stable ? colour("ink") : colour("card"), colour("ink"));
  dot(pen, x(now), y(rate(now)), colour("now"), colour("now"), 3.5);
}

// ---- what the user does ------------------------------------------------------------------------------

function save(toml) {
  view.saved = toml;
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([toml], { type: "application/toml" })) });
  link.download = `${view.template.name.replace(/[^\w-]+/g, "_") || "template"}.toml`;
  link.click();
  say(`Saved as ${link.download}, among your downloads. To check it there: cnnum templates check ${link.download}`);
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

function moveTo(moment) {
  view.moment = Math.min(LAST, Math.max(0, moment));
  draw();
}

function play() {
  clearInterval(view.playing);
  if (at("play").textContent === "Stop") { at("play").textContent = "Play"; return; }
  at("play").textContent = "Stop";
  if (view.moment === LAST) moveTo(0);
  view.playing = setInterval(() => {
    moveTo(view.moment + 1);
    if (view.moment === LAST) { clearInterval(view.playing); at("play").textContent = "Play"; }
  }, 90);
}

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  draw();
}

function resized(side) {
  const old = view.picture, rows = view.rows;
  view.picture = Int8Array.from({ length: side * side }, (_, n) => old[Math.floor((Math.floor(n / side) * rows) / side) * rows + Math.floor(((n % side) * rows) / side)]);
  view.rows = view.cols = side;
}

function begin() {
  kernel("A");
  kernel("B");
  for (const name of ["z", "tau", "rim", "input_rim", "x0"]) at(name).dataset.number = name;
  for (const field of document.querySelectorAll("[data-number]")) {
    field.addEventListener("focus", () => { keep(); choose(field.dataset.number); });
    field.addEventListener("input", () => edited(field));
    field.addEventListener("blur", filled);
  }
  at("slider").addEventListener("pointerdown", keep);
  at("slider").addEventListener("input", () => { put(view.chosen, Number(at("slider").value)); filled(); });
  at("duration").addEventListener("input", () => { const v = Number(at("duration").value); if (v > 0) { keep(); view.template.duration = v; filled(); } });
  at("duration").addEventListener("blur", filled);
  for (const key of Object.keys(CHOICES)) at(CHOICES[key]).addEventListener("change", () => {
    keep();
    const kind = at(CHOICES[key]).value;
    view.template[key] = kind === "number" ? Number(at(FIELDS[key]).value) || (key === "duration" ? 10 : 0) : kind;
    filled();
  });
  at("name").addEventListener("input", () => { view.template.name = at("name").value; });
  for (let n = 0; n < 9; n += 1) {
    const cell = Object.assign(document.createElement("button"), { type: "button" });
    cell.setAttribute("aria-label", `${NEAR[n]}: any, black or white`);
    cell.addEventListener("click", () => {
      keep();
      const signs = cells(view.template.rule);
      signs[n] = { ".": "#", "#": "o", o: "." }[signs[n]];
      const text = signs.join("").replace(/(...)(...)(...)/, "$1/$2/$3");
      view.template.rule = text === ".../.../..." ? "" : `match("${text}")`;
      at("ruled").textContent = "";
      filled();
    });
    at("stencil").append(cell);
  }
  at("rule").addEventListener("change", () => { keep(); view.template.rule = at("rule").value.trim(); at("ruled").textContent = ""; filled(); });
  at("design").addEventListener("click", () => {
    if (!view.template.rule) { at("ruled").textContent = "Say first which cells stay black: click the stencil."; return; }
    at("ruled").textContent = "solving…";
    ask("design", () => ({ rule: view.template.rule, name: view.template.name }));
  });
  at("mismatch").addEventListener("input", () => { at("width").textContent = `${at("mismatch").value} %`; countFlips(); });
  at("bits").addEventListener("input", () => { at("wide").textContent = bits() || "all"; countFlips(); });
  at("library").addEventListener("change", () => ask("load", () => ({ name: at("library").value })));
  at("second").addEventListener("change", () => {
    if (at("second").value) ask("second", () => ({ do: "load", name: at("second").value }));
    else { view.other = view.otherFilm = null; at("unlike").textContent = ""; at("cases").replaceChildren(); draw(); }
  });
  at("keep").addEventListener("click", () => { at("second").value = ""; view.other = structuredClone(view.template); view.other.name += " (kept)"; changed(); });
  at("save").addEventListener("click", () => ask("save", () => ({ template: view.template })));
  at("undo").addEventListener("click", () => step(view.past, view.future));
  at("redo").addEventListener("click", () => step(view.future, view.past));
  at("scrub").addEventListener("input", () => moveTo(Number(at("scrub").value)));
  at("play").addEventListener("click", play);
  at("side").addEventListener("change", () => { keep(); resized(Number(at("side").value)); filled(); });
  at("clear").addEventListener("click", () => { keep(); view.picture.fill(-100); filled(); });
  at("shapes").addEventListener("click", () => { keep(); shapes(); filled(); });
  at("file").addEventListener("change", () => { if (at("file").files[0]) loaded(at("file").files[0]); at("file").value = ""; });
  at("live").addEventListener("change", () => { if (at("live").checked) ask("live", () => ({})); else { resized(Number(at("side").value)); filled(); } });
  let ink = 100, held = false, last = null;
  const stroke = (event) => {
    const [r, c] = cellOf(event, at("picture"), view.rows, view.cols), [r0, c0] = last || [r, c];
    const many = Math.max(1, Math.abs(r - r0), Math.abs(c - c0)); // a quick stroke leaves no gaps
    for (let n = 0; n <= many; n += 1) view.picture[Math.round(r0 + ((r - r0) * n) / many) * view.cols + Math.round(c0 + ((c - c0) * n) / many)] = ink;
    last = [r, c];
    draw();
    changed();
  };
  at("picture").addEventListener("pointerdown", (event) => {
    const [r, c] = cellOf(event, at("picture"), view.rows, view.cols);
    keep();
    held = true;
    at("live").checked = false; // what is drawn stays
    ink = view.picture[r * view.cols + c] > 0 ? -100 : 100;
    at("picture").setPointerCapture(event.pointerId);
    stroke(event);
  });
  at("picture").addEventListener("pointermove", (event) => { if (held) stroke(event); });
  for (const kind of ["pointerup", "pointercancel"]) at("picture").addEventListener(kind, () => { held = false; last = null; });
  at("film").addEventListener("pointerdown", (event) => { if (view.film) { view.cell = cellOf(event, at("film"), view.film.rows, view.film.cols); draw(); } });
  at("film").addEventListener("keydown", (event) => {
    const way = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (!way || !view.film) return;
    event.preventDefault();
    view.cell = [Math.min(view.rows - 1, Math.max(0, view.cell[0] + way[0])), Math.min(view.cols - 1, Math.max(0, view.cell[1] + way[1]))];
    draw();
  });
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    if (event.shiftKey) step(view.future, view.past);
    else step(view.past, view.future);
  });
  at("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme !== "dark"));
  const ramp = at("ramp"), pen = Object.assign(ramp, { width: 64, height: 1 }).getContext("2d");
  for (let n = 0; n < 64; n += 1) { const g = 255 - Math.round((255 * n) / 63); pen.fillStyle = `rgb(${g},${g},${g})`; pen.fillRect(n, 0, 1, 1); }
  const dark = matchMedia("(prefers-color-scheme: dark)");
  theme(dark.matches);
  dark.addEventListener("change", () => theme(dark.matches));
  addEventListener("resize", draw);
  connect();
}
begin();
