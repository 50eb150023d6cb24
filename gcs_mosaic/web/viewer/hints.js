// @ts-check
// Hints: crops of what may be worth a look, the oddest first, and colours that somebody has picked. Never a filter: the map stays
// as it is.

import { send, trying } from "/viewer/api.js";
import { byId, element, focusedIn } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

const EVERY_MS = 3000;
const CROP_LEAST = 64; // px of the original
const CROP_AROUND = 3; // times the size of what is shown
const CROP_MOST = 1024;
const CLOSE_ZOOM = 17;
const REASONS = {
  "moves": "only one look shows it",
  "colour": "rare colour",
  "stands out": "stands out",
  "sought": "picked colour",
  "detector": "detector",
};
const STATES = { starting: "Starting …", refused: "Hints cannot be sought." };

export class Hints {
  /** `showOriginal(hint)`: opens the frame that shows it. */
  constructor(map, pointing, showOriginal) {
    this.map = map;
    this.pointing = pointing;
    this.showOriginal = showOriginal;
    /** @type {Api.Hint[]} */
    this.hints = [];
    this.marks = L.layerGroup();
    this.known = "";
    this.on = byId("hints-on");
    this.pick = byId("hints-pick");
    this.tolerance = byId("hints-tolerance");
    this.colours = byId("hints-colours");
    this.told = byId("hints-told");
    this.said = byId("hints-said");
    this.undo = byId("hints-undo");
    this.list = byId("hints-list");
    this.panel = byId("hints");
    this.tool = { button: this.pick, said: "Click the colour.", place: (island, x, y) => this.pickAt(island, x, y) };
    this.on.onclick = () => this.change(() => send("POST", "/hints", { on: this.on.ariaPressed !== "true" }));
    this.pick.onclick = () => this.pointing.take(this.tool);
    this.undo.querySelector("button").onclick = () => this.bringBack();
    this.panel.addEventListener("opened", () => this.open());
    this.panel.addEventListener("closed", () => this.marks.remove());
    setInterval(() => this.read(), EVERY_MS);
  }

  open() {
    this.marks.addTo(this.map.map);
    this.read();
  }

  /** Ask for what is new, while somebody looks. */
  async read() {
    if (this.panel.hidden || document.hidden) return;
    const answer = await fetchDocument("/api/v1/hints").catch(() => null); // those that are shown stay
    if (answer) this.show(answer);
  }

  async change(action) {
    const answer = await trying(this.said, action);
    await this.read();
    return answer;
  }

  /** @param {Api.Hints} answer */
  show(answer) {
    const text = JSON.stringify([answer, this.map.layer?.island]);
    if (text === this.known) return;
    this.known = text;
    this.hints = answer.hints;
    this.on.setAttribute("aria-pressed", String(answer.on));
    this.told.textContent = told(answer);
    this.showColours(answer.colours);
    this.showList(answer.colours);
    this.drawMarks();
  }

  showColours(colours) {
    this.colours.replaceChildren(...colours.map((colour) => {
      const name = colour.label || hex(colour);
      const away = element("button", { type: "button", textContent: "✕", ariaLabel: `${t("Seek no more")}: ${name}` });
      away.onclick = () => this.change(() => send("DELETE", `/hints/colours/${colour.id}`));
      const swatch = element("i", { ariaHidden: "true" });
      swatch.style.background = hex(colour);
      return element("li", {}, swatch, element("span", { textContent: name }), away);
    }));
  }

  showList(colours) {
    const focused = focusedIn("hint");
    this.list.replaceChildren(...this.hints.map((hint, index) => this.row(hint, index + 1, colours)));
    if (focused) this.list.querySelector(`[data-hint="${focused}"]`)?.focus();
  }

  row(hint, number, colours) {
    const name = `${number}. ${nameOf(hint, colours)}`;
    const picture = element("img", { src: cropOf(hint), alt: "", loading: "lazy", width: 112, height: 112 });
    const go = element("button", { type: "button", className: "crop", ariaLabel: `${t("Show")}: ${name}` }, picture);
    go.dataset.hint = hint.hint;
    go.onclick = () => this.goTo(hint);
    const button = (label, action) => element("button", { type: "button", textContent: t(label), ariaLabel: `${t(label)}: ${name}`, onclick: action });
    return element("li", {}, go, element("small", { textContent: name }),
      element("div", { className: "row" }, button("Original", () => this.showOriginal(hint)), button("Dismiss", () => this.dismiss(hint))));
  }

  drawMarks() {
    this.marks.clearLayers();
    for (const { hint, island, place } of this.hints) {
      if (island !== this.map.layer?.island || !place) continue;
      const icon = L.divIcon({ className: "hint-mark", iconSize: [44, 44] });
      this.marks.addLayer(L.marker([place[1], place[0]], { icon, interactive: false, keyboard: false, title: hint }));
    }
  }

  /** @param {Api.Hint} hint */
  goTo(hint) {
    if (!hint.place) return this.showOriginal(hint);
    if (this.map.layer?.island !== hint.island) this.map.chooseIsland(hint.island);
    this.map.setMode("free");
    this.map.map.setView([hint.place[1], hint.place[0]], Math.max(this.map.map.getZoom(), CLOSE_ZOOM), { animate: false });
    return undefined;
  }

  async pickAt(island, x, y) {
    this.pointing.release();
    await this.change(() => send("POST", "/hints/colours", { island, x, y, tolerance: Number(this.tolerance.value) }));
    if (this.on.ariaPressed !== "true") await this.change(() => send("POST", "/hints", { on: true }));
  }

  /** @param {Api.Hint} hint */
  async dismiss(hint) {
    if (await this.change(() => send("POST", "/hints/dismissed", { hint: hint.hint }))) {
      this.dismissed = hint;
      this.undo.hidden = false;
      this.undo.querySelector("button").focus();
    }
  }

  async bringBack() {
    if (await this.change(() => send("DELETE", `/hints/dismissed/${this.dismissed.hint}`))) this.undo.hidden = true;
  }
}

/** @param {Api.Hints} answer */
function told({ on, state, trouble, searched, failed, frames }) {
  if (!on) return t("Hints are off.");
  const rest = trouble || (state in STATES && t(STATES[state]));
  const far = t("{n} of {all} frames are searched.", { n: searched + failed, all: frames });
  return rest ? `${rest} ${far}` : far;
}

function nameOf(hint, colours) {
  const reason = t(REASONS[hint.reason]);
  if (hint.reason !== "sought") return hint.reason === "detector" ? `${reason} ${hint.what}, ${Math.round(100 * hint.worth)} %` : reason;
  const colour = colours.find(({ id }) => id === hint.what);
  return colour ? `${reason} ${colour.label || hex(colour)}` : reason;
}

/** @param {Api.Hint} hint */
function cropOf({ frame, pixel, size }) {
  const side = Math.min(CROP_MOST, Math.max(CROP_LEAST, Math.round(CROP_AROUND * Math.max(...size))));
  return `/api/v1/frames/${frame}/crop.jpg?x=${Math.round(pixel[0])}&y=${Math.round(pixel[1])}&side=${side}`;
}

/** @param {Api.PickedColour} colour */
function hex({ rgb }) {
  return `#${rgb.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}
