// One quantity of one twin over slow time, with axes, in a drawing and in words.
import { marksOf, timeAxis } from "./axis.js";
import { language, locale, t } from "./language.js";
import { colour, placeOf, rangeOf, sorted, tracesOf, widened } from "./traces.js";
import { QUANTITIES, button, make, slowTime, spoken } from "./words.js";

export const HEIGHT_PX = 232, WIDE_PX = 316, NARROW_PX = 400, MARGIN = { l: 54, r: 10, t: 8, b: 58 };
const NOTHING = { fine: [], buckets: [], readings: 0, apart: { inseparable: [], invalid: [] } };

// A finger on a chart scrolls the page; it does not zoom.
const touched = matchMedia("(pointer: coarse)");

/** What every chart is told besides its layout; Plotly writes numbers and dates by its locale. */
export const quiet = { displayModeBar: false, locale: language, doubleClick: "autosize" };

/** Names of months and days, and signs of numbers, from the browser. */
function localizedPlotly(Plotly) {
  if (language === "en") return Plotly;
  const named = (style, days, count) => Array.from({ length: count }, (_, i) => (
    new Date(Date.UTC(2023, days ? 0 : i, days ? 1 + i : 1)).toLocaleDateString(locale, { timeZone: "UTC", ...style })
  ));
  const sign = (type) => new Intl.NumberFormat(language).formatToParts(12345.6).find((part) => part.type === type)?.value ?? "";
  const format = {
    days: named({ weekday: "long" }, true, 7), shortDays: named({ weekday: "short" }, true, 7),
    months: named({ month: "long" }, false, 12), shortMonths: named({ month: "short" }, false, 12),
    date: t("date.plotly"), decimal: sign("decimal"), thousands: sign("group"),
  };
  Plotly.register({ moduleType: "locale", name: language, dictionary: {}, format });
  return Plotly;
}

/** Plotly is large: the page speaks before it can draw. */
let begin = null;
export const plotly = new Promise((begun) => { begin = begun; }).then(() => new Promise((resolve, reject) => {
  const script = document.createElement("script");
  script.src = "/assets/plotly.min.js";
  script.onload = () => resolve(localizedPlotly(window.Plotly));
  script.onerror = () => reject(new Error(t("error.no_plotly")));
  document.head.append(script);
}));

/** Running its code takes a second or more, in which nothing else is done: words come first. */
export const loadPlotly = () => begin();

/**
 * Where somebody zoomed to: in time on all charts of a twin, in height on this one; a double click ends both.
 * Each drawing states its ranges, so that a new reading would take the zoom back if it were not told here.
 */
export const zoomOf = (plot, { zoom }) => ({ x: zoom?.zoomed ?? null, y: plot.zoomed ?? null });

/** Note where somebody zooms to; a plot hears of it once it has been drawn. */
export function followZoom(plot, { zoom, touch }) {
  if (!plot.zooms) {
    plot.zooms = true;
    plot.on("plotly_relayout", (change) => {
      for (const [axis, held] of [["xaxis", zoom], ["yaxis", plot]]) {
        const [from, to] = change[`${axis}.range`] ?? [change[`${axis}.range[0]`], change[`${axis}.range[1]`]];
        if (change[`${axis}.autorange`]) held.zoomed = null;
        else if (from !== undefined) held.zoomed = [from, to];
        else continue;
        touch?.();
      }
    });
  }
}

/** A button that saves a chart as a picture. */
export function pictureOf(plot, name) {
  return button("PNG", async () => {
    const Plotly = await plotly, { width, height } = plot.getBoundingClientRect();
    const paper = { paper_bgcolor: colour("card"), plot_bgcolor: colour("card") };
    const data = await Plotly.toImage({ data: plot.data, layout: { ...plot.layout, ...paper } }, { format: "png", width, height, scale: 2 });
    const link = make("a");
    Object.assign(link, { href: data, download: `${name()}.png` });
    link.click();
  });
}

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

function layoutOf(twin, quantity, { width, range, assumed, empty, wide, zoomed }) {
  const grid = colour("line"), marks = marksOf(twin);
  const axis = {
    gridcolor: grid, linecolor: grid, tickcolor: grid, showline: true, zeroline: false, ticks: "outside", ticklen: 4,
    fixedrange: touched.matches,
  };
  const said = t(assumed ? "chart.note_assumed" : "chart.note_empty");
  const text = width < NARROW_PX ? said.replaceAll(", ", ",<br>") : said;
  const note = {
    text, showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.85,
    font: { color: colour("faint") },
  };
  return {
    width, height: wide ? WIDE_PX : HEIGHT_PX, margin: MARGIN, showlegend: false, hovermode: "closest",
    dragmode: touched.matches ? false : "zoom", uirevision: twin.id,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: colour("ink"), size: 11.5, family: "system-ui, sans-serif" },
    xaxis: { ...axis, ...timeAxis(twin, zoomed.x, width) },
    yaxis: { ...axis, automargin: true, nticks: 6, range: zoomed.y ?? range, title: { text: QUANTITIES[quantity].axis, standoff: 4 } },
    shapes: [...marks.shapes, ...limitsOf(twin, quantity), ...instantOf(twin)], annotations: [...marks.notes, ...(assumed || empty ? [note] : [])],
  };
}

/** Draw, and give back what there is to see, by the keys of the legend. */
export async function draw(plot, twin, quantity, wide) {
  const Plotly = await plotly, assumed = Boolean(twin.points.at(-1)?.assumed.includes(quantity)), width = plot.clientWidth;
  const parts = assumed ? NOTHING : sorted(twin, twin.points, quantity, width, { until: twin.at?.slow_time ?? Infinity });
  const all = [...twin.points, ...twin.later.slice(1)];
  const range = widened(rangeOf(all, quantity, assumed || !twin.at ? parts : sorted(twin, all, quantity, width)), twin, quantity);
  const traces = tracesOf(twin, quantity, parts, range, width);
  const layout = layoutOf(twin, quantity, { width, range, assumed, empty: !parts.readings, wide, zoomed: zoomOf(plot, twin) });
  await Plotly.react(plot, traces, layout, quiet);
  followZoom(plot, twin);
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
