// What to do with the structure: the sentence, the cost of each option over time, and a table of them.
import { counted, locale, parts, t } from "./language.js";
import { drawPlot } from "./plot.js";
import { translated } from "./sentences.js";
import { colour } from "./svg.js";
import { compose, composed, digits, make, range, unitOf } from "./words.js";

const HEIGHT_PX = 260, NARROW_PX = 480, LINES_PX = 34, DRAWN = 6;
const HEADS = [t("plan.option"), t("plan.now"), t("plan.cost"), t("plan.futures"), t("plan.failures")];
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];

/** An amount with three digits. */
const amount = (x) => (+x.toPrecision(3)).toLocaleString(locale, { maximumSignificantDigits: 3 }).replace("-", "\u2212");

function rowOf(option, ahead) {
  const row = make("tr"), title = composed("th", option.words), { value, lo, hi } = option.cost;
  title.scope = "row";
  row.dataset.option = option.name;
  row.append(title, make("td", ahead && option.now === "repair" ? t("plan.act.order") : t(`plan.act.${option.now}`)), make("td", amount(value)), make("td", range(amount(lo), amount(hi))));
  row.append(make("td", option.failures < 0.0005 ? "0" : digits(option.failures, 2)));
  return row;
}

function headOf(titles) {
  const head = make("thead"), row = make("tr");
  for (const title of titles) {
    const cell = make("th", title);
    cell.scope = "col";
    row.append(cell);
  }
  head.append(row);
  return head;
}

/** Options whose curves can be told apart on one scale: those that cost less than five times the best. */
function drawnOf({ options }) {
  const least = Math.max(options[0].cost.value, 1e-9);
  return options.filter(({ cost }, i) => i < 2 || cost.value < 5 * least).slice(0, DRAWN);
}

/** Break a text where a line of a legend on a telephone ends. */
const broken = (text) => text.replace(/(.{24,34}?) (?=.{4})/g, "$1<br>");

export class Plan {
  constructor() {
    Object.assign(this, { plan: null, told: null });
    this.root = make("section", undefined, "plan");
    this.root.setAttribute("aria-label", t("plan.label"));
    this.title = make("h3", t("plan.title"));
    [this.sentence, this.last, this.changes] = [make("p", "", "sentence"), make("p", "", "last-order"), make("ul", undefined, "changes")];
    this.sentence.setAttribute("role", "status");
    this.plot = make("div", undefined, "plot");
    this.plot.setAttribute("role", "img");
    this.table = make("table", undefined, "options");
    this.body = make("tbody");
    this.table.append(make("caption", t("plan.options")), headOf(HEADS), this.body);
    this.worth = make("p", "", "facts worth");
    this.root.append(this.title, this.sentence, this.last, this.changes, this.plot, this.table, this.worth);
    this.root.hidden = this.plot.hidden = this.table.hidden = true;
  }

  /** What `twin` has asked for beside the forecast, of the same instant; only where something is to be decided. */
  tell({ latest, at, plan }) {
    this.root.hidden = !latest?.registration?.decision || Boolean(at) || latest.slow_time === null;
    if (this.root.hidden || plan === this.told) return;
    this.told = plan;
    if (!plan) this.say(t("plan.computing"));
    else if (plan.trouble) this.say(`${t("plan.trouble")} `, composed("span", plan.trouble));
    if (!plan?.answer) return;
    this.plan = plan.answer;
    this.show();
  }

  say(...words) { this.sentence.replaceChildren(...words); }

  show() {
    const { plan } = this, none = !plan.options.length;
    this.root.dataset.since = plan.since;
    this.say(composed("span", plan.sentence));
    this.root.dataset.action = plan.action ?? "none";
    compose(this.last, plan.last_order?.sentence ?? "");
    this.changes.replaceChildren(...plan.changes.map((text) => composed("li", text)));
    this.plot.hidden = this.table.hidden = none;
    if (none) return;
    this.root.dataset.since = plan.since;
    this.body.replaceChildren(...plan.options.map((option) => rowOf(option, plan.last_order?.lead_time > 0)));
    this.table.querySelectorAll("thead th")[2].textContent = t("plan.cost_in", { currency: plan.currency });
    const [best] = plan.information;
    this.worth.replaceChildren(...(best ? parts("plan.worth", { observation: composed("span", best.words) }) : [t("plan.no_observation")]));
    this.draw();
  }

  draw() {
    const { plan } = this;
    const dated = plan.times.every(({ t }) => t) && plan.seconds > 3600, x = plan.times.map(({ t, ahead }) => (dated ? t : ahead));
    const width = this.plot.clientWidth || 640, narrow = width < NARROW_PX;
    const shown = drawnOf(plan), tints = ["estimate", "ahead", "bad", "good", "inseparable", "ink"].map(colour);
    const wordsOf = (option) => translated(option.words) ?? option.words;
    const traces = shown.map((option, i) => ({
      name: narrow ? broken(wordsOf(option)) : wordsOf(option), x, y: option.curve, mode: "lines", line: { color: tints[i], width: i ? 1.4 : 2.4, dash: DASHES[i] },
      hover: (i) => `${wordsOf(option)}: ${counted(+option.curve[i].toPrecision(3))} ${plan.currency}`,
    }));
    const inSlowTime = plan.time_unit === "slow_time", named = inSlowTime ? plan.slow_time_unit && unitOf(plan) : t(`unit.plan.${plan.time_unit}`);
    const unit = named ? t("axis.time_from_now", { unit: named }) : t("axis.slow_time_from_now");
    drawPlot(this.plot, traces, {
      width, height: HEIGHT_PX + (narrow ? LINES_PX * shown.length : 0), margin: { l: 64, r: 16, t: 8, b: 44 }, across: true, showlegend: true,
      xaxis: { title: { text: dated ? t("axis.date") : unit } },
      yaxis: { rangemode: "tozero", title: { text: t("axis.cost", { currency: plan.currency }) } },
    });
    this.plot.dataset.drawn = traces.length;
    this.plot.setAttribute("aria-label", t("plan.chart", { n: traces.length, best: wordsOf(shown[0]) }));
  }
}
