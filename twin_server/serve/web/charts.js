// One quantity of one twin over slow time, with axes, in a drawing and in words.
import { colour, placeOf, rangeOf, sorted, spanOf, tracesOf, widened } from "./traces.js";
import { QUANTITIES, isClock, spoken, unitOf } from "./words.js";

const HEIGHT_PX = 215, WIDE_PX = 300;
const NOTHING = { runs: [], apart: { inseparable: [], invalid: [] } };

// A finger on a chart scrolls the page; it does not zoom.
const touched = matchMedia("(pointer: coarse)");

/** Plotly is large: the page speaks before it can draw. */
export const plotly = new Promise((resolve, reject) => {
  const script = document.createElement("script");
  script.src = "/assets/plotly.min.js";
  script.onload = () => resolve(window.Plotly);
  script.onerror = () => reject(new Error("The charts cannot be drawn: their library did not load. Reload the page."));
  document.head.append(script);
});

function described({ points }, quantity, assumed) {
  const { title } = QUANTITIES[quantity], first = points[0], last = points.at(-1);
  if (!last) return `${title}: no readings yet`;
  const [from, to] = [first, last].map((point) => +point.slow_time.toPrecision(6));
  const now = last[quantity] && spoken(last[quantity], quantity).join(", 95 % interval ");
  const said = assumed ? "assumed not to change" : now ? `last ${now}` : "not estimated at the last";
  return `${title}, ${points.length} readings from slow time ${from} to ${to} ${unitOf(last)}: ${said}`;
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

function layoutOf(twin, quantity, { width, range, assumed, wide }) {
  const last = twin.points.at(-1), grid = colour("line");
  const axis = {
    gridcolor: grid, linecolor: grid, tickcolor: grid, showline: true, zeroline: false, ticks: "outside", ticklen: 4,
    fixedrange: touched.matches,
  };
  const along = last && !isClock(last) ? `slow time [${unitOf(last)}]` : "slow time";
  const note = {
    text: "assumed not to change, not estimated", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.85,
    font: { color: colour("faint") },
  };
  return {
    width, height: wide ? WIDE_PX : HEIGHT_PX, margin: { l: 54, r: 10, t: 8, b: 42 }, showlegend: false, hovermode: "closest",
    dragmode: touched.matches ? false : "zoom", uirevision: twin.id,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: colour("ink"), size: 11.5, family: "system-ui, sans-serif" },
    xaxis: { ...axis, nticks: 7, range: spanOf(twin), title: { text: along, standoff: 6 } },
    yaxis: { ...axis, nticks: 6, range, title: { text: QUANTITIES[quantity].axis, standoff: 4 } },
    shapes: [...limitsOf(twin, quantity), ...instantOf(twin)], annotations: assumed ? [note] : [],
  };
}

/** Draw, and give back what there is to see, by the keys of the legend. */
export async function draw(plot, twin, quantity, wide) {
  const Plotly = await plotly, assumed = Boolean(twin.points.at(-1)?.assumed.includes(quantity));
  const parts = assumed ? NOTHING : sorted(twin.points, quantity), all = [...twin.points, ...twin.later.slice(1)];
  const range = widened(rangeOf(all, quantity, assumed || !twin.at ? parts : sorted(all, quantity)), twin, quantity);
  const traces = tracesOf(twin, quantity, parts, range);
  const layout = layoutOf(twin, quantity, { width: plot.clientWidth, range, assumed, wide });
  await Plotly.react(plot, traces, layout, { displayModeBar: false });
  const { runs, apart } = parts, has = (name) => traces.some((trace) => trace.name === name);
  plot.setAttribute("aria-label", described(twin, quantity, assumed));
  Object.assign(plot.dataset, {
    points: runs.flat().length, bands: runs.filter((run) => run.length > 1).length, assumed,
    inseparable: apart.inseparable.length, invalid: apart.invalid.length,
    truth: traces.find((trace) => trace.name === "truth")?.x.length ?? 0, forecast: has("forecast"), reached: has("time to threshold"),
  });
  return {
    estimate: has("estimate"), truth: has("truth"), later: has("what came after"), ahead: has("forecast"), reached: has("time to threshold"),
    limit: (twin.latest?.registration?.alarms ?? []).some((alarm) => alarm.quantity === quantity),
    inseparable: apart.inseparable.length > 0, invalid: apart.invalid.length > 0,
  };
}
