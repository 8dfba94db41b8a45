// What has happened to a twin, the newest first; alarms are acknowledged here, and routes are seen and tried.
import { Acknowledging } from "./acknowledging.js";
import { parts, t } from "./language.js";
import { saidOf } from "./recorded_words.js";
import { Routes } from "./routes.js";
import { composed, make, whenOf } from "./words.js";

/** What has happened, in the language of the page: what somebody has recorded by its parts, all else by the server's sentence. */
function said({ kind, message, details }) {
  if (kind !== "asset_event") return composed("span", message);
  return make("span", saidOf({ quantity: null, reverses: null, text: "", ...details, person: details.by }));
}

export class Events {
  constructor() {
    this.root = make("details", undefined, "events");
    this.summary = make("summary", t("events.none"));
    this.list = make("ol");
    this.items = new Map();
    this.routes = new Routes();
    this.root.append(this.summary, this.routes.root, this.list);
    this.root.addEventListener("toggle", () => this.root.open && this.routes.refresh());
  }

  tell({ base, at, events, latest }) {
    this.routes.tell(base);
    const newest = events.at(-1), key = `${newest?.number} ${events.length} ${Boolean(at)}`;
    if (this.told === key) return;
    this.told = key;
    const last = newest && { n: events.length, time: whenOf(newest, latest), event: said(newest) };
    this.summary.replaceChildren(...(last ? parts("events.summary", last) : [t("events.none")]));
    this.root.dataset.severity = newest?.severity ?? "info";
    const seen = new Map(events.filter(({ kind }) => kind === "alarm_acknowledged").map(({ details }) => [details.event_id, details]));
    const numbers = new Set(events.map(({ number }) => number));
    for (const [number, { root }] of this.items) if (!numbers.has(number)) { root.remove(); this.items.delete(number); }
    // Items stay where they are, so that a form that somebody is filling in does not go from under them.
    events.toReversed().forEach((event, i) => {
      const item = this.items.get(event.number) ?? this.item(base, event);
      item.when.textContent = whenOf(event, latest);
      item.acknowledging?.tell(seen.get(event.event_id), Boolean(at));
      if (this.list.children[i] !== item.root) this.list.insertBefore(item.root, this.list.children[i] ?? null);
    });
    if (this.root.open) this.routes.refresh();
  }

  item(base, event) {
    const root = make("li"), when = make("span", "", "when");
    root.dataset.severity = event.severity;
    root.append(when, make("span", t(`severity.${event.severity}`), "severity"), said(event));
    const acknowledging = event.severity === "alarm" ? new Acknowledging(base, event) : null;
    if (acknowledging) root.append(acknowledging.root);
    const item = { root, when, acknowledging };
    this.items.set(event.number, item);
    return item;
  }
}
