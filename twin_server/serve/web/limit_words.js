// Limits of a registration as rows and as sentences.
import { t } from "./language.js";
import { digits, titleOf } from "./words.js";

export const scaleOf = (quantity) => quantity === "frequency_hz" ? [1, "Hz"] : [100, "%"];

/** What a limit is of; one of all elements is named so. */
export const nameOf = (quantity) => quantity === "elements" ? t("limits.any_element") : titleOf(quantity);

/** Limits of a registration in rows: an alarm has a side, a threshold of the forecast is a question. */
export const rowsOf = ({ alarms = [], forecast }) => [
  ...alarms.map(({ quantity, below, above, certainty }) => ({ quantity, side: above === null || above === undefined ? "below" : "above", value: below ?? above, certainty })),
  ...(forecast?.thresholds ?? []).map(({ quantity, at }) => ({ quantity, side: "at", value: at, certainty: null })),
];

export function said({ quantity, side, value, certainty }) {
  const [scale, unit] = scaleOf(quantity), limit = `${digits(scale * value, 4)}\u202f${unit}`;
  return t(`limits.said_${side}`, { quantity: nameOf(quantity), limit, certainty: certainty === null ? "" : `${digits(100 * certainty, 4)}\u202f%` });
}
