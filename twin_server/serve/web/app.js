// The list of twins is asked for again and again and tells whether the server is there; the twins
// on screen follow their live streams. A browser allows a server six connections over all its
// tabs: so two streams at most, none in a hidden tab, and what more is on screen is asked for.
import { plotly } from "./charts.js";
import { Panel } from "./panel.js";
import { Twin } from "./twin.js";
import { ask, make, say } from "./words.js";

const LIST_MS = 2000, DRAW_MS = 700, STREAMS = 2;
const $ = (id) => document.getElementById(id);
const panels = new Map(), onScreen = new Set(), links = new Map(), drawnKeys = new Set();
let lostAt = null, asking = false, drawing = false, arrivedAt = null;

function listen(twin) {
  const stream = new EventSource(`${twin.base}/live`);
  stream.addEventListener("open", () => twin.load());
  stream.addEventListener("error", refresh);
  stream.addEventListener("state", (message) => twin.arrive(JSON.parse(message.data)));
  stream.addEventListener("event", (message) => twin.happen(JSON.parse(message.data)));
  stream.addEventListener("reset", () => twin.load());
  return stream;
}

const watcher = new IntersectionObserver((entries) => {
  for (const entry of entries) entry.isIntersecting ? onScreen.add(entry.target.id) : onScreen.delete(entry.target.id);
  follow();
}, { rootMargin: "100px" });

const visible = () => [...panels.values()].filter((panel) => onScreen.has(panel.twin.id));

function follow() {
  const shown = document.hidden || lostAt ? [] : visible(), followed = new Set(shown.slice(0, STREAMS));
  for (const panel of panels.values()) followed.has(panel) ? panel.twin.watch() : panel.twin.unwatch();
  for (const panel of shown) {
    if (!followed.has(panel)) panel.twin.catchUp();
    panel.twin.foresee();
    panel.diagnosis.refresh();
  }
}

function add(id) {
  const panel = new Panel(new Twin(id, listen)), item = make("li"), link = make("a"), dot = make("span", "", "dot");
  link.href = `#${id}`;
  link.append(dot, make("span", id));
  item.append(link);
  panels.set(id, panel);
  links.set(id, { item, link, dot });
  $("twins").append(item);
  $("panels").append(panel.root);
  watcher.observe(panel.root);
  return panel;
}

function remove(id) {
  const panel = panels.get(id);
  panel.twin.unwatch();
  watcher.unobserve(panel.root);
  panel.root.remove();
  links.get(id).item.remove();
  for (const kept of [panels, links, onScreen]) kept.delete(id);
}

function list(twins) {
  const there = new Set(twins.map((twin) => twin.id));
  for (const id of [...panels.keys()]) if (!there.has(id)) remove(id);
  for (const state of twins) {
    const panel = panels.get(state.id) ?? add(state.id), { twin } = panel, { link, dot } = links.get(state.id);
    twin.hear(state);
    panel.tell();
    link.lastChild.textContent = state.registration.name || state.id;
    say(dot, state.alive ? "good" : "away", "");
    link.title = state.alive ? "edge agent is there" : "edge agent is away";
  }
  $("empty").hidden = twins.length > 0;
  $("legend").hidden = $("index").hidden = twins.length === 0;
  const wanted = decodeURIComponent(location.hash.slice(1));
  $("unknown").hidden = !wanted || there.has(wanted);
  $("unknown").textContent = `No twin is called ${wanted}. Choose one of those below, or register it with `
    + `PUT /api/v1/twins/${wanted}.`;
  if (there.has(wanted) && arrivedAt !== wanted) $(wanted).scrollIntoView();
  arrivedAt = wanted;
}

/** The token is shown to the server once, which has the browser keep it where no script reads it. */
async function enter(event) {
  event.preventDefault();
  const headers = { Authorization: `Bearer ${$("token").value.trim()}` };
  $("token").value = "";
  const answer = await fetch("/api/v1/session", { method: "POST", headers }).catch(() => null);
  $("not-admitted").textContent = answer?.ok ? "" : (await answer?.json())?.detail ?? "The server does not answer.";
  if (answer?.ok) refresh();
}

function whoAsks() {
  for (const panel of panels.values()) panel.twin.unwatch();
  $("who").hidden = false;
  say($("connection"), "waiting", "waits for a token");
}

async function refresh() {
  if (asking) return;
  asking = true;
  try {
    list((await ask("/api/v1/twins")).twins);
    if (lostAt) for (const panel of panels.values()) panel.twin.unwatch();
    lostAt = null;
    say($("connection"), "good", "live");
    $("who").hidden = true;
  } catch (error) {
    if (error.status === 401) return whoAsks();
    lostAt ??= new Date();
    const said = [
      error.status ? `The server answers with an error: ${error.message}` : "Connection lost, trying again.",
      panels.size ? `What you see was known at ${lostAt.toLocaleTimeString()}.` : "",
      "If this lasts, look whether the twin server runs: slowtime twin",
    ];
    $("lost").textContent = said.filter(Boolean).join(" ");
    say($("connection"), "bad", "connection lost, trying again");
  } finally { asking = false; }
  $("lost").hidden = !lostAt;
  follow();
}

async function draw() {
  for (const panel of panels.values()) panel.tick();
  if (drawing || document.hidden) return;
  drawing = true;
  for (const panel of visible().filter((each) => each.twin.dirty)) {
    panel.twin.dirty = false;
    panel.tell();
    const found = await panel.draw().catch(() => ({}));
    for (const key of Object.keys(found)) if (found[key]) drawnKeys.add(key);
  }
  for (const key of document.querySelectorAll("#legend [data-key]")) key.hidden = !drawnKeys.has(key.dataset.key);
  drawing = false;
}

plotly.catch((error) => { $("undrawn").textContent = error.message; $("undrawn").hidden = false; });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const panel of panels.values()) panel.twin.dirty = true;
});
document.addEventListener("visibilitychange", () => { document.hidden ? follow() : refresh(); });
addEventListener("hashchange", refresh);
setInterval(() => { if (!document.hidden) refresh(); }, LIST_MS);
$("token-form").addEventListener("submit", enter);
setInterval(draw, DRAW_MS);
refresh().then(draw);
