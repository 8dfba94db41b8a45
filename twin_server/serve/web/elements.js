// A twin of many elements: which of them has changed, said first, then listed and drawn.
import { marksOf, timeAxis } from "./axis.js";
import { HEIGHT_PX, MARGIN, WIDE_PX, instantOf, pictureOf, zoomOf } from "./charts.js";
import { t } from "./language.js";
import { membersSaid, probabilityOf } from "./members.js";
import { Modes } from "./modes.js";
import { drawPlot } from "./plot.js";
import { colour, faded } from "./svg.js";
import { bucketTraces, linesOf, placeOf, truthTraces } from "./traces.js";
import { atTime, interval95, make, number, range, slowTime, suspected, valued } from "./words.js";

const MOST_LINES = 8, NARROW = "\u202f";
const HARDLY_TOLD = 0.9;
const ROW_PX = 15, BELOW_PX = 42;
const TINTS = ["inseparable", "ahead", "estimate"], DASHES = ["solid", "dash", "dot"];

const percent = (x, places) => number(100 * x, places);
const placesOf = (sd) => sd > 0 ? Math.min(2, Math.max(0, 1 - Math.floor(Math.log10(100 * sd)))) : 1;

/** `["−7.6 %", "−9.0 to −6.1 %"]`: the change, and its 95 % interval. */
function changeOf({ value, sd, lo, hi }) {
  const many = placesOf(sd);
  return [`${percent(value, many)}${NARROW}%`, `${range(percent(lo, many), percent(hi, many))}${NARROW}%`];
}

const MASS = ".mass";
const isMass = (name) => name.endsWith(MASS);
const ownerOf = (name) => isMass(name) ? name.slice(0, -MASS.length) : name;

/** Names that a suspicion speaks of: one, or several with "or" and "and" between them. */
const namesIn = (word, elements) => word.split(/ or | and /).filter((name) => name in elements);

function sentence(word, elements) {
  const names = namesIn(word, elements);
  if (names.length !== 1) return t("elements.undecided", { elements: suspected(word) });
  const { value, sd } = elements[names[0]], places = Math.max(0, placesOf(sd) - 1);
  const size = `${number(Math.abs(100 * value), places)}${NARROW}% ± ${number(100 * sd, places)}${NARROW}%`;
  const key = `elements.${value < 0 ? "lost" : "gained"}.${isMass(names[0]) ? "mass" : "stiffness"}`;
  return t(key, { element: ownerOf(names[0]), size });
}

export class Elements {
  constructor(panel) {
    this.panel = panel;
    this.verdict = make("p", "", "verdict");
    this.verdict.setAttribute("role", "status");
    panel.shapes.root.before(this.verdict);
    this.now = this.figure("elements", t("elements.now"));
    this.past = this.figure("elements-history", t("elements.past"));
    panel.charts.append(this.now, this.past);
    this.table = make("table", undefined, "elements");
    this.modes = new Modes();
    this.tables = make("div", undefined, "tables");
    this.tables.append(this.table, this.modes.root);
    panel.charts.after(this.tables);
  }

  remove() {
    this.modes.close();
    for (const part of [this.verdict, this.now, this.past, this.tables]) part.remove();
  }

  figure(key, title) {
    const figure = make("figure"), caption = make("figcaption"), plot = make("div", undefined, "plot");
    const value = make("strong", "\u2013"), interval = make("span", "", "interval");
    caption.append(make("span", title, "title"), value, interval, pictureOf(plot, () => `${this.panel.twin.id} ${title}`));
    this[`${key}-caption`] = { value, interval };
    plot.dataset.quantity = key;
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", t("chart.loading", { title }));
    figure.append(caption, plot);
    this[key] = plot;
    return figure;
  }

  /** What is known in words. */
  tell(latest) {
    const { elements = {}, suspects = [] } = latest, names = Object.keys(elements);
    const said = suspects.map((word) => sentence(word, elements));
    const calm = names.length ? t("elements.none_changed") : "";
    const { assessment, registration } = latest, compared = registration?.assessment;
    const text = compared ? membersSaid(assessment, compared) : said.length ? `${said.join("; ")}.` : calm;
    if (this.verdict.textContent !== text) this.verdict.textContent = text;
    this.verdict.dataset.state = said.length || assessment?.verdict === "undecided" ? "waiting" : "good";
    this.list(latest);
    this.caption(elements, suspects);
  }

