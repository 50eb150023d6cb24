// @ts-check
// The map of one island: which one, which part of it, and the newest frame's outline.

import { byId } from "/viewer/dom.js";
import { isOutOfKept } from "/viewer/kept.js";
import { Layers } from "/viewer/layers.js";
import { outlineLayer, outlineOf } from "/viewer/outline.js";
import { LiveTiles, affectedBy, retryAll } from "/viewer/tiles.js";
import { Turn } from "/viewer/turn.js";
import { t } from "/viewer/words.js";

const BASE_LEVEL = 16; // one tile pixel per canvas unit
const ORIGIN = 2 ** 23 + 0.5; // canvas units from the grid's edge to the canvas' origin
const SHRINK_LEVELS = 1; // ... and out beyond the coarsest
const ROOM_AROUND = 0.75; // of the island's size on each side: as far as one may move away
const ZOOM_SNAP = 0.25;
const OVERLAP_PX = 2; // on the screen, of tiles that are not shown pixel by pixel: one may be lost to rounding at either edge
const ROOM_PX = 12; // about what is fitted into the pane
const MAGNIFY_LEVELS = 3; // how far one may zoom in beyond the finest tiles

/** Canvas units as latitude (y, down) and longitude (x); zoom 16 shows a canvas unit as a CSS pixel. */
const CANVAS = L.extend({}, L.CRS.Simple, {
  transformation: new L.Transformation(1, ORIGIN, 1, ORIGIN),
  scale: (zoom) => 2 ** (zoom - BASE_LEVEL),
  zoom: (scale) => Math.log2(scale) + BASE_LEVEL,
});

export class MosaicMap {
  constructor() {
    this.map = L.map("map", {
      crs: CANVAS, attributionControl: false, zoomControl: false, zoomSnap: ZOOM_SNAP, zoomDelta: 0.5, fadeAnimation: false,
      maxBoundsViscosity: 1,
    });
    L.control.zoom({ position: "bottomright" }).addTo(this.map);
    this.layer = null;
    this.outline = null;
    this.revision = 0;
    this.mosaic = null;
    this.newestFrame = null;
    this.painted = null; // the part of the island in view that is painted: [left, top, right, bottom]
    this.isAway = false; // whether the server is
    this.hidesNewest = false; // while the flight is played again
    this.colourOf = (_frame) => "#ffe600"; // of the newest frame's outline
    this.onPlace = null; // called with island, x and y of a place that was clicked
    this.chosenIsland = null; // by hand; null: the newest or largest
    this.layers = new Layers(this.map);
    this.turn = new Turn(this.map);
    this.turn.onTurned = () => this.keepInView();
    this.bind();
    this.setMode("all");
  }

  pointAt({ lng, lat }) {
    if (this.layer) this.onPlace?.(this.layer.island, lng, lat);
  }

  bind() {
    this.movedByUs = false;
    this.map.on("click", ({ latlng }) => this.pointAt(latlng));
    const container = this.map.getContainer();
    container.addEventListener("keydown", ({ key, repeat, target }) => {
      if (key === "Enter" && !repeat && target === container) this.pointAt(this.map.getCenter()); // for whom moves it by keys
    });
    this.map.on("dragstart", () => this.setMode("free"));
    this.map.on("zoomstart", () => this.mode === "all" && !this.movedByUs && this.setMode("free"));
    this.map.on("resize", () => this.keepInView());
    this.map.on("viewreset zoomend", () => this.closeHairlines());
    // The map also changes its size when notices come or the alarm goes, which Leaflet does not see by itself.
    new ResizeObserver(() => this.map.invalidateSize({ animate: false })).observe(this.map.getContainer());
    for (const mode of ["all", "newest"]) {
      byId(mode).onclick = () => this.setMode(this.mode === mode ? "free" : mode);
    }
  }

