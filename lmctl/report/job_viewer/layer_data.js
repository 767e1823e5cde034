"use strict";
// The viewer of a job: everything it shows is in this page. Lengths mm, times s, flows g/min.
const head = JSON.parse(document.getElementById("head").textContent);
const layers = JSON.parse(document.getElementById("layers").textContent);
const KIND = { SETUP: 0, TRAVEL: 1, LEAD: 2, BEAD: 3, DWELL: 4 };
const CURVE_COLOURS = ["#20205a", "#c8321e", "#2fa8d8", "#8a7a00", "#7a4fa0", "#2e7d32"];
const byId = (id) => document.getElementById(id);
const state = { layer: 0, s: 0, colour: "mixture", show: head.runs.length ? "executed" : "planned",
  zoom: 1, panX: 0, panY: 0, hover: null };
let view = null;      // the layer that is shown, decoded
let drawn = 0;        // layers may arrive late; the last one asked for is drawn

// --- data ---------------------------------------------------------------------------------------

async function inflate(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

async function decode(packed) {
  const buffer = await inflate(packed.data), found = {};
  for (const c of packed.columns) {
    if (c.type === "f4") { found[c.name] = new Float32Array(buffer, c.at, c.n); continue; }
    const steps = new Uint16Array(buffer, c.at, c.n), values = new Float64Array(c.n);
    let sum = 0;
    for (let i = 0; i < c.n; i++) {
      sum = (sum + steps[i]) & 0xffff;
      values[i] = c.holes && sum === 65535 ? NaN : c.low + sum * c.step;
    }
    found[c.name] = values;
  }
  return found;
}

async function load(index) {
  const layer = layers[index], lines = await decode(layer);
  const n = lines.x.length, beginX = new Float64Array(n), beginY = new Float64Array(n);
  for (let i = 0; i < n; i++) {
    beginX[i] = i ? lines.x[i - 1] : layer.start_mm[0] ?? lines.x[0];
    beginY[i] = i ? lines.y[i - 1] : layer.start_mm[1] ?? lines.y[0];
  }
  const reported = layer.reported ? await decode(layer.reported) : null;
  return { layer, lines, n, beginX, beginY, reported, bounds: bounds(lines, beginX, beginY, n) };
}

function bounds(lines, beginX, beginY, n) {
  let x0 = Infinity, x1 = -Infinity, y0 = Infinity, y1 = -Infinity, widest = 0;
  for (let i = 0; i < n; i++) {
    if (lines.kind[i] !== KIND.BEAD) continue;
    x0 = Math.min(x0, lines.x[i], beginX[i]); x1 = Math.max(x1, lines.x[i], beginX[i]);
    y0 = Math.min(y0, lines.y[i], beginY[i]); y1 = Math.max(y1, lines.y[i], beginY[i]);
    widest = Math.max(widest, lines.width[i]);
  }
  if (x0 > x1) { x0 = y0 = 0; x1 = y1 = 10; }
  return { x0: x0 - widest, x1: x1 + widest, y0: y0 - widest, y1: y1 + widest, widest };
}

// --- colours ------------------------------------------------------------------------------------

const rgb = (c) => `rgb(${c[0]},${c[1]},${c[2]})`;
const palette = head.palette.map(rgb);
const shade = (share) => palette[Math.max(0, Math.min(255, Math.round(share * 255)))];

function mixtureColour(fractions) {
  const m = fractions.length;
  if (m === 1) return "rgb(143,169,196)";
  if (m === 2) return shade(fractions[1]);
  if (head.mixed) {
    return rgb([0, 1, 2].map((k) => Math.round(Math.min(255, Math.max(0,
      fractions.reduce((sum, v, i) => sum + v * head.anchors[i][k], 0))))));
  }
  const most = fractions.indexOf(Math.max(...fractions)), share = fractions[most];
  return rgb(head.anchors[most].map((v) => Math.round(share * v + (1 - share) * 255)));
}

const fractionsAt = (of, name, i) => head.materials.map((_, k) => of[`${name}${k}`][i]);

function flowAt(v, k, s) {  // linear between knots
  const t = v.lines.knot_s, f = v.lines[`flow${k}`];
  let low = 0, high = t.length - 1;
  while (high - low > 1) { const mid = (low + high) >> 1; if (t[mid] <= s) low = mid; else high = mid; }
  const width = t[high] - t[low], share = width > 0 ? Math.min(1, Math.max(0, (s - t[low]) / width)) : 0;
  return f[low] + share * (f[high] - f[low]);
}

// What can be told by colour: values of planned lines, and of samples where a run reported them.
const COLOURS = {
  mixture: { title: "mixture", unit: "% by volume" },
  power: { title: "power", unit: "W", line: (v, i) => v.lines.power[i], sample: (r, i) => r.power[i] },
  speed: { title: "speed", unit: "mm/s", line: (v, i) => v.lines.speed[i], sample: (r, i) => r.speed[i] },
  flow: { title: "powder flow, all hoppers", unit: "g/min",
    line: (v, i) => head.hoppers.reduce((sum, _, k) => sum + flowAt(v, k, v.lines.s[i]), 0),
    sample: (r, i) => head.hoppers.reduce((sum, _, k) => sum + r[`flow${k}`][i], 0) },
  error: { title: "mixture error", unit: "volume fraction",
    line: (v, i) => v.lines.error ? v.lines.error[i] : NaN, sample: sampleError },
  order: { title: "order of paths", unit: "", line: (v, i) => v.lines.path[i] },
};

function sampleError(r, i, v) {
  const line = lineAt(v, r.s[i]);
  return Math.max(...head.materials.map((_, k) => Math.abs(r[`inferred${k}`][i] - v.lines[`planned${k}`][line])));
}

function lineAt(v, s) {
  let low = 0, high = v.n - 1;
  while (low < high) { const mid = (low + high) >> 1; if (v.lines.s[mid] < s) low = mid + 1; else high = mid; }
  return low;
}

function colouring() {
  const of = COLOURS[state.colour], reported = state.show === "reported" && view.reported;
  if (state.colour === "mixture") {
    return { line: (i) => mixtureColour(fractionsAt(view.lines, "planned", i)),
      sample: (i) => mixtureColour(fractionsAt(view.reported, "inferred", i)), range: null };
  }
  const value = reported && of.sample ? (i) => of.sample(view.reported, i, view) : (i) => of.line(view, i);
  const count = reported && of.sample ? view.reported.s.length : view.n;
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < count; i++) {
    if (!reported && view.lines.kind[i] !== KIND.BEAD) continue;
    const x = value(i);
    if (Number.isFinite(x)) { low = Math.min(low, x); high = Math.max(high, x); }
  }
  if (low > high) low = high = 0;
  if (state.colour === "error") low = 0;
  const colour = (x) => Number.isFinite(x) ? shade(high > low ? (x - low) / (high - low) : 0) : "#bbb";
  return { line: (i) => colour(of.line(view, i)), sample: (i) => colour(value(i)), range: [low, high] };
}
