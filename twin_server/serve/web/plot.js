// A chart: lines, bands and marks on two axes as SVG. Dragging zooms, with Shift it moves, a double click shows all again.
import { t } from "./language.js";
import { scaleOf, valueText } from "./scale.js";
import { colour, draw } from "./svg.js";
import { make } from "./words.js";

const DASHES = { dot: "2 3", dash: "7 4", longdash: "11 4", dashdot: "7 3 2 3" };
const FONT = "system-ui, sans-serif", FONT_PX = 11.5, LINE_PX = 14, TICK_PX = 4, SAMPLE_PX = 22;
const PX_A_TICK = { x: 85, y: 34 };
/** [px] How near the pointer has to be to what it is told of. Source: about the width of a fingertip. */
const REACH_PX = 30;
/** [px] A drag shorter than this in one direction zooms the other alone. Source: a hand that means a straight line strays less. */
const STRAY_PX = 12;
const ROOM = { x: 0, y: 0.06 };

// A finger on a chart scrolls the page; it does not zoom.
const touched = matchMedia("(pointer: coarse)");

const ruler = document.createElement("canvas").getContext("2d");
const widthOf = (text) => { ruler.font = `${FONT_PX}px ${FONT}`; return ruler.measureText(text).width; };
const linesIn = (text) => `${text}`.split(/<br>|\n/);
const widest = (texts) => Math.max(0, ...texts.flatMap(linesIn).map(widthOf));

const SYMBOLS = {
  circle: (r) => `M${-r},0a${r},${r} 0 1,0 ${2 * r},0a${r},${r} 0 1,0 ${-2 * r},0Z`,
  diamond: (r) => `M0,${-1.3 * r}L${1.3 * r},0L0,${1.3 * r}L${-1.3 * r},0Z`,
  "triangle-up": (r) => `M0,${-r}L${r},${0.8 * r}L${-r},${0.8 * r}Z`,
  "triangle-down": (r) => `M0,${r}L${r},${-0.8 * r}L${-r},${-0.8 * r}Z`,
  "triangle-right": (r) => `M${r},0L${-0.8 * r},${r}L${-0.8 * r},${-r}Z`,
  "x-thin": (r) => `M${-r},${-r}L${r},${r}M${r},${-r}L${-r},${r}`,
  "line-ns": (r) => `M0,${-1.4 * r}L0,${1.4 * r}`,
};

/** Text of several lines, the first at `y`. */
function words(text, { x, y, anchor = "middle", fill, size = FONT_PX, name }) {
  const element = draw("text", { x, y, "text-anchor": anchor, fill, "font-size": size, ...(name ? { class: name } : {}) });
  linesIn(text).forEach((line, i) => element.append(draw("tspan", { x, ...(i ? { dy: LINE_PX } : {}) }, line)));
  return element;
}

const stroke = ({ color, width = 1.5, dash } = {}) => ({
  stroke: color, "stroke-width": width, ...(dash && dash !== "solid" ? { "stroke-dasharray": DASHES[dash] ?? dash.replaceAll("px", "") } : {}),
});

/** Points in runs, which a null ends. */
function runsOf({ x, y }, at) {
  const runs = [[]];
  for (let i = 0; i < x.length; i += 1) {
    if (x[i] === null || y[i] === null || x[i] === undefined || y[i] === undefined) runs.push([]);
    else runs.at(-1).push([at.x(x[i]), at.y(y[i])]);
  }
  return runs.filter((run) => run.length);
}
const pathOf = (run) => `M${run.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join("L")}`;

function marksOf(trace, at, into) {
  const { marker, error_y: error } = trace, each = (value, i) => Array.isArray(value) ? value[i] : value;
  trace.x.forEach((x, i) => {
    const tint = each(marker.color, i), symbol = each(marker.symbol, i) ?? "circle", r = each(marker.size, i) / 2;
    const [px, py] = [at.x(x), at.y(trace.y[i])];
    if (error) {
      const [high, low] = [at.y(trace.y[i] + error.array[i]), at.y(trace.y[i] - error.arrayminus[i])];
      into.append(draw("path", { d: `M${px},${high}L${px},${low}`, ...stroke({ color: error.color, width: error.thickness }) }));
    }
    const isOpen = symbol.endsWith("-open");
    into.append(draw("path", {
      d: SYMBOLS[symbol.replace(/-open$/, "")](r), transform: `translate(${px.toFixed(1)},${py.toFixed(1)})`, class: "mark",
      fill: isOpen ? "none" : tint, ...(isOpen ? stroke({ color: tint, width: marker.line?.width ?? 1.4 }) : {}),
    }));
  });
}

