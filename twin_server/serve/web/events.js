// What has happened to a twin, the newest first.
import { make, whenOf } from "./words.js";

export class Events {
  constructor() {
    this.root = make("details", undefined, "events");
    this.summary = make("summary", "No events yet");
    this.list = make("ol");
    this.root.append(this.summary, this.list);
  }

  tell({ events, latest }) {
    const newest = events.at(-1), key = `${newest?.number} ${events.length}`;
    if (this.told === key) return;
    this.told = key;
    const count = events.length === 1 ? "1 event" : `${events.length} events`;
    this.summary.textContent = newest ? `${count}, last: ${whenOf(newest, latest)} ${newest.message}` : "No events yet";
    this.root.dataset.severity = newest?.severity ?? "info";
    this.list.replaceChildren(...events.toReversed().map((event) => {
      const item = make("li");
      item.dataset.severity = event.severity;
      item.append(make("span", whenOf(event, latest), "when"), make("span", event.severity, "severity"), event.message);
      return item;
    }));
  }
}
