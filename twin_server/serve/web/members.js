// Members compared with the reference period, in words: which have changed, how probable each is, and how rare false alarms are.
import { t } from "./language.js";
import { number } from "./words.js";

const NARROW = "\u202f", LEAST_SHARE = 0.005;

const percent = (x, places = 0) => `${number(100 * x, places)}${NARROW}%`;
const sizeOf = ({ loss, sd }) => `${percent(loss, sd < 0.01 ? 1 : 0)} ± ${percent(sd, sd < 0.01 ? 1 : 0)}`;

/** The set of one changed member: its name and loss, or all that it may be, the likeliest first. */
function setOf(some) {
  if (some.length === 1) return t("elements.lost.stiffness", { element: some[0].name, size: sizeOf(some[0]) });
  const each = some.map((one) => t("members.candidate", { name: one.name, share: percent(one.probability), size: sizeOf(one) }));
  return t("members.one_of", { members: each.join("; ") });
}

const VERDICTS = {
  unchanged: () => t("members.unchanged"),
  changed: ({ sets }) => `${sets.map(setOf).join("; ")}.`,
  undecided: () => t("members.undecided"),
};

/** What the latest comparison says, and at which rate of false alarms; before the first, how many readings it needs. */
export function membersSaid(assessment, { readings }) {
  if (!assessment) return t("members.waiting", { n: readings });
  const { verdict, reference_readings: reference, false_alarms_per_year: rate } = assessment;
  const said = (VERDICTS[verdict] ?? (() => t("members.incomparable")))(assessment);
  return `${said} ${t("members.rate", { n: assessment.readings, reference, rate: number(rate, rate < 1 ? 2 : 0) })}`;
}

/** "62 % probable" of a member that may have changed; empty for others. */
export function probabilityOf(assessment, name) {
  const share = assessment?.probability[name] ?? 0;
  return share < LEAST_SHARE ? "" : t("members.probability", { share: percent(share) });
}
