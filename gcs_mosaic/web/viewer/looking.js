// @ts-check
// Looking, patch by patch: the server lends each open page ground that nobody has looked at, at full sharpness, and takes in how
// long somebody really looked. A key, a button or a swipe brings the next.

import { send } from "/viewer/api.js";
import { byId, element } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { closePanels, isMapFree } from "/viewer/panels.js";
import { t } from "/viewer/words.js";

const CELL = 128; // canvas units
const BASE_LEVEL = 16; // of zoom: a canvas unit is a pixel
const TICK_MS = 200;
const KEEP_MS = 10000;
const AWAKE_MS = 15000; // since a key, the pointer or a finger: a page that nobody sits at looks at nothing
const LONGEST_S = 10; // of one patch
const SWIPE_PX = 60;
const PERSON_M = 0.5;
const MOST_SIDE = 64; // cells

export class Looking {
  /** `metresPerUnit()`: of the island in view, undefined where it is not known. */
  constructor(map, reviews, metresPerUnit) {
    this.map = map;
    this.reviews = reviews;
    this.metresPerUnit = metresPerUnit;
    this.session = crypto.getRandomValues(new Uint32Array(3)).join("-");
    this.bar = byId("looking");
    this.told = byId("looking-told");
    this.drawn = L.layerGroup().addTo(map.map);
    this.patch = null;
    this.turn = 0; // of questions: what answers one of before the last, or of before the end, is not acted on
    this.startCounting();
    this.askedIsland = null;
    byId("looking-begin").onclick = () => this.begin();
    byId("looking-end").onclick = () => this.end();
    byId("looking-next").onclick = () => this.next();
    byId("looking-later").onclick = () => this.next(true);
    byId("looking-mark").onclick = () => byId("finds-mark").click();
    document.addEventListener("keydown", (event) => this.onKey(event), { capture: true });
    closeByEscape("looking", () => this.isOn(), () => this.end());
    this.listenForSwipes(map.map.getContainer());
    setInterval(() => this.tick(), TICK_MS);
    setInterval(() => this.keep(), KEEP_MS);
    addEventListener("pagehide", () => this.giveBack());
    map.map.on("resize", () => this.isOn() && this.show());
  }

  isOn() {
    return !this.bar.hidden;
  }

  async begin() {
    if (!this.map.layer) return;
    closePanels();
    if (!byId("sheet").hidden) byId("state").click(); // it would lie over the patches
    byId("turn-none").click(); // patches are upright
    this.bar.hidden = false;
    document.body.classList.add("looking");
    this.map.setMode("free");
    this.map.map.dragging.disable();
    byId("looking-next").focus();
    await this.ask();
  }

  end() {
    this.turn++;
    this.isAsking = false;
    this.giveBack();
    this.bar.hidden = true;
    document.body.classList.remove("looking");
    this.map.map.dragging.enable();
    this.drawn.clearLayers();
    this.patch = null;
    this.reviews.read();
  }

  giveBack() {
    if (this.patch) this.leave();
  }

  leave() {
    const body = new Blob([JSON.stringify({ session: this.session })], { type: "application/json" });
    navigator.sendBeacon("/api/v1/looking/leave", body);
  }

  /** The patch was looked at, or is put off. */
  async next(isPutOff = false) {
    if (!this.isAsking) await this.ask(isPutOff);
  }

  startCounting() {
    this.seconds = 0;
    this.zoomedOut = Infinity; // the farthest zoom at which they were counted
  }

  async ask(isPutOff = false) {
    const { layer } = this.map;
    if (!layer) return;
    const turn = ++this.turn;
    this.isAsking = true;
    this.askedIsland = layer.island;
    const seconds = Math.min(this.seconds, LONGEST_S);
    const level = Math.round(Math.min(this.zoomedOut, this.map.map.getZoom()));
    try {
      const body = { session: this.session, island: layer.island, ...this.room(), level, seconds, put_off: isPutOff, looked: this.patch?.box ?? null };
      const answer = await send("POST", "/looking", body);
      if (turn !== this.turn) {
        if (!this.isOn()) this.leave(); // it was lent to nobody
        return;
      }
      const isSame = JSON.stringify([this.patch?.island, this.patch?.box]) === JSON.stringify([answer.patch?.island, answer.patch?.box]);
      this.take(answer, isSame && this.patch && !isPutOff && !answer.counted && seconds > 0);
    } catch (error) {
      if (turn !== this.turn) return;
      this.told.textContent = error.message;
    }
    this.isAsking = false;
  }

  /** @param {Api.AnswerTo<"POST", "/api/v1/looking">} answer */
  take(answer, isTooShort) {
    if (!isTooShort) this.startCounting();
    this.patch = answer.patch;
    this.bringNew(answer.map_revision);
    this.others = answer.others;
    this.show();
    const share = answer.cells ? Math.floor((100 * (answer.cells - answer.left)) / answer.cells) : 0;
    const told = [isTooShort ? t("Too short to count: look for a second.") : "", answer.cut ? t("{share} % of what is shared out is looked at.", { share }) : t("{share} % of this part is looked at.", { share })];
    if (!answer.cells) told.splice(0, 2, t("Nothing of this part is known now."));
    else if (!answer.patch && answer.left) told.unshift(t("Others have the rest."));
    else if (!answer.patch && !answer.cut) told.unshift(t("All of this part is looked at."));
    if (answer.cut) told.push(t("Ground farther out is in no patch: look there by hand."));
    const unit = this.metresPerUnit();
    if (unit && answer.patch) told.push(t("A person is {px} px across on the screen.", { px: ((PERSON_M / unit) * this.perUnit()).toFixed(0) }));
    this.told.textContent = told.filter(Boolean).join(" ");
  }

