// @ts-check
// Panels beside the map (below it on a narrow screen): one at a time, each opened by its button.
// A panel is a `section.panel` of the page, with an id and an `aria-label`; it is told by the events `opened` and `closed`.

import { byId } from "/viewer/dom.js";

/** @type {NodeListOf<HTMLElement>} */
const found = document.querySelectorAll("section.panel");
const panels = [...found];
const side = byId("side");

/** Make a button for each panel; Escape closes the open one. */
export function makePanels() {
  for (const panel of panels) {
    const button = Object.assign(document.createElement("button"), { type: "button", id: `open-${panel.id}`, textContent: panel.ariaLabel });
    button.setAttribute("aria-controls", panel.id);
    button.setAttribute("aria-expanded", "false");
    button.onclick = () => (panel.hidden ? openPanel(panel.id) : closePanels());
    byId("tools").append(button);
  }
  byId("side-close").onclick = closePanels;
  side.addEventListener("keydown", ({ key }) => key === "Escape" && closePanels());
}

export function openPanel(id) {
  for (const panel of panels) setOpen(panel, panel.id === id);
  side.hidden = false;
  byId("side-title").textContent = byId(id).ariaLabel;
}

/** Close what is open, and give the keyboard back to its button. */
export function closePanels() {
  const open = panels.find((panel) => !panel.hidden);
  for (const panel of panels) setOpen(panel, false);
  side.hidden = true;
  if (open) byId(`open-${open.id}`).focus();
}

function setOpen(panel, isOpen) {
  if (panel.hidden !== isOpen) return;
  panel.hidden = !isOpen;
  byId(`open-${panel.id}`).setAttribute("aria-expanded", String(isOpen));
  panel.dispatchEvent(new CustomEvent(isOpen ? "opened" : "closed"));
}
