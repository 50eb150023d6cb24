// @ts-check
// Second opinions: finds of others, each with its crop, and what people say of it by name.

import { send, trying, who } from "/viewer/api.js";
import { byId, element } from "/viewer/dom.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

/** @type {() => ["yes" | "no" | "unsure", string][]} once the words are there */
const answers = () => [["yes", t("Yes")], ["no", t("No")], ["unsure", t("Unsure")]];

export class Opinions {
  constructor() {
    this.list = byId("opinions-list");
    this.said = byId("opinions-said");
    byId("reviews").addEventListener("opened", () => this.read());
  }

  async read() {
    if (byId("reviews").hidden) return;
    const [finds, told] = await Promise.all([fetchDocument("/api/v1/finds"), fetchDocument("/api/v1/opinions")]).catch(() => [null, null]);
    if (!finds || !told) return;
    const others = finds.finds.filter((find) => !find.deleted && find.who !== who());
    byId("opinions-title").hidden = !others.length;
    this.list.replaceChildren(...others.map((find) => this.row(find, told.opinions.filter((one) => one.find === find.id))));
  }

  /** @param {Api.FindOpinion[]} opinions */
  row(find, opinions) {
    const title = `${find.label}, ${t("by {name}", { name: find.who })}`;
    const picture = element("img", { src: `/api/v1/finds/${find.id}/crop.jpg`, alt: "", loading: "lazy", width: 112, height: 112 });
    const mine = opinions.find((one) => one.who === who())?.opinion;
    const buttons = answers().map(([opinion, word]) => {
      const button = element("button", { type: "button", textContent: word, ariaLabel: `${word}: ${title}`, ariaPressed: String(mine === opinion) });
      button.onclick = () => trying(this.said, () => send("POST", `/finds/${find.id}/opinions`, { opinion })).then(() => this.read());
      return button;
    });
    const told = opinions.map((one) => `${one.who}: ${answers().find(([opinion]) => opinion === one.opinion)?.[1]}`).join(", ");
    return element("li", {}, picture, element("small", { textContent: title }), element("div", { className: "row" }, ...buttons), element("small", { textContent: told }));
  }
}
