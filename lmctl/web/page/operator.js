// The operator's seat and acts. Each act is confirmed, carries the state it was decided on, and is
// sent once: a number that only grows keeps a copy of the request from acting again.

import { $, element } from "./panels.js";
import { authorization } from "./event_stream.js";

const ALLOWED = {
  hold: ["depositing", "purging", "resuming"], resume: ["held"],
  override: ["gas", "powder", "armed", "depositing", "holding", "held", "opening", "refilling", "weighing", "purging", "resuming"],
  refill: ["depositing", "holding", "held", "refilling"],
  stop: ["connecting", "checking", "gas", "powder", "armed", "depositing", "holding", "held", "opening", "refilling",
    "weighing", "purging", "resuming", "finishing", "stopping", "tripped"],
};
// A height is asked for at a height check only; the run says so among what may come next.
const awaitsHeight = (now) => now.next.some((one) => one.command.startsWith("lmctl height"));
const isFilled = (now) => now.state === "refilling";
const TEXTS = {
  height: ["Height of the part", "The height of the part above what it stands on. The powder of the next layers follows from it."],
  hold: ["Hold the run?", "The nozzle stops on its path, beam and powder off; the position is kept. The run can be resumed."],
  resume: ["Resume the run?", "Powder comes first, the hoses are purged off the part, then motion and beam return."],
  refill: ["Refill a hopper?", "The run is held at the end of its path; then powder and gas of the hopper's feeder go off. Open it once the state is “refilling”, not before."],
  filled: ["Is the hopper filled and closed?", "It is weighed; then the run can be resumed. Lot and mass go into the journal."],
  override: ["Change the override?", "Speed, beam and powder change together, in the next travel that powder can follow."],
  stop: ["Stop the run?", "Beam and motion go off, then powder, then gas after its post-flow; a second stop skips the post-flow. This is no emergency stop."],
};

export class Operator {
  constructor(token, onToken) {
    this.token = token;
    this.onToken = onToken;
    this.seat = sessionStorage.getItem("lmctl-seat");
    this.role = "none";
    this.now = null;
    this.isLinked = false;
    $("take-seat").addEventListener("click", () => this.take());
    $("leave-seat").addEventListener("click", () => this.leave());
    for (const button of $("acts").children) button.addEventListener("click", () => this.act(button.dataset.act));
    this.update();
  }

  async request(method, path, body) {
    const answer = await fetch(path, {
      method, headers: { "Content-Type": "application/json", ...authorization(this.token),
        ...(this.seat ? { "X-Operator-Seat": this.seat } : {}) },
      ...(method === "GET" ? {} : { body: JSON.stringify(body ?? {}) }),
    });
    const found = await answer.json();
    if (!answer.ok) throw Object.assign(new Error(found.error), { status: answer.status, hint: found.hint });
    return found;
  }

  async look() {
    try {
      const session = await this.request("GET", "/api/session");
      this.role = session.role;
      this.operator = session.operator;
      if (this.seat && !session.has_seat) {
        this.setSeat(null);
        this.say(session.operator ? `${session.operator} has taken control` : "control was lost", true);
      }
    } catch { return; }  // not reached: what is shown stays
    this.update();
  }

  setSeat(key) {
    this.seat = key;
    if (key) sessionStorage.setItem("lmctl-seat", key); else sessionStorage.removeItem("lmctl-seat");
    this.update();
  }

  show(now, isLinked) {
    this.now = now;
    this.isLinked = isLinked;
    this.update();
  }

  update() {
    const state = this.now?.live && this.isLinked ? this.now.state : "";
    for (const button of $("acts").children) {
      const { act } = button.dataset;
      const isHeight = act === "height";
      button.hidden = isHeight && !(state && awaitsHeight(this.now));
      button.disabled = !this.seat || !(isHeight || ALLOWED[act].includes(state));
      if (act === "refill") button.textContent = state && isFilled(this.now) ? "Hopper filled" : "Refill hopper";
      button.title = this.seat ? (state ? "" : "no live run") : "take control first";
    }
    $("take-seat").hidden = Boolean(this.seat);
    $("leave-seat").hidden = !this.seat;
    $("seat").textContent = this.seat ? `You operate as ${this.operator || "…"}.`
      : this.operator ? `${this.operator} operates; you look on.` : "No operator has control; you look on.";
    $("who").textContent = this.seat ? `operator ${this.operator ?? ""}` : "viewer";
  }

  say(text, isRefused = false) {
    $("act-result").textContent = text;
    $("act-result").classList.toggle("refused", isRefused);
  }

  async take() {
    const fields = [["name", "Your name, for the journal", "text", localStorage.getItem("lmctl-name") ?? ""]];
    if (this.role !== "operator") fields.push(["token", "The operator's token", "password", ""]);
    const values = await ask("Take control?", "One operates at a time; what you do is journaled with your name.", fields);
    if (!values) return;
    if (values.token) { this.token = values.token.trim(); this.onToken(this.token); }
    localStorage.setItem("lmctl-name", values.name);
    try { await this.sit(values.name, false); } catch (error) {
      if (error.status !== 409 || !(await ask(`${error.message}. Take over?`, "The other operator then only looks on.", []))) {
        this.say(error.message, true);
        return;
      }
      try { await this.sit(values.name, true); } catch (again) { this.say(again.message, true); }
    }
  }

