// @ts-check
// Shots that are not on the map, where they should be: crosses with the reason.

import { byId, element } from "/viewer/dom.js";
import { Fresh } from "/viewer/fresh.js";
import { fetchDocument } from "/viewer/server.js";
import { said, t } from "/viewer/words.js";

const EVERY_MS = 5000; // shots that are waited for change nothing on the map

export class Absent {
  /** `map`: the MosaicMap. */
  constructor(map) {
    this.map = map;
    this.marks = L.layerGroup();
    this.known = "";
    this.isShown = false;
    this.button = byId("flight-crosses");
    this.button.onclick = () => this.toggle();
    this.fresh = new Fresh(() => this.read());
    setInterval(() => this.isShown && this.fresh.again(), EVERY_MS);
  }

  toggle() {
    this.isShown = !this.isShown;
    this.button.setAttribute("aria-pressed", String(this.isShown));
    if (this.isShown) this.marks.addTo(this.map.map);
    else this.marks.remove();
    if (this.isShown) this.fresh.again();
  }

  async read() {
    if (!this.isShown || document.hidden) return null;
    const answer = await fetchDocument("/api/v1/absent");
    const island = this.map.layer?.island;
    const text = JSON.stringify([answer?.absent, island]);
    if (!answer || text === this.known) return answer?.map_revision ?? null;
    this.known = text;
    this.marks.clearLayers();
    for (const one of answer.absent.filter((shot) => shot.place && shot.island === island)) this.marks.addLayer(mark(one));
    return answer.map_revision;
  }
}

/** @param {Api.AbsentShot} shot */
function mark({ name, reason, place: [x, y] }) {
  const icon = L.divIcon({ className: "absent", html: "", iconSize: [30, 30] });
  const why = said(reason);
  const told = element("span", { className: "upright", textContent: t("{name}: {reason}", { name: name || t("A shot"), reason: why }) });
  const marker = L.marker([y, x], { icon, keyboard: false, title: why });
  marker.on("add", () => marker.getElement().replaceChildren(element("span", { className: "upright", textContent: "✕" })));
  return marker.bindTooltip(told);
}
