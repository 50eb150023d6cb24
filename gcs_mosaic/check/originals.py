"""The originals of a flight against the ledger, by their hashes; a damaged one is sought among the camera's files."""

from __future__ import annotations

import logging
from collections import defaultdict
from itertools import islice
from pathlib import Path

from gcs_mosaic.check.findings import CheckedPart, Progress
from gcs_mosaic.messages import content_hash
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import make_folder, write_beside
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.originals import place_of, read_intact, relative_place
from gcs_mosaic.store.records import FrameRecord, FrameState

logger = logging.getLogger(__name__)

MOST_SOUGHT = 500_000  # files of a folder in which originals are sought; a stranger's status may name any
ON_THE_MAP = (FrameState.PLACED, FrameState.COVERED)
UNDECIDED = (FrameState.PENDING, FrameState.WAITING)  # without its original such a frame can never be placed


def check_originals(flight: Path, ledger: Ledger, part: CheckedPart, progress: Progress) -> None:
    """Add each frame whose original is not what came to `part`."""
    frames = ledger.frames()
    for number, frame in enumerate(frames):
        progress("originals", number, len(frames))
        if frame.original is not None:
            part.checked += 1
            if problem := _problem(flight, frame):
                part.fault(frame.name, problem)
        elif frame.state in UNDECIDED:
            part.notes.append(f"{frame.name} is {frame.state}, and its original is not kept")
    known = {frame.original for frame in frames}
    strangers = [
        path for path in inside.files(flight / "frames", flight) if path.relative_to(flight).as_posix() not in known
    ]
    if strangers:
        part.notes.append(f"{len(strangers)} files in frames/ are of no frame of the ledger: they are left as they are")


def restore_originals(
    flight: Path, ledger: Ledger, damaged: set[str], sources: list[Path], lost: list[str]
) -> list[str]:
    """Take damaged originals from the camera's files, and record those that are lost as not kept; returns what was done. Names of
    frames whose original is lost are added to `lost`."""
    frames = [frame for frame in ledger.frames() if frame.name in damaged and frame.content_hash is not None]
    files = _by_size(sources) if frames else {}
    return [_restored(flight, ledger, frame, files.get(frame.size or 0, []), lost) for frame in frames]


def take_again(flight: Path, ledger: Ledger, sources: list[Path]) -> list[str]:
    """Take originals of what is on the map, which a repair has recorded as not kept, from the camera's files; returns what
    was done. Of a flight that keeps none, none is taken."""
    frames = ledger.frames()
    lost = [frame for frame in frames if frame.original is None and frame.state in ON_THE_MAP and frame.content_hash]
    if not lost or all(frame.original is None for frame in frames):
        return []
    files = _by_size(sources)
    said = (_taken(flight, ledger, frame, files.get(frame.size or 0, [])) for frame in lost)
    return [text for text in said if text]


def adopt_originals(flight: Path, ledger: Ledger) -> int:
    """Record the originals that the ledger does not know as frames still to be placed; returns how many."""
    frames = ledger.frames()
    known, names = {frame.original for frame in frames}, {frame.name for frame in frames}
    adopted = 0
    for path in inside.files(flight / "frames", flight):
        place = path.relative_to(flight).as_posix()
        name = place.removeprefix("frames/")
        if place in known or name in names or path.name.startswith("."):
            continue
        try:
            data, status = inside.read(path, flight), inside.status(path, flight)
        except OSError:
            logger.warning("%s cannot be read", path, exc_info=True)
            continue
        modified = status.st_mtime if status is not None else 0.0
        row = name, content_hash(data), len(data), modified, place
        ledger.write(
            "INSERT INTO frames (name, content_hash, size, modified, received, original) VALUES (?, ?, ?, ?, 0.0, ?)",
            *row,
        )
        adopted += 1
    return adopted


def _problem(flight: Path, frame: FrameRecord) -> str | None:
    path = place_of(flight, frame.original or "")
    if path is None:
        return "its original is said to lie outside the folder"
    try:
        data = inside.read(path, flight)
    except FileNotFoundError:
        return "its original is missing"
    except OSError as error:
        return f"its original cannot be read ({error.strerror})"
    return None if content_hash(data) == frame.content_hash else "its original is not what came"


def _restored(flight: Path, ledger: Ledger, frame: FrameRecord, files: list[Path], lost: list[str]) -> str:
    if taken := _taken(flight, ledger, frame, files):
        return taken
    lost.append(frame.name)
    aside = _set_aside(_kept_at(flight, frame), flight)
    ledger.write(
        "UPDATE frames SET original = NULL WHERE id = (SELECT id FROM frames WHERE original = ?)", frame.original
    )
    if frame.state in UNDECIDED:
        ledger.settle_frame(frame.name, FrameState.DAMAGED, "its original was damaged on the disk")
    return f"{frame.name}: its original is lost, and recorded as not kept{aside}; what the map shows of it stays"


def _kept_at(flight: Path, frame: FrameRecord) -> Path:
    return place_of(flight, frame.original or "") or flight / relative_place(frame.name)


def _taken(flight: Path, ledger: Ledger, frame: FrameRecord, files: list[Path]) -> str:
    """What was done; empty if none of the files is its original."""
    found = next((data for file in files if (data := _whole(file, frame.content_hash)) is not None), None)
    if found is None:
        return ""
    path = _kept_at(flight, frame)
    make_folder(path.parent, flight, durable=True)
    write_beside(path, found, durable=True, root=flight)
    ledger.record_original(frame.name, path.relative_to(flight).as_posix())
    return f"{frame.name}: its original was taken from the camera's files again"


def _set_aside(path: Path, flight: Path) -> str:
    if not inside.is_file(path, flight):
        return ""
    aside = path.with_name(f"{path.name}.damaged")
    inside.move(path, aside, flight)
    return f" (the damaged file is {aside.name})"


def _whole(path: Path, expected_hash: str | None) -> bytes | None:
    return None if expected_hash is None else read_intact(path, expected_hash)


def _by_size(folders: list[Path]) -> dict[int, list[Path]]:
    found = defaultdict[int, list[Path]](list)
    for folder in folders:
        for path in islice(inside.files(folder, folder), MOST_SOUGHT):
            if (status := inside.status(path, folder)) is not None:
                found[status.st_size].append(path)
    return found
