// All twins at a glance: what each is, whether it is to be relied on, when it was last heard of, what is wrong.
import { served } from "./buckets.js";
import { Composites } from "./composites.js";
import { ANSWERS, answerOf, fleetConclusion, moodOf, summaryOf } from "./conclusion.js";
import { parts, t } from "./language.js";
import { ask } from "./link.js";
import { toTwin } from "./route.js";
import { sparkline } from "./sparkline.js";
import { historyOf } from "./window.js";
import { ago, button, composed, interval95, make, say, spoken, standing, titleOf } from "./words.js";

const LATEST = 1000, SPARK_POINTS = 200, MOST_CARDS = 100, FINDABLE = 9, RELOAD_MS = 60000, PLAN_MS = 300000;
const WORD = {
  valid: ["good", `\u2713 ${t("standing.valid")}`], learning: ["waiting", `\u2026 ${t("standing.learning")}`],
  inseparable: ["waiting", `\u25c7 ${t("standing.inseparable")}`], invalid: ["bad", `\u2715 ${t("standing.invalid")}`],
  none: ["waiting", `\u2026 ${t("standing.none")}`],
};
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
    const before = this.state, begun = state.slow_time !== null, summary = summaryOf(state);
    this.state = state;
    const name = state.registration.name || this.id;
    if (this.link.textContent !== name) this.link.textContent = name;
    this.sub.textContent = name === this.id ? "" : this.id;
    say(this.validity, ...WORD[begun ? standing(state) : "none"]);
    say(this.edge, state.alive ? "good" : "away", state.alive ? `\u25cf ${t("fleet.agent_online")}` : `\u25cb ${t("fleet.agent_offline")}`);
    say(this.alarm, moodOf(state), summary || t("fleet.no_alarm"));
    this.root.dataset.answer = answerOf(state);
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
    this.visits.replaceChildren(...parts("fleet.visits", { plan: composed("span", told.sentence) }));
  }

  /** What is urgent comes first; among equals the order of registration stays, so that nothing jumps about. */
  arrange() {
    const states = this.states.filter(({ id, registration }) => `${id} ${registration.name ?? ""}`.toLowerCase().includes(this.wanted));
    const urgency = (state) => ANSWERS.indexOf(answerOf(state));
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
    const of = (holds) => this.states.filter(holds).length, alarms = of(({ raised }) => raised.length);
    const changed = of(({ suspects = [], raised }) => suspects.length && !raised.length);
    const said = [
      t("fleet.twins", { n: this.states.length }), alarms ? t("fleet.with_alarm", { n: alarms }) : t("fleet.no_alarm"),
      changed && t("fleet.changed", { n: changed }), t("fleet.valid", { n: of(({ valid }) => valid) }), t("fleet.online", { n: of(({ alive }) => alive) }),
      this.wanted && t("fleet.found", { n: found }),
    ];
    say(this.verdict, ...fleetConclusion(this.states));
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
