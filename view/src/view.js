// Tangled from chapters/view.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

const by = (id) => document.getElementById(id);
const [canvas, form] = [by("image"), by("settings")];

// Vectors are arrays of three numbers.
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => a.map((x) => s * x);
const unit = (a) => scaled(a, 1 / Math.hypot(...a));
const turned = (v, axis, angle) => add(add(scaled(v, Math.cos(angle)),
  cross(axis, v), Math.sin(angle)), axis, dot(axis, v) * (1 - Math.cos(angle)));

// The state that the server has sent, and the camera as it is moved here.
let state = {}, view = null, image = null, sent = 0, grip = null;
let exposure = null, stops = null, pivot = null, showsErrors = false;

const post = (name, body) => fetch(name, {
  method: "POST", body: JSON.stringify(body) });

async function listen() {
  const reader = (await fetch("stream")).body.getReader();
  let held = new Uint8Array(0);
  const take = async (length) => {
    const parts = [held];
    for (let has = held.length; has < length;) {
      const { value, done } = await reader.read();
      if (done) throw Error("ptview has ended");
      parts.push(value);
      has += value.length;
    }
    if (parts.length > 1) {
      held = new Uint8Array(await new Blob(parts).arrayBuffer());
    }
    const taken = held.slice(0, length);
    held = held.subarray(length);
    return taken;
  };
  for (;;) {
    const [text, bytes] = new Uint32Array((await take(8)).buffer);
    const about = JSON.parse(new TextDecoder().decode(await take(text)));
    const numbers = new Float32Array((await take(bytes)).buffer);
    if (about.state) hear(about.state);
    if (about.size) show({ ...about, numbers });
  }
}

function hear(told) {
  state = told;
  by("fault").textContent = state.fault ?? "";
  if (!state.settings) return;
  const { settings } = state;
  const isOurs = view?.words
    && Object.entries(view.words).every(([name, s]) => settings[name] === s);
  if (!view || (state.number >= sent && !view.isNew && !isOurs)) {
    const vector = (name) => settings[name].split(",").map(Number);
    view = { position: vector("-p"), target: vector("-t"), up: vector("-u") };
  }
  view.fov = Number(settings["-F"]);
  exposure ??= String(state.exposure?.stops ?? "auto");
  document.title = `${state.scene} - ptview`;
  document.querySelector("h1").textContent = state.scene;
  const up = state.zenith.findIndex((x) => Math.abs(x) > 0.5);
  const shown = { ...asked(), ...state.fields, "-u": "xyz"[up] };
  for (const field of form.elements) {
    if (field !== document.activeElement) field.value = shown[field.name] ?? "";
  }
  by("command").textContent = command();
  tellRender(state.render);
}

function tellRender(render) {
  by("render").textContent = render?.runs ? "Stop" : "Render";
  const { spp, rmse, seconds } = render?.last ?? {};
  const link = (name) => Object.assign(document.createElement("a"),
    { href: name, textContent: name, download: name });
  if (render?.files && !render.runs && render.fault === null) {
    if (by("files").childElementCount) return;
    const links = render.files.flatMap((name) => [" ", link(name)]);
    by("files").replaceChildren("rendered:", ...links);
  } else {
    by("files").textContent = !render ? "" : render.fault
      ?? (spp ? `rendering: ${spp} spp, rmse ${rmse?.toPrecision(2)}, `
        + `${seconds.toFixed(0)} s` : "rendering");
  }
}

// The requested options, and the command with them.
const asked = () => ({ ...state.error && { "--error": state.error },
  "--exposure": exposure, ...state.settings });

const word = (text) => /^[\w.,/:=+%@-]+$/.test(text)
  ? text : `'${text.replaceAll("'", "'\\''")}'`;

