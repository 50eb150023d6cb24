"""The documents of a flight against its ledger, read as other programs read them."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gcs_mosaic.check.findings import CheckedPart
from gcs_mosaic.render.render_list import Extent
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store import inside
from gcs_mosaic.store.documents import Document, iso_utc, write_json
from gcs_mosaic.store.journal import JOURNAL_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.listing import FrameNews, Listing
from gcs_mosaic.store.manifest import Contents, IslandEntry, Manifest
from gcs_mosaic.store.placements import WHOLE_NAME
from gcs_mosaic.store.reading import LARGEST_DOCUMENT, read_document
from gcs_mosaic.store.records import FrameState

MOSAIC_NAME, STATUS_NAME = "mosaic.json", "status.json"
LISTS = ("frames", "covered", "rejected", "waiting")
EDGE = 1e-6  # canvas units
LARGEST_ENTRY = 4000  # bytes that placements.json has for one frame: 500 as a rule

Extents = Mapping[int, Extent]


def check_documents(flight: Path, ledger: Ledger, extents: Extents, part: CheckedPart) -> None:
    """Add what the documents say otherwise than the ledger to `part`."""
    mosaic, status = _read(flight / MOSAIC_NAME, part), _read(flight / STATUS_NAME, part, may_miss=True)
    listed = _read_placements(flight, part, ledger.rows("SELECT count(*) FROM frames")[0][0])
    if mosaic is not None:
        _compare_accounts(MOSAIC_NAME, mosaic, ledger, part)
        _compare_islands(mosaic, ledger, extents, part)
    if status is not None:
        _compare_status(status, mosaic, ledger, part)
    if listed is not None and (told := _quietly_by_name(listed, part)) is not None:
        _compare_lists(told, _by_name(json.loads(_listing(ledger).text(0))), part)


def write_documents(flight: Path, ledger: Ledger, extents: Extents) -> None:
    """Write all documents anew, as the ledger has it; what only the flight knew (held-out errors) is taken from the old ones."""
    old, record = _quietly(flight / MOSAIC_NAME), ledger.flight()
    inside.remove(flight / JOURNAL_NAME, flight)
    manifest = Manifest(flight)
    manifest.write(
        Contents(
            flight=record.name if record else flight.resolve().name,
            updated_utc=time.time(),
            islands=_islands(old, ledger, extents),
            accounts=ledger.accounts(),
            frames=_news(ledger),
        ),
        everything=True,
    )
    manifest.close()
    if inside.exists(flight / STATUS_NAME, flight):
        _write_status(flight, ledger, manifest.revision)


def has_lost_the_map(flight: Path, ledger: Ledger) -> bool:
    """Whether the documents list frames on the map, and the ledger none."""
    told = _quietly(flight / MOSAIC_NAME).get("frames")
    return not ledger.accounts().frames.placed and isinstance(told, dict) and bool(told.get("placed"))


def _write_status(flight: Path, ledger: Ledger, revision: int) -> None:
    status = _quietly(flight / STATUS_NAME)
    if not status:
        inside.remove(flight / STATUS_NAME, flight)
        return
    now = {"state": "stopped", "updated": iso_utc(time.time()), "revision": revision, "frames_in_queue": 0}
    write_json(flight / STATUS_NAME, status | now | {"seconds_behind": 0.0} | _accounts(ledger))


def _read(
    path: Path, part: CheckedPart, *, may_miss: bool = False, most: int = LARGEST_DOCUMENT
) -> dict[str, Any] | None:
    part.checked += 1
    try:
        return read_document(path, most)
    except FileNotFoundError:
        part.checked -= 1
        if not may_miss:
            part.fault(path.name, "a document that is missing")
    except (OSError, ValueError):
        part.fault(path.name, "a document that cannot be read")
    return None


def _quietly(path: Path) -> dict[str, Any]:
    return _read(path, CheckedPart("", "")) or {}


def _read_placements(flight: Path, part: CheckedPart, frames: int) -> dict[str, Any] | None:
    """What placements.json says, with the lines of the journal that are newer."""
    document = _read(flight / WHOLE_NAME, part, most=LARGEST_DOCUMENT + LARGEST_ENTRY * frames)
    if document is None or not inside.exists(flight / JOURNAL_NAME, flight):
        return document
    part.checked += 1
    try:
        journal = inside.read(flight / JOURNAL_NAME, flight, LARGEST_DOCUMENT)
        head, *lines = map(json.loads, journal.split(b"\n")[:-1])
        if head["since"] > document["revision"]:
            part.fault(JOURNAL_NAME, "begins after the revision of placements.json")
        newer = [line for line in lines if line["revision"] > document["revision"]]
        for line in newer:
            document = _followed(document, line)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        part.fault(JOURNAL_NAME, "a document that cannot be read")
    return document


def _followed(document: dict[str, Any], line: dict[str, Any]) -> dict[str, Any]:
    """A document with what a line of the journal says of the same frames."""
    lenses = len(document["cameras"])
    told = {entry["name"]: (kind, entry) for kind in LISTS for entry in document[kind]}
    for kind in LISTS:
        for entry in line[kind]:
            told[entry["name"]] = kind, entry | ({"camera": entry["camera"] + lenses} if kind == "frames" else {})
    lists = {kind: [entry for of, entry in told.values() if of == kind] for kind in LISTS}
    return line | {"cameras": document["cameras"] + line["cameras"]} | lists


def _quietly_by_name(document: dict[str, Any], part: CheckedPart) -> dict[str, Document] | None:
    try:
        return _by_name(document)
    except (LookupError, TypeError, AttributeError, ValueError):
        part.fault(WHOLE_NAME, "a document that cannot be read")
        return None


def _by_name(document: dict[str, Any]) -> dict[str, Document]:
    """Each frame's entry with its list; that of a covered frame without what follows from its keyframe."""
    found = dict[str, Document]()
    for kind in LISTS:
        for entry in document.get(kind, ()):
            plain = {key: value for key, value in entry.items() if kind != "covered" or key in COVERED_KEYS}
            if kind == "frames":
                plain["camera"] = document["cameras"][entry["camera"]]
            found[entry["name"]] = {"list": kind, **plain}
    return found


