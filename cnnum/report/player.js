(() => {
  "use strict";
  const player = document.getElementById("player");
  const canvas = player.querySelector("canvas");
  const pen = canvas.getContext("2d");
  const data = JSON.parse(document.getElementById("data").textContent);
  const [rows, cols] = data.scene.shape;
  const every = data.maps.every;
  const normalTop = Number(canvas.dataset.normal);
  const shearTop = Number(canvas.dataset.shear);
  const rate = data.scene.rate_hz || 50;

  function unpack(map) {
    const bytes = Uint8Array.from(atob(map.data), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    const values = new Float32Array(bytes.length / 2);
    for (let i = 0; i < values.length; i++) {
      const whole = view.getInt16(2 * i, true);
      values[i] = whole === map.missing ? NaN : whole * map.scale;
    }
    return values;
  }

  const values = unpack(data.maps.values);
  const channels = data.scene.channels;
  const count = data.maps.values.shape[0];
  const place = (name) => channels.indexOf(name);
  const [ix, iy, iz] = ["shear_x", "shear_y", "normal"].map(place);
  const detected = [["contact_map", []], ["stick_map", [0.22, 0.16]]]
    .filter(([name]) => data.maps[name]).map(([name, dash]) => [unpack(data.maps[name]), dash]);
  let colours = [];
  let ink = "";
  let card = "";

  function readColours() {
    colours = [...document.querySelectorAll(".key rect")].map((r) => getComputedStyle(r).fill);
    const style = getComputedStyle(document.documentElement);
    ink = style.getPropertyValue("--ink");
    card = style.getPropertyValue("--card");
  }

  const at = (name, n) => (data.truth[name] ? data.truth[name][n] : null);
  const value = (k, r, c, i) => values[((k * rows + r) * cols + c) * channels.length + i];

  function heat(k, side) {
    const half = (colours.length - 1) / 2;
    for (let r = 0; r < rows; r++) for (let c = 0; c < cols; c++) {
      const v = iz < 0 ? 0 : data.scene.push * value(k, r, c, iz);
      const share = Math.max(-1, Math.min(1, v / normalTop));
      pen.fillStyle = Number.isNaN(v) ? card : colours[Math.round(half * (share + 1))];
      pen.fillRect(Math.floor(c * side), Math.floor(r * side), Math.ceil(side), Math.ceil(side));
    }
  }

  function arrows(k, side) {
    pen.strokeStyle = ink;
    pen.lineWidth = side * 0.06;
    pen.lineCap = pen.lineJoin = "round";
    pen.beginPath();
    for (let r = 0; r < rows; r++) for (let c = 0; c < cols; c++) {
      const x = (c + 0.5) * side, y = (r + 0.5) * side;
      const unit = data.scene.push * side / shearTop;
      const dx = unit * value(k, r, c, ix), dy = unit * value(k, r, c, iy);
      const long = Math.hypot(dx, dy);
      if (!(long > 0.12 * side)) continue;
      const head = Math.min(0.24 * side, 0.45 * long) / long;
      pen.moveTo(x, y);
      pen.lineTo(x + dx, y + dy);
      pen.lineTo(x + dx + head * (-0.87 * dx - 0.5 * dy), y + dy + head * (-0.87 * dy + 0.5 * dx));
      pen.moveTo(x + dx, y + dy);
      pen.lineTo(x + dx + head * (-0.87 * dx + 0.5 * dy), y + dy + head * (-0.87 * dy - 0.5 * dx));
    }
    pen.stroke();
  }

  function cells(k, side) {
    pen.strokeStyle = ink;
    pen.lineWidth = side * 0.05;
    for (const [map, dash] of detected) {
      const held = (r, c) => r >= 0 && c >= 0 && r < rows && c < cols && map[(k * rows + r) * cols + c] > 0.5;
      pen.setLineDash(dash.map((part) => part * side));
      pen.beginPath();
      for (let r = 0; r <= rows; r++) for (let c = 0; c <= cols; c++) {
        if (held(r, c) !== held(r - 1, c)) { pen.moveTo(c * side, r * side); pen.lineTo((c + 1) * side, r * side); }
        if (held(r, c) !== held(r, c - 1)) { pen.moveTo(c * side, r * side); pen.lineTo(c * side, (r + 1) * side); }
      }
      pen.stroke();
    }
    pen.setLineDash([]);
  }

  function circles(n, side) {
    const pitch = data.scene.pitch_m;
    if (!pitch || at("x", n) === null) return;
    const x = side * (cols / 2 + at("x", n) / pitch), y = side * (rows / 2 + at("y", n) / pitch);
    for (const [name, dash] of [["contact_radius", []], ["stick_radius", [0.22 * side, 0.16 * side]]]) {
      const radius = side * at(name, n) / pitch;
      if (!(radius > 0.03 * side)) continue;
      for (const [colour, width, dashes] of [[card, 0.17, []], [ink, 0.08, dash]]) {
        pen.beginPath();
        pen.setLineDash(dashes);
        pen.strokeStyle = colour;
        pen.lineWidth = width * side;
        pen.arc(x, y, radius, 0, 2 * Math.PI);
        pen.stroke();
      }
      pen.setLineDash([]);
    }
  }

  const slider = player.querySelector("input");
  const button = player.querySelector("button");
  const speed = player.querySelector("select");
  const facts = player.querySelector("dl");
  slider.max = count - 1;

  function described(n) {
    const rowsOf = [["frame", `${n} of ${data.scene.frames - 1}`], ["time", `${data.t[n].toFixed(3)} s`]];
    const load = at("normal_force", n), torque = at("torque", n), a = at("contact_radius", n), c = at("stick_radius", n);
    if (load !== null) rowsOf.push(["normal load P", `${load.toFixed(2)} N`]);
    if (at("shear_x", n) !== null) rowsOf.push(["shear force Q", `${Math.hypot(at("shear_x", n), at("shear_y", n)).toFixed(2)} N`]);
    if (torque !== null) rowsOf.push(["torque T", `${(1e3 * torque).toFixed(2)} mN m`]);
    if (a !== null && c !== null) rowsOf.push(["stick / contact radius", a > 0 ? `${(1e3 * c).toFixed(2)} / ${(1e3 * a).toFixed(2)} mm` : "no contact"]);
    const names = { contact: "contact", incipient: "incipient slip", slip: "gross slip", twist_slip: "twist" };
    const flags = { contact: "contact", incipient_slip: "incipient slip", gross_slip: "gross slip", twist: "twist" };
    const on = (table, label) => Object.keys(label).filter((k) => table[k] && table[k][n] > 0).map((k) => label[k]).join(", ") || "none";
    if (Object.keys(data.truth).length) rowsOf.push(["truth", on(data.truth, names)]);
    rowsOf.push(["program", on(data.outputs, flags)]);
    return rowsOf;
  }

  function show() {
    const k = Number(slider.value), n = Math.min(k * every, data.scene.frames - 1);
    const side = canvas.width / cols;
    heat(k, side);
    cells(k, side);
    circles(n, side);
    if (ix >= 0 && iy >= 0) arrows(k, side);
    facts.replaceChildren(...described(n).flatMap(([name, text]) => {
      const dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = name;
      dd.textContent = text;
      return [dt, dd];
    }));
    slider.setAttribute("aria-valuetext", `${data.t[n].toFixed(2)} s`);
  }

  let playing = false, from = 0, begun = 0;
  function play(now) {
    if (!playing) return;
    const k = from + Math.floor((now - begun) / 1000 * rate * Number(speed.value) / every);
    slider.value = Math.min(k, count - 1);
    show();
    if (k >= count - 1) stop();
    else requestAnimationFrame(play);
  }
  function stop() {
    playing = false;
    button.textContent = "Play";
  }
  function start() {
    playing = true;
    button.textContent = "Pause";
    from = Number(slider.value) >= count - 1 ? 0 : Number(slider.value);
    begun = performance.now();
    requestAnimationFrame(play);
  }

  button.addEventListener("click", () => (playing ? stop() : start()));
  speed.addEventListener("change", () => playing && start());
  slider.addEventListener("input", () => { stop(); show(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); show(); });
  slider.value = Math.min(count - 1, Math.round(Number(canvas.dataset.first) / every));
  readColours();
  player.hidden = false;
  show();
})();
