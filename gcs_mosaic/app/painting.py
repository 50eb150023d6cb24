"""Paints what has found its place and repaints what has moved, so that nothing that fails costs anything else."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence

from gcs_mosaic.app.method import Renderer
from gcs_mosaic.app.prefetch import DecodedFrame, thumbnail
from gcs_mosaic.app.unpainted import Unpainted
from gcs_mosaic.messages import Notice
from gcs_mosaic.render.repaint_queue import Step
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept, transaction
from gcs_mosaic.store.flight_store import FlightStore

logger = logging.getLogger(__name__)


class Painting(Kept):
    """What is done to the map by a painter and told to the store.

    `whole` is all that painting changes, and is put back when it fails; `load_original` gives a frame's picture;
    `say` is given what the operator should hear.
    """

    FIXED = frozenset({"_painter", "_store", "_whole", "_load_original", "_say"})  # parts of the whole

    def __init__(
        self,
        painter: Renderer,
        store: FlightStore,
        whole: Kept,
        load_original: Callable[[str], Bands | None],
        say: Callable[[Notice], None],
    ) -> None:
        self._painter = painter
        self._store = store
        self._whole = whole
        self._load_original = load_original
        self._say = say
        self._unpainted = Unpainted()
        self._said = ""  # of what could not be repainted

    def follow(self, moved: Sequence[Placement], prepared: DecodedFrame | None) -> None:
        """Paint what has found its place; note what must be painted elsewhere.

        If the frame in hand (`prepared`) cannot be painted, that is raised. It is not to pay for another one: that stays
        unpainted and is tried again with the next frames, at most `MOST_TRIES` times.
        """
        self._unpainted.add(placement for placement in moved if not self._painter.is_painted(placement.name))
        for placement in self._unpainted.all():
            if prepared is not None and prepared.frame.name == placement.name:
                self._paint_new(placement, prepared.image, prepared.thumbnail)
            else:
                self._paint_other(placement)
        self._painter.follow(moved)

    def repaint_some(self) -> bool:
        """Repaint a little where it is most needed; False if there is nothing to do."""
        steps = self._painter.next_steps()
        self._repaint(steps)
        return bool(steps)

    def repaint_all(self, placements: Iterable[Placement]) -> Iterator[None]:
        """Bring everything to its final place and brightness, step by step."""
        for steps in self._painter.final_steps(placements):
            self._repaint(steps)
            yield

    def _paint_other(self, placement: Placement) -> None:
        name = placement.name
        try:
            with transaction(self._whole):
                image = self._load_original(name)
                if image is not None:
                    self._paint_new(placement, image, thumbnail(image))
                    return
        except Exception as error:
            logger.exception("%s could not be painted", name)
            then = "it is tried again" if self._unpainted.fail(name) else "it is not on the map"
            text = f"{name} found its place, but could not be painted ({error!r}): {then}"
            self._say(Notice(source="painting", level="error", text=text))
            return
        self._unpainted.give_up(name)
        text = f"{name} found its place, but its original is gone: it is not on the map"
        self._say(Notice(source="originals", level="error", text=text))

    def _paint_new(self, placement: Placement, image: Bands, small: Bands) -> None:
        changed = self._painter.paint_new(image, small, placement, self._store.order_of(placement.name))
        self._store.note_tiles(changed)
        self._unpainted.remove(placement.name)

    def _repaint(self, steps: Sequence[Step]) -> None:
        """Do these steps together; each for itself if one of them raises, which is left out then and said."""
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
        if text != self._said:  # a fault that meets every tile is one fault
            self._say(Notice(source="painting", level="error", text=text))
        self._said = text
