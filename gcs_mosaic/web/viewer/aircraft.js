// @ts-check
// The choice of the aircraft whose triggers are followed; shown once a second one is heard.

import { toast } from "/viewer/toast.js";
import { t } from "/viewer/words.js";

export class AircraftChoice {
  constructor(select) {
    this.select = select;
    select.addEventListener("change", () => this.choose(select.value));
  }

  /** @param {Api.Status} status */
  show(status) {
    const heard = new Map();
    for (const { aircraft, followed } of status?.mavlink ?? []) {
      for (const { system } of aircraft ?? []) heard.set(system, heard.get(system) || system === followed);
    }
    const systems = [...heard.keys()].sort((one, other) => one - other);
    const allCount = Boolean(status?.aircraft); // then none is followed alone
    this.select.hidden = allCount || systems.length < 2 || status.state === "stopped";
    if (document.activeElement === this.select) return; // an open list must not change under the finger
    const options = systems.map((system) => new Option(heard.get(system) ? t("Aircraft {system} (followed)", { system }) : t("Aircraft {system}", { system }), system));
    const same = options.map(({ text }) => text).join() === [...this.select.options].map(({ text }) => text).join();
    if (!same) this.select.replaceChildren(...options);
    const followed = systems.find((system) => heard.get(system));
    if (followed !== undefined) this.select.value = followed;
  }

  async choose(system) {
    this.select.blur();
    try {
      const response = await fetch(`/vehicle/${system}`, { method: "POST" });
      toast((await response.text()).trim());
    } catch {
      toast(t("No answer: nothing is known to have changed."));
    }
  }
}
