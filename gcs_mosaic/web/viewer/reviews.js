// @ts-check
// Which ground people have looked at closely: reported while one looks, and shaded where nobody has.

import { send, who } from "/viewer/api.js";
import { byId } from "/viewer/dom.js";
import { isMapFree } from "/viewer/panels.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

const EACH_MS = 3000; // between two reports of what is on the screen
const STILL_MS = 1000; // the map must have stood so long, and nothing have lain over it
const TICK_MS = 200;
const AWAKE_MS = 20000; // since the map or the pointer was last moved: a page that nobody sits at reviews nothing
const AGAIN_MS = 3000; // between two questions how much of the part was reviewed
const MOST_CELLS = 60000; // of one question; of a larger part what is in view is told of
const CELL = 128; // canvas units

export class Reviews {
  constructor(map) {
    this.map = map;
    this.shade = L.layerGroup().addTo(map.map);
    this.since = Date.now(); // it has been looked at the map, and that has stood still
    this.lastInput = -Infinity; // by a person, who has not touched anything yet
    this.panel = byId("reviews");
    this.isShown = false;
    this.isCounting = true;
    this.renderer = L.canvas({ padding: 0.2 });
    this.button = byId("reviews-show");
    this.counts = byId("reviews-count");
    this.whose = byId("reviews-whose");
    this.told = byId("reviews-told");
    this.button.onclick = () => this.toggle();
    this.counts.onclick = () => this.toggleCounting();
    this.whose.onchange = () => this.read();
    for (const kind of ["pointermove", "pointerdown", "wheel", "keydown"]) {
      document.addEventListener(kind, () => (this.lastInput = Date.now()), { passive: true, capture: true });
    }
    this.panel.addEventListener("opened", () => this.read());
    map.map.on("movestart zoomstart moveend zoomend", () => (this.since = Date.now()));
    setInterval(() => this.isLookedAt() || (this.since = Date.now()), TICK_MS);
    setInterval(() => this.report(), EACH_MS);
    setInterval(() => this.read(), AGAIN_MS);
  }

  toggle() {
    this.isShown = !this.isShown;
    this.button.setAttribute("aria-pressed", String(this.isShown));
    this.read();
  }

  toggleCounting() {
    this.isCounting = !this.isCounting;
    this.counts.setAttribute("aria-pressed", String(this.isCounting));
  }

  /** The zoom from which on a look counts: nine tenths of what the frames show. */
  leastLevel() {
    return (this.map.layer?.options.maxNativeZoom ?? 99) - 1;
  }

  box() {
    return this.map.turn.seen();
  }

  isLookedAt() {
    const { layer, map } = this.map;
    const isAwake = Date.now() - this.lastInput < AWAKE_MS;
    const isMap = !map.getContainer().classList.contains("through-trees"); // what is laid together is not as sharp as the frames
    const isLooking = isMap && this.isCounting && isAwake && document.visibilityState === "visible" && isMapFree() && byId("looking").hidden;
    return isLooking && Boolean(layer) && map.getZoom() >= this.leastLevel() - 0.5;
  }

  async report() {
    const { layer, map } = this.map;
    const looked = Math.min(EACH_MS, Date.now() - this.since);
    if (!this.isLookedAt() || !layer.isComplete() || looked < STILL_MS) return;
    const level = Math.max(0, Math.min(30, Math.round(map.getZoom())));
    try {
      await send("POST", "/reviews", { island: layer.island, box: this.box(), level, seconds: looked / 1000 });
      await this.read();
    } catch {
      // the next look is reported
    }
  }

  async read() {
    if (!this.isShown) this.shade.clearLayers();
    if (!this.map.layer || document.hidden || (!this.isShown && this.panel.hidden)) return;
    const { island } = this.map.layer;
    const { box: [left, top, right, bottom], isWhole } = this.asked();
    const whose = this.whose.value ? `&who=${encodeURIComponent(this.whose.value)}` : "";
    const query = `island=${island}&left=${left}&top=${top}&right=${right}&bottom=${bottom}&level=${this.leastLevel() - 1}${whose}`;
    const answer = await fetchDocument(`/api/v1/reviews?${query}`).catch(() => null);
    if (!answer || this.map.layer?.island !== island) return;
    const said = isWhole ? "{share} % of the ground of this part was reviewed." : "{share} % of the ground in view was reviewed.";
    const [done, open] = [answer.reviewed.length, answer.missing.length];
    this.told.textContent = done + open ? t(said, { share: Math.floor((100 * done) / (done + open)) }) : "";
    this.tellReviewers(answer.reviewers);
    if (this.isShown) this.draw(answer);
  }

  /** The whole part, or of a very large one what is in view. */
  asked() {
    const { bounds } = this.map.currentIsland();
    const [left, top, right, bottom] = bounds;
    const isWhole = ((right - left) / CELL) * ((bottom - top) / CELL) <= MOST_CELLS;
    return { box: isWhole ? bounds : this.box(), isWhole };
  }

  /** @param {Api.Reviewed} answer */
  draw({ cell, missing }) {
    this.shade.clearLayers();
    const { renderer } = this;
    const { units } = cell;
    const cells = missing.map(([x, y]) => [units * y - 2 ** 23, units * x - 2 ** 23])
      .map(([top, left]) => [[[top, left], [top, left + units], [top + units, left + units], [top + units, left]]]);
    // All in one, and none simplified, so that no seams show between them.
    this.shade.addLayer(L.polygon(/** @type {any} */ (cells), { renderer, smoothFactor: 0, stroke: false, fillColor: "#30006b", fillOpacity: 0.45, interactive: false }));
  }

  /** @param {readonly Api.Reviewer[]} reviewers */
  tellReviewers(reviewers) {
    const names = [t("anybody"), ...reviewers.map(({ who: name }) => name)];
    if (this.whose.options.length === names.length) return;
    const chosen = this.whose.value;
    this.whose.replaceChildren(...names.map((name, at) => new Option(name === who() ? `${name} (${t("you")})` : name, at ? name : "")));
    this.whose.value = chosen;
  }
}
