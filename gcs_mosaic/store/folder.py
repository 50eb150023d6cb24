"""Selects the output folder: a new flight never touches an old one."""

from __future__ import annotations

import math
import sqlite3
import stat
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.foreign_file import COMPANIONS
from gcs_mosaic.store.lock import LOCK_NAME, FolderLock, try_lock
from gcs_mosaic.store.schema import DamagedLedger, connect_for_reading

LEDGER_NAME = "flight.sqlite"
RECORDING_NAME = "flight.tlog"
LOG_NAME = "flight.log"
TOKEN_NAME = "page.token"  # lets other machines look at the page
NOTES_NAME = "notes.sqlite"  # what people add to the flight, see the room `notes`
HINTS_NAME = "hints.sqlite"  # what may be worth a look, see the room `hints`
PAIRING_NAME = "pairing.json"  # the pairs of triggers and pictures found in flight, where others were chosen
PROGRESS_NAME = "progress.json"  # of a command that ends by itself
OUR_NAMES = (
    *(LEDGER_NAME, "mosaic.json", "placements.json", "placements.jsonl", "status.json", RECORDING_NAME, LOG_NAME),
    *("checkpoint", "checkpoint.values", TOKEN_NAME, NOTES_NAME, HINTS_NAME, PAIRING_NAME),
    PROGRESS_NAME,
    *("tiles", "masks", "frames"),
)
ARTEFACTS = "archive"  # folder in which `reprocess` keeps what it has found
BESIDE_OURS = tuple(f"{name}{end}" for name in (LEDGER_NAME, NOTES_NAME, HINTS_NAME) for end in COMPANIONS[1:])
# All that we ever write into a flight's folder.
WRITTEN_NAMES = (*OUR_NAMES, *BESIDE_OURS, ARTEFACTS, LOCK_NAME)
# What a start writes before its flight has begun, which may take half a minute on a busy machine.
BEFORE_A_FLIGHT = (LEDGER_NAME, LOG_NAME, RECORDING_NAME, TOKEN_NAME, NOTES_NAME, HINTS_NAME, PROGRESS_NAME)
FIRST_ROWS = ("flight", "frames", "events")  # tables of which a flight that has begun has rows
LONGEST_LINE = 1000  # bytes
LONGEST_PATH = 480  # bytes: SQLite takes 512 with its file's name, the ending of its journal, and a flight's number
MOST_FLIGHTS = 1000  # numbered folders; more suggests a runaway script


