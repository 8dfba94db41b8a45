// What the twin's model lacks: the gap while nobody asks, jobs under way, what they found, adopted and undone.
import { findingOf } from "./finding.js";
import { t } from "./language.js";
import { ask, send } from "./link.js";
import { Overlay } from "./overlay.js";
import { draw } from "./svg.js";
import { button, composed, english, explain, make, number, say } from "./words.js";

const WIDTH = 320, HEIGHT = 64, SHOWN = 60, EVERY_MS = 1500, UNDER_WAY_MS = 400;
const UNDER_WAY = ["queued", "running"];
const STATES = { queued: "waiting", running: "waiting", done: "good", failed: "bad", cancelled: "away" };
const GAP_STATES = { waiting: "waiting", learning: "waiting", watching: "good", disagreeing: "bad" };

const percent = (x) => `${number(100 * x, x < 0.1 ? 1 : 0)}\u202f%`;

/** Both gaps on a scale of powers of ten, and the limit; with what was adopted drawn thick. */
function gapPicture({ readings, limit, expected }) {
  const shown = readings.slice(-SHOWN), values = shown.flatMap((one) => [one.nominal, one.in_use]);
  const all = [...values, ...[limit, expected].filter((x) => x)].map((x) => Math.log10(Math.max(x, 1e-4)));
  const low = Math.min(...all) - 0.1, high = Math.max(...all) + 0.1;
  const y = (x) => HEIGHT - 2 - (HEIGHT - 4) * (Math.log10(Math.max(x, 1e-4)) - low) / (high - low);
  const x = (i) => 2 + (WIDTH - 4) * i / Math.max(shown.length - 1, 1);
  const picture = draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "gap", role: "img" });
  const last = shown.at(-1);
  picture.setAttribute("aria-label", t("diagnosis.gap_chart", { n: shown.length, nominal: percent(last.nominal), in_use: percent(last.in_use) }));
  if (limit) picture.append(draw("line", { x1: 0, x2: WIDTH, y1: y(limit), y2: y(limit), class: "limit" }));
  for (const name of ["nominal", "in_use"]) {
    const points = shown.map((one, i) => `${x(i).toFixed(1)},${y(one[name]).toFixed(1)}`).join(" ");
    picture.append(draw("polyline", { points, class: name }));
  }
  return picture;
}

/** Bars of the gap: as given, refitted, after each effect, and what noise alone makes. */
function gapBars(report) {
  const { gap } = report, slow = report.clock === "slow";
  const rows = slow
    ? [[t("diagnosis.as_it_was"), gap.nominal, "nominal"], [t("diagnosis.with_effects"), gap.augmented, "augmented"]]
    : [
      [t("diagnosis.as_given"), gap.nominal, "nominal"], [t("diagnosis.refitted"), gap.refitted_nominal, "refitted"],
      ...gap.steps.map((step) => [t("diagnosis.with_effect", { effect: step.effect.replaceAll("_", " ") }), step.nrmse, "augmented"]),
    ];
  rows.push([t("diagnosis.noise_alone"), gap.noise_floor, "floor"]);
  const most = Math.max(...rows.map(([, value]) => value)), table = make("table", undefined, "bars");
  table.append(make("caption", slow ? t("diagnosis.scatter") : t("diagnosis.free_run")));
  for (const [name, value, kind] of rows) {
    const row = make("tr"), cell = make("td"), bar = make("span", undefined, `bar ${kind}`);
    bar.style.width = `${Math.max(100 * value / most, 0.5)}%`;
    cell.append(bar);
    row.append(make("th", name), cell, make("td", percent(value)));
    row.dataset.step = kind;
    table.append(row);
  }
  return table;
}

export class Diagnosis {
  constructor(twin) {
    this.twin = twin;
    this.root = make("div", undefined, "diagnosis");
    this.root.hidden = true;
    [this.pill, this.sentence] = [make("p", "", "pill"), make("p", "", "facts")];
    [this.picture, this.problem, this.jobs] = [make("div", undefined, "picture"), make("p", "", "notice"), make("ol", undefined, "jobs")];
    this.problem.dataset.state = "bad";
    this.problem.setAttribute("role", "alert");
    this.problem.hidden = true;
    this.root.append(this.pill, this.sentence, this.picture, this.tools(), this.problem, this.jobs);
    [this.rows, this.askedAt, this.asking, this.underWay] = [new Map(), 0, false, false];
  }

