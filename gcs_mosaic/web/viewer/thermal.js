// @ts-check
// What the greys of a thermal map mean: a bar with degrees where the camera tells them, else a sentence that says what is known.

import { byId, element } from "/viewer/dom.js";
import { Fresh } from "/viewer/fresh.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

export class Thermal {
  constructor(map) {
    this.map = map;
    this.island = null;
    this.box = byId("thermal");
    this.fresh = new Fresh(() => this.read());
  }

  /** The map is at this revision, perhaps on another island. */
  follow(revision) {
    const island = this.map.mosaic ? this.map.currentIsland()?.id : null;
    if (island == null) return;
    if (island !== this.island) {
      this.island = island;
      this.box.hidden = true; // it is the other island's
      this.fresh.begin();
    }
    this.fresh.follow(revision);
  }

  async read() {
    const island = this.island;
    const answer = await fetchDocument(`/api/v1/islands/${island}/thermal`);
    if (!answer || island !== this.island) return null;
    this.show(answer.scale);
    return answer.map_revision;
  }

  /** @param {Api.ThermalScale | null} scale */
  show(scale) {
    this.box.hidden = !scale;
    if (!scale) return;
    const [title, bar, values, note] = this.box.children;
    title.textContent = scale.kind === "temperature" ? t("Temperature, {unit}", { unit: scale.unit }) : scale.kind === "counts" ? (scale.unit ? t("Counts of the camera") : t("Numbers in the files")) : t("Colours of a palette");
    bar.hidden = !scale.colours.length;
    bar.style.background = scale.colours.length ? `linear-gradient(90deg, ${scale.colours.join(", ")})` : "";
    values.replaceChildren(...wordsUnder(scale).map((textContent) => element("span", { textContent })));
    note.textContent = noteOf(scale);
  }
}

/** @param {Api.ThermalScale} scale */
function wordsUnder(scale) {
  if (scale.kind === "palette") return scale.colours.length ? [t("colder"), t("warmer")] : [];
  return scale.values.filter((_, at) => at % 2 === 0).map((value) => written(scale, value));
}

/** Digits behind the point only where the scale is so short that they say something. */
function written({ values }, value) {
  const span = values[values.length - 1] - values[0];
  return value.toFixed(span < 2 ? 2 : span < 20 ? 1 : 0);
}

/** @param {Api.ThermalScale} scale */
function noteOf({ kind, unit, within }) {
  if (kind === "palette") return t("Each frame has its own range: one colour is not one temperature, and no degrees are known.");
  if (kind === "counts") return t("The files tell no degrees.");
  return within ? t("As the camera tells, without emissivity and air; 19 of 20 pixels lie within {within} {unit} of it.", { within, unit }) : t("As the camera tells, without emissivity and air.");
}
