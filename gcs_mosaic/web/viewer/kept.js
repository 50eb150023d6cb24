// @ts-check
// The page with the server gone: what was seen stays viewable, also after a reload, where the browser allows that (this machine,
// and HTTPS). A service worker keeps the page itself, the documents and the tiles that were shown.

let isKept = false;

/** Whether this page was opened without a server, out of what was kept: tiles then come from there too. */
export function isOutOfKept() {
  return isKept;
}

/** Note where an answer came from; true if it was kept, and so tells nothing of now. */
export function noteSource(response, wasAnswered) {
  const kept = response.headers.get("X-Kept") === "1";
  if (kept && !wasAnswered) isKept = true;
  if (!kept) isKept = false;
  return kept;
}

/** Have the browser keep what is shown; without a word where it cannot. */
export function keep() {
  navigator.serviceWorker?.register("/sw.js").catch(console.info);
}

/** Another flight is served here: nothing of the one before may be shown as its map. */
export function forget() {
  navigator.serviceWorker?.controller?.postMessage("forget");
}
