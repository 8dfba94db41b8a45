// What the page knows of one twin: its history, and what the live stream adds to it.
import { ask } from "./words.js";

const MAX_POINTS = 1000, FORECAST_MS = 8000, RELOAD_MS = 30000, EVENTS = 100;

export class Twin {
  constructor(id, listen) {
    Object.assign(this, { id, listen, latest: null, points: [], events: [], forecast: null });
    Object.assign(this, { stream: null, loading: null, arrived: null, stale: false, problem: null, dirty: true });
    Object.assign(this, { seenAt: null, loadedAt: 0, forecastAt: 0 });
  }

  get base() { return `/api/v1/twins/${encodeURIComponent(this.id)}`; }

  /** The latest state, from the list or the stream, whichever is newer. */
  hear(state) {
    const before = this.latest;
    this.latest = { ...before, ...state };
    if (!before || state.sequence !== before.sequence || state.boot !== before.boot) {
      if (before) this.seenAt = Date.now();
      this.dirty = true;
    }
    if (before && (before.alive !== this.latest.alive || before.valid !== this.latest.valid)) this.dirty = true;
    if (before && JSON.stringify(before.normal) !== JSON.stringify(this.latest.normal)) this.dirty = true;
  }

  /** Each opening fetches the history, so that nothing between it and the stream is missed. */
  watch() {
    if (this.stream && this.stream.readyState !== EventSource.CLOSED) return;
    this.stream = this.listen(this);
  }

  unwatch() {
    if (this.stream) this.stream.close();
    this.stream = null;
  }

  arrive(point) {
    this.hear(point);
    const last = this.points.at(-1);
    if (this.arrived) this.arrived.push(point);
    if (last && point.boot === last.boot && point.sequence <= last.sequence) return;
    this.points.push(point);
    this.dirty = true;
    if (this.points.length > 2 * MAX_POINTS) this.load();
  }

  happen(event) {
    if (this.events.some((other) => other.number === event.number)) return;
    this.events = [...this.events, event].slice(-EVENTS);
    this.dirty = true;
  }

  /** History and events anew: one request at a time, and one more if it is asked for meanwhile. */
  load() {
    if (this.loading) this.stale = true;
    else this.loading = this.fetchAll().catch((error) => { this.problem = error.message; }).finally(() => {
      this.loading = this.arrived = null;
      this.dirty = true;
      if (this.stale) this.load();
    });
  }

  async fetchAll() {
    this.arrived = [];
    this.stale = false;
    const [history, events] = await Promise.all([
      ask(`${this.base}/history?max_points=${MAX_POINTS}`),
      ask(`${this.base}/events?limit=${EVENTS}`),
    ]);
    const known = new Set(history.points.map((point) => `${point.boot} ${point.sequence}`));
    this.points = [...history.points, ...this.arrived.filter((point) => !known.has(`${point.boot} ${point.sequence}`))];
    this.events = events.events;
    this.loadedAt = Date.now();
    this.problem = null;
  }

  /** For a twin on screen that has no stream: what is new, and everything now and then. */
  async catchUp() {
    const last = this.points.at(-1);
    if (this.loading) return;
    if (!last || Date.now() - this.loadedAt > RELOAD_MS) {
      this.load();
      return;
    }
    const [history, events] = await Promise.all([
      ask(`${this.base}/history?start=${last.t_ns}&max_points=${MAX_POINTS}`),
      ask(`${this.base}/events?after=${this.events.at(-1)?.number ?? 0}`),
    ]).catch(() => [{ points: [] }, { events: [] }]);
    for (const point of history.points) this.arrive(point);
    for (const event of events.events) this.happen(event);
  }

  async foresee() {
    if (!this.points.length || Date.now() - this.forecastAt < FORECAST_MS) return;
    this.forecastAt = Date.now();
    const forecast = await ask(`${this.base}/forecast?points=40`).catch(() => ({ points: [] }));
    this.forecast = forecast.points.length ? forecast : null;
    this.dirty = true;
  }
}