class BeingWritten(UsageError):  # noqa: N818 - names a state, not an error
    """Another gcs-mosaic writes the flight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightFolder:
    """A folder locked for our writing until `close`; `said` is the sentence for the operator."""

    path: Path
    said: str
    lock: FolderLock
    existed: bool = True
    resumed: bool = False  # it holds a flight to resume

    def close(self) -> None:
        """Release the lock; the folder of a flight that never began is removed."""
        if not (self.path / LEDGER_NAME).exists():
            with suppress(OSError):
                inside.remove(self.path / TOKEN_NAME, self.path)
                inside.remove(self.path / LOCK_NAME, self.path)
                if not self.existed:
                    self.path.rmdir()
        self.lock.release()


def open_flight_folder(out: Path) -> FlightFolder:
    """Make and lock `out` or, if that is taken, the first free one of `out-2`, `out-3`, …

    Raises UsageError if no such folder can be made or written.
    """
    refuse_unusable(out)
    taken: str | None = None
    for path in candidates(out):
        existed = path.exists()
        lock, obstacle = take(path)
        if lock is not None:
            said = f"{taken}; this flight is written to {path}" if taken else spoken(path, existed)
            return FlightFolder(path=path, said=said, lock=lock, existed=existed)
        taken = taken or obstacle
    raise UsageError(f"{out} and {MOST_FLIGHTS} folders beside it hold flights already: choose another --out")


def refuse_unusable(out: Path) -> None:
    """Raises UsageError for a path that no ledger can have, and for one that is no folder."""
    try:
        size = len(str(out.absolute()).encode())
        is_something_else = not out.is_dir() and (out.is_symlink() or out.exists())
    except UnicodeEncodeError as error:
        raise UsageError(f"the name of --out {str(out)!r} is not UTF-8: choose another --out") from error
    except OSError as error:
        raise UsageError(f"{out} cannot be written ({error.strerror}): choose another --out") from error
    if size > LONGEST_PATH:
        text = f"the path of --out is {size} bytes long, and the ledger in it can have {LONGEST_PATH}"
        raise UsageError(f"{text}: choose a shorter --out")
    if is_something_else:
        raise UsageError(f"{out} is not a folder: choose another --out")


def resume_flight_folder(out: Path) -> FlightFolder:
    """Lock the most recently written flight of `out`, `out-2`, `out-3`, …; there may be gaps in the numbering.

    Raises UsageError if there is none, if its ledger is of a newer version or damaged (DamagedLedger), or if it is being written
    (BeingWritten).
    """
    flights = flights_of(out)
    if not flights:
        raise UsageError(f"--resume: {out} holds no flight to go on with: start without --resume, or name its --out")
    return lock_flight(flights[0])


def lock_flight(path: Path) -> FlightFolder:
    """The folder of a flight to resume. Raises UsageError if it cannot be written, or if its ledger is of a newer version or
    damaged (DamagedLedger), and BeingWritten."""
    connect_for_reading(path / LEDGER_NAME).close()
    try:
        lock = try_lock(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written ({error.strerror}): choose another --out") from error
    if lock is None:
        raise BeingWritten(f"{path} is being written by another gcs-mosaic: end that one first")
    try:
        refuse_strange_parts(path)
        refuse_damaged_ledger(path / LEDGER_NAME)
    except UsageError:
        lock.release()
        raise
    return FlightFolder(path=path, said=f"going on with the flight in {path}", lock=lock, resumed=True)


def refuse_damaged_ledger(path: Path) -> None:
    """Read the whole file before anything is written to it. Raises DamagedLedger for what it holds, and not for a disk that
    cannot be read now, or another program that has locked it: who opens it finds that."""
    try:
        with closing(connect_for_reading(path)) as opened:
            found = str(opened.execute("PRAGMA quick_check(1)").fetchone()[0])
    except sqlite3.OperationalError:
        return
    except sqlite3.DatabaseError as error:
        raise DamagedLedger(f"{path} is damaged ({error})") from error
    if found != "ok":
        raise DamagedLedger(f"{path} is damaged ({' '.join(found.split())})")


def flights_of(out: Path, since_utc: float = -math.inf) -> list[Path]:
    """The flights in `out` and its numbered siblings that were written since then (seconds since 1970), the newest first.

    A flight of the future is a recent one: a machine without a battery for its clock starts in the past.
    """
    there = (path for path in candidates(out) if inside.is_file(path / LEDGER_NAME, path) and not is_unbegun(path))
    held = {path: written_ns(path) / 1e9 for path in there}
    return sorted((path for path in held if held[path] >= since_utc), key=lambda path: -held[path])


def written_ns(path: Path) -> int:
    """Modification time of a flight's ledger, its write-ahead log included unless empty: a reader leaves an empty one."""
    files = [path / LEDGER_NAME, path / f"{LEDGER_NAME}-wal"]
    stats = [file.stat() for file in files if file.exists()]
    return max(stat.st_mtime_ns for stat in stats if stat.st_size or len(stats) == 1)


def find_flight(path: Path) -> Path:
    """`path` if it holds a readable flight. Raises UsageError."""
    if (path / LEDGER_NAME).is_file() or (path / "mosaic.json").is_file():
        return path
    what = "holds no flight" if path.is_dir() else "is not a folder" if path.exists() else "does not exist"
    raise UsageError(f"{path} {what}: name a folder that gcs-mosaic has written a flight into")


def strange_in(flight: Path) -> Iterator[Path]:
    """What lies under our names and is neither a file nor a folder: links and devices, which nobody of us makes or follows."""
    for name in dict.fromkeys(WRITTEN_NAMES):
        path = flight / name
        found = inside.status(path, flight)
        if found is not None and stat.S_ISDIR(found.st_mode):
            yield from (below for below, entry in inside.entries(path, flight) if not inside.is_plain(entry))
        elif found is not None and not stat.S_ISREG(found.st_mode):
            yield path


