"""Flight folders as a stranger might hand them over: each trick makes something of a whole flight's folder hostile.

`outside` is a folder of somebody else, of which nothing may be read into an answer, and nothing changed.
"""

from __future__ import annotations

import json
import os
import sqlite3
import struct
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from gcs_mosaic.store.folder import LEDGER_NAME, NOTES_NAME

Trick = Callable[[Path, Path], object]  # flight, outside
SECRET = "TOP SECRET"
# What the program removes or renames where it is its own.
OURS_ELSEWHERE = (".draft.part", "0/16/1/1.jpg", "unfinished/x", "packing-x/y", "gcs-mosaic-reprocess")


def written(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def an_outside(folder: Path) -> Path:
    """Somebody else's files."""
    for name in ("secret.txt", "frames/a.jpg", *OURS_ELSEWHERE):
        written(folder / name, f"{SECRET} {name}\n".encode())
    (folder / "document.json").write_text(json.dumps({"revision": 1, "flight": SECRET, "islands": []}))
    return folder


def seen(folder: Path) -> dict[str, tuple[int, int, bytes]]:
    """All that lies in a folder, comparable."""
    found = {}
    for path in sorted(folder.rglob("*")):
        stat = path.lstat()
        found[str(path.relative_to(folder))] = (
            stat.st_mode,
            stat.st_mtime_ns,
            path.read_bytes() if path.is_file() else b"",
        )
    return found


def put(path: Path, make: Callable[[Path], object]) -> None:
    """Something else in the place of a file or folder."""
    if path.is_dir() and not path.is_symlink():
        path.rename(path.with_name(f"was-{path.name}"))
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    make(path)


def linked(name: str, to: str) -> Trick:
    return lambda flight, outside: put(flight / name, lambda path: path.symlink_to(outside / to))


def each(make: Callable[[Path], object], *names: str) -> Trick:
    """The same in the place of each of these names."""

    def trick(flight: Path, _: Path) -> None:
        for name in names:
            put(flight / name, make)

    return trick


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def folder(path: Path) -> None:
    (path / "deep").mkdir(parents=True)


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 40)


def of_text(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text)


def deep(flight: Path, _: Path) -> None:
    """Folders below folders until no path is long enough."""
    for name in ("frames", "tiles", "masks", "archive"):
        here = os.open(flight / name, os.O_RDONLY) if (flight / name).is_dir() else None
        for _number in range(3000):
            if here is None:
                break
            os.mkdir("d", dir_fd=here)
            below = os.open("d", os.O_RDONLY, dir_fd=here)
            os.close(here)
            here = below
        if here is not None:
            os.close(here)


def names(flight: Path, _: Path) -> None:
    """Names with line breaks, escapes, undecodable bytes."""
    tiles = ("tiles/0/16/x\ny.jpg", "tiles/٣/16/1/1.jpg", "tiles/0/99/1/1.jpg")
    for name in ("frames/a\nb.jpg", "frames/\x1b[2J.jpg", *tiles):
        written(flight / name, b"x")
    (Path(os.fsdecode(os.fsencode(flight) + b"/frames/\xff.jpg"))).write_bytes(b"x")


def many(flight: Path, _: Path) -> None:
    for kind in ("frames", "tiles/0/16"):
        (flight / kind / "many").mkdir(parents=True, exist_ok=True)
        for number in range(20_000):
            os.close(os.open(flight / kind / "many" / f"{number}.jpg", os.O_CREAT))


def ledger(*statements: str, name: str = LEDGER_NAME) -> Trick:
    """Run on the ledger (or the notes), whatever the schema says."""

    def change(flight: Path, outside: Path) -> None:
        with closing(sqlite3.connect(flight / name, isolation_level=None)) as file:
            file.executescript(
                "PRAGMA foreign_keys = OFF; PRAGMA legacy_alter_table = ON; PRAGMA ignore_check_constraints = ON;"
            )
            for statement in statements:
                file.execute(statement.format(outside=outside))

    return change


ENDLESS = "WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


def view_of(table: str, name: str = LEDGER_NAME) -> Trick:
    """The table is an endless view of itself."""
    return ledger(
        f"ALTER TABLE {table} RENAME TO {table}_real",
        f"CREATE VIEW {table} AS {ENDLESS} SELECT {table}_real.* FROM {table}_real, n",
        name=name,
    )


def ledger_bytes(data: bytes) -> Trick:
    return lambda flight, _: (flight / LEDGER_NAME).write_bytes(data)


