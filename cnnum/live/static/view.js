"use strict";
// The live page: pictures come as bytes (cnnum/live/hub.py), the rest as JSON.
// All that belongs to one skin lies in a record of `view.skins`; `view` holds the chosen one's.
const at = (id) => document.getElementById(id);
const MINUTE = 60, HEAD = 24;
const FLAG = { contact: 1, incipient: 2, gross: 4, twist: 8, bad: 16, dropped: 32, saturated: 64 };
const MARK = { contact: 1, bump: 2, edge: 4 };

const fresh = (hello) => ({ hello, past: [], whys: [], events: [], shown: null, held: null, newest: null, scale: 0, shearScale: 0, latency: 0, status: null });
const OF_SKIN = Object.keys(fresh(null));
const view = {
  ...fresh(null), skins: [], chosen: 0, paused: false,
  pictures: 0, counted: 0, drawn: null, wait: 500, dirty: true, lineDirty: true,
};
const skin = (n) => (n === view.chosen ? view : view.skins[n]);

function choose(n) {
  for (const key of OF_SKIN) { view.skins[view.chosen][key] = view[key]; view[key] = view.skins[n][key]; }
  view.chosen = n;
  at("name").textContent = named(view.hello);
  at("what").textContent = view.hello.drawn ? "draw on it" : `normal (${view.hello.unit})`;
  at("skins").querySelectorAll("button").forEach((tile, k) => tile.setAttribute("aria-pressed", String(k === n)));
  at("taxel").hidden = true;
  if (view.newest && !view.held) view.shown = view.newest;
  if (view.status) status(view.status);
  place();
  fit();
}

// ---- the line to the server -------------------------------------------------------------------

function connect() {
  const socket = new WebSocket(`ws://${location.host}/stream${location.search}`);
  socket.binaryType = "arraybuffer";
  view.socket = socket;
  socket.onopen = () => { view.wait = 500; };
  socket.onmessage = ({ data }) => (typeof data === "string" ? received(JSON.parse(data)) : picture(data));
  socket.onclose = () => {
    state("lost", "connection lost, trying again…");
    setTimeout(connect, view.wait);
    view.wait = Math.min(5000, 2 * view.wait);
  };
}

function send(wanted) {
  if (view.socket.readyState === WebSocket.OPEN) view.socket.send(JSON.stringify(wanted));
}

function state(kind, text) {
  at("link").dataset.state = kind;
  at("link").textContent = text;
}

function received(message) {
  if (message.kind === "hello") greet(message);
  else if (message.kind === "events") message.events.forEach((event) => note(event, message.skin));
  else if (message.kind === "status") statusOf(message);
  else if (message.kind === "why" && message.skin === view.chosen) reasons(message);
}

const named = (hello) => `${hello.name}, ${hello.shape[0]}×${hello.shape[1]} ${hello.drawn ? "cells" : "taxels"}`;

function greet({ skins }) {
  const names = (some) => some.map((one) => one.name).join("\n");
  const same = view.hello && names(view.skins.map((one) => one.hello)) === names(skins);
  if (!same) {
    view.chosen = 0;
    Object.assign(view, fresh(null));
  }
  view.skins = skins.map((hello, n) => (same ? Object.assign(view.skins[n], { hello, events: [] }) : fresh(hello)));
  const hello = view.hello = skins[view.chosen];
  state("on", hello.duration ? "recording" : "live");
  at("name").textContent = named(hello);
  at("record").hidden = !skins[0].records;
  tiles();
  at("what").textContent = hello.drawn ? "draw on it" : `normal (${hello.unit})`;
  document.body.classList.toggle("drawn", hello.drawn);
  readColours();
  at("speed").hidden = !hello.duration;
  at("live").hidden = Boolean(hello.duration);
  showProgram(hello.graph);
  view.whys = [];
  view.events = [];
  at("events").replaceChildren();
  const events = skins.flatMap((one, n) => one.events.slice(-200).map((event) => [event, n]));
  events.sort((a, b) => a[0].t - b[0].t).forEach(([event, n]) => note(event, n));
  fit();
}

