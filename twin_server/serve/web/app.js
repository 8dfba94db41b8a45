"use strict";
// History at load, then the live stream; a `reset`, or a gap, fetches the history again.
const MAX_POINTS = 2000, REDRAW_MS = 400, LIST_MS = 3000, FORECAST_MS = 15000;
const $ = (id) => document.getElementById(id);
const shown = { id: null, points: [], forecast: null, events: [], stream: null };
let dirty = false, generation = 0;

async function ask(path) {
  const answer = await fetch(path, { headers: { Accept: "application/json" } });
  const body = await answer.json();
  if (!answer.ok) throw new Error(body.detail || answer.statusText);
  return body;
}

function say(element, state, text) { element.dataset.state = state; element.textContent = text; }
function make(tag, text, name) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (name) element.className = name;
  return element;
}
const percent = (x, digits = 2) => `${(100 * x).toFixed(digits).replace("-", "−")} %`;
function digits(sd) { return sd > 0 ? Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(sd)))) : 3; }
const places = (estimate) => Math.min(4, digits(100 * estimate.sd));

// Slow time in seconds since 1970 is drawn as dates; any other slow time as the number it is.
const isClock = (point) => point.slow_time_unit === "s" && Math.abs(point.slow_time - point.t_ns / 1e9) < 1e6;
let clock = false;
const axis = (slow) => clock ? new Date(1000 * slow) : slow;
function when(event) {
  if (event.kind === "registered" || event.slow_time === null) return new Date(event.t_ns / 1e6).toLocaleTimeString();
  return clock ? new Date(1000 * event.slow_time).toLocaleString() : `t_s ${event.slow_time.toPrecision(6)}`;
}

function summary(twin) {
  const parts = [];
  if (twin.frequency_hz) parts.push(`${twin.frequency_hz.value.toPrecision(4)} Hz`);
  if (twin.stiffness_change && !twin.assumed.includes("stiffness_change")) parts.push(`k ${percent(twin.stiffness_change.value, 1)}`);
  if (twin.mass_change && !twin.assumed.includes("mass_change")) parts.push(`m ${percent(twin.mass_change.value, 1)}`);
  return parts.join(" · ") || "no features yet";
}

async function refreshList() {
  let twins;
  try { twins = (await ask("/api/v1/twins")).twins; } catch (error) { say($("connection"), "bad", "server away"); return; }
  const list = $("twins");
  list.replaceChildren(...twins.map((twin) => {
    const item = make("li"), button = make("button"), who = make("div", undefined, "who"), dot = make("span", "", "dot");
    dot.dataset.state = twin.alive ? "good" : "away";
    dot.title = twin.alive ? "edge agent is there" : "edge agent is away";
    who.append(dot, twin.registration.name || twin.id);
    button.append(who, make("div", summary(twin), "what"));
    button.setAttribute("aria-current", String(twin.id === shown.id));
    button.addEventListener("click", () => { location.hash = twin.id; });
    item.append(button);
    return item;
  }));
  const wanted = decodeURIComponent(location.hash.slice(1));
  const chosen = twins.find((twin) => twin.id === wanted) || twins.find((twin) => twin.id === shown.id) || twins[0];
  if (chosen && chosen.id !== shown.id) { await show(chosen.id); }
  const current = twins.find((twin) => twin.id === shown.id);
  if (current) {
    $("name").textContent = current.registration.name || current.id;
    say($("edge"), current.alive ? "good" : "waiting", current.alive ? "edge agent is there" : "edge agent is away");
  }
}

async function load(id) {
  const mine = ++generation;
  const base = `/api/v1/twins/${id}`;
  const [history, events] = await Promise.all([ask(`${base}/history?max_points=${MAX_POINTS}`), ask(`${base}/events?limit=50`)]);
  if (mine !== generation) return;
  shown.points = history.points;
  shown.events = events.events;
  dirty = true;
  refreshForecast();
}

async function refreshForecast() {
  const id = shown.id;
  if (!id || document.hidden) return;
  try {
    const forecast = await ask(`/api/v1/twins/${id}/forecast?points=40`);
    if (id === shown.id) { shown.forecast = forecast.points.length ? forecast : null; dirty = true; }
  } catch (error) { shown.forecast = null; }
}

