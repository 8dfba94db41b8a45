// The limits of a twin: those that raise an alarm, and those whose time is foretold; changed and put back by those who may.
import { t } from "./language.js";
import { send } from "./link.js";
import { button, digits, english, explain, make, say, titleOf } from "./words.js";

const SIDES = { below: t("limits.below"), above: t("limits.above"), at: t("limits.at") };
const CERTAINTY = 0.975;

const scaleOf = (quantity) => quantity === "frequency_hz" ? [1, "Hz"] : [100, "%"];

/** Limits of a registration in rows: an alarm has a side, a threshold of the forecast is a question. */
const rowsOf = ({ alarms = [], forecast }) => [
  ...alarms.map(({ quantity, below, above, certainty }) => ({ quantity, side: above === null || above === undefined ? "below" : "above", value: below ?? above, certainty })),
  ...(forecast?.thresholds ?? []).map(({ quantity, at }) => ({ quantity, side: "at", value: at, certainty: null })),
];

function said({ quantity, side, value, certainty }) {
  const [scale, unit] = scaleOf(quantity), limit = `${digits(scale * value, 4)}\u202f${unit}`;
  return t(`limits.said_${side}`, { quantity: titleOf(quantity), limit, certainty: certainty === null ? "" : `${digits(100 * certainty, 4)}\u202f%` });
}

/** What can have a limit: what is measured, and what the twin estimates. */
function quantitiesOf({ registration: { changes }, elements }) {
  const estimated = changes === "elements" ? ["elements", ...Object.keys(elements ?? {})] : changes === "both" ? ["stiffness_change", "mass_change"] : [`${changes}_change`];
  return Object.fromEntries([...estimated, "frequency_hz", "damping_ratio"].map((name) => [name, name === "elements" ? t("limits.any_element") : titleOf(name)]));
}

function choice(of, chosen, label) {
  const select = make("select");
  select.append(...Object.entries(of).map(([value, text]) => new Option(text, value, value === chosen, value === chosen)));
  select.setAttribute("aria-label", label);
  return select;
}

function numeric(value, label) {
  const input = Object.assign(make("input"), { type: "number", step: "any", value, required: true });
  input.setAttribute("aria-label", label);
  return input;
}

export class Limits {
  constructor(twin) {
    this.twin = twin;
    this.root = make("details", undefined, "limits");
    this.summary = make("summary", t("limits.none"));
    [this.list, this.place] = [make("ul"), make("div")];
    this.open = button(t("limits.change"), () => this.edit());
    this.answer = make("p", "", "answer");
    this.answer.setAttribute("role", "status");
    this.root.append(this.summary, this.list, this.open, this.place, this.answer);
  }

  tell({ latest, at }) {
    if (!latest) return;
    this.latest = latest;
    this.open.hidden = Boolean(at) || Boolean(this.form);
    const rows = rowsOf(latest.registration), key = JSON.stringify(rows);
    if (this.told === key) return;
    this.told = key;
    this.summary.textContent = rows.length ? t("limits.title", { n: rows.length, limits: rows.map(said).join("; ") }) : t("limits.none");
    this.list.replaceChildren(...rows.map((row) => make("li", said(row))));
  }

  edit() {
    const form = this.form = make("form", undefined, "record"), rows = make("div"), quantities = quantitiesOf(this.latest);
    const add = (row) => rows.append(this.row(row, quantities));
    for (const row of rowsOf(this.latest.registration)) add(row);
    const [first] = Object.keys(quantities), fresh = { quantity: first, side: "below", value: "", certainty: CERTAINTY }, save = make("button", t("limits.save"), "act");
    form.append(
      rows, button(t("limits.add"), () => add(fresh)), save,
      button(t("form.cancel"), () => this.close()),
    );
    form.addEventListener("submit", (submitted) => {
      submitted.preventDefault();
      this.give([...rows.children].map((row) => row.read()));
    });
    form.addEventListener("keydown", (pressed) => { if (pressed.key === "Escape") this.close(); });
    this.place.replaceChildren(form);
    this.open.hidden = true;
    (rows.querySelector("select") ?? save).focus();
  }

  row({ quantity, side, value, certainty }, quantities) {
    const root = make("p"), [scale] = scaleOf(quantity);
    const [of, where] = [choice(quantities, quantity, t("limits.quantity")), choice(SIDES, side, t("limits.side"))];
    const limit = numeric(value === "" ? "" : +(scale * value).toPrecision(12), t("limits.value")), sure = numeric(100 * (certainty ?? CERTAINTY), t("limits.certainty")), unit = make("span");
    Object.assign(sure, { min: 50, max: 99.99 });
    const fit = () => {
      unit.textContent = ` ${scaleOf(of.value)[1]} `;
      sure.hidden = sure.disabled = where.value === "at";
    };
    for (const each of [of, where]) each.addEventListener("change", fit);
    fit();
    root.append(of, " ", where, " ", limit, unit, sure, " ", button(t("limits.remove"), () => root.remove()));
    root.read = () => ({ quantity: of.value, side: where.value, value: Number(limit.value) / scaleOf(of.value)[0], certainty: Number(sure.value) / 100 });
    return root;
  }

  /** Register the twin anew with these limits; what it was before can be put back. */
  async give(rows) {
    const before = this.latest.registration;
    const alarms = rows.filter(({ side }) => side !== "at").map(({ quantity, side, value, certainty }) => ({ quantity, [side]: value, certainty }));
    const thresholds = rows.filter(({ side }) => side === "at").map(({ quantity, value }) => ({ quantity, at: value }));
    await this.register({ ...before, alarms, forecast: { ...before.forecast, thresholds } }, before);
  }

  async register(registration, before) {
    this.answer.removeAttribute("lang");
    say(this.answer, "waiting", t("limits.saving"));
    try {
      this.twin.hear(await send(this.twin.base, "PUT", registration));
      this.close();
      say(this.answer, "good", t("limits.saved"));
      if (before) this.answer.append(" ", button(t("form.undo"), () => this.register(before, null)));
    } catch (error) {
      this.answer.dataset.state = "bad";
      explain(error.status ? english(this.answer) : this.answer, error);
    }
  }

  close() {
    this.form = null;
    this.place.replaceChildren();
    this.open.hidden = false;
    this.open.focus();
  }
}
