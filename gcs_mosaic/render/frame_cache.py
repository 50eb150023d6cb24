"""Frames in use: their lattices on the tiles, their images, and their looks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass

from gcs_mosaic.render.blend_maps import LOOK_PIXELS, BlendMaps, Of
from gcs_mosaic.render.blend_modes import Mode
from gcs_mosaic.render.frame_warp import FrameWarp, frame_warp
from gcs_mosaic.render.originals import LoadImage, OriginalsCache
from gcs_mosaic.render.pixels import FramePicture, KeepBands, frame_picture
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_cache import Store
from gcs_mosaic.render.warp import shrunk
from gcs_mosaic.stitch.arrays import Bands, ImageBGR
from gcs_mosaic.stitch.camera.picture_area import PictureArea, filled

LOOKS_AHEAD = 2  # frames analysed in the background while others are placed
WARPED_TOGETHER = 8  # frames whose lattices are computed in parallel


@dataclass(frozen=True, slots=True, eq=False)
class _KnownWarp:
    """A frame as placed last; `frame` is None where it sees no ground."""

    painted: RenderItem
    frame: FrameWarp | None

    @property
    def nbytes(self) -> int:
        return 0 if self.frame is None else self.frame.nbytes


class FrameCache:
    """Everything here can be recomputed from `load_image` at any time, so nothing is ever restored. Lattices and blend maps
    are kept in the store."""

    def __init__(self, load_image: LoadImage, store: Store, mode: Mode, keep: KeepBands, pool: Executor) -> None:
        self._originals = OriginalsCache(load_image, pool)
        self._pool = pool
        self._store = store
        self._mode = mode
        self._keep: KeepBands = keep
        self._warping: dict[str, tuple[RenderItem, Future[_KnownWarp]]] = {}
        self._looking: dict[str, Future[BlendMaps]] = {}
        self._begun: tuple[str, Future[BlendMaps]] | None = None  # of a frame that may never be painted

    def warp(self, painted: RenderItem) -> FrameWarp | None:
        """The frame on the tiles of its level; None where it sees no ground. ValueError if the level is absurdly fine for it."""
        known = self._known_warp(painted.name)
        if known is None or known.painted != painted:
            known = self._coming_warp(painted) or _warp(painted, known)
            self._store.put(("warp", painted.name), known)
        return known.frame

    def all_warps(self, frames: Sequence[RenderItem]) -> Iterator[tuple[RenderItem, FrameWarp | None]]:
        """Each of these frames with its result of `warp`, in order; computed in parallel."""
        for first in range(0, len(frames), WARPED_TOGETHER):
            some = frames[first : first + WARPED_TOGETHER]
            if len(some) > 1:  # a single one may already be expected
                self.expect_warps(some)
            yield from ((painted, self.warp(painted)) for painted in some)

    def expect_warps(self, frames: Sequence[RenderItem]) -> None:
        """Begin to compute the lattices of a few frames that are needed next."""
        known = [(painted, self._known_warp(painted.name)) for painted in frames]
        new = [(painted, before) for painted, before in known if before is None or before.painted != painted]
        self._warping = {one.name: (one, self._pool.submit(_warp, one, before)) for one, before in new[1:]}

    def take(self, painted: RenderItem, image: Bands) -> FramePicture:
        """Keep a frame's image in memory, and analyse it. ValueError if it does not fit."""
        picture = frame_picture(image, painted, self._keep)
        self._originals.put(painted.name, image)
        self._look(painted, picture)
        return picture

    def look_ahead(self, painted: RenderItem, image: Bands) -> None:
        """Analyse a frame in the background; it is painted much later, so its image is let go. ValueError if it does not fit."""
        picture = frame_picture(image, painted, self._keep)
        while len(self._looking) >= LOOKS_AHEAD:
            self._take_look(next(iter(self._looking)))
        if self._mode.look is not None:
            self._looking[painted.name] = self._pool.submit(self._looked, painted, picture)

    def begin_look(self, name: str, image: Bands, of: Of, area: PictureArea | None = None) -> None:
        """Begin to analyse a frame that may be painted next, in the background; nothing is kept if it is not."""
        self._begun = None
        display, dead = of
        if self._mode.look is not None and display.fits(image):
            self._begun = name, self._pool.submit(lambda: self._seen(display.picture(filled(image, dead, area)), of))

    def expect(self, name: str) -> None:
        """Begin to load the original that is needed next, in the background."""
        self._originals.expect(name)

    def is_at_hand(self, name: str) -> bool:
        """Whether the frame's original is in memory."""
        return name in self._originals

    def picture(self, painted: RenderItem) -> FramePicture | None:
        """The frame's image; None if the original is gone."""
        image = self._originals.get(painted.name)
        return None if image is None else frame_picture(image, painted, self._keep)

    def blend_maps(self, painted: RenderItem) -> BlendMaps | None:
        """The frame's look, if known."""
        self._take_look(painted.name)
        maps: BlendMaps | None = self._store.get(("maps", painted.name))
        return maps

    def has_seen(self, painted: RenderItem) -> bool:
        """Whether the frame's look is known, or not needed."""
        maps = self.blend_maps(painted)
        return self._mode.look is None or (maps is not None and maps.fits(painted))

    def can_see(self, painted: RenderItem) -> bool:
        """Whether the frame's look is known, or can be computed."""
        if self.has_seen(painted):
            return True
        picture = self.picture(painted)
        if picture is not None:
            self._look(painted, picture)
        return picture is not None

    def know(self, name: str, maps: BlendMaps) -> None:
        """Take a frame's look that was made elsewhere."""
        self._store.put(("maps", name), maps)

    def clear(self) -> None:
        self._originals.clear()
        self._warping.clear()
        self._looking.clear()
        self._begun = None

    def _known_warp(self, name: str) -> _KnownWarp | None:
        known: _KnownWarp | None = self._store.get(("warp", name))
        return known

    def _coming_warp(self, painted: RenderItem) -> _KnownWarp | None:
        """Result of an expected placing; None also if it raised, as the caller's own attempt will."""
        expected, coming = self._warping.pop(painted.name, (None, None))
        wanted = coming is not None and expected == painted and coming.exception() is None
        return coming.result() if wanted and coming is not None else None

    def _look(self, painted: RenderItem, picture: FramePicture) -> None:
        self._looking.pop(painted.name, None)
        if self._mode.look is not None:
            begun = self._begun_look(painted)
            self._store.put(("maps", painted.name), begun or self._looked(painted, picture))

    def _begun_look(self, painted: RenderItem) -> BlendMaps | None:
        """Result of `begin_look`, if it was for this frame as it is painted."""
        begun, self._begun = self._begun, None
        if begun is None or begun[0] != painted.name or begun[1].exception() is not None:
            return None
        maps = begun[1].result()
        return maps if maps.fits(painted) else None

    def _looked(self, painted: RenderItem, picture: FramePicture) -> BlendMaps:
        return self._seen(picture.image, (painted.display, painted.dead))

    def _seen(self, image: ImageBGR, of: Of) -> BlendMaps:
        maps = seen_by(self._mode, image, of)
        assert maps is not None
        return maps

    def _take_look(self, name: str) -> None:
        """Store the result of a background look. If it raised, the frame's next look will: the caller may be working on another
        frame."""
        coming = self._looking.pop(name, None)
        if coming is not None and coming.exception() is None:
            self._store.put(("maps", name), coming.result())


def seen_by(mode: Mode, image: ImageBGR, of: Of) -> BlendMaps | None:
    """What a mode wants to know of a frame's picture as displayed; None if nothing."""
    return None if mode.look is None else mode.look(shrunk(image, LOOK_PIXELS), of)


def _warp(painted: RenderItem, before: _KnownWarp | None) -> _KnownWarp:
    return _KnownWarp(painted, frame_warp(painted, None if before is None else before.frame))
