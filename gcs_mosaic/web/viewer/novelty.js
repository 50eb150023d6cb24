// @ts-check
// What is new since somebody last looked: tiles that were painted while the page was hidden, or since "Seen" was pressed.

import { byId } from "/viewer/dom.js";
import { t } from "/viewer/words.js";

const MOST = 4000; // tiles that are remembered

export class Novelty {
  constructor(map) {
    this.map = map;
    this.tiles = new Map();
    this.isOn = false;
    this.shade = L.layerGroup().addTo(map.map);
    this.renderer = L.canvas({ padding: 0.2 });
    this.button = byId("new-show");
    this.seen = byId("new-seen");
    this.told = byId("new-told");
    this.button.onclick = () => {
      this.isOn = !this.isOn;
      this.button.setAttribute("aria-pressed", String(this.isOn));
      this.draw();
    };
    this.seen.onclick = () => {
      this.tiles.clear();
      this.draw();
    };
  }

  /** Tiles [[island, z, x, y], …] were painted. */
  painted(tiles) {
    for (const tile of tiles ?? []) this.tiles.set(tile.join("/"), tile);
    for (const key of this.tiles.keys()) {
      if (this.tiles.size <= MOST) break;
      this.tiles.delete(key);
    }
    this.draw();
  }

  draw() {
    this.shade.clearLayers();
    const here = [...this.tiles.values()].filter(([island]) => island === this.map.layer?.island);
    this.told.textContent = here.length ? t("{n} tiles are new since you pressed Seen.", { n: here.length }) : t("Nothing is new.");
    for (const [, z, x, y] of this.isOn ? here : []) {
      const side = 256 * 2 ** (16 - z);
      const corner = [y * side - 2 ** 23 - 0.5, x * side - 2 ** 23 - 0.5];
      /** @type {any} */
      const bounds = [corner, [corner[0] + side, corner[1] + side]];
      this.shade.addLayer(L.rectangle(bounds, { renderer: this.renderer, color: "#009e73", weight: 2, fillColor: "#009e73", fillOpacity: 0.2, interactive: false }));
    }
  }
}
