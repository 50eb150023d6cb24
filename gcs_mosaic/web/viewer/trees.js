// @ts-check
// Through the trees: a click opens a lens over the map, in focus at the ground; sliders move the focus and open the aperture.

import { byId, element } from "/viewer/dom.js";
import { said, t } from "/viewer/words.js";

const SIDE_M = 40;
const HINTS = 5;
const LEAST_CELLS = 96, MOST_CELLS = 360; // px of the picture: as many as are shown of it, but for what costs too much
const TIMEOUT_MS = 60000; // all originals of a place on a busy machine
/** @type {[string, number][]} colour, width */
const RIM = [["#000", 5], ["#ffe600", 2]];

/** A height, and between which it lies by the focal length, which is estimated (95 %). */
function metresOf(height, factor) {
  const [m, low, high] = [height, ...[height / factor, height * factor].sort((one, other) => one - other)].map((one) => one.toFixed(1));
  return low === high ? t("about {m} m", { m }) : t("about {m} m ({low} to {high} m)", { m, low, high });
}

export class Trees {
  /** `measure`: knows the metres of a canvas unit; `showOriginals(island, x, y)`: all looks at a place. */
  constructor(map, pointing, measure, showOriginals) {
    this.map = map;
    this.pointing = pointing;
    this.measure = measure;
    this.showOriginals = showOriginals;
    this.drawn = L.layerGroup().addTo(map.map);
    this.picture = null;
    this.place = null; // { island, x, y, side, cells } of the open lens
    this.asking = false; // one picture is on its way, not more
    this.askAgain = false;
    this.open = byId("trees-open");
    this.focus = byId("trees-focus");
    this.aperture = byId("trees-aperture");
    this.form = byId("trees-form");
    this.controls = byId("trees-controls");
    this.told = byId("trees-told");
    this.said = byId("trees-said");
    this.list = byId("trees-list");
    this.tool = { button: this.open, said: "Click where the lens is to be.", place: (island, x, y) => this.lay(island, x, y) };
    this.open.onclick = () => this.pointing.take(this.tool);
    for (const one of [this.focus, this.aperture]) one.addEventListener("input", () => this.ask());
    this.form.onchange = () => this.ask();
    byId("trees-ground").onclick = () => this.backToGround();
    byId("trees-looks").onclick = () => this.place && this.showOriginals(this.place.island, this.place.x, this.place.y);
    byId("trees-close").onclick = () => this.close();
    byId("trees").addEventListener("closed", () => this.close());
    this.map.map.on("layeradd", () => this.place && this.map.layer?.island !== this.place.island && this.close());
  }

  /** Open a lens about a place: 40 m of ground, or as much as a few hundred pixels of the frames show where no scale is known. */
  lay(island, x, y) {
    this.pointing.release();
    this.clear();
    const unit = this.measure.scales.get(island)?.metres_per_unit;
    const side = unit ? SIDE_M / unit : null;
    const pixels = side === null ? MOST_CELLS : side * 2 ** (this.map.map.getZoom() - 16) * devicePixelRatio;
    this.place = { island, x, y, side, unit, cells: Math.round(Math.min(MOST_CELLS, Math.max(LEAST_CELLS, pixels))) };
    this.isNew = true;
    this.aperture.value = "100";
    this.ask();
  }

  backToGround() {
    if (!this.place) return;
    this.focus.value = String(100 * (this.ground ?? 0));
    this.ask();
  }

  /** Ask for the picture; while one is on its way only that another is wanted is noted. */
  async ask() {
    this.askAgain = true;
    if (this.asking) return;
    this.asking = true;
    while (this.askAgain && this.place) {
      this.askAgain = false;
      await this.bring(this.place, this.isNew);
    }
    this.asking = false;
  }

  async bring(place, isNew) {
    if (isNew) this.told.textContent = t("Opening all originals of this place …");
    const asked = new URLSearchParams({ x: place.x, y: place.y, cells: place.cells, form: this.form.value });
    if (place.side !== null) asked.set("side", place.side);
    if (place.unit) asked.set("unit", String(place.unit));
    if (isNew) asked.set("hints", String(HINTS));
    else asked.set("height", String(this.focus.value / 100));
    asked.set("aperture", String(this.aperture.value / 100));
    try {
      const response = await fetch(`/api/v1/islands/${place.island}/integral?${asked}`, { signal: AbortSignal.timeout(TIMEOUT_MS) });
      if (!response.ok) throw new Error((await response.text()).trim() || `${response.status}`);
      const answer = await response.json();
      if (this.place === place) this.show(answer, isNew);
    } catch (error) {
      if (this.place === place) this.fail(error, isNew);
    }
  }

