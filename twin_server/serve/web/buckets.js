// Many readings → few buckets: of each the mean, the least and greatest value, and the widest interval. Stretches end at gaps.

const PX_A_BUCKET = 4, FINE = 2.5;

/** Share of the typical step from which a pause between two readings is a gap. */
const GAP_STEPS = 10;

/** How many buckets a chart of a width has room for. */
export const roomFor = (width) => Math.max(60, Math.round(width / PX_A_BUCKET));

/** Readings that a chart shows one by one; more are put into buckets. */
export const fineFor = (width) => Math.round(FINE * roomFor(width));

function median(values) {
  const ordered = values.filter((value) => value > 0).sort((a, b) => a - b);
  return ordered.length ? ordered[Math.floor(ordered.length / 2)] : 0;
}

/** Slow time from one reading to the next, typically. */
export const stepOf = (points) => median(points.slice(1).map((point, i) => point.slow_time - points[i].slow_time));

/** Whether one of `times` is within two steps of `at`. */
export const isNear = (at, times, step) => [...times].some((time) => Math.abs(time - at) <= 2 * step);

/** The slow time from which a pause is a gap; of readings that were thinned nothing is known of pauses. */
function longest(points, whole) {
  const typical = whole ? stepOf(points) : 0;
  return typical > 0 ? GAP_STEPS * typical : Infinity;
}

/**
 * Readings in stretches without a gap: none was lost, time does not fall or pause, and the structure was not renewed.
 * `pick` gives what is drawn of a reading, or nothing; a reading without it ends a stretch too.
 */
export function stretches(points, pick, { whole = true, renewed = new Set() } = {}) {
  const runs = [], most = longest(points, whole);
  let run = null, before = null;
  for (const point of points) {
    const step = before ? point.slow_time - before.slow_time : 0;
    const broken = !before || (whole && point.missing_before > 0) || step < 0 || step > most || renewed.has(point.slow_time);
    before = point;
    if (!pick(point)) run = null;
    else if (run && !broken) run.push(point);
    else runs.push(run = [point]);
  }
  return runs;
}

/** One bucket of consecutive readings. */
function bucketOf(points, pick) {
  const first = points[0], last = points.at(-1), all = points.map(pick);
  const least = (values) => values.reduce((a, b) => Math.min(a, b)), most = (values) => values.reduce((a, b) => Math.max(a, b));
  const values = all.map(({ value }) => value);
  return {
    from: first.slow_time, to: last.slow_time, count: points.length, mean: values.reduce((a, b) => a + b, 0) / values.length,
    min: least(values), max: most(values), lo: least(all.map(({ lo }) => lo)), hi: most(all.map(({ hi }) => hi)),
  };
}

/** Stretches of readings → stretches of buckets of `size` readings each. */
export function bucketed(runs, pick, size) {
  return runs.map((run) => {
    const buckets = [];
    for (let i = 0; i < run.length; i += size) buckets.push(bucketOf(run.slice(i, i + size), pick));
    return buckets;
  });
}

/** The buckets of a history that the server has thinned, of those from `since` to `until`, in stretches; `of` gives the columns of what is drawn. */
export function served(bands, of, { renewed = new Set(), since = -Infinity, until = Infinity } = {}) {
  const columns = of(bands), runs = [];
  if (!columns) return runs;
  const { start: { slow_time: from }, end: { slow_time: to }, count } = bands, ends = [...renewed].sort((a, b) => a - b);
  let run = null, steps = 0, typical = 0;
  for (let i = 0; i < from.length && to[i] <= until; i += 1) {
    const value = columns.mean ? columns.mean[i] : columns.min[i];
    if (count[i] > 1) [steps, typical] = [steps + 1, (typical * steps + (to[i] - from[i]) / (count[i] - 1)) / (steps + 1)];
    const pause = i ? from[i] - to[i - 1] : 0, broken = pause < 0 || (typical > 0 && pause > GAP_STEPS * typical);
    const anew = i > 0 && ends.some((at) => at > to[i - 1] && at <= from[i]);
    if (value === null || value === undefined || from[i] < since) run = null;
    else {
      const { mean = columns.min, min, max, lo = min, hi = max } = columns;
      const bucket = { from: from[i], to: to[i], count: count[i], mean: mean[i], min: min[i], max: max[i], lo: lo[i], hi: hi[i] };
      if (run && !broken && !anew) run.push(bucket);
      else runs.push(run = [bucket]);
    }
  }
  return runs;
}

/** Neighbours of a stretch put together until no more than `most` are left of all. */
export function merged(runs, most) {
  const size = Math.ceil(runs.reduce((sum, run) => sum + run.length, 0) / most);
  if (size < 2) return runs;
  return runs.map((run) => {
    const fewer = [];
    for (let i = 0; i < run.length; i += size) fewer.push(run.slice(i, i + size).reduce(together));
    return fewer;
  });
}

function together(a, b) {
  const count = a.count + b.count;
  return {
    from: a.from, to: b.to, count, mean: (a.count * a.mean + b.count * b.mean) / count,
    min: Math.min(a.min, b.min), max: Math.max(a.max, b.max), lo: Math.min(a.lo, b.lo), hi: Math.max(a.hi, b.hi),
  };
}

/** Where a stretch of buckets is drawn: its beginning, the middle of each bucket, its end; with the bucket of each place. */
export function corners(run) {
  const first = run[0], last = run.at(-1);
  return [
    [first.from, first], ...run.map((bucket) => [(bucket.from + bucket.to) / 2, bucket]), [last.to, last],
  ];
}
