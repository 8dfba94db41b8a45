// Who changed limits, costs and recorded events of a twin, when, from what to what; each change can be undone.
import { locale, t } from "./language.js";
import { rowsOf, said } from "./limit_words.js";
import { ask, send } from "./link.js";
import { saidOf } from "./recorded_words.js";
import { button, english, explain, make, say } from "./words.js";

/** `[path, value]` of all that a value holds. */
const leavesOf = (value, path) => value === null || typeof value !== "object" ? [[path, value]]
  : Object.entries(value).flatMap(([name, inner]) => leavesOf(inner, `${path}.${name}`));

const shown = (value) => value === null || value === undefined || value === "" ? "\u2013" : `${value}`;

/** Limits before and after as sentences; of other fields what differs, by its name in the registration. */
function linesOf({ field, before, after }) {
  if (field === "alarms" || field === "forecast") {
    const [old, now] = [before, after].map((value) => rowsOf({ [field]: value }).map(said));
    const lines = [...old.filter((one) => !now.includes(one)).map((one) => ["del", one]), ...now.filter((one) => !old.includes(one)).map((one) => ["ins", one])];
    if (lines.length) return lines.map(([tag, text]) => { const line = make("div"); line.append(make(tag, text)); return line; });
  }
  const [old, now] = [before, after].map((value) => new Map(leavesOf(value, field)));
  return [...new Set([...old.keys(), ...now.keys()])].filter((path) => shown(old.get(path)) !== shown(now.get(path))).map((path) => {
    const line = english(make("div"));
    line.append(make("code", path), " ", make("del", shown(old.get(path))), " \u2192 ", make("ins", shown(now.get(path))));
    return line;
  });
}

export class Changes {
  constructor(twin) {
    Object.assign(this, { twin, told: null });
    this.root = make("details", undefined, "revisions");
    this.answer = make("p", "", "answer");
    this.answer.setAttribute("role", "status");
    this.list = make("ol");
    this.root.append(make("summary", t("changes.title")), this.answer, this.list);
    this.root.addEventListener("toggle", () => this.refresh());
  }

  /** An event says that there is a new change. */
  tell({ events, at }) {
    const last = events.findLast(({ kind, details }) => kind === "registered" || details?.corrects);
    const key = `${last?.number} ${Boolean(at)}`;
    if (this.told === key) return;
    [this.told, this.past] = [key, Boolean(at)];
    this.refresh();
  }

  async refresh() {
    if (!this.root.open) return;
    try {
      const { changes } = await ask(`${this.twin.base}/changes`);
      this.list.replaceChildren(...changes.map((change) => this.item(change)));
      if (!changes.length) say(this.answer, "", t("changes.none"));
      else if (!this.answer.dataset.state) say(this.answer, "", "");
    } catch (error) {
      this.answer.dataset.state = "bad";
      explain(this.answer, error);
    }
  }

  item(change) {
    const { number, t_ns: time, person, principal, text, changes, others, event, recorded_as: now, reverses, reversed_by: by } = change;
    const item = make("li"), when = make("span", new Date(time / 1e6).toLocaleString(locale), "when");
    item.dataset.number = number;
    const who = person === principal ? person : t("changes.for", { person, principal });
    item.append(when, " ", make("strong", who), text ? `: ${text}` : "");
    if (reverses !== null) item.append(" ", make("span", t("changes.undoes", { number: reverses }), "severity"));
    item.append(...(event === null ? changes.flatMap(linesOf) : this.correction(event, now)), ...others.map((name) => english(make("div", name))));
    if (by !== null) {
      item.classList.add("reversed");
      item.append(make("span", t("changes.undone", { number: by }), "severity"));
    } else if (!others.length && !this.past) {
      const undo = button(t("form.undo"), () => this.undo(number, this.answer), "writes");
      undo.setAttribute("aria-label", t("changes.undo", { number, person }));
      item.append(undo);
    }
    return item;
  }

  /** What a corrected event said, and what the event says that was recorded instead. */
  correction(...names) {
    const { events } = this.twin.recorded;
    return names.map((name, i) => {
      const line = make("div"), found = events.find(({ event }) => event === name);
      line.append(make(i ? "ins" : "del", found ? saidOf(found) : name));
      return line;
    });
  }

  /** Send a change; what the twin is now is shown at once. */
  async give(order) {
    const told = await send(`${this.twin.base}/changes`, "POST", order);
    this.twin.hear(await ask(this.twin.base));
    this.twin.forecastAt = 0;
    this.refresh();
    return told;
  }

  async undo(number, answer) {
    answer.removeAttribute("lang");
    say(answer, "waiting", t("changes.saving"));
    try {
      await this.give({ reverses: number });
      say(answer, "good", t("changes.put_back"));
    } catch (error) {
      answer.dataset.state = "bad";
      explain(answer, error);
    }
  }

  /** Save what a form holds, say so in `answer`, and offer to undo it; true if it was saved. */
  async save(order, answer) {
    answer.removeAttribute("lang");
    say(answer, "waiting", t("changes.saving"));
    try {
      const { number } = await this.give(order);
      say(answer, "good", t("changes.saved"));
      answer.append(" ", button(t("form.undo"), () => this.undo(number, answer), "writes"));
      return true;
    } catch (error) {
      answer.dataset.state = "bad";
      explain(answer, error);
      return false;
    }
  }
}
