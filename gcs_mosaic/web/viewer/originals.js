// @ts-check
// A place on the map -> the original frames that saw it, one after another, each opened at that very spot.

import { byId } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { fetchDocument } from "/viewer/server.js";
import { SideBySide } from "/viewer/sidebyside.js";
import { written } from "/viewer/times.js";
import { toast } from "/viewer/toast.js";
import { t } from "/viewer/words.js";

const PREVIEW = 4; // the picture is shown at a quarter of its size until it has come whole
const LARGE = 16e6; // pixels; such a picture comes in pieces, those in view first
const PIECE = 512; // pixels
const CLOSEST = 3; // levels beyond pixel by pixel
const SOON_MS = 300; // until a server that does not know the newest frames is asked again
const LONGEST_MS = 5000;

/** Original pixels, y down: zoom 0 shows one as a CSS pixel; the centre of the top left one is (0, 0). */
const PIXELS = L.extend({}, L.CRS.Simple, { transformation: new L.Transformation(1, 0.5, 1, 0.5) });

/** @type {[string, number][]} colour, width */
const RING = [["#000", 5], ["#ffe600", 2]];

export class Originals {
  /** `mapRevision()`: the newest that is known of the map. */
  constructor(mapRevision) {
    this.mapRevision = mapRevision;
    this.asked = null; // what the last question was about
    this.box = byId("originals");
    this.map = null;
    /** @type {Api.Sighting[]} */
    this.found = [];
    this.at = 0; // which of them is shown
    this.before = 0; // which was shown before, to blink with
    this.beside = new SideBySide((index) => this.chosen(index));
    this.prefersBeside = false; // as it was looked at last
    const press = (id, action) => (byId(id).onclick = action);
    press("originals-close", () => this.close());
    press("originals-next", () => this.step(1));
    press("originals-previous", () => this.step(-1));
    press("originals-blink", () => this.show(this.before));
    press("originals-mark", () => this.mark());
    press("originals-beside", () => this.setBeside(!this.prefersBeside));
    this.onMark = null; // called with { frame, pixel } of what is in the middle
    document.addEventListener("keydown", (event) => this.key(event));
    closeByEscape("originals", () => this.isOpen, () => this.close());
    this.followSwipes(byId("originals-head"));
  }

  get isOpen() {
    return !this.box.hidden;
  }

  /** Ask who saw a place on an island's canvas; the frame of the number `first` is shown first, else the best. */
  async ask(island, x, y, first) {
    const asked = (this.asked = { island, x, y });
    toast(t("Asking …"));
    for (let wait = SOON_MS; this.asked === asked; wait *= 2) {
      const wanted = this.mapRevision();
      const answer = await fetchDocument(`/api/v1/islands/${island}/sightings?x=${x}&y=${y}&r=${wanted}`).catch(() => null);
      if (this.asked !== asked) return;
      if (!answer) {
        toast(t("No answer: ask again once the connection is back."));
        return;
      }
      const isOld = answer.map_revision < wanted;
      this.take(answer.sightings, first, isOld);
      if (!isOld || wait > LONGEST_MS) return;
      await new Promise((done) => setTimeout(done, wait));
    }
  }

  /** Who saw the place; `isOld`: the newest frames are not known to whoever answers. Without any the map stays in sight. */
  take(found, first, isOld) {
    const nobody = t("No frame saw this place.");
    if (!found.length) toast(isOld ? t("None of the frames before the last few seconds saw this place: asking again …") : nobody);
    if (!found.length) return;
    toast("");
    const shown = this.isOpen ? this.shown?.number : first;
    const same = this.isOpen && found.length === this.found.length && this.shown;
    this.found = found;
    this.isOld = isOld;
    this.box.hidden = false;
    this.at = Math.max(0, found.findIndex(({ number }) => number === shown));
    if (same) return this.tell(found[this.at], this.at);
    this.before = this.at;
    this.begin();
    this.show(this.at);
    this.setBeside(this.prefersBeside);
  }

  /** All looks beside each other, or one of them. */
  setBeside(isBeside) {
    this.prefersBeside = isBeside;
    byId("originals-beside").setAttribute("aria-pressed", String(isBeside));
    byId("original").hidden = isBeside;
    for (const name of ["previous", "next", "blink", "mark", "download"]) byId(`originals-${name}`).hidden = isBeside;
    if (!isBeside) this.beside.hide();
    if (!isBeside || !this.asked) return this.shown && this.tell(this.shown, this.at);
    this.beside.show(this.asked, this.found, this.at);
    return this.say(t("{all} looks at this place", { all: this.found.length }));
  }

