"""The tables of notes.sqlite, and its migrations."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_mosaic.store.schema import FileSchema

VERSION = 4  # PRAGMA user_version; increment with every change to the tables below, and add a migration
APPLICATION = 0x6763736E  # PRAGMA application_id, "gcsn"

PLACE = """
    island INTEGER NOT NULL, x NOT NULL, y NOT NULL, -- canvas, when it was set
    frame, pixel_x, pixel_y -- what it is bound to: a frame's name, and a pixel of its original
"""
ANCHORING = f"""
CREATE TABLE pins (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    deleted INTEGER NOT NULL DEFAULT 0 CHECK (deleted IN (0, 1)),
    label TEXT NOT NULL,
    written TEXT NOT NULL, -- the coordinate as it was given
    longitude_deg NOT NULL, latitude_deg NOT NULL, sigma_m NOT NULL,
    who TEXT NOT NULL, utc NOT NULL,
    {PLACE}
);
CREATE TABLE anchoring (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    by_positions INTEGER NOT NULL CHECK (by_positions IN (0, 1)), -- where there are no pins
    who TEXT NOT NULL, utc NOT NULL
);
"""
HINTS = """
CREATE TABLE hints_asked (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    asked INTEGER NOT NULL CHECK (asked IN (0, 1)),
    who TEXT NOT NULL, utc NOT NULL
);
CREATE TABLE picked_colours (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    deleted INTEGER NOT NULL DEFAULT 0 CHECK (deleted IN (0, 1)),
    blue INTEGER NOT NULL, green INTEGER NOT NULL, red INTEGER NOT NULL,
    tolerance NOT NULL,
    label TEXT NOT NULL,
    who TEXT NOT NULL, utc NOT NULL
);
"""
LOOKING = """
CREATE TABLE leases ( -- patches that somebody is looking at
    session TEXT PRIMARY KEY, -- an open page
    who TEXT NOT NULL,
    island INTEGER NOT NULL,
    x INTEGER NOT NULL, y INTEGER NOT NULL, columns INTEGER NOT NULL, lines INTEGER NOT NULL -- cells, as of `reviewed`
) WITHOUT ROWID;
CREATE TABLE opinions ( -- of others on a find
    find INTEGER NOT NULL REFERENCES finds (id),
    who TEXT NOT NULL,
    opinion TEXT NOT NULL CHECK (opinion IN ('yes', 'no', 'unsure')),
    utc NOT NULL,
    PRIMARY KEY (find, who)
) WITHOUT ROWID;
"""
LOOKING_BEFORE = f"ALTER TABLE reviewed ADD COLUMN newest INTEGER;{LOOKING}"
TABLES = f"""
CREATE TABLE book (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    name TEXT NOT NULL, -- at random: tells this file from another flight's
    revision INTEGER NOT NULL
);
INSERT INTO book VALUES (1, lower(hex(randomblob(8))), 0);
CREATE TABLE finds (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    key TEXT UNIQUE, -- given by who made it: a request that is sent again makes no second find
    revision INTEGER NOT NULL,
    deleted INTEGER NOT NULL DEFAULT 0 CHECK (deleted IN (0, 1)),
    kind TEXT NOT NULL, label TEXT NOT NULL, note TEXT NOT NULL,
    who TEXT NOT NULL, created_utc NOT NULL,
    changed_by TEXT NOT NULL, changed_utc NOT NULL,
    in_original INTEGER NOT NULL CHECK (in_original IN (0, 1)),
    {PLACE}
);
CREATE TABLE scales (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    deleted INTEGER NOT NULL DEFAULT 0 CHECK (deleted IN (0, 1)),
    metres NOT NULL,
    who TEXT NOT NULL, utc NOT NULL
);
CREATE TABLE scale_ends (
    scale INTEGER NOT NULL REFERENCES scales (id),
    end INTEGER NOT NULL CHECK (end IN (0, 1)),
    {PLACE},
    PRIMARY KEY (scale, end)
);
CREATE TABLE reviewers (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE reviewed (
    island INTEGER NOT NULL, x INTEGER NOT NULL, y INTEGER NOT NULL, -- cell: a tile of the level of `reviews.CELL_LEVEL`
    reviewer INTEGER NOT NULL REFERENCES reviewers (id),
    level INTEGER NOT NULL, -- of zoom
    seconds NOT NULL,
    utc NOT NULL, -- last
    newest INTEGER, -- stamp of the frames there then, as `StampedGround`'s; NULL: looked at before that was noted
    PRIMARY KEY (island, x, y, reviewer, level)
) WITHOUT ROWID;
CREATE TABLE dismissed (hint TEXT PRIMARY KEY, who TEXT NOT NULL, utc NOT NULL) WITHOUT ROWID;
{ANCHORING}{HINTS}{LOOKING}"""
MIGRATIONS: Mapping[int, str] = {1: ANCHORING, 2: HINTS, 3: LOOKING_BEFORE}

# One file without a log beside it can also be read in a folder that cannot be written. EXTRA: as FULL, and the journal's
# removal is synced too, so that a power cut takes back nothing that was answered with success.
NOTES = FileSchema(
    APPLICATION,
    VERSION,
    TABLES,
    MIGRATIONS,
    modes="PRAGMA journal_mode = DELETE; PRAGMA synchronous = EXTRA;",
    noun="notes",
    kind="a file of notes",
    remedy="move it away",
)
