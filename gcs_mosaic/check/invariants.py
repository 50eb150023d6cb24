"""What must hold between the rows of a ledger, in one place; each rule knows how a contradiction is settled.

Settling believes the less: a frame whose place is in doubt is pending again, and `--resume` or `stitch` places it anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from sqlite3 import Row

from gcs_mosaic.check.findings import CheckedPart
from gcs_mosaic.store.ledger import Ledger, placed_in
from gcs_mosaic.store.records import FlightRecord
from gcs_mosaic.store.rows import canvas_of, covered_of, estimate_of, painted_of, recorded_of
from gcs_mosaic.store.stored_text import restored

ROUNDS = 8  # settling one rule may show what another one rejects


@dataclass(frozen=True, slots=True)
class Rule:
    """`broken` selects the names of what contradicts it, `settle` are statements after which nothing does."""

    text: str
    broken: str
    settle: tuple[str, ...]


NO_PLACE = "state = 'placed' AND id NOT IN (SELECT frame FROM estimates)"
# One whose original is not kept, or that the paper's recipe has placed, may be placed without being painted.
NOT_PAINTED = """state = 'placed' AND original IS NOT NULL AND id NOT IN (SELECT frame FROM painted)
    AND id IN (SELECT frame FROM estimates WHERE homography IS NULL)"""
NO_KEYFRAME = "state = 'covered' AND id NOT IN (SELECT frame FROM covered)"
IN_A_CIRCLE = """WITH RECURSIVE way (start, at, steps) AS (
    SELECT id, merged_into, 1 FROM islands WHERE merged_into IS NOT NULL
    UNION ALL SELECT start, merged_into, steps + 1 FROM way JOIN islands ON islands.id = way.at
        WHERE merged_into IS NOT NULL AND steps <= (SELECT count(*) FROM islands)
) SELECT DISTINCT start FROM way WHERE at = start"""
RULES = (
    Rule(
        "its island is not in the list of islands",
        """SELECT name FROM frames WHERE id IN (
            SELECT frame FROM painted WHERE island NOT IN (SELECT id FROM islands)
            UNION SELECT frame FROM estimates WHERE island NOT IN (SELECT id FROM islands))""",
        ("INSERT OR IGNORE INTO islands (id) SELECT island FROM painted UNION SELECT island FROM estimates",),
    ),
    Rule(
        "placed, but the ledger has no place for it",
        f"SELECT name FROM frames WHERE {NO_PLACE}",
        (f"UPDATE frames SET state = 'pending', reason = NULL WHERE {NO_PLACE}",),
    ),
    Rule(
        "placed, but not painted",
        f"SELECT name FROM frames WHERE {NOT_PAINTED}",
        (f"UPDATE frames SET state = 'pending', reason = NULL WHERE {NOT_PAINTED}",),
    ),
    Rule(
        "has a place, but is not placed",
        "SELECT name FROM frames JOIN estimates ON frame = id WHERE state != 'placed'",
        ("DELETE FROM estimates WHERE frame IN (SELECT id FROM frames WHERE state != 'placed')",),
    ),
    Rule(
        "painted, but not placed",
        "SELECT name FROM frames JOIN painted ON frame = id WHERE state != 'placed'",
        ("DELETE FROM painted WHERE frame IN (SELECT id FROM frames WHERE state != 'placed')",),
    ),
    Rule(
        "covered, but nothing says by which frame",
        f"SELECT name FROM frames WHERE {NO_KEYFRAME}",
        (f"UPDATE frames SET state = 'pending', reason = NULL WHERE {NO_KEYFRAME}",),
    ),
    Rule(
        "has a keyframe, but is not covered",
        "SELECT name FROM frames JOIN covered ON frame = id WHERE state != 'covered'",
        ("DELETE FROM covered WHERE frame IN (SELECT id FROM frames WHERE state != 'covered')",),
    ),
    Rule(
        "an island that is merged into itself by way of others",
        IN_A_CIRCLE,
        (f"UPDATE islands SET merged_into = NULL WHERE id IN ({IN_A_CIRCLE})",),
    ),
)
# How a reference to something that is gone is settled, by table.
DANGLING = {
    **{table: f"DELETE FROM {table} WHERE rowid = ?" for table in ("estimates", "painted", "covered", "recorded")},
    "events": "UPDATE events SET state = 'missing', frame = NULL, duplicate_of = NULL WHERE rowid = ?",
    "islands": "UPDATE islands SET merged_into = NULL WHERE rowid = ?",
}
COVERED = """SELECT frame.name, frame.width, frame.height, keyframe.name AS keyframe, keyframe_from_frame, covered.frame
    FROM covered JOIN frames AS frame ON frame.id = covered.frame JOIN frames AS keyframe ON keyframe.id = covered.keyframe"""
RECORDED = "SELECT recorded.*, name FROM recorded JOIN frames ON frames.id = recorded.frame"
READ: dict[str, tuple[str, Callable[[Row], object]]] = {
    "estimates": (placed_in("estimates", "frames.id"), estimate_of),
    "painted": (placed_in("painted", "frames.id"), painted_of),
    "covered": (COVERED, covered_of),
    "recorded": (RECORDED, recorded_of),
}


def check_rows(ledger: Ledger, part: CheckedPart) -> None:
    """Add what contradicts the rules to `part`."""
    part.checked = ledger.rows("SELECT count(*) FROM frames")[0][0]
    pending = ledger.rows("SELECT count(*) FROM frames WHERE state = 'pending'")[0][0]
    if pending:
        part.notes.append(f"{pending} frames are still to be placed: gcs-mosaic --resume, or stitch")
    if not _has_flight(ledger):
        part.fault("flight", "the row that names the flight, and how it is painted, is missing or cannot be read")
    for table, row in _dangling(ledger):
        part.fault(f"{table}, row {row}", "refers to a row that does not exist")
    for table, name, _ in _unreadable(ledger):
        part.fault(name, f"its row in the table {table} cannot be read")
    for rule in RULES:
        for found in ledger.rows(rule.broken):
            part.fault(restored(found[0]) if isinstance(found[0], str | bytes) else f"island {found[0]}", rule.text)


def settle_rows(ledger: Ledger, name: str, started_utc: float) -> None:
    """Settle all contradictions. `name`, `started_utc`: of the flight, should the ledger not know them any more."""
    with ledger.transaction():
        if not _has_flight(ledger):
            ledger.write("DELETE FROM flight")
            ledger.begin_flight(FlightRecord(name=name, started_utc=started_utc))
        for _ in range(ROUNDS):
            for statement in (statement for rule in RULES for statement in rule.settle):
                ledger.write(statement)
            for table, row in _dangling(ledger):
                if table in DANGLING:
                    ledger.write(DANGLING[table], row)
            for table, _, frame in _unreadable(ledger):
                ledger.write(f"DELETE FROM {table} WHERE frame = ?", frame)


def _has_flight(ledger: Ledger) -> bool:
    try:
        return any(canvas_of(row) for row in ledger.rows("SELECT * FROM flight"))
    except (ValueError, TypeError):
        return False


def _dangling(ledger: Ledger) -> list[tuple[str, int]]:
    """Table and row of each reference to what is gone; of frames and islands that are missing themselves, see the rules."""
    return [(row[0], row[1]) for row in ledger.rows("PRAGMA foreign_key_check")]


def _unreadable(ledger: Ledger) -> list[tuple[str, str, int]]:
    """Table, frame name and frame id of each row whose values make no sense."""
    found = []
    for table, (select, read) in READ.items():
        for row in ledger.rows(select):
            try:
                read(row)
            except (ValueError, TypeError, KeyError, IndexError):
                found.append((table, restored(row["name"]) or "", row["frame"]))
    return found
