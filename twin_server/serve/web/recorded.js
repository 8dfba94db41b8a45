// Repairs, replacements, inspections and notes of an asset: listed, recorded, taken back; and the question whether something was repaired.
import { locale, parts, t } from "./language.js";
import { send } from "./link.js";
import { RecordForm, nameOf } from "./record_form.js";
import { button, english, explain, make, say, whenOf } from "./words.js";

export class Recorded {
  constructor() {
    this.root = make("details", undefined, "recorded");
    this.summary = make("summary", t("recorded.none"));
    [this.questions, this.list] = [make("ul", undefined, "questions"), make("ol")];
    this.open = button(t("recorded.open"), () => this.ask({}));
    this.open.classList.add("writes");
    this.place = make("div");
    this.answer = make("p", "", "answer");
    this.answer.setAttribute("role", "status");
    this.root.append(this.summary, this.questions, this.open, this.place, this.answer, this.list);
  }

  tell({ base, at, latest, recorded, reload }) {
    Object.assign(this, { base, latest, reload, past: at });
    const { events, questions } = recorded, open = questions.filter(({ answered_by: by }) => by === null);
    const shown = at ? events.filter(({ slow_time: time }) => time !== null && time <= at.slow_time) : events;
    const key = JSON.stringify([shown.map(({ event, reversed_by: by }) => [event, by]), open.map(({ event_id: id }) => id), Boolean(at)]);
    if (this.told === key) return;
    this.told = key;
    const holding = shown.filter(({ reverses, reversed_by: by }) => reverses === null && by === null);
    const asked = open.length && !at ? t("recorded.questions", { n: open.length }) : "";
    const last = holding[0] ? parts("recorded.last", { n: holding.length, event: english(make("span", holding[0].sentence)) }) : [t("recorded.none")];
    this.summary.replaceChildren(...(asked ? [asked] : last));
    this.root.dataset.severity = asked ? "warning" : "info";
    if (asked && !this.shownOnce) this.root.open = this.shownOnce = true;
    this.open.hidden = Boolean(this.form) || Boolean(at);
    this.questions.replaceChildren(...(at ? [] : open.map((question) => this.question(question))));
    this.list.replaceChildren(...shown.map((event) => this.item(event, Boolean(at))));
  }

  question(question) {
    const item = make("li");
    item.dataset.severity = "warning";
    const { event_id: answers, quantity, since } = question;
    item.append(
      english(make("span", question.message)), " ",
      button(t("recorded.record"), () => this.ask({ kind: "repair", answers, quantity, slow_time: since })),
      " ",
      button(t("recorded.real"), () => this.give({ event: nameOf(), kind: "note", answers, quantity, slow_time: since, text: "No repair: it is a real change." })),
    );
    return item;
  }

  item(event, past) {
    const item = make("li"), when = make("span", event.slow_time === null ? new Date(event.t_ns / 1e6).toLocaleString(locale) : whenOf(event, this.latest), "when");
    item.append(when, english(make("span", event.sentence)));
    if (event.reversed_by !== null) {
      item.className = "reversed";
      item.append(" ", make("span", t("recorded.taken_back"), "severity"));
    } else if (event.reverses === null && !past) {
      const undo = button(t("form.undo"), () => this.give({ event: nameOf(), kind: "note", reverses: event.event }));
      undo.classList.add("writes");
      undo.setAttribute("aria-label", t("recorded.undo", { event: event.sentence }));
      item.append(" ", undo);
    }
    return item;
  }

  ask(given) {
    this.close();
    this.form = new RecordForm(this.latest, given, (body) => this.give(body), () => this.close(true));
    this.place.append(this.form.root);
    this.open.hidden = true;
    this.form.begin();
  }

  /** What the server keeps is what is shown: it is asked for anew. */
  async give(body) {
    try {
      const told = await send(`${this.base}/events`, "POST", body);
      say(english(this.answer), "good", told.sentence);
      this.close(true);
      this.reload();
    } catch (error) {
      const place = this.form?.problem ?? this.answer;
      place.dataset.state = "bad";
      explain(place, error);
      this.form?.ready();
    }
  }

  /** Whoever works with a keyboard goes on from where they were. */
  close(back = false) {
    const inside = this.form?.root.contains(document.activeElement);
    this.form?.root.remove();
    this.form = null;
    this.open.hidden = Boolean(this.past);
    if (back && inside) this.open.focus();
  }
}
