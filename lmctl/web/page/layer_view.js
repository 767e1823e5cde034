// The layer under way: its tracks as pending, sent and executed, and the nozzle where it was reported.

const COLOURS = { done: "#1f7a4d", sent: "#e08a00", pending: "#b9c2cc", travel: "#dfe4e9",
  nozzle: "#0b57d0", reentry: "#7a2bb5" };
const BEAD = 3, MARGIN = 22;

async function decode(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer(), found = {};
  for (const column of packed.columns) {
    const steps = new Uint16Array(buffer, column.at, column.n), values = new Float64Array(column.n);
    for (let i = 0, sum = 0; i < column.n; i++) {
      sum = (sum + steps[i]) & 0xffff;
      values[i] = column.low + sum * column.step;
    }
    found[column.name] = values;
  }
  return found;
}

export class LayerView {
  constructor(canvas) {
    this.canvas = canvas;
    this.tracks = document.createElement("canvas");
    this.layer = null;
    this.snapshot = null;
    this.drawn = { executed: 0, sent: 0 };
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  async show(packed) {
    if (!packed) { this.layer = null; this.redraw(); return; }
    const lines = await decode(packed), n = lines.x.length;
    let left = Infinity, right = -Infinity, low = Infinity, high = -Infinity;
    for (let i = 0; i < n; i++) {
      if (lines.kind[i] !== BEAD) continue;
      for (const at of [Math.max(0, i - 1), i]) {
        left = Math.min(left, lines.x[at]); right = Math.max(right, lines.x[at]);
        low = Math.min(low, lines.y[at]); high = Math.max(high, lines.y[at]);
      }
    }
    if (!(right >= left)) { left = low = 0; right = high = 1; }
    this.layer = { number: packed.layer, first: packed.first_line, start: packed.start_mm, lines, n,
      box: { left, right, low, high } };
    this.redraw();
  }

  update(snapshot) {
    this.snapshot = snapshot;
    this.advance();
    this.compose();
  }

  redraw() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    for (const one of [this.canvas, this.tracks]) { one.width = width; one.height = height; }
    if (this.layer) {
      const { left, right, low, high } = this.layer.box, margin = MARGIN * ratio;
      const scale = Math.min((width - 2 * margin) / Math.max(right - left, 1e-6),
        (height - 2 * margin) / Math.max(high - low, 1e-6));
      this.scale = scale;
      this.toX = (x) => width / 2 + (x - (left + right) / 2) * scale;
      this.toY = (y) => height / 2 - (y - (low + high) / 2) * scale;
      this.stroke(0, this.layer.n, "pending");
      this.drawn = { executed: 0, sent: 0 };
      this.advance();
    }
    this.compose();
  }

  // Only lines that have changed are drawn again; going backwards (a re-entry) draws everything.
  advance() {
    if (!this.layer || !this.snapshot) return;
    const row = (line) => Math.max(0, Math.min(this.layer.n, (line ?? 0) - this.layer.first));
    const executed = row(this.snapshot.line), sent = Math.max(executed, row(this.snapshot.sent_line ?? 0));
    if (executed < this.drawn.executed || sent < this.drawn.sent) {
      this.tracks.getContext("2d").clearRect(0, 0, this.tracks.width, this.tracks.height);
      this.stroke(0, this.layer.n, "pending");
      this.drawn = { executed: 0, sent: 0 };
    }
    this.stroke(Math.max(this.drawn.sent, executed), sent, "sent");
    this.stroke(this.drawn.executed, executed, "done");
    this.drawn = { executed, sent };
  }

  stroke(from, to, kind) {
    if (to <= from) return;
    const pen = this.tracks.getContext("2d"), { lines, start } = this.layer, ratio = window.devicePixelRatio || 1;
    const widthOf = (row) => Math.max(2.4 * ratio, Math.min(lines.width[row] * this.scale * 0.8, 9 * ratio));
    const begin = (i) => i > 0 ? [lines.x[i - 1], lines.y[i - 1]] : start;
    pen.lineCap = "round"; pen.lineJoin = "round";
    for (let i = from; i < to;) {
      const isBead = lines.kind[i] === BEAD, at = begin(i);
      pen.strokeStyle = isBead ? COLOURS[kind] : COLOURS.travel;
      pen.lineWidth = isBead ? widthOf(i) : ratio;
      pen.beginPath();
      if (at) pen.moveTo(this.toX(at[0]), this.toY(at[1]));
      do { pen.lineTo(this.toX(lines.x[i]), this.toY(lines.y[i])); i++; }
      while (i < to && (lines.kind[i] === BEAD) === isBead);
      if (at) pen.stroke();
    }
  }

  compose() {
    const pen = this.canvas.getContext("2d"), ratio = window.devicePixelRatio || 1, now = this.snapshot;
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.layer) {
      pen.fillStyle = "#4c5561"; pen.font = `${14 * ratio}px sans-serif`;
      pen.fillText("no layer to show", 12 * ratio, 24 * ratio);
      return;
    }
    pen.drawImage(this.tracks, 0, 0);
    if (now?.reentry && now.reentry.layer === this.layer.number) this.reentry(pen, now.reentry, ratio);
    if (now?.position_mm) this.nozzle(pen, now.position_mm, ratio);
  }

  reentry(pen, entry, ratio) {
    pen.strokeStyle = COLOURS.reentry; pen.lineWidth = 2.5 * ratio; pen.setLineDash([7 * ratio, 5 * ratio]);
    pen.beginPath();
    entry.approach_mm.forEach(([x, y], i) => pen[i ? "lineTo" : "moveTo"](this.toX(x), this.toY(y)));
    pen.stroke(); pen.setLineDash([]);
    const [x, y] = entry.approach_mm.at(-1);
    pen.fillStyle = COLOURS.reentry;
    pen.beginPath(); pen.arc(this.toX(x), this.toY(y), 5 * ratio, 0, 7); pen.fill();
  }

  // A nozzle outside the view (at the purge position) is shown at its edge.
  nozzle(pen, [x, y], ratio) {
    const edge = 9 * ratio;
    const px = Math.max(edge, Math.min(this.canvas.width - edge, this.toX(x)));
    const py = Math.max(edge, Math.min(this.canvas.height - edge, this.toY(y)));
    pen.strokeStyle = "#fff"; pen.lineWidth = 6 * ratio;
    pen.beginPath(); pen.arc(px, py, 7 * ratio, 0, 7); pen.stroke();
    pen.strokeStyle = COLOURS.nozzle; pen.lineWidth = 3 * ratio;
    pen.beginPath(); pen.arc(px, py, 7 * ratio, 0, 7);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      pen.moveTo(px + 4 * dx * ratio, py + 4 * dy * ratio); pen.lineTo(px + 9 * dx * ratio, py + 9 * dy * ratio);
    }
    pen.stroke();
  }
}
