// @ts-check
// Keys for the hand that does not hold the tablet, and a sheet that tells them.

import { byId } from "/viewer/dom.js";
import { PANELS, openPanel, togglePanel } from "/viewer/panels.js";
import { t } from "/viewer/words.js";

const press = (id) => byId(id).click();
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
  ["1 … 9, 0", "Flight, Islands, Layers, Fly the gaps, Review, Hints, Measure, Finds, Anchor, On other maps", null],
  ["+  −", "Nearer, farther", null],
  ["← ↑ → ↓", "Move the map; step through originals", null],
  ["b", "Blink between two originals", null],
  ["s", "All looks at a place side by side", null],
  ["Esc", "End what was begun, close what is open", null],
];

export function listenForKeys() {
  const sheet = byId("help");
  const list = byId("help-keys");
  for (const [key, said] of KEYS) {
    const [term, words] = ["dt", "dd"].map((tag) => document.createElement(tag));
    term.append(Object.assign(document.createElement("kbd"), { textContent: key }));
    words.textContent = t(said);
    list.append(term, words);
  }
  byId("help-close").onclick = () => sheet.close();
  byId("open-help").onclick = showSheet;
  document.addEventListener("keydown", onKey);
}

function onKey({ key, target, ctrlKey, altKey, metaKey }) {
  const isTyping = target.matches?.("input:not([type=range], [type=checkbox]), textarea, select");
  if (ctrlKey || altKey || metaKey || isTyping || document.querySelector("dialog[open]")) return;
  const panel = /^[0-9]$/.test(key) && PANELS[(Number(key) + 9) % 10];
  if (panel) togglePanel(panel);
  else if (byId("originals").hidden) KEYS.find(([name]) => name === key)?.[2]?.();
}

function showSheet() {
  byId("help").showModal();
}