COVERED_KEYS = ("name", "covered_by", "keyframe_from_frame", "width", "height")


def _compare_lists(told: dict[str, Document], known: dict[str, Document], part: CheckedPart) -> None:
    for name in sorted(told.keys() | known.keys()):
        if name not in known:
            part.fault(name, f"in {WHOLE_NAME}, but not in the ledger")
        elif name not in told:
            part.fault(name, f"in the ledger, but not yet in {WHOLE_NAME}")
        elif told[name] != known[name]:
            part.fault(name, f"elsewhere in {WHOLE_NAME} than in the ledger")


def _accounts(ledger: Ledger) -> Document:
    accounts = ledger.accounts()
    return {"events": asdict(accounts.events), "frames": asdict(accounts.frames), "orphans": accounts.orphans}


def _compare_accounts(name: str, document: dict[str, Any], ledger: Ledger, part: CheckedPart) -> None:
    known = _accounts(ledger)
    if {key: document.get(key) for key in known} != known:
        part.fault(name, "its counts of events and frames are not those of the ledger")


def _compare_status(status: dict[str, Any], mosaic: dict[str, Any] | None, ledger: Ledger, part: CheckedPart) -> None:
    if status.get("state") != "stopped":
        part.fault(
            STATUS_NAME,
            f"says {status.get('state')!r}, but nobody writes the flight: it was killed, or lost power",
        )
        return
    _compare_accounts(STATUS_NAME, status, ledger, part)
    if mosaic is not None and status.get("revision") != mosaic.get("revision"):
        part.fault(STATUS_NAME, f"of another revision than {MOSAIC_NAME}")


def _compare_islands(mosaic: dict[str, Any], ledger: Ledger, extents: Extents, part: CheckedPart) -> None:
    told = {entry["id"]: entry for entry in mosaic.get("islands", ()) if isinstance(entry, dict) and "id" in entry}
    merged = {island.id: island.merged_into for island in ledger.islands()}
    counts = _frames_on(ledger)
    for island, entry in told.items():
        if entry.get("merged_into") != merged.get(island) or entry.get("frames") != counts.get(island, 0):
            part.fault(f"island {island}", f"otherwise in {MOSAIC_NAME} than in the ledger")
    for island, extent in extents.items():
        if island not in told or not _is_extent(told[island], extent):
            part.fault(f"island {island}", f"its bounds in {MOSAIC_NAME} are not those of its frames")


def _is_extent(entry: dict[str, Any], extent: Extent) -> bool:
    levels = (entry.get("minzoom"), entry.get("maxzoom")) == (extent.coarsest, extent.finest)
    bounds = entry.get("bounds")
    if not levels or not isinstance(bounds, list) or len(bounds) != 4:
        return False
    return all(abs(said - known) < EDGE for said, known in zip(bounds, extent.box, strict=True))


def _frames_on(ledger: Ledger) -> dict[int, int]:
    rows = ledger.rows("SELECT island, count(*) FROM estimates GROUP BY island")
    return {row[0]: row[1] for row in rows}


def _islands(old: dict[str, Any], ledger: Ledger, extents: Extents) -> list[IslandEntry]:
    """All islands that have tiles; those that were merged as the old document has them."""
    before = {entry["id"]: entry for entry in old.get("islands", ()) if isinstance(entry, dict) and "id" in entry}
    counts, entries = _frames_on(ledger), list[IslandEntry]()
    for island in ledger.islands():
        extent, known = extents.get(island.id) or _extent_in(before.get(island.id)), before.get(island.id, {})
        if extent is not None:
            entries.append(
                IslandEntry(
                    id=island.id,
                    bounds=extent.box,
                    minzoom=extent.coarsest,
                    maxzoom=extent.finest,
                    frames=counts.get(island.id, 0),
                    merged_into=island.merged_into,
                    held_out=_held_out(known.get("held_out_px")),
                )
            )
    return entries


def _extent_in(entry: dict[str, Any] | None) -> Extent | None:
    try:
        left, top, right, bottom = (entry or {})["bounds"]
        return Extent((left, top, right, bottom), int(entry["minzoom"]), int(entry["maxzoom"])) if entry else None
    except (KeyError, TypeError, ValueError):
        return None


def _held_out(entry: Any) -> HeldOut | None:
    try:
        median, p95 = (float("inf") if entry[key] is None else float(entry[key]) for key in ("median", "p95"))
        return HeldOut(median, p95, int(entry["matches"]))
    except (KeyError, TypeError, ValueError):
        return None


def _news(ledger: Ledger) -> FrameNews:
    return FrameNews(
        estimates=ledger.estimates(),
        covered=ledger.covered(),
        rejected={frame.name: frame.reason or "" for frame in ledger.frames(FrameState.REJECTED)},
        waiting=[frame.name for frame in ledger.frames(FrameState.WAITING)],
        newest=ledger.newest_on_map(),
        newest_of=ledger.newest_of_aircraft(),
    )


def _listing(ledger: Ledger) -> Listing:
    listing = Listing()
    listing.tell(_news(ledger))
    return listing
