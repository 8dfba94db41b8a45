// What if a limit were another? Its handle on a chart is moved by pointer or keys, and the forecast says when that value is reached.
import { t } from "./language.js";
import { scaleOf } from "./limit_words.js";
import { ask } from "./link.js";
import { QUANTITIES, atTime, button, digits, explain, foretold, make, number, slowTime } from "./words.js";

/** [ms] How long a handle rests before the server is asked. Source: longer than from one key to the next. */
const REST_MS = 300;
/** [px] Handles of limits beyond the chart stand side by side at its edge. Source: wider than "what if −100 %". */
const ASIDE_PX = 104;
const PATIENCE_MS = 60000, NARROW = "\u202f";
/** [%] One step of an arrow key, and of Page Up and Page Down. */
const STEP = 0.5, LEAP = 5, LEAST = -100, MOST = 1000;
const KEYS = { ArrowUp: STEP, ArrowRight: STEP, ArrowDown: -STEP, ArrowLeft: -STEP, PageUp: LEAP, PageDown: -LEAP };

const percent = (value) => `${digits(value, 4)}${NARROW}%`;

/** Values [%] that have a limit, with the side that is asked for; a chart without one has a handle below its readings. */
function limitsOf({ latest: { registration } }, quantity, [low, high]) {
  const { alarms = [], forecast } = registration, own = (each) => each.quantity === quantity, [scale] = scaleOf(quantity);
  const found = [
    ...alarms.filter(own).map(({ below, above }) => ({ at: scale * (below ?? above), toward: (below ?? null) === null ? "above" : "below" })),
    ...(forecast?.thresholds ?? []).filter(own).map(({ at }) => ({ at: scale * at, toward: null })),
  ];
  return found.length ? found : [{ at: Math.round(low + 0.1 * (high - low)), toward: null }];
}

class Handle {
  constructor(owner, limit, order) {
    Object.assign(this, { owner, limit, order, value: limit.at });
    this.root = make("div", undefined, "supposed");
    this.grip = make("div", "", "grip");
    Object.assign(this.grip, { tabIndex: 0 });
    for (const [name, value] of Object.entries({ role: "slider", "aria-orientation": "vertical", "aria-valuemin": LEAST, "aria-valuemax": MOST })) this.grip.setAttribute(name, value);
    this.grip.setAttribute("aria-label", t("supposed.handle", { quantity: owner.title }));
    this.root.append(this.grip);
    this.grip.addEventListener("keydown", (pressed) => this.press(pressed));
    this.grip.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      this.grip.setPointerCapture(event.pointerId);
      [this.held, this.from] = [true, event.clientY];
    });
    this.grip.addEventListener("pointermove", (event) => {
      if (!this.held) return;
      const { y } = owner.plot.scene.scales, { area } = owner.plot.scene, { top } = owner.plot.getBoundingClientRect();
      this.move(y.valueAt(Math.min(area.bottom, Math.max(area.top, event.clientY - top))));
    });
    for (const name of ["pointerup", "pointercancel"]) this.grip.addEventListener(name, () => { this.held = false; });
    this.show();
  }

  press(event) {
    if (event.key === "Escape") this.owner.putBack();
    else if (event.key in KEYS) this.move(this.value + KEYS[event.key]);
    else return;
    event.preventDefault();
  }

  move(value) {
    this.value = Math.min(MOST, Math.max(LEAST, Math.round(10 * value) / 10));
    this.show();
    this.owner.suppose(this);
  }

  show() {
    const moved = this.value !== this.limit.at, said = moved ? t("supposed.label", { limit: percent(this.value) }) : percent(this.value);
    this.root.classList.toggle("moved", moved);
    this.grip.textContent = said;
    this.grip.setAttribute("aria-valuenow", this.value);
    this.grip.setAttribute("aria-valuetext", said);
    this.place();
  }

  /** At its value, or at the edge of the chart where that lies beyond it. */
  place() {
    const { scene, offsetTop, offsetLeft } = this.owner.plot;
    if (!scene) return;
    const { scales, area } = scene, own = scales.y.at(this.value), y = Math.min(area.bottom, Math.max(area.top, own));
    this.grip.style.right = y === own ? "0" : `${ASIDE_PX * this.order}px`;
    Object.assign(this.root.style, { top: `${offsetTop + y}px`, left: `${offsetLeft + area.left}px`, width: `${area.right - area.left}px` });
  }
}

