// The status strip, the alarm, the notices and the empty map's text. It never shows old numbers as if they were new.
// Red is kept for what must not be overlooked: that the page itself cannot be trusted. Losses are yellow.

import { ageOf } from "/viewer/server.js";

const HUNG_AFTER_S = 8; // the daemon writes its status each two seconds or more often
const LATE_AFTER_S = 10; // changes are asked for each two seconds if nobody tells them
const NOTICES = 3;

const byId = (id) => document.getElementById(id);

export function showStrip({ mosaic, newestFrame, status, hasEnded }, connection, lagSeconds, island) {
  const state = endOf(status, mosaic, hasEnded, connection.lostForSeconds()) ?? stateOf(status, mosaic, connection, lagSeconds);
  showState(state);
  showCounts(status, mosaic, island);
  showConditions(state.kind === "bad" ? [] : status?.conditions ?? []);
  showNotices(status?.notices ?? []);
  showEmpty(!mosaic?.islands.length && !newestFrame, status, state);
}

/** How it has ended, if it has: well, in a crash, or because the page of an earlier flight is no longer served; else null. */
function endOf(status, mosaic, hasEnded, lostSeconds) {
  const name = status?.flight ?? mosaic?.flight;
  const again = `To open it again: gcs-mosaic serve ${name}`;
  if (status?.state === "stopped" && (hasEnded || lostSeconds)) {
    const frames = mosaic ? `, ${count(mosaic.frames.placed + (mosaic.frames.covered ?? 0), "frame")}` : "";
    return { kind: "calm", title: "Flight ended", detail: `map complete${frames}`, farewell: `Ended, map complete${frames}. ${again}` };
  }
  if (!hasEnded) return null;
  if (!status) return { kind: "calm", title: "Saved flight", detail: "no longer served", farewell: `The page is no longer served. ${again}` };
  const alarm = `gcs-mosaic has ended without finishing: it crashed or was killed. What you see is from ${clock(status.updated)}. Start it again with the same words: the flight goes on by itself.`;
  return { kind: "bad", title: "Crashed", detail: `at ${clock(status.updated)}`, alarm };
}

/** What is going on: {kind, title, detail, alarm}; `alarm` is a sentence if what is shown may be old. */
function stateOf(status, mosaic, connection, lagSeconds) {
  const updated = status?.updated ?? mosaic?.updated;
  const asOf = updated ? `What you see is from ${clock(updated)}.` : "";
  const lostSeconds = connection.lostForSeconds();
  if (lostSeconds && connection.isRefused) {
    const alarm = `This device may not look any more: open the link again that gcs-mosaic shows on its terminal. ${asOf}`;
    return { kind: "bad", title: "Not allowed", detail: `for ${duration(lostSeconds)}`, alarm };
  }
  if (lostSeconds) {
    const alarm = `No connection to gcs-mosaic for ${duration(lostSeconds)}. ${asOf}`;
    return { kind: "bad", title: "No connection", detail: `for ${duration(lostSeconds)}`, alarm };
  }
  if (lagSeconds > LATE_AFTER_S) {
    const alarm = `The map is older than what gcs-mosaic has: its changes have not come for ${duration(lagSeconds)}.`;
    return { kind: "bad", title: "Map is old", detail: `for ${duration(lagSeconds)}`, alarm };
  }
  if (!status) return mosaic ? { kind: "calm", title: "Saved flight", detail: clock(updated) } : nothingYet();
  if (status.state === "stopped") return { kind: "calm", title: "Flight ended", detail: clock(updated) };
  const age = ageOf(updated);
  if (age > HUNG_AFTER_S) {
    const alarm = `gcs-mosaic has not shown a sign of life for ${duration(age)}. ${asOf}`;
    return { kind: "bad", title: "Not responding", detail: `for ${duration(age)}`, alarm };
  }
  return runningState(status);
}

