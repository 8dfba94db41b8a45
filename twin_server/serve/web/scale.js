// Scales of a chart: from values to places in the picture, with ticks at round numbers, dates, powers or names.
import { locale, localized } from "./language.js";

const SECOND = 1e3, MINUTE = 60e3, HOUR = 3600e3, DAY = 86400e3, MONTH = 30.44 * DAY, YEAR = 365.25 * DAY;
const CLOCK_STEPS = [1, 2, 5, 10, 15, 30].flatMap((n) => [n * SECOND, n * MINUTE]).concat([1, 2, 3, 6, 12].map((n) => n * HOUR)).sort((a, b) => a - b);
const DAY_STEPS = [1, 2, 7, 14], MONTH_STEPS = [1, 2, 3, 6];
const SUPERSCRIPT = { "-": "\u207b", ...Object.fromEntries([..."\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"].map((sign, i) => [i, sign])) };
/** [] Numbers from here on are written in short, as 12K. Source: five digits no longer fit beside an axis. */
const SHORT = 1e4;

/** A value as a number: a date as milliseconds since 1970. */
export const numeric = (value) => value instanceof Date ? value.getTime() : typeof value === "string" ? Date.parse(value) : value;

/** A step of 1, 2, 2.5 or 5 times a power of ten, such that about `many` fit into `span`. */
export function roundStep(span, many) {
  const rough = span / many, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 2.5, 5, 10].find((times) => times * power >= 0.8 * rough);
}

function numberText(value, step) {
  if (Math.abs(value) < 1e-9 * step) return "0";
  if (Math.max(Math.abs(value), step) >= SHORT) return localized(new Intl.NumberFormat("en", { notation: "compact", maximumSignificantDigits: 4 }).format(value)).replace("\u2212\u2212", "\u2212");
  if (step < 1e-4) return localized(value.toExponential(1));
  const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return localized(`${+value.toFixed(places + 1)}`);
}

function linearTicks([from, to], many) {
  const step = roundStep(to - from, many), ticks = [];
  for (let i = Math.ceil(from / step - 1e-9); i * step <= to + 1e-9 * step; i += 1) ticks.push({ value: i * step, text: numberText(i * step, step) });
  return ticks;
}

function logTicks([from, to], many) {
  const first = Math.ceil(from - 1e-9), last = Math.floor(to + 1e-9), every = Math.max(1, Math.ceil((last - first + 1) / many)), ticks = [];
  const power = (n) => `10${[...`${n}`].map((sign) => SUPERSCRIPT[sign]).join("")}`;
  for (let n = first; n <= last; n += every) ticks.push({ value: n, text: power(n) });
  if (ticks.length > 1) return ticks;
  for (let n = Math.floor(from); n <= to; n += 1) {
    for (const times of [1, 2, 5]) {
      const value = n + Math.log10(times);
      if (value >= from && value <= to && times > 1) ticks.push({ value, text: `${times}\u00b7${power(n)}` });
    }
  }
  return ticks.sort((a, b) => a.value - b.value);
}

const written = (ms, style) => new Date(ms).toLocaleString(locale, style);

/** Beginnings of days, months or years, by the calendar of the browser. */
function calendarTicks(from, to, next, style) {
  const ticks = [], start = new Date(from);
  for (let at = next(start, true); at.getTime() <= to; at = next(at, false)) {
    if (at.getTime() >= from) ticks.push({ value: at.getTime(), text: style(at, !ticks.length) });
  }
  return ticks;
}

