"""The frames at hand: where each lies on the tiles, its picture, what it looks like."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass

from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.painting.layers import Store
from gcs_mosaic.stitch.painting.modes import Mode
from gcs_mosaic.stitch.painting.originals import LoadImage, Originals
from gcs_mosaic.stitch.painting.painted import Painted
from gcs_mosaic.stitch.painting.pixels import FramePicture, KeepBands, frame_picture
from gcs_mosaic.stitch.painting.placed import PlacedFrame, placed
from gcs_mosaic.stitch.painting.sights import LOOK_PIXELS, Sight
from gcs_mosaic.stitch.painting.warping import shrunk

LOOKS_AHEAD = 2  # frames that are being looked at while others are placed
PLACED_TOGETHER = 8  # frames whose places are worked out side by side


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """A frame as it was placed last; `frame` None where it sees no ground."""

    painted: Painted
    frame: PlacedFrame | None

    @property
    def nbytes(self) -> int:
        return 0 if self.frame is None else self.frame.nbytes


class Gallery:
    """All of it can be had again at any time, from `load_image`, so nothing here is ever put back. Places and sights are in the
    store."""

    def __init__(self, load_image: LoadImage, store: Store, mode: Mode, keep: KeepBands, pool: Executor) -> None:
        self._originals = Originals(load_image, pool)
        self._pool = pool
        self._store = store
        self._mode = mode
        self._keep: KeepBands = keep
        self._looking: dict[str, Future[Sight]] = {}

    def placed(self, painted: Painted) -> PlacedFrame | None:
        """The frame on the tiles of its level; None where it sees no ground. ValueError if that would be absurdly fine for it."""
        ((_, frame),) = self.all_placed([painted])
        return frame

    def all_placed(self, frames: Sequence[Painted]) -> Iterator[tuple[Painted, PlacedFrame | None]]:
        """Each of these frames with its place as in `placed`, in their order."""
        for first in range(0, len(frames), PLACED_TOGETHER):
            some = frames[first : first + PLACED_TOGETHER]
            known: list[_Placed | None] = [self._store.get(("placed", painted.name)) for painted in some]
            for painted, before, now in zip(some, known, self._each_placed(some, known), strict=True):
                if now is not before:
                    self._store.put(("placed", painted.name), now)
                yield painted, now.frame

    def _each_placed(self, frames: Sequence[Painted], known: Sequence[_Placed | None]) -> Iterator[_Placed]:
        def place(painted: Painted, before: _Placed | None) -> _Placed:
            if before is not None and before.painted == painted:
                return before
            return _Placed(painted, placed(painted, None if before is None else before.frame))

        return (map if len(frames) == 1 else self._pool.map)(place, frames, known)

    def take(self, painted: Painted, image: Bands) -> FramePicture:
        """Keep a frame's picture at hand, and what it looks like. ValueError if it does not fit."""
        picture = frame_picture(image, painted, self._keep)
        self._originals.put(painted.name, image)
        self._look(painted, picture)
        return picture

    def look_ahead(self, painted: Painted, image: Bands) -> None:
        """Keep a frame's picture at hand, and begin to look at it while other things are done. ValueError if it does not fit."""
        picture = frame_picture(image, painted, self._keep)
        self._originals.put(painted.name, image)
        while len(self._looking) >= LOOKS_AHEAD:
            self._take_look(next(iter(self._looking)))
        if self._mode.look is not None:
            self._looking[painted.name] = self._pool.submit(self._looked, painted, picture)

    def expect(self, name: str) -> None:
        """Begin to load the original that is wanted next, while other things are done."""
        self._originals.expect(name)

    def is_at_hand(self, name: str) -> bool:
        """Whether the frame's original need not be loaded."""
        return name in self._originals

    def picture(self, painted: Painted) -> FramePicture | None:
        """None if the original is gone."""
        image = self._originals.get(painted.name)
        return None if image is None else frame_picture(image, painted, self._keep)

    def sight(self, painted: Painted) -> Sight | None:
        """What the frame looks like, as far as that is known."""
        self._take_look(painted.name)
        sight: Sight | None = self._store.get(("sight", painted.name))
        return sight

    def has_seen(self, painted: Painted) -> bool:
        """Whether it is known what the frame looks like, or nobody wants to know."""
        sight = self.sight(painted)
        return self._mode.look is None or (sight is not None and sight.fits(painted))

    def can_see(self, painted: Painted) -> bool:
        """Whether it is known, or can be, what the frame looks like."""
        if self.has_seen(painted):
            return True
        picture = self.picture(painted)
        if picture is not None:
            self._look(painted, picture)
        return picture is not None

    def clear(self) -> None:
        self._originals.clear()
        self._looking.clear()

    def _look(self, painted: Painted, picture: FramePicture) -> None:
        self._looking.pop(painted.name, None)
        if self._mode.look is not None:
            self._store.put(("sight", painted.name), self._looked(painted, picture))

    def _looked(self, painted: Painted, picture: FramePicture) -> Sight:
        assert self._mode.look is not None
        return self._mode.look(shrunk(picture.image, LOOK_PIXELS), (painted.display, painted.dead))

    def _take_look(self, name: str) -> None:
        """Keep what a look has found, if one was begun. If it has raised, that is left to the next look at the frame: whoever is
        here may be at work on another one."""
        coming = self._looking.pop(name, None)
        if coming is not None and coming.exception() is None:
            self._store.put(("sight", name), coming.result())
