// @ts-check
// Several aircraft in one flight: a colour and a number for each, where its newest frame lies, and which of them is followed.

import { byId, element } from "/viewer/dom.js";
import { middleOf, outlineOf } from "/viewer/outline.js";
import { t } from "/viewer/words.js";

// Okabe and Ito's colours, which people with any kind of colour blindness tell apart; the numbers tell them, too.
const COLOURS = ["#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#f0e442", "#0072b2", "#ffffff"];

export class Fleet {
  /** `map`: the MosaicMap; `placements`: where frames lie; `onFollow()` is called when another aircraft is followed. */
  constructor(map, placements, onFollow) {
    this.map = map;
    this.placements = placements;
    this.onFollow = onFollow;
    this.legend = byId("fleet");
    this.marks = L.layerGroup().addTo(map.map);
    this.systems = [];
    this.followed = null; // null: the newest frame, whose ever it is
    map.colourOf = (frame) => this.colourOf(frame.vehicle);
  }

  get isSeveral() {
    return this.systems.length > 1;
  }

  /** Yellow for a lone aircraft. */
  colourOf(vehicle) {
    const at = this.systems.indexOf(vehicle);
    return this.isSeveral && at >= 0 ? COLOURS[at % COLOURS.length] : "#ffe600";
  }

  /** The frame that is followed: the newest of the chosen aircraft, or of all. */
  newestFrame() {
    return this.placements.newestFrame(this.isSeveral ? this.followed : null);
  }

  /** @param {Api.Status} status */
  show(status) {
    const told = new Map((status?.aircraft ?? []).map((one) => [one.system, one]));
    const systems = [...new Set([...told.keys(), ...this.placements.newestOf.keys()])].sort((one, other) => one - other);
    this.systems = systems;
    this.legend.hidden = !this.isSeveral;
    if (!this.isSeveral) return;
    this.showLegend(told);
    this.showMarks();
  }

  showLegend(told) {
    const entries = this.systems.map((system) => ({ system, text: words(told.get(system), this.placements.countOf(system)) }));
    const shown = JSON.stringify([entries, this.followed]);
    if (shown === this.shown) return;
    this.shown = shown;
    const buttons = entries.map(({ system, text }) => this.button(system, text));
    const had = [...this.legend.children].indexOf(document.activeElement); // who uses keys stays where they are
    this.legend.replaceChildren(...buttons);
    if (had >= 0) buttons[had]?.focus();
  }

  button(system, text) {
    const button = element("button", { type: "button", title: t("Follow aircraft {system}", { system }) });
    const swatch = element("i", { textContent: String(system) });
    swatch.style.background = this.colourOf(system);
    button.append(swatch, element("span", { textContent: text }));
    button.setAttribute("aria-pressed", String(this.followed === system));
    button.setAttribute("aria-label", `${t("Follow aircraft {system}", { system })}: ${text}`);
    button.onclick = () => this.follow(system);
    return button;
  }

  /** Follow this one's newest frame; once more: everybody's again. */
  follow(system) {
    this.followed = this.followed === system ? null : system;
    this.onFollow();
    if (this.followed !== null) this.map.setMode("newest");
  }

  /** The newest frame of each that lies on the island in view: its outline, and its number in the middle. */
  showMarks() {
    const island = this.map.layer?.island;
    const frames = this.systems.map((system) => this.placements.newestFrame(system)).filter((frame) => frame && frame.island === island);
    const drawn = JSON.stringify(frames.map(({ vehicle, canvas_from_frame: place }) => [vehicle, place]));
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    this.marks.clearLayers();
    for (const frame of frames) for (const layer of markOf(frame, this.colourOf(frame.vehicle))) this.marks.addLayer(layer);
  }
}

/** @param {Api.FleetMember} one */
function words(one, placed) {
  const count = placed === 1 ? t("1 frame") : t("{n} frames", { n: placed });
  return one?.frames_in_queue ? t("{frames}, {n} waiting", { frames: count, n: one.frames_in_queue }) : count;
}

function markOf(frame, colour) {
  const corners = outlineOf(frame);
  if (!corners) return [];
  const line = (color, weight) => L.polygon(corners, { color, weight, fill: false, interactive: false });
  const icon = L.divIcon({ className: "aircraft-mark", html: "", iconSize: [32, 32] });
  const marker = L.marker(middleOf(frame), { icon, keyboard: false, interactive: false });
  marker.on("add", () => {
    marker.getElement().style.background = colour;
    marker.getElement().replaceChildren(element("span", { className: "upright", textContent: String(frame.vehicle) }));
  });
  return [line("#000", 5), line(colour, 3), marker];
}