def deleting_journal(name: str) -> Trick:
    """A rollback journal that has SQLite delete a file of somebody else: it names that file as the journal of a transaction over
    several databases, which is removed when it has been rolled back."""

    def write(flight: Path, outside: Path) -> None:
        path = flight / name
        if not path.exists():
            sqlite3.connect(path).execute("CREATE TABLE t (x)").connection.close()
        with closing(sqlite3.connect(path)) as file:
            file.execute("PRAGMA journal_mode = DELETE")
            size = file.execute("PRAGMA page_size").fetchone()[0]
        first, pages = path.read_bytes()[:size], path.stat().st_size // size
        magic, nonce, victim = bytes.fromhex("d9d505f920a163d7"), 7, os.fsencode(outside / "secret.txt")
        head = (magic + struct.pack(">IIIII", 1, nonce, pages, 512, size)).ljust(512, b"\0")
        check = (nonce + sum(first[at] for at in range(size - 200, 0, -200))) & 0xFFFFFFFF
        record = struct.pack(">I", 1) + first + struct.pack(">I", check)
        end = struct.pack(">I", 0x40000000 // size + 1) + victim + struct.pack(">II", len(victim), sum(victim)) + magic
        path.with_name(f"{name}-journal").write_bytes(head + record + end)

    return write


def a_png(width: int, height: int) -> bytes:
    """Of one colour: some kilobytes for a gigabyte of pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer, row = zlib.compressobj(9), bytes(1 + 3 * width)
    packed = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


DOCUMENTS = ("mosaic.json", "placements.json", "placements.jsonl", "status.json")
FILES = (*DOCUMENTS, "checkpoint", "checkpoint.values", "flight.log", "flight.tlog", "page.token", ".gcs-mosaic.lock")
DATABASES = (
    LEDGER_NAME,
    NOTES_NAME,
    "hints.sqlite",
    f"{LEDGER_NAME}-wal",
    f"{LEDGER_NAME}-shm",
    f"{LEDGER_NAME}-journal",
)
TREES = ("tiles", "masks", "frames", "archive")
ABSURD = '{"revision": 1e999, "islands": [{"id": "../x", "bounds": [NaN, 1e308, 1, 1]}]}'
NESTED = "[" * 100_000 + "]" * 100_000
LINKS = {
    **{f"a linked {name}": linked(name, "secret.txt") for name in (*FILES, *DATABASES)},
    **{f"a dangling {name}": linked(name, "new.txt") for name in (*FILES, *DATABASES)},
    **{f"a linked {name}": linked(name, "") for name in TREES},
    "a linked document": linked("mosaic.json", "document.json"),
    "a linked island": linked("tiles/0", "0"),
    "a linked tile": linked("tiles/0/16/1/1.jpg", "secret.txt"),
    "a linked part": linked(".mosaic.json.part", "secret.txt"),
    "a linked export": linked(".mosaic.png.part", "secret.txt"),
    "linked folders of exports": linked(".mosaic-xyz.part", ""),
}
STRANGE_FILES: dict[str, Trick] = {
    "devices": each(device, *FILES, *DATABASES),
    "pipes": each(os.mkfifo, *FILES, *DATABASES),
    "folders": each(folder, *FILES, *DATABASES),
    "huge files": each(sparse, *FILES, NOTES_NAME),
    "a huge ledger": each(sparse, LEDGER_NAME),
    "deep folders": deep,
    "strange names": names,
    "many files": many,
    "nested documents": each(of_text(NESTED), *DOCUMENTS),
    "documents of another kind": each(of_text(ABSURD), *DOCUMENTS),
    "documents that are lists": each(of_text("[1, 2]"), *DOCUMENTS),
}
LEDGERS: dict[str, Trick] = {
    **{f"an endless view of {table}": view_of(table) for table in ("frames", "painted", "flight", "events")},
    "endless triggers": ledger(
        f"CREATE TRIGGER t AFTER UPDATE ON frames BEGIN INSERT INTO notices {ENDLESS} SELECT i, 1, 'a', 'info', 'b' FROM n; END"
    ),
    "a computed column": ledger("ALTER TABLE frames ADD COLUMN computed AS (hex(zeroblob(900000000)))"),
    "huge values": ledger("UPDATE frames SET reason = hex(zeroblob(60000000)) WHERE id = 1"),
    "values of other types": ledger(
        "UPDATE painted SET x = 'a', relief_shifts = 7, level = 1e9", "UPDATE cameras SET width = 'b'"
    ),
    "absurd numbers": ledger(
        "UPDATE painted SET log_gsd = 700, level = 24", "UPDATE cameras SET width = 999999999, focal = 1e-300"
    ),
    "paths elsewhere": ledger("UPDATE frames SET original = '{outside}/secret.txt'"),
    "paths upwards": ledger("UPDATE frames SET original = 'frames/../../outside/secret.txt'"),
    "names upwards": ledger("UPDATE frames SET original = NULL, name = '../../outside/secret.txt' || id"),
    "a bomb as overlay": lambda flight, _: sqlite_run(
        flight, "UPDATE painted SET overlay = ?", zlib.compress(bytes(1 << 28))
    ),
    "another schema": ledger("DROP TABLE painted", "CREATE TABLE painted (a, b)"),
    "no ledger of ours": ledger("PRAGMA application_id = 1"),
    "no database": ledger_bytes(b"SQLite format 3\0" + b"x" * 5000),
    "notes that are a view": view_of("book", NOTES_NAME),
    "a journal that deletes": deleting_journal(LEDGER_NAME),
    "a journal of notes that deletes": deleting_journal(NOTES_NAME),
}


def sqlite_run(flight: Path, statement: str, *values: object) -> None:
    with closing(sqlite3.connect(flight / LEDGER_NAME, isolation_level=None)) as file:
        file.execute(statement, values)
