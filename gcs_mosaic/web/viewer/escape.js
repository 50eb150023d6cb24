// @ts-check
// Escape closes what is open: one thing with each press, the innermost first.

/** From the innermost on. A dialog lies over all of them, and the browser closes it by itself. */
const ORDER = ["originals", "sheet", "tool", "form", "panel", "looking"];

/** @type {{ kind: string, isOpen: () => boolean, close: () => void }[]} */
const closers = [];

/**
 * Have Escape close something of a kind while it is open.
 * @param {"originals" | "sheet" | "tool" | "form" | "panel" | "looking"} kind
 * @param {() => boolean} isOpen
 * @param {() => void} close
 */
export function closeByEscape(kind, isOpen, close) {
  if (!closers.length) document.addEventListener("keydown", onKey);
  closers.push({ kind, isOpen, close });
  closers.sort((one, other) => ORDER.indexOf(one.kind) - ORDER.indexOf(other.kind));
}

function onKey({ key, repeat, isComposing }) {
  if (key !== "Escape" || repeat || isComposing || document.querySelector("dialog[open]")) return;
  closers.find(({ isOpen }) => isOpen())?.close();
}
