// @ts-check
// An island laid on a map that the team brings: its picture lies half transparent on it, and is dragged by its corners. Each corner
// that was dragged becomes a pin.

import { send, trying } from "/viewer/api.js";
import { byId } from "/viewer/dom.js";
import { metresIn } from "/viewer/numbers.js";
import { outlineLayer } from "/viewer/outline.js";
import { fetchDocument } from "/viewer/server.js";
import { laidAt, similarity } from "/viewer/similarity.js";
import { said, t } from "/viewer/words.js";

const TILE = 256; // px
const MOST_ACROSS = 4; // tiles of the picture
const HANDLE_PX = 44; // for a finger
const USUAL_SIGMA_M = 10;
const NEARER = 4; // levels beyond the base map's finest
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const EARTH = L.CRS.EPSG3857;

const LABELS = [1, 2, 3, 4].map((n) => `corner ${n}`); // as they are kept, in whatever language the page is

export class Laying {
  /** `map`: the MosaicMap; `placements`: where frames lie; `onTaken`: called when pins were made. */
  constructor(map, placements, onTaken) {
    this.mosaic = map;
    this.placements = placements;
    this.onTaken = onTaken;
    this.dialog = byId("laying");
    this.form = byId("laying-form");
    this.told = byId("laying-told");
    this.said = byId("laying-said");
    this.button = byId("laying-open");
    this.button.onclick = () => this.open();
    this.form.onsubmit = (event) => this.take(event);
    this.form.elements.opacity.oninput = () => this.draw();
    byId("laying-cancel").onclick = () => this.dialog.close();
    this.dialog.onclose = () => this.end();
    byId("anchors").addEventListener("opened", () => this.look());
  }

  /** Whether there is a base map, and where it lies. */
  async look() {
    this.underlay = (await fetchDocument("/api/v1/maps").catch(() => null))?.underlay;
    this.button.hidden = !this.underlay;
  }

  async open() {
    const { mosaic, bounds } = this.mosaic;
    if (!mosaic || !bounds) return;
    this.island = this.mosaic.currentIsland();
    const [left, top, right, bottom] = [bounds.getWest(), bounds.getSouth(), bounds.getEast(), bounds.getNorth()]; // y grows downwards
    this.box = [left, top, right, bottom];
    this.corners = [[left, top], [right, top], [right, bottom], [left, bottom]];
    this.spots = this.corners.map(() => null); // where each was dragged to
    this.said.textContent = "";
    this.dialog.showModal();
    const map = (this.map = baseMap(this.underlay));
    const known = await this.knownSpots();
    if (this.map !== map) return; // it was closed meanwhile
    this.laid = known ? similarity(this.corners.map((corner, at) => [corner, known[at]])) : this.inTheMiddle();
    if (known) this.map.fitBounds(L.latLngBounds(known.map(latLngOf)).pad(0.5), { animate: false });
    this.show();
  }

  /** The corners as an anchor lays them; null without one. */
  async knownSpots() {
    const asked = this.corners.map(([x, y]) => fetchDocument(`/api/v1/coordinates?island=${this.island.id}&x=${x}&y=${y}`));
    const places = (await Promise.all(asked).catch(() => [])).map((answer) => answer?.place);
    return places.length && places.every(Boolean) ? places.map(({ latitude, longitude }) => spotOf(L.latLng(latitude, longitude))) : null;
  }

  /** North up, half as large as the view. */
  inTheMiddle() {
    const [left, top, right, bottom] = this.box;
    const { x: across, y: down } = this.map.getSize();
    const east = EARTH.project(this.map.containerPointToLatLng([across, 0])).x - EARTH.project(this.map.containerPointToLatLng([0, 0])).x;
    const along = (Math.min(across / (right - left), down / (bottom - top)) / 2) * (east / across);
    return similarity([[[(left + right) / 2, (top + bottom) / 2], spotOf(this.map.getCenter())]], { along, across: 0 });
  }

  show() {
    this.picture = pictureOf(this.island, this.box, this.mosaic.revision);
    this.map.getPane("overlayPane").append(this.picture);
    this.outline = outlineLayer(this.laidCorners(), "#ffe600").addTo(this.map);
    this.handles = this.corners.map((_, at) => this.handle(at));
    this.map.on("zoom viewreset", () => this.draw());
    this.map.on("moveend", () => this.tellView());
    this.tellView();
    this.draw();
  }

