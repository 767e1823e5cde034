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

// --- the layer ----------------------------------------------------------------------------------

const canvas = byId("layer"), curves = byId("curves"), tip = byId("tip");

function sized(target) {
  const box = target.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
  target.width = Math.round(box.width * ratio); target.height = Math.round(box.height * ratio);
  const context = target.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, box.width, box.height];
}

function frame(width, height) {
  const b = view.bounds, scale = state.zoom * Math.min(width / (b.x1 - b.x0), (height - 26) / (b.y1 - b.y0));
  const midX = (b.x0 + b.x1) / 2, midY = (b.y0 + b.y1) / 2;
  return { scale, x: (mm) => width / 2 + state.panX + (mm - midX) * scale,
    y: (mm) => (height - 26) / 2 + state.panY - (mm - midY) * scale,
    mmX: (px) => (px - width / 2 - state.panX) / scale + midX,
    mmY: (px) => midY - (px - (height - 26) / 2 - state.panY) / scale };
}

function drawLayer() {
  const [g, width, height] = sized(canvas), f = frame(width, height), of = colouring();
  g.fillStyle = "#fff"; g.fillRect(0, 0, width, height);
  g.lineCap = "round"; g.lineJoin = "round";
  const lines = view.lines, done = view.layer.executed, upTo = byId("upto").checked ? lineAt(view, state.s) : view.n - 1;
  const segment = (i, w, colour) => {
    g.strokeStyle = colour; g.lineWidth = Math.max(0.6, w);
    g.beginPath(); g.moveTo(f.x(view.beginX[i]), f.y(view.beginY[i])); g.lineTo(f.x(lines.x[i]), f.y(lines.y[i])); g.stroke();
  };
  for (let a = 0; a <= upTo;) {             // path by path: rim first, then the bead
    if (lines.kind[a] !== KIND.BEAD) { a++; continue; }
    let b = a;
    while (b <= upTo && lines.kind[b] === KIND.BEAD && lines.path[b] === lines.path[a]) b++;
    const left = (i) => state.show !== "planned" && i >= done;
    for (let i = a; i < b; i++) segment(i, lines.width[i] * f.scale, left(i) ? "#9a9a9a" : "#1a1a1a");
    for (let i = a; i < b; i++) {
      const pale = left(i) || state.show === "reported";
      segment(i, lines.width[i] * f.scale - Math.min(2, 0.1 * lines.width[i] * f.scale), pale ? "#e4e4e4" : of.line(i));
    }
    a = b;
  }
  if (state.show === "reported" && view.reported) drawSamples(g, f, of, segmentWidth(f));
  if (byId("travel").checked) drawTravel(g, f, upTo);
  if (byId("starts").checked) drawStarts(g, f, upTo);
  drawMarks(g, f);
  drawNozzle(g, f);
  scaleBar(g, f, height);
}

const segmentWidth = (f) => Math.max(1.5, 0.7 * view.bounds.widest * f.scale);

function drawSamples(g, f, of, width) {
  const r = view.reported;
  g.lineCap = "butt"; g.lineWidth = width;
  for (let i = 1; i < r.s.length; i++) {
    if (r.run[i] !== r.run[i - 1] || r.s[i] - r.s[i - 1] > 1.0) continue;
    const first = lineAt(view, r.s[i - 1]), last = lineAt(view, r.s[i]);
    g.strokeStyle = of.sample(i);
    g.beginPath(); g.moveTo(f.x(r.x[i - 1]), f.y(r.y[i - 1]));
    let beam = true;
    for (let k = first; k < last; k++) {    // along the lines between two reports
      if (view.lines.kind[k] !== KIND.BEAD) beam = false;
      else g.lineTo(f.x(view.lines.x[k]), f.y(view.lines.y[k]));
    }
    g.lineTo(f.x(r.x[i]), f.y(r.y[i]));
    if (beam) g.stroke();
  }
  g.lineCap = "round";
}

function drawTravel(g, f, upTo) {
  for (let i = 0; i <= upTo; i++) {
    const kind = view.lines.kind[i];
    if (kind !== KIND.TRAVEL && kind !== KIND.LEAD) continue;
    g.strokeStyle = kind === KIND.TRAVEL ? "#c2185b" : "#555"; g.lineWidth = 1;
    g.setLineDash(kind === KIND.TRAVEL ? [4, 3] : []);
    g.beginPath(); g.moveTo(f.x(view.beginX[i]), f.y(view.beginY[i]));
    g.lineTo(f.x(view.lines.x[i]), f.y(view.lines.y[i])); g.stroke();
  }
  g.setLineDash([]);
}

