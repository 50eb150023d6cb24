"""The ledger's tables, migrations, and opening a ledger file, or another SQLite file of ours."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.disk import sync_folder, telling_disk_full
from gcs_mosaic.store.foreign_file import ForeignFile, refuse_strange_files, refuse_strange_schema

VERSION = 18  # PRAGMA user_version; increment with every change to the tables below, and add a migration
APPLICATION = 0x6763736D  # PRAGMA application_id, "gcsm": distinguishes our files from other programs' databases
BUSY_S = 5.0  # how long a reader waits for another program that holds the file
WRITER_BUSY_S = 2.0  # ... and the flight, which tries again, and must say that it is alive

# Bit-exact numbers have no declared type, so that SQLite stores them unchanged (a REAL column
# turns whole numbers into integers on disk, and -0.0 into 0).
# As versions 6 to 9 have it; the migrations to those make it so.
FRAMES = """CREATE TABLE frames (
    id INTEGER PRIMARY KEY,
    name NOT NULL UNIQUE,
    state TEXT NOT NULL DEFAULT 'pending'
        CHECK (state IN
            ('pending', 'placed', 'covered', 'waiting', 'rejected', 'duplicate', 'damaged', 'dropped', 'unstitched')),
    reason TEXT,
    original,
    content_hash TEXT,
    size INTEGER,
    width INTEGER,
    height INTEGER,
    received,
    modified,
    CHECK (reason IS NOT NULL OR state NOT IN ('rejected', 'duplicate', 'damaged', 'dropped', 'unstitched')),
    CHECK (content_hash IS NOT NULL OR state = 'damaged')
);
"""
COVERED = """CREATE TABLE covered (
    frame INTEGER PRIMARY KEY REFERENCES frames (id),
    keyframe INTEGER NOT NULL REFERENCES frames (id),
    keyframe_from_frame BLOB NOT NULL,
    CHECK (frame != keyframe)
);
"""
OTHER_FILES = """CREATE TABLE IF NOT EXISTS other_files (
    name PRIMARY KEY, -- of a file of a shot whose frame is another one
    camera TEXT NOT NULL, -- or what it is: preview, written again
    content_hash TEXT NOT NULL,
    size INTEGER NOT NULL,
    received NOT NULL,
    modified NOT NULL,
    vehicle INTEGER
);
"""
# Where a recorded video says that the camera was: what its frames have instead of events.
RECORDED = """CREATE TABLE IF NOT EXISTS recorded (
    frame INTEGER PRIMARY KEY REFERENCES frames (id),
    time_s NOT NULL,
    told_by TEXT NOT NULL,
    latitude_deg NOT NULL,
    longitude_deg NOT NULL,
    altitude_m
);
"""
CAMERAS = """-- One row for each set of lens values ever used: a painted frame refers to those it was painted with.
CREATE TABLE cameras (
    id INTEGER PRIMARY KEY,
    width INTEGER NOT NULL,
    height INTEGER NOT NULL,
    focal NOT NULL,
    k1 NOT NULL, k2 NOT NULL,
    shift_x NOT NULL, shift_y NOT NULL,
    fisheye INTEGER NOT NULL, -- 1: k1 and k2 are of the angle to the axis
    UNIQUE (width, height, focal, k1, k2, shift_x, shift_y, fisheye)
);
"""
TABLES = f"""
CREATE TABLE flight (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    name TEXT NOT NULL,
    started_utc NOT NULL,
    canvas TEXT NOT NULL -- how frames are painted, JSON
);
{FRAMES}ALTER TABLE frames ADD COLUMN sharpness; -- of its picture, see stitch.features.sharpness
ALTER TABLE frames ADD COLUMN vehicle INTEGER; -- MAVLink system id of the aircraft whose source brought it
CREATE TABLE events (
    id INTEGER PRIMARY KEY,
    state TEXT NOT NULL CHECK (state IN ('pending', 'matched', 'missing', 'duplicate', 'failed')),
    duplicate_of INTEGER REFERENCES events (id),
    frame INTEGER REFERENCES frames (id),
    vehicle INTEGER NOT NULL,
    component INTEGER NOT NULL,
    camera INTEGER NOT NULL,
    source INTEGER NOT NULL,
    sequence INTEGER,
    received NOT NULL,
    source_time,
    clock TEXT NOT NULL,
    utc,
    result TEXT NOT NULL,
    file_hint,
    latitude_deg,
    longitude_deg,
    altitude_m,
    CHECK ((state = 'matched') = (frame IS NOT NULL)),
    CHECK ((state = 'duplicate') = (duplicate_of IS NOT NULL)),
    CHECK (duplicate_of != id)
);
CREATE INDEX events_by_frame ON events (frame);
CREATE TABLE islands (
    id INTEGER PRIMARY KEY,
    merged_into INTEGER REFERENCES islands (id),
    CHECK (merged_into != id)
);
{CAMERAS}CREATE TABLE painted (
    frame INTEGER PRIMARY KEY REFERENCES frames (id),
    "order" INTEGER NOT NULL,
    island INTEGER NOT NULL REFERENCES islands (id),
    level INTEGER NOT NULL,
    camera INTEGER NOT NULL REFERENCES cameras (id),
    x NOT NULL, y NOT NULL, log_gsd NOT NULL, yaw NOT NULL, pitch NOT NULL, roll NOT NULL,
    gain BLOB NOT NULL, display TEXT NOT NULL, vignetting BLOB,
    dead_border TEXT, -- left, top, right, bottom, JSON
    overlay BLOB, -- what covers the ground: deflated rows and columns, 16 bits each, little-endian, then bits by row
    light BLOB, -- log factors at 8 x 6 nodes, by row, column and band: signed bytes, 1/128
    picture_area BLOB, -- where the frame holds a picture, as `overlay`; NULL: everywhere
    relief_columns INTEGER, relief_rows INTEGER, relief_shifts BLOB
);
CREATE INDEX painted_by_island ON painted (island, "order");
CREATE TABLE estimates (
    frame INTEGER PRIMARY KEY REFERENCES frames (id),
    island INTEGER NOT NULL REFERENCES islands (id),
    camera INTEGER NOT NULL REFERENCES cameras (id),
    x NOT NULL, y NOT NULL, log_gsd NOT NULL, yaw NOT NULL, pitch NOT NULL, roll NOT NULL,
    inliers INTEGER NOT NULL,
    residual_px,
    neighbours INTEGER NOT NULL,
    hops INTEGER NOT NULL,
    corner_deviation_px,
    relief_columns INTEGER, relief_rows INTEGER, relief_shifts BLOB,
    homography BLOB,
    focal_log_deviation
);
{COVERED}{OTHER_FILES}{RECORDED}CREATE TABLE notices (
    id INTEGER PRIMARY KEY,
    utc NOT NULL,
    source TEXT NOT NULL,
    level TEXT NOT NULL,
    text NOT NULL
);
"""

# A table's CHECK constraints can only be changed by recreating it; references go by its name.
NEW_FRAMES = f"""
{FRAMES.replace("frames", "new_frames")}
INSERT INTO new_frames SELECT * FROM frames;
DROP TABLE frames;
ALTER TABLE new_frames RENAME TO frames;
"""
# Statements that migrate each older version to the next one.
MIGRATIONS = {
    1: "ALTER TABLE estimates ADD COLUMN homography BLOB;",
    2: """
