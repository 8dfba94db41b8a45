// The language of the page: messages of a catalogue, and numbers and dates as its readers write them.

const FOLDER = "/assets/messages", FALLBACK = "en", CHOSEN = "slowtime.language";
const MINUS = "\u2212";

const fetched = async (name) => {
  const answer = await fetch(`${FOLDER}/${name}.json`);
  if (!answer.ok) throw new Error(`${FOLDER}/${name}.json: ${answer.status} ${answer.statusText}`);
  return answer.json();
};

/** What was chosen before; a browser may keep nothing. */
function remembered() {
  try { return localStorage.getItem(CHOSEN); } catch { return null; }
}

/** The first tag that is wanted and offered, `de-AT` as `de` where there is no own catalogue of it. */
function negotiated(wanted, offered) {
  for (const tag of wanted.filter(Boolean).map((each) => each.toLowerCase())) {
    const found = offered.find((each) => each.toLowerCase() === tag) ?? offered.find((each) => each.toLowerCase() === tag.split("-")[0]);
    if (found) return found;
  }
  return FALLBACK;
}

// English is read at the same time as the list, since most want it and since it fills what another catalogue lacks.
const english = fetched(FALLBACK);

/** Tag of each language → its own name. */
export const LANGUAGES = await fetched("languages").catch(() => ({}));

const asked = () => new URLSearchParams(location.search).get("lang");

/** Tag of the language of the page: from the address, else chosen before, else of the browser. */
export const language = negotiated([asked(), remembered(), ...navigator.languages], Object.keys(LANGUAGES));

/** The tag by which numbers and dates are written: a region of the browser's, where it speaks this language. */
export const locale = navigator.languages.find((tag) => tag.split("-")[0] === language.split("-")[0]) ?? language;

const own = language === FALLBACK ? {} : await fetched(language).catch(() => ({}));
const messages = { ...await english, ...own };
const plurals = new Intl.PluralRules(language);
const signOf = (sought) => new Intl.NumberFormat(language).formatToParts(12345.5).find(({ type }) => type === sought)?.value ?? "";
const POINT = signOf("decimal"), GROUP = signOf("group");

/** English sentence of the server → that of this language; `{names}` stand for its values. */
export const sentences = own.sentences ?? {};

/** A number that JavaScript has written, as the language writes it: its decimal sign, and a true minus sign. */
export const localized = (text) => text.replaceAll("-", MINUS).replace(".", POINT);

/** A number that the server has written for English readers, with the signs of this language. */
export const grouped = (text) => text.replace(/[.,]/g, (sign) => sign === "." ? POINT : GROUP);

/** A count with its thousands set apart. */
export const counted = (n) => n.toLocaleString(locale);

/** The words of a message; one with forms is an object by plural category, chosen by `n`. */
function wordsOf(key, { n } = {}) {
  const message = messages[key] ?? key;
  return typeof message === "string" ? message : message[plurals.select(n)] ?? message.other;
}

const PLACE = /\{(\w+)\}/;
const valueOf = (value) => typeof value === "number" ? localized(`${value}`) : value;

/** The message `key`, with `values` in the places of their names. */
export const t = (key, values = {}) => wordsOf(key, values).split(PLACE).map((part, i) => (i % 2 ? valueOf(values[part]) : part)).join("");

/** The same as nodes: a value may be an element, such as a link. */
export const parts = (key, values) => wordsOf(key, values).split(PLACE).map((part, i) => (i % 2 ? valueOf(values[part]) : part)).filter((part) => part !== "");

/** The words of `root` that HTML holds: elements in them stand in the places of their `data-slot`. */
export function translate(root) {
  for (const element of root.querySelectorAll("[data-message]")) {
    const slots = Object.fromEntries([...element.children].map((child) => [child.dataset.slot, child]));
    element.replaceChildren(...parts(element.dataset.message, slots));
  }
  for (const element of root.querySelectorAll("[data-label]")) element.setAttribute("aria-label", t(element.dataset.label));
}

/** Remember a language and show the page in it; an address that names one names this one then. */
function choose(tag) {
  try { localStorage.setItem(CHOSEN, tag); } catch { /* the address keeps it then */ }
  const address = new URL(location.href);
  if (address.searchParams.has("lang") || remembered() !== tag) address.searchParams.set("lang", tag);
  if (address.href === location.href) location.reload();
  else location.assign(address);
}

/** Offer every language by its own name. */
export function offerLanguages(select) {
  select.replaceChildren(...Object.entries(LANGUAGES).map(([tag, name]) => Object.assign(new Option(name, tag, false, tag === language), { lang: tag })));
  select.addEventListener("change", () => choose(select.value));
  select.hidden = select.options.length < 2;
}
