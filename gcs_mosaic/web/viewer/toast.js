// @ts-check
// A short answer that goes by itself.

import { byId } from "/viewer/dom.js";

const SAID_MS = 6000;

let timer = 0;

/** @param {string} text */
export function toast(text) {
  const output = byId("answer");
  output.textContent = text;
  output.hidden = !text;
  clearTimeout(timer);
  timer = window.setTimeout(() => (output.hidden = true), SAID_MS);
}
