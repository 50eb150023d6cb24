// @ts-check
// The map turned by hand, so that the aircraft flies upwards, or so that north is up. Leaflet knows nothing of it: its container is turned as a whole,
// large enough to fill the pane at any angle, and what it is told of the mouse and the fingers is turned back.

import { byId } from "/viewer/dom.js";
import { outlineOf } from "/viewer/outline.js";

const REMEMBERED = 4; // newest frames, whose way is the course
const LEAST_WAY = 0.05; // of a frame's diagonal: a shorter way tells no course
const LEAST_TURN = 8; // degrees: the map does not follow each gust

export class Turn {
  /** `map`: Leaflet's map, in a pane that does not turn. */
  constructor(map) {
    this.map = map;
    this.pane = byId("pane");
    this.degrees = 0;
    this.isFlightUp = false;
    this.isNorthUp = false;
    this.north = null; // where it is on the canvas, degrees clockwise from its top; null: not known
    this.way = []; // middles of the newest frames
    this.onTurned = null; // called after the map was turned
    this.slider = byId("turn-slider");
    this.button = byId("turn-flight-up");
    this.northButton = byId("turn-north-up");
    this.northButton.onclick = () => this.setNorthUp(!this.isNorthUp);
    this.slider.oninput = () => this.byHand(Number(this.slider.value));
    byId("turn-none").onclick = () => this.byHand(0);
    this.button.onclick = () => this.setFlightUp(!this.isFlightUp);
    this.pane.append(map._controlContainer); // buttons stay upright
    new ResizeObserver(() => this.fill()).observe(this.pane);
    this.turnInput();
  }

  /** Width and height of what is seen of the map, CSS pixels. */
  get size() {
    return [this.pane.clientWidth, this.pane.clientHeight];
  }

  byHand(degrees) {
    this.setFlightUp(false);
    this.setNorthUp(false);
    this.to(degrees);
  }

  setFlightUp(isFlightUp) {
    this.isFlightUp = isFlightUp;
    this.button.setAttribute("aria-pressed", String(isFlightUp));
    if (!isFlightUp) return;
    this.setNorthUp(false);
    this.followCourse();
  }

  setNorthUp(isNorthUp) {
    this.isNorthUp = isNorthUp;
    this.northButton.setAttribute("aria-pressed", String(isNorthUp));
    if (!isNorthUp) return;
    this.setFlightUp(false);
    this.followNorth();
  }

  /** What an anchor tells, which may change while the map is turned by it. */
  setNorth(degrees) {
    this.north = degrees;
    this.northButton.disabled = degrees === null;
    this.followNorth();
  }

  followNorth() {
    if (this.isNorthUp && this.north !== null) this.to(-this.north);
  }

