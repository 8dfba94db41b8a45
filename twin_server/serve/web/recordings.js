// Recordings that the server keeps: given to it, got from it, played to its twins.
import { counted, locale, t } from "./language.js";
import { ask, send } from "./link.js";
import { toTwin } from "./route.js";
import { upload } from "./upload.js";
import { button, compose, composed, explain, make, number, say } from "./words.js";

const BASE = "/api/v1/recordings", PLAYING_MS = 700;
const PACES = [["", t("recordings.pace_fastest")], ["1", t("recordings.pace_recorded")], ...["10", "100"].map((pace) => [pace, t("recordings.pace_times", { pace })])];
const STATES = { playing: "waiting", done: "good", stopped: "away", failed: "bad" };

function sizeOf(bytes) {
  for (const [size, unit] of [[1e9, "GB"], [1e6, "MB"], [1e3, "kB"]]) if (bytes >= size) return `${number(bytes / size, 1)}\u202f${unit}`;
  return `${bytes}\u202f${t("unit.bytes")}`;
}

function spanOf({ start_ns: start, end_ns: end }) {
  if (start === null || !end) return "";
  const seconds = (end - start) / 1e9, [size, unit] = [[86400, "d"], [3600, "h"], [60, "min"], [1, "s"]].find(([each]) => seconds >= each) ?? [1, "s"];
  return `${new Date(start / 1e6).toLocaleString(locale)}, ${number(seconds / size, 1)}\u202f${unit}`;
}

/** A name may be that of a recording of several sites, each in a name space of its own. */
const keyOf = ({ name, site }) => JSON.stringify([site, name]);

/** What the server would make of the name: letters, digits, dots and dashes. */
const nameOf = (file) => file.name.replace(/[^A-Za-z0-9._-]+/g, "-").replace(/^[^A-Za-z0-9]+/, "");

export class Recordings {
  constructor() {
    this.rows = new Map();
    this.root = make("section", undefined, "recordings");
    this.root.setAttribute("aria-label", t("recordings.title"));
    this.root.hidden = true;
    this.problem = make("p", "", "notice");
    this.problem.dataset.state = "bad";
    this.problem.setAttribute("role", "alert");
    this.problem.hidden = true;
    this.none = make("div", undefined, "notice");
    this.none.hidden = true;
    [this.told, this.list] = [make("p", "", "facts"), make("ul", undefined, "cards wide-cards")];
    this.told.setAttribute("role", "status");
    const head = make("div", undefined, "heading");
    head.append(make("h2", t("recordings.title")), this.told);
    this.root.append(head, this.giving(), make("p", t("access.recordings"), "facts for-viewers"), this.problem, this.none, this.list);
  }

  giving() {
    this.drop = make("div", undefined, "drop writes");
    const label = make("label", `${t("recordings.upload")} `);
    this.file = make("input");
    Object.assign(this.file, { type: "file", accept: ".mcap" });
    this.file.addEventListener("change", () => this.give(this.file.files[0]));
    label.append(this.file);
    [this.bar, this.way] = [make("progress"), make("span", "", "facts")];
    this.bar.max = 1;
    this.bar.hidden = true;
    this.bar.setAttribute("aria-label", t("recordings.upload_progress"));
    this.drop.append(label, this.bar, this.way);
    this.drop.addEventListener("dragover", (event) => { event.preventDefault(); this.drop.dataset.over = true; });
    this.drop.addEventListener("dragleave", () => { delete this.drop.dataset.over; });
    this.drop.addEventListener("drop", (event) => {
      event.preventDefault();
      delete this.drop.dataset.over;
      this.give(event.dataTransfer.files[0]);
    });
    return this.drop;
  }

  async give(file) {
    if (!file) return;
    [this.bar.hidden, this.file.disabled] = [false, true];
    this.way.textContent = `${file.name}, ${sizeOf(file.size)}`;
    await this.attempt(() => upload(`${BASE}/${encodeURIComponent(nameOf(file))}`, file, (share) => {
      this.bar.value = share;
      if (share === 1) this.way.textContent = t("recordings.checking", { name: file.name });
    }));
    [this.bar.hidden, this.file.disabled, this.file.value, this.way.textContent] = [true, false, "", ""];
  }

