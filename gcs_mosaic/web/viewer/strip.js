// @ts-check
// The line of state: one sentence, that which matters most; behind it a sheet with all that is known. The alarm, and the empty
// map's text. It never shows old numbers as if they were new.
// Red is kept for what must not be overlooked: that the page itself cannot be trusted. Losses are yellow.

import { byId, element } from "/viewer/dom.js";
import { closeByEscape } from "/viewer/escape.js";
import { ageOf, clockWasJustSet } from "/viewer/server.js";
import { written } from "/viewer/times.js";
import { said, t } from "/viewer/words.js";

const QUIET_AFTER_S = 8; // the daemon writes its status each two seconds or more often
const HUNG_AFTER_S = 30; // a very busy machine gives it no turn for many seconds
const LATE_AFTER_S = 10; // changes are asked for each two seconds if nobody tells them
const NOTICES = 50;
const OWN_WORDS = 2; // of a sentence that a notice may be: notices are of many kinds
const WORST = ["error", "warning", "info"];

/**
 * @param {{ mosaic: Api.Mosaic, newestFrame: unknown, status: Api.Status, statusAt: number, hasEnded: boolean, isGone: boolean }} told
 * @param {import("/viewer/server.js").Connection} connection
 * @param {number} lagSeconds
 * @param {Api.Island} [island] the one in view
 * @param {number} [gaps] on it
 */
export function showStrip({ mosaic, newestFrame, status, statusAt, hasEnded, isGone }, connection, lagSeconds, island, gaps = 0) {
  const state = endOf(status, mosaic, hasEnded, connection.lostForSeconds(), isGone) ?? stateOf({ status, statusAt, mosaic }, connection, lagSeconds, isGone);
  const conditions = state.kind === "bad" ? [] : status?.conditions ?? [];
  document.title = [status?.flight ?? mosaic?.flight, "gcs-mosaic"].filter(Boolean).join(" · "); // of several tabs, which is which
  showState(withWorst(state, conditions));
  showParts(mosaic, island, gaps);
  showCounts(status, mosaic, island);
  showConditions(conditions);
  showNotices(status?.notices ?? []);
  showEmpty(!mosaic?.islands.length && !newestFrame, status, state);
}

/** Let the line of state open and close the sheet behind it. */
export function makeSheet() {
  const [sheet, buttons] = [byId("sheet"), ["state", "chip"].map(byId)];
  const open = (isOpen) => {
    sheet.hidden = !isOpen;
    for (const one of buttons) one.setAttribute("aria-expanded", String(isOpen));
  };
  for (const one of buttons) one.onclick = () => open(sheet.hidden);
  closeByEscape("sheet", () => !sheet.hidden, () => open(false));
  byId("map").addEventListener("pointerdown", () => open(false));
  // What lies at the foot of the map makes room for what is said there.
  const texts = ["alarm", "farewell"].map(byId);
  const makeRoom = () => byId("pane").style.setProperty("--told", `${Math.max(...texts.map(({ offsetHeight }) => offsetHeight))}px`);
  const seen = new ResizeObserver(makeRoom);
  for (const one of texts) seen.observe(one);
}

/** The state with the worst condition as its sentence: one thing is told, and once. */
function withWorst(state, conditions) {
  const worst = conditions.find(({ level }) => level === "error") ?? conditions.find(({ level }) => level === "warning");
  if (!worst || state.kind === "bad") return state;
  if (state.isOld && worst.level !== "error") return state;
  return { ...state, kind: worst.level === "error" ? "bad" : "warn", detail: said(worst.text) };
}

/** How much of all frames is in view: parts that are not shown are always in sight. */
function showParts(mosaic, island, gaps) {
  const parts = partsOf(mosaic);
  const all = parts.reduce((sum, { frames }) => sum + frames, 0);
  const others = parts.length - 1;
  const texts = others > 0 && island
    ? [t("{n} of {all} frames here", { n: island.frames, all }), others === 1 ? t("1 more part") : t("{n} more parts", { n: others })]
    : [frameCount(all)];
  if (gaps) texts.push(gaps === 1 ? t("1 gap") : t("{n} gaps", { n: gaps }));
  byId("parts").hidden = !all;
  byId("parts").className = others > 0 ? "several" : gaps ? "gaps" : "";
  setText(byId("parts"), texts.join(", "));
}

