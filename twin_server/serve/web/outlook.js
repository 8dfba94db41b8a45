// Where a twin is heading, in words: when each threshold is reached, and how far the readings say anything.
import { isNear, stepOf } from "./buckets.js";
import { t } from "./language.js";
import { translated } from "./sentences.js";
import { TrackRecord } from "./track_record.js";
import { atTime, composed, describeRow, digits, foretold, make, number, slowTime, titleOf, unitOf } from "./words.js";

const NARROW = "\u202f", JUMPS_SAID = 2, LAWS_SAID = 3;
const percent = (x, places = 0) => `${number(100 * x, places)}${NARROW}%`;

/** "Stiffness change below −30 %" */
function asked({ quantity, threshold, toward }) {
  return t(`outlook.threshold.${toward ?? "reached"}`, { quantity: titleOf(quantity), limit: `${digits(100 * threshold, 3)}${NARROW}%` });
}

const SVG = "http://www.w3.org/2000/svg", WIDE = 120, HIGH = 28;

/** Distribution function over the time up to the horizon: a small plot, 0 below and 1 above. */
function curve({ cdf, median, horizon, sentence }) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDE} ${HIGH}`);
  svg.setAttribute("class", "cdf");
  svg.setAttribute("role", "img");
  const said = translated(sentence);
  svg.setAttribute("aria-label", said ?? sentence);
  if (said === null) svg.setAttribute("lang", "en");
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
  .map(([name, share]) => `${translated(name) ?? name} ${percent(share)}`).join(", ");

const likelyBy = (percentage) => t("outlook.likely_by", { probability: `${percentage}${NARROW}%` });
const HEADS = [t("outlook.time_to"), ...[10, 50, 90].map(likelyBy), t("outlook.within"), t("outlook.course"), t("outlook.laws"), t("outlook.track")];

/** "31 of 40 came true" */
const cameTrue = ({ record }) => (record ? t("outlook.came_true", { came: record.came_true, count: record.count }) : t("outlook.no_record"));

function row(crossing, since, at) {
  const row = make("tr"), title = make("th", asked(crossing));
  title.scope = "row";
  row.dataset.of = crossing.quantity;
  row.dataset.threshold = crossing.threshold;
  row.dataset.source = crossing.source;
  const passed = crossing.already > 0.5;
  const cells = crossing.times.map(({ slow_time }) => {
    const said = slow_time === null ? t("risk.not_within") : passed && slow_time <= since ? t("outlook.passed") : at(foretold(slow_time, since));
    return make("td", said);
  });
  const plot = make("td"), laws = make("td", lawsOf(crossing.laws), "laws"), record = make("td", cameTrue(crossing), "track");
  plot.append(curve(crossing));
  row.append(title, ...cells, make("td", t("outlook.within_by", { probability: percent(crossing.within), time: at(crossing.horizon) })), plot, laws, record);
  // On a telephone, where a row is a list, each cell carries its heading.
  [...row.children].forEach((cell, i) => { cell.dataset.title = HEADS[i]; });
  describeRow(row, crossing.sentence);
  return row;
}

/** The latest of sudden changes, and how many there were before. */
function saidOf(times, at) {
  const last = times.slice(-JUMPS_SAID).map(at).join(t("list.and")), before = times.length - JUMPS_SAID;
  return before > 0 ? t("outlook.jumps_and_before", { times: last, n: before }) : t("outlook.jumps", { times: last });
}

export class Outlook {
  constructor() {
    this.root = make("div", undefined, "outlook");
    this.table = make("table", undefined, "crossings");
    this.note = make("p", "", "facts");
    const head = make("thead"), row = make("tr");
    for (const title of HEADS) {
      const cell = make("th", title);
      cell.scope = "col";
      row.append(cell);
    }
    head.append(row);
    this.body = make("tbody");
    this.table.append(make("caption", t("outlook.caption")), head, this.body);
    this.trouble = make("p", "", "trouble");
    this.trouble.setAttribute("role", "status");
    this.record = new TrackRecord();
    this.root.append(this.table, this.note, this.record.root, this.trouble);
    this.root.hidden = true;
  }

  /** Why there is no newer forecast: words of the page, then of the server. */
  why({ words = "", why = "" }) {
    const text = [words, why].filter(Boolean).join(" ");
    if (this.trouble.textContent !== text) this.trouble.replaceChildren(words && why ? `${words} ` : words, composed("span", why));
  }

  tell({ forecast, latest, unforeseen, renewed, points, base, at: past }) {
    this.root.hidden = !forecast && !unforeseen;
    this.why(unforeseen ?? {});
    this.trouble.hidden = !unforeseen;
    this.table.hidden = !forecast?.crossings.length;
    this.note.hidden = !forecast;
    this.record.tell({ forecast, base, at: past });
    if (!forecast || this.told === forecast) return;
    this.told = forecast;
    const at = (slow_time) => slowTime(atTime(latest, slow_time));
    this.body.replaceChildren(...forecast.crossings.map((crossing) => row(crossing, forecast.since, at)));
    const period = Object.entries(forecast.periods).filter(([, length]) => length)
      .map(([name, length]) => t("outlook.repeats", { quantity: titleOf(name), period: `${digits(length, 4)}${NARROW}${unitOf(latest)}` }));
    const own = (times) => times.filter((time) => !isNear(time, renewed, stepOf(points)));
    const jumps = Object.entries(forecast.jumps).map(([name, times]) => [name, own(times)]).filter(([, times]) => times.length)
      .map(([name, times]) => `${titleOf(name)}: ${saidOf(times, at)}`);
    const warnings = forecast.warnings ?? [];
    const until = t("outlook.beyond", { time: at(forecast.until) });
    const said = [t("outlook.since", { time: at(forecast.since) }), ...period, ...jumps, until, ...warnings.map((each) => composed("span", each))];
    this.note.replaceChildren(...said.flatMap((part, i) => i ? [" \u00b7 ", part] : [part]));
    this.root.dataset.since = forecast.since;
  }
}
