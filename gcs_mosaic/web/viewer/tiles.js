// A tile layer that exchanges single tiles when they have changed.

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

export const LiveTiles = L.GridLayer.extend({
  /** `island`: whose tiles; `revision`: the newest known, so that no older answer is taken from the browser's cache. */
  initialize(island, revision, options) {
    L.setOptions(this, options);
    this.island = island;
    this.revision = revision;
  },

  createTile(coords, done) {
    const image = this.imageOf(coords);
    image.onload = () => done(null, image);
    image.onerror = () => done(new Error("no tile"), image);
    return image;
  },

  imageOf({ z, x, y }) {
    const image = new Image();
    image.alt = "";
    image.src = `/tiles/${this.island}/${z}/${x}/${y}?r=${this.revision}`;
    return image;
  },

  /** Fetch those visible tiles again that `isAffected` names. */
  refresh(revision, isAffected) {
    this.revision = revision;
    for (const tile of Object.values(this._tiles)) if (isAffected(tile.coords)) this.exchange(tile);
  },

  /** Put a tile's new picture in the place of its old one, once it can be shown: nothing flickers. */
  async exchange(tile) {
    const image = this.imageOf(tile.coords);
    tile.coming = image;
    try {
      await image.decode();
    } catch {
      return; // the old picture stays; the next change tries again
    }
    if (tile.coming !== image || this._tiles[this._tileCoordsToKey(tile.coords)] !== tile) return;
    image.className = tile.el.className;
    image.style.cssText = tile.el.style.cssText;
    tile.el.replaceWith(image);
    tile.el = image;
  },

  /** Follow an island that has grown: its levels, and tiles where there were none. */
  grow(options) {
    L.setOptions(this, options);
    if (this._map) this._update();
  },
});
