// Time travel: a slider over the readings of a twin. All the way to the right is now.
import { t } from "./language.js";
import { remember } from "./route.js";
import { ALL } from "./window.js";
import { button, make, slowTime } from "./words.js";

const SETTLED_MS = 250, PAGE = 20;

export class Timeline {
  constructor(twin) {
    this.twin = twin;
    this.wanted = null;
    this.root = make("div", undefined, "timeline");
    this.slider = make("input");
    Object.assign(this.slider, { type: "range", min: 0, max: 0, step: 1, value: 0 });
    this.slider.setAttribute("aria-label", t("timeline.instant"));
    this.slider.addEventListener("input", () => this.go(Number(this.slider.value)));
    this.slider.addEventListener("keydown", (event) => this.leap(event));
    this.label = make("output", "", "instant");
    this.now = button(t("timeline.now"), () => this.go(this.twin.shown.length - 1));
    this.root.append(this.label, this.slider, this.now);
    this.root.hidden = true;
  }

  /** A browser's own page step is a tenth; in a long history that is too far or too near. */
  leap(event) {
    const sign = { PageUp: 1, PageDown: -1 }[event.key];
    if (!sign) return;
    event.preventDefault();
    this.go(this.index + sign * Math.max(1, Math.round(this.twin.shown.length / PAGE)));
  }

  get index() {
    const { at, shown: points } = this.twin;
    return at ? Math.max(0, points.findLastIndex((point) => point.slow_time <= at.slow_time)) : points.length - 1;
  }

  go(index) {
    const { shown: points, id } = this.twin, last = points.length - 1;
    if (last < 0) return;
    const point = index >= last ? null : points[Math.max(0, index)];
    if (point === this.twin.at) return;
    this.twin.lookAt(point);
    clearTimeout(this.settling);
    this.settling = setTimeout(() => {
      remember(id, point && point.slow_time);
      this.twin.foresee();
    }, SETTLED_MS);
  }

  /** Go to the reading before a slow time, once readings are there. */
  want(slowTime) {
    this.wanted = slowTime;
    this.tell();
  }

  tell() {
    const { twin, slider } = this, { shown: points, at } = twin;
    this.root.hidden = points.length < 2;
    if (this.root.hidden) return;
    if (this.wanted !== null && twin.known) {
      if (twin.longer && this.wanted < points[0].slow_time) return twin.show(ALL);
      const found = points.findLastIndex((point) => point.slow_time <= this.wanted);
      this.wanted = null;
      this.go(found);
      return;
    }
    slider.max = points.length - 1;
    slider.value = this.index;
    const shown = at ?? points.at(-1), said = slowTime(shown);
    const text = t(at ? "timeline.at" : "timeline.is_now", { time: said });
    if (this.label.textContent !== text) this.label.textContent = text;
    slider.setAttribute("aria-valuetext", text);
    this.root.dataset.past = Boolean(at);
    this.now.disabled = !at;
  }

  close() { clearTimeout(this.settling); }
}
