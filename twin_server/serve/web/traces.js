// History of one quantity → what a chart draws: estimate, 95 % band, forecast, what is not valid, truth.
import { bucketed, corners, fineFor, merged, roomFor, served, stretches } from "./buckets.js";
import { t } from "./language.js";
import { colour, faded } from "./svg.js";
import { QUANTITIES, atTime, digits, isClock, spoken, standing, valued } from "./words.js";

/** Where a reading is on the axis of slow time. */
export const placeOf = (point) => isClock(point) ? new Date(1000 * point.slow_time) : point.slow_time;
const told = (point, quantity) => valued(spoken(point[quantity], quantity));
const endsOf = (values) => values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);

/** Whether a reading is drawn as a line: frequency and damping are measured, whatever can then be made of them. */
function soundOf(quantity) {
  return (point) => {
    const kind = standing(point);
    return point[quantity] && (kind === "valid" || (kind !== "invalid" && QUANTITIES[quantity].measured)) ? point[quantity] : null;
  };
}

const MOST_MARKS = 150;

/** Of too many marks each so many-th. */
const fewer = (points) => {
  const every = Math.ceil(points.length / MOST_MARKS);
  return every > 1 ? points.filter((_, i) => i % every === 0) : points;
};

/**
 * What is drawn as lines, in stretches without a gap: few readings as they are, `fine`, many in `buckets`, never both.
 * `of` gives its columns in a history that the server has thinned.
 */
export function linesOf({ bands, renewed, whole = true }, points, pick, of, width, span = {}) {
  const told = { renewed, whole: whole && !bands };
  if (!bands) {
    const runs = stretches(points, pick, told), readings = runs.reduce((sum, run) => sum + run.length, 0);
    const few = readings <= fineFor(width);
    return few ? { fine: runs, buckets: [], readings } : { fine: [], buckets: bucketed(runs, pick, Math.ceil(readings / roomFor(width))), readings };
  }
  const kept = served(bands, of, { renewed, ...span }), until = bands.end.slow_time.at(-1);
  const size = Math.ceil(bands.readings / bands.count.length);
  const fresh = bucketed(stretches(points.filter((point) => point.slow_time > until), pick, { renewed }), pick, size);
  const goesOn = kept.length && fresh.length && !renewed.has(fresh[0][0].from) && kept.at(-1).at(-1).to === until;
  const runs = goesOn ? [...kept.slice(0, -1), [...kept.at(-1), ...fresh[0]], ...fresh.slice(1)] : [...kept, ...fresh];
  return { fine: [], buckets: merged(runs, roomFor(width)), readings: runs.flat().reduce((sum, { count }) => sum + count, 0) };
}

/** Sound readings as lines; the others apart, by what stands against them. */
export function sorted(twin, points, quantity, width, span) {
  const pick = soundOf(quantity), apart = { inseparable: [], invalid: [] };
  for (const point of points) {
    if (point[quantity] && !pick(point)) (apart[standing(point)] ?? apart.invalid).push(point);
  }
  return { ...linesOf(twin, points, pick, (bands) => bands.quantities[quantity], width, span), apart };
}

/** What a trace is called where a reader points at it; lines of elements bear their own name. */
const SAID = {
  estimate: t("chart.estimate"), forecast: t("chart.forecast"), "what came after": t("chart.later"),
  "not told apart": t("chart.inseparable"), "not valid": t("chart.invalid"),
};
const saidOf = (name) => SAID[name] ?? name;

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
    name, x: joined(around, ([x]) => x), y: joined(around, ([, y]) => y), mode: "lines",
    fill: "toself", fillcolor: faded(tint, 0.28), line: { width: 0 },
  };
}

function line(name, runs, quantity, tint, width) {
  const { scale } = QUANTITIES[quantity], points = joined(runs, (point) => point);
  return {
    name, x: joined(runs, placeOf), y: joined(runs, (point) => scale * point[quantity].value), mode: "lines",
    line: { color: tint, width }, hover: (i) => `${saidOf(name)}: ${told(points[i], quantity)}`,
  };
}

/** Each stretch of buckets as a closed shape between two of their ends. */
function ribbon(name, buckets, [low, high], { place, scale, tint }) {
  const around = buckets.map((run) => {
    const at = corners(run);
    return [...at.map(([x, bucket]) => [x, bucket[low]]), ...at.toReversed().map(([x, bucket]) => [x, bucket[high]])];
  });
  return {
    name, x: joined(around, ([x]) => place(x)), y: joined(around, ([, y]) => scale * y), mode: "lines",
    fill: "toself", fillcolor: tint, line: { width: 0 },
  };
}

