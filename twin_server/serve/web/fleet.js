// All twins at a glance: what each is, whether it is to be relied on, when it was last heard of, what is wrong.
import { served } from "./buckets.js";
import { Composites } from "./composites.js";
import { parts, t } from "./language.js";
import { ask } from "./link.js";
import { toTwin } from "./route.js";
import { sparkline } from "./sparkline.js";
import { historyOf } from "./window.js";
import { ago, button, digits, english, interval95, make, say, spoken, standing, suspected, titleOf } from "./words.js";

const LATEST = 1000, SPARK_POINTS = 200, MOST_CARDS = 100, FINDABLE = 9, RELOAD_MS = 60000, PLAN_MS = 300000;
const WORD = {
  valid: ["good", `\u2713 ${t("standing.valid")}`], learning: ["waiting", `\u2026 ${t("standing.learning")}`],
  inseparable: ["waiting", `\u25c7 ${t("standing.inseparable")}`], invalid: ["bad", `\u2715 ${t("standing.invalid")}`],
  none: ["waiting", `\u2026 ${t("standing.none")}`],
};
const ORDER = { alarm: 0, changed: 1, bad: 2, waiting: 3, good: 4 };

/** Which limits of alarms are passed, in a few words; nothing where none is. */
export function limitsPassed({ raised = [] }) {
  const said = raised.map(({ quantity, side, limit }) => {
    const [size, unit] = quantity === "frequency_hz" ? [limit, "Hz"] : [100 * limit, "%"];
    return t(`alarm.${side}`, { quantity: titleOf(quantity), limit: `${digits(size, 3)}\u202f${unit}` });
  });
  return said.join("; ");
}

/** What has changed in a structure though no limit of an alarm is passed. */
function changeOf({ suspects = [], normal = [] }) {
  const unexplained = normal.some(({ entered }) => entered) && t("fleet.unexplained");
  return [...suspects.map((word) => t("fleet.has_changed", { element: suspected(word) })), unexplained].filter(Boolean).join("; ");
}

function urgencyOf(state) {
  if (limitsPassed(state)) return "alarm";
  if (changeOf(state)) return "changed";
  return state.slow_time === null ? "waiting" : WORD[standing(state)][0];
}

const nameOf = ({ id, registration }) => registration.name || id;
const isLearning = (state) => state.slow_time === null || standing(state) === "learning";
const isCalm = (state) => !limitsPassed(state) && !changeOf(state);
const NAMED = 3;
/** What may stand against a twin, the worst first: the answer to "Is anything wrong?", the message on such twins, and which they are. */
const FINDINGS = [
  ["bad", t("fleet.answer.yes"), "alarm", limitsPassed],
  ["waiting", t("fleet.answer.possibly"), "changed", (state) => !limitsPassed(state) && changeOf(state)],
  ["waiting", t("fleet.answer.not_known"), "invalid", (state) => isCalm(state) && !isLearning(state) && !state.valid],
  ["waiting", t("fleet.answer.not_yet_known"), "learning", (state) => isCalm(state) && isLearning(state)],
  ["good", t("fleet.answer.no"), "offline", ({ alive }) => !alive],
];

/** `[state, sentence]`: whether anything is wrong with the twins, in words. */
export function verdictOf(states) {
  const found = FINDINGS.map(([mood, answer, kind, why]) => ({ mood, answer, kind, why, those: states.filter((state) => why(state)) }))
    .filter(({ those }) => those.length);
  const said = found.map(({ kind, why, those }) => {
    const named = those.slice(0, NAMED).map((state) => (typeof why(state) === "string" ? `${nameOf(state)} (${why(state)})` : nameOf(state)));
    const names = those.length > NAMED ? t("fleet.more", { names: named.join(", "), n: those.length - NAMED }) : named.join(", ");
    return t(`fleet.finding.${kind}`, { n: those.length, all: states.length, names });
  });
  const { mood, answer } = found[0] ?? { mood: "good", answer: t("fleet.answer.no") };
  const calm = mood === "good" ? [t("fleet.nothing_wrong", { n: states.length })] : [];
  return [mood, [t("fleet.is_anything_wrong", { answer }), ...calm, ...said].join(" ")];
}

/** The quantity that tells most of a twin: what it estimates, or of a twin of elements the worst of them. */
function headlineOf(state) {
  const { elements = {}, suspects = [], assumed } = state;
  const accused = suspects.flatMap((word) => word.split(/ or | and /)).find((name) => name in elements);
  if (accused) return { name: accused, title: t("fleet.change_of", { element: accused }), quantity: "stiffness_change", pick: (point) => point.elements?.[accused] };
  const quantity = ["stiffness_change", "mass_change"].find((name) => state[name] && !assumed.includes(name)) ?? "frequency_hz";
  return { name: quantity, title: titleOf(quantity), quantity, pick: (point) => point[quantity] };
}

