// @ts-check
// Would a person have been seen? A layer, one figure for what was flown, and one for a part that is drawn.

import { byId } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { LiveTiles } from "/viewer/tiles.js";
import { said, t } from "/viewer/words.js";

const AGAIN_MS = 3000; // between two questions while the panel or the layer is shown
const LEAST_PX = 1.5; // as the server takes them
/** @type {[string, number][]} colour, width */
const LINE = [["#000", 5], ["#7ad7ff", 3]];

export class Detection {
  constructor(map, pointing) {
    this.map = map;
    this.pointing = pointing;
    this.tiles = null;
    this.corners = [];
    this.revision = 0;
    this.shown = ""; // what the tiles are of
    this.drawn = L.layerGroup().addTo(map.map);
    this.panel = byId("detection");
    this.posture = byId("detection-posture");
    this.clothes = byId("detection-clothes");
    this.pixels = byId("detection-pixels");
    this.button = byId("detection-show");
    this.told = byId("detection-told");
    this.part = byId("detection-part");
    const draw = byId("detection-draw");
    const tool = { button: draw, said: "Click round the part.", place: (island, x, y) => this.add(island, x, y) };
    draw.onclick = () => {
      this.forgetPart();
      this.pointing.take(tool);
    };
    this.button.onclick = () => this.toggle();
    for (const input of [this.posture, this.clothes, this.pixels]) input.addEventListener("change", () => this.readAnew());
    map.layers.select.addEventListener("change", () => this.giveWay());
    this.panel.addEventListener("opened", () => this.read());
    setInterval(() => this.isWanted() && this.read(), AGAIN_MS);
  }

  /** Who is sought. */
  sought() {
    return { posture: this.posture.value, clothes: this.clothes.value };
  }

  isWanted() {
    return !document.hidden && Boolean(this.map.layer) && (!this.panel.hidden || this.tiles);
  }

  /** The map is at this revision. */
  follow() {
    if (this.map.layer?.island === this.island) return;
    this.island = this.map.layer?.island;
    this.forgetPart();
    this.blank();
    if (this.isWanted()) this.read();
  }

  /** Another layer was chosen: one at a time, and the legend is that one's. */
  giveWay() {
    if (!this.tiles || !this.map.layers.select.value) return;
    this.tiles.remove();
    this.tiles = null;
    this.button.setAttribute("aria-pressed", "false");
  }

  /** Something else is asked for than what the figures are of. */
  readAnew() {
    this.blank();
    return this.read();
  }

  blank() {
    this.told.textContent = this.part.textContent = byId("detection-said").textContent = "";
  }

  toggle() {
    const isOn = !this.tiles;
    this.button.setAttribute("aria-pressed", String(isOn));
    this.hide();
    if (isOn) this.begin();
    this.read();
  }

  hide() {
    this.tiles?.remove();
    this.tiles = null;
    byId("legend").hidden = true;
  }

  begin() {
    const { layers, layer } = this.map;
    if (!layer) return;
    layers.select.value = "";
    layers.choose(); // one layer at a time
    const path = (island, { z, x, y }, revision) => `/api/v1/detection/${island}/${z}/${x}/${y}.png?${this.asked()}&r=${revision}`;
    this.tiles = new LiveTiles(path, layer.island, 0, () => {}, { ...layers.options, zIndex: 5, opacity: 0.6, tileClass: "layer-tile" });
    this.tiles.addTo(this.map.map);
    this.shown = "";
  }

  asked() {
    const asked = new URLSearchParams(this.sought());
    const pixels = Number(this.pixels.value.replace(",", "."));
    if (!byId("detection-scale").hidden && pixels > 0) asked.set("pixels", String(pixels));
    return asked;
  }

  /**
   * @returns {`/api/v1/islands/${number}/detection?${string}`} what the figures are asked for by
   */
  address(island) {
    const asked = this.asked();
    if (this.corners.length > 2) asked.set("outline", this.corners.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(";"));
    return `/api/v1/islands/${island}/detection?${asked}`;
  }

  async read() {
    const island = this.map.layer?.island;
    if (island === undefined) return;
    const address = this.address(island);
    const answer = await fetchDocument(address).catch(() => null);
    if (this.map.layer?.island !== island || this.address(island) !== address) return; // who changed that has asked anew
    if (!answer) {
      this.blank();
      const pixels = Number(new URLSearchParams(address.split("?")[1]).get("pixels") ?? LEAST_PX);
      if (pixels < LEAST_PX) byId("detection-said").textContent = t("Nothing can be said of a person of less than {px} px.", { px: LEAST_PX });
      return;
    }
    this.tell(answer);
    if (!this.tiles) return;
    if (this.tiles.island !== island) {
      this.hide();
      this.begin();
    }
    const state = `${this.asked()} ${answer.map_revision} ${answer.measured}`;
    if (state === this.shown) return;
    this.shown = state;
    this.tiles.grow(this.map.layers.options);
    this.tiles.refresh(`${answer.map_revision}.${answer.measured}`, () => true);
    this.showLegend(answer.colours);
  }

  /** @param {Api.Detection} answer */
  tell(answer) {
    byId("detection-scale").hidden = answer.by === "anchor" || answer.by === "distance";
    const isWhole = answer.measured === answer.frames;
    this.told.textContent = answer.flown == null ? "" : t("{share} % in what was flown so far, gaps included", { share: percent(answer.flown) });
    this.told.classList.toggle("figure", isWhole); // of a few pictures it is none to go by
    const notes = [answer.trouble && said(answer.trouble)];
    if (answer.frames && !isWhole) notes.push(t("{n} of {all} pictures are measured.", { n: answer.measured, all: answer.frames }));
    if (answer.seen != null) notes.push(t("On ground that was seen: {share} %.", { share: percent(answer.seen) }));
    const unstated = Math.ceil(100 * (1 - (answer.covered ?? 1)));
    if (unstated) notes.push(t("Of {share} % of that ground nothing is stated, and it is not in these figures.", { share: unstated }));
    const unknown = answer.leaves_unknown ?? 0;
    if (unknown === 1) notes.push(t("Whether leaves hide the ground is not known, for no two looks tell: these figures are of open ground."));
    else if (unknown) notes.push(t("On {share} % of it no two looks tell whether leaves hide the ground: it is taken for as open as the rest.", { share: Math.ceil(100 * unknown) }));
    if (answer.person_px != null) notes.push(t("A person is {px} px across in an original.", { px: answer.person_px.toFixed(1) }));
    byId("detection-said").textContent = notes.filter(Boolean).join(" ");
    this.part.textContent = answer.part == null ? "" : t("{share} % in the part drawn", { share: percent(answer.part) });
  }

  showLegend(colours) {
    const box = byId("legend");
    const [title, worst, bar, best] = box.children;
    title.textContent = t("Would a person have been seen?");
    worst.textContent = "0 %";
    best.textContent = "100 %";
    bar.style.background = `linear-gradient(90deg, ${colours.join(", ")})`;
    box.hidden = false;
  }

  add(island, x, y) {
    if (island !== this.map.layer?.island) return;
    this.corners.push([x, y]);
    this.drawn.clearLayers();
    /** @type {[number, number][]} */
    const corners = this.corners.map(([cx, cy]) => [cy, cx]);
    for (const [color, weight] of LINE) this.drawn.addLayer(L.polygon(corners, { color, weight, fill: false, interactive: false }));
    this.part.textContent = "";
    if (this.corners.length > 2) this.read();
  }

  forgetPart() {
    this.corners = [];
    this.drawn.clearLayers();
    this.part.textContent = "";
  }
}

function percent(share) {
  return Math.round(100 * share);
}
