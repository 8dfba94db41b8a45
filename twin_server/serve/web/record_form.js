// The form by which an event of an asset is recorded: which kind, of what, when, with which result.
import { choices, labelled, written } from "./form_fields.js";
import { t } from "./language.js";
import { button, make, slowTime, titleOf } from "./words.js";

const KINDS = {
  repair: t("record.repair"), replacement: t("record.replacement"), inspection: t("record.inspection"), load_test: t("record.load_test"), note: t("record.note"),
};
const SHARES = { all: t("record.restored_all"), share: t("record.restored_share"), unknown: t("record.restored_unknown") };
const PARTS = { nominal: t("record.part_nominal"), unknown: t("record.part_unknown") };
const RESULTS = { measured: t("record.result_measured"), found: t("record.result_found"), none: t("record.result_none") };

/** An id that the server has not seen: made once for a form, so that sending it again is no second event. */
export const nameOf = () => `page-${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 10)}`;

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
    this.send = make("button", t("record.record"), "act");
    this.problem = make("span", "", "alarm");
    this.problem.setAttribute("role", "alert");
    this.root.append(this.send, button(t("form.cancel"), cancel), this.problem);
    if (given.kind) this.kind.input.value = given.kind;
    if (given.quantity && names.includes(given.quantity)) this.quantity.input.value = given.quantity;
    this.root.addEventListener("keydown", (pressed) => { if (pressed.key === "Escape") cancel(); });
    this.root.addEventListener("submit", (submitted) => {
      submitted.preventDefault();
      this.send.disabled = true;
      record(this.body());
    });
    this.fit();
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
      [this.a50, detected], [this.slope, detected],
    ];
    for (const [{ label, input }, needed] of asked) [label.hidden, input.disabled] = [!needed, !needed];
  }

  body() {
    const value = ({ input }) => input.value, share = (field) => Number(value(field)) / 100, kind = value(this.kind);
    const body = { event: this.event, kind, text: value(this.text).trim(), person: value(this.person).trim() || null, quantity: value(this.quantity) || null };
    if (this.given.answers) body.answers = this.given.answers;
    if (this.given.slow_time !== undefined) body.slow_time = this.given.slow_time;
    else if (value(this.at)) body.at = new Date(value(this.at)).toISOString();
    if (kind === "repair" && value(this.share) === "all") body.repair = { restored_share: 1 };
    if (kind === "repair" && value(this.share) === "share") body.repair = { restored_share: share(this.percent), restored_share_sd: share(this.sd) };
    if (kind === "replacement") body.replacement = { change: value(this.part) === "nominal" ? 0 : null };
    if (!this.change.input.disabled) body.measured = { value: share(this.change), sd: share(this.sd) };
    if (!this.a50.input.disabled) {
      const law = { a50: share(this.a50), slope: Number(value(this.slope)) };
      body.detection = { detected: value(this.result) === "found", probability_of_detection: law };
    }
    return body;
  }
}
