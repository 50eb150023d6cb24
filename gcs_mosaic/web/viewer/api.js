// @ts-check
// Writing to the server: what people add to the flight. Who does is asked once, and kept on this device.

import { said, t } from "/viewer/words.js";

const TIMEOUT_MS = 8000;
const OWN_WORDS = 2; // of a sentence that a refusal may be: it may hold what somebody has typed
const KEY = "gcs-mosaic who";

/**
 * The answer to a request that changes something. Throws an Error with the server's own sentence.
 * @template {string} Method
 * @template {string} Path
 * @param {Method} method
 * @param {Path} path
 * @param {Api.BodyOf<Method, `/api/v1${Path}`>} body
 * @returns {Promise<Api.AnswerTo<Method, `/api/v1${Path}`> & { isOutdated: boolean }>}
 */
export async function send(method, path, body = /** @type {any} */ ({})) {
  const response = await fetch(`/api/v1${path}`, {
    method,
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ ...body, who: who() }),
    signal: AbortSignal.timeout(TIMEOUT_MS),
  });
  if (response.ok || response.status === 409) return Object.assign(await response.json(), { isOutdated: response.status === 409 });
  throw new Error((await response.text()).trim() || `${response.status}`);
}

/** The name under which this device adds things. */
export function who() {
  try {
    return localStorage.getItem(KEY) || "operator";
  } catch {
    return "operator"; // a browser that keeps nothing
  }
}

export function setWho(name) {
  try {
    localStorage.setItem(KEY, name.trim());
  } catch {
    // it holds until the page is closed
  }
}

/**
 * Run something that writes; what goes wrong is said in an element.
 * @template Done
 * @param {HTMLElement} place
 * @param {() => Promise<Done>} action
 * @returns {Promise<Done | null>}
 */
export async function trying(place, action) {
  place.textContent = "";
  try {
    return await action();
  } catch (error) {
    place.textContent = sentenceOf(error);
    place.scrollIntoView({ block: "nearest" }); // a form is higher than what a phone shows of it
    return null;
  }
}

/** What went wrong, for whoever looks: of a server that does not answer browsers have words of their own, which help nobody. */
function sentenceOf(error) {
  const isUnanswered = error.name === "TimeoutError" || error instanceof TypeError;
  return isUnanswered ? t("No answer: nothing is known to have changed.") : said(error.message, OWN_WORDS);
}
