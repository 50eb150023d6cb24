"""Whether a flight's folder is whole: ledger, originals, tiles, documents, checkpoint; and its repair."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs_mosaic.check.documents import STATUS_NAME, check_documents, has_lost_the_map, write_documents
from gcs_mosaic.check.findings import CheckedPart, Findings, LostForGood, Progress
from gcs_mosaic.check.invariants import check_rows, settle_rows
from gcs_mosaic.check.notes import check_notes
from gcs_mosaic.check.originals import adopt_originals, check_originals, restore_originals, take_again
from gcs_mosaic.check.salvage import salvage
from gcs_mosaic.check.snapshot import ledger_copy
from gcs_mosaic.check.tiles import check_tiles, compare_tiles, painted_map, repair_tiles
from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.checkpoint import NAME as CHECKPOINT_NAME
from gcs_mosaic.store.checkpoint import VALUES_NAME, Checkpoints, Unusable
from gcs_mosaic.store.folder import LEDGER_NAME, find_flight, refuse_strange_parts, strange_in
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import FolderLock, is_locked, try_lock
from gcs_mosaic.store.reading import read_document
from gcs_mosaic.store.schema import VERSION, DamagedLedger

logger = logging.getLogger(__name__)


def check(flight: Path, progress: Progress, *, every_tile: bool = False) -> Findings:
    """Look at everything and change nothing. `every_tile`: paint each tile again and compare.

    Raises UsageError if there is no flight, or one of a newer version.
    """
    written = is_locked(find_flight(flight))
    ledger_part, originals = CheckedPart("ledger", "frames"), CheckedPart("originals", "files")
    tiles, documents = CheckedPart("tiles", "tiles"), CheckedPart("documents", "documents")
    checkpoint, strays = CheckedPart("checkpoint", "values"), CheckedPart("strays", "files")
    notes, keeps_documents = CheckedPart("notes", "notes"), False
    parts = (ledger_part, originals, tiles, documents, checkpoint, strays, notes)
    check_notes(flight, notes)
    with ledger_copy(flight, written=written) as opened:
        if isinstance(opened, DamagedLedger):
            ledger_part.fault(LEDGER_NAME, str(opened))
            return Findings(str(flight), parts)
        ledger, version = opened
        ledger_part.notes.append(f"version {version} of the schema{'' if version == VERSION else f', now {VERSION}'}")
        check_rows(ledger, ledger_part)
        check_originals(flight, ledger, originals, progress)
        if written:
            ledger_part.notes.append(
                "the flight is being written: tiles, documents and checkpoint are left for afterwards"
            )
        elif not ledger_part.faults:
            shown = painted_map(flight, ledger, originals.subjects)
            check_tiles(shown, tiles, progress)
            if every_tile:
                compare_tiles(shown, tiles, progress)
            else:
                tiles.notes.append("not painted again: --tiles compares each with ledger and originals")
            check_documents(flight, ledger, shown.layout.extents, documents)
            keeps_documents = has_lost_the_map(flight, ledger)
        if not written:
            check_checkpoint(flight, ledger, checkpoint)
            check_strays(flight, strays)
    return Findings(str(flight), parts, keeps_documents=keeps_documents)


def repair(flight: Path, progress: Progress, sources: Sequence[Path] = ()) -> Findings:
    """Make anew what can be made; returns what is then found, and what was done. Raises UsageError as `check`, and if another
    program writes the flight.

    `sources`: folders in which damaged originals are sought, beside those that the flight has watched.
    """
    refuse_strange_parts(find_flight(flight))
    lock, lost = _locked(flight), LostForGood()
    try:
        done = list(_repaired(flight, progress, [*sources, *_watched(flight)], lost))
    finally:
        lock.release()
    return replace(check(flight, progress, every_tile=True), repaired=done, lost=lost)


def check_checkpoint(flight: Path, ledger: Ledger, part: CheckedPart) -> None:
    """Add a checkpoint that cannot be gone on from to `part`."""
    if not inside.exists(flight / CHECKPOINT_NAME, flight):
        part.notes.append("there is none: the flight cannot be gone on with")
        return
    with closing(Checkpoints(flight, read_only=True)) as checkpoints:
        saved = checkpoints.load()
    if isinstance(saved, Unusable) and saved.of_another_version:
        part.notes.append(f"{saved.reason}: to go on with the flight is to stitch its frames again")
        return
    part.checked = 1
    if isinstance(saved, Unusable):
        there = inside.is_file(flight / VALUES_NAME, flight)
        part.fault(CHECKPOINT_NAME, saved.reason if there else f"{VALUES_NAME}, to which it refers, is missing")
        return
    known, processed = {frame.name for frame in ledger.frames()}, _processed(saved)
    if processed is None:
        part.fault(CHECKPOINT_NAME, "its checkpoint is none of ours")
        return
    ahead = sum(name not in known for name in processed)
    if ahead:
        part.fault(CHECKPOINT_NAME, f"{ahead} of its frames are not in the ledger")


def check_strays(flight: Path, part: CheckedPart) -> None:
    """Add files that were being written when the program was killed to `part`."""
    for path in _unfinished(flight):
        part.checked += 1
        part.fault(path.relative_to(flight).as_posix(), "a file that was never finished")
    for path in strange_in(flight):
        part.checked += 1
        part.fault(path.relative_to(flight).as_posix(), "a link or a device, which is not followed")


def _repaired(flight: Path, progress: Progress, sources: Sequence[Path], lost: LostForGood) -> Iterator[str]:
    """What is done, step by step."""
    for path in list(_unfinished(flight)):
        inside.remove(path, flight)
        yield f"{path.relative_to(flight)} was removed: it was never finished"
    with ledger_copy(flight, written=False) as opened:
        is_lost = isinstance(opened, DamagedLedger)
        version = VERSION if isinstance(opened, DamagedLedger) else opened[1]
    if is_lost:
        salvaged = salvage(flight)
        lost.unread = salvaged.unread
        yield salvaged.said
    if version != VERSION:
        yield f"the ledger was brought from version {version} of the schema to {VERSION}"
    with Ledger(flight / LEDGER_NAME) as ledger:
        if is_lost and (adopted := adopt_originals(flight, ledger)):
            yield f"originals that the ledger has lost were recorded as frames still to be placed ({adopted})"
        yield from _settled(flight, ledger, progress, sources, lost.originals)
        yield from _checkpoint_set_aside(flight, ledger)
        damaged = CheckedPart("originals", "files")
        check_originals(flight, ledger, damaged, progress)
        shown = painted_map(flight, ledger, damaged.subjects)
        yield from repair_tiles(shown, progress, lost)
        yield from _documents(flight, ledger, shown.layout.extents)
        ledger.make_durable()


def _settled(
    flight: Path, ledger: Ledger, progress: Progress, sources: Sequence[Path], lost: list[str]
) -> Iterator[str]:
    """Rows and originals."""
    rows, originals = CheckedPart("ledger", "frames"), CheckedPart("originals", "files")
    check_rows(ledger, rows)
    if rows.faults:
        started_utc = min((frame.modified for frame in ledger.frames() if frame.modified), default=0.0)
        settle_rows(ledger, flight.resolve().name, started_utc)
        yield f"contradictions of the ledger were settled ({len(rows.faults)}): frames in doubt are pending again"
    check_originals(flight, ledger, originals, progress)
    yield from take_again(flight, ledger, list(sources))
    yield from restore_originals(flight, ledger, originals.subjects, list(sources), lost)


def _checkpoint_set_aside(flight: Path, ledger: Ledger) -> Iterator[str]:
    part = CheckedPart("checkpoint", "values")
    check_checkpoint(flight, ledger, part)
    if part.faults:
        path = flight / CHECKPOINT_NAME
        inside.move(path, path.with_name(f"{CHECKPOINT_NAME}.damaged"), flight)
        yield f"the checkpoint was set aside ({part.faults[0].text}): the flight cannot be gone on with"


def _documents(flight: Path, ledger: Ledger, extents: Any) -> Iterator[str]:
    part = CheckedPart("documents", "documents")
    check_documents(flight, ledger, extents, part)
    if part.faults and has_lost_the_map(flight, ledger):
        yield "the documents stay as they are: they tell more of the map than is left of the ledger"
    elif part.faults:
        write_documents(flight, ledger, extents)
        yield "the documents were written anew"


def _locked(flight: Path) -> FolderLock:
    try:
        lock = try_lock(flight)
    except OSError as error:
        raise UsageError(
            f"--repair: {flight} cannot be written ({error.strerror}): make it writable, or copy it"
        ) from error
    if lock is None:
        raise UsageError(f"--repair: {flight} is being written by another gcs-mosaic: end that one first")
    return lock


def _watched(flight: Path) -> list[Path]:
    """The folder that the flight watched, or that of each of its aircraft, by its status."""
    try:
        status = read_document(flight / STATUS_NAME)
        watched = [status["watch"], *(one["watch"] for one in status.get("aircraft", ()))]
        folders = [Path(one["folder"]) for one in watched if one is not None and one["kind"] == "folder"]
        return [folder for folder in dict.fromkeys(folders) if folder.is_dir()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        logger.debug("the status does not tell which folder was watched", exc_info=True)
        return []


def _processed(saved: Any) -> list[str] | None:
    """Names of the frames that a checkpoint has processed; None if it is that of no flight."""
    pipeline = saved.get("pipeline") if isinstance(saved, dict) else None
    names = pipeline.get("_processed") if isinstance(pipeline, dict) else None
    if not isinstance(names, Iterable) or isinstance(names, str | bytes):
        return None
    told = list(names)
    return told if all(isinstance(name, str) for name in told) else None


def _unfinished(flight: Path) -> Iterator[Path]:
    """Files beside which another was to be put in place, see `write_beside`."""
    for path in inside.files(flight, flight):
        if path.name.startswith(".") and path.name.endswith(".part"):
            yield path
