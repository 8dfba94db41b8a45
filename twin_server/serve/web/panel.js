// The view of one twin, its state or its diagnosis; made once, then kept up to date in place.
import { Assessed } from "./assessed.js";
import { Changes } from "./changes.js";
import { draw, pictureOf } from "./charts.js";
import { showConclusion } from "./conclusion.js";
import { Costs } from "./costs.js";
import { Diagnosis } from "./diagnosis.js";
import { Elements } from "./elements.js";
import { Events } from "./events.js";
import { locale, t } from "./language.js";
import { Limits } from "./limits.js";
import { Outlook } from "./outlook.js";
import { Recorded } from "./recorded.js";
import { Plan } from "./plan.js";
import { Risk } from "./risk.js";
import { Shapes } from "./shapes.js";
import { Supposed } from "./supposed.js";
import { toTwin } from "./route.js";
import { Timeline } from "./timeline.js";
import { placeOf } from "./traces.js";
import { WhatIf } from "./whatif.js";
import { ALL, LATEST } from "./window.js";
import { LEARNING, QUANTITIES, ago, atTime, composed, interval95, isClock, make, say, sensorOf, slowTime, spoken, standing } from "./words.js";

const CHARTS = Object.keys(QUANTITIES);
const HOUR_MS = 3600e3, DAY_MS = 24 * HOUR_MS;
const PARTS = [
  [HOUR_MS, t("twin.last_hour")], [DAY_MS, t("twin.last_day")], [7 * DAY_MS, t("twin.last_week")],
  [30 * DAY_MS, t("twin.last_month")], [365 * DAY_MS, t("twin.last_year")],
];
const STANDING = {
  valid: ["good", t("standing.valid")],
  inseparable: ["waiting", t("standing.inseparable_long")],
  learning: ["waiting", t("standing.learning_long")],
  invalid: ["bad", t("standing.invalid")],
};
/** What is taken out of the frequencies: temperature, load; and what has entered that they do not explain. */
function weatherOf({ registration: { covariates }, normal = [], reasons }) {
  if (!covariates) return false;
  const names = covariates.names.join(t("list.and"));
  if (!normal.length) return reasons.some((reason) => LEARNING.test(reason)) && t("covariates.learning", { names });
  const laws = [...new Set(normal.map(({ law }) => law))].join(", ");
  return t("covariates.removed", { names, laws });
}

/** The mode that tells most surely of a change that nothing measured explains. */
function enteredOf({ normal = [], ...latest }) {
  const sure = ({ entered: { frequency_change: { value, sd } } }) => Math.abs(value) / sd;
  const [most] = normal.filter(({ entered }) => entered).sort((a, b) => sure(b) - sure(a));
  if (!most) return null;
  const { entered } = most, quantity = ["stiffness_change", "mass_change"].find((name) => name in entered);
  const what = quantity ? t(`quantity.${quantity}.inside`) : t("covariates.mode", { mode: most.model_mode + 1 });
  const [size, interval] = spoken(entered[quantity ?? "frequency_change"], quantity ?? "stiffness_change");
  return t("covariates.unexplained", { time: slowTime(atTime(latest, entered.since)), what, size, interval: interval95(interval) });
}

const CHANGES = {
  stiffness: t("changes.stiffness"),
  mass: t("changes.mass"),
  both: t("changes.both"),
  elements: t("changes.elements"),
};

export class Panel {
  constructor(twin) {
    this.twin = twin;
    this.root = make("section", undefined, "twin");
    this.root.id = twin.id;
    this.root.setAttribute("aria-labelledby", `${twin.id}-name`);
    [this.facts, this.seen, this.reading] = [make("p", "", "facts"), make("span"), make("span")];
    [this.answer, this.reasons] = [make("div", "", "answer"), make("ul", undefined, "reasons")];
    this.answer.setAttribute("role", "status");
    const about = make("p", undefined, "facts");
    this.sensor = make("p", "", "facts sensor");
    this.aside = make("p", "", "aside");
    this.sensor.hidden = this.aside.hidden = true;
    about.append(this.reading, this.seen);
    this.charts = make("div", undefined, "charts");
    this.watcher = new ResizeObserver(() => twin.touch());
    this.watcher.observe(this.charts);
    this.figures = Object.fromEntries(CHARTS.map((quantity) => [quantity, this.figure(quantity)]));
    this.quantities = CHARTS;
    this.elements = null;
    this.changes = new Changes(twin);
    [this.events, this.outlook, this.recorded, this.assessed] = [new Events(), new Outlook(), new Recorded(this.changes), new Assessed()];
    [this.timeline, this.whatIf, this.diagnosis] = [new Timeline(twin), new WhatIf(twin), new Diagnosis(twin)];
    [this.risk, this.plan, this.shapes, this.limits, this.costs] = [new Risk(), new Plan(), new Shapes(), new Limits(this.changes), new Costs(this.changes)];
    this.state = make("div", undefined, "state");
    this.state.append(
      about, this.sensor, this.aside, this.reasons, this.timeline.root, this.shapes.root, this.charts, this.outlook.root, this.risk.root, this.plan.root, this.assessed.root,
      this.whatIf.root, this.limits.root, this.costs.root, this.changes.root, this.recorded.root, this.events.root,
    );
    this.root.append(this.heading(), this.answer, this.facts, this.state, this.diagnosis.root);
  }

