// Numbers, times and elements: how things are said on the page.

export function make(tag, text, name) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (name) element.className = name;
  return element;
}

export function button(text, act) {
  const made = make("button", text, "act");
  made.type = "button";
  made.addEventListener("click", act);
  return made;
}

export function say(element, state, text) {
  if (element.dataset.state !== state) element.dataset.state = state;
  if (element.textContent !== text) element.textContent = text;
}

export const QUANTITIES = {
  frequency_hz: { title: "Natural frequency", unit: "Hz", scale: 1, axis: "frequency [Hz]", measured: true },
  stiffness_change: { title: "Stiffness change", unit: "%", scale: 100, axis: "change [%]" },
  mass_change: { title: "Mass change", unit: "%", scale: 100, axis: "change [%]" },
  damping_ratio: { title: "Damping ratio", unit: "%", scale: 100, axis: "damping ratio [%]", measured: true },
};

export const titleOf = (quantity) => QUANTITIES[quantity]?.title ?? quantity;

const MINUS = "\u2212", NARROW = "\u202f";

/** A number to `places`, with a true minus sign. */
export const number = (x, places) => x.toFixed(places).replace(/^-(?=.*[1-9])/, MINUS).replace("-", "");

/** As many places as the second digit of the standard deviation has. */
function places(sd) {
  return sd > 0 ? Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(sd)))) : 3;
}

/** `["4.701 Hz", "4.673 to 4.728 Hz"]`: the value, and its 95 % interval. */
export function spoken(estimate, quantity) {
  const { unit, scale } = QUANTITIES[quantity];
  const many = Math.min(places(scale * estimate.sd), unit === "%" ? 2 : 6);
  const text = (x) => number(scale * x, many);
  return [`${text(estimate.value)}${NARROW}${unit}`, `${text(estimate.lo)} to ${text(estimate.hi)}${NARROW}${unit}`];
}

/** Slow time that is the time of day is drawn as dates, any other as the number it is. */
export function isClock(point) {
  return point.slow_time_unit === "s" && Math.abs(point.slow_time - point.t_ns / 1e9) < 1e6;
}

/** What a reading at another slow time would be; sensor time goes on with it. */
export const atTime = (point, slowTime) => ({ ...point, slow_time: slowTime, t_ns: point.t_ns + 1e9 * (slowTime - point.slow_time) });

const UNITS = { T0: "natural periods", d: "days" };
export const unitOf = (point) => UNITS[point.slow_time_unit] || point.slow_time_unit;

/** No window is as short as a natural period, so that parts of one are said of the first hundred only. */
function digitsOf({ slow_time: x, slow_time_unit: unit }) {
  if (unit === "T0") return Math.abs(x) < 100 ? +x.toPrecision(3) : Math.round(x);
  return Math.abs(x) < 1e5 ? +x.toPrecision(6) : Math.round(x);
}

export function slowTime(point) {
  if (isClock(point)) return new Date(1000 * point.slow_time).toLocaleString();
  return `${digitsOf(point)} ${unitOf(point)}`.replace("-", MINUS);
}

/** How long ago, in the largest unit that fits. */
export function ago(milliseconds) {
  const s = Math.max(0, Math.round(milliseconds / 1000));
  for (const [size, name] of [[86400, "d"], [3600, "h"], [60, "min"]]) {
    if (s >= 2 * size) return `${Math.floor(s / size)} ${name} ago`;
  }
  return `${s} s ago`;
}

/** What a live sensor does: whether it sends, at which rate, what has been lost. */
export function sensorOf({ sensor }) {
  if (!sensor) return null;
  const { sensor_silent_s: silent, sampling_rate_uhz: rate, samples_lost: lost, samples_dropped: dropped } = sensor;
  const parts = [
    silent ? `sensor silent for ${silent}${NARROW}s` : "sensor sends",
    rate > 0 && `true rate ${+(rate / 1e6).toPrecision(6)}${NARROW}Hz`,
    `${lost.toLocaleString()} samples lost`,
    sensor.samples_lost_unsure > 0 && `up to ${sensor.samples_lost_unsure.toLocaleString()} more that its counter cannot show`,
    dropped > 0 && `${dropped.toLocaleString()} dropped by the agent`,
    sensor.sensor_restarts > 0 && `${sensor.sensor_restarts} restarts`,
    sensor.sensor_reconnects > 0 && `${sensor.sensor_reconnects} lost connections`,
    sensor.garbage_bytes > 0 && `${sensor.garbage_bytes.toLocaleString()} bytes that are no messages`,
  ];
  return { state: silent ? "bad" : "good", text: parts.filter(Boolean).join(" \u00b7 ") };
}

/** The time of an event: of the structure where it has one, else of the day. */
export function whenOf(event, latest) {
  if (event.kind === "registered" || event.slow_time === null || latest.slow_time === null) return new Date(event.t_ns / 1e6).toLocaleTimeString();
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
