"""Which ground was looked at, at which zoom, for how long, by whom, and when: in cells of a fixed grid.

Cells are those of the canvas when it was looked at, and are not carried along when islands join: ground that may not have been
looked at counts as not reviewed. So does a cell over which a frame was painted since: it may show something else, and nobody can
tell without looking; the seconds that somebody looked at it begin anew. Looks of some seconds are held in memory and written
together, so that people who look about do not keep the disk busy: a kill loses the last `FLUSH_S` of them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.notes.search.seen_ground import CELL, NUMBERS, StampedGround, is_as_seen, spans
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.render.tile_grid import HALF_SPAN, Box
from gcs_mosaic.stitch.arrays import Array, Mask

MOST_CELLS = 4096  # of one look; from further away nobody reviews
MOST_ROWS = 400_000  # 20 MB
MOST_REVIEWERS = 100
LONGEST_LOOK_S = 10.0  # of one report
FLUSH_S = 10.0
ALWAYS = 1 << 62 | NUMBERS  # a stamp above all others


@dataclass(frozen=True, slots=True)
class ReviewedView:
    """What somebody had on the screen: a box of an island's canvas at a level of zoom, for so long."""

    island: int
    box: Box
    level: int
    seconds: float
    who: str
    stamps: Mapping[tuple[int, int], int] | None = (
        None  # of what its cells showed, as of `StampedGround`; None: not noted
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What is reviewed within a box: at this level or finer, so long in sum, by `who` or anybody, since `since_utc`."""

    island: int
    box: Box
    level: int
    seconds: float = 0.0
    who: str | None = None
    since_utc: float = 0.0


Key = tuple[int, int, int, str, int]  # island, x, y, who, level


class Reviews:
    """The looks in a book of notes. Raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book
        self._pending: dict[Key, tuple[float, float, int | None]] = {}  # seconds, utc, stamp
        self._written = time.monotonic()

    def report(self, look: ReviewedView) -> int:
        """Take in a look; the number of cells whose middle it shows, 0 from too far away. Raises Unfit when there is no room."""
        cells = cells_within(look.box)
        if len(cells) > MOST_CELLS:
            return 0
        reviewers = {row["name"] for row in self._book.rows("SELECT name FROM reviewers")}
        reviewers |= {key[3] for key in self._pending}
        if len(reviewers | {look.who}) > MOST_REVIEWERS:
            raise Unfit(f"{MOST_REVIEWERS} people review already.")
        if len(self._pending) + self._rows() > MOST_ROWS:
            raise Unfit("No more reviews can be kept for this flight.")
        now = time.time()
        for x, y in cells:
            key = (look.island, x, y, look.who, look.level)
            stamp = None if look.stamps is None else look.stamps.get((x, y), 0)
            before = self._pending.get(key, (0.0, now, stamp))
            seconds = look.seconds + (before[0] if before[2] == stamp else 0.0)
            self._pending[key] = seconds, now, stamp
        return len(cells)

    def flush_if_due(self) -> None:
        """To be called every few seconds."""
        if time.monotonic() - self._written >= FLUSH_S:
            self._written = time.monotonic()
            self.flush()

    def flush(self) -> None:
        """Write what is held in memory."""
        if not self._pending:
            return
        with self._book.change(counts=False) as file:
            numbers = {}
            for who in {key[3] for key in self._pending}:
                file.write("INSERT OR IGNORE INTO reviewers (name) VALUES (?)", who)
                numbers[who] = file.rows("SELECT id FROM reviewers WHERE name = ?", who)[0]["id"]
            for (island, x, y, who, level), (seconds, utc, newest) in self._pending.items():
                file.write(
                    "INSERT INTO reviewed (island, x, y, reviewer, level, seconds, utc, newest) VALUES (?, ?, ?, ?, ?, ?, ?, ?) "
                    "ON CONFLICT (island, x, y, reviewer, level) "
                    "DO UPDATE SET seconds = excluded.seconds + CASE WHEN newest IS excluded.newest THEN seconds ELSE 0 END, "
                    "utc = excluded.utc, newest = excluded.newest",
                    *(island, x, y, numbers[who], level, seconds, utc, newest),
                )
        self._pending.clear()

    def reviewed(self, question: Question, seen: Mapping[tuple[int, int], int]) -> set[tuple[int, int]]:
        """The cells (x, y) within the box that were reviewed as is asked, as they are now: of looks since which frames have come
        to a cell nothing counts. `seen` has the stamps of now."""
        sums: dict[tuple[int, int], float] = {}
        looks = list(self._looks(question))
        looked = np.array([ALWAYS if stamp is None else stamp for *_, stamp in looks], np.int64)
        now = np.array([seen.get((x, y), 0) for x, y, *_ in looks], np.int64)
        for (x, y, seconds, *_), is_known in zip(looks, is_as_seen(looked, now).tolist(), strict=True):
            if is_known:
                sums[x, y] = sums.get((x, y), 0.0) + seconds
        return {cell for cell, seconds in sums.items() if seconds >= question.seconds}

    def open_in(self, ground: StampedGround, island: int, level: int) -> Mask:
        """Which cells of an island's ground (lines, columns) nobody has looked at as they are now, at this level or finer."""
        return np.asarray((ground.stamps > 0) & np.isnan(self.looked_in(ground, island, level)))

    def looked_in(self, ground: StampedGround, island: int, level: int, who: str | None = None) -> Array:
        """When the cells of an island's ground (lines, columns) were looked at as they are now, at this level or finer, by `who`
        or anybody: seconds since 1970, of each who did their last look, of those the first; NaN where nobody has."""
        found = np.full(ground.stamps.shape, np.nan)
        question = Question(island=island, box=ground.box, level=level, who=who)
        looks = [(x, y, ALWAYS if stamp is None else stamp, utc) for x, y, _, utc, stamp in self._looks(question)]
        if looks and found.size:
            x, y, looked = np.array([one[:3] for one in looks], np.int64).T
            utc = np.array([one[3] for one in looks])
            lines, columns = y - ground.y, x - ground.x
            done = is_as_seen(looked, ground.stamps[lines, columns]) & (ground.stamps[lines, columns] > 0)
            np.fmin.at(found, (lines[done], columns[done]), utc[done])
        return found

    def last_of(self, who: str, island: int) -> tuple[int, int] | None:
        """The cell of an island that somebody looked at last."""
        found = [
            (utc, x, y) for (at, x, y, name, _), (_, utc, _) in self._pending.items() if (at, name) == (island, who)
        ]
        for row in self._book.rows(
            "SELECT utc, x, y FROM reviewed JOIN reviewers ON id = reviewer WHERE island = ? AND name = ? "
            "ORDER BY utc DESC, y DESC, x DESC LIMIT 1",
            *(island, who),
        ):
            found.append((row["utc"], row["x"], row["y"]))
        return max(found)[1:] if found else None

    def reviewers(self) -> Mapping[str, float]:
        """Who has reviewed, and when last (seconds since 1970)."""
        rows = self._book.rows(
            "SELECT name, max(utc) AS utc FROM reviewed JOIN reviewers ON id = reviewer GROUP BY reviewer"
        )
        found: dict[str, float] = {row["name"]: row["utc"] for row in rows}
        for (_, _, _, who, _), (_, utc, _) in self._pending.items():
            found[who] = max(found.get(who, 0.0), utc)
        return found

    def _looks(self, question: Question) -> Iterator[tuple[int, int, float, float, int | None]]:
        """Column, line, seconds, when last (seconds since 1970), and the stamp."""
        columns, lines = spans(question.box)
        where = "island = ? AND x BETWEEN ? AND ? AND y BETWEEN ? AND ? AND level >= ? AND utc >= ?"
        bounds = (question.island, columns[0], columns[-1], lines[0], lines[-1], question.level, question.since_utc)
        for row in self._book.rows(
            "SELECT x, y, seconds, utc, newest FROM reviewed JOIN reviewers ON id = reviewer "
            f"WHERE {where} AND (? IS NULL OR name = ?)",
            *bounds,
            *(question.who, question.who),
        ):
            yield row["x"], row["y"], row["seconds"], row["utc"], row["newest"]
        for (island, x, y, who, level), (seconds, utc, newest) in self._pending.items():
            is_asked = question.who in (None, who) and level >= question.level and utc >= question.since_utc
            if is_asked and island == question.island and x in columns and y in lines:
                yield x, y, seconds, utc, newest

    def _rows(self) -> int:
        found = self._book.rows("SELECT count(*) AS n FROM reviewed")
        return int(found[0]["n"]) if found else 0


def cells_within(box: Box) -> list[tuple[int, int]]:
    """The cells whose middle lies in a canvas box; if more than `MOST_CELLS`, one more than that."""
    left, top, right, bottom = ((edge + HALF_SPAN) / CELL - 0.5 for edge in box)
    columns = range(math.ceil(left), math.floor(right) + 1)
    lines = range(math.ceil(top), math.floor(bottom) + 1)
    if len(columns) * len(lines) > MOST_CELLS:
        return [(0, 0)] * (MOST_CELLS + 1)
    return [(x, y) for y in lines for x in columns]
