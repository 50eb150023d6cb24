// @ts-check
// What a click on the map means: usually the originals of that place; while a tool points, the tool's.

import { byId } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { t } from "/viewer/words.js";

export class Pointing {
  /** `map`: the MosaicMap; `usual(island, x, y)`: what a click does while nothing else is asked for. */
  constructor(map, usual) {
    this.map = map;
    this.usual = usual;
    this.tool = null;
    this.hint = byId("hint");
    byId("hint-end").onclick = () => this.release();
    // The tool of a panel that is closed, or left for another one, does not stay armed unseen.
    for (const panel of document.querySelectorAll("section.panel")) {
      panel.addEventListener("closed", () => this.tool?.button && panel.contains(this.tool.button) && this.release());
    }
    map.onPlace = (island, x, y) => (this.tool ? this.tool.place(island, x, y) : this.usual(island, x, y));
    map.map.on("mousemove", ({ latlng }) => this.tool?.move?.(latlng.lng, latlng.lat));
    closeByEscape("tool", () => this.tool !== null, () => this.release());
  }

  /** `tool`: { button, said, place(island, x, y), move(x, y)?, end()? }; the one before it ends. */
  take(tool) {
    const isSame = this.tool === tool;
    this.release();
    if (isSame) return;
    this.tool = tool;
    this.map.setMode("free"); // nothing moves by itself under somebody who points
    tool.button?.setAttribute("aria-pressed", "true");
    this.hint.querySelector("output").textContent = t(tool.said);
    this.hint.hidden = false;
    this.map.map.doubleClickZoom.disable(); // two points that are near each other are two points
    this.map.map.getContainer().classList.add("pointing");
    this.handKeys(tool.button);
  }

  /** Whoever works by keys moves the map next; a mouse leaves the keyboard where it is. */
  handKeys(button) {
    const container = this.map.map.getContainer();
    const { activeElement } = document;
    const isNowhere = activeElement === document.body || container.contains(activeElement);
    if (isNowhere || button?.matches(":focus-visible")) container.focus({ preventScroll: true });
  }

  release() {
    const tool = this.tool;
    this.tool = null;
    this.hint.hidden = true;
    this.map.map.doubleClickZoom.enable();
    this.map.map.getContainer().classList.remove("pointing");
    tool?.button?.setAttribute("aria-pressed", "false");
    tool?.end?.();
  }
}

/** A mark where something is about to be set, which stays until it is set or given up. */
export class ChosenPlace {
  /** `map`: the MosaicMap. */
  constructor(map) {
    this.marks = L.layerGroup().addTo(map.map);
  }

  /** @param {number} x @param {number} y on the canvas */
  show(x, y) {
    this.marks.clearLayers();
    const icon = L.divIcon({ className: "chosen-place", iconSize: [32, 32] });
    this.marks.addLayer(L.marker([y, x], { icon, interactive: false, keyboard: false }));
  }

  clear() {
    this.marks.clearLayers();
  }
}
