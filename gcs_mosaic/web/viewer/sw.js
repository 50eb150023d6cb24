// @ts-check
// Keeps the page, its documents and the tiles that were shown, and answers with them when the server does not. Newest first: what
// is kept is only told when nothing else comes, and says of itself that it was kept.

const NAME = "gcs-mosaic 1";
const MOST_TILES = 6000; // about 200 MB
const QUARTER = 128; // px
const LOOK_EVERY = 300; // tiles between two looks whether there are too many
const ANSWER_MS = 4000;
const DOCUMENTS = /^\/(status\.json|mosaic\.json|placements\.json|api\/v1\/(layers|finds|scale|anchors))$/;
const PAGE = /^\/(viewer\/.*)?$/;
const JOURNAL = "/placements.jsonl";
const TILE = /^\/tiles\//;

/** @type {any} a worker of its own kind, of which the page's types know nothing */
const worker = self;
let stored = 0;

worker.addEventListener("install", () => worker.skipWaiting());
worker.addEventListener("activate", (event) => event.waitUntil(takeOver()));
worker.addEventListener("message", ({ data }) => data === "forget" && caches.delete(NAME));
worker.addEventListener("fetch", (event) => {
  const { method, url } = event.request;
  const { origin, pathname, searchParams } = new URL(url);
  if (method !== "GET" || origin !== location.origin) return;
  if (TILE.test(pathname)) event.respondWith(searchParams.has("kept") ? kept(pathname) : tile(event));
  else if (pathname === JOURNAL) event.respondWith(fetch(event.request).catch(nothingNew));
  else if (DOCUMENTS.test(pathname) || PAGE.test(pathname)) event.respondWith(newest(event.request, pathname));
});

async function takeOver() {
  for (const name of await caches.keys()) if (name !== NAME) await caches.delete(name);
  await worker.clients.claim();
}

/** What the server says, else what it said last. */
async function newest(request, pathname) {
  try {
    const patience = Number(request.headers.get("X-Patience")) || ANSWER_MS; // the page's own: a busy machine is not away
    const response = await fetch(request.url, { signal: AbortSignal.timeout(patience), headers: request.headers });
    if (response.ok && response.status === 200) (await caches.open(NAME)).put(pathname, response.clone());
    return response;
  } catch (error) {
    const found = await (await caches.open(NAME)).match(pathname);
    if (!found && DOCUMENTS.test(pathname)) return nothingNew(); // as if it were not written yet
    if (!found) throw error;
    const headers = new Headers(found.headers);
    headers.set("X-Kept", "1");
    return new Response(found.body, { status: 200, headers });
  }
}

/** The journal is of a living flight: the page then reads the whole list, which is kept. */
function nothingNew() {
  return new Response("", { status: 404, headers: { "X-Kept": "1" } });
}

async function tile(event) {
  const response = await fetch(event.request);
  if (response.status === 200) event.waitUntil(store(new URL(event.request.url).pathname, response.clone()));
  return response;
}

async function kept(pathname) {
  const cache = await caches.open(NAME);
  return (await cache.match(pathname)) ?? (await ofFiner(cache, pathname)) ?? Response.error();
}

/** A tile of the four of the next finer level, marked where one is not kept; null if none is: it may have been seen from nearer. */
async function ofFiner(cache, pathname) {
  const [island, z, x, y] = pathname.match(/\d+/g).map(Number);
  const places = [0, 1, 2, 3].map((n) => [n % 2, n >> 1]);
  const found = await Promise.all(places.map(([right, down]) => cache.match(`/tiles/${island}/${z + 1}/${2 * x + right}/${2 * y + down}`)));
  if (!found.some(Boolean) || typeof OffscreenCanvas === "undefined") return null;
  const canvas = new OffscreenCanvas(2 * QUARTER, 2 * QUARTER);
  const context = canvas.getContext("2d");
  for (const [n, [right, down]] of places.entries()) {
    const [left, top] = [right * QUARTER, down * QUARTER];
    if (found[n]) context.drawImage(await createImageBitmap(await found[n].blob()), left, top, QUARTER, QUARTER);
    else mark(context, left, top);
  }
  return new Response(await canvas.convertToBlob());
}

/** As the page marks what is not loaded. */
function mark(context, left, top) {
  for (const [radius, colour] of /** @type {[number, string][]} */ ([[4.5, "#fff"], [3.5, "#00458c"]])) {
    context.fillStyle = colour;
    for (let n = 0; n < 16; n++) {
      context.beginPath();
      context.arc(left + 16 + 32 * (n % 4), top + 16 + 32 * (n >> 2), radius, 0, 7);
      context.fill();
    }
  }
}

async function store(pathname, response) {
  const cache = await caches.open(NAME);
  await cache.put(pathname, response);
  if (++stored % LOOK_EVERY) return;
  const tiles = (await cache.keys()).filter(({ url }) => TILE.test(new URL(url).pathname));
  for (const one of tiles.slice(0, Math.max(0, tiles.length - MOST_TILES))) await cache.delete(one);
}