class Card {
  constructor(id) {
    Object.assign(this, { id, points: [], loadedAt: 0, loading: false, onScreen: false, of: "" });
    this.root = make("li", undefined, "card");
    this.root.dataset.twin = id;
    [this.link, this.sub, this.alarm] = [make("a", id, "name"), make("span", "", "facts"), make("p", "", "alarm")];
    this.link.href = toTwin(id);
    [this.validity, this.edge, this.seen] = [make("span", "", "pill"), make("span", "", "pill"), make("span", "", "facts seen")];
    [this.title, this.value, this.interval] = [make("span", "", "title"), make("strong", "\u2013"), make("span", "", "interval")];
    this.picture = make("div", undefined, "sparkplace");
    const head = make("div", undefined, "cardhead"), states = make("p", undefined, "states"), told = make("p", undefined, "told");
    head.append(this.link, this.sub);
    states.append(this.validity, this.edge, this.seen);
    told.append(this.title, this.value, this.interval);
    this.root.append(head, states, this.alarm, told, this.picture);
  }

  tell(state) {
    const before = this.state, begun = state.slow_time !== null, passed = limitsPassed(state), changed = changeOf(state);
    this.state = state;
    const name = state.registration.name || this.id;
    if (this.link.textContent !== name) this.link.textContent = name;
    this.sub.textContent = name === this.id ? "" : this.id;
    say(this.validity, ...WORD[begun ? standing(state) : "none"]);
    say(this.edge, state.alive ? "good" : "away", state.alive ? `\u25cf ${t("fleet.agent_online")}` : `\u25cb ${t("fleet.agent_offline")}`);
    const said = [passed && `\u25b2 ${passed}`, changed && `\u25b3 ${changed}`].filter(Boolean).join("; ");
    say(this.alarm, passed ? "bad" : changed ? "waiting" : "good", said || (begun ? t("fleet.no_alarm") : ""));
    this.root.dataset.urgency = urgencyOf(state);
    this.headline(state);
    if (begun && before && (before.sequence !== state.sequence || before.boot !== state.boot)) this.add(state);
    this.tick();
  }

  headline(state) {
    const head = headlineOf(state), estimate = head.pick(state);
    if (head.name !== this.of) [this.of, this.points, this.loadedAt] = [head.name, [], 0];
    this.head = head;
    const [value, interval] = estimate ? spoken(estimate, head.quantity) : ["\u2013", ""];
    this.title.textContent = head.title;
    this.value.textContent = value;
    this.interval.textContent = interval && interval95(interval);
  }

  pointOf(state) {
    const estimate = this.head.pick(state);
    return estimate && { x: state.slow_time, ...estimate };
  }

  /** New readings are added at the end; once there are too many, each second one goes. */
  add(state) {
    const point = this.pointOf(state);
    if (point && this.points.length) this.points.push(point);
    if (this.points.length > 2 * SPARK_POINTS) this.points = this.points.filter((_, i) => i % 2 === this.points.length % 2);
    this.draw();
  }

  async load() {
    if (this.loading || !this.state || this.state.slow_time === null || Date.now() - this.loadedAt < RELOAD_MS) return;
    [this.loading, this.loadedAt] = [true, Date.now()];
    const base = `/api/v1/twins/${encodeURIComponent(this.id)}`;
    const { points, bands } = await historyOf(base, { most: LATEST, points: SPARK_POINTS }).catch(() => ({ points: [] }));
    const of = ({ quantities, elements }) => quantities[this.head.name] ?? elements[this.head.name];
    this.points = bands
      ? served(bands, of).flat().map(({ to, mean, lo, hi }) => ({ x: to, value: mean, lo, hi }))
      : points.map((point) => this.pointOf(point)).filter(Boolean);
    this.loading = false;
    this.draw();
  }

  draw() {
    if (!this.onScreen) return;
    const words = t("fleet.course", { quantity: this.head.title, n: this.points.length, value: this.value.textContent });
    this.picture.replaceChildren(sparkline(this.points, words));
    this.picture.dataset.points = this.points.length;
  }

  /** What changes as time goes by, though nothing arrives. */
  tick() {
    const { heard_ns: heard, slow_time: slow } = this.state;
    const text = slow === null ? "" : heard ? t("twin.last_seen", { ago: ago(Date.now() - heard / 1e6) }) : t("twin.no_message");
    if (this.seen.textContent !== text) this.seen.textContent = text;
  }
}

