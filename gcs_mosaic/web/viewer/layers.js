// @ts-check
// Layers over the map: how often, how finely, how lately the ground was seen; and gaps, which need no click.

import { byId, element } from "/viewer/dom.js";
import { Fresh } from "/viewer/fresh.js";
import { fetchDocument } from "/viewer/server.js";
import { LiveTiles, affectedBy } from "/viewer/tiles.js";
import { said, t } from "/viewer/words.js";

const LEGENDS_AGAIN_MS = 5000;
const OPACITY = 0.6; // of the layer as a whole: its tiles overlap a little
const ALL_AGAIN_MS = 4000; // after a change, for tiles near which nothing was painted
const CHANGES = "changes"; // the layer that is compared while it is looked at: each question has some more frames compared
const CHANGES_AGAIN_MS = 200;
const CHANGES_LATER_MS = 2000; // where the last question brought nothing on

export class Layers {
  constructor(map) {
    this.map = map;
    this.tiles = null;
    this.island = null;
    this.revision = 0; // of the map, which the layer's tiles are as new as
    /** @type {[number, number, number][] | null} */
    this.changed = []; // tiles of the map, since the layer's were asked for; null: any
    this.timer = 0;
    this.again = 0; // so that a browser does not take for the same what is asked for at the same revision
    this.showsGaps = true;
    this.gaps = 0;
    this.onGaps = () => {}; // called when their number has changed
    this.fresh = new Fresh(() => this.readGaps(), (isOld) => this.tellOld(isOld));
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
      setTimeout(() => this.readLegends(), LEGENDS_AGAIN_MS);
    }
  }

  /** The island in view, and its tiles' options. */
  show(island, options) {
    const isAnother = this.island?.id !== island.id;
    this.island = island;
    this.options = options;
    if (!isAnother) return;
    this.gapLines.clearLayers();
    this.gaps = 0;
    this.fresh.begin();
    this.choose();
    this.fresh.again();
  }

  /** The map is at this revision. */
  follow(revision) {
    if (this.island && (this.showsGaps || this.tiles)) this.fresh.follow(revision);
  }

  /** Tiles [z, x, y] of the island in view were painted; null: any. */
  painted(tiles) {
    this.changed = tiles && this.changed && [...this.changed, ...tiles];
  }

  /** The server knows the frames of this revision: what it answers from now on is as new. */
  renew(revision) {
    if (revision <= this.revision) return;
    this.revision = revision;
    if (!this.tiles) return;
    this.tiles.grow(this.options);
    this.tiles.refresh(revision, this.changed ? affectedBy(this.changed) : () => true);
    this.changed = [];
    this.timer ||= window.setTimeout(() => this.renewAll(), ALL_AGAIN_MS);
  }

  /** What is usual of an island, which colours go by, and frames that moved a little change tiles where nothing was painted. */
  renewAll() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.again++;
    this.tiles?.refresh(this.revision, () => true);
  }

  tellOld(isOld) {
    this.button.classList.toggle("old", isOld);
    this.map.getContainer().classList.toggle("old-gaps", isOld);
    this.tell();
  }

  tell() {
    const counted = this.gaps ? `${t("Gaps")}: ${this.gaps}` : t("Gaps");
    const isOld = this.button.classList.contains("old");
    this.button.textContent = isOld ? t("{gaps} (older than the map)", { gaps: counted }) : counted;
    this.onGaps();
  }

  choose() {
    this.tiles?.remove();
    this.tiles = null;
    const legend = this.legends.get(this.select.value);
    this.showLegend(legend);
    if (!legend || !this.island) return;
    const path = (island, { z, x, y }, revision) => `/api/v1/layers/${legend.name}/${island}/${z}/${x}/${y}.png?r=${revision}${this.again ? `&again=${this.again}` : ""}`;
    this.changed = [];
    this.tiles = new LiveTiles(path, this.island.id, this.revision, () => {}, { ...this.options, zIndex: 5, opacity: OPACITY, tileClass: "layer-tile" });
    this.tiles.addTo(this.map);
    if (legend.name === CHANGES) this.compare(this.tiles);
  }

  /** Have the flights compared for as long as these tiles are looked at. */
  async compare(tiles) {
    const about = byId("legend").querySelector("small");
    for (let compared = 0, frames = 1; compared < frames && this.tiles === tiles; ) {
      const answer = await fetchDocument(`/api/v1/islands/${this.island.id}/changes`).catch(() => null);
      if (this.tiles !== tiles) return;
      const wait = answer && answer.compared > compared ? CHANGES_AGAIN_MS : CHANGES_LATER_MS;
      if (answer) {
        ({ compared, frames } = answer);
        about.textContent = aboutChanges(answer);
      }
      if (compared < frames) await new Promise((done) => setTimeout(done, wait));
    }
    this.renewAll();
  }

  /** @param {Api.LayerLegend} legend */
  showLegend(legend) {
    const box = byId("legend");
    box.hidden = !legend;
    if (!legend) return;
    const [title, worst, bar, best, about] = box.children;
    about.textContent = "";
    title.textContent = t(legend.title);
    worst.textContent = t(legend.worst);
    best.textContent = t(legend.best);
    bar.style.background = `linear-gradient(90deg, ${legend.colours.join(", ")})`;
  }

  toggleGaps() {
    this.showsGaps = !this.showsGaps;
    this.button.setAttribute("aria-pressed", String(this.showsGaps));
    if (this.showsGaps) this.fresh.again();
    else this.gapLines.clearLayers();
  }

  /** Of the island in view; the map's revision that they are of. */
  async readGaps() {
    if (!this.island) return null;
    const island = this.island.id;
    const answer = await fetchDocument(`/api/v1/islands/${island}/gaps?r=${Math.max(0, this.fresh.wanted)}`);
    if (!answer || island !== this.island.id) return null;
    this.renew(answer.map_revision);
    this.gaps = answer.gaps.length;
    this.gapLines.clearLayers();
    if (this.showsGaps) for (const gap of answer.gaps) this.gapLines.addLayer(gapLayer(gap));
    this.tell();
    return answer.map_revision;
  }
}

/**
 * How much of the ground the layer of changes tells of.
 * @param {Api.GroundChanges} answer
 */
function aboutChanges({ compared, frames, ground, unshown }) {
  if (compared < frames) return t("{n} of {all} frames are compared.", { n: compared, all: frames });
  const told = [t("{share} % of the ground is compared; the grey was seen by one flight alone, or only near the edges of pictures.", { share: Math.floor(100 * (ground ?? 0)) })];
  if (unshown) told.push(t("{n} frames cannot be shown, and are not compared.", { n: unshown }));
  return [...told, t("Shadows and what stands up differ, too.")].join(" ");
}

/**
 * Dashed vermilion on black: seen on any ground, and by eyes that do not tell red from green.
 * @param {Api.Gap} gap
 */
function gapLayer({ outline, words }) {
  /** @type {[number, number][]} */
  const corners = outline.map(([x, y]) => [y, x]);
  const line = (color, weight, dashArray) => L.polygon(corners, { color, weight, dashArray, fillColor: "#d55e00", fillOpacity: 0.25, className: "gap" });
  const group = L.featureGroup([line("#000", 5), line("#ff8a3d", 3, "8 6")]);
  return group.bindTooltip(element("span", { className: "upright", textContent: t("Not seen: {area}. Fly here again.", { area: said(words) }) }));
}
