// What people have recorded of an asset, in words.
import { t } from "./language.js";
import { QUANTITIES, digits } from "./words.js";

const percent = (share) => `${digits(100 * share, 3)}\u202f%`;
const signed = (share) => `${share > 0 ? "+" : ""}${percent(share)}`;

/** What was restored, found or built in, in a few words; nothing of a note. */
function resultOf({ kind, repair, replacement, measured, detection }) {
  if (kind === "repair") {
    const { restored_share: share = null, restored_share_sd: sd = 0 } = repair ?? {};
    if (share === null) return t("told.share_unknown");
    return share === 1 && sd === 0 ? t("told.perfect") : t("told.share", { share: percent(share), sd: percent(sd) });
  }
  if (kind === "replacement") return replacement?.change === null ? t("told.part_unknown") : t("told.part", { change: signed(replacement?.change ?? 0) });
  if (measured) return t("told.measured", { change: signed(measured.value), sd: percent(measured.sd) });
  return detection ? t(detection.detected ? "told.found" : "told.not_found") : "";
}

const insideOf = (quantity) => QUANTITIES[quantity] ? t(`quantity.${quantity}.inside`) : quantity;

/** An event as a sentence; names of elements, and what somebody wrote, stay as they are. */
export function saidOf(event) {
  const { kind, quantity, person, reverses, text } = event, result = resultOf(event);
  if (reverses !== null) return [t("told.taken_back", { person, event: reverses }), text].filter(Boolean).join(" ");
  const what = quantity === null ? t(`record.${kind}`) : t("told.of", { kind: t(`record.${kind}`), quantity: insideOf(quantity) });
  return [t(result ? "told.result" : "told.event", { what, person, result }), text].filter(Boolean).join(" ");
}
