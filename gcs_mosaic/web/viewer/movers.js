// @ts-check
// Movers: tracks of what changes place from look to look. Hints, and never a filter. Sought while somebody wants it, and its panel is open.

import { byId, element } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { written } from "/viewer/times.js";
import { t } from "/viewer/words.js";

const AGAIN_MS = 200; // while frames are left to be searched: each question has some of them searched
const EVERY_MS = 3000;
const CLOSE_ZOOM = 17;

export class Movers {
  /** `showLook(island, x, y, frame)`: opens the frame at that place. */
  constructor(map, showLook) {
    this.map = map;
    this.showLook = showLook;
    this.panel = byId("hints");
    this.on = byId("movers-on");
    this.told = byId("movers-told");
    this.list = byId("movers-list");
    this.lines = L.layerGroup();
    this.known = "";
    this.island = undefined; // whose tracks are shown
    this.timer = 0;
    this.on.onclick = () => {
      this.on.setAttribute("aria-pressed", String(this.on.ariaPressed !== "true"));
      this.turn();
    };
    this.map.map.on("layeradd", () => this.isWanted && this.map.layer?.island !== this.island && this.read());
    this.panel.addEventListener("opened", () => this.turn());
    this.panel.addEventListener("closed", () => this.turn());
  }

  get isWanted() {
    return !this.panel.hidden && this.on.ariaPressed === "true";
  }

  turn() {
    clearTimeout(this.timer);
    if (this.isWanted) this.lines.addTo(this.map.map);
    else this.lines.remove();
    if (this.isWanted) this.read();
    else this.told.textContent = "";
  }

  async read() {
    clearTimeout(this.timer);
    const island = this.map.layer?.island;
    if (island !== this.island) this.clear(island);
    let wait = EVERY_MS;
    if (!document.hidden && island !== undefined) {
      const answer = await fetchDocument(`/api/v1/islands/${island}/movers`).catch(() => null); // those that are shown stay
      if (answer && island === this.map.layer?.island) this.show(island, answer);
      if (answer && answer.searched < answer.frames) wait = AGAIN_MS;
    }
    clearTimeout(this.timer);
    if (this.isWanted) this.timer = window.setTimeout(() => this.read(), wait);
  }

  /** Tracks of another island lie on no ground of this one. */
  clear(island) {
    this.island = island;
    this.known = "";
    this.lines.clearLayers();
    this.list.replaceChildren();
    this.told.textContent = "";
  }

  /** @param {number} island @param {Api.Movers} answer */
  show(island, { movers, searched, frames }) {
    const far = t("{n} of {all} frames are searched.", { n: searched, all: frames });
    this.told.textContent = movers.length ? `${t("{n} may move.", { n: movers.length })} ${far}` : far;
    const text = JSON.stringify([island, movers]);
    if (text === this.known) return;
    this.known = text;
    const at = [...this.list.querySelectorAll("button")].indexOf(document.activeElement);
    this.list.replaceChildren(...movers.map((mover, index) => this.row(island, mover, index + 1)));
    if (at >= 0) this.list.querySelectorAll("button")[at]?.focus();
    this.lines.clearLayers();
    movers.forEach((mover, index) => this.draw(mover, index + 1));
  }

  /** @param {number} island @param {Api.Mover} mover @param {number} number */
  row(island, { looks }, number) {
    const [first, last] = [looks[0], looks[looks.length - 1]];
    const times = [first, last].map(({ time }) => (time ? written(time) : ""));
    const words = t("{n}. {looks} looks", { n: number, looks: looks.length });
    const said = times[0] ? `${words}, ${times[0]} – ${times[1].slice(-8)}` : words;
    const go = element("button", { type: "button", textContent: said });
    go.onclick = () => {
      this.map.setMode("free");
      this.map.map.setView([first.y, first.x], Math.max(this.map.map.getZoom(), CLOSE_ZOOM), { animate: false });
    };
    const open = element("button", { type: "button", textContent: t("Original"), ariaLabel: `${t("Original")}: ${words}` });
    open.onclick = () => this.showLook(island, first.x, first.y, first.frame);
    return element("li", { className: "row" }, go, open);
  }

  /** A line through its places, in the order of time, with its number at the last. */
  draw({ looks }, number) {
    /** @type {[number, number][]} */
    const places = looks.map(({ x, y }) => [y, x]);
    for (const [color, weight] of /** @type {[string, number][]} */ ([["#000", 5], ["#5ad1ff", 2]])) {
      this.lines.addLayer(L.polyline(places, { color, weight, interactive: false }));
    }
    for (const place of places) this.lines.addLayer(L.circleMarker(place, { radius: 4, color: "#000", weight: 1, fillColor: "#5ad1ff", fillOpacity: 1, interactive: false }));
    const icon = L.divIcon({ className: "mover-mark", iconSize: [24, 24], html: `<span class="upright">${number}</span>` });
    this.lines.addLayer(L.marker(places[places.length - 1], { icon, interactive: false, keyboard: false }));
  }
}
