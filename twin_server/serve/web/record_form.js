// The form by which an event of an asset is recorded or corrected: which kind, of what, when, with which result.
import { choices, labelled, written } from "./form_fields.js";
import { t } from "./language.js";
import { button, make, slowTime, titleOf } from "./words.js";

const KINDS = {
  repair: t("record.repair"), replacement: t("record.replacement"), inspection: t("record.inspection"), load_test: t("record.load_test"), note: t("record.note"),
};
const SHARES = { all: t("record.restored_all"), share: t("record.restored_share"), unknown: t("record.restored_unknown") };
/** Fields of an event that a correction changes. */
const CORRECTED = ["kind", "quantity", "at", "text", "repair", "replacement", "measured", "detection"];
const PARTS = { nominal: t("record.part_nominal"), unknown: t("record.part_unknown") };
const RESULTS = { measured: t("record.result_measured"), found: t("record.result_found"), none: t("record.result_none") };

/** An id that the server has not seen: made once for a form, so that sending it again is no second event. */
export const nameOf = () => `page-${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 10)}`;

/** In per cent, without the noise of binary fractions. */
const percentOf = (share) => +(100 * share).toPrecision(12);

/** A time as a field of a form takes it: of the browser's own zone. */
const local = (ns) => {
  const date = new Date(ns / 1e6);
  return new Date(date - 60_000 * date.getTimezoneOffset()).toISOString().slice(0, 19);
};

const numeric = (value, least, most) => Object.assign(make("input"), { type: "number", step: "any", value, min: least, max: most, required: true });

/** What of a twin can be repaired: what it estimates. */
function quantitiesOf({ registration, elements }) {
  if (registration.changes === "elements") return Object.keys(elements ?? {});
  return registration.changes === "both" ? ["stiffness_change", "mass_change"] : [`${registration.changes}_change`];
}

export class RecordForm {
  constructor(latest, given, record, cancel) {
    Object.assign(this, { given, event: nameOf() });
    this.root = make("form", undefined, "record");
    const select = (text, of) => {
      const made = labelled(text, make("select"), this.root);
      choices(made.input, of);
      made.input.addEventListener("change", () => this.fit());
      return made;
    };
    this.kind = select(t("record.kind"), KINDS);
    const names = quantitiesOf(latest);
    this.quantity = select(t("record.of"), { "": t("record.of_all"), ...Object.fromEntries(names.map((name) => [name, titleOf(name)])) });
    if (given.slow_time === undefined) {
      this.at = labelled(t("record.when"), Object.assign(make("input"), { type: "datetime-local", step: 1 }), this.root);
    } else this.root.append(make("p", t("record.after", { time: slowTime({ ...latest, slow_time: given.slow_time }) })));
    this.share = select(t("record.restored"), SHARES);
    this.percent = labelled(t("record.share"), numeric(80, 0, 100), this.root);
    this.part = select(t("record.part"), PARTS);
    this.result = select(t("record.result"), RESULTS);
    this.change = labelled(t("record.change"), numeric(-10, -100, 1e6), this.root);
    this.sd = labelled(t("record.sd"), numeric(5, 0, 1e6), this.root);
    this.a50 = labelled(t("record.a50"), numeric(10, 0, 100), this.root);
    this.slope = labelled(t("record.slope"), numeric(2, 0, 1e3), this.root);
    this.person = labelled(t("form.name"), written({ autocomplete: "name", maxLength: 100 }), this.root);
    this.text = labelled(t("record.text"), written({ maxLength: 2000 }), this.root);
    if (given.event) this.reason = labelled(t("form.reason"), written({ maxLength: 2000 }), this.root);
    this.send = make("button", t(given.event ? "limits.save" : "record.record"), "act");
    this.problem = make("span", "", "alarm");
    this.problem.setAttribute("role", "alert");
    this.root.append(this.send, button(t("form.cancel"), cancel), this.problem);
    if (given.kind) this.kind.input.value = given.kind;
    if (given.quantity && names.includes(given.quantity)) this.quantity.input.value = given.quantity;
    this.root.addEventListener("keydown", (pressed) => { if (pressed.key === "Escape") cancel(); });
    this.root.addEventListener("submit", (submitted) => {
      submitted.preventDefault();
      this.send.disabled = true;
      record(given.event ? this.correction() : this.body());
    });
    if (given.event) this.hold(given.event, names);
    this.fit();
    if (given.event) this.before = this.body();
  }