ALTER TABLE flight ADD COLUMN canvas TEXT NOT NULL DEFAULT '{"blend": "edge"}';
ALTER TABLE painted ADD COLUMN gain BLOB NOT NULL DEFAULT x'';
ALTER TABLE painted ADD COLUMN display TEXT NOT NULL DEFAULT '{"shown": [0, 1, 2], "black": [0, 0, 0], "white": [255, 255, 255]}';
UPDATE painted SET gain = numbers(gain_b, gain_g, gain_r);
ALTER TABLE painted DROP COLUMN gain_b;
ALTER TABLE painted DROP COLUMN gain_g;
ALTER TABLE painted DROP COLUMN gain_r;
""",
    3: "ALTER TABLE painted ADD COLUMN vignetting BLOB;",
    4: "ALTER TABLE painted ADD COLUMN dead_border TEXT;",
    5: f"{NEW_FRAMES}{COVERED}",
    6: "",  # one vignetting curve for all bands is read as one per band
    7: "",  # a display without factor and gamma is read as 1 for both
    8: NEW_FRAMES,
    9: "ALTER TABLE frames ADD COLUMN sharpness;",
    10: "ALTER TABLE frames ADD COLUMN vehicle INTEGER;",
    11: "ALTER TABLE estimates ADD COLUMN focal_log_deviation;",
    12: "ALTER TABLE painted ADD COLUMN overlay BLOB;",
    13: OTHER_FILES,
    14: RECORDED,
    15: "ALTER TABLE painted ADD COLUMN light BLOB;",
    16: "ALTER TABLE painted ADD COLUMN picture_area BLOB;",
    17: f"""{CAMERAS.replace("TABLE cameras", "TABLE new_cameras")}
