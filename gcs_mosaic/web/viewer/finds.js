// @ts-check
// Finds: markers with a note, who and when, on the map and in a list; shared by all open pages.

import { send, setWho, trying, who } from "/viewer/api.js";
import { byId, element, focusedIn, isVisible } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { handOver } from "/viewer/handing.js";
import { Markers } from "/viewer/markers.js";
import { openPanel } from "/viewer/panels.js";
import { ChosenPlace } from "/viewer/pointing.js";
import { fetchDocument } from "/viewer/server.js";
import { written } from "/viewer/times.js";
import { toast } from "/viewer/toast.js";
import { t } from "/viewer/words.js";

const CROP = 240; // px of the original

export class Finds {
  /** `showOriginal(find)`: opens what the find was seen in. */
  constructor(map, pointing, showOriginal) {
    this.map = map;
    this.pointing = pointing;
    this.showOriginal = showOriginal;
    /** @type {Api.Find[]} */
    this.finds = [];
    this.sendsCot = false; // whether the settings name somebody
    this.markers = new Markers(map, nameOf, (find) => this.open(find));
    this.chosen = new ChosenPlace(map);
    this.form = byId("finds-form");
    this.list = byId("finds-list");
    this.undo = byId("finds-undo");
    this.said = byId("finds-said");
    this.who = byId("finds-who");
    this.mark = byId("finds-mark");
    this.tool = { button: this.mark, said: "Click where the find is.", place: (island, x, y) => this.begin({ island, x, y }) };
    this.who.value = who();
    this.who.onchange = () => setWho(this.who.value);
    this.mark.onclick = () => this.pointing.take(this.tool);
    this.form.onsubmit = (event) => this.save(event);
    byId("finds-cancel").onclick = () => this.endForm();
    closeByEscape("form", () => isVisible(this.form), () => this.endForm());
    this.undo.querySelector("button").onclick = () => this.restore();
  }

  /** Ask where they lie now, and what is new. */
  async read() {
    const answer = await fetchDocument("/api/v1/finds").catch(() => null); // those that are shown stay
    if (!answer) return null;
    this.finds = answer.finds;
    this.sendsCot = answer.cot;
    this.show();
    return answer.map_revision;
  }

  show() {
    this.markers.show(this.finds);
    const focused = focusedIn("find");
    this.list.replaceChildren(...[...this.finds].reverse().map((find) => this.row(find)));
    if (focused) this.list.querySelector(`[data-find="${focused}"]`)?.focus();
    byId("finds-earth").hidden = !this.finds.length || this.finds.some(({ geo }) => geo);
    byId("open-finds").textContent = this.finds.length ? `${t("Finds")}: ${this.finds.length}` : t("Finds");
  }

  /** Markers are those of the island in view. */
  follow() {
    this.markers.follow();
  }

  /** @param {Api.Find} find */
  row(find) {
    const { frame } = find;
    const picture = frame?.number == null ? [] : [element("img", {
      src: `/api/v1/frames/${frame.number}/crop.jpg?x=${Math.round(frame.pixel[0])}&y=${Math.round(frame.pixel[1])}&side=${CROP}`,
      alt: "", loading: "lazy", width: 96, height: 96,
    })];
    const where = find.geo ? `${find.geo.latitude.toFixed(6)}, ${find.geo.longitude.toFixed(6)} ± ${Math.ceil(find.geo.error_m)} m` : "";
    const when = written(find.created_utc * 1000);
    const text = element("div", {}, element("b", { textContent: `${find.id}. ${nameOf(find)}` }), element("p", { textContent: find.note }),
      element("small", { textContent: `${find.who}, ${when}${where && `, ${where}`}${find.follows ? "" : `, ${t("does not follow the map")}`}` }));
    const button = (label, action) => element("button", { type: "button", textContent: t(label), ariaLabel: `${t(label)}: ${nameOf(find)}`, onclick: action });
    const go = button("Show", () => this.goTo(find));
    go.dataset.find = find.id;
    const atak = this.sendsCot && find.geo ? [button("Send to ATAK", () => this.send(find))] : [];
    const give = button("Hand over", () => handOver(find.id));
    return element("li", {}, ...picture, text, element("div", { className: "row" }, go, button("Original", () => this.open(find)), give,
      button("Edit", () => this.edit(find)), button("Delete", () => this.remove(find)), ...atak));
  }

