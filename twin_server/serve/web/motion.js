// Shapes that move, all at the same slowing of time, so that a higher mode is seen to be faster.
import { t } from "./language.js";
import { button, digits, make } from "./words.js";

const LOWEST_S = 2.4;

export class Motion {
  constructor() {
    Object.assign(this, { moved: [], frame: 0, cycles: 0, before: null });
    this.root = make("p", undefined, "facts moves");
    this.button = button("", () => this.run(!this.running));
    this.told = make("span");
    this.root.append(this.button, " ", this.told);
    this.root.hidden = true;
    this.run(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  /** `{ frequency_hz, turn(cycles) }` of each shape. */
  move(shapes) {
    this.moved = shapes;
    this.root.hidden = !shapes.length;
    if (!shapes.length) return;
    this.lowest = Math.min(...shapes.map((shape) => shape.frequency_hz));
    const slower = LOWEST_S * this.lowest;
    const pace = slower >= 1 ? t("motion.slower", { times: digits(slower, 2) }) : t("motion.faster", { times: digits(1 / slower, 2) });
    this.told.textContent = pace;
    this.show();
  }

  run(running) {
    this.running = running;
    this.before = null;
    this.button.textContent = running ? t("motion.stop") : t("motion.start");
    cancelAnimationFrame(this.frame);
    if (running) this.frame = requestAnimationFrame((now) => this.step(now));
  }

  step(now) {
    this.cycles += this.before === null ? 0 : Math.min(now - this.before, 100) / 1000 / LOWEST_S;
    this.before = now;
    this.show();
    this.frame = requestAnimationFrame((next) => this.step(next));
  }

  show() {
    for (const { frequency_hz, turn } of this.moved) turn(this.cycles * frequency_hz / this.lowest);
  }

  close() { cancelAnimationFrame(this.frame); }
}
