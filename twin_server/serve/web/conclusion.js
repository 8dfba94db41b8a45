// Whether anything is wrong: the server's conclusion of each twin, and of a fleet the most urgent of them, in words.
import { language, t } from "./language.js";
import { composed, digits, make, suspected, titleOf, whenOf } from "./words.js";

const MOODS = { act: "bad", watch: "waiting", cannot_say: "waiting", no: "good" };
const SIGNS = { act: "\u25b2", watch: "\u25b3", cannot_say: "\u25cb", no: "\u2713" };
/** Answers, the most urgent first. */
export const ANSWERS = Object.keys(MOODS);
/** Kinds whose details the page says itself, in its language; of the others the server's sentence follows. */
const WHOLE = ["limit_passed", "changed", "unexplained_change", "model_disagrees", "no_readings", "agent_offline", "learning"];
const NAMED = 3;

const NONE = { answer: "cannot_say", findings: [], next: null };
const conclusionOf = (state) => state.conclusion ?? NONE;
export const answerOf = (state) => conclusionOf(state).answer;
export const moodOf = (state) => MOODS[answerOf(state)];

/** The event that raised an alarm, if the latest events have it. */
const raisedBy = (events, { quantity, side, limit }) => events.findLast(({ kind, details }) => (
  kind === "alarm" && details.quantity === quantity && details.side === side && details.limit === limit
));

/** Which limits of alarms are passed, and since when as far as the events tell, in a few words; nothing where none is. */
function limitsPassed(state, events = []) {
  const said = (state.raised ?? []).map((alarm) => {
    const { quantity, side, limit } = alarm, event = raisedBy(events, alarm);
    const [size, unit] = quantity === "frequency_hz" ? [limit, "Hz"] : [100 * limit, "%"];
    const words = t(`alarm.${side}`, { quantity: titleOf(quantity), limit: `${digits(size, 3)}\u202f${unit}` });
    return event ? t("conclusion.since", { finding: words, time: whenOf(event, state) }) : words;
  });
  return said.join("; ");
}

/** Words for each kind of finding of a twin, the most urgent first. */
function kindsOf(state, events) {
  const kinds = [...new Set(conclusionOf(state).findings.map(({ kind }) => kind))];
  return kinds.map((kind) => {
    if (kind === "limit_passed") return [kind, limitsPassed(state, events) || t(`finding.${kind}`)];
    if (kind === "changed") return [kind, (state.suspects ?? []).map((word) => t("fleet.has_changed", { element: suspected(word) })).join("; ") || t(`finding.${kind}`)];
    return [kind, t(`finding.${kind}`)];
  });
}

/** What is most urgent of one twin, in a few words; nothing where nothing is wrong. */
export function summaryOf(state) {
  const answer = answerOf(state), said = kindsOf(state).map(([, words]) => words);
  return said.length ? `${SIGNS[answer]} ${said.join("; ")}` : "";
}

/** Fill an element with the answer for one twin: why, and what to do next; of a past instant, with the alarms of it. */
export function showConclusion(element, state, at, events) {
  const passed = at ? limitsPassed(state, events) : "";
  element.hidden = at ? !passed : !state.conclusion;
  if (element.hidden) return;
  if (at) {
    delete element.told;
    element.dataset.state = MOODS.act;
    element.replaceChildren(`${SIGNS.act} ${passed}`);
    return;
  }
  const { answer, findings } = state.conclusion, key = JSON.stringify([state.conclusion, state.raised, state.suspects, events.at(-1)?.number]);
  if (element.told === key) return;
  element.told = key;
  element.dataset.state = MOODS[answer];
  element.dataset.answer = answer;
  const said = kindsOf(state, events).map(([kind, words]) => {
    const item = make("li", `${words[0].toLocaleUpperCase(language)}${words.slice(1)}.`);
    const details = WHOLE.includes(kind) ? [] : findings.filter((one) => one.kind === kind);
    for (const { text } of details) item.append(" ", composed("span", text, "interval"));
    return item;
  });
  const next = findings.length ? [" ", make("em", t("conclusion.next", { act: t(`next.${findings[0].kind}`) }))] : [], list = make("ul");
  list.append(...said);
  element.replaceChildren(make("strong", `${SIGNS[answer]} ${t("fleet.is_anything_wrong", { answer: t(`conclusion.${answer}`) })}`), ...next, ...(said.length ? [list] : []));
}

const nameOf = ({ id, registration }) => registration.name || id;

/** `[mood, sentence]`: whether anything is wrong with a fleet; never "no" while nothing new is known of one of its twins. */
export function fleetConclusion(states) {
  const answer = ANSWERS.find((each) => states.some((state) => answerOf(state) === each)) ?? "no";
  const of = new Map();
  for (const state of states) for (const [kind, words] of kindsOf(state)) of.set(kind, [...(of.get(kind) ?? []), [state, words]]);
  const said = [...of].map(([kind, those]) => {
    const named = those.slice(0, NAMED).map(([state, words]) => (kind === "limit_passed" || kind === "changed" ? `${nameOf(state)} (${words})` : nameOf(state)));
    const names = those.length > NAMED ? t("fleet.more", { names: named.join(", "), n: those.length - NAMED }) : named.join(", ");
    return t("fleet.finding", { n: those.length, all: states.length, finding: t(`finding.${kind}`), names });
  });
  const calm = answer === "no" ? [t("fleet.nothing_wrong", { n: states.length })] : [];
  return [MOODS[answer], [t("fleet.is_anything_wrong", { answer: t(`conclusion.${answer}`) }), ...calm, ...said].join(" ")];
}