function statusOf(s) {
  skin(s.skin).status = s;
  if (s.skin === view.chosen) status(s);
  if (s.skin !== 0) return;
  warn(s.warnings);
  view.recording = s.recording;
  at("record").textContent = s.recording ? "End recording" : "Record";
  at("record").setAttribute("aria-pressed", String(s.recording));
  at("recorded").textContent = s.recorded;
  at("pictures").textContent = `${view.pictures - view.counted > 0 ? 2 * (view.pictures - view.counted) : 0} /s`;
  view.counted = view.pictures;
}

function status(s) {
  at("rate").textContent = `${s.rate.toFixed(0)} Hz`;
  at("dropped").textContent = s.dropped;
  at("badCount").textContent = s.bad;
  at("gaps").textContent = s.gaps;
  at("latency").textContent = `${view.latency.toFixed(1)} ms`;
  if (s.ended) state("ended", s.ended);
}

function warn(sentences) {
  const list = at("warnings"), known = new Set([...list.children].map((item) => item.textContent));
  if (sentences.length === known.size && sentences.every((one) => known.has(one))) return;
  list.replaceChildren(...sentences.map((one) => Object.assign(document.createElement("li"), { textContent: one })));
  at("warned").hidden = !sentences.length;
  fit();
}

function picture(buffer) {
  if (!view.hello) return;
  if (new DataView(buffer).getUint32(0, true) === NODES) { nodesCame(buffer); return; }
  const head = new DataView(buffer), flags = head.getUint32(4, true), n = flags >>> 16, own = skin(n);
  if (!own) return;
  const [rows, cols] = own.hello.shape, taxels = rows * cols;
  const one = {
    number: head.getUint32(0, true), flags: flags & 0xffff, time: head.getFloat64(8, true),
    wait: head.getFloat32(16, true), load: head.getFloat32(20, true),
    loads: new Float32Array(buffer, HEAD, 3 * taxels),
    marks: new Uint8Array(buffer, HEAD + 12 * taxels, taxels),
  };
  own.latency = one.wait;
  const past = own.past;
  if (past.length && one.time < past[past.length - 1].time) past.length = 0; // a recording moved back
  past.push(one);
  if (!own.hello.duration) while (past.length && past[0].time < one.time - MINUTE) past.shift();
  else if (past.length > 60 * MINUTE) past.shift();
  own.newest = one;
  view.tilesDirty = true;
  if (n !== view.chosen) return;
  view.pictures += 1;
  document.body.dataset.newest = one.number;
  view.lineDirty = true;
  if (!view.held) show(one);
}

function show(one) {
  view.shown = one;
  if (view.held || view.whys.length) explain();
  view.dirty = true;
  document.body.dataset.number = one.number;
}

// ---- events ------------------------------------------------------------------------------------

const AXES = { 1: "from x to y", [-1]: "from y to x" };

function note(event, n = 0) {
  if (event.t === undefined) return;
  const own = skin(n);
  own.events.push(event);
  if (own.events.length > 5000) own.events.shift();
  const item = document.createElement("li");
  item.dataset.t = `${event.t.toFixed(3)} s`;
  item.dataset.kind = event.kind;
  const where = event.where ? ` at row ${event.where[0].toFixed(1)}, column ${event.where[1].toFixed(1)}` : "";
  const lost = event.kind === "gap" ? ` of ${event.seconds.toFixed(3)} s, ${event.missing} missing` : "";
  const way = event.direction === undefined ? "" : ` towards ${Math.round((180 * event.direction) / Math.PI)}°`;
  const sense = AXES[event.sense] && event.kind !== "grasp_squeeze" ? ` ${AXES[event.sense]}` : "";
  const said = made("span", "", ...(view.skins.length > 1 ? [made("b", "", own.hello.name), " "] : []));
  item.append(said);
  said.append(`${event.phase ? event.phase + " " : ""}${event.kind.replaceAll("_", " ")}${where}${way}${sense}${lost}`);
  at("events").prepend(item);
  while (at("events").children.length > 200) at("events").lastChild.remove();
  view.lineDirty = true;
}