  /** Do something whose answer is the list as it is then, or say why not. */
  async attempt(act) {
    this.problem.hidden = true;
    try { this.tell(await act()); } catch (error) {
      explain(this.problem, error);
      this.problem.hidden = false;
    }
  }

  async refresh() {
    clearTimeout(this.again);
    const found = await ask(BASE).catch(() => null);
    if (found) this.tell(found);
  }

  tell({ kept, max_bytes: most, recordings }) {
    this.drop.hidden = !kept;
    this.none.hidden = recordings.length > 0;
    this.none.textContent = kept
      ? t("recordings.none")
      : t("recordings.not_kept");
    say(this.told, "", kept ? t("recordings.kept", { n: recordings.length, size: sizeOf(most) }) : "");
    const keys = new Set(recordings.map(keyOf));
    for (const [key, row] of this.rows) if (!keys.has(key)) { row.root.remove(); this.rows.delete(key); }
    recordings.forEach((one, i) => {
      const row = this.rows.get(keyOf(one)) ?? this.row(one);
      this.fill(row, one);
      if (this.list.children[i] !== row.root) this.list.insertBefore(row.root, this.list.children[i] ?? null);
    });
    clearTimeout(this.again);
    const playing = recordings.some(({ replay }) => replay?.state === "playing");
    if (playing && !this.root.hidden) this.again = setTimeout(() => this.refresh(), PLAYING_MS);
  }

  row({ name, site }) {
    const of = site ? `?site=${encodeURIComponent(site)}` : "", path = `${BASE}/${encodeURIComponent(name)}`;
    const root = make("li", undefined, "card"), acts = make("p", undefined, "acts");
    root.dataset.recording = name;
    const [about, inside, problem, replay] = ["facts", "facts", "alarm", "replay"].map((kind) => make("p", "", kind));
    const pace = make("select"), paced = make("label", `${t("recordings.at_pace")} `, "field writes"), get = make("a", t("recordings.download"), "act");
    get.href = path + of;
    get.download = name;
    for (const [value, text] of PACES) {
      const option = make("option", text);
      option.value = value;
      pace.append(option);
    }
    paced.append(pace);
    const play = button(t("recordings.replay"), () => this.attempt(() => send(`${path}/replay${of}`, "POST", pace.value ? { speed: Number(pace.value) } : {})), "writes");
    const stop = button(t("recordings.stop"), () => this.attempt(() => send(`${path}/replay${of}`, "DELETE")), "writes");
    const drop = button(t("recordings.delete"), () => {
      if (confirm(t("recordings.confirm_delete", { name }))) this.attempt(() => send(path + of, "DELETE"));
    }, "administers");
    const [pill, bar, said] = [make("span", "", "pill"), make("progress"), make("span", "", "facts")];
    bar.setAttribute("aria-label", t("recordings.replay_progress", { name }));
    replay.append(pill, bar, said);
    acts.append(get, play, paced, stop, drop);
    root.append(make("h3", site ? `${name} (${site})` : name), about, inside, problem, replay, acts);
    const row = { root, about, inside, problem, replay, pill, bar, said, play, paced, stop, drop };
    this.rows.set(keyOf({ name, site }), row);
    return row;
  }

  fill(row, one) {
    row.about.textContent = [sizeOf(one.bytes), spanOf(one)].filter(Boolean).join(" \u00b7 ");
    const twins = one.twins.map((id) => {
      const link = make("a", id);
      link.href = toTwin(id);
      return link;
    });
    const counts = Object.entries(one.messages).map(([stream, count]) => `${counted(count)} ${stream}`).join(", ");
    row.inside.replaceChildren(...twins.flatMap((link, i) => i ? [", ", link] : [link]), counts && `: ${counts}`);
    row.problem.dataset.state = "bad";
    row.problem.replaceChildren(...(one.problem ? ["\u25b2 ", composed("span", one.problem)] : []));
    const { replay } = one, playing = replay?.state === "playing";
    row.replay.hidden = !replay;
    if (replay) {
      say(row.pill, STATES[replay.state], t(`replay.${replay.state}`));
      Object.assign(row.bar, { max: Math.max(1, replay.total), value: replay.done, hidden: !playing });
      compose(row.said, replay.sentence);
    }
    for (const control of [row.play, row.paced]) control.hidden = playing || Boolean(one.problem);
    row.stop.hidden = !playing;
    row.drop.hidden = playing;
  }
}
