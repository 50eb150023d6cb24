// @ts-check
// What a click on the map means: usually the originals of that place; while a tool points, the tool's.

import { byId } from "/viewer/dom.js";
import { t } from "/viewer/words.js";

export class Pointing {
  /** `map`: the MosaicMap; `usual(island, x, y)`: what a click does while nothing else is asked for. */
  constructor(map, usual) {
    this.map = map;
    this.usual = usual;
    this.tool = null;
    this.hint = byId("hint");
    map.onPlace = (island, x, y) => (this.tool ? this.tool.place(island, x, y) : this.usual(island, x, y));
    map.map.on("mousemove", ({ latlng }) => this.tool?.move?.(latlng.lng, latlng.lat));
    document.addEventListener("keydown", ({ key }) => key === "Escape" && this.release());
  }

  /** `tool`: { button, said, place(island, x, y), move(x, y)?, end()? }; the one before it ends. */
  take(tool) {
    const isSame = this.tool === tool;
    this.release();
    if (isSame) return;
    this.tool = tool;
    this.map.setMode("free"); // nothing moves by itself under somebody who points
    tool.button?.setAttribute("aria-pressed", "true");
    this.hint.textContent = `${t(tool.said)} ${t("Escape ends it.")}`;
    this.hint.hidden = false;
    this.map.map.getContainer().classList.add("pointing");
  }

  release() {
    const tool = this.tool;
    this.tool = null;
    this.hint.hidden = true;
    this.map.map.getContainer().classList.remove("pointing");
    tool?.button?.setAttribute("aria-pressed", "false");
    tool?.end?.();
  }
}
