// @ts-check
// The islands side by side, each with a picture of its own, so that nobody thinks that they are connected.

import { byId, focusedIn } from "/viewer/dom.js";
import { t } from "/viewer/words.js";

const THUMB = 256; // px: one tile of the coarsest level that holds the island, or four

export class Islands {
  constructor(map) {
    this.map = map;
    this.list = byId("islands-list");
    this.told = byId("islands-told");
    this.shown = "";
    byId("islands").addEventListener("opened", () => this.show());
  }

  show() {
    if (byId("islands").hidden || !this.map.mosaic) return;
    const islands = [...this.map.islands()].sort((one, other) => other.frames - one.frames);
    const state = JSON.stringify([islands, this.map.layer?.island, Math.floor(this.map.revision / 10)]);
    if (state === this.shown) return;
    this.shown = state;
    this.told.textContent = islands.length === 1 ? t("All frames are on one map.") : t("These islands are not connected: nothing tells how one lies to another.");
    const focused = focusedIn("island");
    this.list.replaceChildren(...islands.map((island) => this.row(island)));
    if (focused !== undefined) this.list.querySelector(`[data-island="${focused}"]`)?.focus();
  }

  row(island) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", onclick: () => this.map.chooseIsland(island.id) });
    button.dataset.island = island.id;
    button.setAttribute("aria-pressed", String(island.id === this.map.layer?.island));
    const words = document.createElement("span");
    words.textContent = t(island.frames === 1 ? "Island {id}: 1 frame" : "Island {id}: {n} frames", { id: island.id, n: island.frames });
    button.append(this.picture(island), words);
    const item = document.createElement("li");
    item.append(button);
    return item;
  }

  /** The coarsest tiles that there are, at most three across: an island's own picture. */
  picture({ id, bounds: [left, top, right, bottom], minzoom }) {
    const unit = 2 ** (16 - minzoom); // canvas units of a pixel
    const first = (place) => Math.floor((place + 2 ** 23 + 0.5) / (THUMB * unit));
    const [x0, y0, x1, y1] = [first(left), first(top), first(right - 1), first(bottom - 1)];
    const corner = (tile) => tile * THUMB * unit - 2 ** 23 - 0.5;
    const scale = 96 / Math.max(right - left, bottom - top);
    const box = document.createElement("i");
    box.className = "thumb";
    box.setAttribute("aria-hidden", "true");
    for (let x = x0; x <= Math.min(x1, x0 + 3); x++) {
      for (let y = y0; y <= Math.min(y1, y0 + 3); y++) {
        const image = Object.assign(new Image(), { src: `/tiles/${id}/${minzoom}/${x}/${y}?r=${this.map.revision}`, alt: "", loading: "lazy" });
        Object.assign(image.style, { left: `${(corner(x) - left) * scale}px`, top: `${(corner(y) - top) * scale}px`, width: `${THUMB * unit * scale}px` });
        box.append(image);
      }
    }
    return box;
  }
}
