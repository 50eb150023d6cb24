// @ts-check
// Through the trees: the map in focus at the ground instead of the canopy. What is in view is asked for, and shown as it is made.

import { byId } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { LiveTiles } from "/viewer/tiles.js";
import { said, t } from "/viewer/words.js";

const AGAIN_MS = 1500;
const REST_AGAIN_MS = 4000; // where all is made: the map may have changed

export class Ground {
  constructor(map) {
    this.map = map;
    this.tiles = null;
    /** @type {Map<string, number>} the version of each part that is shown, by its first tile */
    this.versions = new Map();
    this.span = 4;
    this.timer = 0;
    this.asked = 0;
    this.button = byId("ground-show");
    this.focus = byId("ground-focus");
    this.auto = byId("ground-auto");
    this.told = byId("ground-told");
    this.button.onclick = () => (this.tiles ? this.hide() : this.begin());
    this.auto.onclick = () => this.choose(this.auto.getAttribute("aria-pressed") !== "true");
    this.focus.addEventListener("change", () => this.choose(false));
    map.map.on("moveend", () => this.tiles && this.ask());
    map.map.on("layeradd", () => this.tiles && this.map.layer && this.map.layer.island !== this.tiles.island && this.begin());
    document.addEventListener("visibilitychange", () => this.tiles && !document.hidden && this.ask());
  }

  /** The focus is sought, or set. */
  choose(isAuto) {
    this.auto.setAttribute("aria-pressed", String(isAuto));
    if (this.tiles) this.begin();
  }

  height() {
    return this.auto.getAttribute("aria-pressed") === "true" ? null : this.focus.value / 100;
  }

  begin() {
    this.hide();
    const { layers, layer } = this.map;
    if (!layer) return;
    const height = this.height();
    const focus = height === null ? "" : `&height=${height}`;
    const path = (island, { z, x, y }) => `/api/v1/ground/${island}/${z}/${x}/${y}.webp?v=${this.versionOf(z, x, y)}${focus}`;
    this.tiles = new LiveTiles(path, layer.island, 0, () => {}, { ...layers.options, zIndex: 4, tileClass: "ground-tile" });
    this.tiles.addTo(this.map.map);
    this.button.setAttribute("aria-pressed", "true");
    this.map.map.getContainer().classList.add("through-trees");
    this.told.textContent = t("Looking through the trees …");
    this.ask();
  }

  hide() {
    clearTimeout(this.timer);
    this.asked++; // what is on its way is not of what is shown now
    this.tiles?.remove();
    this.tiles = null;
    this.versions.clear();
    this.button.setAttribute("aria-pressed", "false");
    this.map.map.getContainer().classList.remove("through-trees");
    this.told.textContent = "";
  }

  versionOf(z, x, y) {
    return this.versions.get(this.partOf(z, x, y)) ?? 0;
  }

  partOf(z, x, y) {
    return `${z}/${Math.floor(x / this.span)}/${Math.floor(y / this.span)}`;
  }

  /** Ask for what is in view, and go on for as long as it is looked at. */
  async ask() {
    clearTimeout(this.timer);
    const asked = ++this.asked;
    const { tiles } = this;
    const view = this.view();
    let again = AGAIN_MS;
    if (view && !document.hidden) {
      const answer = await fetchDocument(`/api/v1/islands/${tiles.island}/ground?${view}`).catch(() => null);
      if (asked !== this.asked || tiles !== this.tiles) return;
      if (answer) {
        this.show(answer, Number(view.get("z")));
        if (!answer.waiting) again = REST_AGAIN_MS;
      }
    }
    this.timer = window.setTimeout(() => this.tiles && this.ask(), again);
  }

  /** Level and tiles of what is seen; null before there is anything. */
  view() {
    const z = this.tiles._tileZoom;
    if (z === undefined) return null;
    const { min, max } = this.tiles._pxBoundsToTileRange(this.tiles._getTiledPixelBounds(this.map.map.getCenter()));
    const range = { z, left: min.x, top: min.y, right: max.x, bottom: max.y };
    const asked = new URLSearchParams(Object.entries(range).map(([name, value]) => [name, String(Math.max(0, value))]));
    const height = this.height();
    if (height !== null) asked.set("height", String(height));
    return asked;
  }

  /** @param {Api.Ground} answer */
  show(answer, z) {
    this.span = answer.span;
    const changed = new Set();
    for (const { x, y, version } of answer.parts) {
      const part = this.partOf(z, x, y);
      if (this.versions.get(part) === version) continue;
      this.versions.set(part, version);
      changed.add(part);
    }
    this.tiles.grow(this.map.layers.options);
    if (changed.size) this.tiles.refresh(answer.map_revision, (at) => changed.has(this.partOf(at.z, at.x, at.y)));
    this.tell(answer);
  }

  /** @param {Api.Ground} answer */
  tell({ waiting, cells, known, lost, trouble }) {
    const lines = [];
    if (waiting) lines.push(t("{n} parts of this view are still to be laid together.", { n: waiting }));
    else lines.push(t("All of this view is laid together. What fewer than two frames saw is the dimmed map."));
    if (trouble) lines.push(said(trouble));
    if (this.height() === null && cells) {
      lines.push(known === cells ? t("The ground's height was found everywhere.") : t("The ground's height was found at {n} of {all} places; elsewhere the focus is a guess: set it.", { n: known, all: cells }));
    }
    if (lost) lines.push(t("{n} originals cannot be read and are left out.", { n: lost }));
    this.told.textContent = lines.join(" ");
    this.told.dataset.waiting = String(waiting);
  }
}
