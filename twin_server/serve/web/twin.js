// What the page knows of one twin: its history, what the live stream adds to it, and which instant is looked at.
import { ask } from "./link.js";

const MAX_POINTS = 1000, FORECAST_MS = 3000, PATIENCE_MS = 30000, EVENTS = 100;

/** All by which two states that look alike on the page are alike. */
const told = ({ boot, sequence, alive, valid, normal, raised, registration }) => (
  JSON.stringify([boot, sequence, alive, valid, normal, raised, registration])
);
const isOf = (event, at) => event.slow_time === null ? event.kind === "registered" : event.slow_time <= at.slow_time;

export class Twin {
  constructor(id, changed) {
    Object.assign(this, { id, changed, latest: null, points: [], events: [], forecast: null });
    Object.assign(this, { stream: null, loading: null, arrived: null, stale: false, problem: null, dirty: true });
    Object.assign(this, { known: false, forecastAt: 0, at: null, foretold: null, recalled: null });
  }

  get base() { return `/api/v1/twins/${encodeURIComponent(this.id)}`; }

  /** What is to be seen: all until now, or until the instant that is looked at, and apart what came after it. */
  get scene() {
    const { id, base, latest, points, events, forecast, at } = this;
    if (!at) return { id, base, at, latest, points, later: [], events, forecast };
    const seen = points.findLastIndex((point) => point.slow_time <= at.slow_time) + 1;
    return {
      id, base, at, points: points.slice(0, seen), later: points.slice(Math.max(seen - 1, 0)), forecast: this.foretold,
      latest: { ...latest, ...at, normal: [], raised: [] }, events: events.filter((event) => isOf(event, at)),
    };
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
    if (this.points.length > 2 * MAX_POINTS) this.load();
  }

  happen(event) {
    if (this.events.some((other) => other.number === event.number)) return;
    this.events = [...this.events, event].slice(-EVENTS);
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
    const [history, events] = await Promise.all([
      ask(`${this.base}/history?max_points=${MAX_POINTS}`, PATIENCE_MS),
      ask(`${this.base}/events?limit=${EVENTS}`, PATIENCE_MS),
    ]);
    const known = new Set(history.points.map((point) => `${point.boot} ${point.sequence}`));
    this.points = [...history.points, ...this.arrived.filter((point) => !known.has(`${point.boot} ${point.sequence}`))];
    this.events = events.events;
    [this.known, this.problem] = [true, null];
  }

  /** What is foretold now; at an instant of the past what was foretold then, which is asked for once. */
  async foresee() {
    const { at } = this;
    if (!this.points.length || (at ? this.recalled === at : Date.now() - this.forecastAt < FORECAST_MS)) return;
    if (at) this.recalled = at;
    else this.forecastAt = Date.now();
    const forecast = await ask(`${this.base}/forecast?points=40${at ? `&at=slow:${at.slow_time}` : ""}`, PATIENCE_MS).catch(() => null);
    if (this.at !== at) return;
    if (!forecast) this.recalled = null;
    this[at ? "foretold" : "forecast"] = forecast?.points.length ? forecast : null;
    this.touch();
  }

  /** Look at one of the readings, or with null at what is known now. */
  lookAt(point) {
    [this.at, this.foretold, this.recalled] = [point, null, null];
    this.touch();
  }
}
