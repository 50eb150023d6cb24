// @ts-check
// The page: polls the documents, listens for new tiles, and keeps map and strip up to date.

import { Absent } from "/viewer/absent.js";
import { AircraftChoice } from "/viewer/aircraft.js";
import { Anchors } from "/viewer/anchors.js";
import { byId } from "/viewer/dom.js";
import { Debriefing } from "/viewer/debriefing.js";
import { Detection } from "/viewer/detection.js";
import { Elsewhere } from "/viewer/elsewhere.js";
import { Finds } from "/viewer/finds.js";
import { Fleet } from "/viewer/fleet.js";
import { FlightPath } from "/viewer/flightpath.js";
import { Hints } from "/viewer/hints.js";
import { Islands } from "/viewer/islands.js";
import { Fresh } from "/viewer/fresh.js";
import { Ground } from "/viewer/ground.js";
import { forget, keep } from "/viewer/kept.js";
import { listenForKeys } from "/viewer/keys.js";
import { Lag, Live } from "/viewer/live.js";
import { Look } from "/viewer/look.js";
import { Looking } from "/viewer/looking.js";
import { MosaicMap } from "/viewer/map.js";
import { Measure } from "/viewer/measure.js";
import { CanopyMission, Mission } from "/viewer/mission.js";
import { Movers } from "/viewer/movers.js";
import { Novelty } from "/viewer/novelty.js";
import { Opinions } from "/viewer/opinions.js";
import { Originals } from "/viewer/originals.js";
import { makePanels, togglePanel } from "/viewer/panels.js";
import { fitOnPaper } from "/viewer/paper.js";
import { Placements } from "/viewer/placements.js";
import { Pointing } from "/viewer/pointing.js";
import { Reviews } from "/viewer/reviews.js";
import { Connection, fetchDocument, servedFlight } from "/viewer/server.js";
import { makeSheet, showStrip } from "/viewer/strip.js";
import { Trees } from "/viewer/trees.js";
import { Thermal } from "/viewer/thermal.js";
import { loadWords } from "/viewer/words.js";

const STATUS_EVERY_MS = 1000;
const NO_STATUS_EVERY_MS = 15000; // a saved flight has none
const CLOCK_EVERY_MS = 1000;
const MAP_EVERY_MS = 2000; // while changes are not told
const LATE_S = 5; // then what was told must have been lost on the way

await loadWords().catch(console.warn); // in English then
makePanels();
makeSheet();
byId("parts").onclick = () => togglePanel("islands");
listenForKeys();
fitOnPaper();
const connection = new Connection();
const map = new MosaicMap();
const placements = new Placements();
const originals = new Originals(() => mapRevision());
new Look();
byId("full").onclick = () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen());
const pointing = new Pointing(map, (island, x, y) => originals.ask(island, x, y));
const finds = new Finds(map, pointing, (find) => originals.ask(find.island, find.x, find.y, find.frame?.number));
const measure = new Measure(map, pointing);
const anchors = new Anchors(map, pointing, placements);
const reviews = new Reviews(map);
new Looking(map, reviews, () => measure.metresPerUnit());
const opinions = new Opinions();
new Elsewhere();
const detection = new Detection(map, pointing);
new Debriefing(map, () => detection.sought());
new CanopyMission(map, pointing, new Mission(() => detection.sought()));
const islands = new Islands(map);
const fleet = new Fleet(map, placements, showFollowed);
const flightPath = new FlightPath(map, placements, fleet);
const absent = new Absent(map);
const novelty = new Novelty(map);
new Hints(map, pointing, (hint) => originals.ask(hint.island, ...hint.place, hint.frame));
new Trees(map, pointing, measure, (island, x, y) => originals.ask(island, x, y));
new Ground(map);
new Movers(map, (island, x, y, frame) => originals.ask(island, x, y, frame));
originals.onMark = (place) => finds.begin(place);
const noted = [finds, measure, anchors]; // what people add
const lag = new Lag();
const aircraft = new AircraftChoice(byId("aircraft"));
/** @type {{ mosaic: Api.Mosaic | null, newestFrame: Api.Placed | Api.Covered | null, status: Api.Status | null, statusAt: number, served: string }} */
const known = { mosaic: null, newestFrame: null, status: null, statusAt: 0, served: "" }; // the last that came: it stays while the server is away
let isGone = false; // the flight's folder, which was there
let reading = false;
let readAgain = false;
const fresh = [...noted.map((one) => new Fresh(() => one.read())), map.layers, absent.fresh, flightPath, new Thermal(map), detection]; // what follows the map

