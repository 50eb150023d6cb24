// @ts-check
// Fly the gaps: what no frame has seen, or where a person may have been missed, as a mission for a ground station.

import { byId, element } from "/viewer/dom.js";
import { said, t } from "/viewer/words.js";

const NOTHING = "There is nothing to fly again"; // which is no fault: so the server's sentence begins
const TIMEOUT_MS = 60000; // gaps of a long flight on a busy machine

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
    const { format, looks, below, height } = this.form.elements;
    const asked = new URLSearchParams({ looks: looks.value });
    if (height.value.trim()) asked.set("height", height.value.trim().replace(",", "."));
    if (below.value.trim()) {
      for (const [name, value] of Object.entries({ ...this.sought(), below: String(Number(below.value) / 100) })) asked.set(name, value);
    }
    this.tell(t("Asking …"));
    try {
      const response = await fetch(`/api/v1/mission.${format.value}?${asked}`, { signal: AbortSignal.timeout(TIMEOUT_MS) });
      if (!response.ok) throw new Error((await response.text()).trim() || `${response.status}`);
      this.tell(t("Saved. It is advice: look at it in the ground station before it is flown."));
      offer(await response.blob(), `gaps.${format.value}`);
    } catch (error) {
      this.tell(said(error.message), !error.message.startsWith(NOTHING));
    }
  }

  /** In sight, and as an alarm only where something is wrong. */
  tell(sentence, isWrong = false) {
    this.said.setAttribute("role", isWrong ? "alert" : "status");
    this.said.textContent = sentence;
    this.said.scrollIntoView({ block: "nearest" });
  }
}

/** @param {Blob} data */
function offer(data, name) {
  const address = URL.createObjectURL(data);
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), TIMEOUT_MS);
}
