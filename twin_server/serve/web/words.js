// Numbers, times and elements: how things are said on the page.
import { counted, language, locale, localized, t } from "./language.js";
import { translated } from "./sentences.js";

export function make(tag, text, name) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (name) element.className = name;
  return element;
}

/** `needs` is `writes` or `administers` where the server wants an operator or an admin: others are not shown it. */
export function button(text, act, needs = "") {
  const made = make("button", text, needs ? `act ${needs}` : "act");
  made.type = "button";
  made.addEventListener("click", act);
  return made;
}

export function say(element, state, text) {
  if (element.dataset.state !== state) element.dataset.state = state;
  if (element.textContent !== text) element.textContent = text;
}

export const QUANTITIES = {
  frequency_hz: { title: t("quantity.frequency"), unit: "Hz", scale: 1, axis: t("axis.frequency"), measured: true },
  stiffness_change: { title: t("quantity.stiffness_change"), unit: "%", scale: 100, axis: t("axis.change") },
  mass_change: { title: t("quantity.mass_change"), unit: "%", scale: 100, axis: t("axis.change") },
  damping_ratio: { title: t("quantity.damping"), unit: "%", scale: 100, axis: t("axis.damping"), measured: true },
};

export const titleOf = (quantity) => QUANTITIES[quantity]?.title ?? quantity;

const MINUS = "\u2212", NARROW = "\u202f";

/** Words that are English in every language of the page. */
export function english(element) {
  element.lang = "en";
  return element;
}

/** Fill an element with words that the server has composed: translated, or else marked as English. */
export function compose(element, text) {
  const own = translated(text), said = own ?? text;
  if (element.textContent !== said) element.textContent = said;
  if (own === null) element.lang = "en";
  else element.removeAttribute("lang");
  return element;
}

/** A new element with words that the server has composed. */
export const composed = (tag, text, name) => compose(make(tag, undefined, name), text);

/** The server's sentence on a row, for screen readers; where it is not translated, its cells are read instead. */
export function describeRow(row, sentence) {
  const said = language === "en" ? sentence : translated(sentence);
  if (said) row.setAttribute("aria-label", said);
}

/** Why something did not succeed: in the server's words where it has answered, else in the page's. */
export function explain(element, error) {
  if (error.status) return compose(element, error.message);
  element.textContent = error.message;
  element.removeAttribute("lang");
}

/** A number to `places`, with a true minus sign. */
export const number = (x, places) => localized(x.toFixed(places).replace(/^-(?=.*[1-9])/, MINUS).replace("-", ""));

/** A number to as many digits. */
export const digits = (x, many) => localized(`${+x.toPrecision(many)}`);

/** A small or large number as a power of ten: 1.3e−5. */
export const powered = (x) => localized(x.toExponential(1));

/** From one number to another. */
export const range = (lo, hi) => t("number.range", { lo, hi });

/** A value and its interval in one: "4.701 Hz, 95 %: 4.673 to 4.728 Hz". */
export const valued = ([value, interval]) => t("number.valued", { value, interval });

/** An interval that holds the true value with 95 %. */
export const interval95 = (interval) => t("number.interval", { interval });

/** As many places as the second digit of the standard deviation has. */
function places(sd) {
  return sd > 0 ? Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(sd)))) : 3;
}

/** `["4.701 Hz", "4.673 to 4.728 Hz"]`: the value, and its 95 % interval. */
export function spoken(estimate, quantity) {
  const { unit, scale } = QUANTITIES[quantity];
  const many = Math.min(places(scale * estimate.sd), unit === "%" ? 2 : 6);
  const text = (x) => number(scale * x, many);
  return [`${text(estimate.value)}${NARROW}${unit}`, `${range(text(estimate.lo), text(estimate.hi))}${NARROW}${unit}`];
}

/** Slow time that is the time of day is drawn as dates, any other as the number it is. */
export function isClock(point) {
  return point.slow_time_unit === "s" && Math.abs(point.slow_time - point.t_ns / 1e9) < 1e6;
}

