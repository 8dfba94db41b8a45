// What came of past outlooks: sentences, and how often statements came true over how probable they were called.
import { t } from "./language.js";
import { ask } from "./link.js";
import { drawPlot } from "./plot.js";
import { colour } from "./svg.js";
import { composed, make, number } from "./words.js";

const HEIGHT_PX = 220, WIDTH_PX = 300, NARROW = "\u202f";
const percent = (x) => `${number(100 * x, 0)}${NARROW}%`;

/** Points of the diagram: `stated`, `seen` and its interval, and what is said of each. */
function pointsOf({ thresholds, quantities }) {
  const classes = thresholds.classes.map(({ stated, count, came_true, lo, hi }) => ({
    kind: "threshold", stated, seen: came_true / count, lo, hi, said: t("track.of_thresholds", { stated: percent(stated), count, came: came_true }),
  }));
  const bands = Object.values(quantities).flatMap(({ coverage }) => coverage.filter(({ count }) => count)).map(({ stated, count, held, lo, hi }) => ({
    kind: "band", stated, seen: held / count, lo, hi, said: t("track.of_bands", { stated: percent(stated), count, held }),
  }));
  return [...classes, ...bands];
}

function traceOf(points, name, tint, symbol) {
  return {
    name, x: points.map(({ stated }) => 100 * stated), y: points.map(({ seen }) => 100 * seen), mode: "markers", marker: { color: tint, size: 8, symbol },
    error_y: { color: tint, thickness: 1, array: points.map(({ seen, hi }) => 100 * (hi - seen)), arrayminus: points.map(({ seen, lo }) => 100 * (seen - lo)) },
    hover: (i) => points[i].said,
  };
}

export class TrackRecord {
  constructor() {
    this.root = make("div", undefined, "track");
    this.note = make("p", "", "facts");
    this.plot = make("div", undefined, "plot");
    this.plot.setAttribute("role", "img");
    this.root.append(this.note, this.plot);
    this.root.hidden = true;
  }

  /** Ask anew where the forecast says something else of the past. */
  async tell({ forecast, base, at }) {
    const said = forecast?.record ?? [], key = said.join(" ");
    this.root.hidden = Boolean(at) || !said.length;
    if (this.root.hidden || key === this.key) return;
    this.key = key;
    this.note.replaceChildren(composed("span", key));
    const record = await ask(`${base}/forecast/record`).catch(() => null);
    if (!record) this.key = null;
    else this.draw(pointsOf(record));
  }

  draw(points) {
    const of = (kind) => points.filter((point) => point.kind === kind);
    this.plot.hidden = !points.length;
    this.plot.dataset.points = points.length;
    this.plot.setAttribute("aria-label", [t("track.chart"), ...points.map(({ said }) => said)].join(" "));
    const all = [0, 100], faint = colour("faint");
    drawPlot(this.plot, [
      { name: t("track.ideal"), x: all, y: all, mode: "lines", line: { color: faint, width: 1, dash: "dot" } },
      traceOf(of("band"), t("track.bands"), colour("estimate"), "circle-open"),
      traceOf(of("threshold"), t("track.thresholds"), colour("ahead"), "diamond"),
    ], {
      width: WIDTH_PX, height: HEIGHT_PX, margin: { l: 52, r: 10, t: 8, b: 44 }, showlegend: true,
      xaxis: { range: all, title: { text: t("track.stated") } }, yaxis: { range: all, title: { text: t("track.seen") } },
    });
  }
}
