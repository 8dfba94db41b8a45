// One view at a time: the fleet, a twin, recordings. The list of twins is asked for again and again and
// tells whether the server is there; the twin on screen follows its live stream, unless the tab is hidden.
import { Fleet } from "./fleet.js";
import { language, locale, offerLanguages, parts, t, translate } from "./language.js";
import { ask } from "./link.js";
import { Panel } from "./panel.js";
import { Recordings } from "./recordings.js";
import { where } from "./route.js";
import { Twin } from "./twin.js";
import { UnderWay } from "./under_way.js";
import { composed, explain, make, say } from "./words.js";

const LIST_MS = 2000, DRAW_MS = 500, REST = 2;
const $ = (id) => document.getElementById(id);
const fleet = new Fleet(), recordings = new Recordings(), underWay = new UnderWay();
let scope = null, place = where(location.hash), panel = null, known = null, lostAt = null, asking = false, drawing = false, telling = false;

/** Words as soon as they are known, once a frame; drawings follow in their own time, the first ones at once. */
function changed() {
  if (telling) return;
  telling = true;
  requestAnimationFrame(() => {
    telling = false;
    panel?.tell();
    if (panel?.twin.points.length && !panel.isDrawn) draw();
  });
}

/** Only an address that is new moves the instant: while somebody travels, the address still says the last halt. */
function enter(arrived = false) {
  place = where(location.hash);
  const ofTwin = place.id !== null, state = known?.find(({ id }) => id === place.id);
  if (panel && !(state && panel.twin.id === place.id)) {
    panel.close();
    panel = null;
  }
  if (state && !panel) {
    panel = new Panel(new Twin(place.id, changed));
    arrived = true;
    $("view").append(panel.root);
  }
  if (panel) {
    panel.twin.hear(state);
    panel.show(place.view, arrived ? place.at : null);
  }
  fleet.root.hidden = place.view !== "fleet" || !known?.length;
  recordings.root.hidden = underWay.root.hidden = place.view !== "recordings";
  if (place.view === "recordings") for (const each of [recordings, underWay]) each.refresh();
  if (place.view === "fleet" && known) fleet.hear(known);
  $("empty").hidden = place.view !== "fleet" || known === null || known.length > 0;
  $("legend").hidden = !panel || place.view !== "state";
  $("unknown").hidden = !ofTwin || Boolean(state) || known === null;
  $("unknown").textContent = t("app.unknown_twin", { id: place.id });
  for (const link of document.querySelectorAll("header nav a")) {
    link.dataset.view === place.view ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current");
  }
  document.title = ofTwin ? `${place.id} \u00b7 slowtime` : "slowtime";
  follow();
}

function follow() {
  if (!panel) return;
  if (document.hidden || lostAt) return panel.twin.unwatch();
  panel.twin.watch();
  panel.twin.foresee();
  panel.diagnosis.refresh();
}

/** The token is shown to the server once, which has the browser keep it where no script reads it. */
async function identify(event) {
  event.preventDefault();
  const headers = { Authorization: `Bearer ${$("token").value.trim()}` };
  $("token").value = "";
  const answer = await fetch("/api/v1/session", { method: "POST", headers }).catch(() => null);
  const { detail } = answer?.ok ? { detail: "" } : await answer?.json().catch(() => ({})) ?? {};
  explain($("not-admitted"), { message: detail ?? t("app.no_answer"), status: detail && answer.status });
  if (answer?.ok) refresh();
}

/** Those who may only look are shown no buttons that the server would refuse. */
async function learnScope() {
  scope = "asked";
  scope = await ask("/api/v1/session").then((told) => told.scope, () => null);
  document.documentElement.dataset.scope = scope ?? "";
}

function whoAsks() {
  scope = null;
  panel?.twin.unwatch();
  $("who").hidden = false;
  say($("connection"), "waiting", t("app.token_needed"));
}

async function refresh() {
  if (asking) return;
  asking = true;
  try {
    known = (await ask("/api/v1/twins")).twins;
    if (lostAt) panel?.twin.unwatch();
    lostAt = null;
    say($("connection"), "good", t("app.live"));
    $("who").hidden = true;
    if (!scope) learnScope();
  } catch (error) {
    if (error.status === 401) return whoAsks();
    lostAt ??= new Date();
    const why = error.status ? parts("app.server_error", { why: composed("span", error.message) }) : [t("app.connection_lost")];
    const since = known ? [" ", t("app.known_at", { time: lostAt.toLocaleTimeString(locale) })] : [];
    $("lost").replaceChildren(...why, ...since, " ", t("app.look_at_server"));
    say($("connection"), "bad", t("app.reconnecting"));
  } finally { asking = false; }
  $("lost").hidden = !lostAt;
  enter();
}

/** A server with many twins takes a while to list them, and is left in peace for longer. */
async function keepAsking() {
  const began = performance.now();
  if (!document.hidden) await refresh();
  setTimeout(keepAsking, Math.max(LIST_MS, REST * (performance.now() - began)));
}

async function draw() {
  panel?.tick();
  if (!fleet.root.hidden) fleet.tick();
  if (drawing || document.hidden || !panel?.twin.dirty) return;
  drawing = true;
  panel.twin.dirty = false;
  panel.isDrawn ||= panel.twin.points.length > 0;
  const found = await panel.draw().catch(() => ({}));
  for (const key of document.querySelectorAll("#legend [data-key]")) key.hidden = !found[key.dataset.key];
  drawing = false;
}

document.documentElement.lang = language;
translate(document.body);
offerLanguages($("language"));
$("view").append(fleet.root, recordings.root, underWay.root);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => panel?.twin.touch());
document.addEventListener("visibilitychange", () => { document.hidden ? follow() : refresh(); });
addEventListener("hashchange", () => { enter(true); scrollTo(0, 0); });
$("token-form").addEventListener("submit", identify);
setInterval(draw, DRAW_MS);
keepAsking();