// ---- why ---------------------------------------------------------------------------------------

const RATES = ["pattern_speed", "incoherent_shear", "trend", "load_rate", "ratio_rate", "turning"];
const PLACES = ["x", "y", "row", "column", "sense", "centred", "pivots"];
const HELD = { still: "slowest movement", trend: "load has changed", load_rate: "load changes", ratio_rate: "ratio changes" };
const LOW = 0.01, HIGH = 10; // of the level, at the ends of a gauge
const along = (margin) => 100 * Math.min(1, Math.max(0, Math.log(Math.max(margin, 1e-9) / LOW) / Math.log(HIGH / LOW)));

function reasons(why) {
  const whys = view.whys;
  if (whys.length && why.t < whys[whys.length - 1].t) whys.length = 0; // a recording moved back
  whys.push(why);
  while (whys.length > 10 * MINUTE) whys.shift();
  if (!view.held) explain();
}

function explain() {
  const at_time = view.held ? view.held.time : Infinity;
  let why = view.whys[0];
  for (const one of view.whys) if (one.t <= at_time) why = one;
  if (!why || why === view.why) return;
  view.why = why;
  if (at("why").children.length !== why.reports.length) at("why").replaceChildren(...why.reports.map(block));
  at("why").hidden = false;
  why.reports.forEach((report, n) => fill(at("why").children[n], report));
}

function made(name, style, ...children) {
  const item = Object.assign(document.createElement(name), { className: style });
  item.append(...children);
  return item;
}

function numbersOf(report) {
  return Object.entries(report.read_outs)
    .map(([name, value]) => [name.slice(report.kind.length + 1), value])
    .filter(([name]) => !PLACES.includes(name));
}

function block(report) {
  const gauge = made("div", "gauge", made("i", ""), made("b", ""));
  for (const margin of [0.1, 1, 10]) {
    const tick = made("small", "", margin === 1 ? "level" : `×${margin}`);
    tick.style.left = `${along(margin)}%`;
    gauge.append(tick);
  }
  gauge.children[1].style.left = `${along(1)}%`;
  gauge.setAttribute("role", "meter");
  const numbers = made("dl", "", ...numbersOf(report).map(([name]) => made("div", "",
    made("dt", "", name.replaceAll("_", " ")), made("dd", ""))));
  const parts = [made("h2", "", report.kind, made("span", "")), gauge, made("p", ""), numbers];
  const held = Object.keys(report.holds);
  if (held.length) {
    parts.push(made("div", "holds", ...held.map(() => made("i", ""))),
      made("ul", "key", ...held.map((name) => made("li", "", HELD[name] || name))));
  }
  const box = made("div", "", ...parts);
  box.dataset.kind = report.kind;
  return box;
}

function fill(box, report) {
  const { strength, level, margin } = report;
  box.classList.toggle("over", report.reported);
  box.querySelector("h2 span").textContent = `strength ${strength.toPrecision(2)}, level ${level.toPrecision(2)}, margin ${(margin ?? 0).toPrecision(2)}`;
  const gauge = box.querySelector(".gauge");
  gauge.firstChild.style.width = `${along(margin ?? 0)}%`;
  gauge.setAttribute("aria-label", `strength of ${report.kind} over its level`);
  gauge.setAttribute("aria-valuenow", (margin ?? 0).toPrecision(3));
  box.querySelector("p").textContent = report.said;
  const cells = box.querySelectorAll("dd");
  numbersOf(report).forEach(([name, value], n) => {
    cells[n].textContent = `${value.toFixed(2)}${RATES.includes(name) ? " /s" : ""}`;
  });
  const held = Object.values(report.holds), whole = held.reduce((sum, part) => sum + part, 0) || 1;
  box.querySelectorAll(".holds i").forEach((part, n) => { part.style.width = `${(100 * held[n]) / whole}%`; });
}

