// Parts of forms: a labelled control, a choice, a number, and who changes something and why.
import { t } from "./language.js";
import { make } from "./words.js";

/** `{ label, input }`, appended to `fields`. */
export function labelled(text, input, fields) {
  const label = make("label", `${text} `);
  label.append(input);
  fields.append(label);
  return { label, input };
}

export const choices = (select, of) => select.append(...Object.entries(of).map(([value, text]) => Object.assign(make("option", text), { value })));

export const written = (more) => Object.assign(make("input"), { type: "text", autocomplete: "off", ...more });

/** Fields for a name and a reason; gives a function that reads them. */
export function authorIn(form) {
  const person = labelled(t("form.name"), written({ autocomplete: "name", maxLength: 100 }), form);
  const reason = labelled(t("form.reason"), written({ maxLength: 2000 }), form);
  return () => ({ person: person.input.value.trim() || null, text: reason.input.value.trim() });
}