function drawStarts(g, f, upTo) {
  let number = 0;
  g.font = "11px system-ui, sans-serif";
  for (let i = 0; i <= upTo; i++) {
    if (view.lines.kind[i] !== KIND.BEAD || (i && view.lines.kind[i - 1] === KIND.BEAD && view.lines.path[i - 1] === view.lines.path[i])) continue;
    number++;
    const x = f.x(view.beginX[i]), y = f.y(view.beginY[i]);
    g.beginPath(); g.arc(x, y, 3.5, 0, 7); g.fillStyle = "#fff"; g.fill(); g.strokeStyle = "#1a1a1a"; g.lineWidth = 1; g.stroke();
    g.lineWidth = 3; g.strokeStyle = "#fff"; g.strokeText(number, x + 5, y - 4);
    g.fillStyle = "#111"; g.fillText(number, x + 5, y - 4);
  }
}

function marks() {
  const first = view.layer.first_line, found = [];
  for (const one of head.interruptions) {
    const place = one.line === null ? -1 : one.line - first, entry = one.entry_line === null ? -1 : one.entry_line - first;
    if (place >= 0 && place < view.n) {
      found.push({ x: view.beginX[place] + one.share * (view.lines.x[place] - view.beginX[place]),
        y: view.beginY[place] + one.share * (view.lines.y[place] - view.beginY[place]), down: true,
        text: `deposition ended here (${one.known})\n${one.run}: ${one.cause}` });
    }
    if (entry >= 0 && entry < view.n) {
      found.push({ x: view.beginX[entry], y: view.beginY[entry], down: false,
        text: `entered again in ${one.resumed_in}\n${one.repeated_mm.toFixed(1)} mm deposited twice` });
    }
  }
  return found;
}

function drawMarks(g, f) {
  for (const mark of marks()) {
    const x = f.x(mark.x), y = f.y(mark.y), k = mark.down ? 1 : -1;
    g.beginPath(); g.moveTo(x, y); g.lineTo(x - 7, y - 13 * k); g.lineTo(x + 7, y - 13 * k); g.closePath();
    g.fillStyle = mark.down ? "#c2185b" : "#0b57d0"; g.fill(); g.lineWidth = 1.5; g.strokeStyle = "#fff"; g.stroke();
  }
}

function place(s) {
  const i = lineAt(view, s), from = i ? view.lines.s[i - 1] : 0, lasting = view.lines.s[i] - from;
  const share = lasting > 0 ? Math.min(1, Math.max(0, (s - from) / lasting)) : 1;
  return { i, x: view.beginX[i] + share * (view.lines.x[i] - view.beginX[i]), y: view.beginY[i] + share * (view.lines.y[i] - view.beginY[i]) };
}

function drawNozzle(g, f) {
  const at = place(state.s), x = f.x(at.x), y = f.y(at.y);
  g.lineWidth = 3; g.strokeStyle = "#fff"; cross(g, x, y);
  g.lineWidth = 1.4; g.strokeStyle = "#000"; cross(g, x, y);
}

function cross(g, x, y) {
  g.beginPath(); g.arc(x, y, 6, 0, 7); g.moveTo(x - 11, y); g.lineTo(x + 11, y); g.moveTo(x, y - 11); g.lineTo(x, y + 11); g.stroke();
}

function scaleBar(g, f, height) {
  const power = 10 ** Math.floor(Math.log10(160 / f.scale));
  const mm = [5, 2, 1].map((n) => n * power).find((one) => one * f.scale <= 160);
  g.fillStyle = "#111"; g.fillRect(12, height - 14, mm * f.scale, 4);
  g.font = "12px system-ui, sans-serif"; g.fillText(`${mm} mm`, 18 + mm * f.scale, height - 9);
}

// --- curves -------------------------------------------------------------------------------------

const EDGE = { left: 52, right: 10 };