function command() {
  const output = state.scene.replace(/^.*\//, "").replace(/\.obj.*$/, "");
  const options = Object.entries(asked()).map(([name, value]) =>
    `${name}${name.startsWith("--") ? "=" : " "}${word(value)}`);
  return ["pt", word(state.scene), ...state.words.map(word), ...options,
    "-o", word(`${output}.exr`), "-o", word(`${output}.png`)].join(" ");
}

async function change(set) {
  sent = Infinity;
  sent = await (await post("set", { set })).json();
  hear(state);
}

function show(got) {
  image = got;
  const { spp, method, done, moves, curve = [] } = got;
  if (moves) {
    by("pixel").textContent = "\u00a0";
    by("status").textContent = "a glance";
    return paint();
  }
  let text = `${spp} spp by ${method}`;
  if (curve.length) {
    draw(curve);
    const [seconds, error] = curve.at(-1);
    const left = seconds * ((error / 0.01) ** 2 - 1);
    text += `, error ${(100 * error).toPrecision(2)} %`;
    if (left > 0 && !done) text += `, 1 % in ${+left.toPrecision(2)} s`;
  }
  by("status").textContent = done ? `${text}: done` : text;
  paint();
}

function paint() {
  const { size: [width, height], moves } = image;
  const fixed = Number(exposure ?? "auto");
  const wanted = Number.isFinite(fixed) ? fixed
    : moves ? stops ?? image.stops : image.stops;
  stops ??= wanted;
  stops += (Math.abs(wanted - stops) < 0.02 ? 1 : 0.3) * (wanted - stops);
  if (stops !== wanted) requestAnimationFrame(paint);
  Object.assign(canvas, { width, height });
  const [columns, rows] = state.settings["-d"].split("x");
  canvas.style.aspectRatio = columns / rows;
  canvas.style.maxWidth = `${(85 * columns) / rows}vh`;
  const picture = new ImageData(width, height);
  const bytes = new Uint32Array(picture.data.buffer);
  for (let i = 0; i < bytes.length; i++) {
    bytes[i] = 0xff000000 | 0x10101 * Math.round(255 * level(i));
  }
  canvas.getContext("2d").putImageData(picture, 0, 0);
}

// The brightness of a pixel, by the curve of sRGB; or its relative error.
function level(i) {
  const { numbers, size: [width, height], moves } = image;
  const area = width * height;
  if (showsErrors && !moves) {
    const part = numbers[2 * area + i] / numbers[area + i];
    return Math.min(1, Math.max(0, Math.log10(part) / 4 + 1));
  }
  const light = Math.min(1, Math.max(0, numbers[i] * 2 ** stops));
  return light < 0.0031308 ? 12.92 * light
    : 1.055 * light ** (1 / 2.4) - 0.055;
}

// The curve of error against time, on logarithmic axes.
function draw(curve) {
  const log = (value) => Math.log10(value || 1e-3);
  const range = [0, 1].map((i) => {
    const all = curve.map((point) => log(point[i]));
    const low = Math.floor(Math.min(...all));
    return [low, Math.max(low + 1, Math.ceil(Math.max(...all)))];
  });
  const part = (v, [low, high]) => (log(v) - low) / (high - low);
  const x = (v) => 34 + 250 * part(v, range[0]);
  const y = (v) => 130 - 120 * part(v, range[1]);
  const ticks = ([low, high]) => Array.from({ length: high - low + 1 },
    (_, k) => 10 ** (low + k));
  const lines = [
    ...ticks(range[0]).map((v) => `<line x1="${x(v)}" x2="${x(v)}" y1="8"
      y2="130"/><text x="${x(v) - 10}" y="144">${+v.toPrecision(1)} s</text>`),
    ...ticks(range[1]).map((v) => `<line x1="34" x2="284" y1="${y(v)}"
      y2="${y(v)}"/><text x="2" y="${y(v) + 4}">${+(100 * v).toPrecision(1)} %
      </text>`)];
  const points = curve.map(([t, e]) => `${x(t)},${y(e)}`);
  const [cx, cy] = points.at(-1).split(",");
  by("curve").innerHTML = `${lines.join("")}<path d="M${points.join("L")}"/>
    <circle cx="${cx}" cy="${cy}" r="3"/>`;
}

let moves = false;

async function send() {
  if (moves) return;
  for (moves = true; view.isNew;) {
    view.isNew = false;
    const { position, target, up } = view;
    const size = Math.log10(Math.hypot(...add(target, position, -1)));
    const digits = Math.min(20, Math.max(0, 4 - Math.floor(size)));
    const typed = (v, n) => v.map((x) => +x.toFixed(n)).join();
    view.words = { "-p": typed(position, digits),
      "-t": typed(target, digits), "-u": typed(up, 6) };
    await change({ ...view.words, "--view": null,
      "--zenith": state.settings["--zenith"] ?? state.zenith.join() });
  }
  moves = false;
}

function put(position, target) {
  const ahead = unit(add(target, position, -1));
  const isSteep = Math.abs(dot(ahead, state.zenith)) > 0.9999;
  const up = isSteep ? view.up : state.zenith;
  view = { ...view, position, target, up, isNew: true };
  send();
}

// The directions to the right, ahead and up, and the way to the target.
function axes() {
  const way = add(view.target, view.position, -1);
  const ahead = unit(way);
  const right = unit(cross(ahead, view.up));
  return { way, ahead, right, up: cross(right, ahead) };
}

function turn(about, [yaw, pitch]) {
  const { ahead, right } = axes();
  const now = Math.asin(Math.max(-1, Math.min(1, dot(ahead, state.zenith))));
  const angle = Math.max(-1.55, Math.min(1.55, now + pitch)) - now;
  const place = (p) => add(about, turned(turned(add(p, about, -1),
    right, angle), state.zenith, yaw));
  put(place(view.position), place(view.target));
}

function walk(steps, size) {
  const { ahead, right, up } = axes();
  const step = [right, ahead, up].reduce((sum, axis, i) =>
    add(sum, axis, size * steps[i]), [0, 0, 0]);
  put(add(view.position, step), add(view.target, step));
}

const place = (event) => {
  const box = canvas.getBoundingClientRect();
  const part = (x, length) => Math.min(1 - 1e-9, Math.max(0, x / length));
  return { x: part(event.clientX - box.left, box.width),
    y: part(event.clientY - box.top, box.height) };
};
const pick = async (event) => (await post("pick", place(event))).json();

canvas.addEventListener("pointerdown", async (event) => {
  canvas.setPointerCapture(event.pointerId);
  grip = event;
  pivot = view.target;
  pivot = (await pick(event))?.point ?? pivot;
});
canvas.addEventListener("pointermove", (event) => {
  if (!event.buttons) return point(event);
  if (event.pointerId !== grip?.pointerId) return;
  const dx = event.clientX - grip.clientX, dy = event.clientY - grip.clientY;
  grip = event;
  if (!event.shiftKey) return turn(pivot, [-0.006 * dx, -0.006 * dy]);
  const depth = dot(add(pivot, view.position, -1), axes().ahead);
  const height = 2 * depth * Math.tan(view.fov * Math.PI / 360);
  walk([-dx, 0, dy], height / canvas.clientHeight);
});
canvas.addEventListener("lostpointercapture", () => { grip = null; });
canvas.addEventListener("wheel", async (event) => {
  event.preventDefault();
  const nearer = Math.exp(0.001 * event.deltaY);
  const about = (await pick(event))?.point ?? view.target;
  const place = (p) => add(about, add(p, about, -1), nearer);
  put(place(view.position), place(view.target));
}, { passive: false });
canvas.addEventListener("dblclick", async (event) => {
  const found = await pick(event);
  if (found) put(view.position, found.point);
});

// Shows the value of the pixel under the pointer, and its face.
let asks = false;
async function point(event) {
  if (asks || !image || image.moves) return;
  asks = true;
  const { x, y } = place(event);
  const face = (await pick(event))?.face;
  asks = false;
  if (image.moves) return;
  const { size: [width, height], numbers } = image;
  const [column, row] = [Math.floor(x * width), Math.floor(y * height)];
  const [i, area] = [row * width + column, width * height];
  const [mean, error] = [numbers[area + i], numbers[2 * area + i]];
  by("pixel").textContent = `pixel ${column},${row}: `
    + `${mean?.toPrecision(4)} ± ${error?.toPrecision(2)}`
    + (face ? `, face ${face}` : "");
}

const WALKS = { w: [0, 1, 0], s: [0, -1, 0], a: [-1, 0, 0], d: [1, 0, 0],
  q: [0, 0, -1], e: [0, 0, 1] };
const TURNS = { ArrowLeft: [0.05, 0], ArrowRight: [-0.05, 0],
  ArrowUp: [0, 0.05], ArrowDown: [0, -0.05] };
const SIDES = { 1: "front", 2: "back", 3: "left", 4: "right", 5: "top",
  6: "iso", ".": "iso" };

document.addEventListener("keydown", (event) => {
  const { key, target, ctrlKey, metaKey, altKey } = event;
  if (target.closest("aside") || ctrlKey || metaKey || altKey) return;
  const name = key.length === 1 ? key.toLowerCase() : key;
  if (WALKS[name]) walk(WALKS[name], 0.03 * Math.hypot(...axes().way));
  else if (TURNS[name]) turn(view.position, TURNS[name]);
  else if (SIDES[name]) {
    change({ "--view": SIDES[name], "-p": null, "-t": null });
  } else if (name === "m") {
    showsErrors = !showsErrors;
    paint();
  } else if (name === "r") post("set", { read: true });
  else if (name === "c") copy();
  else return;
  event.preventDefault();
});

form.addEventListener("submit", (event) => event.preventDefault());
form.addEventListener("change", ({ target: { name, value } }) => {
  if (name === "--exposure") {
    exposure = value && Number.isFinite(Number(value)) ? value : "auto";
    hear(state);
    return paint();
  }
  const set = { [name]: value === "" ? null : value };
  change(name === "-u" ? { ...set, "--zenith": null } : set);
});

async function copy() {
  await navigator.clipboard.writeText(command());
  by("status").textContent = "the command is copied";
}
by("copy").addEventListener("click", copy);
by("render").addEventListener("click", () => {
  by("files").replaceChildren();
  post(state.render?.runs ? "stop" : "render", asked());
});

async function passDay() {
  const turn = (by("day").value - 12) * Math.PI / 12;
  const [east, cosine] = [-Math.sin(turn), Math.cos(turn) * Math.SQRT1_2];
  const azimuth = Math.atan2(east, -cosine) * 180 / Math.PI;
  const altitude = Math.asin(cosine) * 180 / Math.PI;
  const sun = [(azimuth + 360) % 360, altitude].map((x) => x.toFixed(1));
  const light = "--direct" in state.settings ? {}
    : { "--sky": "cie:12", "--direct": "4" };
  await change({ ...light, "--sun": sun.join() });
}
let passing = false;
by("day").addEventListener("input", async () => {
  if (passing) return;
  passing = true;
  await passDay();
  passing = false;
});
by("day").addEventListener("change", passDay);

listen().catch((fault) => { by("fault").textContent = fault.message; });
