// The past of a twin in a few points: a line with its band.
import { draw } from "./svg.js";

const WIDTH = 240, HEIGHT = 56, EDGE = 3;
/** Share of the readings whose intervals fit into the picture. */
const WHOLE = 0.9;

/** Of `{ x, value, lo, hi }`, with what it shows in words. */
export function sparkline(points, words) {
  const svg = draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", class: "spark", role: "img", "aria-label": words });
  if (points.length < 2) return svg;
  const span = (pick) => points.reduce(([a, b], point) => [Math.min(a, pick(point)), Math.max(b, pick(point))], [Infinity, -Infinity]);
  const [first, last] = span((point) => point.x), [least, most] = span((point) => point.value);
  const x = (point) => (EDGE + (WIDTH - 2 * EDGE) * (point.x - first) / (last - first || 1)).toFixed(1);
  // The band is drawn whole, but for single wide readings, which would flatten the line.
  const ordered = (pick) => points.map(pick).sort((a, b) => a - b), rank = (share) => Math.round(share * (points.length - 1));
  const low = Math.min(least, ordered((point) => point.lo)[rank(1 - WHOLE)]), high = Math.max(most, ordered((point) => point.hi)[rank(WHOLE)]);
  const room = 0.05 * (high - low) || 1;
  const y = (value) => {
    const share = (value - low + room) / (high - low + 2 * room);
    return (HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * Math.min(1, Math.max(0, share))).toFixed(1);
  };
  const at = (pick) => points.map((point) => `${x(point)},${y(pick(point))}`);
  const around = [...at((point) => point.lo), ...at((point) => point.hi).reverse()];
  svg.append(
    draw("polygon", { points: around.join(" "), class: "band" }),
    draw("polyline", { points: at((point) => point.value).join(" "), class: "line" }),
  );
  return svg;
}
