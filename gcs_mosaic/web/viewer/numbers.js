// @ts-check
// Numbers as people write them.

import { t } from "/viewer/words.js";

/**
 * Metres, with a comma or a point, and perhaps with their unit. Throws an Error with a sentence for anything else: what is not
 * understood must not become another number without a word.
 * @param {string} text
 */
export function metresIn(text) {
  const metres = Number(bare(text, /\s*m$/i));
  if (metres > 0) return metres;
  throw new Error(t("{text} are no metres: write a number, as 12.5.", { text: text.trim() || "0" }));
}

/**
 * Per cent, from 1 to 99, perhaps with their sign; throws as above.
 * @param {string} text
 */
export function percentIn(text) {
  const percent = Number(bare(text, /\s*%$/));
  if (percent >= 1 && percent <= 99) return percent;
  throw new Error(t("{text} are no per cent from 1 to 99: write a number, as 80.", { text: text.trim() || "0" }));
}

/** @param {string} text @param {RegExp} unit */
function bare(text, unit) {
  return text.trim().replace(unit, "").replace(",", ".") || NaN;
}