function drawCurves() {
  const [g, width, height] = sized(curves);
  g.fillStyle = "#fff"; g.fillRect(0, 0, width, height);
  const last = view.lines.s[view.n - 1] || 1, x = (s) => EDGE.left + (s / last) * (width - EDGE.left - EDGE.right);
  const half = (height - 22) / 2;
  let most = 0;
  head.hoppers.forEach((_, k) => { for (const v of view.lines[`flow${k}`]) most = Math.max(most, v); });
  const flows = panel(g, x, 4, half - 16, width, 0, 1.25 * most || 1, "flow g/min");
  const shares = panel(g, x, half + 6, half - 16, width, 0, 125, "mixture %");
  beamOff(g, x, height - 18);
  head.hoppers.forEach((hopper, k) => {
    line(g, view.lines.knot_s, view.lines[`flow${k}`], x, flows, CURVE_COLOURS[k % 6], [], 1);
    if (view.reported) dots(g, view.reported.s, view.reported[`flow${k}`], x, flows, CURVE_COLOURS[k % 6], 1);
    label(g, `${hopper.name} ${hopper.material}`, EDGE.left + 6 + 120 * k, 14, CURVE_COLOURS[k % 6]);
  });
  head.materials.forEach((name, k) => {
    const colour = CURVE_COLOURS[k % 6];
    line(g, view.lines.s, view.lines[`planned${k}`], x, shares, colour, [], 100);
    if (view.lines[`predicted${k}`]) line(g, view.lines.s, view.lines[`predicted${k}`], x, shares, colour, [4, 3], 100);
    if (view.reported) dots(g, view.reported.s, view.reported[`inferred${k}`], x, shares, colour, 100);
    label(g, name, EDGE.left + 6 + 120 * k, half + 16, colour);
  });
  g.strokeStyle = "#000"; g.lineWidth = 1;
  g.beginPath(); g.moveTo(x(state.s), 2); g.lineTo(x(state.s), height - 18); g.stroke();
  label(g, `${last.toFixed(1)} s`, width - 56, height - 5, "#444");
  const words = ["solid: planned", view.lines.predicted0 ? "dashed: predicted at the nozzle" : "",
    view.reported ? "dots: flow as reported, seconds late; mixture inferred" : "", "grey: beam off"].filter(Boolean).join("; ");
  label(g, words, EDGE.left, height - 5, "#444");
}

function panel(g, x, top, height, width, low, high, title) {
  g.strokeStyle = "#bbb"; g.lineWidth = 1; g.strokeRect(EDGE.left, top, width - EDGE.left - EDGE.right, height);
  g.fillStyle = "#444"; g.font = "11px system-ui, sans-serif";
  const most = 0.8 * high, at = top + height - (most - low) / (high - low) * height;
  g.fillText(most >= 10 ? most.toFixed(0) : most.toFixed(1), 4, at + 4); g.fillText(String(low), 4, top + height);
  g.fillText(title.split(" ")[0], 4, top + 0.55 * height); g.fillText(title.split(" ")[1], 4, top + 0.55 * height + 12);
  return (v) => top + height - ((v - low) / (high - low)) * height;
}

function beamOff(g, x, bottom) {
  g.fillStyle = "#0000000c";
  for (let i = 0; i < view.n; i++) {
    if (view.lines.kind[i] === KIND.BEAD) continue;
    const from = x(i ? view.lines.s[i - 1] : 0);
    g.fillRect(from, 4, Math.max(0.4, x(view.lines.s[i]) - from), bottom - 4);
  }
}

function line(g, t, v, x, y, colour, dash, scale) {
  g.strokeStyle = colour; g.lineWidth = 1.4; g.setLineDash(dash); g.beginPath();
  for (let i = 0; i < t.length; i++) { if (i) g.lineTo(x(t[i]), y(v[i] * scale)); else g.moveTo(x(t[i]), y(v[i] * scale)); }
  g.stroke(); g.setLineDash([]);
}

function dots(g, t, v, x, y, colour, scale) {
  g.fillStyle = colour;
  for (let i = 0; i < t.length; i++) if (Number.isFinite(v[i])) g.fillRect(x(t[i]) - 1, y(v[i] * scale) - 1, 2, 2);
}

function label(g, text, x, y, colour) {
  g.font = "11px system-ui, sans-serif";
  g.fillStyle = "#ffffffd0"; g.fillRect(x - 2, y - 10, g.measureText(text).width + 4, 13);
  g.fillStyle = colour; g.fillText(text, x, y);
}

// --- key, values, hover -------------------------------------------------------------------------

function drawKey() {
  const [g, width] = sized(byId("key")), of = colouring();
  g.clearRect(0, 0, width, 100); g.font = "12px system-ui, sans-serif"; g.fillStyle = "#111";
  const title = COLOURS[state.colour];
  if (state.colour === "mixture" && head.materials.length !== 2) {
    head.materials.forEach((name, k) => {
      g.fillStyle = mixtureColour(head.materials.map((_, i) => +(i === k))); g.fillRect(0, 4 + 18 * k, 26, 13);
      g.fillStyle = "#111"; g.fillText(name, 32, 15 + 18 * k);
    });
    return;
  }
  g.fillText(state.colour === "mixture" ? `% by volume of ${head.materials[1]}` : `${title.title}${title.unit ? `, ${title.unit}` : ""}`, 0, 12);
  for (let i = 0; i < 256; i++) { g.fillStyle = palette[i]; g.fillRect((i * width) / 256, 20, width / 256 + 1, 16); }
  const [low, high] = of.range || [0, 100];
  g.fillStyle = "#111"; g.fillText(short(low), 0, 50); g.textAlign = "right"; g.fillText(short(high), width, 50); g.textAlign = "left";
  if (high === low) g.fillText("one value throughout", 0, 68);
}