  /** The patch is looked at as new as it was lent, even if nobody has told this page what was painted. */
  bringNew(revision) {
    const { layer } = this.map;
    if (!this.patch || layer?.island !== this.patch.island || layer.revision >= revision) return;
    const [left, top, right, bottom] = this.patch.box;
    layer.refresh(revision, ({ z, x, y }) => {
      const side = 256 * 2 ** (BASE_LEVEL - z);
      const [x0, y0] = [x * side - 2 ** 23 - 0.5, y * side - 2 ** 23 - 0.5];
      return x0 < right && x0 + side > left && y0 < bottom && y0 + side > top;
    });
  }

  /** CSS pixels of a canvas unit. */
  perUnit() {
    return 2 ** (this.map.map.getZoom() - BASE_LEVEL);
  }

  /** The zoom of full sharpness, or a level less where the pane does not hold a cell. */
  zoom() {
    const [across, down] = this.pane();
    const full = this.map.layer.options.maxNativeZoom;
    return Math.max(full - 1, Math.min(full, BASE_LEVEL + Math.floor(4 * Math.log2(Math.min(across, down) / CELL)) / 4));
  }

  pane() {
    const { x, y } = this.map.map.getSize();
    return [x, Math.max(y - this.bar.offsetHeight, 1)];
  }

  /** Cells that the pane holds. */
  room() {
    const side = CELL * 2 ** (this.zoom() - BASE_LEVEL);
    const [columns, lines] = this.pane().map((length) => Math.min(MOST_SIDE, Math.max(1, Math.floor(length / side))));
    return { columns, lines };
  }

  show() {
    this.drawn.clearLayers();
    for (const other of this.others ?? []) this.draw(other, { color: "#fff", weight: 2, dashArray: "4 6" }, other.who);
    if (!this.patch) return;
    const [left, top, right, bottom] = this.patch.box;
    const zoom = this.zoom();
    const aside = this.bar.offsetHeight / 2 / 2 ** (zoom - BASE_LEVEL);
    this.map.map.setView([(top + bottom) / 2 + aside, (left + right) / 2], zoom, { animate: false });
    this.draw(this.patch, { color: "#000", weight: 4 });
    this.draw(this.patch, { color: "#ffe600", weight: 2 });
  }

  draw({ box: [left, top, right, bottom] }, style, name = "") {
    /** @type {any} */
    const bounds = [[top, left], [bottom, right]];
    const drawn = L.rectangle(bounds, { ...style, fill: false, interactive: false });
    if (name) drawn.bindTooltip(element("span", { className: "upright", textContent: name }), { permanent: true, direction: "center" });
    this.drawn.addLayer(drawn);
  }

  /** Time counts while somebody is there, nothing lies over the map, its tiles have come and the whole patch is in view, sharp. */
  tick() {
    if (!this.isOn() || !this.map.layer) return;
    if (this.map.layer.island !== this.askedIsland) {
      this.startCounting();
      this.next();
    }
    if (!this.patch || !this.isLookedAt()) return;
    this.seconds += TICK_MS / 1000;
    this.zoomedOut = Math.min(this.zoomedOut, this.map.map.getZoom());
  }

  isLookedAt() {
    const isThere = !document.hidden && Date.now() - this.reviews.lastInput < AWAKE_MS;
    const isSharp = this.patch.island === this.map.layer.island && this.map.map.getZoom() >= this.zoom() - 0.5;
    if (!isMapFree() || !isThere || !isSharp || !this.map.layer.isComplete()) return false;
    const [left, top, right, bottom] = this.map.turn.seen();
    const [x0, y0, x1, y1] = this.patch.box;
    const rim = CELL / 2; // what is lost at the edge is less than the half of a cell
    return left <= x0 + rim && top <= y0 + rim && right >= x1 - rim && bottom >= y1 - rim;
  }

  async keep() {
    if (!this.isOn() || !this.patch || document.hidden) return;
    const answer = await send("POST", "/looking/keep", { session: this.session }).catch(() => null);
    if (this.isOn() && answer && !answer.kept) {
      this.startCounting(); // it is somebody else's, or was looked at too long ago
      await this.next();
    }
  }

  onKey(event) {
    const isElsewhere = !this.isOn() || event.target.matches?.("input, textarea, select") || !isMapFree();
    const action = { ArrowRight: () => this.next(), " ": () => this.next(), Enter: () => this.next(), ArrowDown: () => this.next(true) }[event.key];
    const isButton = event.target.matches?.("button") && (event.key === "Enter" || event.key === " ");
    if (isElsewhere || !action || (isButton && event.target.id !== "looking-next")) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) action();
  }

  listenForSwipes(pane) {
    let from = null;
    pane.addEventListener("pointerdown", ({ clientX, clientY, isPrimary }) => (from = this.isOn() && isPrimary ? [clientX, clientY] : null));
    pane.addEventListener("pointerup", ({ clientX, clientY, isPrimary }) => {
      if (!from || !isPrimary) return;
      const [across, down] = [clientX - from[0], clientY - from[1]];
      from = null;
      if (Math.abs(across) > SWIPE_PX && Math.abs(across) > 2 * Math.abs(down)) this.next(across > 0);
    });
  }
}