  /** What the view keeps showing: "all" (the whole island), "newest" (the newest frame), "free" (what the user chose). */
  setMode(mode) {
    this.mode = mode;
    for (const name of ["all", "newest"]) {
      byId(name).setAttribute("aria-pressed", String(mode === name));
    }
    if (mode === "newest") this.chosenIsland = null;
    if (this.mosaic) this.showIsland();
  }

  chooseIsland(island) {
    this.chosenIsland = island;
    this.setMode("all");
  }

  /** While the server is away nothing is moved by us: what is not loaded could not be shown. */
  setAway(isAway) {
    if (this.isAway && !isAway) retryAll();
    this.isAway = isAway;
  }

  /** `boundsOf`: of an island's number, what is painted of it. */
  show(mosaic, newestFrame, boundsOf) {
    if (!mosaic || !mosaic.islands.length) return;
    this.mosaic = mosaic;
    this.newestFrame = newestFrame;
    this.boundsOf = boundsOf;
    this.turn.follow(newestFrame);
    byId("all").textContent = this.islands().length > 1 ? t("This whole part") : t("Whole map");
    this.showIsland();
  }

  /** Tiles [[island, z, x, y], …] were painted; null: anything may have changed. */
  tilesChanged(revision, tiles) {
    if (!tiles && revision === this.revision) return;
    this.revision = revision;
    if (!this.layer) return;
    const ours = tiles?.filter(([island]) => island === this.layer.island).map(([, ...tile]) => tile);
    this.layers.painted(ours ?? null);
    this.layer.refresh(revision, ours ? affectedBy(ours) : () => true);
  }

  /** Whatever single exchanges may have missed: done at rest, when the flight's state changes. */
  refreshAll() {
    this.layer?.refresh(this.revision, () => true);
  }

  islands() {
    return this.mosaic.islands.filter((island) => island.merged_into === undefined);
  }

  /** The chosen island, or the newest frame's when following it, or the one with most frames. */
  currentIsland() {
    const islands = this.islands();
    const wanted = this.chosenIsland ?? (this.mode === "newest" ? this.newestFrame?.island : null);
    const byFrames = [...islands].sort((a, b) => b.frames - a.frames);
    return islands.find((island) => island.id === wanted) ?? byFrames[0];
  }

  showIsland() {
    const island = this.currentIsland();
    if (!island) return;
    const options = layerOptions(island);
    this.map.setMaxZoom(island.maxzoom + MAGNIFY_LEVELS);
    this.limitView(island.minzoom - SHRINK_LEVELS, options.bounds.pad(ROOM_AROUND));
    if (this.layer?.island !== island.id) this.startLayer(island.id, options);
    this.bounds = paintedBounds(options.bounds, this.boundsOf(island.id));
    this.showOutline();
    this.keepInView();
    this.layer.grow(options);
    this.closeHairlines();
    this.layers.show(island, options);
  }

  /** Set anew only when they change: it stops a finger that moves the map. */
  limitView(minZoom, bounds) {
    if (this.limits?.minZoom === minZoom && this.limits.bounds.equals(bounds)) return;
    this.limits = { minZoom, bounds };
    this.map.setMinZoom(minZoom); // each level less has four times as many tiles in view
    this.map.setMaxBounds(bounds);
  }

  startLayer(island, options) {
    this.layer?.remove();
    this.outlined = null;
    this.layer = new LiveTiles(mosaicTile, island, Math.max(this.revision, this.mosaic.revision), () => this.showOutline(), options);
    this.look(options.bounds);
    this.layer.addTo(this.map);
  }

  /** Between tiles that are not shown pixel by pixel a browser leaves hairlines; they then overlap a little (see viewer.css). */
  closeHairlines() {
    const zoom = this.map.getZoom();
    const { minNativeZoom: least, maxNativeZoom: most } = this.layer?.options ?? {};
    const isPixelByPixel = zoom % 1 === 0 && zoom >= least && zoom <= most && devicePixelRatio === 1;
    const container = this.map.getContainer();
    container.classList.toggle("between-levels", !isPixelByPixel);
    const shownAt = 2 ** (zoom - Math.min(Math.max(Math.round(zoom), least), most)); // the browser's scale of a tile
    container.style.setProperty("--overlap", `${OVERLAP_PX / shownAt}px`);
  }