  /** The newest frame, which may be the one that was told before. */
  follow(frame) {
    const corners = frame && outlineOf(frame);
    if (!corners || this.way.at(-1)?.name === frame.name) return;
    const [y, x] = [0, 1].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length);
    const size = Math.hypot(corners[2][0] - corners[0][0], corners[2][1] - corners[0][1]);
    if (this.way.at(-1)?.island !== frame.island) this.way = [];
    this.way = [...this.way, { name: frame.name, island: frame.island, x, y, size }].slice(-REMEMBERED);
    if (this.isFlightUp) this.followCourse();
  }

  followCourse() {
    const [first, last] = [this.way[0], this.way.at(-1)];
    if (!last || Math.hypot(last.x - first.x, last.y - first.y) < LEAST_WAY * last.size) return;
    const course = (Math.atan2(last.x - first.x, first.y - last.y) * 180) / Math.PI; // clockwise from the map's own top
    if (Math.abs(between(-course - this.degrees)) >= LEAST_TURN) this.to(-course);
  }

  /** Turn the map clockwise, about its middle. */
  to(degrees) {
    this.degrees = between(degrees);
    this.slider.value = String(Math.round(this.degrees));
    this.pane.style.setProperty("--turn", `${this.degrees}deg`);
    this.fill();
    this.turnKeys();
    this.onTurned?.();
  }

  /** Make the container large enough for the pane at any angle, or as large as the pane if it is not turned. */
  fill() {
    const [width, height] = this.size;
    const side = Math.ceil(Math.hypot(width, height));
    const inset = this.degrees ? `${(height - side) / 2}px ${(width - side) / 2}px` : "0";
    Object.assign(this.map.getContainer().style, { inset, rotate: this.degrees ? "var(--turn)" : "none" });
    if (this.map._loaded) this.map.invalidateSize({ animate: false });
  }

  /** How many CSS pixels [across, down] a box of the canvas takes on the screen at zoom 16. */
  extent(bounds) {
    const width = bounds.getEast() - bounds.getWest();
    const height = Math.abs(bounds.getNorth() - bounds.getSouth());
    const [cos, sin] = this.axes().map(Math.abs);
    return [width * cos + height * sin, width * sin + height * cos];
  }

  /** Whether all of a box of the canvas is in the pane. */
  sees(bounds) {
    const [width, height] = this.size;
    const corners = [bounds.getNorthWest(), bounds.getNorthEast(), bounds.getSouthWest(), bounds.getSouthEast()];
    return corners.every((corner) => {
      const { x, y } = this.fromMiddle(this.map.latLngToContainerPoint(corner));
      return Math.abs(x) <= width / 2 && Math.abs(y) <= height / 2;
    });
  }

  /** A box of the canvas, [left, top, right, bottom], all of which is in the pane. */
  seen() {
    const [width, height] = this.size;
    const [cos, sin] = this.axes().map(Math.abs);
    const [across, down] = sin > cos ? [height, width] : [width, height]; // nearer to a quarter turn
    const share = Math.min(width / (across * cos + down * sin), height / (across * sin + down * cos));
    const half = L.point(across, down).multiplyBy(share / 2);
    const middle = this.map.getSize().divideBy(2);
    const [first, last] = [middle.subtract(half), middle.add(half)].map((point) => this.map.containerPointToLatLng(point));
    return [first.lng, first.lat, last.lng, last.lat];
  }

  /** Cosine and sine of the angle. */
  axes() {
    const radians = (this.degrees * Math.PI) / 180;
    return [Math.cos(radians), Math.sin(radians)];
  }

  /** A point of the container as it lies from the middle of the pane. */
  fromMiddle(point) {
    const { x, y } = point.subtract(this.map.getSize().divideBy(2));
    const [cos, sin] = this.axes();
    return L.point(x * cos - y * sin, x * sin + y * cos);
  }

  /** A point of the container as one of the pane, from its top left. */
  inPane(point) {
    const [width, height] = this.size;
    return this.fromMiddle(point).add([width / 2, height / 2]);
  }

  /** A way on the screen as one of the container. */
  turnedBack({ x, y }) {
    const [cos, sin] = this.axes();
    return L.point(x * cos + y * sin, y * cos - x * sin);
  }

  /** Clicks, wheels and fingers come by this function; dragging has a way of its own. */
  turnInput() {
    const { map } = this;
    map.mouseEventToContainerPoint = (event) => {
      const { left, top, width, height } = this.pane.getBoundingClientRect();
      const away = L.point(event.clientX - left - width / 2, event.clientY - top - height / 2);
      return this.turnedBack(away).add(map.getSize().divideBy(2));
    };
    const draggable = map.dragging._draggable;
    const onMove = draggable._onMove;
    draggable._onMove = (event) => {
      draggable._parentScale = { x: 1, y: 1 }; // Leaflet takes what is turned for stretched
      if (!this.degrees || event.touches?.length > 1) return onMove.call(draggable, event);
      const touch = event.touches?.[0] ?? event;
      const way = this.turnedBack(L.point(touch.clientX, touch.clientY).subtract(draggable._startPoint));
      const { x, y } = draggable._startPoint.add(way);
      return onMove.call(draggable, {
        type: event.type, target: event.target, cancelable: event.cancelable, clientX: x, clientY: y, preventDefault: () => event.preventDefault(),
      });
    };
  }

  /** An arrow key moves the map the way that it points on the screen. */
  turnKeys() {
    const { keyboard } = this.map;
    keyboard._setPanDelta(keyboard._map.options.keyboardPanDelta);
    for (const [key, [x, y]] of Object.entries(keyboard._panKeys)) {
      const way = this.turnedBack(L.point(x, y));
      keyboard._panKeys[key] = [way.x, way.y];
    }
  }
}

/** The same angle between -180 and 180 degrees. */
function between(degrees) {
  return ((((degrees + 180) % 360) + 360) % 360) - 180;
}