// ---- skins -------------------------------------------------------------------------------------

function tiles() {
  at("skins").hidden = view.skins.length < 2;
  at("skins").replaceChildren(...view.skins.map((one, n) => {
    const tile = made("button", "", document.createElement("canvas"), made("b", "", one.hello.name), made("span", "", ""), made("small", "", ""));
    tile.type = "button";
    tile.setAttribute("aria-pressed", String(n === view.chosen));
    [tile.firstChild.height, tile.firstChild.width] = one.hello.shape;
    tile.addEventListener("click", () => choose(n));
    return tile;
  }));
}

function stateOf(flags) {
  if (flags & FLAG.bad) return "bad";
  if (flags & FLAG.gross) return "gross";
  if (flags & FLAG.incipient) return "incipient";
  if (flags & FLAG.twist) return "twist";
  return flags & FLAG.contact ? "contact" : "";
}

const SAID = { gross: "slip", incipient: "incipient slip", bad: "bad frame" };

function drawTiles() {
  at("skins").querySelectorAll("button").forEach((tile, n) => {
    const own = skin(n), one = own.newest;
    if (!one) return;
    const [rows, cols] = own.hello.shape, pen = tile.firstChild.getContext("2d"), taxels = rows * cols;
    let most = 0;
    for (let k = 0; k < taxels; k += 1) most = Math.max(most, Math.abs(one.loads[2 * taxels + k]));
    own.top = Math.max(most, 0.999 * (own.top || 0));
    for (let k = 0; k < taxels; k += 1) {
      pen.fillStyle = colours.ramp[Math.round((255 * Math.abs(one.loads[2 * taxels + k])) / (own.top || 1))];
      pen.fillRect(k % cols, Math.floor(k / cols), 1, 1);
    }
    const now = stateOf(one.flags);
    tile.dataset.state = now;
    tile.children[2].textContent = SAID[now] || now || "–";
    tile.children[3].textContent = `${one.wait.toFixed(1)} ms`;
  });
}

// the plot of the taxel under the pointer, over the time that the time line shows
const TAXEL = [["normal", 2, "r3"], ["shear x", 0, "gross"], ["shear y", 1, "twist"]];

function hover(event) {
  if (!view.hello || view.hello.drawn || !view.shown) return;
  const [rows, cols] = view.hello.shape, box = at("taxels").getBoundingClientRect();
  const inside = (share, count) => Math.min(count - 1, Math.max(0, Math.floor(share * count)));
  view.taxel = [inside((event.clientY - box.top) / box.height, rows), inside((event.clientX - box.left) / box.width, cols)];
  at("taxel").hidden = false;
  drawTaxel();
}

function drawTaxel() {
  if (at("taxel").hidden || !view.taxel) return;
  const canvas = at("plot"), density = devicePixelRatio || 1, [row, col] = view.taxel, [rows, cols] = view.hello.shape;
  canvas.width = canvas.clientWidth * density; canvas.height = canvas.clientHeight * density;
  const pen = canvas.getContext("2d"), taxels = rows * cols, n = row * cols + col, past = view.past;
  let low = 0, high = 1e-12;
  for (const one of past) for (const [, place] of TAXEL) {
    const value = one.loads[place * taxels + n];
    low = Math.min(low, value); high = Math.max(high, value);
  }
  const from = past.length ? past[0].time : 0, to = past.length ? past[past.length - 1].time : 1;
  const x = (t) => ((t - from) / (to - from || 1)) * canvas.width;
  const y = (v) => 3 * density + (1 - (v - low) / (high - low)) * (canvas.height - 6 * density);
  pen.strokeStyle = colours.rule; pen.lineWidth = density;
  pen.beginPath(); pen.moveTo(0, y(0)); pen.lineTo(canvas.width, y(0)); pen.stroke();
  for (const [, place, colour] of TAXEL) {
    pen.strokeStyle = colours[colour]; pen.lineWidth = 1.5 * density; pen.beginPath();
    past.forEach((one, k) => (k ? pen.lineTo(x(one.time), y(one.loads[place * taxels + n])) : pen.moveTo(x(one.time), y(one.loads[place * taxels + n]))));
    pen.stroke();
  }
  const now = TAXEL.map(([name, place]) => `${name} ${view.shown.loads[place * taxels + n].toPrecision(3)}`);
  at("taxelSaid").textContent = `row ${row}, column ${col}, last ${(to - from).toFixed(0)} s (${view.hello.unit})`;
  [...at("taxelNow").children].forEach((item, k) => { item.textContent = now[k]; });
}
at("taxels").addEventListener("pointermove", hover);
at("taxels").addEventListener("pointerdown", hover);
at("taxels").addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") at("taxel").hidden = true; });

