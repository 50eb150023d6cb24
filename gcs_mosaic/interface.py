"""A flight for programs in Python: frames and camera events in; placements, tiles and sightings out.

    import gcs_mosaic

    with gcs_mosaic.open_flight("map", {"scale": 0.5}) as flight:
        flight.hear(message)                         # a camera message, as pymavlink makes it
        done = flight.add("DCIM/IMG_0001.JPG")       # or bytes, or an array (h, w, 3), blue first
        for placed in flight.placements(): ...       # on the map as it is now
        tile = flight.tile(placed.island, 16, x, y)
        seen = flight.sightings(placed.island, 0.0, 0.0)

    flight = gcs_mosaic.read_flight("map")           # one that is over, or written by another process

Places are canvas units of an island, x to the right and y down: one unit is about a pixel of the island's first frame. The folder
is that of every other flight: `gcs-mosaic serve`, `check` and `export` know it. What the program would say to an operator goes
to `say`, what it logs to the logger `gcs_mosaic`. Of settings only those that are given count, no file and no environment.
Pictures are decoded in processes of their own, which do not import the main module.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import cv2
import numpy as np

from gcs_mosaic.app.commands.batch import prefetching
from gcs_mosaic.app.inputs.event_log import EventLog
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.pipeline.resuming import OpenedFlight, runs_of, told_again
from gcs_mosaic.app.pipeline.resuming import open_flight as _open
from gcs_mosaic.config.settings_file import from_mapping
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.exif import captured_s
from gcs_mosaic.frames.pending_file import versioned
from gcs_mosaic.mavlink.messages import MavMessage, decode
from gcs_mosaic.messages import Frame, Notice, TriggerEvent, content_hash
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.store.records import EventRecord, FrameRecord, FrameState
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.store.tiles import tiles_in
from gcs_mosaic.triggers.shots import Shots
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.sightings import Sighting, sightings
from gcs_mosaic.views.tile_reader import EncodedTile, filled

logger = logging.getLogger(__name__)

Picture = str | Path | bytes | np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedOutline:
    """A frame as it is painted now. `outline`: (16, 2) canvas, clockwise from its top left; NaN above the horizon."""

    number: int
    name: str
    island: int
    outline: np.ndarray


class FlightReader:
    """What is known of a flight in a folder, read beside whoever writes it. Thread-safe."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._seen, self._view = -1, FlightView(folder)

    def frames(self) -> list[FrameRecord]:
        """All frames in the order in which they came: state, reason, size, original. Raises UsageError without a ledger."""
        return self._now().frames()

    def events(self) -> list[EventRecord]:
        """All camera events in the order in which they came, each with its frame's name. Raises UsageError without a ledger."""
        return self._now().events()

    def placements(self) -> list[PlacedOutline]:
        """The frames that the map is painted of, in the order in which they came."""
        table = self._now().table()
        return [
            PlacedOutline(number=one.number, name=one.name, island=one.island, outline=outline)
            for one, outline in zip(table.frames, table.outlines, strict=True)
        ]

    def tiles(self) -> Iterator[tuple[int, int, int, int]]:
        """Island, level, x and y of every tile that is painted."""
        for island, tile in tiles_in(self.folder):
            yield island, tile.z, tile.x, tile.y

    def tile(self, island: int, z: int, x: int, y: int) -> EncodedTile | None:
        """A tile for display, its holes filled from coarser ones: JPEG, or WebP with alpha; None where nothing was seen."""
        return filled(self.folder, island, Tile(z, x, y))

    def sightings(self, island: int, x: float, y: float) -> list[Sighting]:
        """Who saw a place of an island's canvas: each frame with the pixel of its original, the best look first."""
        return sightings(self._now(), island, x, y)

    def _now(self) -> FlightView:
        """A view of the newest revision: whoever has just added a frame finds it."""
        revision = last_revision(self.folder)
        if revision != self._seen:
            self._view, self._seen = FlightView(self.folder), revision
        return self._view


