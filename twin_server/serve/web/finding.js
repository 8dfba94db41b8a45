// What a diagnosis has found, in words and numbers: effects with their parameters, rivals, and where it looked.
import { parts, t } from "./language.js";
import { composed, digits, english, make, number, range } from "./words.js";

const spaced = (name) => name.replaceAll("_", " ");
const placed = ({ kind, id }) => kind === "base" ? t("place.base") : t(`place.${kind}`, { id });
// A number carries its unit, and the name of a parameter ends with it: friction_n, k3_n_per_m3.
const labelled = (name, unit) => spaced(unit ? name.replace(/(?:_(?:n|m[23]?|s2?|kg|hz|rad|c|per))+$/, "") : name);
const percent = (share) => share > 0.995 && share < 1 ? "> 99\u202f%" : `${number(100 * share, 0)}\u202f%`;
const few = (x) => digits(x, 4);

const HEADS = [t("finding.effect"), t("finding.where"), t("finding.parameters"), t("finding.probability")];

function table(caption, headings, rows) {
  const made = make("table", undefined, "found-table"), top = make("thead"), head = make("tr"), body = make("tbody");
  for (const heading of headings) {
    const cell = make("th", heading);
    cell.scope = "col";
    head.append(cell);
  }
  for (const [title, ...cells] of rows) {
    const row = make("tr"), first = title instanceof Node ? title : make("th", title);
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
    root.append(table(t("finding.lacking"), HEADS, named.map((effect) => [
      english(make("th", spaced(effect.effect))), placed(effect.where), english(make("td", parametersOf(effect))), percent(effect.probability),
    ])));
    const rivals = named.flatMap(({ alternatives = [] }) => alternatives).slice(0, 5)
      .map((rival) => t("finding.rival", { effect: spaced(rival.effect), place: placed(rival.where), probability: percent(rival.probability) }));
    if (rivals.length) root.append(make("p", t("finding.rivals", { rivals: rivals.join(", ") }), "facts"));
  }
  if (where.length) {
    root.append(table(t("finding.places"), [t("finding.place"), t("finding.share")], where.slice(0, 6).map((place) => [placed(place), bar(place.share)])));
  }
  if (when) {
    const spans = (list, unit) => list.slice(0, 6).map(([from, to]) => `${range(few(from), few(to))}\u202f${unit}`).join(", ");
    const said = [
      when.times_s?.length && t("finding.times", { spans: spans(when.times_s, "s") }), when.bands_hz?.length && t("finding.bands", { spans: spans(when.bands_hz, "Hz") }),
      when.amplitude && composed("span", when.amplitude), when.steady === false && t("finding.unsteady"),
    ];
    const told = make("p", undefined, "facts");
    told.append(...said.filter(Boolean).flatMap((part, i) => i ? [" ", part] : [part]));
    root.append(told);
  }
  if (experiment) {
    const told = make("p", undefined, "facts");
    told.append(...parts("finding.experiment", { experiment: composed("span", experiment) }));
    root.append(told);
  }
  return root;
}
