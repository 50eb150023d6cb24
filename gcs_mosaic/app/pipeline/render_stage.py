"""Paints newly placed frames and repaints moved ones; a failure affects only the frame or tile concerned."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable, Sequence

from gcs_mosaic.app.waiting.prefetch import DecodedFrame, thumbnail
from gcs_mosaic.messages import Notice
from gcs_mosaic.render.repaint_queue import RepaintQueue, Step
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept, transaction
from gcs_mosaic.store.flight_store import FlightStore

logger = logging.getLogger(__name__)


MOST_TRIES = 3  # a failure this persistent will recur, and every try costs a frame's time


class PaintQueue(Kept):
    """Placements of these frames, and how often painting each has failed."""

    def __init__(self) -> None:
        self._placements: dict[str, Placement] = {}
        self._failures: dict[str, int] = {}

    def add(self, placements: Iterable[Placement]) -> None:
        """Add frames to be painted, or update their placements; frames given up are ignored."""
        self._placements |= {one.name: one for one in placements if self._failures.get(one.name, 0) < MOST_TRIES}

    def all(self) -> list[Placement]:
        """The frames to be painted, in the order added."""
        return list(self._placements.values())

    def remove(self, name: str) -> None:
        """The frame has been painted."""
        del self._placements[name]

    def forget(self, name: str) -> None:
        """The frame is not to be painted any more, if it waits for that."""
        self._placements.pop(name, None)

    def give_up(self, name: str) -> None:
        """Never try this frame again."""
        self._failures[name] = MOST_TRIES
        del self._placements[name]

    def fail(self, name: str) -> bool:
        """Count a failure to paint; returns whether to retry."""
        self._failures[name] = self._failures.get(name, 0) + 1
        if self._failures[name] < MOST_TRIES:
            return True
        self.give_up(name)
        return False


class RenderStage(Kept):
    """Applies a renderer's work to the map and notes it in the store.

    `whole` is all state that painting changes, restored when it fails; `load_original` returns a frame's pixels;
    `say` receives notices for the operator.
    """

    FIXED = frozenset({"_renderer", "_store", "_whole", "_load_original", "_say"})  # parts of `whole`

    def __init__(
        self,
        renderer: RepaintQueue,
        store: FlightStore,
        whole: Kept,
        load_original: Callable[[str], Bands | None],
        say: Callable[[Notice], None],
    ) -> None:
        self._renderer = renderer
        self._store = store
        self._whole = whole
        self._load_original = load_original
        self._say = say
        self._queue = PaintQueue()
        self._said = ""  # last repaint failure reported

    def follow(self, moved: Sequence[Placement], prepared: DecodedFrame | None) -> None:
        """Paint newly placed frames; note those that must be repainted elsewhere.

        Raises if the current frame (`prepared`) cannot be painted. A failure of another frame does not affect it: that one stays
        unpainted and is retried with the next frames, at most `MOST_TRIES` times.
        """
        self._queue.add(placement for placement in moved if not self._renderer.is_painted(placement.name))
        for placement in self._queue.all():
            if prepared is not None and prepared.frame.name == placement.name:
                self._paint_new(placement, prepared.image, prepared.thumbnail)
            else:
                self._paint_other(placement)
        self._renderer.follow(moved)

    def take_away(self, name: str) -> None:
        """Another frame shows all that this one does: it is painted no more."""
        self._queue.forget(name)
        self._renderer.take_away(name)

    def repaint_some(self) -> bool:
        """Repaint a little where it is most needed; False if there is nothing to do."""
        steps = self._renderer.next_steps()
        self._repaint(steps)
        return bool(steps)

    def settle(self, placements: Iterable[Placement]) -> None:
        """Decide the final place and brightness of everything by what is known now; `repaint_some` then paints it."""
        for steps in self._renderer.settling_steps(placements):
            self._repaint(steps)

    def repaint_all(self, placements: Iterable[Placement]) -> Generator[None, None, None]:
        """Repaint everything at its final place and brightness, step by step."""
        for steps in self._renderer.final_steps(placements):
            self._repaint(steps)
            yield

    def _paint_other(self, placement: Placement) -> None:
        name = placement.name
        try:
            with transaction(self._whole):
                image = self._load_original(name)
                if image is not None:
                    ground = image if placement.area is None else placement.area.filled(image)
                    self._paint_new(placement, image, thumbnail(ground))
                    return
        except Exception as error:
            logger.exception("%s could not be painted", name)
            then = "it is tried again" if self._queue.fail(name) else "it is not on the map"
            text = f"{name} found its place, but could not be painted ({error!r}): {then}"
            self._say(Notice(source="painting", level="error", text=text))
            return
        self._queue.give_up(name)
        text = f"{name} found its place, but its original is gone: it is not on the map"
        self._say(Notice(source="originals", level="error", text=text))

    def _paint_new(self, placement: Placement, image: Bands, small: Bands) -> None:
        changed = self._renderer.paint_new(image, small, placement, self._store.order_of(placement.name))
        self._store.note_tiles(changed)
        self._queue.remove(placement.name)

    def _repaint(self, steps: Sequence[Step]) -> None:
        """Do these steps together; if that raises, one by one, skipping and reporting those that fail."""
        try:
            with transaction(self._whole):
                changed = [step.do() for step in steps]
                for tiles in filter(None, changed):
                    self._store.note_tiles(tiles)
        except Exception as error:
            logger.exception("repainting has failed: %s", ", ".join(step.what for step in steps))
            if len(steps) > 1:
                for step in steps:
                    self._repaint([step])
                return
            with transaction(self._whole):
                steps[0].skip()
            self._tell(f"{steps[0].what} could not be repainted and stays as it is ({error!r})")

    def _tell(self, text: str) -> None:
        if text != self._said:  # the same fault on every tile is reported once
            self._say(Notice(source="painting", level="error", text=text))
        self._said = text