function nothingYet() {
  return { kind: "calm", title: "Waiting", detail: "nothing is written yet" };
}

function runningState({ state, frames_in_queue: queue, seconds_behind: behind, mavlink, last_frame: last, watch }) {
  const silent = mavlink.find((link) => link.state === "silent" || link.state === "failed");
  const away = ["missing", "silent", "lost", "ended"].includes(watch?.state);
  const queued = queue ? `${queue === 1 ? "1 frame" : `${queue} frames`}, ${duration(behind ?? 0)} behind` : "";
  const trouble = silent ? `MAVLink ${silent.state}: ${silent.address}` : away && watchLine(watch);
  const warning = trouble && { kind: "warn", detail: trouble };
  const texts = {
    listening: { kind: "wait", title: "Listening", detail: "no frame yet" },
    flying: { kind: behind > LATE_AFTER_S ? "warn" : "good", title: "Flying", detail: queued || "frames arrive" },
    idle: { kind: "wait", title: "Idle", detail: last ? `no frame for ${duration(ageOf(last.time))}` : "" },
    settling: { kind: "wait", title: "Finishing", detail: queued || "painting the final map" },
  };
  return { ...(texts[state] ?? { kind: "warn", title: state, detail: "" }), ...warning };
}

function showState({ kind, title, detail, alarm, farewell }) {
  byId("farewell").hidden = !farewell;
  setText(byId("farewell"), farewell ?? "");
  byId("state").className = kind;
  setText(byId("state").querySelector("b"), title);
  setText(byId("state").querySelector("span"), detail);
  byId("alarm").hidden = !alarm;
  setText(byId("alarm"), alarm ?? "");
  document.body.classList.toggle("stale", Boolean(alarm));
}

function showCounts(status, mosaic, island) {
  const source = status ?? mosaic;
  const entries = source ? [...frameCounts(source.frames), ...eventCounts(source.events)] : [];
  entries.push(...linkCounts(status?.mavlink ?? []));
  const islands = mosaic?.islands.filter((island) => island.merged_into === undefined).length ?? 0;
  if (source) entries.push(["Islands", islands, islands > 1 ? "warn" : ""]);
  if (island?.held_out_px) entries.push(fit(island.held_out_px));
  if (status?.last_frame) entries.push(lastFrame(status));
  byId("counts").replaceChildren(...entries.map(countOf));
}

function frameCounts({ placed, covered, waiting, rejected, damaged, dropped, unstitched }) {
  return [
    ["Frames placed", placed, "good"],
    ...(covered ? [["Covered", covered, "", "kept, but not painted: a placed frame shows all that they do"]] : []),
    ["Waiting", waiting, ""],
    ["Rejected", rejected, rejected ? "warn" : ""],
    ...seldom([["Damaged", damaged], ["Dropped", dropped], ["Not stitched", unstitched]]),
  ];
}

function eventCounts({ matched, missing, failed }) {
  return [
    ["Triggers matched", matched, ""],
    ["Frames missing", missing, missing ? "warn" : ""],
    ...seldom([["Failed", failed]]),
  ];
}

/** What the links left out: triggers of aircraft that are not followed, packets whose signature is not right. */
function linkCounts(links) {
  const others = new Map();
  for (const [system, count] of links.flatMap((link) => Object.entries(link.other_triggers ?? {}))) {
    others.set(system, Math.max(others.get(system) ?? 0, count)); // one trigger may come over several links
  }
  const refused = links.flatMap((link) => Object.entries(link.refused ?? {})).filter(([, count]) => count);
  return [
    ...leftOut(`Of aircraft ${[...others.keys()].slice(0, 3).join(", ")}`, [...others], ([system, count]) => `${count} triggers of system ${system}`),
    ...leftOut("Packets refused", refused, ([why, count]) => `${count} ${why}`),
  ];
}

function leftOut(label, entries, text) {
  const total = entries.reduce((sum, [, count]) => sum + count, 0);
  return total ? [[label, total, "warn", entries.map(text).join(", ")]] : [];
}

