// Modes of a twin: frequencies, damping and shapes, each with its error, in a table. The shapes move.
import { t } from "./language.js";
import { ask } from "./link.js";
import { Motion } from "./motion.js";
import { draw } from "./svg.js";
import { interval95, make, number, slowTime, spoken } from "./words.js";

const WIDTH = 150, HEIGHT = 110, MARGIN = 9, QUANTILE = 1.96;
const ASK_MS = 1500;
const TITLES = [t("modes.mode"), t("modes.frequency"), t("modes.since_learnt"), t("modes.damping"), t("modes.shape")];

/** Nodes of the channels from the base upwards; a model without sensors for them keeps the edge's order. */
function placesOf(channels, model) {
  const at = new Map((model?.sensors ?? []).map((sensor) => [sensor.channel, sensor.node]));
  const order = (model?.nodes ?? []).map((node) => node.id);
  const known = channels.map((channel, i) => ({ channel, i, level: order.indexOf(at.get(channel)) }));
  return known.sort((a, b) => a.level - b.level || a.i - b.i);
}

const standsOn = (model) => (model?.elements ?? []).some((element) => element.between.includes("base"));

/** The shape and its band at rest, and a copy of it that moves. */
function shapeOf({ shape, frequency_hz: frequency }, channels, model) {
  const places = placesOf(channels, model), grounded = standsOn(model);
  const points = places.map(({ channel, i }) => (
    { channel, value: shape.re[i], turned: shape.im[i], half: QUANTILE * shape.sd[i] / Math.SQRT2 }
  ));
  const all = grounded ? [{ channel: "base", value: 0, turned: 0, half: 0 }, ...points] : points;
  const reach = Math.max(...all.map(({ value, turned, half }) => Math.hypot(value, turned) + half), 1e-9);
  const x = (value) => (WIDTH / 2 + value / reach * (WIDTH / 2 - MARGIN)).toFixed(1);
  const y = (i) => (HEIGHT - MARGIN - i * (HEIGHT - 2 * MARGIN) / Math.max(all.length - 1, 1)).toFixed(1);
  const line = (pick) => all.map((point, i) => `${x(pick(point))},${y(i)}`);
  const said = points.map(({ channel, value, half }) => `${channel} ${number(value, 2)} ± ${number(half, 2)}`);
  const label = t("modes.shape_at", { frequency: spoken(frequency, "frequency_hz")[0], values: said.join(", ") });
  const svg = draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: WIDTH, height: HEIGHT, role: "img", "aria-label": label });
  const around = [...line(({ value, half }) => value - half), ...line(({ value, half }) => value + half).reverse()];
  const moving = draw("polyline", { class: "moving", points: line(({ value }) => value).join(" ") });
  const nodes = all.map(({ value }, i) => draw("circle", { cx: x(value), cy: y(i), r: 3, class: "node" }));
  svg.append(
    draw("title", {}, label),
    draw("line", { x1: x(0), x2: x(0), y1: y(0), y2: y(all.length - 1), class: "rest" }),
    draw("polygon", { points: around.join(" "), class: "band" }),
    draw("polyline", { points: line(({ value }) => value).join(" "), class: "shape" }), moving, ...nodes,
  );
  const turn = (cycles) => {
    const [c, s] = [Math.cos(2 * Math.PI * cycles), Math.sin(2 * Math.PI * cycles)];
    moving.setAttribute("points", line(({ value, turned }) => value * c - turned * s).join(" "));
    nodes.forEach((node, i) => node.setAttribute("cx", x(all[i].value * c - all[i].turned * s)));
  };
  return { svg, moves: { frequency_hz: frequency.value, turn } };
}

export class Modes {
  constructor() {
    Object.assign(this, { askedAt: 0, shown: null, motion: new Motion() });
    this.root = make("div", undefined, "modal");
    this.root.hidden = true;
    this.table = make("table", undefined, "modes");
    const head = make("tr"), top = make("thead");
    for (const title of TITLES) {
      const cell = make("th", title);
      cell.scope = "col";
      head.append(cell);
    }
    top.append(head);
    [this.caption, this.body] = [make("caption", t("modes.caption")), make("tbody")];
    this.table.append(this.caption, top, this.body);
    this.root.append(this.table, this.motion.root);
  }

  /** Shapes are not part of the list of twins; they are asked for, of a twin that is looked at. */
  async refresh({ latest, base, at }) {
    const key = `${latest?.boot} ${latest?.sequence}`;
    if (!latest || latest.slow_time === null || key === this.shown || Date.now() - this.askedAt < ASK_MS) return;
    this.askedAt = Date.now();
    const found = await ask(`${base}/modes${at ? `?at=slow:${at.slow_time}` : ""}`).catch(() => null);
    if (!found) return;
    this.shown = key;
    this.caption.textContent = at ? t("modes.caption_at", { time: slowTime(found) }) : t("modes.caption_now");
    const nominal = new Map(found.nominal.map((mode) => [mode.model_mode, mode]));
    const rows = found.modes.map((mode) => this.row(mode, nominal.get(mode.model_mode), found, latest.registration.model));
    this.body.replaceChildren(...rows.map(({ row }) => row));
    this.motion.move(rows.map(({ moves }) => moves).filter(Boolean));
    this.root.hidden = !found.modes.length;
  }

  row(mode, learnt, { channels, nominal }, model) {
    const row = make("tr"), machine = mode.kind === "harmonic";
    // Before the nominal model is learnt, no mode has a number in it.
    const unmatched = t(nominal.length ? "modes.unmatched" : "modes.unassigned");
    const name = machine ? t("modes.machine") : mode.model_mode === null ? unmatched : `${mode.model_mode + 1}`;
    const title = make("th", name), drawing = make("td");
    title.scope = "row";
    const cell = (estimate, quantity) => {
      const place = make("td");
      if (!estimate) return place;
      const [value, interval] = spoken(estimate, quantity);
      place.append(value, make("span", interval95(interval), "interval"));
      return place;
    };
    const since = learnt ? 100 * (mode.frequency_hz.value / learnt.frequency_hz - 1) : null;
    const shape = mode.shape && !machine ? shapeOf(mode, channels, model) : null;
    if (shape) drawing.append(shape.svg);
    row.append(
      title, cell(mode.frequency_hz, "frequency_hz"), make("td", since === null ? "" : `${number(since, 2)}\u202f%`),
      cell(machine ? null : mode.damping_ratio, "damping_ratio"), drawing,
    );
    return { row, moves: shape?.moves };
  }

  close() { this.motion.close(); }
}
