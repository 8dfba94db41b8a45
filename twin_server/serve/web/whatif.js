// What would the twin do under a load? A form, and the response with its bands.
import { parts, t } from "./language.js";
import { send } from "./link.js";
import { drawPlot } from "./plot.js";
import { colour, faded } from "./svg.js";
import { composed, digits, explain, interval95, make, number, range } from "./words.js";

const HEIGHT_PX = 240, NARROW = "\u202f";
const LOADS = {
  harmonic: { text: t("load.harmonic"), of: "amplitude", frequency: true },
  step: { text: t("load.step"), of: "amplitude" },
  white: { text: t("load.white"), of: "psd" },
};
const UNITS = { displacement: "m", velocity: "m/s", acceleration: "m/s\u00b2" };

/** A number with as many digits as its error leaves, in powers of ten where it is small or large. */
function figure({ value, lo, hi }) {
  const size = Math.floor(Math.log10(Math.max(Math.abs(value), 1e-300))), scale = size < -2 || size > 4 ? 10 ** -size : 1;
  const many = Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(Math.max((hi - lo) * scale, 1e-5)))));
  const power = scale === 1 ? "" : ` \u00b7 10${String(size).replace(/[-\d]/g, (c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] ?? "⁻")}`;
  return [`${number(value * scale, many)}${power}`, `${range(number(lo * scale, many), number(hi * scale, many))}${power}`];
}

function field(text, control, unit) {
  const label = make("label", text, "field");
  label.append(control);
  if (unit) label.append(unit);
  return label;
}

/** Offer `[value, text]` pairs; what was chosen stays chosen where it still can be. */
function offer(select, options) {
  const before = select.value;
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  if (options.some(([value]) => value === before)) select.value = before;
  return select;
}

const choice = (options) => offer(make("select"), options);

function numeric(value, min) {
  const input = make("input");
  Object.assign(input, { type: "number", step: "any", value, required: true });
  if (min !== undefined) input.min = min;
  return input;
}

export class WhatIf {
  constructor(twin) {
    Object.assign(this, { twin, answer: null, nodes: "" });
    this.root = make("details", undefined, "whatif");
    this.form = make("form");
    this.load = choice(Object.entries(LOADS).map(([kind, { text }]) => [kind, text]));
    this.on = choice([["base", t("place.base")]]);
    this.size = numeric(1);
    [this.unit, this.frequency, this.seconds] = [make("span", "", "unit"), numeric(1, 0.001), numeric(5, 0.1)];
    this.quantity = choice(Object.entries(UNITS).map(([name, unit]) => [name, `${t(`response.${name}`)} [${unit}]`]));
    this.rated = field(t("load.frequency"), this.frequency, "Hz");
    this.run = make("button", t("load.simulate"), "act");
    this.form.append(
      field(t("load.kind"), this.load), field(t("load.at"), this.on), field(t("load.amplitude"), this.size, this.unit), this.rated,
      field(t("load.duration"), this.seconds, "s"), field(t("load.quantity"), this.quantity), this.run,
    );
    this.form.addEventListener("submit", (event) => { event.preventDefault(); this.ask(); });
    for (const control of [this.load, this.on]) control.addEventListener("change", () => this.fit());
    this.problem = make("p", "", "notice");
    this.problem.dataset.state = "bad";
    this.problem.setAttribute("role", "alert");
    this.problem.hidden = true;
    this.result = make("div", undefined, "answer");
    this.result.hidden = true;
    this.node = choice([]);
    this.node.addEventListener("change", () => this.draw());
    this.plot = make("div", undefined, "plot");
    this.plot.setAttribute("role", "img");
    [this.told, this.assumed] = [make("p", "", "told"), make("p", "", "facts")];
    this.result.append(field(`${t("load.response_of")} `, this.node), this.told, this.plot, this.assumed);
    const note = make("p", t("load.note"), "facts");
    this.root.append(make("summary", t("load.title")), note, this.form, this.problem, this.result);
    this.fit();
  }