// ---- taxels ------------------------------------------------------------------------------------

const colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ink", "soft", "rule", "card", "contact", "incipient", "gross", "twist", "bump", "arrow", "r0", "r1", "r2", "r3", "r4"])
    colours[name] = style.getPropertyValue(`--${name}`).trim();
  const stops = ["r0", "r1", "r2", "r3", "r4"].map((n) => [1, 3, 5].map((i) => parseInt(colours[n].slice(i, i + 2), 16)));
  colours.ramp = Array.from({ length: 256 }, (_, i) => {
    const x = (i / 255) * 4, k = Math.min(3, Math.floor(x)), f = x - k;
    return `rgb(${stops[k].map((c, j) => Math.round(c + f * (stops[k + 1][j] - c))).join(",")})`;
  });
  if (view.hello && view.hello.drawn) colours.ramp = colours.ramp.map((_, i) => `rgb(${[255 - i, 255 - i, 255 - i].join()})`); // black is black on any paper
  for (const name of ["above", "below"]) colours[name] = style.getPropertyValue(`--${name}`).split(",").map(Number);
  const ramp = at("ramp"), pen = ramp.getContext("2d");
  ramp.width = 256; ramp.height = 1;
  colours.ramp.forEach((c, i) => { pen.fillStyle = c; pen.fillRect(i, 0, 1, 1); });
  view.dirty = view.lineDirty = true;
}

function fit() {
  if (!view.hello) return;
  const [rows, cols] = view.hello.shape, box = at("array").clientWidth - 26;
  const side = Math.max(4, Math.min(box / cols, (0.62 * innerHeight) / rows, 96));
  const density = devicePixelRatio || 1, canvas = at("taxels");
  canvas.style.width = `${Math.floor(side * cols)}px`;
  canvas.width = Math.floor(side * cols * density);
  canvas.height = Math.floor(side * rows * density);
  const line = at("line");
  line.width = Math.floor(line.clientWidth * density);
  line.height = Math.floor(line.clientHeight * density);
  view.dirty = view.lineDirty = true;
}

function rescale(one, taxels) {
  let normal = 0, shear = 0;
  for (let n = 0; n < taxels; n += 1) {
    normal = Math.max(normal, Math.abs(one.loads[2 * taxels + n]));
    shear = Math.max(shear, Math.hypot(one.loads[n], one.loads[taxels + n]));
  }
  if (view.hello.drawn) normal = view.scale = 1;
  // it rises at once and falls slowly, so that noise does not fill the range after a touch
  if (!view.held) {
    view.scale = Math.max(normal, 0.999 * view.scale);
    view.shearScale = Math.max(shear, 0.999 * view.shearScale);
  }
}