class Flight(FlightReader):
    """A flight that is being flown. For use by one thread; what is read may be read from any."""

    def __init__(self, opened: OpenedFlight, config: Config, say: Callable[[Notice], None]) -> None:
        super().__init__(opened.folder.path)
        with ExitStack() as stack:  # closed in reverse, also where something here raises
            stack.callback(opened.close)
            pipeline = Pipeline(self.folder, config, say, checkpoints=opened.checkpoints, shelf=opened.shelf)
            self._pipeline = stack.enter_context(closing(pipeline))
            self._driver, store = Driver(self._pipeline), self._pipeline.store
            self._preparation = stack.enter_context(closing(prefetching(self._pipeline, config)))
            self._event_log, self._shots = EventLog(store.ledger, config.pairing), Shots(config.shots)
            self._begin(opened)
            self._names = {frame.name for frame in store.ledger.frames()}
            self._closing = stack.pop_all()

    def add(self, picture: Picture, name: str | None = None) -> Done:
        """Place and paint a frame: a file's path, a file's bytes, or an array (h, w, 3) or (h, w), 8 or 16 bits, blue first.

        `name`: that of the file by default, else a number. Returns when the map on disk shows the outcome: what became of it
        and why (`state`, `reason`), its `island`, and which waiting frames came onto the map with it (`on_map`). No picture is
        an error: what cannot be decoded is DAMAGED, what shows nothing known is WAITING. Raises OSError for a file that cannot
        be read, ValueError for an array that is no picture.
        """
        frame = self._frame(picture, name)
        kept = self._driver.accept(frame)
        if kept is None:
            self._event_log.copy(frame, frame.received, of=self._pipeline.store.shown_by(frame))
        else:
            self._event_log.frame(frame, frame.received, fresh=True)
        self._event_log.save()
        if kept is None:
            self._driver.save()
            return Done(frame.name, FrameState.DUPLICATE, "the same picture has come before", None, {})
        return self._process(kept)

    def hear(self, message: MavMessage | TriggerEvent, received: float | None = None) -> bool:
        """Take in a camera message (112, 180, 263), which will be matched with its frame; False for any other message.

        `received`: `time.monotonic()` when it came; now by default.
        """
        now = time.monotonic() if received is None else received
        event = message if isinstance(message, TriggerEvent) else decode(message, now)
        if event is None:
            return False
        self._event_log.message(self._shots.hear(event), event.received)
        self._event_log.tick(event.received)
        self._event_log.save()
        return True

    def use_pause(self, seconds: float) -> None:
        """Use time in which no frame comes: adjust the map, connect its parts, repaint what has moved. May take some longer."""
        until = time.monotonic() + seconds
        while time.monotonic() < until and (self._pipeline.adjust_in_a_pause() or self._pipeline.repaint_some()):
            self._driver.save()
        self._driver.save()

    def finish(self) -> None:
        """End the flight: connect what can be connected, adjust and paint everything. Waiting frames are rejected."""
        for _ in self._driver.finish():
            pass
        self._event_log.close()
        self._event_log.save()
        self._pipeline.save()
        self._pipeline.checkpoint(at_once=True)

    def close(self) -> None:
        """Release the folder, as it is; to be gone on with by `open_flight(..., resume="always")`."""
        self._closing.close()

    def __enter__(self) -> Flight:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """The flight is finished, unless something was raised, and closed."""
        with closing(self):
            if kind is None:
                self.finish()

    def _begin(self, opened: OpenedFlight) -> None:
        store = self._pipeline.store
        if opened.folder.resumed:
            told = told_again(store.ledger.events(), store.ledger.frames(), runs_of(opened.saved))
            self._event_log.resume(told, self._shots, store.flight.started_utc, store.out)
            self._event_log.save()
            again = self._pipeline.resume(opened.saved)
            self._driver.save()
            for frame in again:
                self._process(frame)
        self._driver.save()
        self._pipeline.checkpoint(at_once=True)

    def _process(self, frame: Frame) -> Done:
        self._preparation.append(frame)
        prepared = self._preparation.next()
        assert prepared is not None, "it has just been appended"
        done = self._driver.process(prepared)
        self._pipeline.checkpoint()
        return done

    def _frame(self, picture: Picture, name: str | None) -> Frame:
        path = Path(picture) if isinstance(picture, str | Path) else Path()
        data = _bytes_of(picture)
        wanted = name or path.name or f"frame-{len(self._names) + 1:05}{'' if isinstance(picture, bytes) else '.png'}"
        known = (versioned(wanted, version) for version in range(1, len(self._names) + 2))
        self._names.add(unused := next(one for one in known if one not in self._names))
        return Frame(
            name=unused,
            path=path,
            content_hash=content_hash(data),
            size=len(data),
            received=time.monotonic(),
            modified=path.stat().st_mtime if path.name else time.time(),
            captured=captured_s(data),
            data=data,
        )


def open_flight(
    out: str | Path,
    settings: Mapping[str, Any] | None = None,
    *,
    resume: Literal["auto", "always", "never"] = "never",
    say: Callable[[Notice], None] = lambda notice: logger.info("%s", notice.text),
) -> Flight:
    """A new flight in the folder `out`, or beside an earlier one in it; with `resume`, that one is gone on with.

    `settings`: as in a settings file (`{"stitch": {"cover": {"enabled": False}}}`). Raises UsageError, in a sentence, before
    anything is written.
    """
    config = replace(from_mapping(Config, dict(settings or {}), "settings"), out=str(out), resume=resume, sources=())
    opened = _open(config)
    say(Notice(source="out", level="info", text=opened.folder.said))
    return Flight(opened, config, say)


def read_flight(folder: str | Path) -> FlightReader:
    """A flight that is over, or that another process writes; of several in the folder, the newest. Raises UsageError."""
    return FlightReader(find_flight(Path(folder)))


def _bytes_of(picture: Picture) -> bytes:
    if isinstance(picture, bytes):
        return picture
    if isinstance(picture, np.ndarray):
        if picture.dtype not in (np.uint8, np.uint16) or picture.ndim not in (2, 3) or not picture.size:
            raise ValueError(f"expected a picture (h, w, 3) of 8 or 16 bits, got {picture.shape} of {picture.dtype}")
        return bytes(cv2.imencode(".png", picture)[1])
    return Path(picture).read_bytes()
