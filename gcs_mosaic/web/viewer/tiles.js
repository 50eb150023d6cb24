// @ts-check
// A tile layer that exchanges single tiles when they have changed, and never takes away what is shown before the new is there.

// A browser has six connections to a server: one brings changes, and where tiles had all the others, the state of the flight would
// wait behind the slowest of them. So many of the map, and as many of what lies over it, are loaded at once.
const MOST_AT_ONCE = 2;
const FIRST_RETRY_MS = 1000;
const LONGEST_RETRY_MS = 15000;

const keyOf = (z, x, y) => `${z}/${x}/${y}`;

/** Which tiles to fetch again after the tiles [z, x, y] were painted: those, what lies above, and what fills from them. */
export function affectedBy(painted) {
  const self = new Set(painted.map(([z, x, y]) => keyOf(z, x, y)));
  const above = new Set();
  for (const [z, x, y] of painted) {
    for (let up = 1; up <= z; up++) above.add(keyOf(z - up, x >> up, y >> up));
  }
  return ({ z, x, y }) => {
    if (above.has(keyOf(z, x, y))) return true;
    for (let up = 0; up <= z; up++) if (self.has(keyOf(z - up, x >> up, y >> up))) return true;
    return false;
  };
}

/** So many are loaded at once; the others wait for their turn. */
class Turns {
  constructor(most) {
    this.free = most;
    /** @type {(() => void)[]} */
    this.waiting = [];
  }

  /** Do something when it is its turn, unless it is not wanted any more by then. */
  async take(isWanted, action) {
    if (this.free) this.free--;
    else await new Promise((begin) => this.waiting.push(() => begin(undefined)));
    try {
      if (isWanted()) await action();
    } finally {
      const next = this.waiting.shift();
      if (next) next();
      else this.free++;
    }
  }
}

const turns = { map: new Turns(MOST_AT_ONCE), over: new Turns(MOST_AT_ONCE) };
const shown = new Set(); // the layers

/** Ask at once for all that has failed, or was asked of a connection that is gone: there is one again. */
export function retryAll() {
  for (const layer of shown) layer.retry();
}

function decoded(image, path) {
  image.src = path;
  return image.decode();
}

/** @type {any} Leaflet's own way to make a class, and its inner methods, are in no types */
const { GridLayer } = L;

export const LiveTiles = GridLayer.extend({
  /** `path`: where the tiles of an island lie; `island`: whose tiles; `revision`: the newest known, so that no older answer is taken from the browser's cache;
      `onShown`: called whenever something new can be seen. */
  initialize(path, island, revision, onShown, options) {
    L.setOptions(this, options);
    this.path = path;
    this.island = island;
    this.revision = revision;
    this.onShown = onShown;
    this.coming = new Map(); // what each tile's element waits for: { image, timer, again, end }
  },

  /** Without `viewprereset`, at which Leaflet would throw all tiles away: those of another level stay until they are replaced. */
  getEvents() {
    const { viewprereset, ...events } = GridLayer.prototype.getEvents.call(this);
    return events;
  },

  createTile(coords, done) {
    const holder = document.createElement("div");
    holder.className = `on-its-way ${this.options.tileClass ?? ""}`;
    this.bring(holder, coords, () => done(null, holder));
    return holder;
  },

  /** Show a tile's newest picture in its element once it can be shown; ask again for as long as it does not come. */
  async bring(holder, coords, onFirst, retryMs = FIRST_RETRY_MS) {
    this.cancel(holder);
    const image = new Image();
    const again = () => this.bring(holder, coords, onFirst, Math.min(2 * retryMs, LONGEST_RETRY_MS));
    const wait = { image, again, end: () => {}, timer: 0 };
    const ended = new Promise((end) => (wait.end = () => end(undefined)));
    this.coming.set(holder, wait);
    image.alt = "";
    const path = this.path(this.island, coords, this.revision);
    const isWanted = () => this.coming.get(holder) === wait;
    try {
      await turns[this.options.tileClass ? "over" : "map"].take(isWanted, () => Promise.race([decoded(image, path), ended]));
    } catch {
      if (isWanted()) this.fail(holder, wait, retryMs);
      return;
    }
    if (!isWanted()) return; // a newer one was asked for, or the tile has gone
    this.coming.delete(holder);
    holder.classList.remove("not-loaded", "on-its-way");
    holder.replaceChildren(image);
    onFirst?.();
    this.onShown();
  },

  /** What was shown stays; where nothing was, "not loaded" is drawn, which is not "not seen". */
  fail(holder, wait, retryMs) {
    holder.classList.add("not-loaded");
    wait.timer = setTimeout(wait.again, retryMs);
  },

  cancel(holder) {
    const wait = this.coming.get(holder);
    if (!wait) return;
    clearTimeout(wait.timer);
    wait.image.removeAttribute("src"); // its connection is for others
    wait.end(); // and its turn: some browsers never tell that it does not come
    this.coming.delete(holder);
  },

  _removeTile(key) {
    const tile = this._tiles[key];
    if (tile) this.cancel(tile.el);
    GridLayer.prototype._removeTile.call(this, key);
  },

  onAdd(map) {
    shown.add(this);
    return GridLayer.prototype.onAdd.call(this, map);
  },

  onRemove(map) {
    shown.delete(this);
    GridLayer.prototype.onRemove.call(this, map);
  },

  retry() {
    for (const wait of [...this.coming.values()]) wait.again();
  },

  /** Fetch those visible tiles again that `isAffected` names. */
  refresh(revision, isAffected) {
    this.revision = revision;
    for (const tile of Object.values(this._tiles)) {
      if (!isAffected(tile.coords)) continue;
      const first = tile.loaded ? undefined : () => this._tileReady(tile.coords, null, tile.el);
      this.bring(tile.el, tile.coords, first);
    }
  },

  /** Whether all in view is the newest that is known. */
  isComplete() {
    return this.coming.size === 0;
  },

  /** Follow an island that has grown: its levels, and tiles where there were none. */
  grow(options) {
    L.setOptions(this, options);
    if (this._map) this._update();
  },
});
