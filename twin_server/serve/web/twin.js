// What the page knows of one twin: its history, what the live stream adds to it, and which instant is looked at.
import { isNear, stepOf } from "./buckets.js";
import { t } from "./language.js";
import { ask } from "./link.js";
import { ALL, LATEST, historyOf, partOf } from "./window.js";
import { QUANTITIES, sensorOf } from "./words.js";

const MAX_POINTS = 1000, FIRST_POINTS = 200, FORECAST_MS = 3000, PATIENCE_MS = 30000, EVENTS = 100;
/** [ms] How long a zoom rests before it is asked for more finely. Source: longer than from one step of a drag to the next. */
const REST_MS = 250;

/** All by which two states that look alike on the page are alike. */
const told = ({ boot, sequence, alive, valid, normal, raised, registration, sensor, aside }) => (
  JSON.stringify([boot, sequence, alive, valid, normal, raised, registration, sensorOf({ sensor }), aside])
);

/** The next frame: what is known by now has been drawn then, unless nobody looks. */
const framed = () => document.hidden ? null : new Promise(requestAnimationFrame);

/** Events that change what is recorded of the asset, and so its forecast. */
const RECORDED = ["asset_event", "repair_suspected"];

/** Why there is no forecast: words of the page, and of the server. */
const COMPUTING = { words: t("outlook.computing") }, RENEWED_SINCE = { words: t("outlook.renewed_since") };

const of = ({ quantity, side, limit }) => `${quantity} ${side} ${limit}`;

/** The alarms that these events have raised and not cleared. */
function raisedBy(events) {
  const raised = new Map();
  for (const { kind, details } of events) {
    if (kind === "alarm") raised.set(of(details), { quantity: details.quantity, side: details.side, limit: details.limit });
    if (kind === "alarm_cleared") raised.delete(of(details));
  }
  return [...raised.values()];
}

/** What people have told of, such as a repair, and what holds still. */
const holding = ({ events }) => events.filter(({ reverses, reversed_by: by, slow_time: time }) => reverses === null && by === null && time !== null);

/** Renewals, repairs and sudden changes of the structure; a jump that one of the former explains is no change of its own. */
function marksOf(events, points, recorded) {
  const renewed = events.filter(({ kind, slow_time }) => kind === "renewed" && slow_time !== null).map(({ slow_time }) => slow_time);
  const sudden = events.filter(({ kind }) => kind === "model_changed").map(({ details }) => details.since);
  const told = holding(recorded), jumps = told.filter(({ kind }) => kind === "repair" || kind === "replacement");
  const own = sudden.filter((since) => !isNear(since, [...renewed, ...jumps.map(({ slow_time }) => slow_time)], stepOf(points)));
  return [
    ...told.map(({ kind, quantity, slow_time }) => ({ kind: "told", text: quantity && !QUANTITIES[quantity] ? t("mark.of", { what: t(`mark.told.${kind}`), element: quantity }) : t(`mark.told.${kind}`), slow_time })),
    ...renewed.map((slow_time) => ({ kind: "renewed", slow_time })),
    ...[...new Set(own)].map((slow_time) => ({ kind: "sudden", slow_time })),
  ];
}
const isOf = (event, at) => event.slow_time === null ? event.kind === "registered" : event.slow_time <= at.slow_time;

export class Twin {
  constructor(id, changed) {
    Object.assign(this, { id, changed, latest: null, points: [], events: [], forecast: null });
    Object.assign(this, { stream: null, loading: null, arrived: null, stale: false, problem: null, dirty: true });
    Object.assign(this, { known: false, forecastAt: 0, risk: null, plan: null, at: null, foretold: null, recalled: null, unforeseen: null });
    Object.assign(this, { part: LATEST, longer: false, thinned: false, bands: null, begin: null, detail: null, recorded: { events: [], questions: [] } });
    // Held by the charts, which are given a new scene each time.
    this.zoom = { zoomed: null, to: (range) => this.zoomTo(range) };
    this.reload = () => this.load();
    this.touch = this.touch.bind(this);
  }

  get base() { return `/api/v1/twins/${encodeURIComponent(this.id)}`; }

