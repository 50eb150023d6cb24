"""Looking, shared out: each open page has a patch of ground that nobody has looked at, and no two pages have the same.

A patch is a rectangle of the reviews' cells that fits a screen at full sharpness. It is lent for `LENT_S` and kept by asking
again; a page that is closed gives it back, one that is gone loses it. Lent patches are kept in the notes, so that a server that
is started again lends none of them twice. What was looked at is a review like any other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gcs_mosaic.notes.search.reviews import Reviews
from gcs_mosaic.notes.search.seen_ground import CELL
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.render.tile_grid import HALF_SPAN, Box

LENT_S = 30.0  # a page asks again each 10 s; a tab that is not shown is slowed down by browsers to once a minute, and loses it
LEAST_LOOK_S = 1.0  # of a patch: nobody sees all of it sooner
MOST_SIDE = 64  # cells: squared, the most of one look
MOST_SESSIONS = 100

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPatch:
    """Cells from (x, y) on, that a page is lent."""

    session: str
    who: str
    island: int
    x: int
    y: int
    columns: int
    lines: int

    @property
    def box(self) -> Box:
        """On the island's canvas."""
        left, top = self.x * CELL - HALF_SPAN, self.y * CELL - HALF_SPAN
        return left, top, left + self.columns * CELL, top + self.lines * CELL

    def cells(self) -> set[Cell]:
        return {(self.x + i, self.y + k) for i in range(self.columns) for k in range(self.lines)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """What a page asks for: its island, how many cells its screen holds, and patches that it puts off."""

    session: str
    who: str
    island: int
    columns: int
    lines: int
    put_off: bool = False


class Looking:
    """The patches that are lent. `now`: seconds on any clock that does not go back. Raises what `NotesBook.change` and `rows`
    raise."""

    def __init__(self, book: NotesBook, reviews: Reviews, now: Callable[[], float] = time.monotonic) -> None:
        self._book, self._reviews, self._now = book, reviews, now
        self._until: dict[str, float] = {}  # of sessions
        self._put_off: dict[str, set[Cell]] = {}
        self._stamps: dict[str, Mapping[Cell, int]] = {}  # of what sessions' patches showed when they were lent
        self._begun = now()

    def lent(self) -> list[GroundPatch]:
        """All that are lent now; those from before a start for `LENT_S` after it."""
        rows = self._book.rows("SELECT * FROM leases ORDER BY session")
        found = [GroundPatch(**{name: row[name] for name in row.keys()}) for row in rows]  # noqa: SIM118 -- no mapping
        return [one for one in found if self._until.get(one.session, self._begun + LENT_S) > self._now()]

    def keep(self, session: str) -> bool:
        """Keep a patch for longer; False if it is not lent to that page any more."""
        is_lent = any(one.session == session for one in self.lent())
        if is_lent:
            self._until[session] = self._now() + LENT_S
        return is_lent

    def give_back(self, session: str) -> None:
        """Somebody else may have it."""
        self._forget(session)
        if self._book.rows("SELECT 1 FROM leases WHERE session = ?", session):
            with self._book.change(counts=False) as file:
                file.write("DELETE FROM leases WHERE session = ?", session)

    def next(self, asked: Place, open_cells: set[Cell]) -> GroundPatch | None:
        """The patch of a page: the one that it has as long as any of it is open, else the open ground nearest to what its person
        looked at last that is lent to nobody. `open_cells`: what is to be looked at of the island. Raises Unfit."""
        lent = self.lent()
        own = next((one for one in lent if one.session == asked.session), None)
        if own is not None and own.island == asked.island and own.cells() & open_cells and not asked.put_off:
            return self._lend(own)
        if own is not None and asked.put_off:
            self._put_off.setdefault(asked.session, set()).update(own.cells())
        others = [one for one in lent if one.session != asked.session]
        if len(others) >= MOST_SESSIONS:
            raise Unfit(f"{MOST_SESSIONS} pages look already.")
        taken = {cell for one in others if one.island == asked.island for cell in one.cells()}
        free = open_cells - taken
        wanted = free - self._put_off.get(asked.session, set())
        if not wanted:
            self._put_off.pop(asked.session, None)  # what was put off comes again
            wanted = free
        if not wanted:
            self.give_back(asked.session)
            return None
        return self._lend(self._around(self._nearest(wanted, asked, own), asked, taken, free))

    def looked(self, session: str) -> GroundPatch | None:
        """What is lent to a page."""
        return next((one for one in self.lent() if one.session == session), None)

    def note(self, session: str, stamps: Mapping[Cell, int]) -> None:
        """What a page's patch shows from now on: its looks count for no more than that."""
        self._stamps[session] = stamps

    def noted(self, session: str) -> Mapping[Cell, int] | None:
        """None: not since the server was started."""
        return self._stamps.get(session)

    def at(self, asked: Place, own: GroundPatch | None) -> Cell | None:
        """Where somebody looked last."""
        if own is not None and own.island == asked.island:
            return own.x + own.columns // 2, own.y + own.lines // 2
        return self._reviews.last_of(asked.who, asked.island)

    def _nearest(self, wanted: set[Cell], asked: Place, own: GroundPatch | None) -> Cell:
        """To what was looked at last; else the first from the top left."""
        at = self.at(asked, own)
        if at is None:
            return min(wanted, key=lambda cell: (cell[1], cell[0]))
        x, y = at
        return min(wanted, key=lambda cell: (abs(cell[1] - y) // asked.lines, abs(cell[0] - x), cell[1], cell[0]))

    def _around(self, cell: Cell, asked: Place, taken: set[Cell], free: set[Cell]) -> GroundPatch:
        """The patch of a fixed grid that holds a cell, cut so that it has none that others have, and no wider than what is free,
        which so stands in the middle of the screen."""
        (x, y), right, bottom = cell, 1, 1
        left, top = x - x % asked.columns, y - y % asked.lines
        x = next((one + 1 for one in range(x - 1, left - 1, -1) if (one, y) in taken), left)
        while x + right < left + asked.columns and (x + right, y) not in taken:
            right += 1
        row = [x + one for one in range(right)]
        while y - 1 >= top and not any((one, y - 1) in taken for one in row):
            y, bottom = y - 1, bottom + 1
        while y + bottom < top + asked.lines and not any((one, y + bottom) in taken for one in row):
            bottom += 1
        ours = [(i, k) for k in range(y, y + bottom) for i in range(x, x + right) if (i, k) in free]
        (x, right), (y, bottom) = ((min(along), max(along) + 1 - min(along)) for along in zip(*ours, strict=True))
        return GroundPatch(
            session=asked.session, who=asked.who, island=asked.island, x=x, y=y, columns=right, lines=bottom
        )

    def _lend(self, patch: GroundPatch) -> GroundPatch:
        known = self._book.rows("SELECT * FROM leases WHERE session = ?", patch.session)
        values = patch.session, patch.who, patch.island, patch.x, patch.y, patch.columns, patch.lines
        if not known or tuple(known[0]) != values:
            with self._book.change(counts=False) as file:
                for session in self._ended():
                    file.write("DELETE FROM leases WHERE session = ?", session)
                file.write("INSERT OR REPLACE INTO leases VALUES (?, ?, ?, ?, ?, ?, ?)", *values)
        self._until[patch.session] = self._now() + LENT_S
        return patch

    def _ended(self) -> Sequence[str]:
        lent = {one.session for one in self.lent()}
        ended = [row["session"] for row in self._book.rows("SELECT session FROM leases") if row["session"] not in lent]
        for session in ended:
            self._forget(session)
        return ended

    def _forget(self, session: str) -> None:
        for known in (self._until, self._put_off, self._stamps):
            known.pop(session, None)
