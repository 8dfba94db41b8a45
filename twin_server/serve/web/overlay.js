// The charts of a diagnosis: model and measurement one over the other, and what is left between them.
import { language, locale, parts, t } from "./language.js";
import { ask } from "./link.js";
import { colour, faded } from "./svg.js";
import { english, explain, make } from "./words.js";

const HEIGHT_PX = 270, TIMES = "campaign time [s]", DRAWN_ALREADY = "The gap";
/** By what a line is: thick and pale what was measured, dashed the model as it was, solid with what was found. */
const LINES = [
  [/^(measured|read|as recovered)/, { tint: "invalid", width: 3 }],
  [/original|refitted|as it was/, { tint: "inseparable", width: 1.8, dash: "6px,3px" }],
  [/noise|band/, { tint: "ahead", width: 1.6, dash: "2px,3px" }],
  [/./, { tint: "estimate", width: 1.8 }],
];

function dressed(trace) {
  const { tint, width, dash } = LINES.find(([pattern]) => pattern.test(trace.name ?? ""))[1], shade = colour(tint);
  const own = { ...trace, marker: { ...trace.marker, color: shade }, line: { ...trace.line, color: shade, width, dash } };
  return trace.fillcolor || trace.fill ? { ...own, fillcolor: faded(shade, 0.25) } : own;
}

/** Spans of time in which the two part, behind the lines. */
const parting = (layout, when) => layout.xaxis?.title?.text === TIMES ? (when?.times_s ?? []).map(([x0, x1]) => (
  { type: "rect", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: faded(colour("inseparable"), 0.14) }
)) : [];

function themed(layout, when, width) {
  const grid = { gridcolor: colour("line"), zerolinecolor: colour("line"), automargin: true };
  const axes = Object.entries(layout).filter(([name]) => /^[xy]axis/.test(name)).map(([name, axis]) => [name, { ...axis, ...grid }]);
  return {
    ...layout, ...Object.fromEntries(axes), width, height: HEIGHT_PX, margin: { l: 64, r: 12, t: 34, b: 44 },
    shapes: parting(layout, when), legend: { orientation: "h", y: 1.16, x: 0 }, hovermode: "closest",
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: colour("ink"), size: 11.5, family: "system-ui, sans-serif" },
  };
}

/** Charts of a report are Plotly's own, which is large: it is loaded when the first of them is opened. */
let loaded = null;
function plotly() {
  loaded ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/assets/plotly.min.js";
    script.onload = () => resolve(localizedPlotly(window.Plotly));
    script.onerror = () => {
      loaded = null;
      reject(new Error(t("error.no_plotly")));
    };
    document.head.append(script);
  });
  return loaded;
}

/** Signs of numbers as the browser writes them: the charts have no dates. */
function localizedPlotly(Plotly) {
  if (language === "en") return Plotly;
  const sign = (type) => new Intl.NumberFormat(locale).formatToParts(12345.6).find((part) => part.type === type)?.value ?? "";
  Plotly.register({ moduleType: "locale", name: language, dictionary: {}, format: { decimal: sign("decimal"), thousands: sign("group") } });
  return Plotly;
}

export class Overlay {
  constructor(path, when) {
    Object.assign(this, { path, when, figures: [] });
    this.root = make("details", undefined, "overlay");
    this.room = make("div", undefined, "charts");
    this.root.append(make("summary", t("overlay.title")), this.room);
    this.root.addEventListener("toggle", () => { if (this.root.open) this.show(); });
    this.watcher = new ResizeObserver(() => this.draw().catch(() => {}));
    this.watcher.observe(this.room);
  }

  async show() {
    if (this.asked) return;
    this.asked = true;
    try {
      const { charts } = await ask(this.path);
      const shown = charts.filter(({ heading }) => heading !== DRAWN_ALREADY);
      this.figures = shown.map((chart) => this.figure(chart));
      this.room.replaceChildren(...this.figures.map(({ figure }) => figure));
      if (!shown.length) this.room.append(make("p", t("overlay.none"), "facts"));
      await this.draw();
    } catch (error) {
      this.asked = false;
      const told = make("p", undefined, "facts"), why = make("span");
      explain(why, error);
      told.append(...parts("overlay.trouble", { why }));
      this.room.replaceChildren(told);
    }
  }

  figure(chart) {
    const figure = english(make("figure")), caption = make("figcaption"), plot = make("div", undefined, "plot");
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", chart.words);
    plot.dataset.heading = chart.heading;
    caption.append(make("span", chart.heading, "title"), make("span", chart.words, "interval"));
    figure.append(caption, plot);
    return { figure, plot, chart };
  }

  async draw() {
    if (!this.figures.length || !this.root.open) return;
    const Plotly = await plotly();
    for (const { plot, chart } of this.figures) {
      await Plotly.react(plot, chart.data.map(dressed), themed(chart.layout, this.when, plot.clientWidth), { displayModeBar: false, locale: language });
    }
  }

  close() {
    this.watcher.disconnect();
    for (const { plot } of this.figures) window.Plotly?.purge(plot);
  }
}
