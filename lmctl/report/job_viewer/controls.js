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
const percent = (v) => v === undefined || !Number.isFinite(v) ? "–" : (100 * v).toFixed(1);

function valuesAt(i, s) {
  const l = view.lines, kinds = ["setup", "travel, beam off", "lead, beam off", "bead", "dwell"];
  const rows = [["line", `N${view.layer.first_line + i}`], ["kind", kinds[l.kind[i]]],
    ["path of the layer", l.path[i] || "–"], ["time in the layer", `${s.toFixed(2)} s`],
    ["x, y", `${l.x[i].toFixed(2)}, ${l.y[i].toFixed(2)} mm`], ["speed", `${l.speed[i].toFixed(2)} mm/s`],
    ["power", `${l.power[i].toFixed(0)} W`], ["bead width", `${l.width[i].toFixed(2)} mm`]];
  rows.push(["vol. %", "designed / planned / predicted"]);
  head.materials.forEach((name, k) => rows.push([name, ["designed", "planned", "predicted"]
    .map((kind) => percent(l[`${kind}${k}`]?.[i])).join(" / ")]));
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
  head.materials.forEach((name, k) => rows.push([`${name}, inferred`, `${percent(r[`inferred${k}`][best])} %`]));
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

// Values of the bead, or of the mark, under a place of the canvas; nothing elsewhere.
function showTip(px, py) {
  const box = canvas.getBoundingClientRect(), f = frame(box.width, box.height);
  const mark = marks().find((one) => Math.hypot(f.x(one.x) - px, f.y(one.y) - (one.down ? 7 : -7) - py) < 10);
  const i = mark ? -1 : nearest(f.mmX(px), f.mmY(py), Math.max(view.bounds.widest / 2, 6 / f.scale));
  if (!mark && i < 0) { tip.style.display = "none"; return; }
  const from = i > 0 ? view.lines.s[i - 1] : 0;
  tip.textContent = mark ? mark.text : valuesAt(i, from + state.hover * (view.lines.s[i] - from)).map((row) => row.join(": ")).join("\n");
  tip.style.left = tip.style.top = "0"; tip.style.display = "block";
  const beside = px + 14 + tip.offsetWidth <= box.width - 4 ? px + 14 : Math.max(4, px - 14 - tip.offsetWidth);
  tip.style.left = `${Math.max(4, Math.min(beside, box.width - tip.offsetWidth - 4))}px`;
  tip.style.top = `${Math.max(4, Math.min(py + 14, box.height - tip.offsetHeight - 6))}px`;
}

function zoomBy(by, px, py) {               // about a place, from the middle of the layer's frame
  by = Math.min(40 / state.zoom, Math.max(0.5 / state.zoom, by));
  state.panX = px - (px - state.panX) * by; state.panY = py - (py - state.panY) * by; state.zoom *= by;
  schedule();
}

function fromMiddle(x, y) {
  const box = canvas.getBoundingClientRect();
  return [x - box.left - box.width / 2, y - box.top - (box.height - 26) / 2];
}

// Two fingers zoom and move. One finger scrolls the page, and moves the layer once it is zoomed.
const fingers = new Map();
const middle = () => [...fingers.values()].reduce(([x, y], one) => [x + one[0] / fingers.size, y + one[1] / fingers.size], [0, 0]);
const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
const lift = (event) => fingers.delete(event.pointerId);
canvas.addEventListener("touchstart", (event) => { if (event.touches.length > 1) event.preventDefault(); }, { passive: false });
canvas.addEventListener("pointerdown", (event) => { if (event.pointerType === "touch") fingers.set(event.pointerId, [event.clientX, event.clientY]); });
for (const kind of ["pointerup", "pointercancel", "pointerleave"]) canvas.addEventListener(kind, lift);

canvas.addEventListener("pointermove", (event) => {
  if (!view) return;
  if (fingers.size === 2 && fingers.has(event.pointerId)) {
    const [x, y] = middle(), before = spread();
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const [newX, newY] = middle();
    state.panX += newX - x; state.panY += newY - y; tip.style.display = "none";
    zoomBy(spread() / (before || 1), ...fromMiddle(newX, newY));
    return;
  }
  if (fingers.has(event.pointerId)) fingers.set(event.pointerId, [event.clientX, event.clientY]);
  if (event.buttons & 1) {
    if (event.pointerType === "touch" && state.zoom <= 1) return;
    state.panX += event.movementX; state.panY += event.movementY; tip.style.display = "none"; schedule(); return;
  }
  const box = canvas.getBoundingClientRect();
  showTip(event.clientX - box.left, event.clientY - box.top);
});
canvas.addEventListener("pointerleave", () => { tip.style.display = "none"; });
canvas.addEventListener("click", (event) => {
  const box = canvas.getBoundingClientRect(), f = frame(box.width, box.height), px = event.clientX - box.left, py = event.clientY - box.top;
  const i = nearest(f.mmX(px), f.mmY(py), Math.max(view.bounds.widest / 2, 6 / f.scale));
  if (i >= 0 && event.detail === 1) setTime(view.lines.s[i]);
  showTip(px, py);                          // a finger cannot hover
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoomBy(Math.exp(-event.deltaY * 0.0015), ...fromMiddle(event.clientX, event.clientY));
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
  requestAnimationFrame(() => { waiting = false; if (view) { drawLayer(); drawCurves(); drawKey(); showValues(); }
    canvas.style.touchAction = state.zoom > 1 ? "none" : ""; });
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
  curvesKey();
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
