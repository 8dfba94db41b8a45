// How probable failure is: each limit state with its probability now, up to the horizon, and over time.
import { t } from "./language.js";
import { drawPlot } from "./plot.js";
import { colour } from "./svg.js";
import { atTime, composed, describeRow, digits, english, foretold, make, number, powered, range, say, slowTime, unitOf } from "./words.js";

const HEIGHT_PX = 240;
/** Probability below which models of loads and strengths know nothing: smaller ones are drawn and said as this one. */
const LEAST = 1e-4, LEAST_INDEX = 3.72;
const HEADS = [
  t("risk.limit_state"), t("risk.now"), t("number.interval_90"), t("risk.index"), t("risk.within"), t("risk.reached"),
];

const probability = (p) => (p < LEAST ? t("risk.below_least") : p < 1e-3 ? powered(p) : digits(p, 2));
const interval = (lo, hi) => (hi < LEAST ? t("risk.below_least") : lo < LEAST ? t("risk.up_to", { hi: probability(hi) }) : range(probability(lo), probability(hi)));

/** `[mood, sentence]`: whether it is safe by the limit states that were registered, up to the horizon. */
export function safetyOf({ limit_states: states, since, horizon }, at) {
  const known = states.filter(({ now }) => now);
  if (!known.length) return ["waiting", t("risk.safe.cannot_say")];
  const failing = known.filter(({ now, accepted }) => now.probability.value > accepted);
  if (failing.length) return ["bad", t("risk.safe.no", { names: failing.map(({ name }) => name).join(", ") })];
  const until = known.filter((state) => state.until !== null).sort((a, b) => a.until - b.until)[0];
  if (until) return ["waiting", t("risk.safe.until", { time: at(foretold(until.until, since)), name: until.name })];
  if (known.length < states.length) return ["waiting", t("risk.safe.in_part", { names: known.map(({ name }) => name).join(", ") })];
  return ["good", t("risk.safe.yes", { time: at(horizon), names: known.map(({ name }) => name).join(", ") })];
}

function rowOf(state, since, at) {
  const row = make("tr"), title = make("th", state.name);
  title.scope = "row";
  row.dataset.state = state.name;
  row.append(title);
  if (!state.now) {
    const cell = composed("td", state.reasons[0]);
    cell.colSpan = HEADS.length - 1;
    row.append(cell);
    return row;
  }
  const { probability: now, beta } = state.now;
  const reached = state.until === null ? t("risk.not_within") : at(foretold(state.until, since));
  const cells = [probability(now.value), interval(now.lo, now.hi), beta > LEAST_INDEX ? `> ${number(LEAST_INDEX, 1)}` : number(beta, 2), probability(state.within.value), reached];
  row.append(...cells.map((text) => make("td", text)));
  describeRow(row, state.sentence);
  return row;
}

export class Risk {
  constructor() {
    Object.assign(this, { risk: null, told: null });
    this.root = make("section", undefined, "risk");
    this.root.setAttribute("aria-label", t("risk.label"));
    this.table = make("table", undefined, "options");
    const head = make("thead"), row = make("tr");
    for (const title of HEADS) {
      const cell = make("th", title);
      cell.scope = "col";
      row.append(cell);
    }
    head.append(row);
    this.heads = [...row.children];
    this.body = make("tbody");
    this.table.append(make("caption", t("risk.caption")), head, this.body);
    this.plot = make("div", undefined, "plot");
    this.plot.setAttribute("role", "img");
    this.trouble = make("p", "", "trouble");
    this.trouble.setAttribute("role", "status");
    this.safe = make("p", "", "answer");
    this.safe.setAttribute("role", "status");
    this.root.append(make("h3", t("risk.title")), this.safe, this.table, this.plot, this.trouble);
    // No empty panels: what there is to see is shown once it is known.
    this.root.hidden = this.table.hidden = this.plot.hidden = true;
  }

  /** What `twin` has asked for beside the forecast, of the same instant; only where limit states are registered. */
  tell({ latest, at, risk }) {
    this.root.hidden = !latest?.registration?.limit_states?.length || Boolean(at) || latest.slow_time === null;
    if (this.root.hidden) return;
    if (!risk) this.trouble.textContent = t("risk.computing");
    else if (risk !== this.told) this.take(risk, latest);
  }

  take(risk, latest) {
    this.told = risk;
    if (risk.answer) this.risk = risk.answer;
    this.trouble.replaceChildren(...(risk.trouble ? [`${t("risk.trouble")} `, composed("span", risk.trouble)] : []));
    if (this.risk) this.show(latest);
  }

  show(latest) {
    const { risk } = this, at = (time) => slowTime(atTime(latest, time));
    this.root.dataset.since = risk.since;
    say(this.safe, ...(risk.limit_states.length ? safetyOf(risk, at) : ["", ""]));
    this.body.replaceChildren(...risk.limit_states.map((state) => rowOf(state, risk.since, at)));
    this.heads[1].textContent = t("risk.at", { time: at(risk.since) });
    this.heads[4].textContent = t("risk.up_to_time", { time: at(risk.horizon) });
    this.table.hidden = !risk.limit_states.length;
    this.plot.hidden = !risk.limit_states.some(({ now }) => now);
    if (!risk.limit_states.length) this.trouble.replaceChildren(english(make("span", risk.reasons.join(" "))));
    else if (!this.plot.hidden) this.draw();
  }

  draw() {
    const tints = ["estimate", "bad", "good", "inseparable", "ahead"].map(colour);
    const states = this.risk.limit_states.filter(({ now }) => now);
    const traces = states.flatMap((state, i) => {
      const tint = tints[i % tints.length];
      const all = [...state.past, ...state.points];
      const x = all.map(({ slow_time }) => slow_time), part = (name) => all.map(({ probability: p }) => Math.max(p[name], LEAST));
      const edge = { x, mode: "lines", line: { width: 0 }, showlegend: false };
      return [
        { ...edge, y: part("lo") },
        { ...edge, y: part("hi"), fill: "tonexty", fillcolor: `${tint}22` },
        { name: state.name, x, y: part("value"), mode: "lines", line: { color: tint, width: 2 }, hover: (i) => `${state.name}: ${powered(all[i].probability.value)}` },
      ];
    });
    const since = this.risk.since;
    drawPlot(this.plot, traces, {
      width: this.plot.clientWidth || 640, height: HEIGHT_PX, margin: { l: 64, r: 10, t: 8, b: 44 }, across: true, showlegend: true,
      xaxis: { title: { text: t("axis.time", { unit: unitOf(this.risk) }) } },
      yaxis: { type: "log", title: { text: t("axis.failure_probability") } },
      shapes: [{ type: "line", x0: since, x1: since, yref: "paper", y0: 0, y1: 1, line: { color: colour("faint"), dash: "dot" } }],
    });
    this.plot.dataset.drawn = states.length;
    this.plot.setAttribute("aria-label", t("risk.chart", { names: states.map(({ name }) => name).join(", ") }));
  }
}
