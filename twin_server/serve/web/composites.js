// Twins made of twins, under the fleet: health of each, and when opened its failure probability, tree and members.
import { parts, t } from "./language.js";
import { ask } from "./link.js";
import { toTwin } from "./route.js";
import { button, composed, digits, explain, interval95, make, number, powered, range, say, unitOf } from "./words.js";

const LIST_MS = 10000, MOST_ROWS = 50;
const IMPORTANCE = [t("composites.twin"), t("composites.probability"), t("composites.birnbaum"), t("composites.criticality"), t("composites.fussell_vesely")];
const RATES = [t("composites.of"), t("composites.rate"), t("number.interval_95"), t("composites.weight")];

/** A probability in two digits: 0.00013, 0.42. */
export function chance(p) {
  if (p === null || p === undefined) return t("composites.not_known");
  if (p === 0 || p === 1) return `${p}`;
  return p < 1e-4 ? powered(p) : number(p, Math.max(2, 1 - Math.floor(Math.log10(p))));
}

const band = ({ value, lo, hi }) => `${chance(value)} (${interval95(range(chance(lo), chance(hi)))})`;

function gateOf(gate) {
  if (gate.series) return [t("composites.series"), gate.series];
  if (gate.parallel) return [t("composites.parallel"), gate.parallel];
  return [t("composites.k_of_n", { k: gate.k, all: gate.of.length }), gate.of];
}

/** A table whose cells are texts or elements; the first of a row is its heading. */
function table(caption, titles, rows) {
  const made = make("table", undefined, "found-table"), head = make("thead"), body = make("tbody"), line = make("tr");
  const of = (name, content, scope) => {
    const cell = make(name);
    cell.append(content);
    if (scope) cell.scope = scope;
    return cell;
  };
  line.append(...titles.map((title) => of("th", title, "col")));
  head.append(line);
  body.append(...rows.map((cells) => {
    const row = make("tr");
    row.append(...cells.map((content, i) => of(i ? "td" : "th", content, i ? null : "row")));
    return row;
  }));
  made.append(make("caption", caption), head, body);
  return made;
}

class Composite {
  constructor(id) {
    this.id = id;
    this.root = make("li", undefined, "composite");
    this.root.dataset.composite = id;
    this.title = make("h4", id);
    this.health = make("p", "", "alarm");
    this.detail = make("div", undefined, "detail");
    this.detail.hidden = true;
    this.opener = button(t("composites.show"), () => this.toggle());
    this.opener.setAttribute("aria-expanded", "false");
    this.root.append(this.title, this.health, this.opener, this.detail);
  }

  tell(brief, kinds) {
    this.kinds = kinds;
    const { twins, valid_twins: valid, alive, alarms } = brief.health;
    this.title.textContent = brief.name === this.id ? this.id : `${brief.name} (${this.id})`;
    const words = [
      t(`composites.kind.${brief.kind}`), t("fleet.twins", { n: twins }), t("fleet.valid", { n: valid }), t("composites.online", { n: alive }),
      alarms ? `\u25b2 ${t("composites.alarms", { n: alarms })}` : t("fleet.no_alarm"),
    ];
    say(this.health, alarms ? "bad" : valid < twins ? "waiting" : "good", words.join(" \u00b7 "));
  }

  async toggle() {
    const open = this.detail.hidden;
    this.detail.hidden = !open;
    this.opener.setAttribute("aria-expanded", `${open}`);
    this.opener.textContent = open ? t("composites.hide") : t("composites.show");
    if (open) await this.load();
  }

  async load() {
    this.detail.replaceChildren(make("p", t("composites.computing"), "facts"));
    try {
      this.show(await ask(`/api/v1/composites/${encodeURIComponent(this.id)}`));
    } catch (error) {
      const problem = make("p", undefined, "alarm");
      problem.dataset.state = "bad";
      explain(problem, error);
      this.detail.replaceChildren(problem);
    }
  }

