// @ts-check
// Which ground people have looked at closely: reported while one looks, and shaded where nobody has.

import { send, who } from "/viewer/api.js";
import { byId } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

const EACH_MS = 3000; // between two reports of what is on the screen
const STILL_MS = 1000; // the map must have stood so long
const MOST_CELLS = 60; // across what is on the screen; from further out the shading says too little

export class Reviews {
  constructor(map) {
    this.map = map;
    this.shade = L.layerGroup().addTo(map.map);
    this.moved = Date.now();
    this.isShown = false;
    this.isCounting = true;
    this.renderer = L.canvas({ padding: 0.2 });
    this.button = byId("reviews-show");
    this.counts = byId("reviews-count");
    this.whose = byId("reviews-whose");
    this.told = byId("reviews-told");
    this.button.onclick = () => this.toggle();
    this.counts.onclick = () => this.toggleCounting();
    this.whose.onchange = () => this.read();
    map.map.on("movestart zoomstart", () => (this.moved = Date.now()));
    map.map.on("moveend zoomend", () => {
      this.moved = Date.now();
      this.read();
    });
    setInterval(() => this.report(), EACH_MS);
  }

  toggle() {
    this.isShown = !this.isShown;
    this.button.setAttribute("aria-pressed", String(this.isShown));
    this.read();
  }

  toggleCounting() {
    this.isCounting = !this.isCounting;
    this.counts.setAttribute("aria-pressed", String(this.isCounting));
  }

  /** The zoom from which on a look counts: nine tenths of what the frames show. */
  leastLevel() {
    return (this.map.layer?.options.maxNativeZoom ?? 99) - 1;
  }

  box() {
    return this.map.turn.seen();
  }

  async report() {
    const { layer, map } = this.map;
    const isLooking = this.isCounting && document.visibilityState === "visible" && byId("originals").hidden;
    if (!layer || !isLooking || Date.now() - this.moved < STILL_MS || map.getZoom() < this.leastLevel() - 0.5) return;
    const level = Math.max(0, Math.min(30, Math.round(map.getZoom())));
    try {
      await send("POST", "/reviews", { island: layer.island, box: this.box(), level, seconds: EACH_MS / 1000 });
      if (this.isShown) await this.read();
    } catch {
      // the next look is reported
    }
  }

  async read() {
    if (!this.isShown || !this.map.layer) {
      this.shade.clearLayers();
      return;
    }
    const { island } = this.map.layer;
    const [left, top, right, bottom] = this.box();
    if (right - left > MOST_CELLS * 128 * 4) {
      this.shade.clearLayers();
      this.told.textContent = t("Zoom in to see what was reviewed.");
      return;
    }
    const whose = this.whose.value ? `&who=${encodeURIComponent(this.whose.value)}` : "";
    const query = `island=${island}&left=${left}&top=${top}&right=${right}&bottom=${bottom}&level=${this.leastLevel() - 1}${whose}`;
    const answer = await fetchDocument(`/api/v1/reviews?${query}`).catch(() => null);
    if (!answer || !this.isShown || this.map.layer?.island !== island) return;
    this.draw(answer);
  }

  /** @param {Api.Reviewed} answer */
  draw({ cell, reviewed, missing, reviewers }) {
    this.shade.clearLayers();
    const { renderer } = this;
    for (const [x, y] of missing) {
      const corner = [cell.units * y - 2 ** 23, cell.units * x - 2 ** 23];
      /** @type {any} */
      const bounds = [corner, [corner[0] + cell.units, corner[1] + cell.units]];
      this.shade.addLayer(L.rectangle(bounds, { renderer, stroke: false, fillColor: "#30006b", fillOpacity: 0.45, interactive: false }));
    }
    const [left, top, right, bottom] = this.box();
    const isInView = ([x, y]) => {
      const [across, down] = [x, y].map((index) => cell.units * (index + 0.5) - 2 ** 23);
      return across > left && across < right && down > top && down < bottom;
    };
    const [done, open] = [reviewed, missing].map((cells) => cells.filter(isInView).length);
    this.told.textContent = done + open ? t("{share} % of the ground in view was reviewed.", { share: Math.round((100 * done) / (done + open)) }) : "";
    const names = [t("anybody"), ...reviewers.map(({ who: name }) => name)];
    if (this.whose.options.length === names.length) return;
    const chosen = this.whose.value;
    this.whose.replaceChildren(...names.map((name, at) => new Option(name === who() ? `${name} (${t("you")})` : name, at ? name : "")));
    this.whose.value = chosen;
  }
}
