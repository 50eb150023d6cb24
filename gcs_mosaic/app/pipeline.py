"""A frame's way through the program: the same for a live flight and for a folder of frames."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from gcs_mosaic.app.method import method_of
from gcs_mosaic.app.painting import Painting
from gcs_mosaic.app.prefetch import DecodedFrame, UndecodableFrame
from gcs_mosaic.app.resuming import settings_of, utc_of_zero
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.messages import Frame, Notice
from gcs_mosaic.render.painted import Painted, TileKey
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.bundle.worker import WorkerProcess
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.placement import Covered, Outcome, Placement, Rejection, Waiting
from gcs_mosaic.stitch.transaction import Kept, Snapshot, transaction
from gcs_mosaic.store.checkpoint import Checkpoints
from gcs_mosaic.store.flight_store import FlightStore
from gcs_mosaic.store.records import Accounts, FrameState, IslandRecord
from gcs_mosaic.store.retry import Retry, at_once
from gcs_mosaic.store.stages import stage

logger = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Done:
    """What became of a frame, for the operator. `seconds` by stage."""

    name: str
    state: FrameState
    reason: str | None
    island: int | None
    seconds: dict[str, float]
    covered_by: str | None = None
    on_map: tuple[str, ...] = ()  # frames that have their place since: this one, and such as waited for it


class Pipeline(Kept):
    """Owns the mosaic, the canvas and the output folder of one flight. Used by one thread.

    A frame is placed and painted, or it is rejected and all is as if it had never come, whatever was raised on the way. What
    is no fault of it does not cost it: an island that cannot be adjusted stays as it was, another frame that cannot be
    painted stays unpainted and is tried again with the next ones, a part of the map that cannot be repainted
    goes on showing what it shows. All that is said.

    `say` is given what the operator should hear; `published(revision, tiles)` is called when tiles are on disk. `punctual`:
    the same frames always give the same map, however fast the machine is. `paint_live`: each frame is painted as it comes, not
    all in the end. `observer` looks on while frames are placed. `utc` and `retry` are the store's;
    `checkpoints`: where the flight is saved to be resumed from, if it is to be.
    """

    FIXED = frozenset({"_worker", "_say", "features_of", "_checkpoints", "_settings"})

    def __init__(
        self,
        out: Path,
        config: Config,
        say: Callable[[Notice], None],
        published: Callable[[int, Iterable[TileKey]], None] = lambda revision, tiles: None,
        *,
        punctual: bool = False,
        paint_live: bool = True,
        observer: Observer | None = None,
        utc: Callable[[], float] = time.time,
        retry: Retry = at_once,
        checkpoints: Checkpoints | None = None,
    ) -> None:
        self.store = FlightStore(
            out,
            originals=config.originals,
            tiles=config.tiles,
            canvas=config.paint.canvas,
            published=published,
            utc=utc,
            retry=retry,
        )
        self._worker = WorkerProcess()
        parts = self._worker, self.load_original, self._note_painted, out, observer
        method = method_of(config, *parts, punctual=punctual, paint_live=paint_live)
        self.mosaic, self._painter = method.stitcher, method.renderer
        # Features of an image, by `reduction`: what frames are placed by. May be called from any thread.
        self.features_of, self.feature_pixels = method.features_of, method.feature_pixels
        self._said_problems: dict[str, str | None] = {}  # what was said last, by source or by what was tried
        self._reduction = config.reduction
        self._processed: dict[str, None] = {}  # names of frames, in that order
        self._settings = settings_of(config)
        self._checkpoints = checkpoints
        self._say = say
        self._painting = Painting(self._painter, self.store, self, self.load_original, say)

    @property
    def has_repaints(self) -> bool:
        """Whether some frames lie elsewhere than where they are painted."""
        return self._painter.has_repaints

    def accounts(self) -> Accounts:
        return self.store.accounts()

    # Resuming

    def resume(self, saved: Snapshot) -> list[Frame]:
        """Go on with the flight that the folder holds, from what was saved of it by `checkpoint`.

        Returns the frames that are still to be processed, in the order in which they came. `save` is to follow.
        """
        self.load(saved)
        shown = [painted for island in self.store.ledger.islands() for painted in self.store.ledger.painted(island.id)]
        on_map = [placement.name for placement in self.mosaic.placements()]
        on_map += [covered.name for covered in self.mosaic.covered()]
        again = self.store.resume(self._processed.keys(), on_map)
        self.store.remove_tiles_but(self._painter.resume(shown))
        changes = self.store.changes
        changes.placements = {placement.name: placement for placement in self.mosaic.placements()}
        changes.painted = {painted.name: painted for painted in self._painter.painted()}
        changes.covered = {covered.name: covered for covered in self.mosaic.covered()}
        changes.states = {
            **dict.fromkeys(changes.placements, (FrameState.PLACED, None)),
            **dict.fromkeys(changes.covered, (FrameState.COVERED, None)),
            **{waiting.name: (FrameState.WAITING, None) for waiting in self.mosaic.waiting()},
            **{frame.name: (frame.state, frame.reason) for frame in self.store.ledger.frames(FrameState.REJECTED)},
        }
        return again

    def checkpoint(self, *, at_once: bool = False) -> None:
        """Write down what is known, to be resumed from; now, or when it costs little. After `save`."""
        if self._checkpoints is not None:
            self._checkpoints.write(self._state, self.store.ledger.make_durable, at_once=at_once)
            self._say_problem("checkpoint", self._checkpoints.problem)

    def _state(self) -> Snapshot:
        return {"settings": self._settings, "utc_of_zero": utc_of_zero(), "pipeline": self.saved()}

    # Frames come in

    def accept(self, frame: Frame) -> Frame | None:
        """Write down that a frame has come, and keep its original; returns the frame to process, as it is kept.

        None if the same picture came before.
        """
        kept, said = self.store.accept(frame)
        for notice in said:
            self._say(notice)
        return kept

    # Frames are processed

    def process(self, prepared: DecodedFrame | UndecodableFrame) -> Done:
        """Place a frame, paint it and whatever finds its place because of it. `save` is to follow."""
        name = prepared.frame.name
        try:
            with transaction(self):
                done = self._process(prepared)
                self._processed[name] = None
                return done
        except Exception as error:  # whatever is wrong with one frame must not end the flight, nor go unsaid
            logger.exception("%s could not be processed", name)
            reason = f"it could not be processed ({error!r})"
            self._say(Notice(source="pipeline", level="error", text=f"{name}: {reason}"))
            self._processed[name] = None
            self.store.settle(name, FrameState.REJECTED, reason)
            return Done(name, FrameState.REJECTED, reason, None, {})

    def _process(self, prepared: DecodedFrame | UndecodableFrame) -> Done:
        name = prepared.frame.name
        if isinstance(prepared, UndecodableFrame):
            self.store.may_come_again(prepared.frame)
            self.store.settle(name, FrameState.DAMAGED, prepared.reason)
            return Done(name, FrameState.DAMAGED, prepared.reason, None, {})
        self.store.changes.sizes[name] = (prepared.features.width, prepared.features.height)
        start = time.perf_counter()
        self._painter.begin_look(name, prepared.image)
        with stage("place", name):
            in_sight = self._painter.in_sight(prepared.features, prepared.image)
            outcome = self.mosaic.place(in_sight, name, self.store.order_of(name))
        with stage("adjust", name):
            self._adjusted(self.mosaic.adjust)
        placed = time.perf_counter()
        state, reason = _state_of(outcome)
        self.store.settle(name, state, reason)
        covered_by = self.store.changes.cover(outcome) if isinstance(outcome, Covered) else None
        with stage("paint", name):
            found = self._paint_moved(prepared)
        seconds = {"place": placed - start, "paint": time.perf_counter() - placed}
        island = outcome.island if isinstance(outcome, Placement) else None
        on_map = (*found, name) if covered_by else found
        return Done(name, state, reason, island, prepared.seconds | seconds, covered_by, on_map)

    def repaint_some(self) -> bool:
        """Use spare time to paint a moved frame where it lies now; False if there is nothing to do. `save` is to follow."""
        with stage("repaint", ""):
            some = self._painting.repaint_some()
        self._say_problem("canvas", self._painter.canvas.problem)
        return some

    def adjust_in_a_pause(self) -> bool:
        """Use a pause in the flight to adjust every island that has grown. `save` is to follow.

        To be called again while it returns True: the adjustment is under way in the background.
        """
        self.store.in_a_pause = True
        under_way = self._adjusted(self.mosaic.adjust_in_a_pause) or self._connected_some()
        with transaction(self):
            self._paint_moved(None)
        return bool(under_way)

    def _connected_some(self) -> bool:
        """Compare some frames that look alike and are not connected; whether there are more."""
        try:
            more = self.mosaic.connect_some()
        except Exception as error:
            logger.exception("frames could not be compared")
            self._say_problem(
                "islands", f"some frames could not be compared with those that look like them ({error!r})"
            )
            more = True  # maybe; what has raised is not compared again, so this comes to an end
        self._adjusted(self.mosaic.adjust)
        return more

    def finish(self) -> Iterator[None]:
        """The flight is over: settle it, then paint all, step by step. `save` may be called after each step."""
        yield from self.settle()
        yield from self.repaint_all()

    def settle(self, may_connect: Callable[[], bool] = lambda: True) -> Iterator[None]:
        """The flight is over: connect what can be, adjust everything, reject the rest, step by step.

        To be gone through to its end, or frames stay waiting; when time is short, `may_connect` says so. It tells whether
        more frames may be compared that are not connected: a map that is painted comes before one that is in fewer parts.
        """
        self.store.in_a_pause = True
        self._tried(self.mosaic.retry_waiting, "a frame that waits could not be tried again")
        while self._connected_some():
            if not may_connect():
                text = "there was no time to connect more parts of the map: stitch goes on with it"
                self._say(Notice(source="adjustment", level="info", text=text))
                break
            with transaction(self):
                self._paint_moved(None)
            yield
        self._tried(self.mosaic.retry_waiting, "a frame that waits could not be tried again")
        self._adjusted(partial(self.mosaic.adjust, everything=True))
        with transaction(self):
            self._paint_moved(None)
            for rejection in self.mosaic.finish():
                self.store.settle(rejection.name, FrameState.REJECTED, rejection.reason)
        yield

    def repaint_all(self) -> Iterator[None]:
        """Bring everything to its final place and brightness, step by step; to be left off whenever time is over."""
        yield from self._painting.repaint_all(self.mosaic.placements())

    def _paint_moved(self, prepared: DecodedFrame | None) -> tuple[str, ...]:
        """Paint what has found its place, and return the names; note what must be painted elsewhere."""
        moved = self.mosaic.moved()
        self.store.changes.placements |= {placement.name: placement for placement in moved}
        found = tuple(placement.name for placement in moved if not self._painter.is_painted(placement.name))
        for name in found:
            self.store.settle(name, FrameState.PLACED, None)
        self._painting.follow(moved, prepared)
        return found

    def _adjusted(self, adjust: Callable[[], T]) -> T | None:
        """What goes wrong here is not the fault of the frame that has just been placed: a map is a map, bettered or not."""
        found = self._tried(adjust, "the map could not be adjusted")
        self._say_problem("adjustment", self.mosaic.problem)
        return found

    def _tried(self, attempt: Callable[[], T], otherwise: str) -> T | None:
        """What it returns; None if it raises. A fault that comes again at every frame is said and logged once."""
        try:
            found = attempt()
        except Exception as error:
            text = f"{otherwise} ({error!r})"
            if text != self._said_problems.get(otherwise):
                logger.exception("%s", otherwise)
                self._say(Notice(source="adjustment", level="error", text=text))
            self._said_problems[otherwise] = text
            return None
        self._said_problems.pop(otherwise, None)
        return found

    def _say_problem(self, source: str, problem: str | None) -> None:
        if problem and problem != self._said_problems.get(source):
            self._say(Notice(source=source, level="warning", text=problem))
        self._said_problems[source] = problem

    def load_original(self, name: str, reduction: int | None = None) -> Bands | None:
        """A frame as it came, reduced as in all of this flight or by another factor; None if it is gone or has changed."""
        data = self.store.original(name)
        if data is None:
            return None
        image = decode_image(data, reduction=reduction or self._reduction)
        return None if isinstance(image, Unreadable) else image

    def _note_painted(self, painted: Painted) -> None:
        self.store.changes.painted[painted.name] = painted

    def save(self) -> float:
        """Write everything that has changed; returns the seconds it took."""
        start = time.perf_counter()
        mosaic = self.mosaic
        islands = [IslandRecord(id=island.number, merged_into=island.merged_into) for island in mosaic.islands]
        self.store.save(self._painter.canvas, islands, mosaic.frame_counts(), mosaic.held_out)
        return time.perf_counter() - start

    def close(self) -> None:
        """Let go of everything; what is not saved is lost."""
        if self._checkpoints is not None:
            self._checkpoints.close()
        self._worker.close()
        self._painter.close()
        self.store.close()


def _state_of(outcome: Outcome) -> tuple[FrameState, str | None]:
    match outcome:
        case Placement():
            return FrameState.PLACED, None
        case Covered():
            return FrameState.COVERED, None
        case Waiting():
            return FrameState.WAITING, None
        case Rejection():
            return FrameState.REJECTED, outcome.reason
