// @ts-check
// Missions for a ground station: over what no frame has seen, or where a person may have been missed; and over an area that is to
// be looked at through its trees, with how to fly for that.

import { byId, element } from "/viewer/dom.js";
import { metresIn, percentIn } from "/viewer/numbers.js";
import { fetchDocument } from "/viewer/server.js";
import { said, t } from "/viewer/words.js";

const NOTHING = "There is nothing to fly again"; // which is no fault: so the server's sentence begins
const TIMEOUT_MS = 60000; // gaps of a long flight on a busy machine
/** @type {[string, number][]} colour, width */
const LINE = [["#000", 5], ["#9be15d", 3]];

export class Mission {
  /** `sought()`: the person of the panel of probabilities, { posture, clothes }. */
  constructor(sought) {
    this.sought = sought;
    this.form = byId("mission-form");
    this.said = byId("mission-said");
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
    byId("mission").addEventListener("opened", () => (this.said.textContent = ""));
  }

  async save() {
    const { looks, below } = this.form.elements;
    try {
      const asked = this.asked({ looks: looks.value });
      if (below.value.trim()) {
        for (const [name, value] of Object.entries({ ...this.sought(), below: String(percentIn(below.value) / 100) })) asked.set(name, value);
      }
      await this.bring(asked, "gaps", this.said);
    } catch (error) {
      tell(this.said, error.message, true);
    }
  }

  /** What is asked for, with the height that was given. Throws an Error with a sentence. */
  asked(told) {
    const { height } = this.form.elements;
    const asked = new URLSearchParams(told);
    if (height.value.trim()) asked.set("height", String(metresIn(height.value)));
    return asked;
  }

  /** Save a mission; what stands against it is said in an element. */
  async bring(asked, name, where) {
    const { format } = this.form.elements;
    tell(where, t("Asking …"));
    try {
      const response = await fetch(`/api/v1/mission.${format.value}?${asked}`, { signal: AbortSignal.timeout(TIMEOUT_MS) });
      if (!response.ok) throw new Error((await response.text()).trim() || `${response.status}`);
      tell(where, t("Saved. It is advice: look at it in the ground station before it is flown."));
      offer(await response.blob(), `${name}.${format.value}`);
    } catch (error) {
      tell(where, said(error.message), !error.message.startsWith(NOTHING));
    }
  }
}

/** How to fly for many looks at each place, and a mission for that over an area that is drawn. */
export class CanopyMission {
  /** `mission`: the panel's, which has the format and the height. */
  constructor(map, pointing, mission) {
    this.map = map;
    this.mission = mission;
    this.island = null;
    this.inView = undefined;
    this.corners = [];
    this.drawn = L.layerGroup().addTo(map.map);
    this.form = byId("canopy-form");
    this.told = byId("canopy-told");
    this.said = byId("canopy-said");
    const draw = byId("canopy-draw");
    const tool = { button: draw, said: "Click round the area.", place: (island, x, y) => this.add(island, x, y) };
    draw.onclick = () => {
      this.forget();
      pointing.take(tool);
    };
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
    this.form.addEventListener("input", () => this.read());
    byId("mission").addEventListener("opened", () => this.read());
    byId("mission").addEventListener("closed", () => this.forget());
    map.map.on("layeradd", () => this.map.layer?.island !== this.inView && this.turnTo(this.map.layer?.island));
  }

  /** Another island is in view: what was drawn and told was of the one before. */
  turnTo(island) {
    this.inView = island;
    this.forget();
    if (!byId("mission").hidden) this.read();
  }

  wish() {
    const { looks, at } = this.form.elements;
    return { looks: String(Math.round(Number(looks.value))), at: String(Number(at.value) / 100) };
  }

  async read() {
    const island = this.map.layer?.island;
    this.told.textContent = "";
    if (island === undefined || !this.form.checkValidity()) return;
    const asked = `${new URLSearchParams(this.wish())}`;
    const answer = await fetchDocument(`/api/v1/islands/${island}/flying?${asked}`).catch(() => null);
    if (answer && asked === `${new URLSearchParams(this.wish())}`) this.tell(answer);
  }

  /** @param {Api.Flying} answer */
  tell({ looks, forward, side, step_m, spacing_m, gsd_m, interval_s, speed_m_s, speed_share }) {
    const lines = [t("{n} looks: {forward} % overlap along, {side} % across.", { n: looks, forward: percent(forward), side: percent(side) })];
    if (step_m != null && spacing_m != null && gsd_m != null) {
      lines.push(t("A frame each {step} m, lines {spacing} m apart, {cm} cm a pixel.", { step: step_m.toFixed(1), spacing: spacing_m.toFixed(1), cm: (100 * gsd_m).toFixed(1) }));
    }
    if (interval_s != null && speed_m_s != null) lines.push(t("With a frame each {s} s, as in this flight: {speed} m/s at most.", { s: interval_s, speed: speed_m_s.toFixed(1) }));
    else if (interval_s != null && speed_share != null) lines.push(t("With a frame each {s} s, as in this flight: {share} % of a frame's shorter side a second at most.", { s: interval_s, share: percent(speed_share) }));
    this.told.textContent = lines.join(" ");
  }

  add(island, x, y) {
    if (island !== this.map.layer?.island) return;
    this.island = island;
    this.corners.push([x, y]);
    this.drawn.clearLayers();
    /** @type {[number, number][]} */
    const corners = this.corners.map(([cx, cy]) => [cy, cx]);
    for (const [color, weight] of LINE) this.drawn.addLayer(L.polygon(corners, { color, weight, fill: false, interactive: false }));
    byId("canopy-save").disabled = this.corners.length < 3;
  }

  forget() {
    this.corners = [];
    this.drawn.clearLayers();
    this.said.textContent = "";
    byId("canopy-save").disabled = true;
  }

  async save() {
    if (this.corners.length < 3) return;
    const outline = this.corners.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(";");
    try {
      await this.mission.bring(this.mission.asked({ ...this.wish(), island: String(this.island), outline }), "trees", this.said);
    } catch (error) {
      tell(this.said, error.message, true);
    }
  }
}

/** In sight, and as an alarm only where something is wrong.
 * @param {HTMLElement} where */
function tell(where, sentence, isWrong = false) {
  where.setAttribute("role", isWrong ? "alert" : "status");
  where.textContent = sentence;
  where.scrollIntoView({ block: "nearest" });
}

function percent(share) {
  return Math.round(100 * share);
}

/** @param {Blob} data */
function offer(data, name) {
  const address = URL.createObjectURL(data);
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), TIMEOUT_MS);
}
