// One quantity of one twin over slow time, with axes, in a drawing and in words.
import { marksOf, timeAxis } from "./axis.js";
import { t } from "./language.js";
import { drawPlot, savePicture } from "./plot.js";
import { colour } from "./svg.js";
import { placeOf, rangeOf, sorted, tracesOf, widened } from "./traces.js";
import { QUANTITIES, button, make, slowTime, spoken } from "./words.js";

export const HEIGHT_PX = 232, WIDE_PX = 316, NARROW_PX = 400, MARGIN = { l: 54, r: 10, t: 8, b: 58 };
const NOTHING = { fine: [], buckets: [], readings: 0, apart: { inseparable: [], invalid: [] } };

/**
 * Where somebody zoomed to: in time on all charts of a twin, in height on this one; a double click ends both.
 * A chart shows at once what is asked of it, the others at the next drawing.
 */
export function zoomOf(plot, twin) {
  const { zoom, touch } = twin;
  return {
    x: zoom.zoomed, y: plot.zoomed ?? null,
    to({ x, y }) {
      if (y !== undefined) plot.zoomed = y;
      if (x !== undefined) zoom.to(x);
      drawPlot(plot, plot.data, { ...plot.asked, zoom: zoomOf(plot, twin) });
      touch();
    },
  };
}

/** A button that saves a chart as a picture. */
export const pictureOf = (plot, name) => button("PNG", () => savePicture(plot, name()));

const saidLast = ([value, interval]) => t("chart.last", { value, interval });

function described({ points }, quantity, assumed, readings) {
  const { title } = QUANTITIES[quantity], first = points[0], last = points.at(-1);
  if (!last) return t("chart.none", { title });
  const now = last[quantity] && saidLast(spoken(last[quantity], quantity));
  const said = assumed ? t("chart.assumed") : now ? now : t("chart.not_estimated");
  return t("chart.described", { title, n: Math.max(readings, points.length), from: slowTime(first), to: slowTime(last), said });
}

/** A line across all charts at the instant that is looked at. */
export function instantOf({ at }) {
  const line = { color: colour("ink"), width: 1.4 };
  return at ? [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: placeOf(at), x1: placeOf(at), line }] : [];
}

function limitsOf(twin, quantity) {
  const { scale } = QUANTITIES[quantity], alarms = twin.latest?.registration?.alarms ?? [];
  const thresholds = twin.latest?.registration?.forecast?.thresholds ?? [];
  const drawn = (value, line) => {
    const y = scale * value;
    return { type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line };
  };
  const own = (each) => each.quantity === quantity;
  return [
    ...alarms.filter(own).map((alarm) => drawn(alarm.below ?? alarm.above, { color: colour("bad"), width: 1.4, dash: "dot" })),
    ...thresholds.filter(own).map(({ at }) => drawn(at, { color: colour("ahead"), width: 1.2, dash: "dot" })),
  ];
}

function layoutOf(twin, quantity, { width, range, assumed, empty, wide, zoom }) {
  const marks = marksOf(twin), said = t(assumed ? "chart.note_assumed" : "chart.note_empty");
  const text = width < NARROW_PX ? said.replaceAll(", ", ",<br>") : said;
  const note = { text, xref: "paper", yref: "paper", x: 0.5, y: 0.85, font: { color: colour("faint") } };
  return {
    width, height: wide ? WIDE_PX : HEIGHT_PX, margin: MARGIN, zoom,
    xaxis: timeAxis(twin, zoom.x, width),
    yaxis: { automargin: true, nticks: 6, range, title: { text: QUANTITIES[quantity].axis } },
    shapes: [...marks.shapes, ...limitsOf(twin, quantity), ...instantOf(twin)], annotations: [...marks.notes, ...(assumed || empty ? [note] : [])],
  };
}

/** Draw, and give back what there is to see, by the keys of the legend. */
export function draw(plot, twin, quantity, wide) {
  const assumed = Boolean(twin.points.at(-1)?.assumed.includes(quantity)), width = plot.clientWidth;
  const parts = assumed ? NOTHING : sorted(twin, twin.points, quantity, width, { until: twin.at?.slow_time ?? Infinity });
  const all = [...twin.points, ...twin.later.slice(1)];
  const range = widened(rangeOf(all, quantity, assumed || !twin.at ? parts : sorted(twin, all, quantity, width)), twin, quantity);
  const traces = tracesOf(twin, quantity, parts, range, width);
  const layout = layoutOf(twin, quantity, { width, range, assumed, empty: !parts.readings, wide, zoom: zoomOf(plot, twin) });
  drawPlot(plot, traces, layout);
  const { fine, buckets, readings, apart } = parts, has = (name) => traces.some((trace) => trace.name === name);
  plot.setAttribute("aria-label", described(twin, quantity, assumed, readings));
  Object.assign(plot.dataset, {
    points: readings, bands: fine.filter((run) => run.length > 1).length + buckets.length, buckets: buckets.flat().length, assumed,
    drawn: traces.reduce((sum, trace) => sum + trace.x.length, 0),
    inseparable: apart.inseparable.length, invalid: apart.invalid.length,
    truth: traces.find((trace) => trace.name === "truth")?.x.length ?? 0, forecast: has("forecast"), reached: has("time to threshold"),
  });
  return {
    estimate: has("estimate"), truth: has("truth"), later: has("what came after"), ahead: has("forecast"), reached: has("time to threshold"),
    limit: (twin.latest?.registration?.alarms ?? []).some((alarm) => alarm.quantity === quantity),
    threshold: (twin.latest?.registration?.forecast?.thresholds ?? []).some((threshold) => threshold.quantity === quantity),
    buckets: buckets.length > 0, instant: Boolean(twin.at), ...marksOf(twin).found,
    inseparable: apart.inseparable.length > 0, invalid: apart.invalid.length > 0,
  };
}
