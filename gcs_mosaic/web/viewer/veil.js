// @ts-check
// Ground that some frames show and others do not, veiled: what a flight had not seen yet at a time of it.

export const Veil = L.Layer.extend({
  options: { colour: "rgb(110 115 120 / 80%)" },

  onAdd(map) {
    this.canvas = L.DomUtil.create("canvas", "veil", map.getPane("overlayPane"));
    map.on("moveend zoomend resize", this.draw, this);
    this.draw();
  },

  onRemove(map) {
    map.off("moveend zoomend resize", this.draw, this);
    this.canvas.remove();
  },

  /** Outlines ([[y, x], …]) of what is veiled, and of what is not although it lies there too. */
  show(veiled, seen) {
    this.veiled = veiled;
    this.seen = seen;
    if (this._map) this.draw();
  },

  draw() {
    const { x: width, y: height } = this._map.getSize();
    Object.assign(this.canvas, { width, height });
    L.DomUtil.setPosition(this.canvas, this._map.containerPointToLayerPoint([0, 0]));
    const pen = this.canvas.getContext("2d");
    pen.fillStyle = this.options.colour;
    pen.fill(this.path(this.veiled ?? []), "nonzero");
    pen.globalCompositeOperation = "destination-out";
    pen.fillStyle = "#000";
    pen.fill(this.path(this.seen ?? []), "nonzero");
  },

  path(outlines) {
    const path = new Path2D();
    for (const outline of outlines) {
      outline.forEach((corner, at) => {
        const { x, y } = this._map.latLngToContainerPoint(corner);
        at ? path.lineTo(x, y) : path.moveTo(x, y);
      });
      path.closePath();
    }
    return path;
  },
});