/** A trace: its band, its line, its marks. */
function traceOf(trace, before, at, into, over) {
  const runs = runsOf(trace, at), { line = {}, mode = "lines" } = trace;
  if (trace.fill === "toself") for (const run of runs) into.append(draw("path", { d: `${pathOf(run)}Z`, fill: trace.fillcolor }));
  if (trace.fill === "tonexty") into.append(draw("path", { d: `${pathOf([...runs.flat(), ...runsOf(before, at).flat().reverse()])}Z`, fill: trace.fillcolor }));
  if (mode.includes("lines") && line.width !== 0) {
    into.append(draw("path", { d: runs.map(pathOf).join(""), fill: "none", "stroke-linejoin": "round", ...stroke(line) }));
  }
  if (mode.includes("markers")) marksOf(trace, at, trace.cliponaxis === false ? over : into);
}

/** Where the plotting area is: what axes and legend leave of the picture. */
function areaOf(layout, rows, labels) {
  const { margin, width, height, yaxis = {} } = layout;
  const left = yaxis.automargin ? Math.max(margin.l, widest(labels) + TICK_PX + 6 + (yaxis.title ? LINE_PX + 6 : 0)) : margin.l;
  return { left, right: Math.max(left + 20, width - margin.r), top: margin.t + rows, bottom: Math.max(margin.t + rows + 20, height - margin.b) };
}

/** Names of lines above the plotting area, in rows. */
function legendOf(traces, { width, margin }) {
  const named = traces.filter(({ name, showlegend }) => name && showlegend !== false), group = draw("g", { class: "names" });
  let [x, y, tall] = [margin.l, margin.t + LINE_PX, LINE_PX];
  for (const { name, line } of named) {
    const wide = SAMPLE_PX + 6 + widest([name]) + 14;
    if (x > margin.l && x + wide > width) [x, y, tall] = [margin.l, y + tall, LINE_PX];
    group.append(draw("path", { d: `M${x},${y - 4}h${SAMPLE_PX}`, fill: "none", ...stroke(line) }), words(name, { x: x + SAMPLE_PX + 6, y, anchor: "start", fill: colour("ink") }));
    tall = Math.max(tall, LINE_PX * linesIn(name).length);
    x += wide;
  }
  return { group, rows: named.length ? y + tall - margin.t - LINE_PX / 2 : 0 };
}

function axesOf(layout, scales, area, into) {
  const { xaxis = {}, yaxis = {} } = layout, ink = colour("ink"), { left, right, top, bottom } = area, grid = colour("line");
  for (const { px, text } of scales.x.ticks.filter(({ px: at }) => at >= left - 0.5 && at <= right + 0.5)) {
    into.append(draw("path", { d: `M${px},${top}V${bottom + TICK_PX}`, ...stroke({ color: grid, width: 1 }) }));
    into.append(words(text, { x: px, y: bottom + TICK_PX + LINE_PX - 2, fill: ink, name: "x-tick" }));
  }
  for (const { px, text } of scales.y.ticks.filter(({ px: at }) => at >= top - 0.5 && at <= bottom + 0.5)) {
    into.append(draw("path", { d: `M${left - TICK_PX},${px}H${right}`, ...stroke({ color: grid, width: 1 }) }));
    into.append(words(text, { x: left - TICK_PX - 3, y: px + 4, anchor: "end", fill: ink, name: "y-tick" }));
  }
  const zero = colour("faint");
  if (xaxis.zeroline && scales.x.zero !== null) into.append(draw("path", { d: `M${scales.x.zero},${top}V${bottom}`, ...stroke({ color: zero, width: 1 }) }));
  if (yaxis.zeroline && scales.y.zero !== null) into.append(draw("path", { d: `M${left},${scales.y.zero}H${right}`, ...stroke({ color: zero, width: 1 }) }));
  into.append(draw("path", { d: `M${left},${top}V${bottom}H${right}`, fill: "none", ...stroke({ color: grid, width: 1 }) }));
  if (xaxis.title) into.append(words(xaxis.title.text, { x: (left + right) / 2, y: layout.height - 5, fill: ink, name: "x-title" }));
  if (yaxis.title) {
    const title = words(yaxis.title.text, { x: 0, y: 0, fill: ink, name: "y-title" });
    title.setAttribute("transform", `translate(${FONT_PX},${(top + bottom) / 2}) rotate(-90)`);
    into.append(title);
  }
}