  /** Show what an event says, so that it is corrected from there. */
  hold({ kind, quantity, t_ns: time, text, repair, replacement, measured, detection }, names) {
    const values = [[this.kind, kind], [this.quantity, names.includes(quantity) ? quantity : ""], [this.text, text]];
    if (time !== null) values.push([this.at, local(time)]);
    const { restored_share: share = null, restored_share_sd: shareSd = 0 } = repair ?? {};
    values.push([this.share, share === null ? "unknown" : share === 1 && shareSd === 0 ? "all" : "share"]);
    if (share !== null) values.push([this.percent, percentOf(share)], [this.sd, percentOf(shareSd)]);
    const { change = 0, sd = null } = replacement ?? {};
    if (change && sd) choices(this.part.input, { told: t("record.part_told", { change: percentOf(change), sd: percentOf(sd) }) });
    values.push([this.part, change === null ? "unknown" : change && sd ? "told" : "nominal"]);
    if (measured) values.push([this.change, percentOf(measured.value)], [this.sd, percentOf(measured.sd)]);
    else if (kind === "load_test") values.push([this.change, ""], [this.sd, ""]);
    if (detection) {
      const { a50, slope, points } = detection.probability_of_detection;
      this.curve = points.length ? detection.probability_of_detection : null;
      values.push([this.result, detection.detected ? "found" : "none"]);
      if (!this.curve) values.push([this.a50, percentOf(a50)], [this.slope, slope]);
    }
    for (const [{ input }, value] of values) input.value = value;
  }

  /** What differs from the event as it was, and who says so, and why. */
  correction() {
    const now = this.body(), [before, after] = [this.before, now].map((body) => CORRECTED.map((name) => [name, body[name] ?? null]));
    const changed = after.filter(([, value], i) => JSON.stringify(value) !== JSON.stringify(before[i][1]));
    return { after: Object.fromEntries(changed), person: now.person, text: this.reason.input.value.trim() };
  }

  begin() { this.kind.input.focus(); }

  ready() { this.send.disabled = false; }

  /** Only what goes with the kind is asked for. */
  fit() {
    const kind = this.kind.input.value, detected = kind === "inspection" && this.result.input.value !== "measured";
    const measured = kind === "load_test" || (kind === "inspection" && !detected), shared = kind === "repair" && this.share.input.value === "share";
    const asked = [
      [this.share, kind === "repair"], [this.percent, shared], [this.part, kind === "replacement"],
      [this.result, kind === "inspection"], [this.change, measured], [this.sd, measured || shared],
      [this.a50, detected && !this.curve], [this.slope, detected && !this.curve],
    ];
    for (const [{ label, input }, needed] of asked) [label.hidden, input.disabled] = [!needed, !needed];
    // A load test may be recorded without a number, an inspection may not.
    for (const { input } of [this.change, this.sd]) input.required = kind !== "load_test";
  }

  body() {
    const value = ({ input }) => input.value, share = (field) => Number(value(field)) / 100, kind = value(this.kind);
    const body = { event: this.event, kind, text: value(this.text).trim(), person: value(this.person).trim() || null, quantity: value(this.quantity) || null };
    if (this.given.answers) body.answers = this.given.answers;
    if (this.given.slow_time !== undefined) body.slow_time = this.given.slow_time;
    else if (value(this.at)) body.at = new Date(value(this.at)).toISOString();
    if (kind === "repair" && value(this.share) === "all") body.repair = { restored_share: 1 };
    if (kind === "repair" && value(this.share) === "share") body.repair = { restored_share: share(this.percent), restored_share_sd: share(this.sd) };
    if (kind === "replacement") body.replacement = value(this.part) === "told" ? this.given.event.replacement : { change: value(this.part) === "nominal" ? 0 : null };
    if (!this.change.input.disabled && value(this.change)) body.measured = { value: share(this.change), sd: share(this.sd) };
    if (kind === "inspection" && value(this.result) !== "measured") {
      const law = this.curve ?? { a50: share(this.a50), slope: Number(value(this.slope)) };
      body.detection = { detected: value(this.result) === "found", probability_of_detection: law };
    }
    return body;
  }
}
