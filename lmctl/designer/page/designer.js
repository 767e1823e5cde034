// The designer's page: asks the server for what each movement changes, and draws what it answers.
import { NumberList } from "/page/numbers.js";
import { SurfaceView } from "/page/surface_view.js";

const token = new URLSearchParams(location.hash.slice(1)).get("token") || "";
const at = (id) => document.getElementById(id);
const surface = new SurfaceView(at("surface"), at("surface-note"));
const numbers = new NumberList(at("numbers"), (path, value, continuing) =>
  edit("adjust", { path, value, continuing }));
let view = { axis: 2, at_mm: 0 };
let state = null;
let busy = false;
let next = null;

async function ask(name, given) {
  const asked = { headers: { Authorization: `Bearer ${token}` } };
  if (given !== undefined) {
    asked.method = "POST";
    asked.headers["Content-Type"] = "application/json";
    asked.body = JSON.stringify(given);
  }
  let answer;
  try {
    answer = await fetch(`/api/${name}`, asked);
  } catch {
    throw new Error("the designer does not answer: is `lmctl design` still running?");
  }
  const data = await answer.json();
  if (!answer.ok) throw new Error([data.error, ...data.where, data.hint].filter(Boolean).join("\n"));
  return data;
}

// One request at a time; of movements that come meanwhile only the last is sent.
async function edit(name, given) {
  if (busy) { next = [name, given]; return; }
  busy = true;
  try {
    show(await ask(name, { ...view, ...given }));
    refuse("");
  } catch (error) {
    refuse(error.message);
    numbers.show(state.numbers);
  }
  busy = false;
  if (next) { const [then, what] = next; next = null; edit(then, what); }
}

function refuse(text) {
  at("error").textContent = text;
  at("error").hidden = text === "";
}

function show(answer) {
  if (answer.state) showState(answer.state);
  if (answer.section) showSection(answer.section);
  if (answer.colours) surface.setColours(answer.colours);
  if (answer.solid_changed) loadSurfaceSoon();
}

let surfaceTimer = 0;
function loadSurfaceSoon() {
  clearTimeout(surfaceTimer);
  surfaceTimer = setTimeout(async () => {
    try { surface.setMesh(await ask("surface")); } catch (error) { refuse(error.message); }
  }, 250);
}

function showState(found) {
  state = found;
  at("name").textContent = found.name;
  at("file").textContent = found.file;
  at("text").textContent = found.text;
  at("undo").disabled = !found.can_undo;
  at("redo").disabled = !found.can_redo;
  at("save").disabled = found.saved;
  at("saved").textContent = found.saved ? "saved" : "not saved";
  numbers.show(found.numbers);
}

function showSection(section) {
  at("section").src = `data:image/png;base64,${section.png}`;
  const [u, v] = section.axes;
  const range = (name, k) => `${name} ${section.low_mm[k].toFixed(1)} to ${section.high_mm[k].toFixed(1)} mm`;
  at("section-size").textContent = `${range(u, 0)} to the right, ${range(v, 1)} upwards`;
}

function showMaterials(materials) {
  at("materials").replaceChildren(...materials.map(({ name, colour }) => {
    const item = document.createElement("li"), swatch = document.createElement("canvas");
    swatch.width = swatch.height = 8;
    const draw = swatch.getContext("2d");
    draw.fillStyle = `rgb(${colour.join(",")})`;
    draw.fillRect(0, 0, 8, 8);
    item.append(swatch, name);
    return item;
  }));
}

function setAxis(axis) {
  const slider = at("at"), low = state.low_mm[axis], high = state.high_mm[axis];
  slider.min = low; slider.max = high; slider.step = (high - low) / 200;
  slider.value = (low + high) / 2;
  setView();
}

function setView() {
  view = { axis: Number(at("axis").value), at_mm: Number(at("at").value) };
  at("at-value").textContent = `${view.at_mm.toFixed(2)} mm`;
  return edit("section", {});
}

async function plan() {
  const asked = at("layer").value;
  at("planning").textContent = "planning …";
  at("plan").disabled = true;
  try {
    const found = await ask("verdict", { layer: asked === "" ? null : Number(asked) });
    at("layer").value = found.layer;
    at("layers").textContent = `of ${found.layers}`;
    const lines = [
      ["ok", `built ${(100 * found.built_fraction).toFixed(1)} % of this layer inside its surface, ` +
             `${(100 * found.surplus_fraction).toFixed(1)} % beside it; ${found.duration_s.toFixed(0)} s`],
      ...found.findings.map((one) => [one.level, one.text]),
      ...found.warnings.map((text) => ["warning", text]),
    ];
    at("findings").replaceChildren(...lines.map(([level, text]) => {
      const item = document.createElement("li");
      item.className = level;
      item.textContent = level === "warning" ? `warning: ${text}` : text;
      return item;
    }));
    at("layer-picture").src = `data:image/png;base64,${found.picture}`;
    at("layer-picture").hidden = false;
    refuse("");
  } catch (error) {
    refuse(error.message);
  }
  at("planning").textContent = "";
  at("plan").disabled = false;
}

at("undo").onclick = () => edit("undo", {});
at("redo").onclick = () => edit("redo", {});
at("save").onclick = () => edit("save", {});
at("plan").onclick = plan;
at("axis").onchange = () => setAxis(Number(at("axis").value));
at("at").oninput = setView;
document.addEventListener("keydown", (event) => {
  const key = event.ctrlKey || event.metaKey ? event.key.toLowerCase() : "";
  const act = { z: event.shiftKey ? "redo" : "undo", y: "redo", s: "save" }[key];
  if (!act) return;
  event.preventDefault();
  if (!at(act).disabled) edit(act, {});
});
addEventListener("beforeunload", (event) => { if (state && !state.saved) event.preventDefault(); });

try {
  showState((await ask("design")).state);
  showMaterials(state.materials);
  await setAxis(2);
  surface.setMesh(await ask("surface"));
} catch (error) {
  refuse(error.message);
}
