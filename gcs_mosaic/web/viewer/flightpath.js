// @ts-check
// Where the camera was, and the outlines of the frames; those that are not on the map, with the reason; and the flight played again.

import { byId } from "/viewer/dom.js";
import { middleOf, outlineOf } from "/viewer/outline.js";
import { Fresh } from "/viewer/fresh.js";
import { fetchDocument } from "/viewer/server.js";
import { written } from "/viewer/times.js";
import { Veil } from "/viewer/veil.js";
import { t } from "/viewer/words.js";

const NAMES = new Intl.Collator("en", { numeric: true });
const SOON_MS = 2000; // between two drawings while the flight goes on
const PATH_COLOUR = "#56b4e9";

export class FlightPath {
  /** `placements`: where frames lie; `fleet`: whose they are; `onTime(seconds | null)` is called when the slider is moved. */
  constructor(map, placements, fleet) {
    this.map = map;
    this.fleet = fleet;
    this.placements = placements;
    this.lines = L.layerGroup().addTo(map.map);
    this.until = Infinity;
    this.showsPath = false;
    this.showsOutlines = false;
    this.renderer = L.canvas({ padding: 0.3 });
    this.veil = new Veil(); // over what was not seen yet
    this.path = byId("flight-path");
    this.outlines = byId("flight-outlines");
    this.slider = byId("flight-slider");
    this.time = byId("flight-time");
    this.absent = byId("flight-absent");
    this.play = byId("flight-play");
    /** @type {Map<string, Api.FrameTime>} */
    this.times = new Map();
    this.fresh = new Fresh(() => this.readTimes());
    this.path.onclick = () => this.toggle("showsPath", this.path);
    this.outlines.onclick = () => this.toggle("showsOutlines", this.outlines);
    this.slider.oninput = () => this.moveTo(Number(this.slider.value));
    this.play.onclick = () => this.togglePlay();
    byId("flight").addEventListener("opened", () => this.show());
    byId("flight").addEventListener("closed", () => this.moveTo(Number(this.slider.max)));
  }

  /** While somebody looks: when the frames were taken. */
  follow(revision) {
    if (!byId("flight").hidden) this.fresh.follow(revision);
  }

  async readTimes() {
    const answer = await fetchDocument("/api/v1/times");
    if (!answer) return null;
    this.times = new Map(answer.frames.map((one) => [one.name, one]));
    this.tellPlace();
    return answer.map_revision;
  }

  /** What the slider stands at: the frame's name, and when it was taken. */
  tellPlace() {
    const frames = this.frames();
    const last = frames[this.count - 1];
    const told = last && this.times.get(last.name);
    const when = told?.time ? t(told.time_by === "file" ? "came {time}" : "taken {time}", { time: written(told.time) }) : "";
    const isPast = this.count < frames.length;
    const place = isPast ? t("After {n} of {all} frames: {name}", { n: this.count, all: frames.length, name: last?.name ?? "" }) : t("All {all} frames", { all: frames.length });
    this.time.textContent = isPast && when ? `${place}, ${when}` : place;
  }

  toggle(what, button) {
    this[what] = !this[what];
    button.setAttribute("aria-pressed", String(this[what]));
    this.draw();
  }

  /** All frames that have a place, in the order of their names, which cameras count up. */
  frames() {
    if (this.ordered?.revision !== this.placements.revision) {
      const placed = [...this.placements.places.values()].filter((one) => one.canvas_from_frame);
      placed.sort((one, other) => NAMES.compare(one.name, other.name));
      this.ordered = { revision: this.placements.revision, frames: this.fleet.isSeveral ? interleaved(placed) : placed };
    }
    return this.ordered.frames;
  }

  show() {
    if (byId("flight").hidden && !this.showsPath && !this.showsOutlines) return;
    if (Date.now() - (this.drawnAt ?? 0) < SOON_MS && this.drawnRevision !== undefined) return;
    const wasNewest = this.slider.value === this.slider.max;
    const frames = this.frames();
    this.slider.max = String(frames.length);
    if (wasNewest || this.slider.value > frames.length) this.slider.value = String(frames.length);
    this.showAbsent();
    this.moveTo(Number(this.slider.value));
  }

