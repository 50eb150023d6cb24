// @ts-check
// Talking to the server, and knowing when we no longer do.

import { noteSource } from "/viewer/kept.js";

const TIMEOUT_MS = 4000;
const LOST_AFTER_MS = 5000;

let wasAnswered = false; // by the server, not out of what was kept
let sawKept = false; // since the last attempt began
let clockOffsetMs = 0; // server's clock minus this device's: a tablet's clock may be minutes off

/** The moment on the server's clock, ms since 1970. */
export function serverNow() {
  return Date.now() + clockOffsetMs;
}

/** Seconds since a moment in ISO 8601; null for none. */
export function ageOf(moment) {
  return moment ? Math.max(0, (serverNow() - Date.parse(moment)) / 1000) : null;
}

/**
 * A JSON document, or null if it is not written yet. Throws when the server does not answer.
 * @template {string} Path
 * @param {Path} path
 * @returns {Promise<Api.AnswerTo<"GET", Path>>}
 */
export async function fetchDocument(path) {
  return (await answerTo(path))?.json() ?? null;
}

/**
 * The documents in a file that has one on each line, or null if there is no such file.
 * @param {`/placements.jsonl?after=${number}`} path
 * @returns {Promise<[Api.JournalHead, ...Api.Placements[]] | null>}
 */
export async function fetchLines(path) {
  const text = await (await answerTo(path))?.text();
  return /** @type {any} */ (text?.trimEnd().split("\n").map((line) => JSON.parse(line)) ?? null);
}

async function answerTo(path) {
  const response = await fetch(path, { signal: AbortSignal.timeout(TIMEOUT_MS) });
  if (noteSource(response, wasAnswered)) sawKept = true;
  else wasAnswered = true;
  const date = sawKept ? NaN : Date.parse(response.headers.get("Date"));
  // The header has whole seconds; half a second is the best guess of the rest.
  if (!Number.isNaN(date)) clockOffsetMs = date + 500 - Date.now();
  if (response.status === 404) return null;
  if (!response.ok) throw Object.assign(new Error(`${path}: ${response.status}`), { status: response.status });
  return response;
}

/** Remembers when the server last answered. */
export class Connection {
  lastAnswer = Date.now();
  isRefused = false; // the server answers, but not to this device

  /** Run something that talks to the server; a failure only shows in `lostForSeconds`. */
  async attempt(action) {
    try {
      sawKept = false;
      await action();
      if (sawKept) return; // what was kept tells nothing of the server
      this.lastAnswer = Date.now();
      this.isRefused = false;
    } catch (error) {
      this.isRefused = error.status === 401;
      console.warn(error);
    }
  }

  /** Seconds since the last answer, or 0 while that is short enough to be normal. */
  lostForSeconds() {
    const silent = Date.now() - this.lastAnswer;
    return silent > LOST_AFTER_MS ? silent / 1000 : 0;
  }
}