  /** How many have changed, and the one that has changed most surely. */
  caption(elements, suspects) {
    const now = this["elements-caption"], past = this["elements-history-caption"], [most] = ranked(elements);
    const accused = suspects.flatMap((word) => namesIn(word, elements)), shown = accused[0] ?? most;
    now.value.textContent = !most ? "\u2013" : suspects.length ? suspects.map(suspected).join(", ") : t("elements.none");
    now.interval.textContent = most ? t("elements.changed_of", { n: Object.keys(elements).length }) : t("twin.not_estimated");
    const [value, interval] = shown ? changeOf(elements[shown]) : ["\u2013", ""];
    past.value.textContent = value;
    past.interval.textContent = shown ? `${shown}, ${interval95(interval)}` : t("twin.not_estimated");
  }

  list({ elements = {}, suspects = [], posterior_to_prior: ratios = {}, assessment }) {
    const accused = new Set(suspects.flatMap((word) => namesIn(word, elements)));
    const head = make("tr"), body = make("tbody"), top = make("thead");
    for (const title of [t("elements.element"), t("elements.change"), t("number.interval_95"), ""]) {
      const cell = make("th", title);
      cell.scope = "col";
      head.append(cell);
    }
    for (const [name, estimate] of Object.entries(elements)) {
      const row = make("tr"), title = make("th", ownerOf(name)), [value, interval] = changeOf(estimate);
      title.scope = "row";
      if (isMass(name)) title.append(make("span", ` ${t("elements.mass")}`, "interval"));
      const told = ratios[name] < HARDLY_TOLD ? "" : t("elements.hardly_told");
      const probable = probabilityOf(assessment, name);
      row.append(title, make("td", value), make("td", interval), make("td", probable || (accused.has(name) ? t("elements.changed") : told)));
      row.dataset.changed = accused.has(name);
      body.append(row);
    }
    top.append(head);
    this.table.replaceChildren(make("caption", t("elements.caption")), top, body);
    this.table.hidden = !body.childElementCount;
  }

  async draw(twin, wide) {
    const latest = twin.latest, elements = latest?.elements ?? {};
    const known = twin.points.filter((point) => Object.keys(point.elements ?? {}).length);
    const accused = [...new Set((latest?.suspects ?? []).flatMap((word) => namesIn(word, elements)))];
    const base = (plot) => ({ width: plot.clientWidth, height: wide ? WIDE_PX : HEIGHT_PX });
    const note = {
      text: t("chart.note_empty"), xref: "paper", yref: "paper", x: 0.5, y: 0.85, font: { color: colour("faint") },
    };
    const [bars, below] = drawnNow(elements, accused, base(this.elements));
    drawPlot(this.elements, bars, Object.keys(elements).length ? below : { ...below, annotations: [note] });
    const [traces, layout, shown] = drawnPast(twin, known, elements, accused, base(this["elements-history"]), zoomOf(this["elements-history"], twin));
    drawPlot(this["elements-history"], traces, known.length ? layout : { ...layout, annotations: [note] });
    this.describe(elements, accused, known, shown);
    await this.modes.refresh(twin);
    const has = (end) => traces.some((trace) => trace.name.endsWith(end));
    this["elements-history"].dataset.forecast = has("forecast");
    const limits = (of) => of?.some(({ quantity }) => quantity === "elements" || quantity in elements) ?? false;
    return {
      truth: has("truth"), ahead: has("forecast"), later: has("what came after"), buckets: has("spread"), instant: Boolean(twin.at),
      limit: limits(latest?.registration?.alarms), threshold: limits(latest?.registration?.forecast?.thresholds), ...marksOf(twin).found,
    };
  }

  describe(elements, accused, known, shown) {
    const each = Object.entries(elements).map(([name, estimate]) => t("elements.valued", { element: name, ...spokenOf(estimate) }));
    this.elements.setAttribute("aria-label", t("elements.chart_now", { changes: each.join("; ") || t("elements.none_estimated") }));
    Object.assign(this.elements.dataset, { elements: each.length, suspects: accused.join(" ") });
    const [first, last] = [known[0], known.at(-1)];
    const span = first ? t("chart.from_to", { from: slowTime(first), to: slowTime(last) }) : t("chart.no_readings");
    this["elements-history"].setAttribute("aria-label", t("elements.chart_past", { elements: shown.join(", ") || t("elements.no_element"), span }));
    Object.assign(this["elements-history"].dataset, { points: known.length, shown: shown.join(" ") });
  }
}

