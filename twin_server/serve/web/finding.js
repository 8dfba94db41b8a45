// What a diagnosis has found, in words and numbers: effects with their parameters, rivals, and where it looked.
import { make, number } from "./words.js";

const spaced = (name) => name.replaceAll("_", " ");
const placed = ({ kind, id }) => kind === "base" ? "the base" : `${kind} ${id}`;
// A number carries its unit, and the name of a parameter ends with it: friction_n, k3_n_per_m3.
const labelled = (name, unit) => spaced(unit ? name.replace(/(?:_(?:n|m[23]?|s2?|kg|hz|rad|c|per))+$/, "") : name);
const percent = (share) => share > 0.995 && share < 1 ? "> 99\u202f%" : `${number(100 * share, 0)}\u202f%`;
const few = (x) => `${+x.toPrecision(4)}`.replaceAll("-", "\u2212");

function table(caption, headings, rows) {
  const made = make("table", undefined, "found-table"), top = make("thead"), head = make("tr"), body = make("tbody");
  for (const heading of headings) {
    const cell = make("th", heading);
    cell.scope = "col";
    head.append(cell);
  }
  for (const [title, ...cells] of rows) {
    const row = make("tr"), first = make("th", title);
    first.scope = "row";
    row.append(first, ...cells.map((cell) => cell instanceof Node ? cell : make("td", cell)));
    body.append(row);
  }
  top.append(head);
  made.append(make("caption", caption), top, body);
  return made;
}

function parametersOf({ parameters = {} }) {
  const said = Object.entries(parameters).filter(([, { sd }]) => sd > 0)
    .map(([name, { value, sd, unit }]) => `${labelled(name, unit)} ${few(value)} ± ${few(+sd.toPrecision(2))}${unit ? `\u202f${unit}` : ""}`);
  return said.join(", ");
}

/** A share as a bar with its number, so that places can be told apart at a glance. */
function bar(share) {
  const cell = make("td", undefined, "share"), drawn = make("span", undefined, "bar");
  drawn.style.width = `${Math.max(1, 60 * Math.min(1, share))}%`;
  cell.append(drawn, ` ${percent(share)}`);
  return cell;
}

/** Of fast time; a diagnosis of the slow clock says all it has to in its sentence and its charts. */
export function findingOf({ effects, where = [], when, experiment }) {
  const root = make("div", undefined, "finding");
  const named = effects.filter(({ where: place }) => place);
  if (named.length) {
    root.append(table("What the model lacks", ["effect", "where", "parameters, ± one sd", "probability"], named.map((effect) => [
      spaced(effect.effect), placed(effect.where), parametersOf(effect), percent(effect.probability),
    ])));
    const rivals = named.flatMap(({ alternatives = [] }) => alternatives).slice(0, 5)
      .map((rival) => `${spaced(rival.effect)} at ${placed(rival.where)} (${percent(rival.probability)})`);
    if (rivals.length) root.append(make("p", `It may also be: ${rivals.join(", ")}.`, "facts"));
  }
  if (where.length) {
    root.append(table("Where model and measurement differ", ["place", "share of the remaining error"], where.slice(0, 6).map((place) => [placed(place), bar(place.share)])));
  }
  if (when) {
    const spans = (list, unit) => list.slice(0, 6).map(([from, to]) => `${few(from)} to ${few(to)}\u202f${unit}`).join(", ");
    const said = [
      when.times_s?.length && `In time, the error is largest at ${spans(when.times_s, "s")}.`, when.bands_hz?.length && `In frequency, the error is largest at ${spans(when.bands_hz, "Hz")}.`,
      when.amplitude, when.steady === false && "It changes over the record.",
    ];
    root.append(make("p", said.filter(Boolean).join(" "), "facts"));
  }
  if (experiment) root.append(make("p", `Experiment that would decide: ${experiment}`, "facts"));
  return root;
}
