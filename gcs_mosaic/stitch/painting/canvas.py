"""Frames onto tiles: added one by one as they come, recomposed when poses change, the same picture either way.

A tile's own layer is a fold, in capture order, over the frames painted at its level; coarser tiles are made of finer ones
(`overviews`). So a tile is a pure function of the `Painted` frames that touch it, however and whenever it was painted.
A tile that no longer follows its frames is *behind*: it goes on showing what it showed, with newer frames laid on top so
that nothing new is held back, until `repaint` has made it anew.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self

import cv2

from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.painting.grid import Tile
from gcs_mosaic.stitch.painting.lattice import FrameLattice, frame_lattice
from gcs_mosaic.stitch.painting.layers import LayerKey, LayerStore
from gcs_mosaic.stitch.painting.modes import BLENDS
from gcs_mosaic.stitch.painting.painted import Extent, Painted, PaintedFrames, TileKey, Turn
from gcs_mosaic.stitch.painting.stack import AT_ONCE, LoadTile, TilePicture, TileStack, chunks, top_level
from gcs_mosaic.stitch.painting.view import FrameView, KeepBands, frame_view
from gcs_mosaic.stitch.transaction import Kept

LoadImage = Callable[[str], Bands | None]
INTERPOLATIONS = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
BLOCK = 64  # tiles a side that are repainted together: so many that most frames are decoded once


@dataclass(frozen=True, slots=True, kw_only=True)
class CanvasSettings:
    """How frames are painted."""

    # Which frame shows where several do: seam (the one that sees best), edge (the paper's mixture), newest or first.
    blend: str = "seam"
    interpolation: str = "cubic"  # keeps 97 % of a frame's finest detail; "linear" 70-88 % in two thirds of the time
    memory_mb: int = 512  # tiles kept in memory, about 2,000; the others wait in a scratch file
    threads: int = 2  # how many tiles are painted at a time

    def __post_init__(self) -> None:
        for value, known in ((self.blend, list(BLENDS)), (self.interpolation, list(INTERPOLATIONS))):
            if value not in known:
                raise ValueError(f"{value!r} is not one of {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class _Fold:
    """Tiles that are being made anew together: with each the frames folded so far, which are those up to a turn."""

    turn: Turn | None
    tiles: Mapping[TileKey, tuple[Painted, ...]]


class Canvas(Kept):
    """All tiles of all islands. Used by one thread; the work on tiles is spread over a few of its own.

    `load_image(name)` gives a frame's original, or None if it is gone for good; `load_tile` a tile that an earlier run wrote
    (for `resume`); `scratch` is a folder for the tiles that do not fit into memory. `keep_bands`: whether tiles have, besides
    what is shown, all bands of the frames, which then must have the same ones.
    """

    FIXED = frozenset({"_blend", "_load_image", "_pool"})

    def __init__(
        self,
        load_image: LoadImage,
        settings: CanvasSettings | None = None,
        *,
        load_tile: LoadTile | None = None,
        scratch: Path | None = None,
        keep_bands: KeepBands = "none",
    ) -> None:
        self._settings = settings or CanvasSettings()
        self._blend = BLENDS[self._settings.blend]
        self._load_image = load_image
        self._keep_bands = keep_bands
        self._pool = ThreadPoolExecutor(self._settings.threads, thread_name_prefix="paint")
        self._store = LayerStore(self._settings.memory_mb << 20, scratch)
        self._stack = TileStack(self._store, self._pool, load_tile)
        self._frames = PaintedFrames()
        self._behind: dict[TileKey, float] = {}  # with how urgent each is
        self._left: dict[str, frozenset[TileKey]] = {}  # by frames that are on another level or island: where they were
        self._fold: _Fold | None = None
        self.gone: set[str] = set()  # frames whose originals are gone: their tiles stay as they are

    def paint(self, image: Bands, painted: Painted) -> set[TileKey]:
        """Add a frame; returns the tiles that may look different now (all levels).

        A frame that is not the last in capture order is laid on top all the same, and its tiles are behind.
        ValueError if the image does not fit the camera.
        """
        lattice = _lattice_of(painted)
        view = None if lattice is None else self._view(image, painted, lattice)
        self._fall_behind(self._frames.remove(painted.name))
        keys = self._frames.add(painted, () if lattice is None else lattice.tiles())
        self._fall_behind(key for key in keys if not self._frames.is_last(painted, key))
        if view is not None:
            self._lay_over(view, keys, "own")
        return self._refresh(keys, {painted.island})

    def resume(self, frames: Iterable[Painted]) -> None:
        """Know of frames that an earlier run painted. Their tiles are behind, and shown from `load_tile` until repainted."""
        for painted in frames:
            keys = self._register(painted)
            self._fall_behind(keys)
            self._stack.expect(keys)

    def move(self, frames: Iterable[Painted], urgency: float = 0.0) -> int:
        """Frames have new poses, gains, levels or islands; their old and new tiles are behind. Returns how many changed.

        `repaint` takes the most urgent tiles first.
        """
        changed = [p for p in frames if p.name not in self._frames or self._frames[p.name] != p]
        for painted in changed:
            old = self._frames.remove(painted.name)
            self._fall_behind(old | self._register(painted), urgency)
            elsewhere = frozenset(key for key in old if (key[0], key[1].z) != (painted.island, painted.level))
            if elsewhere:
                self._left[painted.name] = self._left.get(painted.name, frozenset()) | elsewhere
        return len(changed)

    def remove(self, names: Iterable[str]) -> None:
        """Take frames out; their tiles are behind."""
        for name in names:
            self._fall_behind(self._frames.remove(name))

    @property
    def behind(self) -> int:
        """How many tiles wait for `repaint`."""
        return len(self._behind)

    def repaint(self, block: int = BLOCK) -> Iterator[set[TileKey]]:
        """Bring all tiles that are behind up to date, a frame's work at a time; yields tiles that may look different now.

        `block` by `block` tiles change together: a large block decodes each original less often, a small one shows sooner.

        Stop between any two steps, call `paint` or `move` in between, go on or start again: a tile is replaced only when it
        is whole, and nothing is lost but the work since. One such iterator at a time.
        """
        try:
            while self._behind:
                yield self.repaint_step(block)
        finally:
            self._drop_fold()

    def repaint_step(self, block: int = BLOCK) -> set[TileKey]:
        """One step of `repaint`, to be called while tiles are behind: a frame's work, or the change itself."""
        fold = self._fold = self._fold or self._begun(block)
        # Asked anew at each step, because frames may come and move between steps.
        painted = self._frames.next_after(fold.turn, fold.tiles)
        if painted is not None:
            self._fold = self._with_frame(fold, painted)
            return set()
        return self._commit(fold)

    def skip_step(self, block: int = BLOCK) -> None:
        """Leave what `repaint_step` would do next for good: its tiles go on showing what they show."""
        fold = self._fold or self._begun(block)
        painted = self._frames.next_after(fold.turn, fold.tiles)
        keys = set(fold.tiles) if painted is None else self._shared(painted, fold)
        rest = self._without(fold, keys)
        self._fold = rest if rest.tiles else None

    def tile(self, island: int, tile: Tile) -> TilePicture | None:
        """A tile as it is shown; None if there is nothing on it. Its arrays are not to be changed."""
        return self._stack.shown((island, tile))

    def extent(self, island: int) -> Extent | None:
        """The canvas box around an island's tiles and the levels it has tiles of; None if it has none."""
        extent = self._frames.extent(island)
        return None if extent is None else extent._replace(coarsest=top_level(extent))

    @property
    def problem(self) -> str | None:
        """What the operator should know: the scratch file cannot grow, so memory does."""
        return self._store.problem

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give back all memory, threads and the scratch file."""
        self._pool.shutdown()
        self._store.close()

    def _fall_behind(self, keys: Iterable[TileKey], urgency: float = 0.0) -> None:
        for key in keys:
            self._behind[key] = max(urgency, self._behind.get(key, 0.0))

    def _register(self, painted: Painted) -> set[TileKey]:
        lattice = _lattice_of(painted)
        return self._frames.add(painted, () if lattice is None else lattice.tiles())

    def _view(self, image: Bands, painted: Painted, lattice: FrameLattice) -> FrameView:
        flag = INTERPOLATIONS[self._settings.interpolation]
        return frame_view(image, painted, lattice, self._blend, flag, self._keep_bands)

    def _lay_over(self, view: FrameView, keys: Iterable[TileKey], kind: Literal["own", "fresh"]) -> None:
        for some in chunks(sorted(keys), AT_ONCE):
            shown = [self._stack.own(key) if kind == "own" else self._store.get(LayerKey(*key, kind)) for key in some]
            steps = self._pool.map(lambda layer, key: view.over(layer, key[1]), shown, some)
            for key, layer in zip(some, steps, strict=True):
                self._store.put(LayerKey(*key, kind), layer)

    def _refresh(self, keys: set[TileKey], islands: Iterable[int]) -> set[TileKey]:
        return self._stack.refresh(keys, {island: self._frames.extent(island) for island in islands})

    def _next_block(self, side: int) -> list[TileKey]:
        """Tiles that are behind and close together, so that they share frames; the most urgent one is among them."""

        def block(key: TileKey) -> tuple[int, int, int, int]:
            return key[0], key[1].z, key[1].y // side, key[1].x // side

        ready = self._behind.keys() - self._kept() or self._behind.keys()
        _, chosen = min((-self._behind[key], block(key)) for key in ready)
        return [key for key in ready if block(key) == chosen]

    def _kept(self) -> set[TileKey]:
        """Tiles that go on showing frames which have left them until those are shown where they are now: no hole between."""
        arrived = [name for name in self._left if self._behind.keys().isdisjoint(self._frames.tiles_of(name))]
        for name in arrived:
            del self._left[name]
        return set[TileKey]().union(*self._left.values())

    def _begun(self, block: int) -> _Fold:
        return _Fold(None, dict.fromkeys(self._next_block(block), ()))

    def _shared(self, painted: Painted, fold: _Fold) -> set[TileKey]:
        return {key for key in self._frames.tiles_of(painted.name) if key in fold.tiles}

    def _with_frame(self, fold: _Fold, painted: Painted) -> _Fold:
        keys = self._shared(painted, fold)
        image = self._load_image(painted.name)
        lattice = _lattice_of(painted)
        if image is None or lattice is None:
            self.gone.add(painted.name)
            return replace(self._without(fold, keys), turn=painted.turn)
        self._lay_over(self._view(image, painted, lattice), keys, "fresh")
        return _Fold(painted.turn, {**fold.tiles, **{key: (*fold.tiles[key], painted) for key in keys}})

    def _without(self, fold: _Fold, keys: Collection[TileKey]) -> _Fold:
        """Give up tiles: they stay as they are."""
        for key in keys:
            self._store.put(LayerKey(*key, "fresh"), None)
            self._behind.pop(key, None)
        return replace(fold, tiles={key: frames for key, frames in fold.tiles.items() if key not in keys})

    def _commit(self, fold: _Fold) -> set[TileKey]:
        ready = {key for key, frames in fold.tiles.items() if frames == tuple(self._frames.on(key))}
        for key in ready:
            self._stack.set_own(key, self._store.get(LayerKey(*key, "fresh")))
            self._behind.pop(key, None)
        for key in fold.tiles:
            self._store.put(LayerKey(*key, "fresh"), None)
        self._fold = None
        return self._refresh(ready, {island for island, _ in ready})

    def _drop_fold(self) -> None:
        for key in self._fold.tiles if self._fold else ():
            self._store.put(LayerKey(*key, "fresh"), None)
        self._fold = None


def _lattice_of(painted: Painted) -> FrameLattice | None:
    return frame_lattice(painted.pose, painted.camera, painted.level, painted.relief, painted.dead)
