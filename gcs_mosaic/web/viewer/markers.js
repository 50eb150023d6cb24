// @ts-check
// Markers of finds on the map. Many of them hide the ground, so they can be hidden: kept on this device for this flight, told over
// the map, and only until there is a find that was not there then.

import { byId, element } from "/viewer/dom.js";
import { servedFlight } from "/viewer/server.js";
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
    this.flight = null; // that they are of
    this.hiddenTo = null; // the id of the newest find that is hidden, or null
    this.shownAlone = null; // the id of the one that somebody went to meanwhile
    this.pins = L.layerGroup().addTo(map.map);
    this.button = byId("finds-show");
    this.told = byId("finds-hidden");
    this.button.onclick = () => this.hide(this.hiddenTo === null ? newestOf(this.finds) : null);
  }

  /** @param {Api.Find[]} finds all that there are now */
  show(finds) {
    this.finds = finds;
    if (this.flight !== servedFlight()) {
      this.flight = servedFlight();
      this.hiddenTo = keptOf(this.flight);
    }
    const newest = newestOf(finds);
    if (this.hiddenTo !== null && this.hiddenTo !== newest) this.hide(newest > this.hiddenTo ? null : newest);
    else this.draw();
  }

  /** Hide all up to the find of this id, or none. */
  hide(hiddenTo) {
    this.hiddenTo = hiddenTo;
    this.shownAlone = null;
    keep(this.flight, hiddenTo);
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

/** What was kept on this device of a flight, if it is the id of a find: another's finds have the same ids. */
function keptOf(flight) {
  try {
    const found = JSON.parse(localStorage.getItem(KEY));
    return found?.flight === flight && Number.isSafeInteger(found.to) ? found.to : null;
  } catch {
    return null; // a browser that keeps nothing, or somebody else's words
  }
}

function keep(flight, hiddenTo) {
  try {
    if (hiddenTo === null) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, JSON.stringify({ flight, to: hiddenTo }));
  } catch {
    // it holds until the page is closed
  }
}
