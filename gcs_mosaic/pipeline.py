"""A frame's way through the program: the same for a live flight and for a folder of frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.config import Config
from gcs_mosaic.events import DamagedFile, DroppedFrame, Frame, Notice
from gcs_mosaic.flight.originals import is_intact
from gcs_mosaic.flight.records import Accounts, FrameState
from gcs_mosaic.frames.load import Unreadable, load_image
from gcs_mosaic.painter import Painter
from gcs_mosaic.paper import PaperPainter
from gcs_mosaic.prepare import Prepared, Unprepared, thumbnail
from gcs_mosaic.recorder import Recorder
from gcs_mosaic.stitch.adjusting.background import WorkerProcess
from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.matching.features import Features, extract
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.observer import Observer
from gcs_mosaic.stitch.painting.painted import Painted, TileKey
from gcs_mosaic.stitch.paper.mosaic import PaperMosaic
from gcs_mosaic.stitch.placement import Placement, Rejection, Waiting


@dataclass(frozen=True, slots=True)
class Done:
    """What became of a frame, for the operator. `seconds` by stage."""

    name: str
    state: FrameState
    reason: str | None
    island: int | None
    seconds: dict[str, float]


class Pipeline:
    """Owns the mosaic, the canvas and the output folder of one flight. Used by one thread.

    `say` is given what the operator should hear; `published(revision, tiles)` is called when tiles are on disk. `punctual`:
    the same frames always give the same map, however fast the machine is. `observer` looks on while frames are placed. `utc`
    tells the time that is written into documents.
    """

    def __init__(
        self,
        out: Path,
        config: Config,
        say: Callable[[Notice], None],
        published: Callable[[int, Iterable[TileKey]], None] = lambda revision, tiles: None,
        *,
        punctual: bool = False,
        observer: Observer | None = None,
        utc: Callable[[], float] = time.time,
    ) -> None:
        self.recorder = Recorder(out, config, published, utc)
        self._worker = WorkerProcess()
        self.mosaic: Mosaic | PaperMosaic
        self._painter: Painter | PaperPainter
        if config.method == "paper":
            self.mosaic = PaperMosaic(config.paper, config.reduction)
            self._painter = PaperPainter(self.mosaic)
        else:
            self.mosaic = Mosaic(config.stitch, self._worker, punctual=punctual, observer=observer)
            self._painter = Painter(self.load_original, self._note_painted, config.paint, scratch=out)
        self.taken_in = 0  # files, whatever became of them
        self._said_problems: dict[str, str | None] = {}
        self._reduction = config.reduction
        self._feature_settings = config.stitch.features
        self._say = say
        self._orders: dict[str, int] = {}
        self._places: dict[str, tuple[Path, str]] = {}  # original and content hash by frame name
        self._names: dict[str, str] = {}  # first frame's name by content hash

    @property
    def has_repaints(self) -> bool:
        """Whether some frames lie elsewhere than where they are painted."""
        return self._painter.has_repaints

    def accounts(self) -> Accounts:
        return self.recorder.ledger.accounts()

    def features_of(self, image: Bands) -> Features:
        """What frames are placed by. May be called from any thread."""
        if isinstance(self.mosaic, PaperMosaic):
            return self.mosaic.features_of(image)
        return extract(image, self._feature_settings, self._reduction)

    # Frames come in

    def accept(self, frame: Frame) -> Frame | None:
        """Write down that a frame has come, and keep its original; returns the frame to work off, as it is kept.

        None if the same picture came before. After DiskFull nothing has happened: tell it again.
        """
        earlier = self._names.get(frame.content_hash)
        if earlier is not None:
            self.recorder.accept_duplicate(frame, earlier)
            self.taken_in += 1
            return None
        kept, said = self.recorder.accept(frame)
        self.taken_in += 1
        self._names[frame.content_hash] = frame.name
        self._orders[frame.name] = len(self._orders)
        self._places[frame.name] = (kept.path, frame.content_hash)
        for notice in said:
            self._say(notice)
        return kept

    def accept_damaged(self, damaged: DamagedFile) -> None:
        """Write down that a file is not whole."""
        self.recorder.accept_damaged(damaged)
        self.taken_in += 1

    def accept_dropped(self, dropped: DroppedFrame) -> None:
        """Write down that there was no room for a stream's frame."""
        self.recorder.accept_dropped(dropped)
        self.taken_in += 1

    # Frames are worked off

    def work_off(self, prepared: Prepared | Unprepared) -> Done:
        """Place a frame, paint it and whatever finds its place because of it. `save` is to follow."""
        name = prepared.frame.name
        try:
            return self._work_off(prepared)
        except Exception as error:  # whatever is wrong with one frame must not end the flight, nor go unsaid
            reason = f"it could not be worked off ({error!r})"
            self._say(Notice(source="pipeline", level="error", text=f"{name}: {reason}"))
            self.mosaic.forget(name)
            self._settle(name, FrameState.REJECTED, reason)
            return Done(name, FrameState.REJECTED, reason, None, {})

    def _work_off(self, prepared: Prepared | Unprepared) -> Done:
        name = prepared.frame.name
        if isinstance(prepared, Unprepared):
            self._names.pop(prepared.frame.content_hash, None)  # it may come again, and be readable then
            self._settle(name, FrameState.DAMAGED, prepared.reason)
            return Done(name, FrameState.DAMAGED, prepared.reason, None, {})
        self.recorder.changes.sizes[name] = (prepared.features.width, prepared.features.height)
        start = time.perf_counter()
        outcome = self.mosaic.place(prepared.features, name)
        self._adjust()
        placed = time.perf_counter()
        state, reason = _state_of(outcome)
        self._settle(name, state, reason)
        self._paint_moved(prepared)
        seconds = {"place": placed - start, "paint": time.perf_counter() - placed}
        island = outcome.island if isinstance(outcome, Placement) else None
        return Done(name, state, reason, island, prepared.seconds | seconds)

    def repaint_some(self) -> bool:
        """Use spare time to paint a moved frame where it lies now; False if there is nothing to do. `save` is to follow."""
        changed = self._painter.repaint_some()
        self._say_problem("canvas", self._painter.canvas.problem)
        self.recorder.changes.tiles += [changed] if changed else []
        return changed is not None

    def adjust_in_a_pause(self) -> bool:
        """Use a pause in the flight to adjust every island that has grown. `save` is to follow.

        To be called again while it returns True: the adjustment is under way in the background.
        """
        under_way = self.mosaic.adjust_in_a_pause()
        self._say_problem("adjustment", self.mosaic.problem)
        self._paint_moved(None)
        return under_way

    def finish(self) -> Iterator[None]:
        """The flight is over: try once more what waits, adjust everything, reject the rest, paint all, step by step.

        `save` may be called after each step.
        """
        self.mosaic.retry_waiting()
        self.mosaic.adjust(everything=True)
        self._paint_moved(None)
        for rejection in self.mosaic.finish():
            self._settle(rejection.name, FrameState.REJECTED, rejection.reason)
        yield
        for changed in self._painter.repaint_all(self.mosaic.placements()):
            self.recorder.changes.tiles += [changed] if changed else []
            yield

    def _paint_moved(self, prepared: Prepared | None) -> None:
        """Paint what has found its place; note what must be painted elsewhere."""
        moved = self.mosaic.moved()
        self.recorder.changes.placements |= {placement.name: placement for placement in moved}
        for placement in moved:
            if not self._painter.is_painted(placement.name):
                self._settle(placement.name, FrameState.PLACED, None)
                self._paint_new(placement, prepared)
        self._painter.follow(moved)

    def _paint_new(self, placement: Placement, prepared: Prepared | None) -> None:
        order = self._orders[placement.name]
        if prepared is not None and prepared.frame.name == placement.name:
            self.recorder.changes.tiles.append(
                self._painter.paint_new(prepared.image, prepared.thumbnail, placement, order)
            )
            return
        image = self.load_original(placement.name)
        if image is None:
            text = f"{placement.name} found its place, but its original is gone: it is not on the map"
            self._say(Notice(source="originals", level="error", text=text))
            return
        self.recorder.changes.tiles.append(self._painter.paint_new(image, thumbnail(image), placement, order))

    def _adjust(self) -> None:
        """What goes wrong here is not the fault of the frame that has just been placed."""
        try:
            self.mosaic.adjust()
        except Exception as error:  # a map that cannot be bettered is still a map
            text = f"the map could not be adjusted ({error!r})"
            self._say(Notice(source="adjustment", level="error", text=text))
        self._say_problem("adjustment", self.mosaic.problem)

    def _say_problem(self, source: str, problem: str | None) -> None:
        if problem and problem != self._said_problems.get(source):
            self._say(Notice(source=source, level="warning", text=problem))
        self._said_problems[source] = problem

    def load_original(self, name: str, reduction: int | None = None) -> Bands | None:
        """A frame as it came, reduced as in all of this flight or by another factor; None if it is gone or has changed."""
        path, content_hash = self._places[name]
        if not is_intact(path, content_hash):
            return None
        image = load_image(path, reduction=reduction or self._reduction)
        return None if isinstance(image, Unreadable) else image

    def _note_painted(self, painted: Painted) -> None:
        self.recorder.changes.painted[painted.name] = painted
        assert isinstance(self.mosaic, Mosaic), "the paper's painter tells of nothing painted"
        self.mosaic.hold(painted.name, painted.pose, painted.camera)

    def _settle(self, name: str, state: FrameState, reason: str | None) -> None:
        self.recorder.changes.states[name] = (state, reason)

    def save(self) -> float:
        """Write everything that has changed; returns the seconds it took. After DiskFull call it again."""
        start = time.perf_counter()
        self.recorder.save(self._painter.canvas, self.mosaic.islands, self.mosaic.frame_counts())
        return time.perf_counter() - start

    def close(self) -> None:
        """Let go of everything; what is not saved is lost."""
        self._worker.close()
        self._painter.close()
        self.recorder.close()


def _state_of(outcome: Placement | Waiting | Rejection) -> tuple[FrameState, str | None]:
    match outcome:
        case Placement():
            return FrameState.PLACED, None
        case Waiting():
            return FrameState.WAITING, None
        case Rejection():
            return FrameState.REJECTED, outcome.reason
