// @ts-check
// Anchors: pins that say what coordinate a place has, and the coordinate under the cursor with its error.

import { send, trying } from "/viewer/api.js";
import { byId, isVisible } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { cornerOf, Laying } from "/viewer/laying.js";
import { metresIn } from "/viewer/numbers.js";
import { openPanel } from "/viewer/panels.js";
import { ChosenPlace } from "/viewer/pointing.js";
import { fetchDocument } from "/viewer/server.js";
import { said, t } from "/viewer/words.js";

const ASK_EVERY_MS = 250; // the coordinate under a moving cursor
const FAR_M = 10_000; // told in kilometres
const USUAL_SIGMA_M = 3; // of a receiver in the open
const NOTATIONS = ["decimal", "dms", "utm", "mgrs"];

export class Anchors {
  constructor(map, pointing, placements) {
    this.map = map;
    this.pointing = pointing;
    this.answer = null;
    this.pins = L.layerGroup().addTo(map.map);
    this.chosen = new ChosenPlace(map);
    this.set = byId("anchors-set");
    this.form = byId("anchors-form");
    this.list = byId("anchors-list");
    this.told = byId("anchors-told");
    this.said = byId("anchors-said");
    this.positions = byId("anchors-positions");
    this.undo = byId("anchors-undo");
    this.undo.querySelector("button").onclick = () => this.restore();
    this.go = byId("anchors-go");
    this.notation = byId("anchors-notation");
    this.place = byId("coordinate");
    this.tool = { button: this.set, said: "Click a place whose coordinate you know.", place: (island, x, y) => this.begin({ island, x, y }) };
    this.set.onclick = () => this.pointing.take(this.tool);
    this.form.onsubmit = (event) => this.save(event);
    this.go.onsubmit = (event) => this.goTo(event);
    byId("anchors-cancel").onclick = () => this.endForm();
    closeByEscape("form", () => isVisible(this.form), () => this.endForm());
    this.positions.onchange = () => trying(this.said, () => send("PUT", "/anchors/positions", { asked: this.positions.checked })).then(() => this.read());
    for (const name of NOTATIONS) this.notation.append(new Option(name === "decimal" ? t("Degrees") : name.toUpperCase(), name));
    this.notation.onchange = () => this.ask();
    map.map.on("mousemove click", ({ containerPoint }) => this.pointAt(containerPoint));
    map.map.on("moveend", () => this.ask()); // other ground is under a cursor that rests
    new Laying(map, placements, () => this.read());
  }

  async read() {
    const answer = await fetchDocument("/api/v1/anchors").catch(() => null);
    if (!answer) return null;
    this.answer = answer;
    this.show();
    return answer.map_revision;
  }

  show() {
    this.positions.checked = this.answer.by_positions;
    this.list.replaceChildren(...this.answer.pins.map((pin) => this.row(pin)));
    this.drawn = this.map.layer?.island;
    const laid = this.laid();
    this.told.textContent = sentence(laid);
    this.place.hidden = !laid?.anchor;
    this.askAnew(laid?.anchor);
    this.showNorth(laid?.anchor);
    this.pins.clearLayers();
    for (const pin of this.answer.pins.filter(({ island }) => island === this.drawn)) {
      const marker = L.marker([pin.y, pin.x], { icon: L.divIcon({ className: "pin", html: "", iconSize: [32, 32] }), title: nameOf(pin), keyboard: false });
      this.pins.addLayer(marker);
      marker.getElement().textContent = "+";
    }
  }

  laid() {
    return this.answer?.islands.find(({ island }) => island === this.map.layer?.island);
  }

  follow() {
    if (this.answer && this.map.layer && this.drawn !== this.map.layer.island) this.show();
  }

  showNorth(anchor) {
    const arrow = byId("north");
    arrow.hidden = !anchor;
    this.map.turn.setNorth(anchor ? anchor.north_deg : null);
    if (anchor) arrow.style.rotate = `calc(${anchor.north_deg}deg + var(--turn, 0deg))`;
  }

  /** @param {Api.Pin} pin */
  row(pin) {
    const laid = this.answer.islands.find((one) => one.pins?.includes(pin.id));
    const residual = laid?.residuals_m?.[laid.pins.indexOf(pin.id)];
    const off = residual !== undefined && laid.points > 2 ? `, ${offBy(residual)}` : "";
    const drop = Object.assign(document.createElement("button"), { type: "button", textContent: t("Delete"), ariaLabel: `${t("Delete")}: ${nameOf(pin)}` });
    drop.onclick = () => this.remove(pin);
    const item = document.createElement("li");
    const text = document.createElement("span");
    text.textContent = `${nameOf(pin)}: ${pin.written || `${pin.latitude}, ${pin.longitude}`} ± ${pin.sigma_m} m${off}`;
    if (laid?.misfits?.includes(nameOf(pin))) text.className = "misfit";
    item.append(text, drop);
    return item;
  }