export class Supposed {
  constructor(twin, figure, plot, quantity) {
    Object.assign(this, { twin, figure, plot, quantity, title: QUANTITIES[quantity].title, handles: [] });
    this.answer = make("p", "", "supposition");
    this.answer.hidden = true;
    this.answer.setAttribute("role", "status");
    figure.append(this.answer);
  }

  /** Handles where the limits are; one that somebody has moved stays where it is. */
  tell(scene) {
    if (!this.plot.scene) return;
    const none = !scene.points.length || scene.points.at(-1).assumed.includes(this.quantity);
    const limits = none ? [] : limitsOf(scene, this.quantity, this.plot.scene.scales.y.range), key = JSON.stringify([limits, scene.at?.slow_time]);
    // Without a limit the handle stays where it was first put, though readings go on.
    const own = !scene.latest.registration.alarms?.length && !scene.latest.registration.forecast?.thresholds?.length && this.handles.length;
    if (this.told !== key && !(own && !none && this.at === scene.at)) this.renew(limits);
    [this.told, this.at] = [key, scene.at];
    for (const handle of this.handles) handle.place();
  }

  renew(limits) {
    for (const { root } of this.handles) root.remove();
    this.handles = limits.map((limit, order) => new Handle(this, limit, order));
    this.figure.append(...this.handles.map(({ root }) => root));
    this.hush();
  }

  hush() {
    clearTimeout(this.resting);
    this.asked = null;
    this.answer.hidden = true;
    this.answer.replaceChildren();
  }

  putBack() {
    for (const handle of this.handles) {
      handle.value = handle.limit.at;
      handle.show();
    }
    this.hush();
  }

  suppose(handle) {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.ask(handle), REST_MS);
  }

  /** Ask the forecast about this value; nothing is stored. */
  async ask({ value, limit: { toward } }) {
    const { base, at, latest } = this.twin.scene, asked = this.asked = {};
    const query = new URLSearchParams({ points: 1, threshold: value / 100, quantity: this.quantity, ...(toward && { toward }), ...(at && { at: `slow:${at.slow_time}` }) });
    this.answer.hidden = false;
    this.answer.removeAttribute("lang");
    this.answer.textContent = t("supposed.asking", { limit: percent(value) });
    try {
      const { crossings, since, reasons } = await ask(`${base}/forecast?${query}`, PATIENCE_MS);
      if (this.asked !== asked) return;
      const crossing = crossings.find(({ source }) => source === "request");
      if (!crossing) throw Object.assign(new Error(reasons.join(" ")), { status: 200 });
      this.say(crossing, value, since, latest);
    } catch (error) {
      if (this.asked === asked) explain(this.answer, error);
    }
  }

  say({ median, within, horizon, toward }, value, since, latest) {
    const when = (time) => slowTime(atTime(latest, foretold(time, since)));
    const said = t("supposed.answer", {
      what: t(`outlook.threshold.${toward ?? "reached"}`, { quantity: this.title, limit: percent(value) }), time: when(horizon), probability: `${number(100 * within, 0)}${NARROW}%`,
      median: median === null ? t("risk.not_within") : when(median),
    });
    this.answer.replaceChildren(make("strong", t("supposed.what_if")), ` ${said} `, button(t("supposed.put_back"), () => this.putBack()));
    Object.assign(this.answer.dataset, { within, median: median ?? "" });
  }
}
