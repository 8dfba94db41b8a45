// Fatigue damage of each point with its band and the time to failure; the last window of virtual quantities.
import { t } from "./language.js";
import { ask } from "./link.js";
import { sparkline } from "./sparkline.js";
import { digits, make, number, powered, range } from "./words.js";

const EVERY_MS = 30_000, NARROW = "\u202f", YEAR_S = 365.25 * 86_400, MOST_POINTS = 400;
const COLUMNS = [
  t("fatigue.point"), t("fatigue.sum"), t("number.interval_95"), t("fatigue.rate"), t("fatigue.time_to_failure"), "50\u202f%", "95\u202f%", t("fatigue.course"),
];
const few = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e-3 && Math.abs(x) < 1e4 ? digits(x, 3) : powered(x));
const years = (seconds) => (seconds === null ? t("fatigue.never") : `${few(seconds / YEAR_S)}${NARROW}${t("unit.years")}`);

function header(titles) {
  const row = make("tr");
  for (const title of titles) {
    const cell = make("th", title);
    cell.scope = "col";
    row.append(cell);
  }
  return row;
}

function rowOf({ name, damage, damage_per_year, time_to_failure_s, course, counted_s, uncounted_s, reasons }) {
  const row = make("tr"), title = make("th", name), drawn = make("td");
  title.scope = "row";
  row.dataset.point = name;
  const step = Math.ceil(course.length / MOST_POINTS);
  const points = course.filter((_, i) => i % step === 0).map(({ t_ns, damage: value, lo, hi }) => ({ x: t_ns, value, lo, hi }));
  drawn.append(sparkline(points, t("fatigue.damage_of", { point: name, value: few(damage.value) })));
  const times = Object.values(time_to_failure_s).map((time) => make("td", years(time)));
  const interval = make("td", range(few(damage.lo), few(damage.hi)));
  row.append(title, make("td", few(damage.value)), interval, make("td", few(damage_per_year)), ...times, drawn);
  const missed = uncounted_s > 0 ? `, ${t("fatigue.not_counted", { hours: number(uncounted_s / 3600, 1) })}` : "";
  row.title = [`${t("fatigue.counted", { hours: number(counted_s / 3600, 1) })}${missed}`, ...reasons].join("; ");
  return row;
}

function figureOf({ name, unit, values, sd }, { start_ns, rate_hz, lowest_hz, valid, reasons }) {
  const figure = make("figure"), largest = values.reduce((most, value, i) => (Math.abs(value) > Math.abs(values[most]) ? i : most), 0);
  figure.dataset.quantity = name;
  const points = values.map((value, i) => ({ x: start_ns / 1e9 + i / rate_hz, value, lo: value - 1.96 * sd[i], hi: value + 1.96 * sd[i] }));
  const said = t("virtual.largest", { name, value: few(values[largest]), error: few(1.96 * sd[largest]), unit, lowest: few(lowest_hz) });
  figure.append(make("figcaption", valid ? said : `${said} (${reasons.join(", ")})`), sparkline(points, said));
  return figure;
}

export class Assessed {
  constructor() {
    this.root = make("div", undefined, "assessed");
    this.table = make("table", undefined, "crossings");
    this.body = make("tbody");
    const head = make("thead");
    head.append(header(COLUMNS));
    this.table.append(make("caption", t("fatigue.caption")), head, this.body);
    this.virtual = make("div", undefined, "charts");
    this.root.append(this.table, this.virtual);
    this.root.hidden = true;
    this.asked = -Infinity;
  }

  tell({ base }) {
    if (performance.now() - this.asked < EVERY_MS) return;
    this.asked = performance.now();
    this.refresh(base);
  }

  async refresh(base) {
    const [{ points = [] }, { windows = [] }] = await Promise.all(
      ["fatigue", "virtual"].map((what) => ask(`${base}/${what}`).catch(() => ({}))),
    );
    const last = windows.at(-1);
    this.root.hidden = !points.length && !last;
    this.table.hidden = !points.length;
    this.body.replaceChildren(...points.map(rowOf));
    this.virtual.replaceChildren(...(last?.quantities ?? []).map((quantity) => figureOf(quantity, last)));
  }
}
