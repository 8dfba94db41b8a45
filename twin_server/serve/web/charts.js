// One quantity of one twin over slow time: estimate, 95 % band, what is not valid, forecast, truth.
import { QUANTITIES, isClock, spoken, standing, unitOf } from "./words.js";

const HEIGHT_PX = 215, WIDE_PX = 300, ASSUMED_PX = 120;

// A finger on a chart scrolls the page; it does not zoom.
const touched = matchMedia("(pointer: coarse)");

/** Plotly is large: the page speaks before it can draw. */
export const plotly = new Promise((resolve, reject) => {
  const script = document.createElement("script");
  script.src = "/assets/plotly.min.js";
  script.onload = () => resolve(window.Plotly);
  script.onerror = () => reject(new Error("The drawing library did not load. Reload the page; the numbers are right without it."));
  document.head.append(script);
});

function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim(); }
function faded(hex, alpha) { return hex + Math.round(255 * alpha).toString(16).padStart(2, "0"); }
const place = (point) => isClock(point) ? new Date(1000 * point.slow_time) : point.slow_time;

/** Valid readings in stretches without a hole; the others apart, by what stands against them. */
function sorted(points, quantity) {
  const runs = [], apart = { inseparable: [], invalid: [] };
  let run = null, before = null;
  for (const point of points) {
    const broken = !before || point.missing_before > 0 || point.slow_time < before.slow_time;
    const kind = standing(point), drawn = point[quantity];
    before = point;
    // A frequency is measured, whatever it is then taken to mean.
    const sound = drawn && (kind === "valid" || (kind !== "invalid" && quantity === "frequency_hz"));
    if (!sound) {
      run = null;
      if (drawn) (apart[kind] ?? apart.invalid).push(point);
    } else if (run && !broken) run.push(point);
    else runs.push(run = [point]);
  }
  return { runs, apart };
}

function joined(runs, pick) { return runs.flatMap((run, i) => i ? [null, ...pick(run)] : pick(run)); }

/** Each stretch is a closed shape of its own, since a filled line would bridge the holes. */
function band(runs, values, scale, tint) {
  const there = (run) => [...run, ...run.slice().reverse()].map(place);
  const edge = (run) => [...run.map((p) => scale * values(p).lo), ...run.slice().reverse().map((p) => scale * values(p).hi)];
  return { name: "95 % band", x: joined(runs, there), y: joined(runs, edge), mode: "lines", fill: "toself", fillcolor: faded(tint, 0.28),
    line: { width: 0 }, hoverinfo: "skip" };
}

function markers(name, points, quantity, symbol, tint, range) {
  const scale = QUANTITIES[quantity].scale, off = (y) => y < range[0] || y > range[1];
  const y = points.map((point) => scale * point[quantity].value);
  return { name, x: points.map(place), y: y.map((v) => Math.min(range[1], Math.max(range[0], v))), mode: "markers", cliponaxis: false,
    marker: { color: tint, size: 7, symbol: y.map((v) => off(v) ? (v > range[1] ? "triangle-up-open" : "triangle-down-open") : symbol), line: { width: 1.4 } },
    text: points.map((point) => spoken(point[quantity], quantity).join(", 95 %: ")), hovertemplate: `${name}: %{text}<extra></extra>`,
    error_y: { type: "data", symmetric: false, color: faded(tint, 0.45), width: 0, thickness: 1,
      array: points.map((p, i) => off(y[i]) ? 0 : scale * (p[quantity].hi - p[quantity].value)),
      arrayminus: points.map((p, i) => off(y[i]) ? 0 : scale * (p[quantity].value - p[quantity].lo)) } };
}

/** The axis follows what is valid; a wild reading is marked at the edge and does not flatten the rest. */
function rangeOf(points, quantity, { runs, apart }) {
  const scale = QUANTITIES[quantity].scale, sound = runs.flat(), ends = [];
  const many = sound.length >= points.length / 4 ? sound : [...sound, ...apart.inseparable, ...apart.invalid];
  const at = (values, share) => values.sort((a, b) => a - b)[Math.round(share * (values.length - 1))];
  if (many.length) {
    ends.push(at(many.map((p) => p[quantity].lo), 0.01), at(many.map((p) => p[quantity].hi), 0.99));
    for (const point of many) ends.push(point[quantity].value);
  }
  for (const point of points) if (point.truth && quantity in point.truth) ends.push(point.truth[quantity]);
  if (!ends.length) return [-1, 1];
  const [lo, hi] = ends.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]).map((v) => scale * v);
  const margin = Math.max(0.08 * (hi - lo), quantity === "frequency_hz" ? 1e-3 * Math.abs(hi) : 0.5);
  return [lo - margin, hi + margin];
}

function truth(points, quantity) {
  const known = points.filter((point) => point.truth && quantity in point.truth);
  const scale = QUANTITIES[quantity].scale;
  return known.length && { name: "truth", x: known.map(place), y: known.map((p) => scale * p.truth[quantity]), mode: "lines",
    line: { color: colour("truth"), width: 1.2, dash: "4px,4px" }, hovertemplate: "truth: %{y:.5g}<extra></extra>" };
}