  /** What is to be seen: all until now, or until the instant that is looked at, and apart what came after it. */
  get scene() {
    const { id, base, latest, events, forecast, risk, plan, at, unforeseen, touch, recorded, reload, zoom } = this;
    const { points, bands, thinned } = (!at && this.detail) || { points: this.shown, bands: this.bands, thinned: this.thinned };
    const marks = marksOf(events, points, recorded), renewed = new Set(marks.filter(({ kind }) => kind === "renewed").map(({ slow_time }) => slow_time));
    const common = { id, base, at, bands, marks, renewed, recorded, reload, whole: !thinned, unforeseen, touch, zoom };
    // What was foretold of the structure as it was says nothing of the renewed one.
    const old = forecast && [...renewed].some((time) => time > forecast.since);
    const now = old ? { forecast: null, unforeseen: unforeseen ?? RENEWED_SINCE } : { forecast };
    if (!at) return { ...common, latest, points, later: [], events, risk, plan, ...now };
    const seen = points.findLastIndex((point) => point.slow_time <= at.slow_time) + 1;
    const then = events.filter((event) => isOf(event, at));
    return {
      ...common, points: points.slice(0, seen), later: points.slice(Math.max(seen - 1, 0)), forecast: this.foretold,
      latest: { ...latest, ...at, normal: [], raised: raisedBy(then) }, events: then,
    };
  }

  /** The readings that are looked at: the latest, or of the whole history those that were not thinned away. */
  get shown() { return this.part !== LATEST || this.at ? this.points : this.points.slice(-MAX_POINTS); }

  /** Look at another part of the history. */
  show(part) {
    if (this.part === part) return;
    this.part = part;
    this.zoomTo(null);
    this.load();
  }

  /** Show a range of slow time on all charts, and more finely if readings were left out of it; null shows all. */
  zoomTo(range) {
    this.zoom.zoomed = range;
    clearTimeout(this.resting);
    if (!range) this.detail = null;
    else if (this.thinned) this.resting = setTimeout(() => this.fetchDetail(range), REST_MS);
    this.touch();
  }

  async fetchDetail(range) {
    const found = await partOf(this.base, range, MAX_POINTS).catch(() => null);
    if (this.zoom.zoomed !== range) return;
    this.detail = found?.points.length ? found : null;
    this.touch();
  }

  /** The latest state, from the list or the stream, whichever is newer. */
  hear(state) {
    const before = this.latest;
    if (before && before.boot === state.boot && state.sequence < before.sequence) return;
    this.latest = { ...before, ...state };
    if (!before || told(before) !== told(this.latest)) this.touch();
  }

  touch() {
    this.dirty = true;
    this.changed();
  }

  /** Each opening fetches the history, so that nothing between it and the stream is missed. */
  watch() {
    if (this.stream && this.stream.readyState !== EventSource.CLOSED) {
      if (this.problem) this.load();
      return;
    }
    const stream = this.stream = new EventSource(`${this.base}/live`);
    stream.addEventListener("open", () => this.load());
    stream.addEventListener("state", (message) => this.arrive(JSON.parse(message.data)));
    stream.addEventListener("event", (message) => this.happen(JSON.parse(message.data)));
    stream.addEventListener("reset", () => this.load());
  }

  unwatch() {
    this.stream?.close();
    this.stream = null;
  }

  arrive(point) {
    this.hear({ ...point, heard_ns: 1e6 * Date.now() });
    const last = this.points.at(-1);
    if (this.arrived) this.arrived.push(point);
    if (last && point.boot === last.boot && point.sequence <= last.sequence) return;
    this.points.push(point);
    if (this.points.length <= 2 * MAX_POINTS) return;
    if (this.part !== LATEST) this.load();
    else if (this.at) this.show(ALL);
    else [this.points, this.longer, this.thinned, this.bands] = [this.points.slice(-MAX_POINTS), true, false, null];
  }

  happen(event) {
    if (this.events.some((other) => other.number === event.number)) return;
    this.events = [...this.events, event].slice(-EVENTS);
    if (RECORDED.includes(event.kind)) {
      this.forecastAt = 0;
      this.load();
    }
    this.touch();
  }

