// @ts-check
// Layers over the map: how often, how finely, how lately the ground was seen; and gaps, which need no click.

import { byId, element } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { LiveTiles } from "/viewer/tiles.js";
import { said, t } from "/viewer/words.js";

const EACH_MS = 5000; // gaps and layers are asked for again while the map changes

export class Layers {
  constructor(map) {
    this.map = map;
    this.tiles = null;
    this.island = null;
    this.revision = -1;
    this.due = 0;
    this.showsGaps = true;
    this.gapLines = L.layerGroup().addTo(map);
    this.select = byId("layer");
    this.button = byId("gaps");
    this.select.onchange = () => this.choose();
    this.button.onclick = () => this.toggleGaps();
    this.legends = new Map();
    this.readLegends();
  }

  async readLegends() {
    try {
      const { layers } = await fetchDocument("/api/v1/layers");
      for (const one of layers) {
        this.legends.set(one.name, one);
        this.select.append(new Option(t(one.title), one.name));
      }
    } catch {
      setTimeout(() => this.readLegends(), EACH_MS);
    }
  }

  /** The island in view, its tiles' options, and the revision of the map. */
  show(island, options, revision) {
    const isAnother = this.island?.id !== island.id;
    this.island = island;
    this.options = options;
    const isDue = revision !== this.revision && Date.now() >= this.due;
    if (!isAnother && !isDue) return;
    this.revision = revision;
    this.due = Date.now() + EACH_MS;
    if (isAnother) {
      this.gapLines.clearLayers();
      this.choose();
    } else {
      this.tiles?.grow(options);
      this.tiles?.refresh(revision, () => true);
    }
    this.readGaps();
  }

  choose() {
    this.tiles?.remove();
    this.tiles = null;
    const legend = this.legends.get(this.select.value);
    this.showLegend(legend);
    if (!legend || !this.island) return;
    const path = (island, { z, x, y }, revision) => `/api/v1/layers/${legend.name}/${island}/${z}/${x}/${y}.png?r=${revision}`;
    this.tiles = new LiveTiles(path, this.island.id, this.revision, () => {}, { ...this.options, zIndex: 5 });
    this.tiles.addTo(this.map);
  }

  /** @param {Api.LayerLegend} legend */
  showLegend(legend) {
    const box = byId("legend");
    box.hidden = !legend;
    if (!legend) return;
    const [title, worst, bar, best] = box.children;
    title.textContent = t(legend.title);
    worst.textContent = t(legend.worst);
    best.textContent = t(legend.best);
    bar.style.background = `linear-gradient(90deg, ${legend.colours.join(", ")})`;
  }

  toggleGaps() {
    this.showsGaps = !this.showsGaps;
    this.button.setAttribute("aria-pressed", String(this.showsGaps));
    if (this.showsGaps) this.readGaps();
    else this.gapLines.clearLayers();
  }

  async readGaps() {
    if (!this.showsGaps || !this.island) return;
    const island = this.island.id;
    const answer = await fetchDocument(`/api/v1/islands/${island}/gaps`).catch(() => null); // those that are drawn stay
    if (!answer || island !== this.island.id || !this.showsGaps) return;
    this.button.textContent = answer.gaps.length ? `${t("Gaps")}: ${answer.gaps.length}` : t("Gaps");
    this.gapLines.clearLayers();
    for (const gap of answer.gaps) this.gapLines.addLayer(gapLayer(gap));
  }
}

/**
 * Dashed vermilion on black: seen on any ground, and by eyes that do not tell red from green.
 * @param {Api.Gap} gap
 */
function gapLayer({ outline, words }) {
  /** @type {[number, number][]} */
  const corners = outline.map(([x, y]) => [y, x]);
  const line = (color, weight, dashArray) => L.polygon(corners, { color, weight, dashArray, fillColor: "#d55e00", fillOpacity: 0.25 });
  const group = L.featureGroup([line("#000", 5), line("#ff8a3d", 3, "8 6")]);
  return group.bindTooltip(element("span", { className: "upright", textContent: t("Not seen: {area}. Fly here again.", { area: said(words) }) }));
}