function ahead(twin, quantity) {
  const last = twin.points.at(-1), scale = QUANTITIES[quantity].scale, tint = colour("ahead");
  const points = (twin.forecast?.points ?? []).filter((p) => p[quantity] && p.slow_time >= last.slow_time)
    .map((p) => ({ ...last, ...p }));
  if (points.length < 2) return [];
  return [{ ...band([points], (p) => p[quantity], scale, tint), name: "forecast band" },
    { name: "forecast", x: points.map(place), y: points.map((p) => scale * p[quantity].value), mode: "lines", line: { color: tint, width: 1.6 },
      hovertemplate: "forecast: %{y:.4g}<extra></extra>" }];
}

function traces(twin, quantity, parts, range) {
  const { scale } = QUANTITIES[quantity], tint = colour("estimate"), value = (p) => p[quantity];
  const long = parts.runs.filter((run) => run.length > 1), lone = parts.runs.filter((run) => run.length === 1).flat();
  const found = long.length ? [band(long, value, scale, tint), { name: "estimate", x: joined(long, (run) => run.map(place)),
    y: joined(long, (run) => run.map((p) => scale * value(p).value)), mode: "lines", line: { color: tint, width: 1.3 },
    text: joined(long, (run) => run.map((p) => spoken(value(p), quantity).join(", 95 %: "))), hovertemplate: "%{text}<extra></extra>" }] : [];
  if (lone.length) found.push(markers("estimate", lone, quantity, "circle", tint, range));
  found.push(...ahead(twin, quantity));
  const { inseparable, invalid } = parts.apart;
  if (inseparable.length) found.push(markers("not told apart", inseparable, quantity, "diamond-open", colour("inseparable"), range));
  if (invalid.length) found.push(markers("not valid", invalid, quantity, "x-thin-open", colour("invalid"), range));
  return found;
}

/** One range for all charts of a twin, so that they can be read across. */
function spanOf(twin) {
  const { points, forecast } = twin, times = points.map((point) => point.slow_time);
  if (!times.length) return undefined;
  const [from, to] = times.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  const until = Math.max(to, forecast?.points.at(-1).slow_time ?? to, from + 1e-6);
  return [from, until].map((slow_time) => place({ ...points.at(-1), slow_time }));
}

/** The chart in words, for those who do not see it. */
function described(twin, quantity, assumed) {
  const { title } = QUANTITIES[quantity], last = twin.points.at(-1), first = twin.points[0];
  if (!last) return `${title}: no readings yet`;
  const now = assumed ? "assumed not to change" : last[quantity] ? `last ${spoken(last[quantity], quantity).join(", 95 % interval ")}` : "not estimated at the last reading";
  return `${title}, ${twin.points.length} readings from slow time ${+first.slow_time.toPrecision(6)} to ${+last.slow_time.toPrecision(6)} ${unitOf(last)}: ${now}`;
}

export async function draw(plot, twin, quantity, wide) {
  const Plotly = await plotly, last = twin.points.at(-1), assumed = Boolean(last?.assumed.includes(quantity));
  const parts = assumed ? { runs: [], apart: { inseparable: [], invalid: [] } } : sorted(twin.points, quantity);
  const range = rangeOf(twin.points, quantity, parts), known = truth(twin.points, quantity);
  const data = [...(assumed || !last ? [] : traces(twin, quantity, parts, range)), ...(known ? [known] : [])];
  const limits = (twin.latest?.registration?.alarms ?? []).filter((alarm) => alarm.quantity === quantity);
  const { scale, axis } = QUANTITIES[quantity], ink = colour("ink"), line = colour("line");
  const ticks = { gridcolor: line, zeroline: false, ticks: "outside", ticklen: 4, tickcolor: line, linecolor: line, showline: true };
  await Plotly.react(plot, data, {
    height: assumed && !known ? ASSUMED_PX : wide ? WIDE_PX : HEIGHT_PX, showlegend: false, hovermode: "closest", dragmode: touched.matches ? false : "zoom", uirevision: twin.id,
    margin: { l: 54, r: 10, t: 8, b: 42 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: ink, size: 11.5, family: "system-ui, sans-serif" },
    xaxis: { ...ticks, nticks: 7, range: spanOf(twin), fixedrange: touched.matches, title: { text: last && isClock(last) ? "slow time" : `slow time${last ? ` [${unitOf(last)}]` : ""}`, standoff: 6 } },
    yaxis: { ...ticks, nticks: 6, fixedrange: touched.matches, title: { text: axis, standoff: 4 }, range },
    shapes: limits.map((alarm) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: scale * (alarm.below ?? alarm.above), y1: scale * (alarm.below ?? alarm.above),
      line: { color: colour("bad"), width: 1.4, dash: "dot" } })),
    annotations: assumed ? [{ text: "assumed not to change, not estimated", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.85, font: { color: colour("faint") } }] : [],
  }, { responsive: true, displayModeBar: false });
  const { inseparable, invalid } = parts.apart;
  plot.setAttribute("aria-label", described(twin, quantity, assumed));
  Object.assign(plot.dataset, { points: parts.runs.flat().length, bands: parts.runs.filter((run) => run.length > 1).length, inseparable: inseparable.length,
    invalid: invalid.length, truth: known ? known.x.length : 0, forecast: data.some((trace) => trace.name === "forecast"), assumed });
  return { estimate: parts.runs.length > 0, inseparable: inseparable.length > 0, invalid: invalid.length > 0,
    ahead: data.some((trace) => trace.name === "forecast"), truth: Boolean(known), limit: limits.length > 0 };
}