/** Buckets: the widest interval pale, the least and greatest value darker, the mean as a line. */
export function bucketTraces(name, buckets, look, speak) {
  if (!buckets.length) return [];
  const { place, scale, tint } = look, at = buckets.map(corners), places = joined(at, (corner) => corner);
  const say = ([, { count, mean, min, max }]) => count === 1 ? speak(mean) : t("chart.bucket", { n: count, mean: speak(mean), least: speak(min), greatest: speak(max) });
  return [
    ribbon(`${name} band`, buckets, ["lo", "hi"], { ...look, tint: faded(tint, 0.2) }),
    ribbon(`${name} spread`, buckets, ["min", "max"], { ...look, tint: faded(tint, 0.35) }),
    {
      name, x: joined(at, ([x]) => place(x)), y: joined(at, ([, { mean }]) => scale * mean), mode: "lines",
      line: { color: tint, width: look.width ?? 1.4, dash: look.dash }, hover: (i) => `${saidOf(name)}: ${say(places[i])}`,
    },
  ];
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
      array: reach("hi"), arrayminus: reach("lo"),
      color: faded(tint, 0.45), thickness: 1,
    },
    hover: (i) => `${saidOf(name)}: ${told(points[i], quantity)}`,
  };
}

/** What a simulator knows, where it knows it: never across a gap; in buckets between its least and its greatest value. */
export function truthTraces(name, twin, key, width, look) {
  const pick = ({ truth }) => truth && key in truth ? { value: truth[key], lo: truth[key], hi: truth[key] } : null;
  // Each truth is one line without noise, so that readings that are all held are drawn as they are.
  const room = twin.bands ? width : Infinity;
  const { fine, buckets } = linesOf(twin, twin.points, pick, (bands) => bands.truth?.[key], room, { until: twin.at?.slow_time ?? Infinity });
  const { place, scale } = look, at = buckets.map(corners);
  const runs = [
    ...fine.map((run) => run.map((point) => [placeOf(point), scale * point.truth[key]])),
    ...["min", "max"].flatMap((end) => at.map((run) => run.map(([x, bucket]) => [place(x), scale * bucket[end]]))),
  ];
  return runs.length ? [{
    name, x: joined(runs, ([x]) => x), y: joined(runs, ([, y]) => y), mode: "lines",
    line: { color: colour("truth"), width: 1.2, dash: "4px,4px" }, hover: (i) => `${t("chart.truth")}: ${digits(joined(runs, ([, y]) => y)[i], 5)}`,
  }] : [];
}

/** What is expected after the last reading; of an older forecast only what is still to come. */
function ahead({ points, forecast }, quantity) {
  const last = points.at(-1), tint = colour("ahead");
  const coming = (forecast?.points ?? []).filter((point) => point[quantity] && point.slow_time >= last.slow_time);
  if (coming.length < 2) return [];
  const run = coming.map((point) => ({ ...atTime(last, point.slow_time), ...point }));
  return [band("forecast band", [run], quantity, tint), line("forecast", [run], quantity, tint, 1.6)];
}

/** Along each threshold, from when it is reached with 10 % to when it is with 90 %, as far as that is foretold. */
function reached({ points, forecast }, quantity) {
  const { scale } = QUANTITIES[quantity], last = points.at(-1), tint = colour("ahead");
  const told = (forecast?.crossings ?? []).filter(({ quantity: of, times, already }) => (
    of === quantity && times[0].slow_time !== null && already < 0.5
  ));
  return told.map(({ threshold, times, horizon, sentence }) => {
    const at = times.map(({ slow_time }) => placeOf(atTime(last, Math.max(slow_time ?? horizon, last.slow_time))));
    const symbol = times.map(({ slow_time }, i) => slow_time === null ? "triangle-right-open" : i === 1 ? "diamond" : "line-ns-open");
    return {
      name: "time to threshold", x: at, y: at.map(() => scale * threshold), mode: "lines+markers",
      line: { color: tint, width: 3 }, marker: { color: tint, size: 9, symbol, line: { width: 2, color: tint } },
      hover: () => sentence,
    };
  });
}

