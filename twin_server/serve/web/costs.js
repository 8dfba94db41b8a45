// What failing, repairing and inspecting cost, and what counts as a failure: shown, and changed by those who may.
import { authorIn, choices, labelled, written } from "./form_fields.js";
import { counted, t } from "./language.js";
import { button, make, titleOf } from "./words.js";

/** Amounts have a standard deviation; times, and the rate at which later costs count less, have none. */
const AMOUNTS = ["failure", "repair", "inspection", "downtime"], TIMES = ["failure_downtime", "repair_downtime", "inspection_downtime", "discount_rate"];
const UNITS = Object.fromEntries(["year", "month", "d", "h", "s", "slow_time"].map((unit) => [unit, t(`unit.plan.${unit}`)]));
const SIDES = { below: t("limits.below"), above: t("limits.above") };

const meanOf = (amount) => amount?.mean ?? amount, sdOf = (amount) => amount?.sd ?? 0;
const percent = (share) => share === null || share === undefined ? "" : +(100 * share).toPrecision(12);
const shareOf = (text) => +(text / 100).toPrecision(12);
const numeric = (value, more) => Object.assign(make("input"), { type: "number", step: "any", value: value ?? "", required: true, ...more });

/** What of a twin can fail. */
const failingOf = ({ registration: { changes }, elements }) => (
  changes === "elements" ? Object.keys(elements ?? {}) : changes === "both" ? ["stiffness_change", "mass_change"] : [`${changes}_change`]
);

export class Costs {
  constructor(changes) {
    this.changes = changes;
    this.root = make("details", undefined, "costs");
    [this.summary, this.place, this.answer] = [make("summary", t("costs.none")), make("div"), make("p", "", "answer")];
    this.open = button(t("costs.change"), () => this.edit(), "writes");
    this.answer.setAttribute("role", "status");
    this.root.append(this.summary, make("p", t("costs.note"), "facts"), this.open, this.place, this.answer);
  }

  tell({ latest, at }) {
    if (!latest) return;
    this.latest = latest;
    this.open.hidden = Boolean(at) || Boolean(this.form);
    const { costs } = latest.registration, key = JSON.stringify(costs);
    if (this.told === key) return;
    this.told = key;
    const said = (name) => `${t(`costs.${name}`)} ${counted(meanOf(costs[name]))}`;
    this.summary.textContent = costs ? t("costs.title", { costs: AMOUNTS.slice(0, 3).map(said).join(", "), currency: costs.currency }) : t("costs.none");
  }

  edit() {
    const form = this.form = make("form", undefined, "record"), [costs, decision] = [make("fieldset"), make("fieldset")], who = make("p"), save = make("button", t("limits.save"), "act");
    this.before = { costs: this.latest.registration.costs, decision: this.latest.registration.decision };
    costs.append(make("legend", t("costs.costs")));
    decision.append(make("legend", t("costs.decision")));
    const reads = [this.costsIn(costs, this.before.costs ?? {}), this.decisionIn(decision, this.before.decision ?? {})], author = authorIn(who);
    form.append(costs, decision, who, save, " ", button(t("form.cancel"), () => this.close()));
    form.addEventListener("submit", (submitted) => {
      submitted.preventDefault();
      const [after, limit] = reads.map((read) => read());
      this.give({ costs: after, decision: limit }, author());
    });
    form.addEventListener("keydown", (pressed) => { if (pressed.key === "Escape") this.close(); });
    this.place.replaceChildren(form);
    this.open.hidden = true;
    form.querySelector("input").focus();
  }

  /** Fields of the costs; what the form does not ask for stays as it is. */
  costsIn(fields, given) {
    const currency = labelled(t("costs.currency"), written({ value: given.currency ?? "EUR", maxLength: 16, required: true }), fields).input;
    const unit = labelled(t("costs.time_unit"), make("select"), fields).input;
    choices(unit, UNITS);
    unit.value = given.time_unit ?? "year";
    const amounts = AMOUNTS.map((name) => {
      const [needed, label] = [name === "failure" || name === "repair", t(`costs.${name}`)];
      const mean = labelled(label, numeric(meanOf(given[name]) ?? (needed ? "" : 0), { min: 0 }), fields).input;
      return [name, mean, labelled(t("costs.sd", { cost: label }), numeric(sdOf(given[name]), { min: 0 }), fields).input];
    });
    const times = TIMES.map((name) => [name, labelled(t(`costs.${name}`), numeric(given[name] ?? 0, { min: 0 }), fields).input]);
    return () => ({
      ...given, currency: currency.value.trim(), time_unit: unit.value,
      ...Object.fromEntries(amounts.map(([name, mean, sd]) => [name, +sd.value ? { mean: +mean.value, sd: +sd.value } : +mean.value])),
      ...Object.fromEntries(times.map(([name, input]) => [name, +input.value])),
    });
  }

  decisionIn(fields, given) {
    const { failure } = given, names = failingOf(this.latest), inspects = given.inspection?.detects_half == null;
    const select = (label, of, chosen) => {
      const { input } = labelled(label, make("select"), fields);
      choices(input, of);
      if (chosen) input.value = chosen;
      return input;
    };
    const quantity = select(t("limits.quantity"), Object.fromEntries(names.map((name) => [name, titleOf(name)])), failure?.quantity);
    const side = select(t("limits.side"), SIDES, failure && failure.above != null ? "above" : "below");
    const limit = labelled(t("costs.limit"), numeric(percent(failure?.below ?? failure?.above)), fields).input;
    const horizon = labelled(t("costs.horizon"), numeric(given.horizon, { min: 0 }), fields).input;
    const lead = labelled(t("costs.lead_time"), numeric(given.lead_time ?? 0, { min: 0 }), fields).input;
    const accepted = labelled(t("costs.accepted"), numeric(percent(given.accepted), { min: 0, max: 100, required: false }), fields).input;
    const sd = inspects && labelled(t("costs.inspection_sd"), numeric(percent(given.inspection?.sd), { min: 0, required: false }), fields).input;
    return () => {
      const read = {
        ...given, failure: { quantity: quantity.value, [side.value]: shareOf(limit.value) }, horizon: +horizon.value, lead_time: +lead.value,
        accepted: accepted.value === "" ? null : shareOf(accepted.value),
      };
      if (sd) read.inspection = sd.value === "" ? null : { ...given.inspection, sd: shareOf(sd.value) };
      return read;
    };
  }

  async give(after, author) {
    if (await this.changes.save({ before: this.before, after, ...author }, this.answer)) this.close();
  }

  close() {
    this.form = null;
    this.place.replaceChildren();
    this.open.hidden = false;
    this.open.focus();
  }
}