  handle(at) {
    const icon = L.divIcon({ className: "handle", html: `<b>${at + 1}</b>`, iconSize: [HANDLE_PX, HANDLE_PX] });
    const marker = L.marker(this.laidCorners()[at], { icon, draggable: true, autoPanOnFocus: false, riseOnHover: true }).addTo(this.map);
    const element = marker.getElement();
    /** @type {any} */ (marker.dragging)._draggable.options.clickTolerance = 0; // a pixel counts
    marker.on("drag", () => this.move(at, marker.getLatLng()));
    element.addEventListener("keydown", (event) => this.onKey(event, at, marker));
    element.addEventListener("focus", () => element.matches(":focus-visible") && this.bringInView(marker.getLatLng()));
    return marker;
  }

  onKey(event, at, marker) {
    const step = STEPS[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const place = this.map.project(marker.getLatLng()).add(L.point(step[0], step[1]).multiplyBy(event.shiftKey ? 10 : 1));
    this.move(at, this.map.unproject(place));
    this.bringInView(marker.getLatLng());
  }

  /** For the keyboard only: under a finger nothing moves by itself. */
  bringInView(latlng) {
    this.map.panInside(latlng, { padding: [HANDLE_PX, HANDLE_PX], animate: false });
  }

  /** A corner lies there now; the picture follows. */
  move(at, latlng) {
    this.spots[at] = spotOf(latlng);
    this.laid = similarity(this.pairs(), this.laid);
    this.draw();
  }

  pairs() {
    return this.corners.map((corner, at) => [corner, this.spots[at]]).filter(([, spot]) => spot);
  }

  laidCorners() {
    return this.corners.map((corner) => latLngOf(laidAt(this.laid, corner)));
  }

  draw() {
    if (!this.handles) return;
    const corners = this.laidCorners();
    this.outline.invoke("setLatLngs", corners);
    this.picture.style.opacity = this.form.elements.opacity.value;
    this.picture.style.transform = this.placing(corners);
    this.handles.forEach((marker, at) => {
      const spot = this.spots[at];
      marker.setLatLng(spot ? latLngOf(spot) : corners[at]);
      marker.getElement().classList.toggle("set", Boolean(spot));
      marker.getElement().setAttribute("aria-label", t(spot ? "Corner {n}: set" : "Corner {n}: not set. Drag it, or move it with the arrow keys.", { n: at + 1 }));
    });
    this.told.textContent = this.sentence();
    byId("laying-take").disabled = this.pairs().length < 2;
  }

  /** From the picture's pixels to those of the map's panes. @param {any} corners */
  placing(corners) {
    const [first, right, , below] = corners;
    const [origin, across, down] = [first, right, below].map((corner) => this.map.project(corner).subtract(this.map.getPixelOrigin()));
    const [x, y] = [across.subtract(origin).divideBy(this.picture.width), down.subtract(origin).divideBy(this.picture.height)];
    return `matrix(${x.x}, ${x.y}, ${y.x}, ${y.y}, ${origin.x}, ${origin.y})`;
  }

  sentence() {
    const pairs = this.pairs();
    if (!pairs.length) return t("Drag the corners to where they belong on the base map. Two or more lay it.");
    if (pairs.length === 1) return t("One corner is set: drag another one.");
    if (pairs.length === 2) return t("{n} corners are set.", { n: pairs.length });
    const off = pairs.map(([corner, spot]) => this.map.distance(latLngOf(laidAt(this.laid, corner)), latLngOf(spot)));
    return t("{n} corners are set; the worst lies {m} m from where all of them lay it.", { n: pairs.length, m: Math.max(...off).toFixed(1) });
  }

  /** What the map shows, for whoever reads the page's elements. */
  tellView() {
    this.map.getContainer().dataset.bounds = this.map.getBounds().toBBoxString();
  }

  async take(event) {
    event.preventDefault();
    const button = byId("laying-take");
    button.disabled = true;
    const laid = await trying(this.said, () => this.savePins());
    button.disabled = false;
    if (laid) this.onTaken();
    if (laid?.refused) this.said.textContent = said(laid.refused);
    else if (laid) this.dialog.close();
  }

  /**
   * Pins of the corners that are set, instead of those that were made so before; how the island lies by them. Each is set where the
   * nearest frame shows something, as far off as its corner is: so it goes with that frame, wherever that is moved to.
   */
  async savePins() {
    const ours = ({ island }) => island === this.island.id;
    const before = (await fetchDocument("/api/v1/anchors")).pins.filter((pin) => ours(pin) && cornerOf(pin.label));
    const { value } = this.form.elements.sigma;
    const sigma_m = value.trim() ? metresIn(value) : USUAL_SIGMA_M;
    for (const [at, spot] of this.spots.entries()) {
      if (!spot) continue;
      const place = this.placements.shownNear(this.island.id, this.corners[at]) ?? this.corners[at];
      const [there, here] = [place, this.corners[at]].map((one) => laidAt(this.laid, one));
      const { lat: latitude, lng: longitude } = latLngOf([0, 1].map((axis) => spot[axis] + there[axis] - here[axis])).wrap();
      await send("POST", "/pins", { island: this.island.id, x: place[0], y: place[1], latitude, longitude, sigma_m, label: LABELS[at] });
    }
    for (const { id } of before) await send("DELETE", `/pins/${id}`);
    return (await fetchDocument("/api/v1/anchors")).islands.find(ours) ?? { refused: null };
  }

  end() {
    this.handles = null;
    this.map?.remove();
    this.map = null;
  }
}

/** Which corner (1 to 4) a pin with this label was made of; 0: none. */
export function cornerOf(label) {
  return LABELS.indexOf(label) + 1;
}

/** A map of the team's own tiles, north up. */
function baseMap({ bounds: [west, south, east, north], minzoom, maxzoom }) {
  const map = L.map("laying-map", {
    attributionControl: false, zoomControl: false, fadeAnimation: false, zoomAnimation: false,
    minZoom: Math.max(minzoom - 1, 0), maxZoom: maxzoom + NEARER,
  });
  L.control.zoom({ position: "bottomright" }).addTo(map);
  L.tileLayer("/api/v1/underlay/{z}/{x}/{y}", { minNativeZoom: minzoom, maxNativeZoom: maxzoom, maxZoom: maxzoom + NEARER }).addTo(map);
  const follow = new ResizeObserver(() => map.invalidateSize({ animate: false, pan: false })); // what is shown stays where it is
  follow.observe(map.getContainer());
  map.on("unload", () => follow.disconnect());
  return map.fitBounds([[south, west], [north, east]], { animate: false });
}

/**
 * A part of an island's canvas, drawn of the finest tiles of which that takes four across at most.
 * @param {any} island
 * @param {number[]} box
 * @param {number} revision
 */
function pictureOf({ id, minzoom, maxzoom }, [left, top, right, bottom], revision) {
  const unit = (level) => 2 ** (16 - level); // canvas units of a pixel
  const tileAt = (place, level) => Math.floor((place + 2 ** 23 + 0.5) / (TILE * unit(level)));
  const isFew = (level) => [[left, right], [top, bottom]].every(([low, high]) => tileAt(high, level) - tileAt(low, level) < MOST_ACROSS);
  let level = minzoom;
  while (level < maxzoom && isFew(level + 1)) level++;
  const canvas = document.createElement("canvas");
  canvas.className = "laid";
  canvas.width = Math.max(1, Math.round((right - left) / unit(level)));
  canvas.height = Math.max(1, Math.round((bottom - top) / unit(level)));
  const context = canvas.getContext("2d");
  const corner = (tile) => tile * TILE * unit(level) - 2 ** 23 - 0.5;
  for (let x = tileAt(left, level); x <= tileAt(right, level); x++) {
    for (let y = tileAt(top, level); y <= tileAt(bottom, level); y++) {
      const image = Object.assign(new Image(), { src: `/tiles/${id}/${level}/${x}/${y}?r=${revision}` });
      const place = [(corner(x) - left) / unit(level), (corner(y) - top) / unit(level)];
      image.onload = () => context.drawImage(image, place[0], place[1], TILE, TILE);
    }
  }
  return canvas;
}

/**
 * Metres of the map, [east, north], as a place on earth.
 * @param {number[]} spot
 */
function latLngOf([east, north]) {
  return EARTH.unproject(L.point(east, north));
}

function spotOf(latlng) {
  const { x, y } = EARTH.project(latlng);
  return [x, y];
}