const spokenOf = (estimate) => {
  const [value, interval] = changeOf(estimate);
  return { value, interval };
};

const surely = ({ value, sd }) => sd > 0 ? Math.abs(value) / sd : 0;

/** Names, the most surely changed one first. */
const ranked = (elements) => Object.keys(elements).sort((a, b) => surely(elements[b]) - surely(elements[a]));

/** One interval each, lowest element at the bottom as in the structure. */
function drawnNow(elements, accused, base) {
  const rows = Object.entries(elements), tint = (name) => colour(accused.includes(name) ? "inseparable" : "estimate");
  const trace = {
    name: "change", x: rows.map(([, e]) => 100 * e.value), y: rows.map(([name]) => name), mode: "markers",
    marker: {
      color: rows.map(([name]) => tint(name)), size: 9,
      symbol: rows.map(([name]) => accused.includes(name) ? "diamond" : "circle"),
    },
    hover: (i) => `${rows[i][0]}: ${valued(changeOf(rows[i][1]))}`,
  };
  const bars = rows.map(([name, e]) => ({
    type: "line", x0: 100 * e.lo, x1: 100 * e.hi, y0: name, y1: name, line: { color: tint(name), width: 3 },
  }));
  const reach = Math.max(1, ...rows.flatMap(([, e]) => [Math.abs(100 * e.lo), Math.abs(100 * e.hi)]));
  const layout = {
    ...base, height: Math.max(base.height, ROW_PX * rows.length + BELOW_PX), margin: { l: 8, r: 10, t: 8, b: BELOW_PX }, shapes: bars,
    xaxis: { zeroline: true, title: { text: t("axis.change") }, range: [-1.1 * reach, 1.1 * reach] },
    yaxis: { automargin: true, type: "category" },
  };
  return [[trace], layout];
}

/** A null between two stretches breaks a line. */
const joined = (runs, pick) => runs.flatMap((run, i) => [...(i ? [null] : []), ...run.map(pick)]);

/** The limits that were asked for, as in the charts of the whole structure. */
function limitsOf({ registration }) {
  const drawn = (value, line) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: 100 * value, y1: 100 * value, line });
  return [
    ...(registration?.alarms ?? []).filter(({ quantity }) => !/_(hz|ratio)$/.test(quantity))
      .map((alarm) => drawn(alarm.below ?? alarm.above, { color: colour("bad"), width: 1.4, dash: "dot" })),
    ...(registration?.forecast?.thresholds ?? []).map(({ at }) => drawn(at, { color: colour("ahead"), width: 1.2, dash: "dot" })),
  ];
}

/** What is expected of an element after the last reading; of an older forecast what is still to come. */
function ahead({ forecast }, last, name, tint) {
  const coming = (forecast?.points ?? []).filter((point) => point.elements?.[name] && point.slow_time >= last.slow_time);
  if (coming.length < 2) return [];
  const run = coming.map((point) => ({ ...atTime(last, point.slow_time), ...point })), around = [...run, ...run.slice().reverse()];
  const band = {
    name: `${name} forecast band`, x: around.map(placeOf), mode: "lines", fill: "toself", line: { width: 0 },
    y: around.map((point, i) => 100 * point.elements[name][i < run.length ? "lo" : "hi"]), fillcolor: faded(tint, 0.18),
  };
  const line = {
    name: `${name} forecast`, x: run.map(placeOf), y: run.map((point) => 100 * point.elements[name].value), mode: "lines",
    line: { color: tint, width: 1.6 }, hover: (i) => `${t("chart.forecast_of", { name })}: ${percent(run[i].elements[name].value, 2)} %`,
  };
  return [band, line];
}

