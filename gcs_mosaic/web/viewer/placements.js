// @ts-check
// Where the frames lie: all of them are read once, then what is told anew of some.

import { middleOf, outlineOf } from "/viewer/outline.js";
import { fetchDocument, fetchLines } from "/viewer/server.js";
import { t } from "/viewer/words.js";

const INWARDS = 0.8; // of the way from a frame's middle to its corner

export class Placements {
  constructor() {
    this.revision = 0;
    /** @type {Map<string, Api.Placed | Api.Covered>} */
    this.places = new Map(); // entries of frames that have a place, by name
    this.absent = new Map(); // { name, reason } of those that are not on the map
    this.newest = null;
    this.newestOf = new Map(); // names, by aircraft, where each has a source of its own
    this.counts = { revision: -1, of: new Map() };
  }

  /** Learn what is new; `revision`: the map's, if that is known. The journal is read first: what it leaves out is in placements.json by then. */
  async read(revision) {
    if (revision !== undefined && revision === this.revision) return;
    const [head, ...lines] = (await fetchLines(`/placements.jsonl?after=${this.revision}`)) ?? [null];
    if (!head || head.since > this.revision) {
      const all = await fetchDocument("/placements.json");
      if (all) {
        this.places.clear();
        this.absent.clear();
        this.revision = 0;
        this.take(all);
      }
    }
    for (const line of lines) {
      if (line.revision > this.revision) this.take(line);
    }
  }

  /** @param {Api.Placements} told */
  take({ revision, newest, newest_of: newestOf = {}, frames, covered = [], waiting, rejected }) {
    for (const { name, reason = t("waits: nothing that it shows is on the map yet") } of /** @type {(Api.Waiting & Partial<Api.Rejected>)[]} */ ([...waiting, ...rejected])) {
      this.places.delete(name);
      this.absent.set(name, { name, reason });
    }
    for (const frame of [...frames, ...covered]) {
      this.places.set(frame.name, frame);
      this.absent.delete(frame.name);
    }
    this.revision = revision;
    this.newest = newest;
    this.newestOf = new Map(Object.entries(newestOf).map(([system, name]) => [Number(system), name]));
  }

  /** What is painted of an island: [left, top, right, bottom] on the canvas; null if no frame is known to lie on it. */
  boundsOf(island) {
    const corners = [...this.places.values()].filter((one) => one.island === island && one.canvas_from_frame).flatMap((one) => outlineOf(one) ?? []);
    if (!corners.length) return null;
    const [ys, xs] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
    const least = (values) => values.reduce((one, other) => Math.min(one, other));
    const most = (values) => values.reduce((one, other) => Math.max(one, other));
    return [least(xs), least(ys), most(xs), most(ys)];
  }

  /** The place that a frame of an island shows, not at its very edge, nearest to another place; both [x, y], null without frames. */
  shownNear(island, [x, y]) {
    const placed = [...this.places.values()].filter((one) => one.island === island && one.canvas_from_frame);
    const corners = placed.flatMap((frame) => (outlineOf(frame) ?? []).map((corner) => [middleOf(frame), corner]));
    const places = corners.map(([middle, corner]) => [1, 0].map((axis) => middle[axis] + INWARDS * (corner[axis] - middle[axis])));
    const away = (place) => Math.hypot(place[0] - x, place[1] - y);
    return places.reduce((best, place) => (!best || away(place) < away(best) ? place : best), null);
  }

  /** How many frames of an aircraft have a place. */
  countOf(system) {
    if (this.counts.revision !== this.revision) {
      this.counts = { revision: this.revision, of: new Map() };
      for (const { vehicle } of this.places.values()) this.counts.of.set(vehicle, (this.counts.of.get(vehicle) ?? 0) + 1);
    }
    return this.counts.of.get(system) ?? 0;
  }

  /** The entry of the frame that came last of those that have a place, or null; `system`: of this aircraft. */
  newestFrame(system = null) {
    const named = this.places.get(system === null ? this.newest : this.newestOf.get(system));
    const frame = named ?? (system === null ? ([...this.places.values()].at(-1) ?? null) : null);
    return frame && "keyframe_from_frame" in frame ? this.besideKeyframe(frame) : frame;
  }

  /** A covered frame as its keyframe lies now, which alone is told of when it moves. */
  besideKeyframe(frame) {
    const keyframe = this.places.get(frame.covered_by);
    if (!keyframe) return frame;
    return { ...frame, island: keyframe.island, canvas_from_frame: product(keyframe.canvas_from_frame, frame.keyframe_from_frame) };
  }
}

/** Of two matrices (3x3). */
function product(a, b) {
  return a.map((row) => [0, 1, 2].map((column) => row.reduce((sum, value, k) => sum + value * b[k][column], 0)));
}
