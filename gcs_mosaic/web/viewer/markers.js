// @ts-check
// Markers of finds on the map. Many of them hide the ground, so they can be hidden: kept on this device, told over the map, and only
// until there is a find that was not there then.

import { byId, element } from "/viewer/dom.js";
import { t } from "/viewer/words.js";

const KEY = "gcs-mosaic finds hidden";

export class Markers {
  /** `map`: the MosaicMap; `nameOf(find)`; `open(find)`: its marker was pressed. */
  constructor(map, nameOf, open) {
    this.map = map;
    this.nameOf = nameOf;
    this.open = open;
    /** @type {Api.Find[]} */
    this.finds = [];
    this.hiddenTo = kept(); // the id of the newest find that is hidden, or null
    this.shownAlone = null; // the id of the one that somebody went to meanwhile
    this.pins = L.layerGroup().addTo(map.map);
    this.button = byId("finds-show");
    this.told = byId("finds-hidden");
    this.button.onclick = () => this.hide(this.hiddenTo === null ? newestOf(this.finds) : null);
  }

  /** @param {Api.Find[]} finds all that there are now */
  show(finds) {
    this.finds = finds;
    const newest = newestOf(finds);
    if (this.hiddenTo !== null && this.hiddenTo !== newest) this.hide(newest > this.hiddenTo ? null : newest);
    else this.draw();
  }

  /** Hide all up to the find of this id, or none. */
  hide(hiddenTo) {
    this.hiddenTo = hiddenTo;
    this.shownAlone = null;
    keep(hiddenTo);
    this.draw();
  }

  /** Show the marker of a find, also while they are hidden. */
  showAlone(find) {
    this.shownAlone = find.id;
    this.draw();
  }

  draw() {
    this.island = this.map.layer?.island;
    const here = this.finds.filter(({ island }) => island === this.island);
    const shown = here.filter(({ id }) => this.hiddenTo === null || id === this.shownAlone);
    this.pins.clearLayers();
    for (const find of shown) this.add(find);
    const hidden = here.length - shown.length;
    this.button.setAttribute("aria-pressed", String(this.hiddenTo === null));
    this.told.hidden = !hidden;
    this.told.textContent = hidden === 1 ? t("1 find hidden") : t("{n} finds hidden", { n: hidden });
  }

  /** @param {Api.Find} find */
  add(find) {
    const name = this.nameOf(find);
    const icon = L.divIcon({ className: "find", html: "", iconSize: [44, 44] });
    const marker = L.marker([find.y, find.x], { icon, title: name, alt: name, keyboard: true }).on("click", () => this.open(find));
    this.pins.addLayer(marker);
    marker.getElement().replaceChildren(element("span", { className: "upright", textContent: find.id }));
  }

  /** They are those of the island in view. */
  follow() {
    if (this.map.layer && this.island !== this.map.layer.island) this.draw();
  }
}

/** @param {Api.Find[]} finds */
function newestOf(finds) {
  return Math.max(0, ...finds.map(({ id }) => id));
}

/** What was kept on this device, if it is the id of a find. */
function kept() {
  try {
    const found = localStorage.getItem(KEY);
    return /^\d{1,9}$/.test(found ?? "") ? Number(found) : null;
  } catch {
    return null; // a browser that keeps nothing
  }
}

function keep(hiddenTo) {
  try {
    if (hiddenTo === null) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, String(hiddenTo));
  } catch {
    // it holds until the page is closed
  }
}
