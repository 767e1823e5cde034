// The live page: one event stream of the chosen run, shown in panels, layer and curves.

import { authorization, openEventStream } from "./event_stream.js";
import { Curves } from "./curves.js";
import { LayerView } from "./layer_view.js";
import { Operator } from "./operator.js";
import { $, element, showAlarms, showEvents, showInterlocks, showState, showValues } from "./panels.js";

const RUNS_MS = 3000, STALE_MS = 2000;

let token = sessionStorage.getItem("lmctl-token");
const given = new URLSearchParams(location.hash.slice(1)).get("token");
if (given) setToken(given);
if (location.hash) history.replaceState(null, "", location.pathname);

let chosen = null, isChosenByHand = false, now = null, arrivedMs = 0, events = [], close = () => {};
let shownLayer = "", link = "connecting", linkReason = "";
const layer = new LayerView($("layer"));
const curves = new Curves({ mixture: $("curve-mixture"), process: $("curve-process"), powder: $("curve-powder") });
const operator = new Operator(token, (one) => { setToken(one); if (chosen) follow(chosen); });

function setToken(one) { token = one; sessionStorage.setItem("lmctl-token", one); }

// A page started anew has another token; looking on may need none.
function forgetToken() {
  token = null;
  sessionStorage.removeItem("lmctl-token");
  operator.token = null;
  operator.setSeat(null);
  if (chosen) follow(chosen);
}

async function get(path) {
  const answer = await fetch(path, { headers: authorization(token) });
  const found = await answer.json();
  if (!answer.ok) throw Object.assign(new Error(found.error), { status: answer.status });
  return found;
}

function follow(run) {
  close();
  chosen = run; now = null; events = []; shownLayer = "";
  layer.show(null);
  $("run-choice").value = run;
  close = openEventStream(`/api/runs/${run}/events`, token, {
    everything({ snapshot, points, events: first }) {
      events = first;
      curves.replace(points, { hoppers: snapshot.hoppers, materials: snapshot.mixture?.materials ?? [] });
      showEvents(events);
      take(snapshot);
    },
    snapshot: take,
    points(more) { curves.add(more); },
    events(more) { events = events.concat(more).slice(-200); showEvents(events); },
  }, (state, reason = "") => { link = state; linkReason = reason; showLink(); });
}

function take(snapshot) {
  const mixtureIsNew = snapshot.mixture && !now?.mixture;
  now = snapshot;
  arrivedMs = performance.now();
  if (mixtureIsNew) curves.replace(curves.points, { hoppers: now.hoppers, materials: now.mixture.materials });
  showState(now); showAlarms(now); showInterlocks(now); showValues(now, 0);
  $("reentry-key").hidden = !now.reentry;
  layer.update(now);
  showLink();
  loadLayer();
}

async function loadLayer() {
  const number = now.reentry?.layer ?? now.layer;
  const wanted = number == null ? "" : `${now.run}/${number}`;
  if (!wanted || wanted === shownLayer) return;
  shownLayer = wanted;
  try {
    const packed = await get(`/api/runs/${now.run}/layers/${number}`);
    if (shownLayer === wanted) await layer.show(packed);
    $("layer-name").textContent = `${number} of ${now.layers}, Z ${packed.z_mm.toFixed(2)} mm`;
  } catch (error) {
    $("layer-name").textContent = `${number}: ${error.message}`;
    setTimeout(() => { if (shownLayer === wanted) shownLayer = ""; }, 2000);
  }
}

function showLink() {
  const quietMs = performance.now() - arrivedMs;
  const answerMs = (now?.answer_age_s ?? 0) * 1000 + quietMs;
  const isStale = Boolean(now) && (link === "lost" || (now.live && answerMs > STALE_MS));
  $("link").className = link === "live" && !isStale ? "live" : "lost";
  $("link").textContent = link === "lost" ? "connection lost, trying again"
    : isStale ? "no news" : !now ? "connecting" : now.live ? "live"
      : now.state === "running" ? "running, but it does not answer" : "not under way";
  $("stale").hidden = !isStale;
  $("stale").textContent = isStale
    ? `What you see is ${(answerMs / 1000).toFixed(0)} s old${linkReason ? `: ${linkReason}` : ""}. The run itself is not affected.` : "";
  operator.show(now, link === "live" && !isStale);
  if (isStale && now) showValues(now, quietMs / 1000);
}

async function refreshRuns() {
  await operator.look();
  if (token && operator.role === "none") forgetToken();
  try {
    const { runs } = await get("/api/runs");
    showRuns(runs);
    const best = runs.find((one) => one.state === "running") ?? runs[0];
    if (best && (!chosen || (!isChosenByHand && best.run !== chosen))) follow(best.run);
    if (!runs.length) { $("link").textContent = "no run yet"; }
  } catch (error) {
    if (error.status === 401) { $("link").textContent = "a token is needed: take control, or ask for the link"; }
  }
}

function showRuns(runs) {
  const options = runs.map((one) => element("option", `${one.run} ${one.state}`, { value: one.run }));
  const key = JSON.stringify([runs, chosen]);
  if ($("runs").dataset.key === key) return;
  $("runs").dataset.key = key;
  $("run-choice").replaceChildren(...options);
  if (chosen) $("run-choice").value = chosen;
  $("runs").tBodies[0].replaceChildren(...runs.map((one) => {
    const row = element("tr", null, one.run === chosen ? { class: "chosen" } : {});
    const show = element("button", one.run, { "aria-label": `Show ${one.run}` });
    show.addEventListener("click", () => { isChosenByHand = true; follow(one.run); });
    const report = element("button", "report", { "aria-label": `Report of ${one.run}` });
    report.addEventListener("click", () => download(one.run, report));
    const cells = [element("td"), element("td", one.state), element("td", one.part),
      element("td", one.started.slice(0, 16).replace("T", " ")), element("td")];
    cells[0].append(show);
    cells[4].append(report);
    row.append(...cells);
    return row;
  }));
}

async function download(run, button) {
  button.disabled = true;
  button.textContent = "…";
  $("report-result").textContent = "";
  try {
    const answer = await fetch(`/api/runs/${run}/report.html`, { headers: authorization(token) });
    if (!answer.ok) {
      const { error, hint } = await answer.json();
      throw new Error(hint ? `${error}. ${hint}` : error);
    }
    const anchor = element("a", "", { download: `report-${run}.html` });
    anchor.href = URL.createObjectURL(await answer.blob());
    anchor.click();
    URL.revokeObjectURL(anchor.href);
    button.textContent = "report";
  } catch (error) {
    button.textContent = "report";
    $("report-result").textContent = `No report of ${run}: ${error.message}`;
  }
  button.disabled = false;
}

$("run-choice").addEventListener("change", () => { isChosenByHand = true; follow($("run-choice").value); });
setInterval(showLink, 500);
setInterval(refreshRuns, RUNS_MS);
refreshRuns();
