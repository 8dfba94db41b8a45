// Repairs, replacements, inspections and notes of an asset: listed, recorded, corrected, taken back; and the question whether something was repaired.
import { locale, parts, t } from "./language.js";
import { send } from "./link.js";
import { RecordForm, nameOf } from "./record_form.js";
import { saidOf } from "./recorded_words.js";
import { button, composed, explain, make, say, whenOf } from "./words.js";

export class Recorded {
  constructor(changes) {
    this.changes = changes;
    this.root = make("details", undefined, "recorded");
    this.summary = make("summary", t("recorded.none"));
    [this.questions, this.list] = [make("ul", undefined, "questions"), make("ol")];
    this.open = button(t("recorded.open"), () => this.ask({}), "writes");
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
    const last = holding[0] ? t("recorded.last", { n: holding.length, event: saidOf(holding[0]) }) : t("recorded.none");
    this.summary.textContent = asked || last;
    this.root.dataset.severity = asked ? "warning" : "info";
    if (asked && !this.shownOnce) this.root.open = this.shownOnce = true;
    this.open.hidden = Boolean(this.form) || Boolean(at);
    this.questions.replaceChildren(...(at ? [] : open.map((question) => this.question(question))));
    this.events = new Map(shown.map((event) => [event.event, event]));
    const corrected = new Set(shown.map(({ corrects }) => corrects?.event));
    this.list.replaceChildren(...shown.filter(({ event }) => !corrected.has(event)).map((event) => this.item(event, Boolean(at))));
  }

  question(question) {
    const item = make("li");
    item.dataset.severity = "warning";
    const { event_id: answers, quantity, since } = question;
    item.append(
      composed("span", question.message), " ",
      button(t("recorded.record"), () => this.ask({ kind: "repair", answers, quantity, slow_time: since }), "writes"),
      " ",
      button(t("recorded.real"), () => this.give({ event: nameOf(), kind: "note", answers, quantity, slow_time: since, text: t("recorded.no_repair") }), "writes"),
    );
    return item;
  }

  item(event, past) {
    const item = make("li"), when = make("span", event.slow_time === null ? new Date(event.t_ns / 1e6).toLocaleString(locale) : whenOf(event, this.latest), "when");
    const said = saidOf(event);
    item.append(when, make("span", said), ...this.former(event));
    if (event.reversed_by !== null) {
      item.className = "reversed";
      item.append(" ", make("span", t("recorded.taken_back"), "severity"));
    } else if (event.reverses === null && !past) {
      const correct = button(t("recorded.correct"), () => this.ask({ event }, correct), "writes");
      const undo = button(t("form.undo"), () => this.give({ event: nameOf(), kind: "note", reverses: event.event }), "writes");
      correct.setAttribute("aria-label", t("recorded.correct_event", { event: said }));
      undo.setAttribute("aria-label", t("recorded.undo", { event: said }));
      item.append(" ", correct, " ", undo);
    }
    return item;
  }

  /** Who corrected an event, when and why, and what it said before: one line for each correction, the newest first. */
  former({ corrects, person, accepted_ns: time }) {
    const was = corrects && this.events.get(corrects.event);
    if (!was) return [];
    const line = make("div", undefined, "former"), date = new Date(time / 1e6).toLocaleString(locale);
    line.append(t(corrects.text ? "recorded.corrected_because" : "recorded.corrected", { person, date, reason: corrects.text }), " ", make("del", saidOf(was)));
    return [line, ...this.former(was)];
  }

  ask(given, opener = this.open) {
    this.close();
    this.opener = opener;
    const record = (body) => given.event ? this.correct(given.event, body) : this.give(body);
    this.form = new RecordForm(this.latest, given, record, () => this.close(true));
    this.place.append(this.form.root);
    this.open.hidden = true;
    this.form.begin();
  }

  /** What the server keeps is what is shown: it is asked for anew. */
  async give(body) {
    try {
      const told = await send(`${this.base}/events`, "POST", body);
      this.answer.removeAttribute("lang");
      say(this.answer, "good", saidOf(told));
      this.close(true);
      this.reload();
    } catch (error) {
      const place = this.form?.problem ?? this.answer;
      place.dataset.state = "bad";
      explain(place, error);
      this.form?.ready();
    }
  }

  /** Another event is recorded instead of it, in one step; both are kept. */
  async correct({ event }, { after, ...author }) {
    if (!Object.keys(after).length) return this.close(true);
    if (!await this.changes.save({ event, after, ...author }, this.answer)) return this.form?.ready();
    this.close(true);
    this.reload();
  }

  /** Whoever works with a keyboard goes on from where they were. */
  close(back = false) {
    const inside = this.form?.root.contains(document.activeElement);
    this.form?.root.remove();
    this.form = null;
    this.open.hidden = Boolean(this.past);
    if (back && inside) (this.opener.isConnected ? this.opener : this.open).focus();
  }
}
