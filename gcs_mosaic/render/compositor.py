"""Frames onto tiles: added one by one, repainted when poses change, with the same result either way.

Which frame shows where is decided first, on cells, by a fold over the frames in capture order (`cells`); pixels are only made
where that changes the result, and once (`plans`, `pixels`). Coarser tiles are made from finer ones (`overviews`). So a tile is
a pure function of the `RenderItem`s around it, however and whenever it was painted. A tile that no longer matches its frames
is *stale* (`behind`): it stays displayed, with newer frames laid on top so that nothing new is held back, until `repaint` has
made it again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from gcs_mosaic.render.blend_maps import BlendMaps
from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.blending import mix, mix_pixels
from gcs_mosaic.render.cells import around, grouped, in_blocks
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.frame_cache import FrameCache
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.originals import LoadImage
from gcs_mosaic.render.pixels import FramePicture, KeepBands, Part
from gcs_mosaic.render.plans import Plan, Recipe
from gcs_mosaic.render.pyramid import LoadTile, TilePicture, TileStack, top_level
from gcs_mosaic.render.render_list import INSET_LEVELS, Extent, RenderEntry, RenderItem, RenderList, TileKey, Turn
from gcs_mosaic.render.territory import EXPECTED, Territory
from gcs_mosaic.render.tile_cache import Layer, Store
from gcs_mosaic.render.tile_grid import Tile, ancestor
from gcs_mosaic.render.tile_maker import TileMaker
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.transaction import Kept, Snapshot

logger = logging.getLogger(__name__)

INTERPOLATIONS = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
BLOCK = 96  # tiles a side repainted together: large enough that most frames are decoded once
FOLDED = 24  # tiles a side whose cells are decided together: 25 MB


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositorSettings:
    """How frames are painted."""

    # How overlapping frames are blended: seam (the best view), edge (the paper's blending), newest or first.
    blend: str = "seam"
    interpolation: str = "cubic"  # keeps 97 % of a frame's finest detail; "linear" 70-88 % in two thirds of the time
    memory_mb: int = 96  # tiles and looks kept in memory, about 300; the others go to a scratch file
    threads: int = 2  # number of tiles painted in parallel

    def __post_init__(self) -> None:
        for value, known in ((self.blend, list(MODES)), (self.interpolation, list(INTERPOLATIONS))):
            if value not in known:
                raise ValueError(f"{value!r} is not one of {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class _Fold:
    """Tiles whose cells are being decided again, each with the frames folded so far: those up to a turn, `laid` in number."""

    turn: Turn | None
    tiles: Mapping[TileKey, tuple[RenderItem, ...]]
    laid: int = 0


@dataclass(frozen=True, slots=True)
class _Making:
    """Tiles whose pixels are being made: their plans, and the frames still to be warped, in capture order."""

    plans: Mapping[TileKey, Plan]
    left: tuple[str, ...]
    changes: int  # number of changes of cells and frames when the plans were made


class TileCompositor(Kept):
    """All tiles of all islands. Used by one thread; tile work is spread over a few of its own.

    `load_image(name)` returns a frame's original, or None if it is gone for good; `load_tile` a tile written by an earlier run
    (for `resume`); `scratch` is a folder for tiles that exceed memory. `keep_bands`: whether tiles also hold all bands of the
    frames, which then must have the same ones.
    """

    FIXED = frozenset({"_pool", "_frame_cache", "_maker"})

    def __init__(
        self,
        load_image: LoadImage,
        settings: CompositorSettings | None = None,
        *,
        load_tile: LoadTile | None = None,
        scratch: Path | None = None,
        keep_bands: KeepBands = "none",
    ) -> None:
        self._settings = settings or CompositorSettings()
        self._pool = ThreadPoolExecutor(self._settings.threads, thread_name_prefix="paint")
        self._store = Store(self._settings.memory_mb << 20, scratch)
        self._stack = TileStack(self._store, self._pool, load_tile)
        self._frames = RenderList()
        mode = MODES[self._settings.blend]
        self._frame_cache = FrameCache(load_image, self._store, mode, keep_bands, self._pool)
        self._territory = Territory(self._store, mode, self._frame_cache, self._frames, self._pool)
        flag = INTERPOLATIONS[self._settings.interpolation]
        self._maker = TileMaker(self._frame_cache, self._frames, self._store, self._pool, flag, keep_bands)
        self._behind: dict[TileKey, float] = {}  # tiles with stale cells, with their urgency
        self._due: dict[TileKey, float] = {}  # tiles that may not display what their cells require
        self._recipes: dict[TileKey, Recipe] = {}  # recipes of displayed tiles
        self._unhosted: frozenset[TileKey] = frozenset()  # tiles whose insets may have changed
        self._left: dict[str, frozenset[TileKey]] = {}  # by frames that changed level or island: their former tiles
        self._work: _Fold | _Making | None = None
        self._changes = 0
        self._only: frozenset[TileKey] | None = None  # the tiles to be made; None: all
        self._known: dict[str, RenderEntry] = {}  # before `resume`: the frames of the earlier run
        self.gone: set[str] = set()  # frames whose originals are gone: their tiles stay as they are

    def saved(self) -> Snapshot:
        """Which originals are gone, and which tiles frames touch. All else follows from the painted frames: see `resume`."""
        return {"gone": self.gone, "_known": self._frames.entries()}

    def paint(self, image: Bands, painted: RenderItem, *, hastily: bool = False) -> set[TileKey]:
        """Add a frame; returns the tiles that may have changed (all levels).

        A frame that is not the last in capture order is still laid on top, and its tiles become stale. `hastily`: so do tiles
        that would need another frame's original that is not in memory. ValueError if the image does not fit the camera.
        """
        frame = self._frame_cache.warp(painted)
        picture = None if frame is None else self._frame_cache.take(painted, image)
        self._fall_behind(self._frames.remove(painted.name))
        keys = self._register(painted, frame)
        self._fall_behind(key for key in keys if not self._frames.is_last(painted, key))
        if frame is None or picture is None:
            return self._refresh(keys, {painted.island})
        ready = {key for key in keys if key not in self._behind}
        self._unhosted |= self._territory.hosts_below(ready)
        due = self._settle(self._territory.lay_over(frame, ready))
        plans = self._unlike([key for key in due if key not in self._behind])
        made = self._maker.made(plans, hastily=hastily)
        for key, layer in made.items():
            self._show(key, layer, plans[key].recipe)
        parts = {key: plan.parts.get(painted.name) for key, plan in plans.items() if key not in made}
        left = {key: part for key, part in parts.items() if part is not None}
        told = made.keys() | self._lay_on_top(frame, picture, {**left, **dict.fromkeys(keys & self._behind.keys())})
        return self._refresh(told, {painted.island} | {island for island, _ in told})

    def begin_look(
        self, name: str, image: Bands, display: Display, dead: DeadBorder, area: PictureArea | None = None
    ) -> None:
        """Begin to analyse, while it is being placed, an image that may follow by `paint`."""
        self._frame_cache.begin_look(name, image, (display, dead), area)

    def look(self, image: Bands, painted: RenderItem) -> None:
        """Analyse a frame that will follow by `move`, so that it need not be loaded for that. ValueError as in `paint`."""
        self._frame_cache.look_ahead(painted, image)

    def resume(self, frames: Iterable[RenderItem]) -> set[TileKey]:
        """Register frames that an earlier run painted. Their tiles are stale, and shown from `load_tile` until repainted; returns
        those and all above them."""
        new: list[RenderItem] = []
        for painted in frames:
            known = self._known.get(painted.name)
            if known is None or known.painted != painted:
                new.append(painted)
            else:
                self._await(self._frames.add(painted, known.tiles))
        for painted, frame in self._frame_cache.all_warps(new):
            self._await(self._register(painted, frame))
        self._known = {}
        return set(self._stack.earlier)

    def _await(self, keys: set[TileKey]) -> None:
        self._fall_behind(keys)
        self._stack.expect(keys)

    def move(self, frames: Iterable[RenderItem], urgency: float = 0.0) -> int:
        """Frames have new poses, gains, levels or islands, or are new; their old and new tiles become stale. Returns the number
        changed.

        `repaint` takes the most urgent tiles first.
        """
        changed = [p for p in frames if p.name not in self._frames or self._frames[p.name] != p]
        for painted, frame in self._frame_cache.all_warps(changed):
            old = self._frames.remove(painted.name)
            self._fall_behind(old | self._register(painted, frame), urgency)
            elsewhere = frozenset(key for key in old if (key[0], key[1].z) != (painted.island, painted.level))
            if elsewhere:
                self._left[painted.name] = self._left.get(painted.name, frozenset()) | elsewhere
        return len(changed)

    def expect(self, frames: Sequence[RenderItem]) -> None:
        """Begin to compute the lattices of a few frames that follow by `move`."""
        self._frame_cache.expect_warps(frames)

    def remove(self, names: Iterable[str]) -> None:
        """Remove frames; their tiles become stale."""
        for name in names:
            self._fall_behind(self._frames.remove(name))

    def look_again(self, names: Iterable[str]) -> None:
        """The originals of these frames are there again: tiles that were given up without them become stale."""
        for name in self.gone.intersection(names):
            self.gone.discard(name)
            self._fall_behind(self._frames.tiles_of(name))

    def confine(self, keys: Iterable[TileKey]) -> None:
        """Make only these tiles from now on, and of others what these depend on: for painting a map part by part, each with the
        frames around it."""
        self._only = frozenset(keys)
        near = around(around(self._only))
        above = {(i, ancestor(t, t.z - up)) for i, t in near for up in range(1, min(INSET_LEVELS, t.z) + 1)}
        self._give_up([key for key in self._behind if key not in near | above])

    def know(self, name: str, maps: BlendMaps) -> None:
        """Take the look of a frame, made elsewhere by `frame_cache.seen_by`: it need not be loaded where it does not show."""
        self._frame_cache.know(name, maps)

    def layer(self, island: int, tile: Tile) -> Layer | None:
        """What the frames painted at the tile's own level show on it."""
        return self._stack.own((island, tile))

    @property
    def behind(self) -> int:
        """Number of tiles waiting for `repaint`."""
        return len(self._behind.keys() | self._due.keys() | self._unhosted)

    @property
    def is_at_work(self) -> bool:
        """Whether `repaint_step` is in the midst of some tiles."""
        return self._work is not None

    def repaint(self, block: int = BLOCK) -> Iterator[set[TileKey]]:
        """Repaint all stale tiles, one frame's work at a time; yields tiles that may have changed.

        `block` by `block` tiles change together: a large block decodes each original less often, a small one is displayed
        sooner.

        It may be stopped between any two steps, interleaved with `paint` or `move`, and continued or restarted: a tile is only
        replaced when complete, and no more than the work since is lost. One such iterator at a time.
        """
        try:
            while self.behind:
                yield self.repaint_step(block)
        finally:
            self._drop_work()

    def repaint_step(self, block: int = BLOCK) -> set[TileKey]:
        """One step of `repaint`, while there are stale tiles: a frame's work, or the replacement of tiles."""
        if self._insets_wait:
            self._settle(self._territory.let_insets_in(self._unhosted))
            self._note_due(self._territory.with_insets(self._unhosted))
            self._unhosted = frozenset()
            return set()
        work = self._work = self._work or self._begun(block)
        if isinstance(work, _Fold):
            if not self._territory.has_laid(work.laid):  # the cells are of a step that was undone
                work = self._fold_of(work.tiles)
            # Queried at each step, because frames may arrive and move between steps.
            coming = self._frames.next_after(work.turn, work.tiles, EXPECTED)
            if not coming:
                self._end(work)
            self._work = self._with_frame(work, *coming) if coming else None
            return set()
        if work.left:
            self._work = self._with_pixels(work)
            return set()
        return self._commit(work)

    def skip_step(self, block: int = BLOCK) -> None:
        """Abandon what `repaint_step` would do next: its tiles stay as displayed."""
        if self._insets_wait:
            self._unhosted = frozenset()
        elif self._work is None:
            keys = self._next_block(block)
            self._give_up(keys)
        elif isinstance(self._work, _Fold):
            coming = self._frames.next_after(self._work.turn, self._work.tiles)
            keys = self._shared(coming[0], self._work) if coming else set(self._work.tiles)
            self._work = self._without(self._work, keys)
        else:
            self._work = self._unmade(self._work, self._work.left[0] if self._work.left else None)

    def tile(self, island: int, tile: Tile) -> TilePicture | None:
        """A tile as displayed; None if empty. Its arrays must not be modified."""
        return self.tile_later(island, tile)()

    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]:
        """A callable that returns the tile as displayed now, whenever and in whatever thread it is called."""
        return self._stack.shown((island, tile))

    def extent(self, island: int) -> Extent | None:
        """Canvas box around an island's tiles and its range of tile levels; None if it has none."""
        extent = self._frames.extent(island)
        return None if extent is None else extent._replace(coarsest=top_level(extent))

    @property
    def problem(self) -> str | None:
        """Message for the operator: the scratch file cannot grow, so memory does."""
        return self._store.problem

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release all memory, threads and the scratch file."""
        self._pool.shutdown()
        self._store.close()
        self._frame_cache.clear()

    def _register(self, painted: RenderItem, frame: FrameWarp | None) -> set[TileKey]:
        return self._frames.add(painted, () if frame is None else frame.lattice.tiles())

    def _settle(self, changed: Collection[TileKey]) -> set[TileKey]:
        """Update owners for tiles with changed cells and their neighbours; returns those that are due because of it."""
        self._changes += 1
        due = self._territory.settle(changed)
        for key in self._wanted(due):
            self._due.setdefault(key, 0.0)
        return due

    def _note_due(self, keys: Collection[TileKey]) -> None:
        """Mark displayed tiles whose frames have changed as due, and their neighbours, whose tones may change."""
        for key in self._wanted(around(keys)):
            if key in self._recipes:
                self._due.setdefault(key, 0.0)

    def _wanted(self, keys: Iterable[TileKey]) -> Iterator[TileKey]:
        return (key for key in keys if self._only is None or key in self._only)

    # Pixels

    def _unlike(self, keys: Collection[TileKey]) -> dict[TileKey, Plan]:
        """Plans of those tiles that are not displayed accordingly; the others are no longer due."""
        plans = self._territory.plans(keys)
        same = {key for key, plan in plans.items() if self._recipes.get(key) == plan.recipe}
        for key in same:
            self._due.pop(key, None)
        return {key: plan for key, plan in plans.items() if key not in same}

    def _lay_on_top(
        self, frame: FrameWarp, picture: FramePicture, parts: Mapping[TileKey, Part | None]
    ) -> set[TileKey]:
        """Lay a frame on stale tiles, in its planned share if known, else by weight."""
        made = self._maker.whole(frame, picture, parts)
        for key, layer in made.items():
            shown, part = self._stack.own(key), parts[key]
            if shown is not None and part is not None:
                layer = mix_pixels(shown, layer, part.at_pixels().copy())
            elif shown is not None:
                layer = mix(shown, layer, (layer.weight >= shown.weight).astype(np.float32))
            self._recipes.pop(key, None)
            self._stack.set_own(key, layer)
        return set(made)

    def _show(self, key: TileKey, layer: Layer | None, recipe: Recipe) -> None:
        self._stack.set_own(key, layer)
        self._note_shown(key, layer is not None, recipe)

    def _note_shown(self, key: TileKey, anything: bool, recipe: Recipe) -> None:
        self._due.pop(key, None)
        self._recipes.pop(key, None)
        if anything:
            self._recipes[key] = recipe

    def _refresh(self, keys: set[TileKey], islands: Iterable[int]) -> set[TileKey]:
        return self._stack.refresh(keys, {island: self._frames.extent(island) for island in islands})

    # Repainting

    def _fall_behind(self, keys: Iterable[TileKey], urgency: float = 0.0) -> None:
        self._changes += 1
        for key in keys:
            self._behind[key] = max(urgency, self._behind.get(key, 0.0))

    def _next_block(self, side: int) -> set[TileKey]:
        """Stale tiles close together, so that they share frames; the most urgent one is among them."""
        waiting = {**self._due, **self._behind}
        ready = waiting.keys() - self._kept() or waiting.keys()
        levels = sorted(grouped(ready), key=min)
        # Counted from the first waiting tile of each level: a map that fits into one block is not split.
        blocks = [block for some in levels for block in in_blocks(some, side)]
        return max(blocks, key=lambda block: max(waiting[key] for key in block))

    def _kept(self) -> set[TileKey]:
        """Tiles that keep displaying frames which have left them until those are displayed at their new place: no
        temporary hole."""
        waiting = self._behind.keys() | self._due.keys()
        arrived = [name for name in self._left if waiting.isdisjoint(self._frames.tiles_of(name))]
        for name in arrived:
            del self._left[name]
        return set[TileKey]().union(*self._left.values())

    @property
    def _insets_wait(self) -> bool:
        """Whether to admit insets: once for all, after the cells of all tiles are decided."""
        return bool(self._unhosted) and self._work is None and not self._behind

    def _begun(self, block: int) -> _Fold | _Making:
        keys = self._next_block(block)
        stale = keys & self._behind.keys()
        if stale:
            return self._fold_of(in_blocks(stale, FOLDED)[0])
        plans = self._unlike(keys)
        return _Making(plans, self._maker.order(plans), self._changes)

    def _fold_of(self, keys: Iterable[TileKey]) -> _Fold:
        """Begin to decide the cells of these tiles."""
        tiles = sorted(keys)
        self._territory.begin_anew(tiles)
        return _Fold(None, dict.fromkeys(tiles, ()))

    def _shared(self, painted: RenderItem, fold: _Fold) -> set[TileKey]:
        return {key for key in self._frames.tiles_of(painted.name) if key in fold.tiles}

    def _with_frame(self, fold: _Fold, painted: RenderItem, *coming: RenderItem) -> _Fold | None:
        keys = self._shared(painted, fold)
        frame = self._frame_cache.warp(painted)
        if frame is None or not self._frame_cache.can_see(painted):
            self.gone.add(painted.name)
            rest = self._without(fold, keys)
            return None if rest is None else replace(rest, turn=painted.turn)
        self._expect(coming, fold)
        self._territory.lay_anew(frame, keys)
        tiles = {**fold.tiles, **{key: (*fold.tiles[key], painted) for key in keys}}
        return _Fold(painted.turn, tiles, fold.laid + 1)

    def _expect(self, coming: Iterable[RenderItem], fold: _Fold) -> None:
        """Begin to process the next frames of a fold. Their errors will occur again, and be reported, at their own steps."""
        for painted in coming:
            try:
                frame = self._frame_cache.warp(painted)
                if frame is not None:
                    self._territory.expect(frame, self._shared(painted, fold))
            except Exception:
                logger.warning("%s cannot be looked at ahead", painted.name, exc_info=True)

    def _without(self, fold: _Fold, keys: Collection[TileKey]) -> _Fold | None:
        """Abandon tiles: they stay as displayed."""
        self._give_up(keys)
        rest = {key: frames for key, frames in fold.tiles.items() if key not in keys}
        if not rest:
            self._territory.drop_fresh()
        return replace(fold, tiles=rest) if rest else None

    def _give_up(self, keys: Iterable[TileKey]) -> None:
        for key in keys:
            self._behind.pop(key, None)
            self._due.pop(key, None)

    def _end(self, fold: _Fold) -> None:
        """The fold is complete: its tiles are due, and the neighbours that it changes."""
        ready = {key for key, frames in fold.tiles.items() if frames == tuple(self._frames.on(key))}
        changed = self._territory.replace(ready)
        urgency = {key: max(self._behind.pop(key), self._due.get(key, 0.0)) for key in ready}
        self._due |= {key: urgency[key] for key in self._wanted(ready)}
        self._note_due(ready)
        self._unhosted |= self._territory.hosts(ready - changed) | self._territory.hosts_below(ready)
        self._settle(changed)

    def _with_pixels(self, work: _Making) -> _Making | None:
        """Warp the next frame, and finish the tiles that need no other."""
        name = work.left[0]
        painted = self._frames.get(name)
        if any(painted not in plan.recipe[1] for plan in work.plans.values() if name in plan.parts):
            return self._unmade(work, name, due=True)  # it has moved in the meantime
        for following in work.left[1:2]:
            self._frame_cache.expect(following)
        if not self._maker.step(work.plans, name):
            self.gone.add(name)
            return self._unmade(work, name)
        return replace(work, left=work.left[1:])

    def _unmade(self, work: _Making, name: str | None, *, due: bool = False) -> _Making | None:
        """Abandon the tiles that a frame shows on (None: all), or postpone them if `due`."""
        keys = {key for key, plan in work.plans.items() if name is None or name in plan.parts}
        self._maker.drop({key: work.plans[key] for key in keys})
        if not due:
            self._give_up(keys)
        rest = {key: plan for key, plan in work.plans.items() if key not in keys}
        needed = {one for plan in rest.values() for one in plan.parts}
        return replace(work, plans=rest, left=tuple(one for one in work.left if one in needed)) if rest else None

    def _commit(self, work: _Making) -> set[TileKey]:
        """Display the finished tiles, except those whose recipe has changed: they stay due."""
        keys = [key for key in work.plans if key in self._due and key not in self._behind]
        now = work.plans if self._changes == work.changes else self._territory.plans(keys)
        shown = {key for key in keys if now[key].recipe == work.plans[key].recipe}
        for key in shown:
            self._note_shown(key, self._stack.take_own(key, self._maker.finished(key)), work.plans[key].recipe)
        self._maker.drop(work.plans)
        self._work = None
        return self._refresh(shown, {island for island, _ in shown})

    def _drop_work(self) -> None:
        if isinstance(self._work, _Fold):
            self._territory.drop_fresh()
        elif self._work is not None:
            self._maker.drop(self._work.plans)
        self._work = None
