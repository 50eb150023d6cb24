// @ts-check
// How the page looks on this device: light for the sun, dark, red for the night; dark ground made lighter, haze made clearer.
// Kept on the device; tiles stay as they are.

import { byId } from "/viewer/dom.js";
import { LANGUAGES, chooseLanguage, language } from "/viewer/words.js";

const KEY = "gcs-mosaic look";
const PLAIN = { theme: "system", brightness: 1, contrast: 1, gamma: 1, local: false };
const dark = matchMedia("(prefers-color-scheme: dark)");

export class Look {
  constructor() {
    this.chosen = { ...PLAIN, ...kept() };
    byId("look-plain").onclick = () => this.choose({ ...PLAIN });
    for (const name of Object.keys(PLAIN)) {
      const input = byId(`look-${name}`);
      input.addEventListener("input", () => this.choose({ [name]: chosenIn(input) }));
    }
    dark.addEventListener("change", () => this.apply());
    offerLanguages(byId("language"));
    this.apply();
  }

  choose(change) {
    Object.assign(this.chosen, change);
    try {
      localStorage.setItem(KEY, JSON.stringify(this.chosen));
    } catch {
      // a browser that keeps nothing: it holds until the page is closed
    }
    this.apply();
  }

  apply() {
    const { theme, brightness, contrast, gamma, local } = this.chosen;
    for (const name of Object.keys(PLAIN)) byId(`look-${name}`).value = this.chosen[name];
    byId("look-local").checked = local;
    document.documentElement.dataset.theme = theme === "system" ? (dark.matches ? "dark" : "light") : theme;
    for (const channel of document.querySelectorAll("#gamma feFuncR, #gamma feFuncG, #gamma feFuncB")) {
      channel.setAttribute("exponent", String(1 / gamma));
    }
    const isPlain = brightness === 1 && contrast === 1 && gamma === 1 && !local;
    // Only what needs it: a filter costs a weak tablet time at each step of the map.
    const filter = isPlain ? "none" : `${local ? "url(#local)" : ""} ${gamma === 1 ? "" : "url(#gamma)"} brightness(${brightness}) contrast(${contrast})`;
    document.documentElement.style.setProperty("--map-filter", filter);
  }
}

function chosenIn(input) {
  if (input.type === "checkbox") return input.checked;
  return input.tagName === "SELECT" ? input.value : Number(input.value);
}

function offerLanguages(select) {
  for (const [tag, name] of Object.entries(LANGUAGES)) select.append(new Option(name, tag, false, tag === language()));
  select.onchange = () => chooseLanguage(select.value);
}

/** What was chosen on this device before; whatever else lies under that name is left aside. */
function kept() {
  try {
    const found = JSON.parse(localStorage.getItem(KEY)) ?? {};
    return Object.fromEntries(Object.entries(PLAIN).map(([name, plain]) => [name, typeof found[name] === typeof plain ? found[name] : plain]));
  } catch {
    return {};
  }
}
