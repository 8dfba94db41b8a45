// Which part of a long history is asked for: all of it, thinned by the server, or the latest readings, each of them.
import { ask } from "./link.js";

const PATIENCE_MS = 30000;

/** Of how many times as many readings the latest are asked for: where they begin is known roughly. */
const SURPLUS = 3;

/** How many readings came after each of `points`, those before it lost ones included; a boot's first reading is one. */
const between = (before, point) => before.boot === point.boot ? Math.max(1, point.sequence - before.sequence) : 1;

const sumOf = (points, of) => points.slice(1).reduce((sum, point, i) => sum + of(points[i], point), 1);

/** How many readings the points stand for. */
const countOf = ({ points, bands }) => bands ? bands.readings : sumOf(points, between);

/** Whether readings are left out that are not lost. */
function isThinned({ points, bands }) {
  if (bands) return true;
  const known = sumOf(points, (before, point) => 1 + (before.boot === point.boot ? point.missing_before : 0));
  return countOf({ points }) > known;
}

/** Sensor time [ns] from which at least `most` readings follow; null where there are no more than that. */
function beginOf({ points }, most) {
  let count = 1;
  for (let i = points.length - 1; i > 0; i -= 1) {
    count += between(points[i - 1], points[i]);
    if (count >= most) return points[i - 1].t_ns;
  }
  return null;
}

/** Which part of a history is looked at: its latest readings, all of it, or the last milliseconds of sensor time. */
export const LATEST = "latest", ALL = "all";

const told = (history) => ({ points: history.points, bands: history.bands ?? null, thinned: isThinned(history) });

/**
 * `{ points, bands, thinned, longer, begin }`: `longer` says that the whole history has more than `most` readings, and
 * `begin` when it begins, in sensor time [ns].
 */
export async function historyOf(base, { part = LATEST, most, points = most }) {
  const get = (count, start) => ask(`${base}/history?max_points=${count}${start}`, PATIENCE_MS);
  const whole = await get(points, ""), longer = isThinned(whole) && countOf(whole) > most;
  const known = { longer, begin: whole.points[0]?.t_ns ?? null };
  if (typeof part === "number" && whole.points.length) {
    const since = whole.points.at(-1).t_ns - 1e6 * part;
    return since <= known.begin ? { ...known, ...told(whole) } : { ...known, ...told(await get(points, `&start=${Math.floor(since)}`)) };
  }
  const begin = longer && part === LATEST ? beginOf(whole, most) : null;
  if (begin === null) return { ...known, ...told(whole) };
  const latest = await get(points === most ? SURPLUS * most : points, `&start=${begin}`);
  return { ...known, ...told(latest), points: latest.points.slice(-most) };
}

/** The part of a history between two slow times or dates, as finely as `most` points show it. */
export async function partOf(base, ends, most) {
  const [start, end] = ends.map((end) => (end instanceof Date ? end.toISOString() : `slow:${end}`));
  return told(await ask(`${base}/history?${new URLSearchParams({ max_points: most, start, end })}`, PATIENCE_MS));
}