  async sit(name, takeOver) {
    const found = await this.request("POST", "/api/seat", { operator: name, take_over: takeOver });
    this.operator = found.operator;
    this.role = "operator";
    this.number = 0;
    this.setSeat(found.seat);
    this.say("you have control");
  }

  async leave() {
    try { await this.request("DELETE", "/api/seat"); } catch { /* it was lost already */ }
    this.operator = "";
    this.setSeat(null);
    this.say("control left");
  }

  async act(act) {
    const seen = this.now.state, fields = [], isClosing = act === "refill" && isFilled(this.now);
    const [title, text] = TEXTS[isClosing ? "filled" : act], hopper = this.now.refill_hopper;
    if (act === "override") fields.push(["percent", "Per cent of the plan (50 to 200)", "number", this.now.override_percent]);
    if (act === "height") fields.push(["height_mm", "Height in mm", "number", ""]);
    if (isClosing) fields.push(["lot", `Lot filled into hopper ${hopper}`, "text", ""], ["mass_g", "Mass filled in, in g", "number", ""]);
    else if (act === "refill") fields.push(["hopper", "Hopper", "choice", hopperChoices(this.now)]);
    const values = await ask(title, text, fields, act === "resume" ? preview(this.now) : [],
      act === "hold");
    if (!values) return;
    this.say(`${act} …`);
    try {
      const now = await this.request("POST", `/api/runs/${this.now.run}/acts`, {
        act, seen_state: seen, number: Date.now(),
        ...(act === "override" ? { percent: Math.round(Number(values.percent)) } : {}),
        ...(act === "height" ? { height_mm: Number(values.height_mm) } : {}),
        ...(isClosing ? { hopper, lot: values.lot.trim(), mass_g: Number(values.mass_g) }
          : act === "refill" ? { hopper: values.hopper } : {}) });
      this.say(`${act}: accepted, the run is ${now.state}`);
    } catch (error) {
      if (error.status === 403) this.setSeat(null);
      this.say(`${error.message}${error.hint ? `; ${error.hint}` : ""}`, true);
    }
  }
}

// [value, text] of each hopper, the emptiest first.
function hopperChoices(now) {
  const levelOf = (name) => now.levels.find((one) => one.hopper === name)?.level_percent ?? null;
  return now.hoppers.map((name, i) => [name, `${name} (${now.materials[i]})${
    levelOf(name) == null ? "" : `, ${levelOf(name).toFixed(0)} %`}`])
    .sort(([a], [b]) => (levelOf(a) ?? 101) - (levelOf(b) ?? 101));
}

function preview(now) {
  const entry = now.reentry;
  if (!entry) return [element("p", "Where it goes on is not known.", { class: "note" })];
  const list = element("dl");
  for (const [name, value] of [
    ["enters", `layer ${entry.layer}, program line ${entry.beam_on_line}`],
    ["beam on again at", entry.approach_mm.at(-1).map((one, i) => `${"XYZ"[i]} ${one.toFixed(2)}`).join("  ") + " mm"],
    ["run-up, beam off", `${entry.run_up_mm.toFixed(1)} mm along the path`],
    ["deposited again", `${entry.repeated_mm.toFixed(2)} mm`],
  ]) list.append(element("dt", name), element("dd", value));
  return [list, element("p", "The way there is drawn dashed in the layer.", { class: "note" })];
}

// The values of the dialog's fields, null where it was cancelled. fields : [name, label, type, value],
// of a choice [value, text] of each option;
// isUrgent : Enter confirms at once
function ask(title, text, fields, more = [], isUrgent = false) {
  const dialog = $("confirm");
  $("confirm-title").textContent = title;
  $("confirm-text").replaceChildren(element("p", text), ...more);
  $("confirm-fields").replaceChildren(...fields.map(([name, label, type, value]) => {
    const box = element("label", label), input = type === "choice" ? choice(name, value)
      : element("input", null, { name, type, value, required: "" });
    if (name === "percent") { input.min = 50; input.max = 200; input.step = 1; }
    if (name === "height_mm") { input.min = 0; input.step = "any"; }
    if (name === "mass_g") { input.min = 0.1; input.max = 1e6; input.step = "any"; }
    if (type === "text") input.maxLength = 80;
    box.append(input);
    return box;
  }));
  dialog.returnValue = "no";
  dialog.showModal();
  (fields.length ? dialog.querySelector("input, select") : $(isUrgent ? "confirm-yes" : "confirm-no")).focus();
  return new Promise((resolve) => dialog.addEventListener("close", () => {
    const values = Object.fromEntries([...dialog.querySelectorAll("input, select")].map((one) => [one.name, one.value]));
    resolve(dialog.returnValue === "yes" ? values : null);
  }, { once: true }));
}

function choice(name, options) {
  const select = element("select", null, { name });
  select.append(...options.map(([value, text]) => element("option", text, { value })));
  return select;
}

// Enter in a field confirms, as in any form; the first button of a form would cancel.
$("confirm").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && ["INPUT", "SELECT"].includes(event.target.tagName)) { event.preventDefault(); $("confirm-yes").click(); }
});