function drawTaxels() {
  const one = view.shown, [rows, cols] = view.hello.shape, taxels = rows * cols;
  const canvas = at("taxels"), pen = canvas.getContext("2d");
  const w = canvas.width / cols, h = canvas.height / rows;
  rescale(one, taxels);
  const scale = view.scale || 1, shear = view.shearScale || 1;
  for (let n = 0; n < taxels; n += 1) {
    const level = Math.min(1, Math.abs(one.loads[2 * taxels + n]) / scale);
    pen.fillStyle = colours.ramp[Math.round(255 * level)];
    pen.fillRect(Math.floor((n % cols) * w), Math.floor(Math.floor(n / cols) * h), Math.ceil(w), Math.ceil(h));
  }
  drawBumps(pen, one, rows, cols, w, h);
  drawOutline(pen, one, rows, cols, w, h);
  drawArrows(pen, one, taxels, cols, w, h, shear, scale);
  at("low").textContent = view.hello.drawn ? "white" : "0";
  at("high").textContent = view.hello.drawn ? "black" : scale.toPrecision(3);
}

function drawArrows(pen, one, taxels, cols, w, h, shear, scale) {
  pen.lineWidth = Math.max(1.5, w / 26);
  for (let n = 0; n < taxels; n += 1) {
    const x = one.loads[n], y = one.loads[taxels + n], size = Math.hypot(x, y);
    if (size < 0.08 * shear) continue;
    const long = (0.46 * w * size) / shear, cx = ((n % cols) + 0.5) * w, cy = (Math.floor(n / cols) + 0.5) * h;
    const dx = (long * x) / size, dy = (long * y) / size, tip = 0.28 * long;
    const dark = Math.abs(one.loads[2 * taxels + n]) / scale > 0.5;
    pen.strokeStyle = dark ? colours.card : colours.arrow;
    pen.beginPath();
    pen.moveTo(cx - dx, cy - dy); pen.lineTo(cx + dx, cy + dy);
    const a = Math.atan2(dy, dx);
    pen.moveTo(cx + dx - tip * 2 * Math.cos(a - 0.5), cy + dy - tip * 2 * Math.sin(a - 0.5));
    pen.lineTo(cx + dx, cy + dy);
    pen.lineTo(cx + dx - tip * 2 * Math.cos(a + 0.5), cy + dy - tip * 2 * Math.sin(a + 0.5));
    pen.stroke();
  }
}

function drawBumps(pen, one, rows, cols, w, h) {
  pen.strokeStyle = colours.bump;
  pen.globalAlpha = 0.55;
  pen.lineWidth = Math.max(1, w / 40);
  one.marks.forEach((mark, n) => {
    if (!(mark & MARK.bump)) return;
    pen.beginPath();
    pen.arc(((n % cols) + 0.5) * w, (Math.floor(n / cols) + 0.5) * h, 0.4 * Math.min(w, h), 0, 7);
    pen.stroke();
  });
  pen.globalAlpha = 1;
}

function drawOutline(pen, one, rows, cols, w, h) {
  const inside = (r, c) => r >= 0 && c >= 0 && r < rows && c < cols && one.marks[r * cols + c] & MARK.contact;
  const flags = one.flags;
  pen.strokeStyle = flags & FLAG.gross ? colours.gross : flags & FLAG.incipient ? colours.incipient : colours.contact;
  pen.lineWidth = Math.max(2, w / 14);
  pen.beginPath();
  for (let r = 0; r < rows; r += 1)
    for (let c = 0; c < cols; c += 1) {
      if (!inside(r, c)) continue;
      const x = c * w, y = r * h;
      if (!inside(r - 1, c)) { pen.moveTo(x, y); pen.lineTo(x + w, y); }
      if (!inside(r + 1, c)) { pen.moveTo(x, y + h); pen.lineTo(x + w, y + h); }
      if (!inside(r, c - 1)) { pen.moveTo(x, y); pen.lineTo(x, y + h); }
      if (!inside(r, c + 1)) { pen.moveTo(x + w, y); pen.lineTo(x + w, y + h); }
    }
  pen.stroke();
}

