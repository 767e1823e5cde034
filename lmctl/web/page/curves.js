// Curves against machine time, drawn by uPlot: the last two minutes of the points the server sends.

const SHOWN_S = 120, KEPT = 6000;
const COLOURS = ["#0b57d0", "#c8321e", "#1f7a4d", "#8a5a00", "#7a2bb5", "#00798c"];
const DASHES = { designed: [2, 4], commanded: [8, 4], nozzle: [] };
const LINES = { 0: "solid", 2: "dotted", 8: "dashed" };
const NAMES = { designed: "designed", commanded: "commanded", nozzle: "at nozzle" };

function number(digits) {
  return (_, value) => (value == null ? "–" : value.toFixed(digits));
}

export class Curves {
  constructor(boxes) {
    this.boxes = boxes;
    this.plots = [];
    this.points = {};
    this.keys = "";
    new ResizeObserver(() => this.resize()).observe(boxes.mixture);
  }

  // what : {hoppers, materials}; the plots are made anew when they change
  replace(points, what) {
    this.points = points;
    const keys = JSON.stringify([what.hoppers, what.materials]);
    if (keys !== this.keys) { this.keys = keys; this.build(what); }
    this.draw();
  }

  add(points) {
    const before = (this.points.at_s ?? []).length, more = points.at_s.length;
    for (const name of new Set([...Object.keys(this.points), ...Object.keys(points)])) {
      const old = this.points[name] ?? Array(before).fill(null);
      this.points[name] = old.concat(points[name] ?? Array(more).fill(null)).slice(-KEPT);
    }
    this.draw();
  }

  build({ hoppers, materials }) {
    for (const { plot } of this.plots) plot.destroy();
    this.plots = [];
    // Of two materials one tells all: the other is what is left.
    const shown = materials.map((name, at) => ({ name, at })).slice(materials.length === 2 ? 1 : 0);
    const mixture = shown.flatMap(({ name, at }, i) => Object.keys(DASHES).map((kind) => ({
      column: `${kind}${at}`, label: `${name} ${NAMES[kind]}`, stroke: COLOURS[i % COLOURS.length],
      dash: DASHES[kind], width: kind === "nozzle" ? 2 : 1.5, value: number(3) })));
    this.plot("mixture", mixture, { y: { range: [-0.03, 1.03] } }, []);
    this.plot("process", [
      { column: "power_W", label: "power W", stroke: COLOURS[1], width: 1.5, value: number(0) },
      { column: "speed_mm_s", label: "speed mm/s", stroke: COLOURS[0], width: 1.5, scale: "speed", value: number(1) },
    ], { y: {}, speed: {} }, [{ scale: "speed", side: 1, size: 44, grid: { show: false } }]);
    this.plot("powder", hoppers.flatMap((name, i) => [
      { column: `set_g_min${i}`, label: `${name} commanded`, stroke: COLOURS[i % COLOURS.length], dash: [8, 4], value: number(2) },
      { column: `flow_g_min${i}`, label: `${name} reported g/min`, stroke: COLOURS[i % COLOURS.length], width: 2, value: number(2) },
    ]), { y: {} }, []);
  }

  plot(box, series, scales, axes) {
    const options = {
      width: Math.max(200, this.boxes[box].clientWidth), height: 150, cursor: { drag: { x: false, y: false } },
      scales: { x: { time: false }, ...scales }, legend: { live: true, markers: { width: 3, fill: "transparent", stroke: (u, i) => u.series[i].stroke(u, i), dash: (u, i) => LINES[(u.series[i].dash ?? []).length ? u.series[i].dash[0] : 0] } },
      axes: [{ size: 28, values: (_, ticks) => ticks.map((t) => `${t} s`) },
        { size: 48, values: (_, ticks) => ticks.map(String) }, ...axes],
      series: [{ label: "machine time", value: number(1) }, ...series.map((one) => ({ spanGaps: false, points: { show: false }, ...one }))],
    };
    const plot = new uPlot(options, [[], ...series.map(() => [])], this.boxes[box]);
    this.plots.push({ plot, columns: series.map((one) => one.column) });
  }

  draw() {
    const at = this.points.at_s ?? [];
    const last = at.length ? at[at.length - 1] : 0;
    let first = at.length;
    while (first > 0 && at[first - 1] >= last - SHOWN_S) first--;
    const empty = Array(at.length).fill(null);
    for (const { plot, columns } of this.plots) {
      plot.setData([at.slice(first), ...columns.map((name) => (this.points[name] ?? empty).slice(first))]);
      if ((plot.cursor.left ?? -1) < 0) plot.setLegend({ idx: at.length - first - 1 });
      plot.setScale("x", { min: Math.max(0, last - SHOWN_S), max: Math.max(last, 1) });
    }
  }

  resize() {
    const width = Math.max(200, this.boxes.mixture.clientWidth);
    for (const { plot } of this.plots) if (plot.width !== width) plot.setSize({ width, height: 150 });
  }
}
