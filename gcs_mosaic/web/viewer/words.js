// @ts-check
// The page's words in the language of whoever looks. English is written where it is said, and is the key to the other tables.

const TABLES = { de: () => import("/viewer/words.de.js") };
const KEY = "gcs-mosaic language";

let table = {};
let made = null; // patterns of its sentences

/** The languages that there are, each in its own name. */
export const LANGUAGES = { en: "English", de: "Deutsch" };

/** The language that was chosen on this device, else the browser's, else English. */
export function language() {
  const kept = readKept();
  return [kept, ...navigator.languages.map((tag) => tag.slice(0, 2))].find((tag) => tag in LANGUAGES) ?? "en";
}

/** Load the table of the language; to be awaited before anything is said. */
export async function loadWords() {
  const chosen = language();
  document.documentElement.lang = chosen;
  table = (await TABLES[chosen]?.())?.default ?? {};
  made = null;
  translatePage();
}

export function chooseLanguage(tag) {
  try {
    localStorage.setItem(KEY, tag);
  } catch {
    return; // a browser that keeps nothing
  }
  location.reload();
}

/** A sentence in the language of whoever looks: `t("{n} of {all}", {n: 1, all: 5})`. */
export function t(english, values = {}) {
  return (table[english] ?? english).replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
}

/**
 * A sentence of the server in the language of whoever looks; its numbers and names are found by the table's own sentences: those
 * that have so many words besides, for one of few takes any sentence for its own.
 */
export function said(english, leastWords = 0) {
  if (english in table) return table[english];
  for (const [pattern, own] of patterns().filter(([, , words]) => words >= leastWords)) {
    const found = pattern.exec(english);
    if (found) return own.replace(/\{(\w+)\}/g, (whole, name) => filledIn(name, found.groups[name]) ?? whole);
  }
  return english;
}

/** A name or number as it is; what is called `any_…` is words of the server, one or several to choose from. */
function filledIn(name, text) {
  return name.startsWith("any_") ? text?.split(" or ").map((one) => said(one)).join(` ${t("or")} `) : text;
}

/** Those sentences of the table that have room for something, the longest first: it is the most particular. */
function patterns() {
  made ??= Object.entries(table).filter(([english]) => english.includes("{"))
    .sort(([one], [other]) => other.length - one.length)
    .map(([english, own]) => [new RegExp(`^${escaped(english).replace(/\\\{(\w+)\\\}/g, "(?<$1>.+?)")}$`), own, wordsOf(english)]);
  return made;
}

/** How many words a sentence has but for those that are filled in. */
function wordsOf(english) {
  return english.replace(/\{\w+\}/g, "").match(/\p{L}+/gu)?.length ?? 0;
}

function escaped(text) {
  return text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
}

/** What stands in the page itself: its texts, titles and labels. */
function translatePage() {
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const node = /** @type {Text} */ (texts.currentNode);
    const english = node.data.trim();
    if (english in table) node.data = node.data.replace(english, table[english]);
  }
  for (const name of ["aria-label", "title", "placeholder"]) {
    for (const node of document.querySelectorAll(`[${name}]`)) node.setAttribute(name, t(node.getAttribute(name)));
  }
}

function readKept() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}