function drawStates() {
  const { flags, time, load } = view.shown, slipping = flags & (FLAG.gross | FLAG.incipient);
  const on = {
    contact: flags & FLAG.contact, stick: flags & FLAG.contact && !slipping,
    incipient: flags & FLAG.incipient && !(flags & FLAG.gross), gross: flags & FLAG.gross,
    twist: flags & FLAG.twist, bad: flags & FLAG.bad,
  };
  for (const [id, lit] of Object.entries(on)) at(id).classList.toggle("on", Boolean(lit));
  at("time").textContent = `${time.toFixed(2)} s`;
  at("load").textContent = Math.abs(load) >= 1000 ? load.toFixed(0) : load.toPrecision(3);
}

// ---- time line ---------------------------------------------------------------------------------

function span() {
  if (view.hello && view.hello.duration) return [0, view.hello.duration];
  const last = view.newest ? view.newest.time : 0;
  return [last - MINUTE, last];
}

function drawLine() {
  const canvas = at("line"), pen = canvas.getContext("2d"), [from, to] = span();
  const x = (t) => ((t - from) / (to - from || 1)) * canvas.width, density = devicePixelRatio || 1;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  let top = 1e-12;
  for (const one of view.past) top = Math.max(top, Math.abs(one.load));
  const floor = canvas.height - 16 * density;
  pen.strokeStyle = colours.r3; pen.lineWidth = 1.5 * density; pen.beginPath();
  view.past.forEach((one, n) => {
    const y = floor - (Math.abs(one.load) / top) * (floor - 6 * density);
    if (n) pen.lineTo(x(one.time), y); else pen.moveTo(x(one.time), y);
  });
  pen.stroke();
  const tint = { contact: colours.contact, release: colours.soft, slip: colours.gross, twist: colours.twist };
  for (const event of view.events) {
    if (event.t < from || event.t > to) continue;
    pen.fillStyle = event.phase === "incipient" ? colours.incipient : tint[event.kind] || colours.ink;
    pen.fillRect(x(event.t) - density, 0, 2 * density, floor);
  }
  pen.fillStyle = colours.soft;
  pen.font = `${11 * density}px system-ui, sans-serif`;
  const live = !view.hello.duration;
  for (let k = 0; k <= 4; k += 1) {
    const t = from + ((to - from) * k) / 4;
    pen.textAlign = k === 0 ? "left" : k === 4 ? "right" : "center";
    pen.fillText(live ? (k === 4 ? "now" : `−${MINUTE - 15 * k} s`) : `${t.toFixed(1)} s`, x(t), canvas.height - 3 * density);
  }
  if (view.shown) {
    pen.fillStyle = colours.ink;
    pen.fillRect(x(view.shown.time) - density, 0, 2 * density, floor);
  }
}

function nearest(time) {
  const past = view.past;
  let low = 0, high = past.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (past[middle].time < time) low = middle + 1; else high = middle;
  }
  return past[low];
}

function scrubTo(share) {
  const [from, to] = span(), time = from + share * (to - from);
  if (view.hello.duration) {
    send({ seek: time });
    at("place").textContent = `${time.toFixed(2)} s of ${to.toFixed(2)} s`;
    return;
  }
  if (!view.past.length) return;
  view.held = share >= 0.999 ? null : nearest(time);
  show(view.held || view.newest);
  place();
}

function place() {
  const back = view.held && view.newest ? view.newest.time - view.held.time : 0;
  at("place").textContent = view.held ? `${back.toFixed(1)} s ago` : "the last minute";
  document.body.dataset.held = view.held ? "yes" : "no";
  at("pause").textContent = view.held || view.paused ? "Go on" : "Pause";
  at("pause").setAttribute("aria-pressed", String(Boolean(view.held || view.paused)));
}

// ---- controls ----------------------------------------------------------------------------------

