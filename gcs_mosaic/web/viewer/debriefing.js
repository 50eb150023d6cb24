// @ts-check
// The file for the debriefing: the pictures are measured first, so that it can tell how probably somebody would have been seen;
// who presses again has it at once, without that.

import { byId, element } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { said, t } from "/viewer/words.js";

const AGAIN_MS = 2000; // between two questions how far the measuring is: it goes on for as long as somebody asks
const STUCK_MS = 30000; // pictures that cannot be measured now are not waited for
const TIMEOUT_MS = 120000; // for each find all looks at it are laid together
const KEPT_MS = 60000;

export class Debriefing {
  /** `sought()`: the person of the panel of probabilities. */
  constructor(map, sought) {
    this.map = map;
    this.sought = sought;
    this.link = byId("finds-debriefing");
    this.told = byId("finds-debriefing-said");
    this.isMeasuring = false;
    this.isSaving = false;
    this.link.onclick = (event) => {
      event.preventDefault();
      this.press();
    };
  }

  async press() {
    if (this.isSaving) return;
    if (!this.isMeasuring) {
      this.isMeasuring = true;
      await this.measured();
      if (!this.isMeasuring) return; // it was saved meanwhile
    }
    this.isMeasuring = false;
    await this.save();
  }

  /** Until all pictures are, or nothing comes of it, or nobody waits any longer. */
  async measured() {
    const asked = `${new URLSearchParams(this.sought())}`;
    for (const { id } of this.map.mosaic?.islands.filter((one) => one.merged_into == null) ?? []) {
      let [known, since] = [-1, Date.now()];
      while (this.isMeasuring && Date.now() - since < STUCK_MS) {
        const answer = await fetchDocument(`/api/v1/islands/${id}/detection?${asked}`).catch(() => null);
        if (!answer || answer.by == null || answer.measured >= answer.frames) break;
        if (answer.measured > known) [known, since] = [answer.measured, Date.now()];
        if (this.isMeasuring) this.told.textContent = t("{n} of {all} pictures are measured for the probability. Press again to save the file without it.", { n: answer.measured, all: answer.frames });
        await new Promise((done) => setTimeout(done, AGAIN_MS));
      }
    }
  }

  async save() {
    this.isSaving = true;
    this.told.textContent = t("The file is made …");
    try {
      const response = await fetch(`/api/v1/debriefing.html?${new URLSearchParams(this.sought())}`, { signal: AbortSignal.timeout(TIMEOUT_MS) });
      if (!response.ok) throw new Error((await response.text()).trim() || `${response.status}`);
      const address = URL.createObjectURL(await response.blob());
      element("a", { href: address, download: "debriefing.html" }).click();
      setTimeout(() => URL.revokeObjectURL(address), KEPT_MS);
      this.told.textContent = t("Saved. It opens in any browser, without a network.");
    } catch (error) {
      this.told.textContent = error.name === "TimeoutError" || error instanceof TypeError ? t("No answer: ask again once the connection is back.") : said(error.message);
    }
    this.isSaving = false;
  }
}