  /** One of those beside each other is looked at alone. */
  chosen(index) {
    this.setBeside(false);
    this.show(index);
    byId("originals-beside").focus();
  }

  begin() {
    if (this.map) return;
    this.map = L.map("original", {
      crs: PIXELS, attributionControl: false, zoomControl: false, zoomSnap: 0.25, fadeAnimation: false,
      minZoom: -6, maxZoom: CLOSEST, keyboard: false,
    });
    L.control.zoom({ position: "bottomright" }).addTo(this.map);
    new ResizeObserver(() => this.map?.invalidateSize({ animate: false })).observe(this.map.getContainer());
  }

  /** What is in the middle of the picture is a find. */
  mark() {
    if (!this.shown) return;
    const { lat, lng } = this.map.getCenter();
    const { number } = this.shown;
    this.close();
    this.onMark?.({ frame: number, pixel: [lng, lat] });
  }

  step(by) {
    if (this.found.length && !this.beside.isOpen) this.show((this.at + by + this.found.length) % this.found.length);
  }

  /** Show one of them, the place in the middle, as large on the screen as it was in the one before. */
  show(index) {
    const one = this.found[index];
    if (!one || !this.map) return;
    const from = this.shown;
    [this.before, this.at] = [this.at, index];
    const zoom = from ? this.map.getZoom() + Math.log2(one.canvas_per_px / from.canvas_per_px) : 0;
    this.shown = one;
    this.map.setView([one.y, one.x], Math.min(Math.max(zoom, -6), CLOSEST), { animate: false });
    this.layPicture(one);
    this.tell(one, index);
  }

  /** @param {Api.Sighting} one */
  layPicture(one) {
    this.layers?.remove();
    const bounds = L.latLngBounds([-0.5, -0.5], [one.height - 0.5, one.width - 0.5]);
    const path = `/api/v1/frames/${one.number}/picture`;
    const layers = L.layerGroup([L.imageOverlay(`${path}?reduction=${PREVIEW}`, bounds)]).addTo(this.map);
    this.box.removeAttribute("data-sharp");
    const sharp = () => this.layers === layers && this.box.setAttribute("data-sharp", one.name);
    const failed = () => this.layers === layers && this.say(t("{name}: the original cannot be shown.", { name: one.name }));
    if (one.width * one.height > LARGE) {
      const pieces = L.tileLayer(`/api/v1/frames/${one.number}/pieces/{x}/{y}.jpg`, {
        bounds, tileSize: PIECE, minZoom: -1.5, minNativeZoom: 0, maxNativeZoom: 0, keepBuffer: 1,
      });
      layers.addLayer(pieces.on("load", sharp).on("tileerror", failed));
    } else {
      const whole = Object.assign(new Image(), { src: path });
      whole.decode().then(() => this.layers === layers && layers.addLayer(L.imageOverlay(path, bounds)) && sharp(), failed);
    }
    for (const [color, weight] of RING) {
      layers.addLayer(L.circleMarker([one.y, one.x], { radius: 22, color, weight, fill: false, interactive: false }));
    }
    this.layers = layers;
  }

  tell(one, index) {
    if (this.prefersBeside) return;
    const parts = [
      `${t("{n} of {all}", { n: index + 1, all: this.found.length })}: ${one.name}`,
      ...(one.time ? [t(one.time_by === "file" ? "came {time}" : "taken {time}", { time: written(one.time) })] : []),
      ...(one.covered ? [t("not painted")] : []),
      ...(this.isOld ? [t("asking for newer ones …")] : []),
    ];
    this.say(parts.join(", "));
    const link = byId("originals-download");
    link.href = `/api/v1/frames/${one.number}/original`;
    link.download = one.name.split("/").pop();
  }

  say(text) {
    byId("originals-title").textContent = text;
  }

  clear() {
    this.layers?.remove();
    this.layers = this.shown = null;
  }

  close() {
    this.clear();
    this.asked = null;
    this.beside.hide();
    this.box.hidden = true;
    byId("map").focus();
  }

  key({ key, target }) {
    if (!this.isOpen || target.matches?.("input, textarea, select")) return;
    const action = { s: () => this.setBeside(!this.prefersBeside), ArrowRight: () => this.step(1), ArrowLeft: () => this.step(-1), b: () => this.beside.isOpen || this.show(this.before) }[key];
    action?.();
  }

  /** A swipe over the head line, since one over the picture moves it. */
  followSwipes(head) {
    let begun = null;
    head.addEventListener("pointerdown", ({ clientX }) => (begun = clientX));
    head.addEventListener("pointerup", ({ clientX }) => {
      if (begun !== null && Math.abs(clientX - begun) > 60) this.step(clientX < begun ? 1 : -1);
      begun = null;
    });
  }
}
