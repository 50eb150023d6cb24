"""The ledger: everything a flight's output depends on, except the originals' pixels.

One SQLite file, owned by one thread (SQLite itself refuses calls from another). Every method is one transaction unless
called inside `with ledger.transaction():`, which commits all of a frame's changes together or none.
All writing methods raise DiskFull when the disk is full; the ledger is then unchanged and remains usable.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Callable, Iterable
from dataclasses import asdict

from gcs_mosaic.messages import DamagedFile, Frame, Notice, OtherFile, RecordedPosition, TriggerEvent
from gcs_mosaic.render.compositor import CompositorSettings
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.stitch.graph.placement import Homography
from gcs_mosaic.store.ledger_file import LedgerFile
from gcs_mosaic.store.records import (
    Accounts,
    CoveredRecord,
    Estimate,
    EventRecord,
    EventState,
    FlightRecord,
    FrameRecord,
    FrameState,
    IslandRecord,
    NoticeRecord,
    PositionRecord,
    ReportedPosition,
)
from gcs_mosaic.store.rows import (
    EVENT_COLUMNS,
    LENS_COLUMNS,
    LOOK_COLUMNS,
    POSE_COLUMNS,
    RELIEF_COLUMNS,
    SUPPORT_COLUMNS,
    camera_row,
    covered_of,
    estimate_of,
    event_record_of,
    event_row,
    flight_of,
    frame_record_of,
    homography_row,
    look_row,
    name_of,
    nine_numbers,
    painted_of,
    pose_row,
    position_record_of,
    recorded_of,
    recorded_position_of,
    relief_row,
    reported_position_of,
    support_row,
)
from gcs_mosaic.store.stored_text import restored, stored
from gcs_mosaic.store.told_documents import EventAccount, FrameAccount

NO_PICTURES = "('duplicate', 'damaged')"  # states of files that no event is to be expected of


class Ledger(LedgerFile):
    """The ledger of one flight."""

    # The flight

    def begin_flight(self, flight: FlightRecord) -> None:
        """Record the flight; a ledger holds exactly one."""
        values = (flight.name, flight.started_utc, json.dumps(asdict(flight.canvas)))
        self.write("INSERT INTO flight (id, name, started_utc, canvas) VALUES (1, ?, ?, ?)", *values)

    def set_canvas(self, canvas: CompositorSettings) -> None:
        """The flight is painted otherwise from now on: none of its tiles may be older."""
        self.write("UPDATE flight SET canvas = ?", json.dumps(asdict(canvas)))

    def flight(self) -> FlightRecord | None:
        return next(iter(self.made(flight_of, self.rows("SELECT * FROM flight"))), None)

    def record_notice(self, notice: Notice, utc: float) -> None:
        """Record a notice shown to the operator, and when (seconds since 1970)."""
        columns = "INSERT INTO notices (utc, source, level, text) VALUES (?, ?, ?, ?)"
        self.write(columns, utc, notice.source, notice.level, printable(notice.text))

    def notices(self, last: int = 1000) -> list[NoticeRecord]:
        """The newest `last` notices, oldest first."""
        rows = self.rows("SELECT utc, source, level, text FROM notices ORDER BY id DESC LIMIT ?", last)
        return [NoticeRecord(**{key: row[key] for key in row.keys()}) for row in reversed(rows)]  # noqa: SIM118

    # Events

    def record_event(self, event: TriggerEvent, *, duplicate_of: int | None = None) -> int:
        """Record a new event, pending unless it is a duplicate of another (`duplicate_of`); returns its id."""
        state = EventState.PENDING if duplicate_of is None else EventState.DUPLICATE
        values = (state, duplicate_of, *event_row(event))
        columns = f"state, duplicate_of, {EVENT_COLUMNS}"
        return self.write(f"INSERT INTO events ({columns}) VALUES ({marks(values)})", *values)

    def settle_event(
        self, event_id: int, state: EventState, *, frame: str | None = None, duplicate_of: int | None = None
    ) -> None:
        """Set an event's outcome: matched (to `frame`), duplicate (of the event `duplicate_of`), missing or failed."""
        frame_id = None if frame is None else self._frame_id(frame)
        self.update(
            "UPDATE events SET state = ?, frame = ?, duplicate_of = ? WHERE id = ?",
            *(state, frame_id, duplicate_of, event_id),
        )

    def events(self, state: EventState | None = None) -> list[EventRecord]:
        """All events, or those in one state, in the order recorded."""
        select = "SELECT events.*, frames.name AS frame_name FROM events LEFT JOIN frames ON frames.id = events.frame"
        rows = self.rows(f"{select} WHERE ? IS NULL OR events.state = ? ORDER BY events.id", state, state)
        return self.made(event_record_of, rows)

    # Frames

    def record_frame(self, frame: Frame) -> None:
        """Record a complete frame. A file that was damaged before becomes pending; any other known name is an error."""
        values = (frame.content_hash, frame.size, frame.received, frame.modified, frame.vehicle, stored(frame.name))
        with self.transaction():
            mend = (
                "state = 'pending', reason = NULL, content_hash = ?, size = ?, received = ?, modified = ?, vehicle = ?"
            )
            if not self.changed(f"UPDATE frames SET {mend} WHERE name = ? AND state = 'damaged'", *values):
                columns = "content_hash, size, received, modified, vehicle, name"
                self.write(f"INSERT INTO frames ({columns}) VALUES ({marks(values)})", *values)
            self.write("DELETE FROM other_files WHERE name = ?", stored(frame.name))  # its camera is mapped after all

    def record_other(self, other: OtherFile) -> None:
        """Record a file of a camera that is not mapped; the newest version of it."""
        frame = other.frame
        values = (stored(frame.name), other.camera, frame.content_hash, frame.size, frame.received, frame.modified)
        columns = "name, camera, content_hash, size, received, modified, vehicle"
        self.write(
            f"INSERT OR REPLACE INTO other_files ({columns}) VALUES ({marks((*values, 0))})", *values, frame.vehicle
        )

    def record_beside(self, name: str, what: str) -> None:
        """Record that a frame is of a shot whose frame is another one; `what` it is to that, in the place of its camera."""
        columns = "name, camera, content_hash, size, received, modified, vehicle"
        of_frame = "SELECT name, ?, content_hash, size, received, modified, vehicle FROM frames WHERE name = ?"
        self.write(f"INSERT OR REPLACE INTO other_files ({columns}) {of_frame}", what, stored(name))

    def other_files(self) -> list[tuple[str, str]]:
        """Name and camera of each file of a camera that is not mapped, in order of arrival."""
        if not self._has_other_files():
            return []
        return [
            (name_of(row), row["camera"]) for row in self.rows("SELECT name, camera FROM other_files ORDER BY rowid")
        ]

    def shots_of_other_cameras(self) -> frozenset[int]:
        """Ids of the events without a picture that name a file of a camera that is not mapped: it has come, and is left out."""
        columns = "SELECT id, file_hint FROM events WHERE state = 'missing' AND file_hint IS NOT NULL"
        named = [(row["id"], _base_name(restored(row["file_hint"]))) for row in self.rows(columns)]
        left_out = {_base_name(name) for name, _ in self.other_files()} if named else set[str]()
        return frozenset(number for number, name in named if name in left_out)

    def record_new_bytes(self, frame: Frame) -> None:
        """Record that a frame's file holds the same picture in other bytes now; its time is still that of the picture."""
        told = (frame.content_hash, frame.size, stored(frame.name))
        self.update("UPDATE frames SET content_hash = ?, size = ? WHERE name = ?", *told)

    def record_position(self, name: str, recorded: RecordedPosition) -> None:
        """Record where the video that a frame is taken from says that it was; replaces any earlier record."""
        place = recorded.position
        told = (recorded.time_s, printable(recorded.told_by), place.latitude_deg, place.longitude_deg, place.altitude_m)
        columns = "frame, time_s, told_by, latitude_deg, longitude_deg, altitude_m"
        self.write(
            f"INSERT OR REPLACE INTO recorded ({columns}) VALUES (?, ?, ?, ?, ?, ?)", self._frame_id(name), *told
        )

    def recorded(self) -> list[tuple[str, RecordedPosition]]:
        """What videos say of where their frames were taken, with the frames' names; none in a ledger older than this table."""
        if not self.rows("SELECT 1 FROM sqlite_schema WHERE name = 'recorded'"):
            return []
        rows = self.rows("SELECT recorded.*, name FROM recorded JOIN frames ON frames.id = frame ORDER BY frame")
        return [(name_of(row), recorded_of(row)) for row in rows]

    def record_damaged(self, damaged: DamagedFile) -> None:
        """Record an incomplete file. If repeated, the newest reason is kept; the name of a complete frame is an error."""
        values = (printable(damaged.reason), damaged.vehicle, stored(damaged.name))
        with self.transaction():
            again = "UPDATE frames SET reason = ?, vehicle = ? WHERE name = ? AND state = 'damaged'"
            if not self.changed(again, *values):
                self.write("INSERT INTO frames (reason, vehicle, name, state) VALUES (?, ?, ?, 'damaged')", *values)

    def record_original(self, name: str, original: str) -> None:
        """Record where the frame's original is kept: a POSIX path relative to the output folder."""
        self.update("UPDATE frames SET original = ? WHERE name = ?", stored(original), stored(name))

    def forget_original(self, name: str) -> None:
        """Record that the frame's original is no longer kept."""
        self.update("UPDATE frames SET original = NULL WHERE name = ?", stored(name))

    def record_size(self, name: str, width: int, height: int, sharpness: float | None = None) -> None:
        """Record the frame's size in pixels and its sharpness, known once decoded."""
        told = (width, height, sharpness, stored(name))
        self.update("UPDATE frames SET width = ?, height = ?, sharpness = coalesce(?, sharpness) WHERE name = ?", *told)

    def settle_frame(self, name: str, state: FrameState, reason: str | None = None) -> None:
        """Set a frame's outcome; `reason` is required for rejected, duplicate, damaged, dropped and unstitched."""
        reason = None if reason is None else printable(reason)
        self.update("UPDATE frames SET state = ?, reason = ? WHERE name = ?", state, reason, stored(name))

    def process_again(self, names: Iterable[str], placed: Iterable[str], covered: Iterable[str] = ()) -> None:
        """Reset these frames to pending. Places of all frames but those that are `placed` or `covered` are removed, and so is the
        record of merged islands."""
        with self.transaction():
            for name in names:
                self.settle_frame(name, FrameState.PENDING)
            for kept, tables in ((placed, ("estimates", "painted")), (covered, ("covered",))):
                self.write("CREATE TEMP TABLE on_map (frame INTEGER PRIMARY KEY)")
                for name in kept:
                    self.write("INSERT INTO on_map VALUES (?)", self._frame_id(name))
                for table in tables:
                    self.write(f"DELETE FROM {table} WHERE frame NOT IN (SELECT frame FROM on_map)")
                self.write("DROP TABLE on_map")
            self.write("UPDATE islands SET merged_into = NULL")

    def frames(self, state: FrameState | None = None) -> list[FrameRecord]:
        """All frames, or those in one state, in order of arrival."""
        had_event = "EXISTS (SELECT 1 FROM events WHERE events.frame = frames.id) AS had_event"
        rows = self.rows(f"SELECT *, {had_event} FROM frames WHERE ? IS NULL OR state = ? ORDER BY id", state, state)
        return self.made(frame_record_of, rows)

    # Placements

    def record_island(self, island: int) -> None:
        """Record a new island. Ids are never reused, so a known one is an error."""
        self.write("INSERT INTO islands (id) VALUES (?)", island)

    def merge_island(self, island: int, into: int) -> None:
        """Record that `island` was merged into `into`; the caller records its moved frames."""
        self.update("UPDATE islands SET merged_into = ? WHERE id = ?", into, island)

    def islands(self) -> list[IslandRecord]:
        rows = self.rows("SELECT id, merged_into FROM islands ORDER BY id")
        return [IslandRecord(id=row["id"], merged_into=row["merged_into"]) for row in rows]

    def record_estimates(self, estimates: Iterable[Estimate]) -> None:
        """Record the newest estimates of some frames in one transaction."""
        columns = f"frame, island, camera, {POSE_COLUMNS}, {SUPPORT_COLUMNS}, {RELIEF_COLUMNS}"
        columns += ", homography, focal_log_deviation"
        with self.transaction():
            for one in estimates:
                head = (self._frame_id(one.name), int(one.island), self._camera_id(one.camera))
                values = (*head, *pose_row(one.pose), *support_row(one), *relief_row(one.relief))
                values = (*values, homography_row(one.homography), one.focal_log_deviation)
                self.write(f"INSERT OR REPLACE INTO estimates ({columns}) VALUES ({marks(values)})", *values)

    def estimates(self) -> list[Estimate]:
        """The newest estimate of every frame that has one, in order of arrival."""
        more = ", frames.vehicle" if self._has("vehicle") else ""
        return self.made(estimate_of, self.rows(placed_in("estimates", "frames.id", more=more)))

    def corner_deviations(self) -> list[tuple[int, float]]:
        """Island and `corner_deviation_px` in canvas units of every frame that has one."""
        known = "SELECT island, corner_deviation_px, log_gsd FROM estimates WHERE corner_deviation_px IS NOT NULL"
        return [(row["island"], row["corner_deviation_px"] * math.exp(row["log_gsd"])) for row in self.rows(known)]

    def record_covered(self, name: str, by: str, by_from_frame: Homography) -> None:
        """Record that the frame is covered by its keyframe `by`; replaces any earlier record, also of a place of its own."""
        for table in ("estimates", "painted"):
            self.write(f"DELETE FROM {table} WHERE frame = ?", self._frame_id(name))
        values = (self._frame_id(name), self._frame_id(by), homography_row(by_from_frame))
        self.write("INSERT OR REPLACE INTO covered (frame, keyframe, keyframe_from_frame) VALUES (?, ?, ?)", *values)

    def covered(self) -> list[CoveredRecord]:
        """Every frame covered by a placed one, in order of arrival; none in a ledger older than this table."""
        if not self.rows("SELECT 1 FROM sqlite_schema WHERE name = 'covered'"):
            return []
        frame = (
            "JOIN frames AS frame ON frame.id = covered.frame JOIN frames AS keyframe ON keyframe.id = covered.keyframe"
        )
        columns = "frame.name, frame.width, frame.height, keyframe.name AS keyframe, keyframe_from_frame"
        columns += ", frame.vehicle" if self._has("vehicle") else ""
        return self.made(covered_of, self.rows(f"SELECT {columns} FROM covered {frame} ORDER BY covered.frame"))

    def covered_by(self, number: int) -> list[tuple[int, FrameRecord, Homography]]:
        """The frames that one frame (by its number) covers: number, record, keyframe_from_frame."""
        if not self.rows("SELECT 1 FROM sqlite_schema WHERE name = 'covered'"):
            return []
        had_event = "EXISTS (SELECT 1 FROM events WHERE events.frame = frames.id) AS had_event"
        rows = self.rows(
            f"SELECT frames.*, {had_event}, keyframe_from_frame FROM covered JOIN frames ON frames.id = covered.frame "
            "WHERE keyframe = ? ORDER BY frames.id",
            number,
        )
        return self.made(lambda row: (row["id"], frame_record_of(row), nine_numbers(row["keyframe_from_frame"])), rows)

    def keyframe_of(self, number: int) -> int | None:
        """The number of the frame that covers this one, if it is covered."""
        if not self.rows("SELECT 1 FROM sqlite_schema WHERE name = 'covered'"):
            return None
        rows = self.rows("SELECT keyframe FROM covered WHERE frame = ?", number)
        return int(rows[0]["keyframe"]) if rows else None

    def newest_on_map(self) -> str | None:
        """The most recently arrived frame that has a place."""
        rows = self.rows("SELECT name FROM frames WHERE state IN ('placed', 'covered') ORDER BY id DESC LIMIT 1")
        return name_of(rows[0]) if rows else None

    def newest_of_aircraft(self) -> dict[int, str]:
        """The same of each aircraft that has a source of its own."""
        if not self._has("vehicle"):
            return {}
        placed = "state IN ('placed', 'covered') AND vehicle IS NOT NULL"
        rows = self.rows(f"SELECT vehicle, name, max(id) FROM frames WHERE {placed} GROUP BY vehicle ORDER BY vehicle")
        return {row["vehicle"]: name_of(row) for row in rows}

    def record_painted(self, painted: RenderItem) -> None:
        """Record how a frame is painted now; replaces any earlier record."""
        columns = f'frame, "order", island, level, camera, {POSE_COLUMNS}, {LOOK_COLUMNS}, {RELIEF_COLUMNS}'
        with self.transaction():
            head = (self._frame_id(painted.name), int(painted.order), int(painted.island), int(painted.level))
            place = (self._camera_id(painted.camera), *pose_row(painted.pose))
            values = (*head, *place, *look_row(painted), *relief_row(painted.relief))
            self.write(f"INSERT OR REPLACE INTO painted ({columns}) VALUES ({marks(values)})", *values)

    def painted(self, island: int) -> list[RenderItem]:
        """Every frame painted on an island, in painting order."""
        rows = self.rows(placed_in("painted", '"order", frames.id', "WHERE painted.island = ?"), island)
        return self.made(painted_of, rows)

    def positions(self, make: Callable[[sqlite3.Row], PositionRecord] = position_record_of) -> list[PositionRecord]:
        """Every painted frame and how it lies, without relief and looks, in order of arrival. Quick: 100,000 take a second.

        `make`: who has read them before may know the record of a row.
        """
        columns = (
            f'frame, frames.name, island, "order", level, {POSE_COLUMNS}, frames.modified, frames.original, '
            f"frames.content_hash, {self._sharpness} AS sharpness, cameras.width AS camera_width, "
            f"cameras.height AS camera_height, {LENS_COLUMNS}, "
            "(SELECT corner_deviation_px FROM estimates WHERE estimates.frame = painted.frame) AS deviation"
        ) + (", frames.vehicle" if self._has("vehicle") else "")
        tables = "painted JOIN frames ON frames.id = painted.frame JOIN cameras ON cameras.id = painted.camera"
        return self.made(make, self.rows(f"SELECT {columns} FROM {tables} ORDER BY frame"))

    def reported_positions(self) -> list[ReportedPosition]:
        """All positions that were told of frames, duplicate messages included, in the order in which they came."""
        rows = self.rows(
            "SELECT told.*, coalesce(told.frame, first.frame) AS taken FROM events AS told "
            "LEFT JOIN events AS first ON first.id = told.duplicate_of "
            "WHERE taken IS NOT NULL AND told.latitude_deg IS NOT NULL ORDER BY told.id"
        )
        return [*self.made(reported_position_of, rows), *self._recorded_positions()]

    def _recorded_positions(self) -> list[ReportedPosition]:
        """Those that videos tell, as if their cameras had sent them."""
        if not self.rows("SELECT 1 FROM sqlite_schema WHERE name = 'recorded'"):
            return []
        return self.made(recorded_position_of, self.rows("SELECT * FROM recorded ORDER BY frame"))

    def message_times(self) -> dict[int, float]:
        """When messages say that frames were taken, by the frames' numbers (`frames.id`); seconds since 1970."""
        told = "SELECT frame, min(utc) AS utc FROM events WHERE frame IS NOT NULL AND utc IS NOT NULL GROUP BY frame"
        return {row["frame"]: float(row["utc"]) for row in self.rows(told)}

    def message_time(self, number: int) -> float | None:
        """The same of one frame."""
        (row,) = self.rows("SELECT min(utc) AS utc FROM events WHERE frame = ?", number)
        return None if row["utc"] is None else float(row["utc"])

    def painted_frame(self, number: int) -> RenderItem | None:
        """How one frame is painted, by its number (`frames.id`)."""
        rows = self.rows(placed_in("painted", "frame", "WHERE painted.frame = ?"), number)
        return next(iter(self.made(painted_of, rows)), None)

    def frame(self, number: int) -> FrameRecord | None:
        """One frame by its number (`frames.id`)."""
        had_event = "EXISTS (SELECT 1 FROM events WHERE events.frame = frames.id) AS had_event"
        rows = self.rows(f"SELECT *, {had_event} FROM frames WHERE id = ?", number)
        return next(iter(self.made(frame_record_of, rows)), None)

    # Accounts

    def accounts(self) -> Accounts:
        """How many events and frames are in each state. The sums always equal the numbers of rows."""
        announced = "SELECT count(DISTINCT frame) FROM events"  # four times as fast as one query per frame
        return Accounts(
            events=EventAccount(**self._count_by_state("events")),
            frames=FrameAccount(**self._count_by_state("frames")),
            orphans=self.rows(f"SELECT count(*) - ({announced}) FROM frames")[0][0]
            - self._previews()
            - self._no_pictures(),
        )

    def _previews(self) -> int:
        """Frames without an event that are of a shot whose frame is another one."""
        if not self._has_other_files():
            return 0
        beside = f"SELECT count(*) FROM other_files JOIN frames USING (name) WHERE state NOT IN {NO_PICTURES}"
        alone = "frames.id NOT IN (SELECT frame FROM events WHERE frame IS NOT NULL)"
        return int(self.rows(f"{beside} AND {alone}")[0][0])

    def _no_pictures(self) -> int:
        """Files without an event of which none is to be expected: copies of other frames, and damaged ones."""
        aside = f"SELECT count(*) FROM frames WHERE state IN {NO_PICTURES} AND NOT EXISTS "
        return int(self.rows(f"{aside} (SELECT 1 FROM events WHERE events.frame = frames.id)")[0][0])

    def accounts_of_aircraft(self) -> dict[int, Accounts]:
        """The same for each aircraft that is known by an event or a frame. A frame is that of the aircraft whose source brought
        it or, where all have one source, of the one that announced it."""
        whose = (
            "SELECT frames.state, coalesce(frames.vehicle, events.vehicle) AS vehicle, events.id AS event "
            "FROM frames LEFT JOIN events ON events.frame = frames.id"
        )
        known = "WHERE vehicle IS NOT NULL GROUP BY vehicle"
        is_orphan = f"event IS NULL AND state NOT IN {NO_PICTURES}"
        orphans = f"SELECT vehicle, count(*) FILTER (WHERE {is_orphan}) AS n FROM ({whose}) {known}"
        events, frames = self._by_aircraft("events", known), self._by_aircraft(f"({whose})", known)
        left = {row["vehicle"]: row["n"] for row in self.rows(orphans)}
        return {
            one: Accounts(
                events=EventAccount(**events.get(one, {})),
                frames=FrameAccount(**frames.get(one, {})),
                orphans=left.get(one, 0),
            )
            for one in sorted(events.keys() | frames.keys())
        }

    def _by_aircraft(self, rows: str, known: str) -> dict[int, dict[str, int]]:
        counts: dict[int, dict[str, int]] = {}
        for row in self.rows(f"SELECT vehicle, state, count(*) AS n FROM {rows} {known}, state"):
            counts.setdefault(row["vehicle"], {})[row["state"]] = row["n"]
        return counts

    def _count_by_state(self, table: str) -> dict[str, int]:
        return {row["state"]: row["n"] for row in self.rows(f"SELECT state, count(*) AS n FROM {table} GROUP BY state")}

    # Lookups

    @property
    def _sharpness(self) -> str:
        """The column; nothing in an older ledger that is only read."""
        return "frames.sharpness" if self._has("sharpness") else "NULL"

    def _has_other_files(self) -> bool:
        """An older ledger that is only read may have none."""
        return bool(self.rows("SELECT 1 FROM sqlite_schema WHERE name = 'other_files'"))

    def _has(self, column: str) -> bool:
        """Whether frames have this column: an older ledger that is only read may not."""
        return any(row["name"] == column for row in self.rows("PRAGMA table_info(frames)"))

    def _frame_id(self, name: str) -> int:
        rows = self.rows("SELECT id FROM frames WHERE name = ?", stored(name))
        if not rows:
            raise LookupError(f"no frame of that name in {self.path}: {name!r}")
        return int(rows[0]["id"])

    def _camera_id(self, camera: Camera) -> int:
        columns, values = f"width, height, {LENS_COLUMNS}", camera_row(camera)
        self.write(f"INSERT OR IGNORE INTO cameras ({columns}) VALUES ({marks(values)})", *values)
        where = " AND ".join(f"{column} = ?" for column in columns.split(", "))
        return int(self.rows(f"SELECT id FROM cameras WHERE {where}", *values)[0]["id"])


def placed_in(table: str, order: str, where: str = "", more: str = "") -> str:
    """A query for the rows of `painted` or `estimates` joined with the frame's name and the camera's values; `more` columns."""
    return (
        f"SELECT {table}.*, frames.name, cameras.width AS camera_width, cameras.height AS camera_height, {LENS_COLUMNS}{more} "
        f"FROM {table} JOIN frames ON frames.id = {table}.frame JOIN cameras ON cameras.id = {table}.camera "
        f"{where} ORDER BY {order}"
    )


def marks(values: tuple[object, ...]) -> str:
    """One question mark per value."""
    return ", ".join("?" * len(values))


def printable(text: str) -> str:
    """Display text that may quote a file name with undecodable bytes."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _base_name(name: str | None) -> str:
    """Of a file in a folder, without case."""
    return (name or "").rpartition("/")[2].casefold()
