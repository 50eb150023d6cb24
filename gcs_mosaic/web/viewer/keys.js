// @ts-check
// Keys for the hand that does not hold the tablet, and a sheet that tells them.

import { byId, element } from "/viewer/dom.js";
import { PANELS, openPanel, togglePanel } from "/viewer/panels.js";
import { t } from "/viewer/words.js";

const press = (id) => byId(id).click();
const DIGITS = [..."1234567890"]; // of the panels, in their order; those beyond have none
/** @type {[string, string, (() => void) | null][]} key, what it does, action */
const KEYS = [
  ["?", "This sheet", () => showSheet()],
  ["m", "Mark a find", () => press("finds-mark")],
  ["a", "Whole map", () => press("all")],
  ["n", "Follow newest", () => press("newest")],
  ["g", "Gaps", () => press("gaps")],
  ["l", "Length", () => {
    openPanel("measure");
    press("measure-line");
  }],
  ["r", "Flight up", () => press("turn-flight-up")],
  ["t", "North up", () => press("turn-north-up")],
  ["f", "Full screen", () => press("full")],
  ["+  −", "Nearer, farther", null],
  ["← ↑ → ↓", "Move the map; step through originals", null],
  ["↵", "Point at the middle of the map, which has the keyboard", null],
  ["b", "Blink between two originals", null],
  ["s", "All looks at a place side by side", null],
  ["Esc", "End what was begun, close what is open", null],
];

export function listenForKeys() {
  const sheet = byId("help");
  const list = byId("help-keys");
  list.append(...told("1 … 9, 0", DIGITS.map((digit, at) => `${digit}\u00a0${byId(PANELS[at]).ariaLabel}`).join(", ")));
  for (const [key, said] of KEYS) list.append(...told(key, t(said)));
  byId("help-close").onclick = () => sheet.close();
  byId("open-help").onclick = showSheet;
  document.addEventListener("keydown", onKey);
}

function told(key, words) {
  return [element("dt", {}, element("kbd", { textContent: key })), element("dd", { textContent: words })];
}

function onKey({ key, target, ctrlKey, altKey, metaKey }) {
  const isTyping = target.matches?.("input:not([type=range], [type=checkbox]), textarea, select");
  if (ctrlKey || altKey || metaKey || isTyping || document.querySelector("dialog[open]")) return;
  const panel = PANELS[DIGITS.indexOf(key)];
  if (panel) togglePanel(panel);
  else if (byId("originals").hidden) KEYS.find(([name]) => name === key)?.[2]?.();
}

function showSheet() {
  byId("help").showModal();
  byId("help").scrollTop = 0; // its button, which is last, has the keyboard
}