def refuse_strange_parts(flight: Path) -> None:
    """Raises UsageError if the folder holds what `strange_in` finds: whoever writes there must not reach elsewhere."""
    for path in strange_in(flight):
        text = f"{str(path.relative_to(flight))!r} is a link or a device, which no flight's folder has, and which is not followed"
        raise UsageError(f"{flight}: {text}: put what it leads to in its place, or take it away")


def refuse_watching_ourselves(watched: Path, out: Path) -> None:
    """Raises UsageError if images we write would appear in the watched folder and become frames."""
    try:
        is_flight = (watched / LEDGER_NAME).exists()
    except OSError as error:
        raise UsageError(f"{watched} cannot be watched ({error.strerror}): give another folder") from error
    if is_flight:
        raise UsageError(
            f"{watched} holds a flight that gcs-mosaic has written: watch the folder that the camera fills"
        )
    inner, outer = watched.resolve(), out.resolve()
    ours = any(inner.is_relative_to(outer / name) for name in OUR_NAMES)
    if inner == outer or ours or outer.is_relative_to(inner):
        raise UsageError(
            f"the output folder {out} and the watched folder {watched} overlap, so the map's own pictures "
            "would be taken for frames: choose an --out outside the watched folder"
        )


def candidates(out: Path) -> Iterator[Path]:
    """`out`, then its numbered siblings."""
    yield out
    whole = out.resolve()  # so that "." has a name to append a number to
    beside = whole.parent if not out.name else out.parent
    for number in range(2, MOST_FLIGHTS + 2):
        yield beside / f"{whole.name}-{number}"


def take(path: Path) -> tuple[FolderLock | None, str]:
    """Make and lock one folder; or None and the reason it is taken. Raises UsageError if it cannot be written."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        if obstacle := occupied(path):
            return None, obstacle
        lock = try_lock(path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written ({error.strerror}): choose another --out") from error
    if lock is None:
        return None, f"{path} is being written by another gcs-mosaic"
    if obstacle := occupied(path):  # another program may have used it while we waited for the lock
        lock.release()
        return None, obstacle
    return lock, ""


def occupied(path: Path) -> str:
    """Which of our files the folder already holds, as a sentence; empty if none."""
    there = [name for name in OUR_NAMES if inside.exists(path / name, path)]
    if "mosaic.json" in there or (LEDGER_NAME in there and not is_unbegun(path, FIRST_ROWS[1:])):
        return f"{path} holds an earlier flight, which is left as it is"
    begun = _was_begun_by_us(path)
    strange = next((name for name in there if not (begun and name in BEFORE_A_FLIGHT)), None)
    if strange and LEDGER_NAME in there and not is_unbegun(path):
        return f"{path} holds an earlier flight, which is left as it is"
    return f"{path} has its own {strange}, which is left as it is" if strange else ""


def is_unbegun(path: Path, rows: Sequence[str] = FIRST_ROWS) -> bool:
    """Whether the ledger there is of a flight that was ended before it began: empty, or without rows in these tables."""
    ledger = path / LEDGER_NAME
    found = inside.status(ledger, path)
    if found is None or not stat.S_ISREG(found.st_mode):
        return False
    if not found.st_size:
        return True
    try:
        with closing(connect_for_reading(ledger)) as opened:
            return not any(opened.execute(f"SELECT 1 FROM {table} LIMIT 1").fetchone() for table in rows)
    except (UsageError, sqlite3.Error):
        return False


def _was_begun_by_us(path: Path) -> bool:
    """Whether a start of ours was killed here: its lock is left, or its log, or an empty ledger."""
    if inside.is_file(path / LOCK_NAME, path) or is_unbegun(path, FIRST_ROWS[1:]):
        return True
    try:
        with inside.reading(path / LOG_NAME, path) as log:
            return b"gcs_mosaic" in log.readline(LONGEST_LINE)
    except OSError:
        return False


def spoken(path: Path, existed: bool) -> str:
    return f"this flight is written to {path}" if existed else f"{path} was created; this flight is written to it"