/** What a reading at another slow time would be; sensor time goes on with it. */
export const atTime = (point, slowTime) => ({ ...point, slow_time: slowTime, t_ns: point.t_ns + 1e9 * (slowTime - point.slow_time) });

/** A foretold time to about a hundredth of how far ahead it is: more digits would say more than is known of it. */
export const foretold = (time, now) => time === now ? time : +time.toFixed(Math.max(0, 2 - Math.floor(Math.log10(Math.abs(time - now)))));

const UNITS = { T0: t("unit.natural_periods"), d: t("unit.days") };
export const unitOf = (point) => UNITS[point.slow_time_unit] || point.slow_time_unit;

/** No window is as short as a natural period, so that parts of one are said of the first hundred only. */
function digitsOf({ slow_time: x, slow_time_unit: unit }) {
  if (unit === "T0") return Math.abs(x) < 100 ? +x.toPrecision(3) : Math.round(x);
  return Math.abs(x) < 1e5 ? +x.toPrecision(6) : Math.round(x);
}

export function slowTime(point) {
  if (isClock(point)) return new Date(1000 * point.slow_time).toLocaleString(locale);
  return `${localized(`${digitsOf(point)}`)} ${unitOf(point)}`;
}

/** How long ago, in the largest unit that fits. */
export function ago(milliseconds) {
  const s = Math.max(0, Math.round(milliseconds / 1000));
  for (const [size, key] of [[86400, "ago.days"], [3600, "ago.hours"], [60, "ago.minutes"]]) {
    if (s >= 2 * size) return t(key, { n: Math.floor(s / size) });
  }
  return t("ago.seconds", { n: s });
}

/** A suspicion, in which the server joins the names of elements: "k1 or k2 and k3". */
export const suspected = (word) => word.replaceAll(" or ", t("list.or")).replaceAll(" and ", t("list.and"));

/** What a live sensor does: whether it sends, at which rate, what has been lost. */
export function sensorOf({ sensor }) {
  if (!sensor) return null;
  const { sensor_silent_s: silent, sampling_rate_uhz: rate, samples_lost: lost, samples_dropped: dropped } = sensor;
  const parts = [
    silent ? t("sensor.silent", { n: silent }) : t("sensor.sends"),
    rate > 0 && t("sensor.rate", { rate: digits(rate / 1e6, 6) }),
    t("sensor.lost", { n: lost, count: counted(lost) }),
    sensor.samples_lost_unsure > 0 && t("sensor.lost_unsure", { count: counted(sensor.samples_lost_unsure) }),
    dropped > 0 && t("sensor.dropped", { count: counted(dropped) }),
    sensor.sensor_restarts > 0 && t("sensor.restarts", { n: sensor.sensor_restarts }),
    sensor.sensor_reconnects > 0 && t("sensor.reconnects", { n: sensor.sensor_reconnects }),
    sensor.garbage_bytes > 0 && t("sensor.garbage", { count: counted(sensor.garbage_bytes) }),
  ];
  return { state: silent ? "bad" : "good", text: parts.filter(Boolean).join(" \u00b7 ") };
}

/** The time of an event: of the structure where it has one, else of the day. */
export function whenOf(event, latest) {
  if (event.kind === "registered" || event.slow_time === null || latest.slow_time === null) return new Date(event.t_ns / 1e6).toLocaleTimeString(locale);
  return slowTime(atTime(latest, event.slow_time));
}

// Reasons that say nothing against the frequency itself.
export const LEARNING = /still being learnt/;
const INSEPARABLE = /not separately identifiable|^The damping is known|^No (positive )?damping ratio/;

/** What stands against a reading: nothing, that it is too early, that mass and stiffness look alike, or more. */
export function standing({ valid, reasons }) {
  if (valid) return "valid";
  if (!reasons.every((reason) => LEARNING.test(reason) || INSEPARABLE.test(reason))) return "invalid";
  return reasons.some((reason) => LEARNING.test(reason)) ? "learning" : "inseparable";
}