  show(told) {
    const { failure, health, pooled } = told, { lo, hi } = failure.any_dependence;
    const horizon = failure.horizon === null ? null : `${digits(failure.horizon, 4)} ${unitOf(failure) ?? ""}`;
    const risk = horizon === null ? t("composites.risk", { probability: band(failure) }) : t("composites.risk_within", { probability: band(failure), horizon });
    const worst = health.worst && make("p", undefined, "worst");
    if (worst) worst.append(...parts("composites.worst", { member: this.link(health.worst) }));
    const told_of = [
      make("p", risk, "told"),
      make("p", t("composites.any_dependence", { range: range(chance(lo), chance(hi)) }), "facts"),
      worst, this.tree(told), this.twins(told.twins), ...pooled.map((pool) => this.rates(pool)), this.reasons([...failure.reasons, ...health.reasons]),
    ];
    this.detail.replaceChildren(...told_of.filter(Boolean));
  }

  /** Gates as nested lists, which are read as such; each member with its own probability. */
  tree({ tree, members, twins }) {
    const of = new Map([...twins, ...members].map((one) => [one.id, one.failure]));
    const grown = (gate) => {
      const [words, inputs] = gateOf(gate), list = make("ul");
      list.append(...inputs.map((input) => {
        const item = make("li");
        if (typeof input !== "string") item.append(...grown(input));
        else item.append(this.link(input), ` ${chance(of.get(input)?.value)}`);
        return item;
      }));
      return [make("span", words, "gate"), list];
    };
    const root = make("div", undefined, "tree");
    root.append(...grown(tree));
    return root;
  }

  link(id) {
    if (this.kinds.has(id)) return make("span", id, "name");
    const link = make("a", id, "name");
    link.href = toTwin(id);
    return link;
  }

  /** Those that matter most come first. */
  twins(twins) {
    const weight = ({ importance, failure }) => importance?.criticality ?? failure.value ?? 0;
    const share = (x) => (x === null || x === undefined ? "\u2013" : number(x, 3));
    const rows = twins.toSorted((a, b) => weight(b) - weight(a) || (b.failure.value ?? 0) - (a.failure.value ?? 0)).slice(0, MOST_ROWS).map(({ id, failure, importance }) => [
      this.link(id), band(failure), share(importance?.birnbaum), share(importance?.criticality), share(importance?.fussell_vesely),
    ]);
    const caption = twins.length > MOST_ROWS ? t("composites.most_important", { n: MOST_ROWS, all: twins.length }) : t("composites.by_importance");
    return table(caption, IMPORTANCE, rows);
  }

  rates({ quantity, slow_time_unit: unit, fleet, another, members }) {
    const text = (x) => (x === null ? t("composites.none") : digits(x, 3));
    const said = ({ value, lo, hi }) => [text(value), range(text(lo), text(hi))];
    const rows = [[t("composites.fleet"), ...said(fleet), ""], [t("composites.another"), ...said(another), ""], ...members.map((one) => [
      this.link(one.id), ...said(one), `${Math.round(100 * one.shrinkage)}\u202f%`,
    ])];
    return table(t("composites.pooled", { quantity, unit: unit ?? t("unit.slow_time") }), RATES, rows);
  }

  reasons(reasons) {
    if (!reasons.length) return null;
    const list = make("ul", undefined, "facts reasons");
    list.append(...reasons.map((reason) => composed("li", reason)));
    return list;
  }
}

export class Composites {
  constructor() {
    Object.assign(this, { known: new Map(), askedAt: -Infinity, asking: false });
    this.root = make("section", undefined, "composites");
    this.root.setAttribute("aria-label", t("composites.title"));
    this.list = make("ul");
    this.root.append(make("h3", t("composites.title")), this.list);
    this.root.hidden = true;
  }

  async refresh() {
    if (this.asking || performance.now() - this.askedAt < LIST_MS) return;
    [this.asking, this.askedAt] = [true, performance.now()];
    const { composites = [] } = await ask("/api/v1/composites").catch(() => ({}));
    this.asking = false;
    const kinds = new Map(composites.map(({ id, kind }) => [id, kind]));
    this.root.hidden = !composites.length;
    for (const [id, one] of this.known) if (!kinds.has(id)) { one.root.remove(); this.known.delete(id); }
    for (const brief of composites) {
      if (!this.known.has(brief.id)) {
        const one = new Composite(brief.id);
        this.known.set(brief.id, one);
        this.list.append(one.root);
      }
      this.known.get(brief.id).tell(brief, kinds);
    }
  }
}