  /** What was shown is no picture of what is asked for now. */
  fail(error, isNew) {
    this.picture?.remove();
    this.picture = null;
    this.told.textContent = "";
    this.said.textContent = error.name === "TimeoutError" ? t("No answer: ask again once the connection is back.") : said(error.message);
    if (isNew) this.controls.hidden = true;
  }

  /** @param {Api.Integral} answer */
  show(answer, isNew) {
    this.said.textContent = "";
    this.answer = answer;
    const corners = L.latLngBounds([answer.top, answer.left], [answer.top + answer.side, answer.left + answer.side]);
    const source = `data:image/jpeg;base64,${answer.picture}`;
    if (this.picture) this.picture.setUrl(source);
    else {
      this.picture = L.imageOverlay(source, corners, { className: "lens", zIndex: 10 }).addTo(this.map.map);
      for (const [color, weight] of RIM) this.drawn.addLayer(L.rectangle(corners, { color, weight, fill: false, interactive: false }));
    }
    if (isNew) this.begin(answer);
    this.tell(answer);
  }

  /** @param {Api.Integral} answer */
  begin(answer) {
    this.isNew = false;
    this.ground = answer.ground;
    byId("trees-ground").textContent = this.ground === null ? t("To the map's ground") : t("To the ground");
    Object.assign(this.focus, { min: 100 * answer.lowest, max: 100 * answer.highest, value: 100 * answer.height });
    this.controls.hidden = false;
    this.list.replaceChildren(...answer.hints.map((hint, index) => this.row(hint, index + 1)));
    for (const { x, y } of answer.hints) {
      const icon = L.divIcon({ className: "hint-mark", iconSize: [44, 44] });
      this.drawn.addLayer(L.marker([y, x], { icon, interactive: false, keyboard: false }));
    }
  }

  /** @param {Api.HotPlace} hint */
  row(hint, number) {
    const name = t("{n}. stands out by {score} deviations", { n: number, score: hint.score.toFixed(1) });
    const looks = element("button", { type: "button", textContent: t("All looks"), ariaLabel: `${t("All looks")}: ${name}` });
    looks.onclick = () => this.showOriginals(this.place.island, hint.x, hint.y);
    const focus = element("button", { type: "button", textContent: t("Focus on it"), ariaLabel: `${t("Focus on it")}: ${name}` });
    focus.onclick = () => {
      this.focus.value = String(100 * hint.height);
      this.ask();
    };
    return element("li", {}, element("small", { textContent: name }), element("div", { className: "row" }, looks, focus));
  }

  /** @param {Api.Integral} answer */
  tell(answer) {
    const { unit } = this.place;
    const percent = (100 * answer.height).toFixed(1);
    const metres = unit && answer.known_to !== null ? `, ${metresOf(answer.height * answer.flying_height * unit, answer.known_to)}` : "";
    const lines = [
      t("{n} looks, {degrees}° between the outermost.", { n: answer.looks, degrees: Math.round(answer.spread_deg) }),
      t("Focus {percent} % of the flying height above the map's ground{metres}.", { percent, metres }),
    ];
    if (answer.ground === null) lines.push(t("Where the ground lies is not known here: the looks agree at no height, or at many as crowns do. Move the focus."));
    else if (answer.ground_is_beside) lines.push(t("The ground is not seen here by itself: it was found around this place, at {percent} %.", { percent: (100 * answer.ground).toFixed(1) }));
    else if (Math.abs(answer.height - answer.ground) > 0.001) lines.push(t("The ground was found at {percent} %.", { percent: (100 * answer.ground).toFixed(1) }));
    if (unit && answer.known_to === null) lines.push(t("How many metres that are is not known: the pictures do not tell the angle of view."));
    if (answer.left_out) lines.push(t("{n} more looks, evenly among these, are left out: so many are not kept in memory.", { n: answer.left_out }));
    if (answer.map_revision < this.map.revision) lines.push(t("The map has changed since the lens was opened: click again for all looks of now."));
    if (answer.lost) lines.push(t("{n} originals cannot be read and are left out.", { n: answer.lost }));
    this.told.textContent = lines.join(" ");
    this.told.dataset.looks = String(answer.looks);
  }

  clear() {
    this.picture?.remove();
    this.picture = null;
    this.drawn.clearLayers();
    this.list.replaceChildren();
    this.said.textContent = this.told.textContent = "";
  }

  close() {
    this.clear();
    this.place = null;
    this.controls.hidden = true;
  }
}