/** Where a shape or a note stands: on the scale, or as a share of the plotting area. */
const placesOf = (of, at, { left, right, top, bottom }) => ({
  x: of.xref === "paper" ? (x) => left + x * (right - left) : at.x, y: of.yref === "paper" ? (y) => bottom - y * (bottom - top) : at.y,
});

function shapeOf(shape, at, area) {
  const { x, y } = placesOf(shape, at, area);
  return draw("path", { d: `M${x(shape.x0)},${y(shape.y0)}L${x(shape.x1)},${y(shape.y1)}`, ...stroke(shape.line), ...(shape.name ? { class: shape.name } : {}) });
}

const ANCHORS = { left: "start", right: "end" };

function noteOf(note, at, area) {
  const { x, y } = placesOf(note, at, area), size = note.font?.size ?? FONT_PX, many = linesIn(note.text).length;
  const place = x(note.x) + (note.xshift ?? 0), wide = widest([note.text]) * size / FONT_PX;
  const top = y(note.y) - (note.yanchor === "top" ? 0 : note.yanchor === "bottom" ? LINE_PX * many : LINE_PX * many / 2);
  const group = draw("g", { class: "note" }), anchor = ANCHORS[note.xanchor] ?? "middle";
  const left = anchor === "start" ? place : anchor === "end" ? place - wide : place - wide / 2;
  if (note.bgcolor) group.append(draw("rect", { x: left - 1, y: top, width: wide + 2, height: LINE_PX * many, fill: note.bgcolor }));
  group.append(words(note.text, { x: place, y: top + LINE_PX - 3, anchor, fill: note.font?.color ?? colour("ink"), size }));
  return group;
}

let drawn = 0;

/**
 * Draw traces in place of what was drawn.
 *
 * `traces` have `x`, `y` (null breaks a line), `name`, `mode`, `line`, `marker`, `error_y`, `fill` (`toself`, `tonexty`) and
 * `hover`, what is said of the i-th point. `layout` has `width`, `height`, `margin`, `xaxis`, `yaxis`, `shapes`,
 * `annotations`, `showlegend`, `across` (all lines are told at one place) and `zoom`: `{ x, y, to }` with the ranges in which
 * somebody zoomed and what hears of others; without it the chart keeps them itself.
 */
