// Whom events of a twin reach: each receiver with what waits and what went wrong, and a test alarm.
import { t } from "./language.js";
import { ask, send } from "./link.js";
import { button, composed, explain, make, say } from "./words.js";

const said = ({ receiver, waiting, delivered, failed }) => (
  [t("routes.delivered", { receiver, n: delivered }), waiting && t("routes.waiting", { n: waiting }), failed && t("routes.failed", { n: failed })].filter(Boolean).join(", ")
);

export class Routes {
  constructor() {
    this.root = make("div", undefined, "routes");
    this.list = make("ul");
    this.answer = make("span");
    this.answer.setAttribute("role", "status");
    this.root.append(this.list, button(t("routes.test"), () => this.test(), "writes"), " ", this.answer);
    this.root.hidden = true;
  }

  tell(base) { this.base = base; }

  async refresh() {
    const { routes = [] } = await ask(`${this.base}/alarms/deliveries?limit=50`).catch(() => ({}));
    this.root.hidden = !routes.length;
    this.list.replaceChildren(...routes.map((route) => {
      const item = make("li", said(route));
      if (route.last_error) {
        const trouble = make("span", " \u25b2 ", "trouble");
        trouble.dataset.state = "bad";
        trouble.append(composed("span", route.last_error));
        item.append(trouble);
      }
      return item;
    }));
  }

  async test() {
    try {
      const { receivers } = await send(`${this.base}/alarms/test`, "POST", {});
      this.answer.removeAttribute("lang");
      say(this.answer, "good", t("routes.sent", { receivers: receivers.join(", ") }));
    } catch (error) {
      this.answer.dataset.state = "bad";
      explain(this.answer, error);
    }
    this.refresh();
  }
}
