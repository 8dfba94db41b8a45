// The limits of a twin: those that raise an alarm, and those whose time is foretold; changed and put back by those who may.
import { authorIn } from "./form_fields.js";
import { t } from "./language.js";
import { nameOf, rowsOf, said, scaleOf } from "./limit_words.js";
import { button, make } from "./words.js";

const SIDES = { below: t("limits.below"), above: t("limits.above"), at: t("limits.at") };
const CERTAINTY = 0.975;

/** What can have a limit: what is measured, and what the twin estimates. */
function quantitiesOf({ registration: { changes }, elements }) {
  const estimated = changes === "elements" ? ["elements", ...Object.keys(elements ?? {})] : changes === "both" ? ["stiffness_change", "mass_change"] : [`${changes}_change`];
  return Object.fromEntries([...estimated, "frequency_hz", "damping_ratio"].map((name) => [name, nameOf(name)]));
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
  constructor(changes) {
    this.changes = changes;
    this.root = make("details", undefined, "limits");
    this.summary = make("summary", t("limits.none"));
    [this.list, this.place] = [make("ul"), make("div")];
    this.open = button(t("limits.change"), () => this.edit(), "writes");
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
    const form = this.form = make("form", undefined, "record"), rows = make("div"), quantities = quantitiesOf(this.latest), who = make("p");
    this.before = this.latest.registration;
    const add = (row) => rows.append(this.row(row, quantities));
    for (const row of rowsOf(this.latest.registration)) add(row);
    const [first] = Object.keys(quantities), fresh = { quantity: first, side: "below", value: "", certainty: CERTAINTY }, save = make("button", t("limits.save"), "act");
    const author = authorIn(who);
    form.append(
      rows, button(t("limits.add"), () => add(fresh)), who, save, " ",
      button(t("form.cancel"), () => this.close()),
    );
    form.addEventListener("submit", (submitted) => {
      submitted.preventDefault();
      this.give([...rows.children].map((row) => row.read()), author());
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

  /** Refused where somebody else has changed the limits since the form was opened. */
  async give(rows, author) {
    const { alarms: were, forecast } = this.before;
    const alarms = rows.filter(({ side }) => side !== "at").map(({ quantity, side, value, certainty }) => ({ quantity, [side]: value, certainty }));
    const thresholds = rows.filter(({ side }) => side === "at").map(({ quantity, value }) => ({ quantity, at: value }));
    const order = { before: { alarms: were, forecast }, after: { alarms, forecast: { ...forecast, thresholds } }, ...author };
    if (await this.changes.save(order, this.answer)) this.close();
  }

  close() {
    this.form = null;
    this.place.replaceChildren();
    this.open.hidden = false;
    this.open.focus();
  }
}