/** How it has ended, if it has: well, in a crash, or because the page of an earlier flight is no longer served; else null. */
function endOf(status, mosaic, hasEnded, lostSeconds, isGone) {
  const name = status?.flight ?? mosaic?.flight;
  const again = t("To open it again: gcs-mosaic serve {name}", { name: typed(name) });
  const onward = t("Start it again with the same words: the flight goes on by itself.");
  if (hasEnded && isGone) {
    const gone = t("gcs-mosaic has ended while the flight's folder was gone: put it back where it was.");
    const alarm = `${gone} ${seenFrom(status?.updated ?? mosaic.updated)} ${status && status.state !== "stopped" ? onward : again}`;
    return { kind: "bad", title: t("Folder gone"), detail: t("what is shown is left over"), alarm };
  }
  if (status?.state === "stopped" && (hasEnded || lostSeconds)) {
    const map = finalMap(mosaic);
    return { kind: "calm", title: t("Flight ended"), detail: map, farewell: `${t("Ended, {map}.", { map })} ${again}` };
  }
  if (!hasEnded) return null;
  if (!status) {
    return { kind: "calm", title: t("Saved flight"), detail: t("no longer served"), farewell: `${t("The page is no longer served.")} ${again}` };
  }
  const time = written(status.updated);
  const crashed = t("gcs-mosaic has ended without finishing: it crashed or was killed.");
  const alarm = `${crashed} ${seenFrom(status.updated)} ${onward}`;
  return { kind: "bad", title: t("Crashed"), detail: t("at {time}", { time }), alarm };
}

/** A name as a shell takes it for one word: it may have spaces, or an ampersand. */
function typed(name) {
  return /^[\w@%+=:,./-]+$/.test(name) ? name : `'${String(name).replaceAll("'", `'"'"'`)}'`;
}

/** What has become of the map: complete only if it is in one part, and all frames that came are on it. */
function finalMap(mosaic) {
  if (!mosaic) return t("map final{frames}", { frames: "" });
  const { placed, covered, pending, waiting, rejected, damaged, dropped, unstitched } = mosaic.frames;
  const left = [pending, waiting, rejected, damaged, dropped, unstitched].some((count) => count > 0);
  const frames = `, ${frameCount(placed + (covered ?? 0))}`;
  return left || partsOf(mosaic).length > 1 ? t("map final{frames}", { frames }) : t("map complete{frames}", { frames });
}

/** @param {Api.Mosaic | null} mosaic */
function partsOf(mosaic) {
  return mosaic?.islands.filter((one) => one.merged_into === undefined) ?? [];
}

/** What is going on: {kind, title, detail, alarm}; `alarm` is a sentence if what is shown may be old, `isOld`: it is, by some seconds. */
function stateOf({ status, statusAt, mosaic }, connection, lagSeconds, isGone) {
  const updated = status?.updated ?? mosaic?.updated;
  const asOf = updated ? seenFrom(updated) : "";
  const lostSeconds = connection.lostForSeconds();
  if (lostSeconds && connection.isRefused) {
    const alarm = `${t("This device may not look any more: open the link again that gcs-mosaic shows on its terminal.")} ${asOf}`;
    return { kind: "bad", title: t("Not allowed"), detail: forTime(lostSeconds), alarm };
  }
  if (lostSeconds) {
    const alarm = `${t("No connection to gcs-mosaic for {time}.", { time: duration(lostSeconds) })} ${asOf}`;
    return { kind: "bad", title: t("No connection"), detail: forTime(lostSeconds), alarm };
  }
  if (isGone) {
    const alarm = `${t("The flight's folder is gone: put it back where it was. What the map does not show now may have been seen.")} ${asOf}`;
    return { kind: "bad", title: t("Folder gone"), detail: t("what is shown is left over"), alarm };
  }
  const lateSeconds = connection.lateForSeconds();
  if (lateSeconds) return { kind: "warn", isOld: true, title: t("Answers late"), detail: `${forTime(lateSeconds)}. ${asOf}` };
  if (lagSeconds > LATE_AFTER_S) {
    const time = duration(lagSeconds);
    const alarm = t("The map is older than what gcs-mosaic has: its changes have not come for {time}.", { time });
    return { kind: "bad", title: t("Map is old"), detail: forTime(lagSeconds), alarm };
  }
  if (!status) return mosaic ? { kind: "calm", title: t("Saved flight"), detail: t("painted {time}", { time: written(updated) }) } : nothingYet();
  if (status.state === "stopped") return { kind: "calm", title: t("Flight ended"), detail: t("painted {time}", { time: written(updated) }) };
  const age = clockWasJustSet() ? 0 : ageOf(updated);
  if (age > HUNG_AFTER_S && !connection.isJustBackSince(statusAt)) {
    const alarm = `${t("gcs-mosaic has not shown a sign of life for {time}.", { time: duration(age) })} ${asOf}`;
    return { kind: "bad", title: t("Not responding"), detail: forTime(age), alarm };
  }
  if (age > QUIET_AFTER_S) return { kind: "warn", isOld: true, title: t("Nothing new"), detail: `${forTime(age)}. ${asOf}` };
  return runningState(status);
}