  heading() {
    const { twin } = this;
    const heading = make("div", undefined, "heading"), tools = make("p", undefined, "tools"), rooms = make("nav", undefined, "rooms");
    this.name = make("h2", this.twin.id);
    this.name.id = `${this.twin.id}-name`;
    [this.validity, this.edge] = [make("p", "", "pill"), make("p", "", "pill")];
    this.size = make("button", t("twin.larger_charts"), "quiet");
    this.size.type = "button";
    this.size.setAttribute("aria-pressed", "false");
    this.size.addEventListener("click", () => this.resize());
    const history = make("a", t("twin.history_json"));
    history.href = `${this.twin.base}/history`;
    this.part = make("select");
    this.part.setAttribute("aria-label", t("twin.shown_time"));
    this.part.hidden = true;
    this.part.addEventListener("change", () => twin.show(+this.part.value || this.part.value));
    this.tables = ["csv", "parquet"].map((form) => this.table(form));
    tools.append(this.part, this.size, history, ...this.tables);
    rooms.setAttribute("aria-label", t("twin.views"));
    this.rooms = ["state", "diagnosis"].map((room) => {
      const link = make("a", room === "state" ? t("twin.state") : t("twin.diagnosis"));
      link.href = toTwin(this.twin.id, room);
      link.dataset.room = room;
      return link;
    });
    rooms.append(...this.rooms);
    heading.append(this.name, this.validity, this.edge, rooms, tools);
    return heading;
  }

  /** Parts of the history that can be looked at: none where it is short. */
  offerParts({ longer, begin, latest, part }) {
    const spans = begin === null ? [] : PARTS.filter(([span]) => 1e6 * span < latest.t_ns - begin);
    const offered = [...(longer ? [[LATEST, t("twin.latest_readings")]] : []), ...spans, [ALL, t("twin.whole_history")]];
    const key = offered.join();
    this.part.hidden = offered.length < 2;
    if (this.offered !== key) this.part.replaceChildren(...offered.map(([value, text]) => new Option(text, value)));
    this.offered = key;
    this.part.value = `${longer || part !== LATEST ? part : ALL}`;
  }

  /** A link to the readings that the charts show, as a table. */
  table(form) {
    const link = make("a", t(`twin.table_${form}`));
    link.download = `${this.twin.id}.${form}`;
    const aim = () => {
      const { zoom, points } = this.twin.scene, ends = zoom.zoomed ?? [points[0], points.at(-1)].map((point) => point && placeOf(point));
      const at = (end) => (typeof end === "string" || end instanceof Date ? new Date(end).toISOString() : `slow:${end}`);
      const [start, end] = points.length ? ends.map(at) : [];
      link.href = `${this.twin.base}/history/export?${new URLSearchParams({ format: form, ...(start && { start, end }) })}`;
    };
    for (const event of ["pointerdown", "focus", "keydown"]) link.addEventListener(event, aim);
    link.href = `${this.twin.base}/history/export?format=${form}`;
    return link;
  }

  figure(quantity) {
    const figure = make("figure"), caption = make("figcaption");
    const value = make("strong", "\u2013"), interval = make("span", "", "interval");
    const plot = make("div", undefined, "plot");
    plot.dataset.quantity = quantity;
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", t("chart.loading", { title: QUANTITIES[quantity].title }));
    const { title } = QUANTITIES[quantity];
    caption.append(make("span", title, "title"), value, interval, pictureOf(plot, () => `${this.twin.id} ${title}`));
    figure.append(caption, plot);
    this.charts.append(figure);
    const supposed = QUANTITIES[quantity].measured ? null : new Supposed(this.twin, figure, plot, quantity);
    return { figure, value, interval, plot, supposed };
  }

  resize() {
    const wide = this.root.classList.toggle("wide");
    this.size.setAttribute("aria-pressed", String(wide));
  }

  /** Which room of the twin is shown, at which slow time if one is asked for. */
  show(room, at) {
    this.room = room;
    this.state.hidden = room !== "state";
    this.diagnosis.root.hidden = room === "state";
    this.diagnosis.refresh();
    for (const link of this.rooms) link.dataset.room === room ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current");
    if (at !== null && at !== this.twin.at?.slow_time) this.timeline.want(at);
    this.twin.touch();
  }

  /** What changes as time goes by, though nothing new arrives. */
  tick() {
    const { latest, at } = this.twin;
    if (!latest) return;
    const heard = `, ${latest.heard_ns ? t("twin.last_seen", { ago: ago(Date.now() - latest.heard_ns / 1e6) }) : t("twin.no_message")}`;
    const text = latest.slow_time !== null && !at ? heard : "";
    if (this.seen.textContent !== text) this.seen.textContent = text;
  }