  keepInView() {
    if (!this.layer || this.isAway) return;
    if (this.mode === "all") this.look(this.bounds);
    if (this.mode === "newest" && this.outline) this.lookAtNewest(this.outline.getBounds());
  }

  lookAtNewest(place) {
    if (this.turn.sees(place)) return;
    const [width, height] = this.turn.extent(place).map((side) => side * 2 ** (this.map.getZoom() - BASE_LEVEL));
    const [across, down] = this.turn.size;
    if (width > across || height > down) this.look(place);
    else this.map.panTo(place.getCenter());
  }

  look(bounds) {
    const [width, height] = this.turn.extent(bounds);
    const [across, down] = this.turn.size;
    const { top, right } = underTools();
    const room = [across - right - ROOM_PX, down - top - ROOM_PX].map((side) => Math.max(side, 1)); // a pane may be hidden, or tiny
    const fitting = BASE_LEVEL + Math.log2(Math.min(room[0] / width, room[1] / height));
    const zoom = Math.min(Math.max(Math.floor(fitting / ZOOM_SNAP) * ZOOM_SNAP, this.map.getMinZoom()), this.map.getMaxZoom());
    const aside = this.turn.turnedBack(L.point((ROOM_PX - right) / 2, (top - ROOM_PX) / 2)).divideBy(2 ** (zoom - BASE_LEVEL));
    const { lat, lng } = bounds.getCenter();
    this.movedByUs = true;
    this.map.setView([lat - aside.y, lng - aside.x], zoom, { animate: false });
    this.movedByUs = false;
  }

  /** The newest frame's outline, as soon as its ground is shown: it never stands on bare ground. */
  showOutline() {
    const isShown = this.newestFrame && this.newestFrame.island === this.layer?.island && !this.hidesNewest;
    const ours = isShown ? this.newestFrame : null;
    if (ours && (!this.layer.isComplete() || JSON.stringify(ours.canvas_from_frame) === this.outlined)) return;
    this.outline?.remove();
    const corners = ours && outlineOf(ours);
    this.outline = corners && outlineLayer(corners, this.colourOf(ours)).addTo(this.map);
    this.outlined = corners && JSON.stringify(ours.canvas_from_frame);
    if (this.outline) this.keepInView();
  }
}

/** CSS pixels at the top and on the right that buttons stand on: what is looked at is not under them. */
function underTools() {
  const zoom = /** @type {HTMLElement | null} */ (document.querySelector("#pane .leaflet-control-zoom"));
  return { top: byId("top").offsetHeight + ROOM_PX, right: (zoom?.offsetWidth ?? 0) + ROOM_PX };
}

/** What is painted within an island's tiles; all of them while that is not known. */
function paintedBounds(tiles, painted) {
  if (!painted) return tiles;
  const [left, top, right, bottom] = painted;
  const clamp = (value, least, most) => Math.min(Math.max(value, least), most);
  const y = (value) => clamp(value, tiles.getSouth(), tiles.getNorth());
  const x = (value) => clamp(value, tiles.getWest(), tiles.getEast());
  return L.latLngBounds([y(top), x(left)], [y(bottom), x(right)]);
}

function mosaicTile(island, { z, x, y }, revision) {
  return `/tiles/${island}/${z}/${x}/${y}?r=${revision}${isOutOfKept() ? "&kept" : ""}`;
}

function layerOptions({ bounds: [left, top, right, bottom], minzoom, maxzoom }) {
  return {
    bounds: L.latLngBounds([top, left], [bottom, right]),
    minNativeZoom: minzoom,
    maxNativeZoom: maxzoom,
    maxZoom: maxzoom + MAGNIFY_LEVELS,
    updateInterval: 100,
    keepBuffer: 3,
  };
}