/** What was read decides the axis, which a forecast may widen by half; what leaves it is cut off. */
function reachOf(known, shown, accused, forecast) {
  const sure = accused.length ? accused : shown.slice(0, 1);
  const values = known.flatMap((point) => shown.filter((name) => name in (point.elements ?? {})).flatMap((name) => {
    const { value, lo, hi } = point.elements[name], truth = point.truth?.[name];
    return [value, ...(sure.includes(name) ? [lo, hi] : []), ...(truth === undefined ? [] : [truth])];
  }));
  if (!values.length) return undefined;
  let [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  const room = 0.5 * (high - low), [least, most] = [low - room, high + room];
  for (const { elements = {} } of forecast?.points ?? []) {
    for (const name of sure.filter((each) => each in elements)) {
      low = Math.max(least, Math.min(low, elements[name].lo));
      high = Math.min(most, Math.max(high, elements[name].hi));
    }
  }
  const margin = Math.max(0.08 * (high - low), 0.005);
  return [100 * (low - margin), 100 * (high + margin)];
}

/** What came after the instant that is looked at. */
function afterwards({ later }, shown) {
  return later.length < 2 ? [] : shown.map((name) => ({
    name: `${name}, what came after`, x: later.map(placeOf), y: later.map((point) => point.elements?.[name] ? 100 * point.elements[name].value : null),
    mode: "lines", line: { color: faded(colour("invalid"), 0.6), width: 1 },
  }));
}

/** One element: few readings as a line with its band, many in buckets; the others' bands would hide one another. */
function lineOf(twin, points, name, { width, tint, dash, thick, banded }) {
  const pick = (point) => point.elements?.[name], until = twin.at?.slow_time ?? Infinity;
  const { fine, buckets } = linesOf(twin, points, pick, (bands) => bands.elements?.[name], width, { until });
  const last = points.at(-1), look = { place: (slow_time) => placeOf(atTime(last, slow_time)), scale: 100, tint, width: thick, dash };
  const many = bucketTraces(name, buckets, look, (x) => `${percent(x, 2)} %`);
  if (many.length) return banded ? many : many.slice(2);
  const around = fine.map((run) => [...run.map((point) => [point, "lo"]), ...run.toReversed().map((point) => [point, "hi"])]);
  const band = {
    name: `${name} band`, x: joined(around, ([point]) => placeOf(point)), y: joined(around, ([point, end]) => 100 * point.elements[name][end]),
    mode: "lines", fill: "toself", line: { width: 0 }, fillcolor: faded(tint, 0.22),
  };
  const read = joined(fine, (point) => point);
  const line = {
    name, x: joined(fine, placeOf), y: joined(fine, (point) => 100 * point.elements[name].value), mode: "lines",
    line: { color: tint, width: thick, dash }, hover: (i) => `${name}: ${percent(read[i].elements[name].value, 2)} %`,
  };
  return [...(banded ? [band] : []), line];
}

function drawnPast(twin, known, elements, accused, base, zoom) {
  const shown = [...accused, ...ranked(elements).filter((name) => !accused.includes(name))].slice(0, MOST_LINES);
  const traces = shown.slice().reverse().flatMap((name) => {
    const points = known.filter((point) => name in point.elements), place = accused.indexOf(name);
    const tint = colour(place < 0 ? "faint" : TINTS[place % TINTS.length]), dash = DASHES[Math.max(place, 0) % DASHES.length];
    const lines = lineOf(twin, known, name, { width: base.width, tint, dash, thick: place < 0 ? 1 : 2, banded: place >= 0 });
    const look = { place: (slow_time) => placeOf(atTime(known.at(-1), slow_time)), scale: 100 };
    const truth = known.length ? truthTraces(`${name} truth`, twin, name, base.width, look) : [];
    const coming = points.length ? ahead(twin, points.at(-1), name, place < 0 ? tint : colour("ahead")) : [];
    const expected = place < 0 ? coming.slice(1) : coming;
    return [...lines, ...truth, ...expected];
  });
  traces.unshift(...afterwards(twin, shown));
  const notes = shown.filter((name) => accused.includes(name)).map((name) => ({
    text: name, xanchor: "left", x: 0.02, xref: "paper", yanchor: "bottom", bgcolor: colour("card"),
    y: 100 * elements[name].value, font: { color: colour(TINTS[accused.indexOf(name) % TINTS.length]) },
  }));
  const marks = marksOf(twin);
  const layout = {
    ...base, margin: MARGIN, annotations: [...marks.notes, ...notes],
    shapes: [...marks.shapes, ...limitsOf(twin.latest ?? {}), ...instantOf(twin)],
    xaxis: timeAxis(twin, zoom.x, base.width), zoom,
    yaxis: { zeroline: true, nticks: 6, range: reachOf([...known, ...twin.later], shown, accused, twin.forecast), title: { text: t("axis.change") } },
  };
  return [traces, layout, shown];
}
