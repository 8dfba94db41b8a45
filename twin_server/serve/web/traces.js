// History of one quantity → what Plotly draws: estimate, 95 % band, forecast, what is not valid, truth.
import { QUANTITIES, isClock, spoken, standing } from "./words.js";

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
export function faded(hex, alpha) { return hex + Math.round(255 * alpha).toString(16).padStart(2, "0"); }

/** Where a reading is on the axis of slow time. */
export const placeOf = (point) => isClock(point) ? new Date(1000 * point.slow_time) : point.slow_time;
const told = (point, quantity) => spoken(point[quantity], quantity).join(", 95 %: ");
const ends = (values) => values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);

/** Sound readings in stretches without a hole; the others apart, by what stands against them. */
export function sorted(points, quantity) {
  const runs = [], apart = { inseparable: [], invalid: [] };
  let run = null, before = null;
  for (const point of points) {
    const kind = standing(point), drawn = point[quantity];
    const broken = !before || point.missing_before > 0 || point.slow_time < before.slow_time;
    before = point;
    // Frequency and damping are measured, whatever can then be made of them.
    const sound = drawn && (kind === "valid" || (kind !== "invalid" && QUANTITIES[quantity].measured));
    if (!sound) {
      run = null;
      if (drawn) (apart[kind] ?? apart.invalid).push(point);
    } else if (run && !broken) run.push(point);
    else runs.push(run = [point]);
  }
  return { runs, apart };
}

/** A null between two stretches breaks the line. */
const joined = (runs, pick) => runs.flatMap((run, i) => [...(i ? [null] : []), ...run.map(pick)]);
const backwards = (run) => run.slice().reverse();

/** Each stretch is a closed shape of its own, since a filled line would bridge the holes. */
function band(name, runs, quantity, tint) {
  const { scale } = QUANTITIES[quantity];
  const around = runs.map((run) => [
    ...run.map((point) => [placeOf(point), scale * point[quantity].lo]),
    ...backwards(run).map((point) => [placeOf(point), scale * point[quantity].hi]),
  ]);
  return {
    name, x: joined(around, ([x]) => x), y: joined(around, ([, y]) => y), mode: "lines", hoverinfo: "skip",
    fill: "toself", fillcolor: faded(tint, 0.28), line: { width: 0 },
  };
}

function line(name, runs, quantity, tint, width) {
  const { scale } = QUANTITIES[quantity];
  return {
    name, x: joined(runs, placeOf), y: joined(runs, (point) => scale * point[quantity].value), mode: "lines",
    line: { color: tint, width }, text: joined(runs, (point) => told(point, quantity)),
    hovertemplate: `${name}: %{text}<extra></extra>`,
  };
}

/** Single readings with their intervals; one beyond the axis is a triangle at its edge. */
function markers(name, points, quantity, symbol, tint, [low, high]) {
  const { scale } = QUANTITIES[quantity], values = points.map((point) => scale * point[quantity].value);
  const off = values.map((v) => v > high ? "triangle-up-open" : v < low ? "triangle-down-open" : null);
  const reach = (end) => points.map((p, i) => off[i] ? 0 : scale * Math.abs(p[quantity][end] - p[quantity].value));
  return {
    name, x: points.map(placeOf), y: values.map((v) => Math.min(high, Math.max(low, v))), mode: "markers",
    marker: { color: tint, size: 7, symbol: off.map((sign) => sign ?? symbol), line: { width: 1.4 } }, cliponaxis: false,
    error_y: {
      type: "data", symmetric: false, array: reach("hi"), arrayminus: reach("lo"),
      color: faded(tint, 0.45), width: 0, thickness: 1,
    },
    text: points.map((point) => told(point, quantity)), hovertemplate: `${name}: %{text}<extra></extra>`,
  };
}

const knowing = (points, quantity) => points.filter((point) => point.truth && quantity in point.truth);

function truth(points, quantity) {
  const known = knowing(points, quantity), { scale } = QUANTITIES[quantity];
  return known.length ? [{
    name: "truth", x: known.map(placeOf), y: known.map((point) => scale * point.truth[quantity]), mode: "lines",
    line: { color: colour("truth"), width: 1.2, dash: "4px,4px" }, hovertemplate: "truth: %{y:.5g}<extra></extra>",
  }] : [];
}

/** What is expected after the last reading; of an older forecast only what is still to come. */
function ahead({ points, forecast }, quantity) {
  const last = points.at(-1), tint = colour("ahead");
  const coming = (forecast?.points ?? []).filter((point) => point[quantity] && point.slow_time >= last.slow_time);
  if (coming.length < 2) return [];
  const run = coming.map((point) => ({ ...last, ...point }));
  return [band("forecast band", [run], quantity, tint), line("forecast", [run], quantity, tint, 1.6)];
}