  /** Words first: charts follow. */
  tell() {
    const { twin } = this, scene = twin.scene, { latest } = scene;
    if (!latest) return;
    const named = latest.registration.name || twin.id;
    this.name.textContent = named;
    say(this.edge, latest.alive ? "good" : "waiting", latest.alive ? t("twin.agent_online") : t("twin.agent_offline"));
    const begun = latest.slow_time !== null;
    say(this.validity, ...(begun ? STANDING[standing(latest)] : ["waiting", t("standing.none")]));
    const sensor = sensorOf(latest);
    this.sensor.hidden = !sensor;
    if (sensor) say(this.sensor, sensor.state, sensor.text);
    this.aside.hidden = !latest.aside;
    if (latest.aside) say(this.aside, "bad", t("aside.count", { n: latest.aside }));
    showConclusion(this.answer, latest, scene.at, scene.events);
    const damping = latest.damping_ratio && spoken(latest.damping_ratio, "damping_ratio");
    const facts = [
      named !== twin.id && twin.id,
      CHANGES[latest.registration.changes],
      damping && t("twin.damping", { value: damping[0], interval: interval95(damping[1]) }),
      latest.frequency_used === "smoothed" && t("twin.smoothed"),
      weatherOf(latest),
    ];
    this.facts.textContent = facts.filter(Boolean).join(" \u00b7 ");
    const taken = begun && new Date(latest.t_ns / 1e6).toLocaleString(locale);
    const reading = begun && t(isClock(latest) ? "twin.reading" : "twin.reading_timed", { number: `${latest.sequence}`, time: slowTime(latest), taken });
    this.reading.textContent = reading || "";
    const entered = enteredOf(latest), { problem } = twin;
    const reasons = [...(entered ? [entered] : []), ...latest.reasons, ...(problem ? [problem] : [])];
    const listed = () => reasons.map((reason) => (reason === entered || reason === problem ? make("li", reason) : composed("li", reason)));
    if (this.said !== reasons.join("\n")) this.reasons.replaceChildren(...listed());
    this.said = reasons.join("\n");
    this.become(latest.registration.changes === "elements");
    for (const quantity of this.quantities) this.number(quantity, latest);
    if (this.elements) this.elements.tell(latest);
    this.offerParts(twin);
    this.timeline.tell();
    this.outlook.tell(scene);
    for (const each of [this.limits, this.costs, this.changes]) each.tell(scene);
    this.recorded.tell(scene);
    this.risk.tell(scene);
    this.plan.tell(scene);
    this.assessed.tell(twin);
    this.events.tell(scene);
    this.whatIf.tell(twin.latest);
    this.tick();
  }

  /** A twin may be registered anew, of many elements instead of one mode; it begins afresh then. */
  become(ofElements) {
    if (ofElements === Boolean(this.elements)) return;
    if (!ofElements) this.elements.remove();
    this.elements = ofElements ? new Elements(this) : null;
    this.quantities = ofElements ? CHARTS.filter((quantity) => QUANTITIES[quantity].measured) : CHARTS;
    for (const quantity of CHARTS) this.figures[quantity].figure.hidden = !this.quantities.includes(quantity);
  }

  number(quantity, latest) {
    const { value, interval, figure } = this.figures[quantity];
    const estimate = latest[quantity], assumed = latest.assumed.includes(quantity);
    const [said, range] = estimate && !assumed ? spoken(estimate, quantity) : ["\u2013", ""];
    value.textContent = assumed ? t("twin.no_change") : said;
    const missing = latest.slow_time === null ? "" : t("twin.not_estimated");
    interval.textContent = assumed ? t("twin.assumed") : range ? interval95(range) : missing;
    figure.dataset.standing = assumed ? "assumed" : standing(latest);
  }

  /** Gives back which keys of the legend it has drawn. */
  async draw() {
    if (this.room !== "state") {
      this.diagnosis.redraw();
      return {};
    }
    const wide = this.root.classList.contains("wide"), found = {}, { scene } = this.twin;
    for (const quantity of this.quantities) {
      const { plot, supposed } = this.figures[quantity], drawn = draw(plot, scene, quantity, wide);
      supposed?.tell(scene);
      for (const key of Object.keys(drawn)) found[key] ||= drawn[key];
    }
    await this.shapes.refresh(scene);
    const drawn = this.elements ? await this.elements.draw(scene, wide) : {};
    for (const key of Object.keys(drawn)) found[key] ||= drawn[key];
    return found;
  }

  /** Nothing of it goes on, and nothing of it is held. */
  close() {
    this.twin.unwatch();
    this.watcher.disconnect();
    this.timeline.close();
    this.diagnosis.close();
    this.elements?.modes.close();
    this.shapes.close();
    this.root.remove();
  }
}