const short = (v) => v === 0 ? "0" : Math.abs(v) >= 100 ? v.toFixed(0) : Math.abs(v) >= 10 ? v.toFixed(1) : v.toFixed(3);
const percent = (v) => v === undefined || !Number.isFinite(v) ? "–" : `${(100 * v).toFixed(1)} %`;

function valuesAt(i, s) {
  const l = view.lines, kinds = ["setup", "travel, beam off", "lead, beam off", "bead", "dwell"];
  const rows = [["line", `N${view.layer.first_line + i}`], ["kind", kinds[l.kind[i]]],
    ["path of the layer", l.path[i] || "–"], ["time in the layer", `${s.toFixed(2)} s`],
    ["x, y", `${l.x[i].toFixed(2)}, ${l.y[i].toFixed(2)} mm`], ["speed", `${l.speed[i].toFixed(2)} mm/s`],
    ["power", `${l.power[i].toFixed(0)} W`], ["bead width", `${l.width[i].toFixed(2)} mm`]];
  head.materials.forEach((name, k) => rows.push([name, percent(l[`planned${k}`][i])],
    [`${name}, predicted`, percent(l[`predicted${k}`]?.[i])]));
  head.hoppers.forEach((hopper, k) => rows.push([`flow ${hopper.name}`, `${flowAt(view, k, s).toFixed(2)} g/min`]));
  if (head.runs.length) rows.push(["executed", i < view.layer.executed ? "yes" : "no report says so"]);
  return rows;
}

function sampleRows(s) {
  const r = view.reported;
  if (!r || !r.s.length) return [];
  let best = 0;
  for (let i = 0; i < r.s.length; i++) if (Math.abs(r.s[i] - s) < Math.abs(r.s[best] - s)) best = i;
  if (Math.abs(r.s[best] - s) > 1) return [["reported", "nothing within 1 s"]];
  const rows = [["reported in", head.runs[r.run[best]].run], ["speed", `${r.speed[best].toFixed(2)} mm/s`],
    ["power", Number.isFinite(r.power[best]) ? `${r.power[best].toFixed(0)} W` : "–"]];
  head.hoppers.forEach((hopper, k) => rows.push([`flow ${hopper.name}`, `${short(r[`flow${k}`][best])} g/min`]));
  head.materials.forEach((name, k) => rows.push([`${name}, inferred`, percent(r[`inferred${k}`][best])]));
  return rows;
}

function showValues() {
  const at = place(state.s);
  fill(byId("values"), valuesAt(at.i, state.s));
  fill(byId("reported"), sampleRows(state.s));
}

function fill(table, rows) {
  table.replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("tr"), th = document.createElement("th"), td = document.createElement("td");
    th.textContent = name; td.textContent = value; row.append(th, td); return row;
  }));
}

function nearest(mmX, mmY, reach) {
  let best = -1, least = reach * reach;
  for (let i = 0; i < view.n; i++) {
    if (view.lines.kind[i] !== KIND.BEAD) continue;
    const ax = view.beginX[i], ay = view.beginY[i], dx = view.lines.x[i] - ax, dy = view.lines.y[i] - ay;
    const t = Math.min(1, Math.max(0, ((mmX - ax) * dx + (mmY - ay) * dy) / (dx * dx + dy * dy || 1)));
    const off = (ax + t * dx - mmX) ** 2 + (ay + t * dy - mmY) ** 2;
    if (off < least) { least = off; best = i; state.hover = t; }
  }
  return best;
}