async function show(id) {
  if (shown.stream) shown.stream.close();
  Object.assign(shown, { id, points: [], forecast: null, events: [] });
  for (const button of document.querySelectorAll("nav button")) button.setAttribute("aria-current", "false");
  try { await load(id); } catch (error) { say($("connection"), "bad", error.message); }
  listen(id);
}

function listen(id) {
  const stream = shown.stream = new EventSource(`/api/v1/twins/${id}/live`);
  stream.addEventListener("open", () => say($("connection"), "good", "live"));
  stream.addEventListener("error", () => say($("connection"), "waiting", "reconnecting"));
  stream.addEventListener("state", (message) => {
    const point = JSON.parse(message.data), last = shown.points.at(-1);
    if (last && point.boot === last.boot && point.sequence <= last.sequence) return;
    shown.points.push(point);
    if (shown.points.length > 2 * MAX_POINTS) reload(id);
    dirty = true;
  });
  stream.addEventListener("event", (message) => {
    const event = JSON.parse(message.data);
    if (shown.events.some((other) => other.number === event.number)) return;
    shown.events.push(event);
    dirty = true;
  });
  stream.addEventListener("reset", () => reload(id));
}

let reloading = null;
function reload(id) {
  clearTimeout(reloading);
  reloading = setTimeout(() => { if (id === shown.id) load(id).catch(() => {}); }, 500);
}

function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim(); }
function clear(hex, alpha) { return hex + Math.round(255 * alpha).toString(16).padStart(2, "0"); }

function band(x, lo, hi, tint, alpha) {
  const edge = { x, mode: "lines", line: { width: 0 }, hoverinfo: "skip", connectgaps: false };
  return [{ ...edge, y: lo }, { ...edge, y: hi, fill: "tonexty", fillcolor: clear(tint, alpha) }];
}

// A lost range breaks the line: a null between two points that have features missing between them.
function series(name, scale) {
  const x = [], y = [], lo = [], hi = [], off = [], text = [];
  for (const point of shown.points) {
    const at = axis(point.slow_time);
    if (point.missing_before > 0 && x.length) { for (const s of [y, lo, hi, off]) s.push(null); x.push(at); text.push(""); }
    const e = point[name];
    x.push(at);
    y.push(e && scale * e.value); lo.push(e && scale * e.lo); hi.push(e && scale * e.hi);
    off.push(e && !point.valid ? scale * e.value : null);
    text.push(e ? `${(scale * e.value).toPrecision(5)} [${(scale * e.lo).toPrecision(5)}, ${(scale * e.hi).toPrecision(5)}]` : "");
  }
  return { x, y, lo, hi, off, text };
}

function truthOf(name, scale) {
  const known = shown.points.filter((point) => point.truth && name in point.truth);
  if (!known.length) return [];
  return [{ x: known.map((p) => axis(p.slow_time)), y: known.map((p) => scale * p.truth[name]), mode: "lines",
    line: { color: colour("truth"), width: 1.5, dash: "dash" }, hovertemplate: "truth %{y:.5g}<extra></extra>" }];
}

function drawChange(id, name, scale, tint, ahead) {
  const last = shown.points.at(-1), assumed = last && last.assumed.includes(name);
  const s = series(name, scale), traces = [];
  if (!assumed) {
    traces.push(...band(s.x, s.lo, s.hi, tint, 0.25));
    traces.push({ x: s.x, y: s.y, text: s.text, mode: "lines", line: { color: tint, width: 1.6 }, hovertemplate: "%{text}<extra></extra>" });
    traces.push({ x: s.x, y: s.off, mode: "markers", marker: { color: colour("invalid"), size: 4 }, hoverinfo: "skip" });
  }
  if (ahead && shown.forecast && shown.forecast.points[0][name]) {
    const x = shown.forecast.points.map((p) => axis(p.slow_time)), e = shown.forecast.points.map((p) => p[name]), c = colour("ahead");
    traces.push(...band(x, e.map((v) => scale * v.lo), e.map((v) => scale * v.hi), c, 0.25));
    traces.push({ x, y: e.map((v) => scale * v.value), mode: "lines", line: { color: c, width: 1.6 }, hovertemplate: "forecast %{y:.4g}<extra></extra>" });
  }
  traces.push(...truthOf(name, scale));
  plot(id, traces, assumed && "assumed not to change", last);
}

