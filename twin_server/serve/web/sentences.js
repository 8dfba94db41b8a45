// Sentences that the server has composed, in the language of the page as far as its catalogue has them.
import { grouped, sentences } from "./language.js";

/** Values that stay as somebody has written or named them. */
const VERBATIM = ["person", "reason", "note", "fields", "name", "element", "boot", "receivers", "why", "path", "twins", "date"];
const BETWEEN_SENTENCES = /(?<=[.?!]) (?=[A-Z“])/;
/** What a value may be: one word, anything, or in general anything within one sentence. */
const VALUES = { element: "((?:(?! has |[:;,]).)+)", reason: "(.+)", reasons: "(.+)", note: "(.+?)", alarm: "(.+)" };
const VALUE = "((?:(?![.?!] [A-Z“]).)+?)";
/** A number as the server writes it, which is no part of a date or of a name. */
const NUMBER = /(?<![\w.:,])(?<!\w-)(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?![\w:]|-\d|[.,]\d)/g;

const escaped = (text) => text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");

/** `{ pattern, names, own }` of a sentence with placeholders. */
function compiled([english, own]) {
  const parts = english.split(/\{(\w+)\}/);
  const pattern = parts.map((part, i) => (i % 2 ? VALUES[part] ?? VALUE : escaped(part))).join("");
  return { pattern: new RegExp(`^${pattern}$`), names: parts.filter((_, i) => i % 2), own };
}

const patterns = Object.entries(sentences).filter(([english]) => english.includes("{")).map(compiled);
const told = new Map();

/** A whole sentence or phrase in the language of the page; null where the catalogue lacks it. */
function found(text) {
  if (text in sentences) return sentences[text];
  for (const { pattern, names, own } of patterns) {
    const match = pattern.exec(text);
    if (match) return own.replace(/\{(\w+)\}/g, (_, name) => valueOf(name, match[1 + names.indexOf(name)]));
  }
  return null;
}

/** A value: itself a phrase, which may begin a sentence, else with its numbers as the language writes them. */
function valueOf(name, text) {
  if (VERBATIM.includes(name)) return text;
  const own = translated(text);
  if (own !== null) return own;
  const inside = translated(text[0].toLowerCase() + text.slice(1));
  return inside === null ? text.replace(NUMBER, grouped) : inside[0].toUpperCase() + inside.slice(1);
}

/** Words of the server in the language of the page: as one sentence, else sentence by sentence; null where one of them is unknown. */
export function translated(text) {
  if (!patterns.length || !text) return null;
  if (told.size > 1000) told.clear();
  if (!told.has(text)) {
    const parts = text.split(BETWEEN_SENTENCES), each = () => parts.map(found);
    const own = found(text) ?? (parts.length > 1 && each().every((part) => part !== null) ? each().join(" ") : null);
    told.set(text, own);
  }
  return told.get(text);
}