  /** @param {Api.Pin} pin */
  async remove(pin) {
    if (await trying(this.said, () => send("DELETE", `/pins/${pin.id}`))) {
      this.deleted = pin.id;
      this.undo.querySelector("span").textContent = t("{name} is deleted.", { name: nameOf(pin) });
      this.undo.hidden = false;
      this.undo.querySelector("button").focus();
    }
    await this.read();
  }

  async restore() {
    if (await trying(this.said, () => send("POST", `/pins/${this.deleted}/restore`))) this.undo.hidden = true;
    await this.read();
  }

  begin(place) {
    this.pointing.release();
    openPanel("anchors");
    this.newPlace = place;
    this.chosen.show(place.x, place.y);
    this.form.hidden = false;
    this.form.elements.coordinate.focus();
  }

  async save(event) {
    event.preventDefault();
    const { coordinate, sigma, label } = this.form.elements;
    const told = { ...this.newPlace, coordinate: coordinate.value, label: label.value };
    const kept = await trying(this.said, () => send("POST", "/pins", { ...told, sigma_m: sigma.value.trim() ? metresIn(sigma.value) : USUAL_SIGMA_M }));
    if (!kept) return;
    this.form.reset();
    this.endForm();
    await this.read();
  }

  endForm() {
    this.form.hidden = true;
    this.said.textContent = "";
    this.chosen.clear();
    this.set.focus();
  }

  async goTo(event) {
    event.preventDefault();
    const at = this.go.elements.at.value;
    const answer = await trying(this.said, async () => {
      const response = await fetch(`/api/v1/canvas?at=${encodeURIComponent(at)}`);
      if (!response.ok) throw new Error((await response.text()).trim());
      return response.json();
    });
    const place = answer?.places.find(({ island }) => island === this.map.layer?.island) ?? answer?.places[0];
    if (answer && !place) this.said.textContent = t("No island with an anchor reaches there.");
    if (!place) return;
    if (this.map.layer?.island !== place.island) this.map.chooseIsland(place.island);
    this.map.setMode("free");
    this.map.map.setView([place.y, place.x], this.map.map.getZoom(), { animate: false });
  }

  /** The anchor may be another one than that by which the coordinate was told that is shown. */
  askAnew(anchor) {
    if (!anchor || this.wanted?.island !== this.drawn) this.forgetCursor();
    const by = JSON.stringify(anchor);
    if (by !== this.toldBy) this.ask();
    this.toldBy = by;
  }

  forgetCursor() {
    this.wanted = null;
    this.place.textContent = "";
  }

  /** Where the cursor is in the map's container. */
  pointAt(point) {
    this.wanted = { island: this.map.layer?.island, point };
    this.ask();
  }

  /** What is under the cursor, a few times a second at most. */
  ask() {
    if (this.wanted && this.laid()?.anchor) this.timer ??= setTimeout(() => this.answerCursor(), ASK_EVERY_MS);
  }

  async answerCursor() {
    const { wanted } = this;
    const { lng, lat } = wanted ? this.map.map.containerPointToLatLng(wanted.point) : {};
    const answer = wanted && (await fetchDocument(`/api/v1/coordinates?island=${wanted.island}&x=${lng}&y=${lat}`).catch(() => null));
    this.timer = undefined;
    const found = answer?.place;
    // Of a place that the cursor has left, or by an anchor that is gone, nothing is told.
    const isThere = found && this.wanted?.island === wanted.island && this.laid()?.anchor;
    this.place.textContent = isThere ? `${found[this.notation.value] ?? found.decimal} ± ${Math.ceil(found.error_m)} m (95 %)` : "";
  }
}

function offBy(metres) {
  return metres < FAR_M ? t("{m} m off", { m: metres.toFixed(1) }) : t("{km} km off", { km: (metres / 1000).toFixed() });
}

function sentence(laid) {
  if (!laid) return t("This island has no anchor: set two pins or more.");
  if (laid.refused) return said(laid.refused);
  const error = Math.ceil(laid.anchor.middle.error_m);
  if (laid.by === "positions") return t("Laid by {n} positions of the aircraft: ± {m} m (95 %) in the middle.", { n: laid.shots, m: error });
  if (laid.misfits.length > 1) return t("{names} do not fit the other pins and are left out, ± {m} m (95 %) in the middle: check them, or delete them.", { names: laid.misfits.join(", "), m: error });
  if (laid.misfit) return t("{name} does not fit the other pins and is left out, ± {m} m (95 %) in the middle: check it, or delete it.", { name: laid.misfit, m: error });
  if (!laid.fits) return t("The pins do not fit each other, ± {m} m (95 %) in the middle: set another one to find out which is wrong.", { m: error });
  const right = Math.ceil(laid.if_right_m);
  if (!laid.checked) return t("Laid by {n} points, unchecked: ± {m} m (95 %) in the middle, ± {right} m if none is wrong. Another point far from them checks them.", { n: laid.points, m: error, right });
  return t("Laid by {n} pins that fit: ± {m} m (95 %) in the middle.", { n: laid.points, m: error });
}

/** @param {Api.Pin} pin */
function nameOf(pin) {
  const corner = cornerOf(pin.label);
  return corner ? t("corner {n}", { n: corner }) : pin.label || `pin ${pin.id}`;
}
