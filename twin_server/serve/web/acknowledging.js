// Beside an alarm: a button by which somebody says that they have seen it, and who has.
import { t } from "./language.js";
import { send } from "./link.js";
import { translated } from "./sentences.js";
import { button, explain, make, say } from "./words.js";

export class Acknowledging {
  constructor(base, event) {
    this.path = `${base}/alarms/${event.event_id}/acknowledge`;
    this.root = make("span", undefined, "acknowledging");
    this.open = button(t("acknowledging.acknowledge"), () => this.ask(), "writes");
    this.open.setAttribute("aria-label", t("acknowledging.of", { event: translated(event.message) ?? event.message }));
    this.seen = make("span", "", "seen");
    this.seen.tabIndex = -1;
    this.root.append(this.open, this.seen);
  }

  /** Who has acknowledged it, if somebody has; at a past instant nothing can be done. */
  tell(by, past) {
    const note = by?.note ? `: ${by.note}` : "";
    say(this.seen, by ? "good" : "", by ? `\u2713 ${t("acknowledging.by", { person: by.by })}${note}` : "");
    this.open.hidden = Boolean(by) || past || Boolean(this.form);
    if (by && this.form) this.close(this.seen);
  }

  ask() {
    this.form = make("form");
    const [name, note] = [[t("form.name"), "name", 100], [t("acknowledging.note"), "off", 1000]].map(([text, complete, longest]) => {
      const label = make("label", `${text} `), input = make("input");
      Object.assign(input, { type: "text", autocomplete: complete, maxLength: longest });
      label.append(input);
      this.form.append(label);
      return input;
    });
    const give = make("button", t("acknowledging.acknowledge"), "act"), problem = make("span", "", "alarm");
    problem.setAttribute("role", "alert");
    this.form.append(give, button(t("form.cancel"), () => this.close(this.open)), problem);
    this.form.addEventListener("keydown", (event) => { if (event.key === "Escape") this.close(this.open); });
    this.form.addEventListener("submit", async (event) => {
      event.preventDefault();
      give.disabled = true;
      try {
        const seen = await send(this.path, "POST", { by: name.value.trim() || null, note: note.value.trim() });
        this.tell(seen, false);
      } catch (error) {
        problem.dataset.state = "bad";
        explain(problem, error);
        give.disabled = false;
      }
    });
    this.root.append(this.form);
    this.open.hidden = true;
    name.focus();
  }

  /** Whoever works with a keyboard goes on from where they were. */
  close(next) {
    const inside = this.form?.contains(document.activeElement);
    this.form?.remove();
    this.form = null;
    if (next === this.open) this.open.hidden = false;
    if (inside) next.focus();
  }
}