at("scrub").addEventListener("input", (e) => scrubTo(e.target.value / 1000));
at("line").addEventListener("pointerdown", (e) => { e.target.setPointerCapture(e.pointerId); drag(e); });
at("line").addEventListener("pointermove", (e) => { if (e.buttons) drag(e); });
function drag(e) {
  const box = at("line").getBoundingClientRect(), share = Math.min(1, Math.max(0, (e.clientX - box.left) / box.width));
  at("scrub").value = 1000 * share;
  scrubTo(share);
}
at("live").addEventListener("click", () => {
  view.held = null; at("scrub").value = 1000;
  if (view.newest) show(view.newest);
  place();
});
at("pause").addEventListener("click", () => {
  if (view.hello && view.hello.duration) {
    view.paused = !view.paused;
    send({ paused: view.paused });
  } else if (view.held) {
    view.held = null; at("scrub").value = 1000;
  } else if (view.newest) {
    view.held = view.newest;
  }
  place();
});
at("tare").addEventListener("click", () => send({ tare: true }));
at("record").addEventListener("click", () => send({ record: !view.recording }));
at("speed").addEventListener("change", (e) => send({ speed: Number(e.target.value) }));
at("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
function theme(name) {
  document.documentElement.dataset.theme = name;
  readColours();
  drawGraph();
}
addEventListener("resize", fit);
addEventListener("keydown", (e) => {
  if (e.target.tagName === "BODY" && e.key === " ") { e.preventDefault(); at("pause").click(); }
  if (e.target.tagName === "BODY" && e.key === "t" && !e.ctrlKey && !e.metaKey) at("tare").click();
});

// ---- a picture that is drawn for a program --------------------------------------------------------

function sendPicture(cells) { // from −100, white, to 100
  view.drawn = cells;
  send({ picture: btoa(String.fromCharCode(...new Uint8Array(cells.buffer))) });
}

const pictureNow = () => Int8Array.from(view.drawn || view.newest.loads.slice(-view.newest.marks.length).map((v) => 200 * v - 100));

let ink = null, last = null;
function stroke(event) {
  const [rows, cols] = view.hello.shape, box = at("taxels").getBoundingClientRect();
  const inside = (share, count) => Math.min(count - 1, Math.max(0, Math.floor(share * count)));
  const r = inside((event.clientY - box.top) / box.height, rows), c = inside((event.clientX - box.left) / box.width, cols);
  const cells = pictureNow(), [r0, c0] = last || [r, c], many = Math.max(1, Math.abs(r - r0), Math.abs(c - c0));
  ink ??= cells[r * cols + c] > 0 ? -100 : 100;
  for (let n = 0; n <= many; n += 1) cells[Math.round(r0 + ((r - r0) * n) / many) * cols + Math.round(c0 + ((c - c0) * n) / many)] = ink;
  last = [r, c];
  sendPicture(cells);
}
at("taxels").addEventListener("pointerdown", (event) => {
  if (!view.hello || !view.hello.drawn || !view.newest) return;
  at("taxels").setPointerCapture(event.pointerId);
  stroke(event);
});
at("taxels").addEventListener("pointermove", (event) => { if (ink !== null) stroke(event); });
for (const kind of ["pointerup", "pointercancel"]) at("taxels").addEventListener(kind, () => { ink = last = null; });
at("clear").addEventListener("click", () => sendPicture(pictureNow().fill(-100)));
at("again").addEventListener("click", () => { // such as the next generation of a game
  const values = program.values.get(program.selected.number);
  if (values && values.length === view.newest.marks.length) sendPicture(Int8Array.from(values, (v) => (v > 0 ? 100 : -100)));
});

function draw() {
  if (view.dirty && view.shown) {
    view.dirty = false;
    drawTaxels();
    drawStates();
    if (view.hello.duration) at("scrub").value = (1000 * (view.shown.time - 0)) / view.hello.duration;
  }
  if (view.lineDirty && view.hello) { view.lineDirty = false; drawLine(); drawTaxel(); }
  if (view.tilesDirty && view.skins.length > 1) { view.tilesDirty = false; drawTiles(); }
  requestAnimationFrame(draw);
}

addEventListener("load", () => {
  const dark = matchMedia("(prefers-color-scheme: dark)"), follow = () => theme(dark.matches ? "dark" : "light");
  follow();
  dark.addEventListener("change", follow);
  connect();
  draw();
});
