// The axis of time: in the unit of the structure with the calendar below it, or the calendar alone where that is the unit.
import { localized, locale, t } from "./language.js";
import { roundStep } from "./scale.js";
import { colour } from "./svg.js";
import { placeOf, spanOf } from "./traces.js";
import { atTime, isClock, unitOf } from "./words.js";

const PX_A_TICK = 95, DAY_MS = 86400e3, MOST_NOTES = 4;

/** Sensor time [ms since 1970] of a slow time, between readings and beyond them; null where sensor time does not rise with it. */
function calendarOf(points) {
  const first = points[0], last = points.at(-1);
  if (!first || last.slow_time <= first.slow_time || last.t_ns <= first.t_ns) return null;
  for (let i = 1; i < points.length; i += 1) {
    if (points[i].slow_time < points[i - 1].slow_time || points[i].t_ns < points[i - 1].t_ns) return null;
  }
  const pace = (last.t_ns - first.t_ns) / (last.slow_time - first.slow_time);
  return (slowTime) => {
    let [low, high] = [0, points.length - 1];
    if (slowTime <= first.slow_time) return (first.t_ns + pace * (slowTime - first.slow_time)) / 1e6;
    if (slowTime >= last.slow_time) return (last.t_ns + pace * (slowTime - last.slow_time)) / 1e6;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle].slow_time <= slowTime) low = middle;
      else high = middle;
    }
    const [a, b] = [points[low], points[high]], share = (slowTime - a.slow_time) / (b.slow_time - a.slow_time || 1);
    return (a.t_ns + share * (b.t_ns - a.t_ns)) / 1e6;
  };
}

function dateOf(ms, span, isFirst) {
  const date = new Date(ms), year = isFirst || span > 2 * 365 * DAY_MS ? { year: "numeric" } : {};
  if (span > 4 * DAY_MS) return date.toLocaleDateString(locale, { ...(span > 2 * 365 * DAY_MS ? {} : { day: "numeric" }), month: "short", ...year });
  const time = date.toLocaleTimeString(locale, { hour: "2-digit", minute: "2-digit", ...(span < 600e3 ? { second: "2-digit" } : {}) });
  return isFirst ? `${date.toLocaleDateString(locale, { day: "numeric", month: "short" })}, ${time}` : time;
}

/** The axis of time of a chart; `shown` is the range that somebody zoomed to. */
export function timeAxis(twin, shown, width) {
  const last = twin.points.at(-1), range = shown ?? spanOf(twin);
  if (!last || isClock(last)) return { nticks: 7, range, title: { text: t("axis.date_and_time") } };
  const title = { text: t("axis.time", { unit: unitOf(last) }) }, at = calendarOf(twin.points), [from, to] = range ?? [];
  if (!at || !(to > from)) return { nticks: 7, range, title };
  const step = roundStep(to - from, Math.max(2, Math.min(6, width / PX_A_TICK))), values = [], span = at(to) - at(from);
  for (let i = Math.ceil(from / step); i * step <= to; i += 1) values.push(+(i * step).toPrecision(12));
  const texts = values.map((value, i) => `${localized(`${value}`)}\n${dateOf(at(value), span, i === 0)}`);
  return { range, title, tickvals: values, ticktext: texts };
}

export const MARKS = {
  renewed: { tint: "good", dash: "solid", text: t("mark.renewed") },
  told: { tint: "ink", dash: "longdash", text: t("mark.recorded") },
  sudden: { tint: "inseparable", dash: "dashdot", text: t("mark.sudden") },
};

/** What happened to the structure, as lines across the chart, with a word each where there is room. */
export function marksOf({ points, marks = [] }) {
  const last = points.at(-1), from = points[0]?.slow_time;
  const shown = last ? marks.filter(({ slow_time }) => slow_time >= from && slow_time <= last.slow_time) : [];
  const place = (slowTime) => placeOf(atTime(last, slowTime));
  const shapes = shown.map(({ kind, slow_time }) => ({
    type: "line", name: kind, yref: "paper", y0: 0, y1: 1, x0: place(slow_time), x1: place(slow_time), layer: "below",
    line: { color: colour(MARKS[kind].tint), width: 1.6, dash: MARKS[kind].dash },
  }));
  const notes = shown.length > MOST_NOTES ? [] : shown.map(({ kind, slow_time, text }) => ({
    text: text ?? MARKS[kind].text, x: place(slow_time), xanchor: "left", xshift: 2, yref: "paper", y: 1, yanchor: "top",
    font: { color: colour(MARKS[kind].tint), size: 10.5 }, bgcolor: `${colour("card")}cc`,
  }));
  return { shapes, notes, found: Object.fromEntries(Object.keys(MARKS).map((kind) => [kind, shown.some((mark) => mark.kind === kind)])) };
}