/** Read mosaic.json and what is new of the frames; calls that come meanwhile lead to one more reading afterwards. */
async function readMap() {
  readAgain = true;
  if (reading) return;
  reading = true;
  while (readAgain) {
    readAgain = false;
    await connection.attempt(async () => {
      const mosaic = await fetchDocument("/mosaic.json");
      await placements.read(mosaic?.revision);
      startAfreshForAnotherFlight(mosaic);
      known.mosaic = mosaic ?? known.mosaic;
      byId("map").classList.remove("coming");
      showFollowed();
      show();
    });
  }
  reading = false;
}

/** Show the map as it is, and on it the newest frame of whom is followed. */
function showFollowed() {
  fleet.show(known.status);
  known.newestFrame = fleet.newestFrame();
  map.show(known.mosaic, known.newestFrame, (island) => placements.boundsOf(island));
}

/** The newest that is known of the map. */
function mapRevision() {
  return Math.max(map.revision, known.mosaic?.revision ?? 0);
}

/** A daemon that was started again may write another flight: nothing on this page is true of it. */
function startAfreshForAnotherFlight(mosaic) {
  const before = known.served;
  if (mosaic) known.served = servedFlight();
  const isSame = !before || before === known.served; // those of two days may have one name
  if (!known.mosaic || !mosaic || (known.mosaic.flight === mosaic.flight && isSame)) return;
  forget();
  location.reload();
}

let noStatusUntil = 0;

async function readStatus() {
  if (Date.now() >= noStatusUntil) await askStatus();
  else await connection.attempt(seeFolder); // and whether the server is there
  setTimeout(readStatus, STATUS_EVERY_MS);
}

async function askStatus() {
  await connection.attempt(async () => {
    const status = await fetchDocument("/status.json");
    if (known.status && known.status.state !== status?.state) map.refreshAll();
    known.status = status ?? known.status;
    if (status) known.statusAt = Date.now();
    if (status) isGone = false;
    else await seeFolder();
    if (!known.status && known.mosaic) noStatusUntil = Date.now() + NO_STATUS_EVERY_MS;
  });
  show();
}

/** A folder that was deleted, or whose disk was pulled: what is shown is left over, and nothing more comes. */
async function seeFolder() {
  isGone = (await fetchDocument("/mosaic.json")) === null && known.mosaic !== null;
}

const live = new Live(
  (change) => {
    map.tilesChanged(change.revision, change.tiles);
    if (change.tiles) novelty.painted(change.tiles);
    readMap();
  },
  () => {
    readMap();
    askStatus();
  },
  () => {
    for (const one of [...noted, opinions]) one.read(); // somebody has added something
  },
  () => connection.sign(),
);

/** Ask for what nobody tells: the map must not stand still in silence. */
async function pollMap() {
  const late = lagSeconds() > LATE_S;
  if (late && live.isOpen) live.restart();
  if (!live.isOpen) {
    await readMap();
    if (known.mosaic?.revision > map.revision) map.tilesChanged(known.mosaic.revision, null);
  }
  setTimeout(pollMap, MAP_EVERY_MS);
}

function lagSeconds() {
  return lag.seconds(known.mosaic?.revision ?? 0, known.status?.revision ?? 0);
}

function show() {
  map.setAway(connection.lostForSeconds() > 0 || isGone);
  fleet.show(known.status);
  aircraft.show(known.status);
  for (const one of noted) one.follow();
  for (const one of fresh) one.follow(mapRevision());
  islands.show();
  flightPath.show();
  showStrip({ ...known, hasEnded: live.hasEnded, isGone }, connection, lagSeconds(), map.mosaic ? map.currentIsland() : undefined, map.layers.gaps);
}

document.documentElement.dataset.begun = "1";
keep();
readMap();
readStatus();
pollMap();
setInterval(show, CLOCK_EVERY_MS);