export function drawPlot(plot, traces, layout) {
  const zoom = layout.zoom ?? (plot.kept ??= { x: null, y: null, to(ranges) { Object.assign(plot.kept, ranges); drawPlot(plot, plot.data, plot.asked); } });
  const xaxis = { ...layout.xaxis, range: zoom.x ?? layout.xaxis?.range }, yaxis = { ...layout.yaxis, range: zoom.y ?? layout.yaxis?.range };
  const own = (axis, key, shapes = []) => [...traces.flatMap((trace) => [...trace[key]]), ...shapes].filter((value) => value !== null && value !== undefined);
  const spread = traces.filter(({ error_y: error }) => error).flatMap(({ y, error_y: { array, arrayminus } }) => y.flatMap((value, i) => [value + array[i], value - arrayminus[i]]));
  const values = { x: own(xaxis, "x"), y: own(yaxis, "y", spread) };
  const legend = layout.showlegend ? legendOf(traces, layout) : { group: null, rows: 0 };
  const many = (axis, span) => Math.max(2, Math.floor(span / PX_A_TICK[axis]));
  const rough = layout.height - layout.margin.t - layout.margin.b - legend.rows;
  const labels = scaleOf(yaxis, values.y, [1, 0], { room: ROOM.y, many: many("y", rough) }).ticks.map(({ text }) => text);
  const area = areaOf(layout, legend.rows, labels), { left, right, top, bottom } = area;
  const scales = {
    x: scaleOf(xaxis, values.x, [left, right], { room: ROOM.x, many: many("x", right - left) }),
    y: scaleOf(yaxis, values.y, [bottom, top], { room: ROOM.y, many: many("y", bottom - top) }),
  };
  const at = { x: scales.x.at, y: scales.y.at }, id = `clip-${drawn += 1}`;
  const { width, height, shapes = [], annotations = [] } = layout;
  const svg = draw("svg", { width, height, viewBox: `0 0 ${width} ${height}`, class: "drawing", "font-family": FONT, "aria-hidden": true, "font-size": FONT_PX });
  const clip = draw("clipPath", { id }), inside = draw("g", { "clip-path": `url(#${id})` }), over = draw("g", {});
  clip.append(draw("rect", { x: left, y: top, width: right - left, height: bottom - top }));
  svg.append(clip);
  axesOf({ ...layout, xaxis, yaxis }, scales, area, svg);
  for (const shape of shapes.filter(({ layer }) => layer === "below")) inside.append(shapeOf(shape, at, area));
  traces.forEach((trace, i) => traceOf(trace, traces[i - 1], at, inside, over));
  for (const shape of shapes.filter(({ layer }) => layer !== "below")) inside.append(shapeOf(shape, at, area));
  const cursor = draw("path", { class: "cursor", ...stroke({ color: colour("faint"), width: 1 }), visibility: "hidden" });
  const box = draw("rect", { class: "zoom", fill: colour("estimate"), "fill-opacity": 0.12, visibility: "hidden" });
  const hand = draw("rect", { class: "area", x: left, y: top, width: right - left, height: bottom - top, fill: "transparent" });
  svg.append(inside, over, ...annotations.map((note) => noteOf(note, at, area)), ...(legend.group ? [legend.group] : []), cursor, box, hand);
  const tip = plot.querySelector(":scope > .tip") ?? make("div", undefined, "tip");
  tip.hidden = true;
  plot.replaceChildren(svg, tip);
  const told = { ...layout, xaxis: { ...xaxis, range: scales.x.range }, yaxis: { ...yaxis, range: scales.y.range } };
  Object.assign(plot, { data: traces, layout: told, asked: layout, scene: { scales, area, zoom, cursor, box, tip } });
  listen(plot);
}

/** The point of a trace that is nearest to the pointer. */
function nearest({ x, y }, at, [px, py]) {
  let [best, least] = [-1, Infinity];
  for (let i = 0; i < x.length; i += 1) {
    if (x[i] === null || y[i] === null || y[i] === undefined) continue;
    const away = Math.hypot(at.x(x[i]) - px, py === null ? 0 : at.y(y[i]) - py);
    if (away < least) [best, least] = [i, away];
  }
  return [best, least];
}

/** What is said beside the pointer: of the nearest point, or of all lines where they are read across. */
function saidAt(plot, px, py) {
  const { scales: { x, y } } = plot.scene, at = { x: x.at, y: y.at }, hovered = plot.data.filter(({ hover }) => hover);
  if (plot.asked.across) {
    const found = hovered.map((trace) => [trace, nearest(trace, at, [px, null])[0]]).filter(([, i]) => i >= 0);
    return found.length ? [valueText(found[0][0].x[found[0][1]]), ...found.map(([trace, i]) => trace.hover(i))] : [];
  }
  const [best] = hovered.map((trace) => [trace, ...nearest(trace, at, [px, py])]).sort((a, b) => a[2] - b[2]);
  return best && best[2] <= REACH_PX ? [best[0].hover(best[1])] : [];
}

/** One line across all charts beside this one, so that they can be read together. */
function point(plot, value) {
  for (const other of plot.closest(".charts")?.querySelectorAll(".plot") ?? [plot]) {
    if (!other.scene || (other !== plot && other.asked.xaxis?.type !== plot.asked.xaxis?.type)) continue;
    const { cursor, scales, area: { left, right, top, bottom } } = other.scene, px = value === null ? -1 : scales.x.at(value);
    const shown = px >= left && px <= right && other.asked.xaxis?.title?.text === plot.asked.xaxis?.title?.text;
    cursor.setAttribute("visibility", shown ? "visible" : "hidden");
    if (shown) cursor.setAttribute("d", `M${px},${top}V${bottom}`);
  }
}

