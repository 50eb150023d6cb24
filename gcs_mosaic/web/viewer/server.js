// @ts-check
// Talking to the server, and knowing when we no longer do.

import { noteSource } from "/viewer/kept.js";

const LOST_AFTER_MS = 5000;
const STATE = /^\/(status|mosaic)[.]json$/; // asked for each second
const FIRST_PATIENCE_MS = 4000; // for the state: a network that has changed leaves a question without an answer for ever
const LONGEST_PATIENCE_MS = 16000; // a busy machine that takes longer than the first would never be heard
const QUESTION_MS = 20000;
const WITHOUT_BODY = [204, 205, 304];

let wasAnswered = false; // by the server, not out of what was kept
let sawKept = false; // since the last attempt began
let clockOffsetMs = 0; // server's clock minus this device's: a tablet's clock may be minutes off
let serverZero = NaN; // its clock at the zero of one that nobody sets
let setAt = -Infinity; // when it was set last, ms since this page was opened
let patienceMs = FIRST_PATIENCE_MS;
let served = ""; // what the server calls the flight of the last document, where it tells flights of one name apart
/** @type {Set<AbortController>} the questions that are not answered */
const asked = new Set();

/** What tells the flight that is served from others of its name; empty if nothing does. */
export function servedFlight() {
  return served;
}

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
  const response = STATE.test(path) ? await stateAt(path) : await within(QUESTION_MS, path);
  if (noteSource(response, wasAnswered)) sawKept = true;
  else wasAnswered = true;
  served = response.headers.get("X-Flight") ?? served;
  const date = sawKept ? NaN : Date.parse(response.headers.get("Date"));
  // The header has whole seconds; half a second is the best guess of the rest.
  if (!Number.isNaN(date)) noteClock(date + 500);
  if (response.status === 404) return null;
  if (!response.ok) throw Object.assign(new Error(`${path}: ${response.status}`), { status: response.status });
  return response;
}

function noteClock(serverMs) {
  const zero = serverMs - performance.now();
  if (Math.abs(zero - serverZero) > LOST_AFTER_MS) setAt = performance.now();
  serverZero = zero;
  clockOffsetMs = serverMs - Date.now();
}

/** Whether the server's clock was set a moment ago, or its machine was suspended: ages of what was written before tell nothing. */
export function clockWasJustSet() {
  return performance.now() - setAt < LOST_AFTER_MS;
}

async function stateAt(path) {
  try {
    const response = await within(patienceMs, path);
    patienceMs = FIRST_PATIENCE_MS;
    return response;
  } catch (error) {
    if (error.name === "TimeoutError") patienceMs = Math.min(2 * patienceMs, LONGEST_PATIENCE_MS);
    throw error;
  }
}

/** The answer with all that belongs to it. The worker that keeps the page waits as long (see sw.js). */
async function within(timeMs, path) {
  const ending = new AbortController();
  const late = setTimeout(() => ending.abort(new DOMException(`no answer in ${timeMs} ms`, "TimeoutError")), timeMs);
  asked.add(ending);
  try {
    const response = await fetch(path, { signal: ending.signal, headers: { "X-Patience": `${timeMs}` } });
    const whole = await response.arrayBuffer();
    const { status, statusText, headers } = response;
    return new Response(WITHOUT_BODY.includes(status) ? null : whole, { status, statusText, headers });
  } finally {
    clearTimeout(late);
    asked.delete(ending);
  }
}

/** Ask anew whatever was asked of a connection that is gone. */
function giveUp() {
  patienceMs = FIRST_PATIENCE_MS;
  for (const one of asked) one.abort(new DOMException("the connection was lost", "AbortError"));
}

/** Remembers when the server last answered. */
export class Connection {
  lastAnswer = Date.now();
  lastSign = Date.now(); // an answer, or anything else that it has sent
  backAt = 0; // when it was heard again after it had been lost
  isRefused = false; // the server answers, but not to this device

  /** Run something that talks to the server; a failure only shows in `lostForSeconds`. */
  async attempt(action) {
    try {
      sawKept = false;
      await action();
      if (sawKept) return; // what was kept tells nothing of the server
      this.sign();
      this.lastAnswer = this.lastSign;
      this.isRefused = false;
    } catch (error) {
      this.isRefused = error.status === 401;
      console.warn(error);
    }
  }

  /** Something has come from it. */
  sign() {
    if (this.lostForSeconds()) {
      giveUp();
      this.backAt = Date.now();
    }
    this.lastSign = Date.now();
  }

  /** Whether what came at that moment came before the server was lost, and is asked for again now. */
  isJustBackSince(moment) {
    return this.backAt > moment && Date.now() - this.backAt < LOST_AFTER_MS;
  }

  /** Seconds since anything came from the server, or 0 while that is short enough to be normal. */
  lostForSeconds() {
    return since(Math.max(this.lastSign, this.lastAnswer));
  }

  /** Seconds since the last answer, of a server that may well be there, but is slow; or 0 as above. */
  lateForSeconds() {
    return since(this.lastAnswer);
  }
}

function since(moment) {
  const silent = Date.now() - moment;
  return silent > LOST_AFTER_MS ? silent / 1000 : 0;
}