/** Bad news that takes room only when there is some. */
function seldom(entries) {
  return entries.filter(([, count]) => count).map(([label, count]) => [label, count, "warn"]);
}

/** How well the island in view fits together, measured by matches that had no say in where anything lies. */
function fit({ median, p95, matches }) {
  const short = (px) => (px === null ? "∞" : String(Number(px.toPrecision(2))));
  const meaning = `Half of ${matches} points that were kept out of the fitting are torn apart by less than ${short(median)} px, 95 % by less than ${short(p95)} px`;
  return ["Fits to", `${short(median)} px`, "", meaning, `95 %: ${short(p95)}`];
}

function lastFrame({ state, last_frame: last }) {
  const when = state === "stopped" ? clock(last.time) : `${duration(ageOf(last.time))} ago`;
  return ["Last frame", when, last.outcome === "rejected" ? "warn" : "", `${last.name}: ${last.reason ?? last.outcome}${last.covered_by ? ` by ${last.covered_by}` : ""}`];
}

function countOf([label, value, kind, title, beside]) {
  const box = document.createElement("div");
  box.className = kind;
  box.title = title ?? "";
  box.append(element("dt", label), element("dd", String(value)));
  if (beside) box.lastChild.append(element("small", beside));
  return box;
}

/** What lasts, the worst first: each a line that says what to do. */
function showConditions(conditions) {
  const shown = conditions.map(({ level, text }) => `${level} ${text}`).join("\n");
  if (byId("conditions").dataset.shown === shown) return;
  byId("conditions").dataset.shown = shown;
  const lines = conditions.map(({ level, text }) => Object.assign(element("li", text), { className: level }));
  byId("conditions").replaceChildren(...lines);
}

function showNotices(notices) {
  const newest = notices.slice(-NOTICES).reverse();
  const lines = newest.map(({ time, level, text }) => {
    const line = element("li", "");
    line.className = level;
    line.append(element("time", clock(time)), element("span", text));
    return line;
  });
  byId("notices").replaceChildren(...lines);
}

function showEmpty(empty, status, { title, detail }) {
  byId("empty").hidden = !empty;
  if (!empty) return;
  const links = (status?.mavlink ?? []).map(({ address, state, last_heard: heard }) =>
    `MAVLink on ${address}: ${heard ? `heard ${duration(ageOf(heard))} ago` : state === "failed" ? "failed" : "nothing heard yet"}`);
  const watch = status?.watch ? [watchLine(status.watch)] : [];
  const lines = links.length || watch.length ? [...links, ...watch] : [`${title}: ${detail}`];
  byId("empty").querySelector("ul").replaceChildren(...lines.map((line) => element("li", line)));
}

function watchLine({ folder, state, since }) {
  const words = {
    watching: `Watching ${folder}: no frame has come yet`,
    missing: `The folder ${folder} is missing`,
    connecting: `Stream ${folder}: not connected yet`,
    connected: `Stream ${folder}: connected, no frame was taken yet`,
    silent: `Stream ${folder}: silent for ${since ? duration(ageOf(since)) : "some time"}`,
    lost: `Stream ${folder}: lost, trying again`,
  };
  return words[state] ?? `${folder} has ended`;
}

function element(name, text) {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}

/** Only touch what changes, or a screen reader would read it out each second. */
function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function count(number, what) {
  return `${number} ${what}${number === 1 ? "" : "s"}`;
}

function duration(seconds) {
  if (seconds < 120) return `${Math.round(seconds)} s`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`;
  return `${Math.round(seconds / 3600)} h`;
}

/** The time of day on this device; with the date if that is another day. */
function clock(moment) {
  const then = new Date(moment);
  const sameDay = then.toDateString() === new Date().toDateString();
  return sameDay ? then.toLocaleTimeString("en-GB") : then.toLocaleString("en-GB");
}