  /** Offers the nodes of the model, and begins where it hurts: at the lowest frequency. */
  tell({ registration, frequency_hz: frequency, modes = [] }) {
    const nodes = (registration.model?.nodes ?? []).map(({ id }) => id), own = registration.model ? nodes : registration.nominal?.mass_kg ? ["mass"] : [];
    if (this.nodes !== own.join()) {
      this.nodes = own.join();
      offer(this.on, [["base", t("place.base")], ...own.map((id) => [id, id])]);
      this.fit();
    }
    const lowest = modes[0]?.frequency_hz ?? frequency;
    if (!this.begun && lowest) [this.frequency.value, this.begun] = [+lowest.value.toPrecision(3), true];
  }

  fit() {
    const base = this.on.value === "base", unit = base ? "m/s\u00b2" : "N";
    this.rated.hidden = !LOADS[this.load.value].frequency;
    this.unit.textContent = this.load.value === "white" ? `(${unit})\u00b2/Hz` : unit;
  }

  async ask() {
    const kind = this.load.value, load = { kind, [LOADS[kind].of]: Number(this.size.value) };
    if (LOADS[kind].frequency) load.frequency_hz = Number(this.frequency.value);
    const order = { load, on: this.on.value, quantity: this.quantity.value, duration_s: Number(this.seconds.value) };
    this.problem.hidden = true;
    [this.run.disabled, this.run.textContent] = [true, t("load.running")];
    try {
      this.answer = await send(`${this.twin.base}/simulate`, "POST", order);
      const names = Object.keys(this.answer.outputs), begins = !this.node.value;
      offer(this.node, names.map((name) => [name, name]));
      if (begins) this.node.value = names.at(-1);
      this.result.hidden = false;
      this.draw();
    } catch (error) {
      explain(this.problem, error);
      this.problem.hidden = false;
    } finally { [this.run.disabled, this.run.textContent] = [false, t("load.simulate")]; }
  }

  draw() {
    const { answer } = this, response = answer.outputs[this.node.value], unit = UNITS[answer.quantity];
    const [peak, around] = figure(response.peak), [rms] = figure(response.rms);
    this.told.replaceChildren(
      `${t("load.peak")} `, make("strong", `${peak}${NARROW}${unit}`),
      make("span", ` ${interval95(`${around}${NARROW}${unit}`)} \u00b7 ${t("load.rms", { value: `${rms}${NARROW}${unit}` })}`, "interval"),
    );
    const said = [...answer.reasons.map((each) => [composed("span", each)]), ...answer.assumed.map((each) => parts("load.assumed", { what: composed("span", each) }))];
    // Reasons are whole sentences, assumptions are not.
    const closed = [...answer.reasons, ...answer.assumed].map((each) => each.endsWith(".") ? " " : ". ");
    this.assumed.replaceChildren(...said.flatMap((words, i) => [...words, i < said.length - 1 ? closed[i] : closed[i].trimEnd()]));
    this.plot.setAttribute("aria-label", t("load.chart", { quantity: t(`response.${answer.quantity}`), node: this.node.value, n: answer.t_s.at(-1), peak: `${peak} ${unit}`, interval: around }));
    const times = answer.t_s, tint = colour("estimate");
    const band = {
      name: "95 % band", x: [...times, ...times.toReversed()], y: [...response.lo, ...response.hi.toReversed()], mode: "lines",
      fill: "toself", fillcolor: faded(tint, 0.28), line: { width: 0 },
    };
    const line = { name: "response", x: times, y: response.value, mode: "lines", line: { color: tint, width: 1.4 }, hover: (i) => `${digits(times[i], 4)} s: ${digits(response.value[i], 4)} ${unit}` };
    drawPlot(this.plot, [band, line], {
      width: this.plot.clientWidth, height: HEIGHT_PX, margin: { l: 60, r: 10, t: 8, b: 42 },
      xaxis: { title: { text: t("axis.time", { unit: "s" }) } }, yaxis: { zeroline: true, automargin: true, title: { text: `${t(`response.${answer.quantity}`)} [${unit}]` } },
    });
    this.plot.dataset.samples = times.length;
  }
}
