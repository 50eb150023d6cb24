// @ts-check
// On other maps: for each ground station the address to paste, a code to scan, and what is to be known of it there.

import { byId, element } from "/viewer/dom.js";
import { copied } from "/viewer/handing.js";
import { fetchDocument } from "/viewer/server.js";
import { t } from "/viewer/words.js";

const EACH_MS = 3000; // while the panel is open

/** `address`: the name of the one that is pasted; `base`: where the station shows no other map beside it. */
const STATIONS = [
  {
    name: "QGroundControl", address: "xyz", base: true,
    how: [{ said: "In its settings, under maps, as the custom map URL; then choose the map of that name." }],
    limits: [
      { said: "It keeps every tile that it has loaded, also an empty one: what is painted later shows there only once its map cache is emptied." },
      { said: "Versions 5.0 may load no tile at all where there is no internet. Try it before the flight; this page needs none." },
    ],
  },
  {
    name: "Mission Planner", address: "wms", base: true,
    how: [{ said: "In the flight planner choose the map WMS Custom, and paste this where it asks for the server." }],
    limits: [{ said: "It shows this map alone, down to zoom level 22." }],
  },
  {
    name: "ATAK, WinTAK", address: "mobac", code: "atak_import",
    how: [{ said: "Scan the code on the device, or open the link there: ATAK asks, and shows the map as an overlay that can be switched." }],
    limits: [
      { said: "From version 4.4 on it asks for changes every five seconds by itself; older ones keep what they have loaded." },
      { said: "WinTAK imports the same file; it was not tried." },
    ],
    links: [["atak_import", { said: "Open in ATAK" }], ["mobac", { said: "Map source" }], ["data_package", { said: "Data package with finds" }]],
  },
  {
    name: "QGIS", address: "xyz",
    how: [{ said: "Open the project, or add an XYZ layer with this address. WMS and WMTS are served too." }],
    limits: [],
    links: [["qgis", { said: "Project for QGIS" }], ["wms", { said: "WMS" }], ["wmts", { said: "WMTS" }]],
  },
  {
    name: "Google Earth", address: "kml",
    how: [{ said: "Add a network link with this address, or open the file. What is in view is asked for again every ten seconds." }],
    limits: [],
    links: [["kml", { said: "Network link (KML)" }]],
  },
  {
    name: "Leaflet, MapLibre, OpenLayers", address: "xyz",
    how: [{ said: "XYZ tiles of 256 px; TileJSON tells bounds, levels and a revision that is another whenever something changes." }],
    limits: [],
    links: [["tilejson", { said: "TileJSON" }]],
    isPage: true,
  },
];

export class Elsewhere {
  constructor() {
    this.panel = byId("elsewhere");
    this.list = byId("elsewhere-list");
    this.told = byId("elsewhere-told");
    this.reach = byId("elsewhere-reach");
    this.answer = null;
    this.rows = STATIONS.map((station) => new Station(station));
    this.list.append(...this.rows.map(({ box }) => box));
    this.panel.addEventListener("opened", () => this.read());
  }

  async read() {
    if (this.panel.hidden) return;
    clearTimeout(this.timer);
    const answer = await fetchDocument("/api/v1/maps").catch(() => null);
    if (answer) this.show(answer);
    this.timer = setTimeout(() => this.read(), EACH_MS);
  }

  /** @param {Api.MapsForOthers} answer */
  show(answer) {
    this.told.textContent = whatIsShown(answer);
    this.reach.textContent = whoReachesIt(answer);
    this.reach.className = answer.reach === "network" ? "" : "misfit";
    for (const row of this.rows) row.show(answer);
  }
}