function nothingYet() {
  return { kind: "calm", title: t("Waiting"), detail: t("nothing is written yet") };
}

/** @param {Api.Status} status */
function runningState({ state, frames, frames_in_queue: queue, seconds_behind: behind, mavlink, last_frame: last, watch }) {
  const silent = mavlink.find((link) => link.state === "silent" || link.state === "failed");
  const away = ["missing", "silent", "lost", "ended"].includes(watch?.state);
  const queued = queue ? t("{frames}, {time} behind", { frames: frameCount(queue), time: duration(behind ?? 0) }) : "";
  const link = silent && (silent.state === "silent" ? t("MAVLink silent: {address}", silent) : t("MAVLink failed: {address}", silent));
  const trouble = state !== "settling" && (link || (away && watchLine(watch))); // at the end nothing is listened for any more
  const warning = trouble && { kind: "warn", detail: trouble };
  const goesOn = frames.placed + (frames.covered ?? 0) > 0; // with a flight that was interrupted
  const texts = {
    listening: { kind: "wait", title: t("Listening"), detail: goesOn ? t("no new frame yet") : t("no frame yet") },
    flying: { kind: queue && behind > LATE_AFTER_S ? "warn" : "good", title: t("Flying"), detail: queued || t("frames arrive") },
    idle: { kind: "wait", title: t("Idle"), detail: last ? t("no frame for {time}", { time: duration(ageOf(last.time)) }) : "" },
    settling: { kind: "wait", title: t("Finishing"), detail: queued || t("painting the final map") },
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
  if (status && !status.mavlink?.length && !source.events.matched) drop(entries, t("Triggers matched"));
  entries.push(...linkCounts(status?.mavlink ?? []));
  const islands = partsOf(mosaic).length;
  if (source) entries.push([t("Islands"), islands, islands > 1 ? "warn" : ""]);
  if (island?.held_out_px) entries.push(fit(island.held_out_px));
  if (status?.last_frame) entries.push(lastFrame(status));
  byId("counts").replaceChildren(...entries.map(countOf));
}

function drop(entries, label) {
  const at = entries.findIndex(([one]) => one === label);
  if (at >= 0) entries.splice(at, 1);
}

/** @param {Api.FrameAccount} frames */
function frameCounts({ placed, covered, waiting, rejected, damaged, dropped, unstitched }) {
  return [
    [t("Frames placed"), placed, ""],
    ...(covered ? [[t("Covered"), covered, "", t("kept, but not painted: a placed frame shows all that they do")]] : []),
    [t("Waiting"), waiting, ""],
    [t("Rejected"), rejected, rejected ? "warn" : ""],
    ...seldom([[t("Damaged"), damaged], [t("Dropped"), dropped], [t("Not stitched"), unstitched]]),
  ];
}

/** @param {Api.EventAccount} events */
function eventCounts({ matched, missing, failed }) {
  return [
    [t("Triggers matched"), matched, ""],
    [t("Frames missing"), missing, missing ? "warn" : ""],
    ...seldom([[t("Failed"), failed]]),
  ];
}

/**
 * What the links left out: triggers of aircraft that are not followed, packets whose signature is not right.
 * @param {Api.Link[]} links
 */
function linkCounts(links) {
  const others = new Map();
  for (const [system, count] of links.flatMap((link) => Object.entries(link.other_triggers ?? {}))) {
    others.set(system, Math.max(others.get(system) ?? 0, count)); // one trigger may come over several links
  }
  const refused = links.flatMap((link) => Object.entries(link.refused ?? {})).filter(([, count]) => count);
  return [
    ...leftOut(t("Of aircraft {systems}", { systems: [...others.keys()].slice(0, 3).join(", ") }), [...others],
      ([system, n]) => t("{n} triggers of system {system}", { n, system })),
    ...leftOut(t("Packets refused"), refused, ([why, count]) => `${count} ${why}`),
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

/**
 * How well the island in view fits together, measured by matches that had no say in where anything lies.
 * @param {Api.HeldOut} found
 */
function fit({ median, p95, matches }) {
  const short = (px) => (px === null ? "∞" : String(Number(px.toPrecision(2))));
  const meaning = t("Half of {n} points that were kept out of the fitting are torn apart by less than {half} px, 95 % by less than {most} px",
    { n: matches, half: short(median), most: short(p95) });
  return [t("Fits to"), `${short(median)} px`, "", meaning, `95 %: ${short(p95)}`];
}

/** @param {Api.Status} status */
function lastFrame({ state, last_frame: last }) {
  const when = state === "stopped" ? written(last.time) : t("{time} ago", { time: duration(ageOf(last.time)) });
  return [t("Last frame"), when, last.outcome === "rejected" ? "warn" : "", `${last.name}: ${last.reason ?? last.outcome}${last.covered_by ? ` by ${last.covered_by}` : ""}`];
}

function countOf([label, value, kind, title, beside]) {
  const box = document.createElement("div");
  box.className = kind;
  box.title = title ?? "";
  const told = element("dd", { textContent: String(value) });
  if (beside) told.append(element("small", { textContent: beside }));
  box.append(element("dt", { textContent: label }), told);
  return box;
}

/**
 * What lasts, the worst first: each a line that says what to do.
 * @param {Api.Condition[]} conditions
 */
function showConditions(conditions) {
  const shown = conditions.map(({ level, text }) => `${level} ${text}`).join("\n");
  if (byId("conditions").dataset.shown === shown) return;
  byId("conditions").dataset.shown = shown;
  const chip = byId("chip");
  const count = conditions.length;
  chip.hidden = !count;
  chip.className = WORST.find((level) => conditions.some((one) => one.level === level)) ?? "";
  const [number, more] = (count === 1 ? t("1 to see to") : t("{n} to see to", { n: count })).split(/(?<=^\S+)(?= )/);
  chip.ariaLabel = `${number}${more ?? ""}`;
  chip.replaceChildren(number, element("span", { className: "more", textContent: more ?? "" }));
  byId("told").textContent = conditions.map(({ text }) => said(text)).join(" ");
  const lines = conditions.map(({ level, text }) => Object.assign(element("li", { textContent: said(text) }), { className: level }));
  byId("conditions").replaceChildren(...lines);
}

/** @param {Api.Notice[]} notices */
function showNotices(notices) {
  const newest = notices.slice(-NOTICES).reverse();
  const shown = newest.map(({ time, text }) => `${time} ${text}`).join();
  if (byId("notices").dataset.shown === shown) return; // who reads and scrolls is not disturbed
  byId("notices").dataset.shown = shown;
  const lines = newest.map(({ time, level, text }) => {
    const line = element("li", { className: "" });
    line.append(element("time", { textContent: written(time) }), element("span", { className: level, textContent: said(text, OWN_WORDS) }));
    return line;
  });
  byId("notices").replaceChildren(...lines);
}

function showEmpty(empty, status, { title, detail }) {
  byId("empty").hidden = !empty;
  if (!empty) return;
  const links = (status?.mavlink ?? []).map(linkLine);
  const watch = status?.watch ? [watchLine(status.watch)] : [];
  const lines = links.length || watch.length ? [...links, ...watch] : [`${title}: ${detail}`];
  byId("empty").querySelector("ul").replaceChildren(...lines.map((line) => element("li", { textContent: line })));
}

/** @param {Api.Link} link */
function linkLine({ address, state, last_heard: heard }) {
  if (heard) return t("MAVLink on {address}: heard {time} ago", { address, time: duration(ageOf(heard)) });
  return state === "failed" ? t("MAVLink on {address}: failed", { address }) : t("MAVLink on {address}: nothing heard yet", { address });
}

/** @param {Api.Watch} watch */
function watchLine({ folder, state, since }) {
  const words = {
    watching: t("Watching {folder}: no frame has come yet", { folder }),
    missing: t("The folder {folder} is missing", { folder }),
    connecting: t("Stream {folder}: not connected yet", { folder }),
    connected: t("Stream {folder}: connected, no frame was taken yet", { folder }),
    silent: t("Stream {folder}: silent for {time}", { folder, time: since ? duration(ageOf(since)) : t("some time") }),
    lost: t("Stream {folder}: lost, trying again", { folder }),
  };
  return words[state] ?? t("{folder} has ended", { folder });
}

/** Only touch what changes, or a screen reader would read it out each second. */
function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function frameCount(n) {
  return n === 1 ? t("1 frame") : t("{n} frames", { n });
}

function seenFrom(moment) {
  return t("What you see is from {time}.", { time: written(moment) });
}

function forTime(seconds) {
  return t("for {time}", { time: duration(seconds) });
}

function duration(seconds) {
  if (seconds < 120) return `${Math.round(seconds)} s`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`;
  return `${Math.round(seconds / 3600)} h`;
}