  /** @param {Api.Find} find */
  async send(find) {
    const sent = await trying(byId("finds-said"), () => send("POST", `/finds/${find.id}/cot`));
    if (sent) toast(t("Sent to {address}; nobody tells whether it came.", { address: sent.sent_to }));
  }

  /** @param {Api.Find} find */
  goTo(find) {
    if (this.map.layer?.island !== find.island) this.map.chooseIsland(find.island);
    this.markers.showAlone(find);
    this.map.setMode("free");
    this.map.map.setView([find.y, find.x], Math.max(this.map.map.getZoom(), 16), { animate: false });
  }

  /** @param {Api.Find} find */
  open(find) {
    this.goTo(find);
    this.showOriginal(find);
  }

  /** A form for a new find at a place: { island, x, y } or { frame, pixel }. */
  begin(place) {
    this.pointing.release();
    openPanel("finds");
    this.place = place;
    if ("x" in place) this.chosen.show(place.x, place.y);
    this.edited = null;
    this.key = crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`;
    this.fill({ label: "", kind: "", note: "" });
  }

  /** @param {Api.Find} find */
  edit(find) {
    this.place = null;
    this.edited = find;
    this.fill(find);
  }

  fill(find) {
    for (const name of ["label", "kind", "note"]) this.form.elements[name].value = find[name];
    this.form.hidden = false;
    this.form.scrollIntoView({ block: "end" }); // on a phone its last line would lie below
    this.form.elements.label.focus();
  }

  endForm() {
    this.form.hidden = true;
    this.said.textContent = "";
    this.chosen.clear();
    this.place = null;
    this.edited = null;
    this.mark.focus();
  }

  async save(event) {
    event.preventDefault();
    const texts = Object.fromEntries(["label", "kind", "note"].map((name) => [name, this.form.elements[name].value]));
    const { edited } = this;
    const answer = await trying(this.said, () => (edited
      ? this.change(edited, texts)
      : send("POST", "/finds", { ...texts, ...this.place, key: this.key })));
    if (answer?.isOutdated) {
      this.said.textContent = answer.deleted
        ? t("Somebody else has deleted it meanwhile: save again to have it back with these words.")
        : t("Somebody else has changed it meanwhile: look at it, then save again.");
      this.edited = answer;
    } else if (answer) this.endForm();
    await this.read();
  }

  /** Write a find's texts; one that was deleted is there again first, or they would be seen by nobody. */
  async change(find, texts) {
    const there = find.deleted ? await send("POST", `/finds/${find.id}/restore`, { revision: find.revision }) : find;
    return there.isOutdated ? there : send("PATCH", `/finds/${find.id}`, { ...texts, revision: there.revision });
  }

  /** @param {Api.Find} find */
  async remove(find) {
    const answer = await trying(this.said, () => send("DELETE", `/finds/${find.id}`, { revision: find.revision }));
    if (answer?.isOutdated && !answer.deleted) {
      this.said.textContent = t("Somebody else has changed it meanwhile: look at it, then delete it again.");
    } else if (answer) {
      this.deleted = answer;
      this.undo.querySelector("span").textContent = t("{name} is deleted.", { name: nameOf(find) });
      this.undo.hidden = false;
      this.undo.querySelector("button").focus();
    }
    await this.read();
  }

  /** Whatever has become of it meanwhile: nothing is overwritten by a find that is there again. */
  async restore() {
    const answer = await trying(this.said, () => send("POST", `/finds/${this.deleted.id}/restore`, { revision: this.deleted.revision }));
    if (answer?.isOutdated && answer.deleted) {
      this.deleted = answer;
      return this.restore();
    }
    if (answer) this.undo.hidden = true;
    await this.read();
  }
}

/** @param {Api.Find} find */
function nameOf(find) {
  return find.label || find.kind || t("Find");
}
