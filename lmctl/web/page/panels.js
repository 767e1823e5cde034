// The parts of the page that are text: state, values with origin and age, alarms, interlocks, events.

const OLD_S = 3;

export const $ = (id) => document.getElementById(id);

export function element(tag, text, attributes = {}) {
  const made = document.createElement(tag);
  if (text != null) made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

export function fixed(value, digits, unit = "") {
  return value == null ? "–" : `${value.toFixed(digits)}${unit && ` ${unit}`}`;
}

export function duration(seconds) {
  if (seconds == null) return "–";
  if (seconds < 60) return `${seconds.toFixed(0)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

// Replaces the children of a box only where they differ, so that focus and selection stay.
function fill(box, children) {
  const next = children.map((one) => one.outerHTML).join("");
  if (box.dataset.shown === next) return;
  box.dataset.shown = next;
  box.replaceChildren(...children);
}

export function showState(now) {
  $("title").textContent = `${now.run} · ${now.part ?? ""}`;
  document.title = `${now.state} · ${now.run} · lmctl`;
  $("state").textContent = now.state;
  $("state").dataset.state = now.state;
  const left = now.doing_left_s == null ? "" : `, ${duration(now.doing_left_s)} left`;
  const doing = now.doing && now.doing !== now.state ? `${now.doing}${left}` : "";
  const refill = !now.refill_hopper ? "" : now.state === "refilling"
    ? `Hopper ${now.refill_hopper} may be opened and filled.` : `Hopper ${now.refill_hopper} is to be refilled: do not open it yet.`;
  $("doing").textContent = [now.held_by && `held by: ${now.held_by}`, doing, refill].filter(Boolean).join(". ");
  $("done").value = now.total_s ? Math.min(1, now.done_s / now.total_s) : 0;
  const rows = [
    ["layer", now.layer == null ? `– of ${now.layers ?? "–"}` : `${now.layer} of ${now.layers}`],
    ["program line", `${now.line ?? "–"} of ${now.lines ?? "–"}, sent to ${now.sent_line ?? "–"}`],
    ["time left", now.remaining_s == null ? "–" : `${duration(now.remaining_s)} (planned)`],
    ["override", now.override_percent == null ? "–" : `${now.override_percent} %`],
    ["machine", now.machine ?? ""], ["operator", now.operator || "–"],
  ];
  if (now.live && now.beam_off) rows.push(["beam", "stays off in this run"]);
  fill($("place"), rows.flatMap(([name, text]) => [element("dt", name), element("dd", text)]));
  fill($("next"), (now.next ?? []).map((one) => {
    const item = element("li");
    item.append(element("code", one.command), ` ${one.does}`);
    return item;
  }));
}

export function showAlarms(now) {
  const items = [
    ...now.alarms.map((one, i) => note(one, i ? "then" : "cause", one.cleared_s == null ? "" : "cleared")),
    ...now.warnings.map((one) => note(one, "warning", "warning")),
  ];
  fill($("alarms"), items.length ? items : [element("li", "none", { class: "none" })]);
}

function note(one, role, kind) {
  const item = element("li", null, { class: kind });
  item.append(element("b", `${role}: ${one.what}${kind === "cleared" ? " (over)" : ""}`));
  if (one.hint) item.append(element("span", `What to do: ${one.hint}`));
  return item;
}

export function showInterlocks(now) {
  fill($("interlocks"), now.interlocks.length ? now.interlocks.map((row) => {
    const item = element("li", null, { "data-state": row.state });
    item.append(element("b", row.name), element("span", row.what || row.state));
    return item;
  }) : [element("li", "not read yet", { "data-state": "not fitted" })]);
}

export function showValues(now, extraAgeS) {
  const [x, y, z] = now.position_mm ?? [];
  const mixture = now.mixture ?? { materials: [], origins: {} };
  const text = (fractions) => fractions == null ? "–"
    : fractions.map((one, i) => `${mixture.materials[i]} ${one.toFixed(3)}`).join(", ");
  const ofHopper = (i) => now.origins.measured_g_min
    && { ...now.origins.measured_g_min, age_s: now.reading_age_s?.[i] };
  const rows = [
    ["power", fixed(now.power_W, 0, "W"), now.origins.power_W],
    ["speed", fixed(now.speed_mm_s, 1, "mm/s"), now.origins.speed_mm_s],
    ["nozzle", now.position_mm ? `X ${x.toFixed(2)} Y ${y.toFixed(2)} Z ${z.toFixed(2)} mm` : "–", now.origins.position_mm],
    ["mixture designed", text(mixture.designed), mixture.origins.designed],
    ["mixture planned", text(mixture.planned), mixture.origins.planned],
    ["mixture commanded", text(mixture.commanded), mixture.origins.commanded],
    ["mixture at nozzle", text(mixture.nozzle), mixture.origins.nozzle],
    ["shield gas", fixed(now.shield_gas_L_min, 1, "L/min"), now.origins.shield_gas_L_min],
    ...now.hoppers.flatMap((name, i) => [
      [`${name} commanded`, fixed(now.set_g_min?.[i], 2, "g/min"), now.origins.set_g_min],
      [`${name} reported`, fixed(now.measured_g_min?.[i], 2, "g/min"), ofHopper(i)],
      [`${name} carrier gas`, fixed(now.carrier_L_min?.[i], 1, "L/min"), ofHopper(i)],
    ]),
  ];
  fill($("values").tBodies[0], rows.map(([name, value, origin]) => {
    const age = origin?.age_s == null ? null : origin.age_s + extraAgeS;
    const row = element("tr", null, age != null && age > OLD_S + 4 ? { class: "old" } : {});
    const by = origin ? `${origin.kind}${age == null ? "" : `, ${age < 10 ? age.toFixed(1) : age.toFixed(0)} s`}` : "";
    row.append(element("td", name), element("td", value),
      element("td", by, { class: "origin", title: origin?.source ?? "" }));
    return row;
  }));
  fill($("hoppers"), now.levels.length ? now.levels.map((one) => {
    const box = element("div", null, { class: "hopper" });
    const grams = one.weight_g == null ? "" : `${(one.weight_g / 1000).toFixed(2)} kg`;
    const level = one.level_percent == null ? "" : `${one.level_percent.toFixed(0)} %`;
    box.append(element("span", `${one.hopper}: ${[level, grams].filter(Boolean).join(", ")}`));
    if (one.level_percent != null) box.append(element("progress", null, {
      max: 100, value: one.level_percent, "aria-label": `Level of hopper ${one.hopper}` }));
    return box;
  }) : [element("p", "no level reported", { class: "note" })]);
}

export function showEvents(events) {
  fill($("events"), events.slice(-100).reverse().map((one) => {
    const item = element("li");
    item.append(element("time", `${one.t.toFixed(1)} s`), describe(one));
    return item;
  }));
}

function describe(one) {
  switch (one.kind) {
    case "state": return `${one.from} → ${one.to} (${one.event})`;
    case "operator": return `${one.operator || "operator"}: ${one.act}${one.accepted ? "" : ` refused: ${one.refused}`}`;
    case "alarm": return `alarm: ${one.what}`;
    case "alarm_cleared": return `over: ${one.what} (${one.how})`;
    case "warning": return `${one.active ? "warning" : "no longer"}: ${one.what}`;
    case "fault": return `fault: ${one.what}`;
    case "override": return `override ${one.feed_percent} % (${one.source})`;
    case "refill": return `hopper ${one.hopper} refilled, lot ${one.lot}, ${one.mass_g} g`;
    case "height": return one.height_mm == null ? `height after layer ${one.layers} not measured`
      : `height after layer ${one.layers}: ${one.height_mm} mm, powder × ${one.volume_factor}`;
    case "entry": return `enters layer ${one.layer + 1} again; ${one.repeated_mm.toFixed(2)} mm deposited again`;
    case "place": return `deposition ended at line ${one.line} (${one.known})`;
    case "layer_opened": return `layer ${one.layer + 1} begins`;
    case "seal": return `run ended: ${one.state}`;
    default: return one.kind.replaceAll("_", " ");
  }
}