  /** History and events anew: one request at a time, and one more if it is asked for meanwhile. */
  load() {
    if (this.loading) this.stale = true;
    else this.loading = this.fetchAll().catch((error) => { this.problem = error.message; }).finally(() => {
      this.loading = this.arrived = null;
      this.touch();
      if (this.stale) this.load();
    });
    return this.loading;
  }

  async fetchAll() {
    this.arrived = [];
    this.stale = false;
    if (!this.known) {
      this.take(await historyOf(this.base, { part: this.part, most: MAX_POINTS, points: FIRST_POINTS }));
      await framed();
    }
    const [history, events, recorded] = await Promise.all([
      historyOf(this.base, { part: this.part, most: MAX_POINTS }),
      ask(`${this.base}/events?limit=${EVENTS}`, PATIENCE_MS),
      ask(`${this.base}/events/recorded`, PATIENCE_MS),
    ]);
    this.take(history);
    [this.events, this.recorded] = [events.events, recorded];
    [this.known, this.problem] = [true, null];
    // Who looks at the past goes on to see it when the latest readings have left it behind.
    if (this.at && this.longer && this.points[0]?.slow_time > this.at.slow_time) this.show(ALL);
  }

  /** A history, and what has arrived since it was asked for. The first one is thinned: over a slow line it is drawn much sooner. */
  take(history) {
    const known = new Set(history.points.map((point) => `${point.boot} ${point.sequence}`));
    this.points = [...history.points, ...this.arrived.filter((point) => !known.has(`${point.boot} ${point.sequence}`))];
    [this.bands, this.longer, this.thinned, this.begin] = [history.bands, history.longer, history.thinned, history.begin];
    this.touch();
  }

  /** What is foretold now; at an instant of the past what was foretold then, which is asked for once. */
  async foresee() {
    const { at } = this;
    if (!this.points.length || (at ? this.recalled === at : Date.now() - this.forecastAt < FORECAST_MS)) return;
    if (at) this.recalled = at;
    else this.forecastAt = Infinity;
    if (!this[at ? "foretold" : "forecast"] && !this.unforeseen) this.unforeseen = COMPUTING;
    await this.forecastAgain(at);
    if (!at && this.forecastAt === Infinity) this.forecastAt = Date.now();
  }

  async forecastAgain(at) {
    const path = `${this.base}/forecast?points=40${at ? `&at=slow:${at.slow_time}` : ""}`;
    const { forecast, trouble, wait } = await ask(path, PATIENCE_MS).then(
      (told) => ({ forecast: told }), ({ message, retry }) => ({ trouble: message, wait: retry }),
    );
    if (this.at !== at) return;
    if (wait && !at) this.forecastAt = Date.now() + 1000 * wait;
    if (trouble && at) this.recalled = null;
    // What was foretold stays until something newer is: it says itself since when it holds.
    const name = at ? "foretold" : "forecast", none = forecast && !forecast.points.length;
    const said = trouble ? { words: t("outlook.trouble"), why: trouble } : none ? { why: forecast.reasons.join(" ") } : null;
    const show = (more) => {
      if (forecast) this[name] = none ? null : forecast;
      Object.assign(this, { unforeseen: said, ...more });
      this.touch();
    };
    // Forecast, risk and plan are of one instant, and are shown together; only the first forecast does not wait.
    if (at || trouble || !this.forecast) show();
    if (at || trouble) return;
    const more = await this.assess(forecast.since);
    if (!this.at) show(more);
  }

  /** Risk and plan, where the registration asks for them, of the reading that a forecast is of. */
  async assess(since) {
    const { limit_states: states, decision } = this.latest?.registration ?? {}, of = since === null ? "" : `?since=${since}`;
    const answer = (what) => ask(`${this.base}/${what}${of}`, 2 * PATIENCE_MS).then((told) => ({ answer: told }), ({ message }) => ({ trouble: message }));
    const [risk, plan] = await Promise.all([states?.length ? answer("risk") : null, decision ? answer("plan") : null]);
    return { risk, plan };
  }

  /** Look at one of the readings, or with null at what is known now. */
  lookAt(point) {
    [this.at, this.foretold, this.recalled, this.unforeseen] = [point, null, null, null];
    this.touch();
  }
}