  tools() {
    const tools = make("div", undefined, "orders"), orders = make("p", undefined, "orders writes"), label = make("label", `${t("diagnosis.samples")} `), quick = make("label");
    this.seconds = make("input");
    Object.assign(this.seconds, { type: "number", min: 5, max: 3600, value: 40, step: 5 });
    label.append(this.seconds, " s");
    this.quick = make("input");
    this.quick.type = "checkbox";
    quick.append(this.quick, ` ${t("diagnosis.quick")}`);
    this.fast = make("span", undefined, "fast");
    this.fast.append(button(t("diagnosis.find_effect"), () => this.start({
      raw: { duration_s: Number(this.seconds.value) }, quick: this.quick.checked,
    })), label, quick);
    this.slow = button(t("diagnosis.find_driver"), () => this.start({ clock: "slow" }));
    orders.append(this.fast, this.slow);
    tools.append(orders, make("p", t("access.diagnoses"), "facts for-viewers"));
    return tools;
  }

  start(order) { return this.attempt(() => send(`${this.twin.base}/diagnoses`, "POST", order)); }

  async attempt(act) {
    this.problem.hidden = true;
    try { await act(); } catch (error) {
      explain(this.problem, error);
      this.problem.hidden = false;
    }
    await this.refresh(true);
  }

  /** Ask what is new: the gap always, jobs while somebody looks at them. */
  async refresh(now = false) {
    if (this.root.hidden || this.asking || (!now && Date.now() - this.askedAt < EVERY_MS)) return;
    [this.asking, this.askedAt] = [true, Date.now()];
    try {
      const gap = await ask(`${this.twin.base}/gap`);
      this.tell(gap);
      this.list((await ask(`${this.twin.base}/diagnoses`)).diagnoses);
    } catch (error) {
      // A server that diagnoses nothing, or is away: the page says the latter elsewhere.
      if (error.status === 404) this.sentence.textContent = t("diagnosis.unavailable");
    } finally { this.asking = false; }
    clearTimeout(this.again);
    if (this.underWay && !this.root.hidden) this.again = setTimeout(() => this.refresh(true), UNDER_WAY_MS);
  }

  tell(gap) {
    const off = gap.state === "off";
    this.root.dataset.gap = gap.state;
    this.fast.hidden = off && !this.twin.latest?.registration?.model;
    say(this.pill, off ? "" : GAP_STATES[gap.state], off ? "" : t(`gap.${gap.state}`));
    this.pill.hidden = off;
    const usual = gap.expected ? [` ${t("diagnosis.usual", { expected: percent(gap.expected), limit: percent(gap.limit) })}`] : [];
    this.sentence.replaceChildren(composed("span", gap.sentence), ...usual);
    const last = gap.readings.at(-1);
    if (last) [this.root.dataset.nominal, this.root.dataset.inUse] = [last.nominal, last.in_use];
    const key = `${last?.t_ns} ${gap.state}`;
    if (this.drawn === key) return;
    this.drawn = key;
    this.picture.replaceChildren(...(last ? [make("p", t("diagnosis.gap_title"), "facts"), gapPicture(gap), this.legend(gap.limit, last)] : []));
  }

  legend(limit, { nominal, in_use: inUse }) {
    const legend = make("p", undefined, "facts keys");
    const lines = [["nominal", t("diagnosis.line_nominal"), nominal], ["in_use", t("diagnosis.line_in_use"), inUse], ["limit", t("diagnosis.line_limit"), limit]];
    for (const [name, text, value] of lines) {
      const entry = make("span");
      entry.append(make("span", undefined, `line ${name}`), value ? `${text}: ${percent(value)}` : text);
      legend.append(entry);
    }
    return legend;
  }

