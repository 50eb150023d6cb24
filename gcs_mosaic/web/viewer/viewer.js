// The page: polls the documents, listens for new tiles, and keeps map and strip up to date.

import { MosaicMap } from "/viewer/map.js";
import { Placements } from "/viewer/placements.js";
import { Connection, fetchDocument } from "/viewer/server.js";
import { showStrip } from "/viewer/strip.js";

const STATUS_EVERY_MS = 1000;
const CLOCK_EVERY_MS = 1000;

const connection = new Connection();
const map = new MosaicMap();
const placements = new Placements();
const known = { mosaic: null, newestFrame: null, status: null };
let reading = false;
let readAgain = false;

/** Read mosaic.json and what is new of the frames; calls that come meanwhile lead to one more reading afterwards. */
async function readMap() {
  readAgain = true;
  if (reading) return;
  reading = true;
  while (readAgain) {
    readAgain = false;
    await connection.attempt(async () => {
      const [mosaic] = await Promise.all([fetchDocument("/mosaic.json"), placements.read()]);
      startAfreshForAnotherFlight(mosaic);
      Object.assign(known, { mosaic, newestFrame: placements.newestFrame() });
      map.show(mosaic, known.newestFrame);
      show();
    });
  }
  reading = false;
}

/** A daemon that was started again may write another flight: nothing on this page is true of it. */
function startAfreshForAnotherFlight(mosaic) {
  if (known.mosaic && mosaic && known.mosaic.flight !== mosaic.flight) location.reload();
}

async function readStatus() {
  await connection.attempt(async () => {
    const status = await fetchDocument("/status.json");
    if (known.status && known.status.state !== status?.state) map.refreshAll();
    known.status = status;
  });
  show();
  setTimeout(readStatus, STATUS_EVERY_MS);
}

function listen() {
  const source = new EventSource("/live");
  source.onmessage = (message) => {
    const change = JSON.parse(message.data);
    map.tilesChanged(change.revision, change.tiles);
    readMap();
  };
}

function show() {
  showStrip(known, connection, map.mosaic ? map.currentIsland() : undefined);
}

readMap();
readStatus();
listen();
setInterval(show, CLOCK_EVERY_MS);