/** Along each threshold, from when it is reached with 10 % to when it is with 90 %, as far as that is foretold. */
function reached({ points, forecast }, quantity) {
  const { scale } = QUANTITIES[quantity], last = points.at(-1), tint = colour("ahead");
  const told = (forecast?.crossings ?? []).filter(({ quantity: of, times, already }) => (
    of === quantity && times[0].slow_time !== null && already < 0.5
  ));
  return told.map(({ threshold, times, horizon, sentence }) => {
    const at = times.map(({ slow_time }) => placeOf({ ...last, slow_time: Math.max(slow_time ?? horizon, last.slow_time) }));
    const symbol = times.map(({ slow_time }, i) => slow_time === null ? "triangle-right-open" : i === 1 ? "diamond" : "line-ns-open");
    return {
      name: "time to threshold", x: at, y: at.map(() => scale * threshold), mode: "lines+markers",
      line: { color: tint, width: 3 }, marker: { color: tint, size: 9, symbol, line: { width: 2, color: tint } },
      text: at.map(() => sentence), hovertemplate: "%{text}<extra></extra>",
    };
  });
}

/** The axis follows what is sound: a wild reading is marked at its edge and does not flatten the rest. */
export function rangeOf(points, quantity, { runs, apart }) {
  const sound = runs.flat(), few = sound.length < points.length / 4;
  const shown = few ? [...sound, ...apart.inseparable, ...apart.invalid] : sound;
  const at = (end, share) => {
    const ordered = shown.map((point) => point[quantity][end]).sort((a, b) => a - b);
    return ordered[Math.round(share * (ordered.length - 1))];
  };
  const within = [
    ...(shown.length ? [at("lo", 0.01), at("hi", 0.99)] : []),
    ...shown.map((point) => point[quantity].value),
    ...knowing(points, quantity).map((point) => point.truth[quantity]),
  ];
  if (!within.length) return [-1, 1];
  const [low, high] = ends(within).map((v) => QUANTITIES[quantity].scale * v);
  const margin = Math.max(0.08 * (high - low), quantity === "frequency_hz" ? 1e-3 * Math.abs(high) : 0.5);
  return [low - margin, high + margin];
}

/** What is foretold may widen an axis by half; what leaves it then is cut off. */
export function widened([low, high], { points, forecast }, quantity) {
  const { scale } = QUANTITIES[quantity], last = points.at(-1), room = 0.5 * (high - low);
  const coming = (forecast?.points ?? []).filter((point) => point[quantity] && point.slow_time >= last.slow_time);
  if (coming.length < 2 || last.assumed.includes(quantity)) return [low, high];
  const [least, most] = [Math.min(...coming.map((point) => point[quantity].lo)), Math.max(...coming.map((point) => point[quantity].hi))];
  return [Math.max(low - room, Math.min(low, scale * least)), Math.min(high + room, Math.max(high, scale * most))];
}

/** One range of slow time for all charts of a twin, so that they can be read across. */
export function spanOf({ points, later, forecast }) {
  if (!points.length) return undefined;
  const [from, to] = ends([...points, ...later].map((point) => point.slow_time));
  const until = Math.max(to, forecast?.points.at(-1).slow_time ?? to, from + 1e-6);
  return [from, until].map((slow_time) => placeOf({ ...points.at(-1), slow_time }));
}

const SIGNS = { inseparable: ["not told apart", "diamond-open"], invalid: ["not valid", "x-thin-open"] };

/** What came after the instant that is looked at: there, and no more than that. */
function after({ later }, quantity) {
  const { runs } = sorted(later, quantity);
  return later.length > 1 && runs.length ? [line("what came after", runs, quantity, faded(colour("invalid"), 0.6), 1)] : [];
}

/** All that is drawn of one quantity, from the back to the front. */
export function tracesOf(twin, quantity, parts, range) {
  const tint = colour("estimate"), { runs, apart } = parts;
  const long = runs.filter((run) => run.length > 1), lone = runs.filter((run) => run.length === 1).flat();
  const found = after(twin, quantity);
  if (long.length) found.push(band("95 % band", long, quantity, tint), line("estimate", long, quantity, tint, 1.3));
  if (lone.length) found.push(markers("estimate", lone, quantity, "circle", tint, range));
  if (twin.points.length && !twin.points.at(-1).assumed.includes(quantity)) {
    found.push(...ahead(twin, quantity), ...reached(twin, quantity));
  }
  for (const [kind, [name, symbol]] of Object.entries(SIGNS)) {
    if (apart[kind].length) found.push(markers(name, apart[kind], quantity, symbol, colour(kind), range));
  }
  return [...found, ...truth(twin.points, quantity)];
}
