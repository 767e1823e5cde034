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
  });
  head.materials.forEach((name, k) => {
    const colour = CURVE_COLOURS[k % 6];
    line(g, view.lines.s, view.lines[`planned${k}`], x, shares, colour, [], 100);
    line(g, view.lines.s, view.lines[`designed${k}`], x, shares, colour, [1, 4], 100);
    if (view.lines[`predicted${k}`]) line(g, view.lines.s, view.lines[`predicted${k}`], x, shares, colour, [4, 3], 100);
    if (view.reported) dots(g, view.reported.s, view.reported[`inferred${k}`], x, shares, colour, 100);
  });
  g.strokeStyle = "#000"; g.lineWidth = 1;
  g.beginPath(); g.moveTo(x(state.s), 2); g.lineTo(x(state.s), height - 18); g.stroke();
  g.fillStyle = "#444"; g.font = "11px system-ui, sans-serif";
  g.fillText("0 s", EDGE.left, height - 5);
  g.textAlign = "right"; g.fillText(`${last.toFixed(1)} s`, width - EDGE.right, height - 5); g.textAlign = "left";
  g.fillStyle = "#000"; g.textAlign = "center";
  g.fillText(`${state.s.toFixed(1)} s`, Math.min(width - 78, Math.max(EDGE.left + 44, x(state.s))), height - 5); g.textAlign = "left";
}

// Below the curves, as text of the page: it wraps where the window is narrow.
function curvesKey() {
  const entry = (text, colour) => {
    const item = document.createElement("span"), line = document.createElement("i");
    line.style.background = colour; item.append(line, text);
    return item;
  };
  const names = [...new Set([...head.hoppers.map((one, k) => `flow ${one.name}|${k}`), ...head.materials.map((name, k) => `${name}|${k}`)])];
  const lines = ["solid: planned", "dotted: designed", view.lines.predicted0 ? "dashed: predicted at the nozzle" : "",
    view.reported ? "dots: flow as reported, which is ahead of the nozzle; mixture inferred at it" : "", "grey: beam off"].filter(Boolean).join("; ");
  byId("curves-key").replaceChildren(
    ...names.map((one) => { const [name, k] = one.split("|"); return entry(name, CURVE_COLOURS[k % 6]); }), `${lines}.`);
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
  let isOpen = false;                       // a gap where a value is not known
  for (let i = 0; i < t.length; i++) {
    if (!Number.isFinite(v[i])) { isOpen = false; continue; }
    if (isOpen) g.lineTo(x(t[i]), y(v[i] * scale)); else g.moveTo(x(t[i]), y(v[i] * scale));
    isOpen = true;
  }
  g.stroke(); g.setLineDash([]);
}

function dots(g, t, v, x, y, colour, scale) {
  g.fillStyle = colour;
  for (let i = 0; i < t.length; i++) if (Number.isFinite(v[i])) g.fillRect(x(t[i]) - 1, y(v[i] * scale) - 1, 2, 2);
}