  list(diagnoses) {
    const numbers = new Set(diagnoses.map((one) => one.number));
    for (const [kept, row] of this.rows) if (!numbers.has(kept)) { row.overlay?.close(); row.item.remove(); this.rows.delete(kept); }
    this.underWay = diagnoses.some(({ state }) => UNDER_WAY.includes(state));
    const adopted = this.twin.latest?.registration?.adopted?.at(-1)?.diagnosis;
    for (const one of diagnoses.slice().reverse()) {
      const row = this.rows.get(one.number) ?? this.row(one);
      this.rows.set(one.number, row);
      this.fill(row, one, adopted);
    }
  }

  row(one) {
    const item = make("li"), head = make("p", undefined, "head"), bar = make("progress"), found = make("div", undefined, "found");
    const [pill, stage, acts] = [make("span", "", "pill"), english(make("span", "", "stage")), make("span", undefined, "acts")];
    bar.max = 1;
    item.dataset.number = one.number;
    const what = one.request.clock === "fast" && one.request.quick ? t("diagnosis.fast_quick") : t(`diagnosis.clock.${one.request.clock}`);
    head.append(make("strong", `${one.number}`), pill, make("span", what, "facts"), stage, bar, acts);
    item.append(head, found);
    this.jobs.prepend(item);
    return { item, pill, stage, bar, acts, found, state: "" };
  }

  fill(row, one, adopted) {
    say(row.pill, STATES[one.state], t(`job.${one.state}`));
    const under = UNDER_WAY.includes(one.state);
    row.bar.hidden = !under;
    row.bar.value = one.progress;
    row.stage.textContent = under ? one.stage : one.error;
    const state = `${one.state} ${one.adopted} ${adopted}`;
    if (row.state === state) return;
    row.state = state;
    const base = `${this.twin.base}/diagnoses/${one.number}`, post = (word) => () => this.attempt(() => send(`${base}/${word}`, "POST"));
    const acts = [];
    if (under) acts.push(button(t("form.cancel"), () => this.attempt(() => send(base, "DELETE")), "writes"));
    if (one.state === "done") {
      if (!row.found.childElementCount) this.show(row, one, base);
      if (one.report.effects.length && !one.adopted) acts.push(button(t("diagnosis.adopt"), post("adopt"), "writes"));
      if (one.adopted && one.number === adopted) acts.push(button(t("form.undo"), post("undo"), "writes"));
      if (one.adopted) acts.push(make("span", t("diagnosis.adopted"), "facts"));
      acts.push(this.opener(row, base), ...this.links(base, one.report.clock === "slow"));
    }
    row.acts.replaceChildren(...acts);
  }

  /** Of the newest, model and measurement are drawn at once. */
  show(row, { report }, base) {
    const { item } = row;
    const words = composed("p", report.sentence, "verdict");
    words.dataset.state = report.effects.length ? "bad" : "good";
    row.overlay = new Overlay(`${base}/charts.json`, report.when);
    row.found.append(words, gapBars(report), findingOf(report), row.overlay.root);
    row.overlay.root.open = item === this.jobs.firstElementChild;
  }

  /** Other colours, or another width. */
  redraw() { for (const { overlay } of this.rows.values()) overlay?.draw(); }

  close() {
    this.root.hidden = true;
    clearTimeout(this.again);
    for (const { overlay } of this.rows.values()) overlay?.close();
  }

  /** The report draws itself, in a frame that can do nothing else. */
  opener(row, base) {
    const opener = button(t("diagnosis.report"), () => {
      const open = row.frame && !row.frame.hidden;
      if (!row.frame) {
        row.frame = make("iframe");
        row.frame.title = t("diagnosis.report_title");
        row.frame.setAttribute("sandbox", "allow-scripts");
        row.frame.src = `${base}/report.html`;
        row.found.append(row.frame);
      }
      row.frame.hidden = open;
      opener.setAttribute("aria-expanded", String(!open));
    });
    opener.setAttribute("aria-expanded", String(Boolean(row.frame && !row.frame.hidden)));
    return opener;
  }

  links(base, slow) {
    return ["report.json", ...(slow ? [] : ["augmented.yaml"])].map((name) => {
      const link = make("a", name);
      link.href = `${base}/${name}`;
      return link;
    });
  }
}
