// @ts-check
// A find given to somebody else, by what the device has for that: its share sheet, with the text and the picture; else the text to
// be copied, the picture to be kept, and a code that another device scans. Browsers share over HTTPS and on this machine only.

import { byId, element } from "/viewer/dom.js";
import { t } from "/viewer/words.js";

const TIMEOUT_MS = 8000;

/**
 * Open the share sheet, or show what there is instead of it.
 * @param {number} id of a find
 */
export async function handOver(id) {
  const [text, picture] = await Promise.all([asked(id, "message.txt"), asked(id, "crop.jpg")]);
  const message = await text?.text();
  if (!message) {
    byId("finds-said").textContent = t("No answer: ask again once the connection is back.");
    return;
  }
  const files = picture ? [new File([await picture.blob()], `find-${id}.jpg`, { type: "image/jpeg" })] : [];
  const told = [{ text: message, files }, { text: message }].find((one) => navigator.canShare?.(one));
  if (!told || !(await shared(told))) show(id, message, files.length > 0);
}

async function asked(id, what) {
  const response = await fetch(`/api/v1/finds/${id}/${what}`, { signal: AbortSignal.timeout(TIMEOUT_MS) }).catch(() => null);
  return response?.ok ? response : null;
}

/** Whether it was, or somebody thought better of it. */
async function shared(told) {
  try {
    await navigator.share(told);
    return true;
  } catch (error) {
    return error.name === "AbortError";
  }
}

function show(id, message, hasPicture) {
  const field = element("textarea", { value: message, readOnly: true, rows: 5, ariaLabel: t("What is handed over") });
  const said = element("small", { role: "status" });
  const copy = element("button", { type: "button", textContent: t("Copy"), onclick: async () => {
    said.textContent = (await copied(field)) ? t("Copied.") : t("Select it and copy it by hand.");
  } });
  const keep = hasPicture ? [element("a", { href: `/api/v1/finds/${id}/crop.jpg`, download: `find-${id}.jpg`, textContent: t("Picture") })] : [];
  const close = element("button", { type: "button", textContent: t("Close"), onclick: () => box.close() });
  const code = element("img", { className: "code", src: `/api/v1/finds/${id}/code.svg`, alt: t("This text as a QR code") });
  const title = element("h2", { textContent: t("Hand over") });
  const box = element("dialog", { className: "handed", ariaLabel: t("Hand over"), onclose: () => box.remove() },
    title, field, element("div", { className: "row" }, copy, ...keep, close), said, code);
  document.body.append(box);
  box.showModal();
  copy.focus(); // and not the text, which would be scrolled to its end
  field.scrollTop = 0;
}

/** Over plain HTTP browsers have no clipboard but for this machine's own pages; then as in former times. */
export async function copied(field) {
  try {
    await navigator.clipboard.writeText(field.value);
    return true;
  } catch {
    field.focus();
    field.select();
    return document.execCommand("copy");
  }
}
