"""hints.sqlite: what was found, and in which frames was sought. Nothing in it is lost with it: all of it can be sought again."""

from __future__ import annotations

import json
import logging
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.other_looks import UNJUDGED, Verdict
from gcs_mosaic.hints.rarity import SIDES, STEPS, FlightRarity
from gcs_mosaic.store.folder import HINTS_NAME, LEDGER_NAME
from gcs_mosaic.store.ledger_file import flight_at
from gcs_mosaic.store.schema import FileSchema, connect, connect_for_reading

logger = logging.getLogger(__name__)

VERSION = 1
APPLICATION = 0x67637368  # PRAGMA application_id, "gcsh"
TABLES = """
CREATE TABLE flight ( -- whose hints these are
    id INTEGER PRIMARY KEY CHECK (id = 1),
    name TEXT NOT NULL,
    file TEXT NOT NULL -- at random: tells these hints from those of a file that was lost
);
CREATE TABLE rarity (id INTEGER PRIMARY KEY CHECK (id = 1), colours BLOB NOT NULL, contrasts BLOB NOT NULL);
CREATE TABLE searched (
    frame INTEGER PRIMARY KEY, -- number in the ledger
    content_hash TEXT,
    colours TEXT NOT NULL, -- picked colours that were sought in it, JSON list of numbers
    reason TEXT, -- why it could not be searched
    utc NOT NULL, took_s NOT NULL
);
CREATE TABLE hints (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    kind TEXT NOT NULL CHECK (kind IN ('odd', 'sought', 'detector')),
    what INTEGER NOT NULL, -- number of the picked colour, or the detector's class
    frame INTEGER NOT NULL, -- where it is seen best
    x NOT NULL, y NOT NULL, width NOT NULL, height NOT NULL, -- middle and size, pixels of the original
    lightness INTEGER NOT NULL, red INTEGER NOT NULL, yellow INTEGER NOT NULL, -- L*a*b* of 8 bits
    contrast NOT NULL,
    score NOT NULL, -- likeness or confidence, 0 to 1
    looks INTEGER NOT NULL, shown INTEGER NOT NULL, -- other looks at the place, and how many of them show it
    seen INTEGER NOT NULL, -- frames in which it was found
    utc NOT NULL -- when it was found first
);
CREATE INDEX hints_by_frame ON hints (frame);
"""
HINTS = FileSchema(
    APPLICATION,
    VERSION,
    TABLES,
    {},
    modes="PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL;",
    noun="hints",
    kind="a file of hints",
    remedy="move it away",
)
BEGUN = "The search in it was not ended."
BEGUN_TWICE = "The search in it was twice not ended."
Kind = Literal["odd", "sought", "detector"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundThing:
    """Something in a frame: middle and size in pixels of the original."""

    kind: Kind
    what: int = 0
    frame: int
    x: float
    y: float
    width: float
    height: float
    lab: tuple[int, int, int] = (0, 0, 0)
    contrast: float = 0.0
    score: float = 0.0
    verdict: Verdict = UNJUDGED
    seen: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownHint:
    """Something that was found; `utc`: first, in seconds since 1970."""

    id: int
    found: FoundThing
    utc: float


class HintFile:
    """Use it only from the thread that opened it. Raises what sqlite3 raises, UsageError, and DiskFull."""

    def __init__(self, root: Path) -> None:
        """The file in a flight's folder; another flight's hints in it are removed."""
        self._file = connect(root / HINTS_NAME, HINTS)
        self._belong_to(_flight_in(root))

    def close(self) -> None:
        self._file.close()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        with self._file:
            self._file.execute("BEGIN IMMEDIATE")
            yield

    def searched(self) -> dict[int, frozenset[int]]:
        """The frames that were searched, or begun twice and not ended, and for which colours."""
        rows = self._file.execute("SELECT frame, colours FROM searched WHERE reason IS NOT ?", (BEGUN,))
        return {row["frame"]: frozenset(json.loads(row["colours"])) for row in rows}

    def note_begun(self, frame: int) -> None:
        """Before it is searched: a frame that ends the program twice is not begun again."""
        again = self._file.execute("SELECT 1 FROM searched WHERE frame = ? AND reason = ?", (frame, BEGUN)).fetchone()
        self._note(frame, None, (), BEGUN_TWICE if again else BEGUN, 0.0)

    def forget_begun(self, frame: int) -> None:
        """It can be searched later, as if it had not been begun."""
        self._file.execute("DELETE FROM searched WHERE frame = ?", (frame,))

    def note_searched(self, frame: int, content_hash: str | None, colours: Iterable[int], took_s: float) -> None:
        self._note(frame, content_hash, colours, None, took_s)

    def note_failed(self, frame: int, colours: Iterable[int], reason: str) -> None:
        self._note(frame, None, colours, reason, 0.0)

    def _note(
        self, frame: int, content_hash: str | None, colours: Iterable[int], reason: str | None, took_s: float
    ) -> None:
        values = frame, content_hash, json.dumps(sorted(colours)), reason, time.time(), took_s
        self._file.execute("INSERT OR REPLACE INTO searched VALUES (?, ?, ?, ?, ?, ?)", values)

    def rarity(self) -> FlightRarity:
        return _rarity_in(self._file)

    def keep_rarity(self, rarity: FlightRarity) -> None:
        values = rarity.colours.tobytes(), rarity.contrasts.tobytes()
        self._file.execute("INSERT OR REPLACE INTO rarity VALUES (1, ?, ?)", values)

    def of_frames(self, frames: Sequence[int]) -> list[KnownHint]:
        """The hints that are seen best in one of these."""
        several = ",".join("?" * len(frames))
        rows = self._file.execute(f"SELECT * FROM hints WHERE frame IN ({several}) ORDER BY id", tuple(frames))
        return [_known(row) for row in rows]

    def add(self, found: FoundThing) -> int:
        """A new hint; its id."""
        columns = _columns(found)
        names = ", ".join((*columns, "utc"))
        marks = ", ".join("?" * (len(columns) + 1))
        made = self._file.execute(f"INSERT INTO hints ({names}) VALUES ({marks})", (*columns.values(), time.time()))
        return made.lastrowid or 0

    def replace(self, number: int, found: FoundThing) -> None:
        columns = _columns(found)
        pairs = ", ".join(f"{name} = ?" for name in columns)
        self._file.execute(f"UPDATE hints SET {pairs} WHERE id = ?", (*columns.values(), number))

    def forget(self, hints: Iterable[int]) -> None:
        self._file.executemany("DELETE FROM hints WHERE id = ?", [(one,) for one in hints])

    def all_odd(self) -> list[KnownHint]:
        return [_known(row) for row in self._file.execute("SELECT * FROM hints WHERE kind = 'odd' ORDER BY id")]

    def forget_colours(self, known: Iterable[int]) -> None:
        """Remove what was found of colours that nobody seeks any more."""
        several = list(known)
        marks = ",".join("?" * len(several))
        self._file.execute(f"DELETE FROM hints WHERE kind = 'sought' AND what NOT IN ({marks})", several)

    def _belong_to(self, flight: str) -> None:
        row = self._file.execute("SELECT name FROM flight").fetchone()
        if row is not None and row["name"] == flight:
            return
        with self.transaction():
            for table in ("hints", "searched", "rarity", "flight"):
                self._file.execute(f"DELETE FROM {table}")
            self._file.execute("INSERT INTO flight VALUES (1, ?, lower(hex(randomblob(4))))", (flight,))


@dataclass(frozen=True, slots=True)
class HintsRead:
    """What a file of hints tells whoever shows it."""

    hints: Sequence[KnownHint] = ()
    rarity: FlightRarity | None = None
    searched: int = 0  # frames
    failed: int = 0
    file: str = ""  # tells these hints from those of a file that was lost

    def key(self, hint: KnownHint) -> str:
        """By which people dismiss it."""
        return f"{self.file}.{hint.id}"


def read_hints(root: Path) -> HintsRead:
    """The hints of the flight in a folder; none where there is no file, or only another flight's."""
    try:
        with closing(connect_for_reading(root / HINTS_NAME, HINTS)) as file:
            row = file.execute("SELECT name, file FROM flight").fetchone()
            if row is None or row["name"] != _flight_in(root):
                return HintsRead()
            hints = [_known(one) for one in file.execute("SELECT * FROM hints ORDER BY id")]
            searched, failed = file.execute("SELECT count(*), count(reason) FROM searched").fetchone()
            return HintsRead(hints, _rarity_in(file), searched - failed, failed, row["file"])
    except (UsageError, sqlite3.Error):
        logger.info("no hints can be read", exc_info=True)
        return HintsRead()


def _flight_in(root: Path) -> str:
    return repr(flight_at(root / LEDGER_NAME))


def _rarity_in(file: sqlite3.Connection) -> FlightRarity:
    rarity = FlightRarity()
    row = file.execute("SELECT colours, contrasts FROM rarity").fetchone()
    if row is not None:
        colours, contrasts = (np.frombuffer(row[name], np.float64).copy() for name in ("colours", "contrasts"))
        if colours.size == np.prod(SIDES) and contrasts.size == STEPS + 1:
            rarity.colours, rarity.contrasts = colours.reshape(SIDES), contrasts
    return rarity


def _columns(found: FoundThing) -> Mapping[str, object]:
    return {
        "kind": found.kind,
        "what": found.what,
        "frame": found.frame,
        "x": float(found.x),
        "y": float(found.y),
        "width": float(found.width),
        "height": float(found.height),
        "lightness": int(found.lab[0]),
        "red": int(found.lab[1]),
        "yellow": int(found.lab[2]),
        "contrast": float(found.contrast),
        "score": float(found.score),
        "looks": found.verdict.looks,
        "shown": found.verdict.shown,
        "seen": found.seen,
    }


def _known(row: sqlite3.Row) -> KnownHint:
    found = FoundThing(
        kind=row["kind"],
        what=row["what"],
        frame=row["frame"],
        x=row["x"],
        y=row["y"],
        width=row["width"],
        height=row["height"],
        lab=(row["lightness"], row["red"], row["yellow"]),
        contrast=row["contrast"],
        score=row["score"],
        verdict=Verdict(row["looks"], row["shown"]),
        seen=row["seen"],
    )
    return KnownHint(id=row["id"], found=found, utc=row["utc"])
