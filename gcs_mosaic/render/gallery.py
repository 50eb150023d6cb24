"""Frames in use: their lattices on the tiles, their images, and their looks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass

from gcs_mosaic.render.blend_modes import Mode
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.looks import LOOK_PIXELS, Of, Sight
from gcs_mosaic.render.originals import LoadImage, OriginalsCache
from gcs_mosaic.render.painted import Painted
from gcs_mosaic.render.pixels import FramePicture, KeepBands, frame_picture
from gcs_mosaic.render.placed import PlacedFrame, placed
from gcs_mosaic.render.tile_cache import Store
from gcs_mosaic.render.warp import shrunk
from gcs_mosaic.stitch.arrays import Bands, ImageBGR
from gcs_mosaic.stitch.camera.dead_border import DeadBorder

LOOKS_AHEAD = 2  # frames analysed in the background while others are placed
PLACED_TOGETHER = 8  # frames whose lattices are computed in parallel


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """A frame as placed last; `frame` is None where it sees no ground."""

    painted: Painted
    frame: PlacedFrame | None

    @property
    def nbytes(self) -> int:
        return 0 if self.frame is None else self.frame.nbytes


class Gallery:
    """Everything here can be recomputed from `load_image` at any time, so nothing is ever restored. Lattices and sights are kept
    in the store."""

    def __init__(self, load_image: LoadImage, store: Store, mode: Mode, keep: KeepBands, pool: Executor) -> None:
        self._originals = OriginalsCache(load_image, pool)
        self._pool = pool
        self._store = store
        self._mode = mode
        self._keep: KeepBands = keep
        self._placing: dict[str, tuple[Painted, Future[_Placed]]] = {}
        self._looking: dict[str, Future[Sight]] = {}
        self._begun: tuple[str, Future[Sight]] | None = None  # of a frame that may never be painted

    def placed(self, painted: Painted) -> PlacedFrame | None:
        """The frame on the tiles of its level; None where it sees no ground. ValueError if the level is absurdly fine for it."""
        known = self._known_place(painted.name)
        if known is None or known.painted != painted:
            known = self._coming_place(painted) or _place(painted, known)
            self._store.put(("placed", painted.name), known)
        return known.frame

    def all_placed(self, frames: Sequence[Painted]) -> Iterator[tuple[Painted, PlacedFrame | None]]:
        """Each of these frames with its result of `placed`, in order; computed in parallel."""
        for first in range(0, len(frames), PLACED_TOGETHER):
            some = frames[first : first + PLACED_TOGETHER]
            if len(some) > 1:  # a single one may already be expected
                self.expect_places(some)
            yield from ((painted, self.placed(painted)) for painted in some)

    def expect_places(self, frames: Sequence[Painted]) -> None:
        """Begin to compute the lattices of a few frames that are needed next."""
        known = [(painted, self._known_place(painted.name)) for painted in frames]
        new = [(painted, before) for painted, before in known if before is None or before.painted != painted]
        self._placing = {one.name: (one, self._pool.submit(_place, one, before)) for one, before in new[1:]}

    def take(self, painted: Painted, image: Bands) -> FramePicture:
        """Keep a frame's image in memory, and analyse it. ValueError if it does not fit."""
        picture = frame_picture(image, painted, self._keep)
        self._originals.put(painted.name, image)
        self._look(painted, picture)
        return picture

    def look_ahead(self, painted: Painted, image: Bands) -> None:
        """Keep a frame's image in memory, and analyse it in the background. ValueError if it does not fit."""
        picture = frame_picture(image, painted, self._keep)
        self._originals.put(painted.name, image)
        while len(self._looking) >= LOOKS_AHEAD:
            self._take_look(next(iter(self._looking)))
        if self._mode.look is not None:
            self._looking[painted.name] = self._pool.submit(self._looked, painted, picture)

    def begin_look(self, name: str, image: Bands, display: Display, dead: DeadBorder) -> None:
        """Begin to analyse a frame that may be painted next, in the background; nothing is kept if it is not."""
        self._begun = None
        if self._mode.look is not None and display.fits(image):
            self._begun = (
                name,
                self._pool.submit(lambda: self._seen(display.picture(dead.filled(image)), (display, dead))),
            )

    def expect(self, name: str) -> None:
        """Begin to load the original that is needed next, in the background."""
        self._originals.expect(name)

    def is_at_hand(self, name: str) -> bool:
        """Whether the frame's original is in memory."""
        return name in self._originals

    def picture(self, painted: Painted) -> FramePicture | None:
        """The frame's image; None if the original is gone."""
        image = self._originals.get(painted.name)
        return None if image is None else frame_picture(image, painted, self._keep)

    def sight(self, painted: Painted) -> Sight | None:
        """The frame's look, if known."""
        self._take_look(painted.name)
        sight: Sight | None = self._store.get(("sight", painted.name))
        return sight

    def has_seen(self, painted: Painted) -> bool:
        """Whether the frame's look is known, or not needed."""
        sight = self.sight(painted)
        return self._mode.look is None or (sight is not None and sight.fits(painted))

    def can_see(self, painted: Painted) -> bool:
        """Whether the frame's look is known, or can be computed."""
        if self.has_seen(painted):
            return True
        picture = self.picture(painted)
        if picture is not None:
            self._look(painted, picture)
        return picture is not None

    def know(self, name: str, sight: Sight) -> None:
        """Take a frame's look that was made elsewhere."""
        self._store.put(("sight", name), sight)

    def clear(self) -> None:
        self._originals.clear()
        self._placing.clear()
        self._looking.clear()
        self._begun = None

    def _known_place(self, name: str) -> _Placed | None:
        known: _Placed | None = self._store.get(("placed", name))
        return known

    def _coming_place(self, painted: Painted) -> _Placed | None:
        """Result of an expected placing; None also if it raised, as the caller's own attempt will."""
        expected, coming = self._placing.pop(painted.name, (None, None))
        wanted = coming is not None and expected == painted and coming.exception() is None
        return coming.result() if wanted and coming is not None else None

    def _look(self, painted: Painted, picture: FramePicture) -> None:
        self._looking.pop(painted.name, None)
        if self._mode.look is not None:
            begun = self._begun_look(painted)
            self._store.put(("sight", painted.name), begun or self._looked(painted, picture))

    def _begun_look(self, painted: Painted) -> Sight | None:
        """Result of `begin_look`, if it was for this frame as it is painted."""
        begun, self._begun = self._begun, None
        if begun is None or begun[0] != painted.name or begun[1].exception() is not None:
            return None
        sight = begun[1].result()
        return sight if sight.fits(painted) else None

    def _looked(self, painted: Painted, picture: FramePicture) -> Sight:
        return self._seen(picture.image, (painted.display, painted.dead))

    def _seen(self, image: ImageBGR, of: Of) -> Sight:
        sight = seen_by(self._mode, image, of)
        assert sight is not None
        return sight

    def _take_look(self, name: str) -> None:
        """Store the result of a background look. If it raised, the frame's next look will: the caller may be working on another
        frame."""
        coming = self._looking.pop(name, None)
        if coming is not None and coming.exception() is None:
            self._store.put(("sight", name), coming.result())


def seen_by(mode: Mode, image: ImageBGR, of: Of) -> Sight | None:
    """What a mode wants to know of a frame's picture as displayed; None if nothing."""
    return None if mode.look is None else mode.look(shrunk(image, LOOK_PIXELS), of)


def _place(painted: Painted, before: _Placed | None) -> _Placed:
    return _Placed(painted, placed(painted, None if before is None else before.frame))