INSERT INTO new_cameras SELECT id, width, height, focal, k1, k2, shift_x, shift_y, 0 FROM cameras;
DROP TABLE cameras;
ALTER TABLE new_cameras RENAME TO cameras;
""",
}
# Statements by which a file of an older version that is only read, and so not migrated, reads like one of the next.
SEEN_AS = {17: "CREATE TEMP VIEW cameras AS SELECT *, 0 AS fisheye FROM main.cameras;"}


@dataclass(frozen=True, slots=True)
class FileSchema:
    """A kind of SQLite file of ours."""

    application: int  # PRAGMA application_id
    version: int  # PRAGMA user_version
    tables: str  # statements that make a new file
    migrations: Mapping[int, str]  # from each older version to the next one
    modes: str  # pragmas of a connection that writes
    noun: str
    kind: str  # what a file of it is, with an article
    remedy: str  # what to do with a file that is none
    seen_as: Mapping[int, str] = field(default_factory=dict)  # as migrations, for a connection that only reads


PRIMARY_CODE = 0xFF  # of SQLite's extended error codes

# With a write-ahead log, NORMAL survives any kill; for power cuts see LedgerFile.make_durable.
LEDGER = FileSchema(
    APPLICATION,
    VERSION,
    TABLES,
    MIGRATIONS,
    modes="PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL;",
    noun="ledger",
    kind="a flight's ledger",
    remedy="move it away or choose another --out",
    seen_as=SEEN_AS,
)


class DamagedLedger(UsageError):  # noqa: N818 - names a state, not an error
    """A file that should be a ledger and cannot be read as one; the message says why."""


def connect(path: Path, schema: FileSchema = LEDGER) -> sqlite3.Connection:
    """The ledger (or other file) at `path`, created if missing. Raises UsageError for a file that is not ours, and DiskFull."""
    refuse_strange_files(path)
    with telling_disk_full(path):
        connection = sqlite3.connect(path, timeout=WRITER_BUSY_S, isolation_level=None, factory=ForeignFile)
        try:
            prepare(connection, path, schema)
        except BaseException:
            connection.close()
            raise
        sync_folder(path.parent)  # the ledger and its log are found again after a power cut, on FAT too
    return connection


def connect_for_reading(path: Path, schema: FileSchema = LEDGER, *, without_log: bool = False) -> sqlite3.Connection:
    """The ledger at `path`, alongside the program that writes it. Raises UsageError if there is none of ours.

    `without_log`: the main file alone, as of its last checkpoint: the log beside it may be another ledger's.
    """
    refuse_strange_files(path)
    if not path.is_file():
        raise UsageError(f"{path} does not exist: name a folder that gcs-mosaic has written a flight into")
    try:
        return _opened(path, schema, "immutable=1" if without_log else "mode=ro")
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & PRIMARY_CODE != sqlite3.SQLITE_CANTOPEN:
            raise
        return _opened_where_nobody_writes(path, schema)


def _opened_where_nobody_writes(path: Path, schema: FileSchema) -> sqlite3.Connection:
    """A ledger on a read-only medium: SQLite makes files beside it even to read, unless it knows that nobody changes it. Raises
    UsageError if the last changes are in its log only, which would be left out."""
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size:
        raise UsageError(
            f"the last changes of {path} are in {log.name}, which cannot be read where nothing can be written: copy the "
            "folder to a disk that can be written, and name the copy"
        )
    return _opened(path, schema, "immutable=1")


def _opened(path: Path, schema: FileSchema, how: str) -> sqlite3.Connection:
    place = f"{path.resolve().as_uri()}?{how}"
    connection = sqlite3.connect(place, uri=True, timeout=BUSY_S, isolation_level=None, factory=ForeignFile)
    try:
        connection.row_factory = sqlite3.Row
        version = version_of(connection, path, schema)
        if version == 0:
            raise UsageError(f"{path} holds no flight: name a folder that gcs-mosaic has written a flight into")
        for old in range(version, schema.version):
            connection.executescript(schema.seen_as.get(old, ""))
    except BaseException:
        connection.close()
        raise
    return connection


def prepare(connection: sqlite3.Connection, path: Path, schema: FileSchema) -> None:
    """Create the tables in a new file, or check that an existing file's are ours; set the write mode."""
    connection.row_factory = sqlite3.Row
    version = version_of(connection, path, schema)
    if version == 0:
        marks = f"PRAGMA application_id = {schema.application}; PRAGMA user_version = {schema.version};"
        connection.executescript(f"BEGIN; {schema.tables} {marks} COMMIT;")
    connection.create_function("numbers", 3, lambda *values: struct.pack("<3d", *values))
    for old in range(version or schema.version, schema.version):
        connection.executescript(f"BEGIN; {schema.migrations[old]} PRAGMA user_version = {old + 1}; COMMIT;")
    connection.executescript(f"{schema.modes} PRAGMA foreign_keys = ON;")


def version_of(connection: sqlite3.Connection, path: Path, schema: FileSchema = LEDGER) -> int:
    """The schema version, 0 for an empty file. Raises UsageError for a file that is not ours or newer than this program."""
    try:
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        application = int(connection.execute("PRAGMA application_id").fetchone()[0])
        empty = connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0] == 0
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise
        text = f"{path} is not {schema.kind} ({error}): {schema.remedy}, or see gcs-mosaic check"
        raise DamagedLedger(text) from error
    if empty:
        return 0
    if application != schema.application:
        raise UsageError(f"{path} belongs to another program: {schema.remedy}")
    if version > schema.version:
        known = f"({schema.noun} version {version}, this one knows up to {schema.version})"
        remedy = schema.remedy.replace("move it away", "update gcs-mosaic")
        raise UsageError(f"{path} was written by a newer gcs-mosaic {known}: {remedy}")
    refuse_strange_schema(connection, path, schema.tables, whole=version == schema.version)
    return version
