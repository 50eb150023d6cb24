// @ts-check
// All looks at a place beside each other: crops of one orientation and scale about it, in order of time.

import { byId, element } from "/viewer/dom.js";
import { written } from "/viewer/times.js";
import { t } from "/viewer/words.js";

const CELLS = 320; // px of a crop
const FIRST_PX = 200; // of the finest look, over which a crop goes at first
const NEARER = 2; // times, for each step

export class SideBySide {
  /** `choose(index)`: show this one of the looks alone. */
  constructor(choose) {
    this.choose = choose;
    this.box = byId("originals-looks");
    this.list = this.box.querySelector("ol");
    this.place = null;
    byId("looks-nearer").onclick = () => this.zoom(1 / NEARER);
    byId("looks-farther").onclick = () => this.zoom(NEARER);
    this.box.addEventListener("keydown", (event) => this.key(event));
  }

  get isOpen() {
    return !this.box.hidden;
  }

  /**
   * @param {{ island: number, x: number, y: number }} place
   * @param {Api.Sighting[]} found
   * @param {number} at which of them is looked at
   */
  show(place, found, at) {
    const isAnother = this.place !== place;
    if (isAnother) this.side = FIRST_PX * Math.min(...found.map((one) => one.canvas_per_px));
    this.place = place;
    this.order = found.map((one, index) => ({ one, index })).sort((a, b) => (a.one.time ?? "").localeCompare(b.one.time ?? "") || a.one.number - b.one.number);
    this.box.hidden = false;
    this.draw();
    this.focus(isAnother ? 0 : this.order.findIndex(({ index }) => index === at));
  }

  hide() {
    this.box.hidden = true;
    this.list.replaceChildren(); // what is not looked at is not loaded
  }

  draw() {
    const { island, x, y } = this.place;
    this.list.replaceChildren(...this.order.map(({ one, index }, at) => {
      const time = one.time ? written(one.time) : "";
      const said = [`${at + 1}.`, time && t(one.time_by === "file" ? "came {time}" : "taken {time}", { time })];
      const src = `/api/v1/islands/${island}/looks/${one.number}.jpg?x=${x}&y=${y}&side=${this.side}&cells=${CELLS}`;
      const picture = element("img", { src, alt: "", loading: "lazy", width: CELLS, height: CELLS });
      const shown = element("span", { className: "coming" }, picture);
      picture.onload = picture.onerror = () => shown.classList.remove("coming");
      picture.addEventListener("error", () => picture.replaceWith(element("i", { textContent: t("cannot be shown") })));
      const caption = element("small", { textContent: said.filter(Boolean).join(" ") });
      if (!index) caption.append(" ", element("b", { textContent: t("the best look") }));
      const press = element("button", { type: "button", title: one.name, onclick: () => this.choose(index) }, shown, caption);
      return element("li", {}, press);
    }));
  }

  zoom(times) {
    this.side = Math.min(Math.max(this.side * times, 0.01), 1e6);
    const at = this.focused();
    this.draw();
    if (at >= 0) this.focus(at);
  }

  get buttons() {
    return /** @type {HTMLElement[]} */ ([...this.list.querySelectorAll("button")]);
  }

  focused() {
    return this.buttons.indexOf(/** @type {HTMLElement} */ (document.activeElement));
  }

  focus(at) {
    this.buttons[Math.min(Math.max(at, 0), this.buttons.length - 1)]?.focus();
  }

  key(event) {
    const across = Math.max(1, Math.floor(this.list.clientWidth / (this.buttons[0]?.offsetWidth || Infinity)));
    const step = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: across, ArrowUp: -across }[event.key];
    const times = { "+": 1 / NEARER, "-": NEARER }[event.key];
    if (step) this.focus(this.focused() + step);
    if (times) this.zoom(times);
    if (step || times) {
      event.preventDefault();
      event.stopPropagation(); // else the one behind is exchanged
    }
  }
}