function drawFrequency() {
  const s = series("frequency_hz", 1), few = s.x.length <= 250, tint = colour("estimate"), traces = [];
  if (!few) traces.push(...band(s.x, s.lo, s.hi, tint, 0.25));
  traces.push({ x: s.x, y: s.y, text: s.text, mode: few ? "markers" : "lines", line: { color: tint, width: 1.2 }, marker: { color: tint, size: 4 },
    error_y: few ? { type: "data", symmetric: true, array: s.y.map((v, i) => v === null ? 0 : s.hi[i] - v), color: clear(tint, 0.5), width: 0, thickness: 1.2 } : undefined,
    hovertemplate: "%{text} Hz<extra></extra>" });
  traces.push(...truthOf("frequency_hz", 1));
  plot("plot-frequency", traces, null, shown.points.at(-1));
}

function plot(id, traces, note, last) {
  const ink = colour("ink"), line = colour("line");
  const unit = last && !clock ? `slow time [${last.slow_time_unit}]` : "";
  const layout = {
    margin: { l: 56, r: 10, t: 8, b: unit ? 38 : 26 }, showlegend: false, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: ink, size: 12, family: "system-ui, sans-serif" }, uirevision: shown.id,
    xaxis: { gridcolor: line, zeroline: false, title: { text: unit, standoff: 6 } }, yaxis: { gridcolor: line, zerolinecolor: line, automargin: true },
    annotations: note ? [{ text: note, showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.8, font: { color: colour("faint"), size: 14 } }] : [],
  };
  Plotly.react($(id), traces, layout, { responsive: true, displayModeBar: false });
}

function tile(name, main, small) {
  const box = make("div"), value = make("dd", main);
  value.append(make("small", small));
  box.append(make("dt", name), value);
  return box;
}

function drawTiles() {
  const last = shown.points.at(-1);
  if (!last) { $("tiles").replaceChildren(); say($("validity"), "waiting", "no features yet"); $("reasons").replaceChildren(); return; }
  const f = last.frequency_hz, z = last.damping_ratio, tiles = [];
  tiles.push(tile("Natural frequency", f ? `${f.value.toFixed(digits(f.sd))} Hz` : "–", f ? `± ${f.sd.toPrecision(2)}, ${last.frequency_used}` : "no mode found"));
  for (const [name, label] of [["stiffness_change", "Stiffness change"], ["mass_change", "Mass change"]]) {
    const e = last[name], assumed = last.assumed.includes(name);
    tiles.push(tile(label, e ? (assumed ? "none" : percent(e.value, places(e))) : "–",
      assumed ? "assumed" : e ? `± ${(100 * e.sd).toFixed(places(e))}; 95 %: ${percent(e.lo, places(e))} to ${percent(e.hi, places(e))}` : "not yet"));
  }
  tiles.push(tile("Damping ratio", z ? percent(z.value) : "–", z ? `± ${percent(z.sd)}` : "not identified"));
  tiles.push(tile("Slow time", clock ? new Date(1000 * last.slow_time).toLocaleTimeString() : last.slow_time.toPrecision(6), clock ? "" : last.slow_time_unit));
  $("tiles").replaceChildren(...tiles);
  say($("validity"), last.valid ? "good" : "bad", last.valid ? "valid" : "not valid");
  $("reasons").replaceChildren(...last.reasons.map((reason) => make("li", reason)));
}

function drawEvents() {
  const latest = shown.events.slice(-30).reverse();
  $("events").replaceChildren(...(latest.length ? latest : [null]).map((event) => {
    if (!event) return make("li", "None yet.", "none");
    const item = make("li");
    item.dataset.severity = event.severity;
    item.append(make("span", when(event), "when"), event.message);
    return item;
  }));
}

function draw() {
  if (!dirty || document.hidden) return;
  dirty = false;
  const last = shown.points.at(-1);
  clock = Boolean(last && isClock(last));
  drawTiles();
  drawFrequency();
  drawChange("plot-stiffness", "stiffness_change", 100, colour("estimate"), true);
  drawChange("plot-mass", "mass_change", 100, colour("mass"), true);
  drawEvents();
}

addEventListener("hashchange", () => { const id = decodeURIComponent(location.hash.slice(1)); if (id && id !== shown.id) show(id).then(refreshList); });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { dirty = true; });
document.addEventListener("visibilitychange", () => { if (!document.hidden) { dirty = true; refreshForecast(); } });
setInterval(draw, REDRAW_MS);
setInterval(() => { if (!document.hidden) refreshList(); }, LIST_MS);
setInterval(refreshForecast, FORECAST_MS);
refreshList();