class Station {
  constructor(station) {
    this.station = station;
    this.field = element("input", { readOnly: true, type: "text", ariaLabel: t("Address for {name}", { name: station.name }) });
    this.field.onfocus = () => this.field.select();
    this.copied = element("span", { textContent: "" });
    this.copied.setAttribute("role", "status");
    this.copy = element("button", { type: "button", textContent: t("Copy"), ariaLabel: `${t("Copy")}: ${station.name}`, onclick: () => this.copyIt() });
    this.scan = element("button", { type: "button", textContent: t("Code to scan"), ariaLabel: `${t("Code to scan")}: ${station.name}`, onclick: () => this.toggleCode() });
    this.scan.setAttribute("aria-pressed", "false");
    this.code = element("img", { className: "code", alt: t("Address for {name} as a QR code", { name: station.name }), hidden: true });
    this.links = element("div", { className: "row" });
    this.notes = element("div", { className: "notes" });
    this.box = element("details", {},
      element("summary", { textContent: station.name }),
      ...station.how.map(({ said }) => element("p", { textContent: t(said) })),
      this.field, element("div", { className: "row" }, this.copy, this.scan), this.copied, this.code, this.links,
      ...station.limits.map(({ said }) => element("p", { className: "limit", textContent: t(said) })), this.notes);
    this.shown = "";
  }

  /** @param {Api.MapsForOthers} answer */
  show(answer) {
    const { name, address, base, links = [], isPage } = this.station;
    const all = { ...answer.addresses, ...(base ? answer.over_underlay : null) };
    const state = JSON.stringify([all, answer.is_local, answer.cors, answer.reach]);
    if (state === this.shown) return;
    this.shown = state;
    this.field.value = all[address];
    this.links.replaceChildren(...links.map(([key, { said }]) => element("a", { href: all[key], textContent: t(said), target: "_blank", rel: "noopener" })));
    this.links.hidden = !links.length;
    const notes = [];
    if (name === "QGroundControl" && answer.is_local) notes.push(t("It refuses this address: it takes none of this machine alone (127.0.0.1), nor of a network without a router (169.254)."));
    if (address === "mobac" && answer.reach !== "network") notes.push(t("A device cannot reach this address: ATAK wants one of the network."));
    if (base && !answer.over_underlay) notes.push(t("Around the flight it is empty there; web: {underlay: FILE} in the settings puts a map of yours under it."));
    if (isPage && !answer.cors) notes.push(t("A page of another site is refused until the settings say web: {cors: true}."));
    this.notes.replaceChildren(...notes.map((text) => element("p", { className: "limit", textContent: text })));
    if (!this.code.hidden) this.loadCode();
  }

  async copyIt() {
    this.copied.textContent = (await copied(this.field)) ? t("Copied.") : t("Select it and copy it by hand.");
  }

  toggleCode() {
    this.code.hidden = !this.code.hidden;
    this.scan.setAttribute("aria-pressed", String(!this.code.hidden));
    if (!this.code.hidden) this.loadCode();
  }

  loadCode() {
    const { address, code = address } = this.station;
    this.code.src = `/api/v1/maps/codes/${code}.svg`;
  }
}

/** @param {Api.MapsForOthers} answer */
function whatIsShown({ islands, unanchored, error_m }) {
  if (!islands.length) return t("Nothing is shown on other maps: no part of the flight has an anchor. Set two pins under Anchor; of pins that are set it says there why they lay nothing.");
  const shown = t("Shown on other maps, ± {m} m (95 %) at the worst corner.", { m: Math.ceil(error_m) });
  return unanchored.length ? `${shown} ${t("Not shown, without an anchor: island {ids}.", { ids: unanchored.join(", ") })}` : shown;
}

/** @param {Api.MapsForOthers} answer */
function whoReachesIt({ reach, needs_token }) {
  if (reach === "loopback") return t("Others cannot reach these addresses: the page is served to this machine alone. Start gcs-mosaic with --http 0.0.0.0:8470 to let them.");
  if (reach === "nowhere") return t("Others cannot reach these addresses: this machine is on no network.");
  return needs_token ? t("Whoever has one of these addresses may look at the flight.") : t("Everybody on the network may look at the flight.");
}