function showTip(plot, lines, px, py) {
  const { tip } = plot.scene;
  tip.hidden = !lines.length;
  if (!lines.length) return;
  tip.replaceChildren(...lines.map((line) => make("div", line)));
  tip.style.left = `${Math.max(0, Math.min(px + 12, plot.clientWidth - tip.offsetWidth))}px`;
  tip.style.top = `${Math.max(0, py > plot.clientHeight / 2 ? py - tip.offsetHeight - 12 : py + 14)}px`;
}

/** Hear the pointer, once for each chart. */
function listen(plot) {
  if (plot.heard) return;
  plot.heard = true;
  let held = null;
  const placeOf = (event) => {
    const { left, top } = plot.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  };
  const within = ([px, py], { left, right, top, bottom }) => px >= left && px <= right && py >= top && py <= bottom;
  const cornersOf = (to) => {
    const { area } = plot.scene, straight = [0, 1].map((i) => Math.abs(to[i] - held.from[i]) < STRAY_PX);
    const span = (i, low, high) => straight[i] ? [low, high] : [held.from[i], to[i]].map((px) => Math.min(high, Math.max(low, px))).sort((a, b) => a - b);
    return { straight, x: span(0, area.left, area.right), y: span(1, area.top, area.bottom) };
  };
  plot.addEventListener("pointerdown", (event) => {
    if (touched.matches || event.pointerType === "touch" || event.button || !plot.scene || !within(placeOf(event), plot.scene.area)) return;
    held = { from: placeOf(event), moves: event.shiftKey };
    plot.setPointerCapture(event.pointerId);
  });
  plot.addEventListener("pointermove", (event) => {
    if (!plot.scene) return;
    const to = placeOf(event), { scales, box, area, zoom } = plot.scene;
    if (held?.moves) {
      const by = held.from[0] - to[0];
      held.from = to;
      zoom.to({ x: [area.left + by, area.right + by].map(scales.x.valueAt) });
    } else if (held) {
      const { straight, x, y } = cornersOf(to);
      box.setAttribute("visibility", straight[0] && straight[1] ? "hidden" : "visible");
      for (const [name, value] of [["x", x[0]], ["y", y[0]], ["width", x[1] - x[0]], ["height", y[1] - y[0]]]) box.setAttribute(name, value);
    } else {
      const near = within(to, area);
      point(plot, near ? scales.x.valueAt(to[0]) : null);
      showTip(plot, near ? saidAt(plot, ...to) : [], ...to);
    }
  });
  plot.addEventListener("pointerup", (event) => {
    if (!held || held.moves) { held = null; return; }
    const { straight, x, y } = cornersOf(placeOf(event)), { scales, box, zoom } = plot.scene;
    held = null;
    box.setAttribute("visibility", "hidden");
    if (straight[0] && straight[1]) return;
    zoom.to({ ...(straight[0] ? {} : { x: x.map(scales.x.valueAt) }), ...(straight[1] ? {} : { y: y.map(scales.y.valueAt).reverse() }) });
  });
  plot.addEventListener("pointercancel", () => { held = null; });
  plot.addEventListener("pointerleave", () => { if (plot.scene && !held) { point(plot, null); showTip(plot, [], 0, 0); } });
  plot.addEventListener("dblclick", () => plot.scene?.zoom.to({ x: null, y: null }));
}

/** Save what a chart shows as a picture, on the ground of its card. */
export async function savePicture(plot, name) {
  const source = plot.querySelector(".drawing").cloneNode(true), { width, height } = plot.layout, scale = 2;
  source.prepend(draw("rect", { width, height, fill: colour("card") }));
  const address = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(source)], { type: "image/svg+xml" }));
  const picture = new Image();
  await new Promise((loaded, failed) => Object.assign(picture, { onload: loaded, onerror: () => failed(new Error(t("error.no_picture"))), src: address }));
  const canvas = Object.assign(document.createElement("canvas"), { width: scale * width, height: scale * height });
  canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(address);
  const link = make("a"), file = await new Promise((made) => canvas.toBlob(made, "image/png"));
  Object.assign(link, { href: URL.createObjectURL(file), download: `${name}.png` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