export class Fleet {
  constructor() {
    Object.assign(this, { cards: new Map(), states: [], most: MOST_CARDS, wanted: "" });
    this.root = make("section", undefined, "fleet");
    this.root.setAttribute("aria-label", t("fleet.title"));
    [this.title, this.summary] = [make("h2", t("fleet.title")), make("p", "", "facts summary")];
    this.find = make("input");
    Object.assign(this.find, { type: "search", placeholder: t("fleet.find"), autocomplete: "off" });
    this.find.setAttribute("aria-label", t("fleet.find_label"));
    this.find.addEventListener("input", () => { this.wanted = this.find.value.trim().toLowerCase(); this.arrange(); });
    this.list = make("ul", undefined, "cards");
    this.more = button(t("fleet.show_more"), () => { this.most += MOST_CARDS; this.arrange(); });
    const head = make("div", undefined, "heading");
    this.visits = make("p", "", "facts visits");
    this.visits.hidden = true;
    head.append(this.title, this.summary, this.find);
    this.verdict = make("p", "", "verdict");
    this.verdict.setAttribute("role", "status");
    this.composites = new Composites();
    this.root.append(head, this.verdict, this.visits, this.list, this.more, this.composites.root);
    this.watcher = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) this.see(this.cards.get(target.dataset.twin), isIntersecting);
    }, { rootMargin: "200px" });
  }

  see(card, onScreen) {
    if (!card) return;
    card.onScreen = onScreen;
    if (onScreen) { card.load(); card.draw(); }
  }

  hear(states) {
    this.states = states;
    this.arrange();
    this.composites.refresh();
    this.dispatch();
  }

  /** Where the inspection team goes this month, where something is to be decided; asked for every five minutes. */
  async dispatch() {
    const deciding = this.states.filter(({ registration, slow_time: slow }) => registration.decision && slow !== null).length;
    if (!deciding || (this.plannedFor === deciding && Date.now() - this.plannedAt < PLAN_MS)) return;
    [this.plannedAt, this.plannedFor] = [Date.now(), deciding];
    const told = await ask("/api/v1/fleet/plan?window_d=30", PLAN_MS).catch(() => null);
    if (!told) return;
    this.visits.hidden = false;
    this.visits.replaceChildren(...parts("fleet.visits", { plan: english(make("span", told.sentence)) }));
  }

  /** What is urgent comes first; among equals the order of registration stays, so that nothing jumps about. */
  arrange() {
    const states = this.states.filter(({ id, registration }) => `${id} ${registration.name ?? ""}`.toLowerCase().includes(this.wanted));
    const urgency = (state) => ORDER[urgencyOf(state)];
    const shown = states.toSorted((a, b) => urgency(a) - urgency(b)).slice(0, this.most), there = new Set(shown.map(({ id }) => id));
    for (const [id, card] of this.cards) if (!there.has(id)) this.drop(id, card);
    shown.forEach((state, i) => {
      const card = this.cards.get(state.id) ?? this.add(state.id);
      card.tell(state);
      if (card.onScreen) card.load();
      if (this.list.children[i] !== card.root) this.list.insertBefore(card.root, this.list.children[i] ?? null);
    });
    this.more.hidden = states.length <= this.most;
    this.find.hidden = this.states.length < FINDABLE;
    this.count(states.length);
  }

  count(found) {
    const of = (holds) => this.states.filter(holds).length, alarms = of((state) => limitsPassed(state)), changed = of((state) => changeOf(state));
    const said = [
      t("fleet.twins", { n: this.states.length }), alarms ? t("fleet.with_alarm", { n: alarms }) : t("fleet.no_alarm"),
      changed && t("fleet.changed", { n: changed }), t("fleet.valid", { n: of(({ valid }) => valid) }), t("fleet.online", { n: of(({ alive }) => alive) }),
      this.wanted && t("fleet.found", { n: found }),
    ];
    say(this.verdict, ...verdictOf(this.states));
    say(this.summary, alarms ? "bad" : "good", said.filter(Boolean).join(" \u00b7 "));
  }

  add(id) {
    const card = new Card(id);
    this.cards.set(id, card);
    this.watcher.observe(card.root);
    return card;
  }

  drop(id, card) {
    this.watcher.unobserve(card.root);
    card.root.remove();
    this.cards.delete(id);
  }

  tick() { for (const card of this.cards.values()) card.tick(); }
}
