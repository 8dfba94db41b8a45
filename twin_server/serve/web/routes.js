// Whom events of a twin reach: each receiver with what waits and what went wrong, and a test alarm.
import { ask, send } from "./link.js";
import { button, make, say } from "./words.js";

const said = ({ receiver, waiting, delivered, failed }) => (
  [`${receiver}: ${delivered} delivered`, waiting && `${waiting} waiting`, failed && `${failed} given up`].filter(Boolean).join(", ")
);

export class Routes {
  constructor() {
    this.root = make("div", undefined, "routes");
    this.list = make("ul");
    this.answer = make("span");
    this.answer.setAttribute("role", "status");
    this.root.append(this.list, button("Send a test alarm", () => this.test()), " ", this.answer);
    this.root.hidden = true;
  }

  tell(base) { this.base = base; }

  async refresh() {
    const { routes = [] } = await ask(`${this.base}/alarms/deliveries?limit=50`).catch(() => ({}));
    this.root.hidden = !routes.length;
    this.list.replaceChildren(...routes.map((route) => {
      const item = make("li", said(route));
      if (route.last_error) {
        const trouble = make("span", ` \u25b2 ${route.last_error}`, "trouble");
        trouble.dataset.state = "bad";
        item.append(trouble);
      }
      return item;
    }));
  }

  async test() {
    try {
      const { receivers } = await send(`${this.base}/alarms/test`, "POST", {});
      say(this.answer, "good", `Sent to ${receivers.join(", ")}.`);
    } catch (error) { say(this.answer, "bad", error.message); }
    this.refresh();
  }
}
