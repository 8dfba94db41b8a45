// Where a twin is heading, in words: when each threshold is reached, and how far the readings say anything.
import { isNear, stepOf } from "./buckets.js";
import { atTime, make, number, slowTime, titleOf } from "./words.js";

const NARROW = "\u202f", JUMPS_SAID = 2, LAWS_SAID = 3;
const percent = (x, places = 0) => `${number(100 * x, places)}${NARROW}%`;
const few = (x) => `${+(100 * x).toPrecision(3)}`.replace("-", "\u2212");

/** "Stiffness change below −30 %" */
function asked({ quantity, threshold, toward }) {
  return `${titleOf(quantity)} ${toward ?? "reaches"} ${few(threshold)}${NARROW}%`;
}

const SVG = "http://www.w3.org/2000/svg", WIDE = 120, HIGH = 28;

/** Distribution function over the time up to the horizon: a small plot, 0 below and 1 above. */
function curve({ cdf, median, horizon, sentence }) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDE} ${HIGH}`);
  svg.setAttribute("class", "cdf");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", sentence);
  if (!cdf?.slow_time.length) return svg;
  const from = cdf.slow_time[0], span = horizon - from || 1;
  const x = (time) => (WIDE * (time - from)) / span, y = (share) => 1 + (HIGH - 2) * (1 - share);
  const line = (points, name) => {
    const path = document.createElementNS(SVG, "polyline");
    path.setAttribute("points", points.map(([a, b]) => `${a.toFixed(1)},${b.toFixed(1)}`).join(" "));
    path.setAttribute("class", name);
    svg.append(path);
  };
  line([[0, y(0.5)], [WIDE, y(0.5)]], "half");
  if (median !== null) line([[x(median), y(0)], [x(median), y(1)]], "median");
  line(cdf.slow_time.map((time, i) => [x(time), y(cdf.probability[i])]), "probability");
  return svg;
}

/** "linear drift 62 %, Wiener 14 %" */
const lawsOf = (laws) => Object.entries(laws ?? {}).slice(0, LAWS_SAID).filter(([, share]) => share >= 0.05)
  .map(([name, share]) => `${name} ${percent(share)}`).join(", ");

function row(crossing, since, at) {
  const row = make("tr"), title = make("th", asked(crossing));
  title.scope = "row";
  row.dataset.of = crossing.quantity;
  row.dataset.threshold = crossing.threshold;
  row.dataset.source = crossing.source;
  const passed = crossing.already > 0.5;
  const cells = crossing.times.map(({ slow_time }) => {
    const said = slow_time === null ? "not within the horizon" : passed && slow_time <= since ? "passed" : at(slow_time);
    return make("td", said);
  });
  const plot = make("td"), laws = make("td", lawsOf(crossing.laws), "laws");
  plot.append(curve(crossing));
  row.append(title, ...cells, make("td", `${percent(crossing.within)} by ${at(crossing.horizon)}`), plot, laws);
  row.setAttribute("aria-label", crossing.sentence);
  return row;
}

/** The latest of sudden changes, and how many there were before. */
function saidOf(times, at) {
  const more = times.length > JUMPS_SAID ? ` (and ${times.length - JUMPS_SAID} before)` : "";
  return `sudden change after ${times.slice(-JUMPS_SAID).map(at).join(" and ")}${more}`;
}

export class Outlook {
  constructor() {
    this.root = make("div", undefined, "outlook");
    this.table = make("table", undefined, "crossings");
    this.note = make("p", "", "facts");
    const head = make("thead"), row = make("tr");
    for (const title of ["time to a threshold", `10${NARROW}%`, `50${NARROW}%`, `90${NARROW}%`, "within the horizon", "probability over time", "degradation laws"]) {
      const cell = make("th", title);
      cell.scope = "col";
      row.append(cell);
    }
    head.append(row);
    this.body = make("tbody");
    this.table.append(make("caption", "Forecast: when thresholds are reached"), head, this.body);
    this.trouble = make("p", "", "trouble");
    this.trouble.setAttribute("role", "status");
    this.root.append(this.table, this.note, this.trouble);
    this.root.hidden = true;
  }

  tell({ forecast, latest, unforeseen, renewed, points }) {
    this.root.hidden = !forecast && !unforeseen;
    if (this.trouble.textContent !== (unforeseen ?? "")) this.trouble.textContent = unforeseen ?? "";
    this.trouble.hidden = !unforeseen;
    this.table.hidden = !forecast?.crossings.length;
    this.note.hidden = !forecast;
    if (!forecast || this.told === forecast) return;
    this.told = forecast;
    const at = (slow_time) => slowTime(atTime(latest, slow_time));
    this.body.replaceChildren(...forecast.crossings.map((crossing) => row(crossing, forecast.since, at)));
    const period = Object.entries(forecast.periods).filter(([, length]) => length)
      .map(([name, length]) => `${titleOf(name)} repeats every ${+length.toPrecision(4)}`);
    const own = (times) => times.filter((time) => !isNear(time, renewed, stepOf(points)));
    const jumps = Object.entries(forecast.jumps).map(([name, times]) => [name, own(times)]).filter(([, times]) => times.length)
      .map(([name, times]) => `${titleOf(name)}: ${saidOf(times, at)}`);
    const warnings = forecast.warnings ?? [];
    const until = `Beyond ${at(forecast.until)} the forecast only extrapolates its trend.`;
    this.note.textContent = [`Forecast from ${at(forecast.since)}`, ...period, ...jumps, until, ...warnings].join(" \u00b7 ");
    this.root.dataset.since = forecast.since;
  }
}