/** The axis follows what is sound: a wild reading is marked at its edge and does not flatten the rest. */
export function rangeOf(points, quantity, { fine, buckets, readings, apart }) {
  const few = readings < points.length / 4, ends = [];
  const shown = [
    ...fine.flat().map((point) => point[quantity]), ...buckets.flat().map(({ min, max, lo, hi }) => ({ lo, hi, least: min, value: max })),
    ...(few ? [...apart.inseparable, ...apart.invalid].map((point) => point[quantity]) : []),
  ];
  const at = (end, share) => {
    const ordered = shown.map((one) => one[end]).sort((a, b) => a - b);
    return ordered[Math.round(share * (ordered.length - 1))];
  };
  if (shown.length) ends.push(at("lo", 0.01), at("hi", 0.99));
  for (const one of shown) ends.push(one.value, one.least ?? one.value);
  for (const { truth } of points) if (truth && quantity in truth) ends.push(truth[quantity]);
  if (!ends.length) return [-1, 1];
  const [low, high] = endsOf(ends).map((v) => QUANTITIES[quantity].scale * v);
  const margin = Math.max(0.08 * (high - low), quantity === "frequency_hz" ? 1e-3 * Math.abs(high) : 0.5);
  return [low - margin, high + margin];
}

/** A threshold farther beyond the readings than this many times their range would flatten them. */
const FARTHEST = 2;

/** What is foretold may widen an axis by half, a threshold that is likely reached within the horizon more; what leaves it then is cut off. */
export function widened([low, high], { points, forecast }, quantity) {
  const { scale } = QUANTITIES[quantity], last = points.at(-1), room = 0.5 * (high - low);
  const coming = (forecast?.points ?? []).filter((point) => point[quantity] && point.slow_time >= last.slow_time);
  if (coming.length < 2 || last.assumed.includes(quantity)) return [low, high];
  const [least, most] = [Math.min(...coming.map((point) => point[quantity].lo)), Math.max(...coming.map((point) => point[quantity].hi))];
  const wide = [Math.max(low - room, Math.min(low, scale * least)), Math.min(high + room, Math.max(high, scale * most))];
  const limits = (forecast.crossings ?? []).filter(({ quantity: of, times }) => of === quantity && (times[1] ?? times[0]).slow_time !== null);
  const margin = 0.08 * (high - low), farthest = FARTHEST * (high - low);
  for (const { threshold } of limits) {
    const at = scale * threshold;
    if (at < wide[0] && at > low - farthest) wide[0] = at - margin;
    if (at > wide[1] && at < high + farthest) wide[1] = at + margin;
  }
  return wide;
}

/** One range of slow time for all charts of a twin, so that they can be read across. */
export function spanOf({ points, later, forecast }) {
  if (!points.length) return undefined;
  const [from, to] = endsOf([...points, ...later].map((point) => point.slow_time));
  const until = Math.max(to, forecast?.points.at(-1).slow_time ?? to, from + 1e-6);
  return [from, until].map((slow_time) => placeOf(atTime(points.at(-1), slow_time)));
}

const SIGNS = { inseparable: ["not told apart", "diamond-open"], invalid: ["not valid", "x-thin-open"] };

/** What came after the instant that is looked at: there, and no more than that. */
function after(twin, quantity, look, width) {
  if (twin.later.length < 2) return [];
  const { fine, buckets } = sorted(twin, twin.later, quantity, width, { since: twin.at.slow_time });
  const tint = faded(colour("invalid"), 0.6), name = "what came after";
  if (fine.length) return [line(name, fine, quantity, tint, 1)];
  return bucketTraces(name, buckets, { ...look, tint: colour("invalid"), width: 1 }, (x) => digits(look.scale * x, 4)).slice(2);
}

/** All that is drawn of one quantity, from the back to the front. */
export function tracesOf(twin, quantity, parts, range, width) {
  const tint = colour("estimate"), { fine, buckets, apart } = parts, { scale, unit } = QUANTITIES[quantity];
  const long = fine.filter((run) => run.length > 1), lone = fine.filter((run) => run.length === 1).flat();
  const last = twin.points.at(-1), look = { place: (slow_time) => placeOf(atTime(last, slow_time)), scale, tint };
  const found = last ? after(twin, quantity, look, width) : [];
  if (long.length) found.push(band("95 % band", long, quantity, tint), line("estimate", long, quantity, tint, 1.3));
  if (lone.length) found.push(markers("estimate", lone, quantity, "circle", tint, range));
  found.push(...bucketTraces("estimate", buckets, look, (x) => `${digits(scale * x, 4)} ${unit}`));
  if (last && !last.assumed.includes(quantity)) found.push(...ahead(twin, quantity), ...reached(twin, quantity));
  for (const [kind, [name, symbol]] of Object.entries(SIGNS)) {
    if (apart[kind].length) found.push(markers(name, fewer(apart[kind]), quantity, symbol, colour(kind), range));
  }
  return last ? [...found, ...truthTraces("truth", twin, quantity, width, look)] : found;
}