  /** Show the flight as it was when `count` frames had been taken. */
  moveTo(count) {
    this.count = count;
    this.tellPlace();
    this.draw();
  }

  togglePlay() {
    if (this.playing) {
      clearInterval(this.playing);
      this.playing = null;
    } else {
      if (this.slider.value === this.slider.max) this.slider.value = "0";
      const step = Math.max(1, Math.round(this.slider.max / 150));
      this.playing = setInterval(() => {
        this.slider.value = String(Math.min(Number(this.slider.value) + step, Number(this.slider.max)));
        this.moveTo(Number(this.slider.value));
        if (this.slider.value === this.slider.max) this.togglePlay();
      }, 200);
    }
    this.play.setAttribute("aria-pressed", String(Boolean(this.playing)));
  }

  draw() {
    this.drawnAt = Date.now();
    this.drawnRevision = this.placements.revision;
    this.lines.clearLayers();
    const frames = this.frames();
    const isPast = this.count !== undefined && this.count < frames.length && !byId("flight").hidden;
    const until = isPast ? this.count : frames.length;
    const here = (one) => one.island === this.map.layer?.island;
    const shown = frames.slice(0, until).filter(here);
    this.veil.remove();
    this.map.hidesNewest = isPast; // one frame is marked: the one that it is played to
    this.map.showOutline();
    if (isPast) {
      this.veil.show(frames.slice(until).filter(here).map(outlineOf).filter(Boolean), shown.map(outlineOf).filter(Boolean));
      this.veil.addTo(this.map.map);
    }
    if (this.showsOutlines || isPast) for (const frame of shown.slice(this.showsOutlines ? 0 : -1)) this.outline(frame, frame === shown.at(-1));
    if (!this.showsPath) return;
    for (const [vehicle, own] of grouped(shown)) {
      this.drawPath(own.map(middleOf).filter(Boolean), this.fleet.isSeveral ? this.fleet.colourOf(vehicle) : PATH_COLOUR);
    }
  }

  drawPath(middles, colour) {
    for (const [color, weight] of [["#000", 5], [colour, 2]]) this.lines.addLayer(L.polyline(middles, { renderer: this.renderer, color, weight, interactive: false }));
  }

  outline(frame, isNewest) {
    const corners = outlineOf(frame);
    if (corners) this.lines.addLayer(L.polygon(corners, { renderer: this.renderer, color: isNewest ? "#ffe600" : this.fleet.isSeveral ? this.fleet.colourOf(frame.vehicle) : "#fff", weight: isNewest ? 4 : 1, fill: false, interactive: false }));
  }

  /** Frames that are not on the map, by their reasons. */
  showAbsent() {
    const items = [...this.placements.absent.values()].slice(-200).reverse().map(({ name, reason }) => {
      const item = document.createElement("li");
      item.textContent = `${name}: ${reason}`;
      return item;
    });
    const title = byId("flight-absent-title");
    title.textContent = items.length ? t("Not on the map: {n}", { n: this.placements.absent.size }) : t("All frames are on the map.");
    this.absent.replaceChildren(...items);
  }
}

/** Frames by their aircraft, in their order. */
function grouped(frames) {
  const groups = new Map();
  for (const frame of frames) {
    if (!groups.has(frame.vehicle)) groups.set(frame.vehicle, []);
    groups.get(frame.vehicle).push(frame);
  }
  return groups;
}

/** Frames of several aircraft as if all had flown at one time: each one's first, middle and last come about together. */
function interleaved(placed) {
  const times = new Map();
  for (const frames of grouped(placed).values()) frames.forEach((frame, k) => times.set(frame, (k + 1) / frames.length));
  return placed.sort((one, other) => times.get(one) - times.get(other));
}

