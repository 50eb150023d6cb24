// @ts-check
// Lengths and areas on the map, in pixels, or in metres once a scale is known; the scale bar; a person's size at the cursor.

import { send, trying } from "/viewer/api.js";
import { byId, isVisible } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { metresIn } from "/viewer/numbers.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

const PERSON_M = { height: 1.75, width: 0.5 };
const BAR_PX = 120; // at most
const STEPS = [1, 2, 5];
/** @type {[string, number][]} colour, width */
const LINE = [["#000", 6], ["#ffe600", 3]];

export class Measure {
  constructor(map, pointing) {
    this.map = map;
    this.pointing = pointing;
    this.scales = new Map();
    this.points = [];
    this.drawn = L.layerGroup().addTo(map.map);
    this.line = byId("measure-line");
    this.area = byId("measure-area");
    this.scale = byId("measure-scale");
    this.person = byId("measure-person");
    this.clear = byId("measure-clear");
    this.told = byId("measure-told");
    this.said = byId("measure-said");
    this.metres = byId("measure-metres");
    this.known = byId("measure-known");
    this.bar = byId("scale-bar");
    for (const [kind, said] of [["line", "Click along the line."], ["area", "Click round the area."], ["scale", "Click both ends of the known distance."]]) {
      const tool = { kind, said, button: this[kind], place: (island, x, y) => this.add(kind, island, x, y) };
      this[kind].onclick = () => {
        this.clearAll();
        this.pointing.take(tool);
      };
    }
    this.clear.onclick = () => this.clearAll();
    this.metres.onsubmit = (event) => this.saveScale(event);
    closeByEscape("form", () => isVisible(this.metres), () => this.clearAll());
    this.person.onclick = () => this.togglePerson();
    map.map.on("zoomend moveend", () => this.showBar());
    map.map.on("mousemove", ({ containerPoint }) => this.movePerson(map.turn.inPane(containerPoint)));
    this.silhouette = byId("person");
  }

  async read() {
    const answer = await fetchDocument("/api/v1/scale").catch(() => null);
    if (!answer) return null;
    this.scales = new Map(answer.islands.map((one) => [one.island, one]));
    this.distances = answer.distances.filter((one) => !one.deleted);
    this.showScale();
    return answer.map_revision;
  }

  /** Metres of a canvas unit of the island in view, or undefined. */
  metresPerUnit() {
    return this.scales.get(this.map.layer?.island)?.metres_per_unit;
  }

  showScale() {
    const scale = this.scales.get(this.map.layer?.island);
    const unit = this.metresPerUnit();
    this.known.replaceChildren(!scale ? t("No scale is known of this island: measured in pixels of the map.")
      : t("One pixel of the map is {cm} cm ({source}).", { cm: (unit * 100).toPrecision(3), source: t(scale.source === "anchor" ? "by the anchor" : "by a known distance") }));
    if (scale?.scale != null) {
      const drop = Object.assign(document.createElement("button"), { type: "button", textContent: t("Delete this scale") });
      drop.onclick = () => trying(this.said, () => send("DELETE", `/scale/${scale.scale}`)).then(() => this.read());
      this.known.append(" ", drop);
    }
    this.person.disabled = !scale;
    if (!scale) this.silhouette.hidden = true;
    this.showBar();
    this.tell();
  }

  /** The island in view may be another one. */
  follow() {
    if (this.shownIsland === this.map.layer?.island) return;
    this.shownIsland = this.map.layer?.island;
    this.clearAll();
    this.showScale();
  }

  add(kind, island, x, y) {
    this.kind = kind;
    this.points.push([x, y]);
    this.island = island;
    if (kind === "scale" && this.points.length === 2) {
      this.pointing.release();
      this.metres.hidden = false;
      this.metres.elements.metres.focus();
    }
    this.draw();
    this.tell();
  }

  draw() {
    this.drawn.clearLayers();
    /** @type {[number, number][]} */
    const corners = this.points.map(([x, y]) => [y, x]);
    for (const [color, weight] of LINE) {
      const shape = this.kind === "area" ? L.polygon : L.polyline;
      this.drawn.addLayer(shape(corners, { color, weight, fill: this.kind === "area", fillOpacity: 0.15, interactive: false }));
      for (const corner of corners) this.drawn.addLayer(L.circleMarker(corner, { radius: 6, color, weight: weight / 2, fill: false, interactive: false }));
    }
  }

  tell() {
    if (this.points.length < 2) {
      this.told.textContent = "";
      return;
    }
    const unit = this.metresPerUnit();
    const pairs = this.points.slice(1).map((end, at) => [this.points[at], end]);
    const length = pairs.reduce((sum, [a, b]) => sum + Math.hypot(a[0] - b[0], a[1] - b[1]), 0);
    const area = Math.abs(this.points.reduce((sum, [x, y], at) => {
      const [nextX, nextY] = this.points[(at + 1) % this.points.length];
      return sum + (x * nextY - nextX * y) / 2;
    }, 0));
    this.told.textContent = this.kind === "area" ? squares(area, unit) : lengths(length, unit);
  }

  clearAll() {
    this.pointing.release();
    this.points = [];
    this.drawn.clearLayers();
    this.metres.hidden = true;
    this.told.textContent = "";
  }

  async saveScale(event) {
    event.preventDefault();
    const [from, to] = this.points;
    const { value } = this.metres.elements.metres;
    if (await trying(this.said, () => send("POST", "/scale", { island: this.island, from, to, metres: metresIn(value) }))) this.clearAll();
    await this.read();
  }

  showBar() {
    const unit = this.metresPerUnit();
    this.bar.hidden = !unit;
    if (!unit || !this.map.map._loaded) return;
    const pixelM = unit / 2 ** (this.map.map.getZoom() - 16); // metres of a CSS pixel
    const most = BAR_PX * pixelM;
    const decade = 10 ** Math.floor(Math.log10(most));
    const length = decade * STEPS.filter((step) => step * decade <= most).at(-1);
    this.bar.style.width = `${length / pixelM}px`;
    this.bar.textContent = length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`;
    this.sizePerson(pixelM);
  }

  togglePerson() {
    const isShown = this.silhouette.hidden;
    this.silhouette.hidden = !isShown;
    this.person.setAttribute("aria-pressed", String(isShown));
    this.showBar();
  }

  /** Lying on the ground, as seen from above: true to scale, and not to be seen when it is smaller than a pixel. */
  sizePerson(pixelM) {
    Object.assign(this.silhouette.style, { width: `${PERSON_M.width / pixelM}px`, height: `${PERSON_M.height / pixelM}px` });
    this.silhouette.dataset.px = (PERSON_M.height / (this.metresPerUnit() ?? NaN)).toFixed(1);
  }

  movePerson({ x, y }) {
    if (!this.silhouette.hidden) Object.assign(this.silhouette.style, { left: `${x + 18}px`, top: `${y + 18}px` });
  }
}

function lengths(units, metres) {
  return metres ? `${rounded(units * metres)} m` : `${rounded(units)} px`;
}

function squares(units, metres) {
  if (!metres) return `${rounded(units)} px²`;
  const area = units * metres ** 2;
  return area >= 10000 ? `${rounded(area / 10000)} ha` : `${rounded(area)} m²`;
}

/** Three digits: more would claim more than the map knows. */
function rounded(value) {
  return Number(value.toPrecision(3)).toLocaleString(document.documentElement.lang);
}