canvas.addEventListener("pointermove", (event) => {
  if (!view) return;
  const box = canvas.getBoundingClientRect(), px = event.clientX - box.left, py = event.clientY - box.top;
  if (event.buttons & 1) { state.panX += event.movementX; state.panY += event.movementY; tip.style.display = "none"; schedule(); return; }
  const f = frame(box.width, box.height);
  const mark = marks().find((one) => Math.hypot(f.x(one.x) - px, f.y(one.y) - (one.down ? 7 : -7) - py) < 10);
  const i = mark ? -1 : nearest(f.mmX(px), f.mmY(py), Math.max(view.bounds.widest / 2, 6 / f.scale));
  if (!mark && i < 0) { tip.style.display = "none"; return; }
  const from = i > 0 ? view.lines.s[i - 1] : 0;
  tip.textContent = mark ? mark.text : valuesAt(i, from + state.hover * (view.lines.s[i] - from)).map((row) => row.join(": ")).join("\n");
  tip.style.display = "block";
  tip.style.left = `${Math.min(px + 14, box.width - 270)}px`; tip.style.top = `${Math.max(4, Math.min(py + 14, box.height - tip.offsetHeight - 6))}px`;
});
canvas.addEventListener("pointerleave", () => { tip.style.display = "none"; });
canvas.addEventListener("click", (event) => {
  const box = canvas.getBoundingClientRect(), f = frame(box.width, box.height);
  const i = nearest(f.mmX(event.clientX - box.left), f.mmY(event.clientY - box.top), Math.max(view.bounds.widest / 2, 6 / f.scale));
  if (i >= 0 && event.detail === 1) setTime(view.lines.s[i]);
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  const box = canvas.getBoundingClientRect(), px = event.clientX - box.left - box.width / 2, py = event.clientY - box.top - (box.height - 26) / 2;
  const by = Math.min(40 / state.zoom, Math.max(0.5 / state.zoom, Math.exp(-event.deltaY * 0.0015)));
  state.panX = px - (px - state.panX) * by; state.panY = py - (py - state.panY) * by; state.zoom *= by;
  schedule();
}, { passive: false });
canvas.addEventListener("dblclick", () => { state.zoom = 1; state.panX = state.panY = 0; schedule(); });
for (const kind of ["pointerdown", "pointermove"]) {
  curves.addEventListener(kind, (event) => {
    if (!view || (kind === "pointermove" && !(event.buttons & 1))) return;
    const box = curves.getBoundingClientRect();
    setTime(((event.clientX - box.left - EDGE.left) / (box.width - EDGE.left - EDGE.right)) * view.lines.s[view.n - 1]);
  });
}

// --- controls -----------------------------------------------------------------------------------

let waiting = false;
function schedule() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; if (view) { drawLayer(); drawCurves(); drawKey(); showValues(); } });
}

function setTime(s) {
  state.s = Math.min(view.lines.s[view.n - 1], Math.max(0, s));
  byId("time").value = state.s;
  byId("time-text").textContent = `${state.s.toFixed(1)} s of ${view.lines.s[view.n - 1].toFixed(1)} s`;
  schedule();
}

async function setLayer(index) {
  state.layer = Math.min(layers.length - 1, Math.max(0, index));
  byId("layer-range").value = byId("layer-number").value = state.layer + head.excerpt;
  const asked = ++drawn, found = await load(state.layer);
  if (asked !== drawn) return;
  view = found;
  byId("layer-text").textContent = `z = ${view.layer.z_mm.toFixed(2)} mm` + (view.layer.remark ? `; ${view.layer.remark}` : "");
  byId("time").max = view.lines.s[view.n - 1];
  document.body.dataset.layer = String(state.layer + head.excerpt);
  setTime(Math.min(state.s, view.lines.s[view.n - 1]));
}

function start() {
  byId("job").textContent = `${head.part}`;
  byId("job-text").textContent = `${layers.length} layers for ${head.machine}, job ${head.job.slice(0, 16)}…` +
    (head.runs.length ? `; ${head.runs.map((one) => `${one.run} ${one.state}`).join(", ")}` : "");
  for (const id of ["layer-range", "layer-number"]) {
    byId(id).min = head.excerpt; byId(id).max = layers.length - 1 + head.excerpt;
    byId(id).addEventListener("input", (event) => { if (event.target.value) setLayer(Number(event.target.value) - head.excerpt); });
  }
  byId("time").addEventListener("input", (event) => setTime(Number(event.target.value)));
  byId("colour").addEventListener("change", (event) => { state.colour = event.target.value; schedule(); });
  byId("show").addEventListener("change", (event) => { state.show = event.target.value; schedule(); });
  byId("show").value = state.show;
  byId("of-runs").hidden = !head.runs.length;
  for (const id of ["upto", "travel", "starts"]) byId(id).addEventListener("change", schedule);
  window.addEventListener("resize", schedule);
  document.addEventListener("keydown", (event) => {
    if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
    if (event.key === "ArrowUp") setLayer(state.layer + 1);
    else if (event.key === "ArrowDown") setLayer(state.layer - 1);
    else if (event.key === "ArrowRight") setTime(state.s + 1);
    else if (event.key === "ArrowLeft") setTime(state.s - 1);
    else return;
    event.preventDefault();
  });
  setLayer(Number(document.body.dataset.first));
}

start();
