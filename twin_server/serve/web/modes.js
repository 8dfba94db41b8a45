// Modes of a twin: frequencies, damping and shapes, each with its error, in a table.
import { ask, make, number, spoken } from "./words.js";

const SVG = "http://www.w3.org/2000/svg", WIDTH = 120, HEIGHT = 84, MARGIN = 8, QUANTILE = 1.96;
const ASK_MS = 1500;
const TITLES = ["mode", "frequency", "since learnt", "damping ratio", "shape"];

function draw(tag, attributes, text) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text) element.textContent = text;
  return element;
}

/** Nodes of the channels from the base upwards; a model without sensors for them keeps the edge's order. */
function placesOf(channels, model) {
  const at = new Map((model?.sensors ?? []).map((sensor) => [sensor.channel, sensor.node]));
  const order = (model?.nodes ?? []).map((node) => node.id);
  const known = channels.map((channel, i) => ({ channel, i, level: order.indexOf(at.get(channel)) }));
  return known.sort((a, b) => a.level - b.level || a.i - b.i);
}

const standsOn = (model) => (model?.elements ?? []).some((element) => element.between.includes("base"));

function shapeOf({ shape, frequency_hz: frequency }, channels, model) {
  const places = placesOf(channels, model), grounded = standsOn(model);
  const points = places.map(({ channel, i }) => ({ channel, value: shape.re[i], half: QUANTILE * shape.sd[i] / Math.SQRT2 }));
  const all = grounded ? [{ channel: "base", value: 0, half: 0 }, ...points] : points;
  const reach = Math.max(...all.map(({ value, half }) => Math.abs(value) + half), 1e-9);
  const x = (value) => (WIDTH / 2 + value / reach * (WIDTH / 2 - MARGIN)).toFixed(1);
  const y = (i) => (HEIGHT - MARGIN - i * (HEIGHT - 2 * MARGIN) / Math.max(all.length - 1, 1)).toFixed(1);
  const line = (pick) => all.map((point, i) => `${x(pick(point))},${y(i)}`);
  const said = points.map(({ channel, value, half }) => `${channel} ${number(value, 2)} ± ${number(half, 2)}`);
  const label = `Shape at ${spoken(frequency, "frequency_hz")[0]}: ${said.join(", ")}`;
  const svg = draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: WIDTH, height: HEIGHT, role: "img", "aria-label": label });
  const around = [...line(({ value, half }) => value - half), ...line(({ value, half }) => value + half).reverse()];
  svg.append(
    draw("title", {}, label),
    draw("line", { x1: x(0), x2: x(0), y1: y(0), y2: y(all.length - 1), class: "rest" }),
    draw("polygon", { points: around.join(" "), class: "band" }),
    draw("polyline", { points: line(({ value }) => value).join(" "), class: "shape" }),
    ...all.map(({ value }, i) => draw("circle", { cx: x(value), cy: y(i), r: 2.4, class: "node" })),
  );
  return svg;
}

export class Modes {
  constructor(twin) {
    Object.assign(this, { twin, askedAt: 0, shown: null });
    this.root = make("table", undefined, "modes");
    this.root.hidden = true;
    const head = make("tr"), top = make("thead");
    for (const title of TITLES) {
      const cell = make("th", title);
      cell.scope = "col";
      head.append(cell);
    }
    top.append(head);
    this.body = make("tbody");
    this.root.append(make("caption", "Modes of the latest epoch"), top, this.body);
  }

  tell({ registration }) { this.model = registration.model; }

  /** Shapes are not part of the list of twins; they are asked for, of a twin that is looked at. */
  async refresh() {
    const { latest, base } = this.twin, key = `${latest?.boot} ${latest?.sequence}`;
    if (!latest || latest.slow_time === null || key === this.shown || Date.now() - this.askedAt < ASK_MS) return;
    this.askedAt = Date.now();
    const found = await ask(`${base}/modes`).catch(() => null);
    if (!found) return;
    this.shown = key;
    const nominal = new Map(found.nominal.map((mode) => [mode.model_mode, mode]));
    this.body.replaceChildren(...found.modes.map((mode) => this.row(mode, nominal.get(mode.model_mode), found.channels)));
    this.root.hidden = !found.modes.length;
  }

  row(mode, learnt, channels) {
    const row = make("tr"), machine = mode.kind === "harmonic";
    const name = machine ? "machine" : mode.model_mode === null ? "not the model’s" : `${mode.model_mode + 1}`;
    const title = make("th", name), drawing = make("td");
    title.scope = "row";
    const cell = (estimate, quantity) => {
      const place = make("td");
      if (!estimate) return place;
      const [value, interval] = spoken(estimate, quantity);
      place.append(value, make("span", `95\u202f%: ${interval}`, "interval"));
      return place;
    };
    const since = learnt ? 100 * (mode.frequency_hz.value / learnt.frequency_hz - 1) : null;
    if (mode.shape && !machine) drawing.append(shapeOf(mode, channels, this.model));
    row.append(
      title, cell(mode.frequency_hz, "frequency_hz"), make("td", since === null ? "" : `${number(since, 2)}\u202f%`),
      cell(machine ? null : mode.damping_ratio, "damping_ratio"), drawing,
    );
    return row;
  }
}
