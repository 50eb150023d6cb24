// @ts-check
// Panels beside the map (below it on a narrow screen): one at a time. They belong to the phases of a search (fly, search, report)
// and to the page itself; each phase has a button, which opens the panel of it that was open last, and a tab for each of them.
// A panel is a `section.panel` of the page, with an id, an `aria-label` and its phase; it is told by the events `opened` and
// `closed`.

import { byId } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";

/** @type {NodeListOf<HTMLElement>} */
const found = document.querySelectorAll("section.panel");
const panels = [...found];
const side = byId("side");
/** @type {Map<string, string>} the panel of each phase that was open last */
const last = new Map();

/** Their ids, in the order of the buttons. */
export const PANELS = panels.map(({ id }) => id);

/** Make a tab for each panel, and let the phases' buttons open them; Escape closes the open one, wherever the keyboard is. */
export function makePanels() {
  for (const panel of [...panels].reverse()) last.set(panel.dataset.phase, panel.id);
  for (const panel of panels) {
    const tab = Object.assign(document.createElement("button"), { type: "button", id: `open-${panel.id}`, textContent: panel.ariaLabel });
    tab.dataset.phase = panel.dataset.phase;
    tab.onclick = () => openPanel(panel.id);
    byId("tabs").append(tab);
  }
  for (const phase of last.keys()) {
    byId(`phase-${phase}`).onclick = () => (openPhase() === phase ? closePanels() : openPanel(last.get(phase)));
  }
  byId("side-close").onclick = closePanels;
  closeByEscape("panel", () => !side.hidden, closePanels);
}

/** Open a panel, or close it if it is open. */
export function togglePanel(id) {
  if (byId(id).hidden) openPanel(id);
  else closePanels();
}

export function openPanel(id) {
  const { phase } = byId(id).dataset;
  last.set(phase, id);
  for (const panel of panels) if (panel.id !== id) setOpen(panel, false);
  side.hidden = false;
  setOpen(byId(id), true);
  byId("side-title").textContent = byId(id).ariaLabel;
  /** @type {NodeListOf<HTMLElement>} */
  const tabs = document.querySelectorAll("#tabs button");
  for (const tab of tabs) {
    tab.hidden = tab.dataset.phase !== phase;
    tab.setAttribute("aria-current", String(tab.id === `open-${id}`));
  }
  byId("tabs").hidden = panels.filter((panel) => panel.dataset.phase === phase).length < 2;
  side.scrollTop = 0;
  showTab(byId(`open-${id}`));
  showPhase(phase);
}

/** Close what is open, and give the keyboard back to its button, but for whom moves the map with it. */
export function closePanels() {
  const phase = openPhase();
  for (const panel of panels) setOpen(panel, false);
  side.hidden = true;
  showPhase("");
  if (phase && !byId("map").contains(document.activeElement)) byId(`phase-${phase}`).focus();
}

/** Whether nothing lies over the map or beside it that somebody may be reading instead of looking. */
export function isMapFree() {
  return [side, byId("originals"), byId("sheet")].every(({ hidden }) => hidden) && !document.querySelector("dialog[open]");
}

/** Where a low window has all tabs in one line, that of the open panel is in sight. */
function showTab(tab) {
  const tabs = byId("tabs");
  tabs.scrollLeft = tab.offsetLeft - tabs.offsetLeft - (tabs.clientWidth - tab.offsetWidth) / 2;
}

function openPhase() {
  return panels.find((panel) => !panel.hidden)?.dataset.phase ?? "";
}

function showPhase(open) {
  for (const phase of last.keys()) byId(`phase-${phase}`).setAttribute("aria-expanded", String(phase === open));
}

function setOpen(panel, isOpen) {
  if (panel.hidden !== isOpen) return;
  panel.hidden = !isOpen;
  panel.dispatchEvent(new CustomEvent(isOpen ? "opened" : "closed"));
}