function dateTicks([from, to], many) {
  const rough = (to - from) / many, clock = CLOCK_STEPS.find((step) => step >= 0.8 * rough);
  if (clock) {
    const offset = new Date(from).getTimezoneOffset() * MINUTE, ticks = [];
    for (let i = Math.ceil((from - offset) / clock); i * clock + offset <= to; i += 1) {
      const value = i * clock + offset, day = new Date(value).toDateString();
      const time = written(value, { hour: "2-digit", minute: "2-digit", ...(clock < MINUTE ? { second: "2-digit" } : {}) });
      const isNew = !ticks.length || new Date(ticks.at(-1).value).toDateString() !== day;
      ticks.push({ value, text: isNew ? `${time}\n${written(value, { day: "numeric", month: "short", year: "numeric" })}` : time });
    }
    return ticks;
  }
  const days = DAY_STEPS.find((n) => n * DAY >= 0.8 * rough), months = MONTH_STEPS.find((n) => n * MONTH >= 0.8 * rough);
  const withYear = (at, text, isFirst, changes) => isFirst || changes ? `${text}\n${at.getFullYear()}` : text;
  if (days) {
    const next = (at, begins) => new Date(at.getFullYear(), at.getMonth(), at.getDate() + (begins ? 0 : days));
    return calendarTicks(from, to, next, (at, isFirst) => withYear(at, written(at, { day: "numeric", month: "short" }), isFirst, false));
  }
  if (months) {
    const next = (at, begins) => new Date(at.getFullYear(), begins ? Math.floor(at.getMonth() / months) * months : at.getMonth() + months, 1);
    return calendarTicks(from, to, next, (at, isFirst) => withYear(at, written(at, { month: "short" }), isFirst, at.getMonth() === 0));
  }
  const years = Math.max(1, Math.round(roundStep((to - from) / YEAR, many)));
  const next = (at, begins) => new Date(begins ? Math.floor(at.getFullYear() / years) * years : at.getFullYear() + years, 0, 1);
  return calendarTicks(from, to, next, (at) => `${at.getFullYear()}`);
}

/** The range that holds all values, with some room beside them. */
function rangeOf(values, { rangemode }, room) {
  const [low, high] = values.reduce(([a, b], v) => (Number.isFinite(v) ? [Math.min(a, v), Math.max(b, v)] : [a, b]), [Infinity, -Infinity]);
  if (low > high) return [0, 1];
  const margin = high > low ? room * (high - low) : Math.abs(high) * 0.05 || 1;
  if (rangemode === "tozero") return [Math.min(0, low), Math.max(0, high) + margin];
  return [low - margin, high + margin];
}

/**
 * A scale between two places [px].
 * `axis` has `type` (linear, log, category), `range`, `nticks`, `tickvals` and `ticktext`; `values` are all that is drawn along it.
 */
export function scaleOf(axis, values, [start, end], { room, many }) {
  const isDate = axis.type !== "category" && values.some((value) => value instanceof Date || typeof value === "string");
  const names = axis.type === "category" ? [...new Set(values)] : null;
  const inner = axis.type === "log" ? (value) => Math.log10(value) : names ? (value) => typeof value === "number" ? value : names.indexOf(value) : numeric;
  const given = axis.range?.map(numeric).map((value) => axis.type === "log" ? Math.log10(value) : value);
  let range = names ? [-0.6, names.length - 0.4] : given ?? rangeOf(values.filter((value) => value !== null).map(inner), axis, room);
  if (!(range[1] > range[0])) range = [range[0] - 0.5, range[0] + 0.5];
  const [from, to] = range, many_ = Math.max(2, Math.min(axis.nticks ?? 20, many));
  const at = (value) => start + (end - start) * (inner(value) - from) / (to - from);
  const outer = (x) => axis.type === "log" ? 10 ** x : isDate ? new Date(x) : x;
  const ticks = axis.tickvals ? axis.tickvals.map((value, i) => ({ value, text: axis.ticktext[i] }))
    : names ? names.map((name, i) => ({ value: i, text: name })) : (axis.type === "log" ? logTicks : isDate ? dateTicks : linearTicks)(range, many_);
  return {
    at, isDate, range: range.map(outer), valueAt: (px) => outer(from + (to - from) * (px - start) / (end - start)),
    ticks: ticks.map(({ value, text }) => ({ text, px: start + (end - start) * ((axis.tickvals ? inner(value) : value) - from) / (to - from) })),
    zero: axis.type === "log" || names || isDate || from > 0 || to < 0 ? null : at(0),
  };
}

/** A value of an axis in words. */
export const valueText = (value) => value instanceof Date || typeof value === "string"
  ? new Date(value).toLocaleString(locale) : localized(new Intl.NumberFormat("en", { maximumSignificantDigits: 5, useGrouping: false }).format(value));
