"""Making tiles from their plans, frame by frame: at once, or in steps that can be interleaved with other work."""

from __future__ import annotations

import logging
from collections.abc import Hashable, Iterable, Mapping
from concurrent.futures import Executor

from gcs_mosaic.render.cells import window_around
from gcs_mosaic.render.frame_cache import FrameCache
from gcs_mosaic.render.frame_warp import FrameWarp, on_level
from gcs_mosaic.render.pixels import FramePicture, KeepBands, Part, Piece, alone, mixed, piece
from gcs_mosaic.render.plans import Plan
from gcs_mosaic.render.render_list import RenderItem, RenderList, TileKey
from gcs_mosaic.render.spread import spread
from gcs_mosaic.render.tile_cache import Layer, Store

logger = logging.getLogger(__name__)

Plans = Mapping[TileKey, Plan]


class TileMaker:
    """Intermediate results are kept in the store, under the tile's key. `interpolation` is an OpenCV flag."""

    def __init__(
        self,
        frame_cache: FrameCache,
        frames: RenderList,
        store: Store,
        pool: Executor,
        interpolation: int,
        keep: KeepBands,
    ) -> None:
        self._frame_cache = frame_cache
        self._frames = frames
        self._store = store
        self._pool = pool
        self._interpolation = interpolation
        self._keep: KeepBands = keep

    def order(self, plans: Plans) -> tuple[str, ...]:
        """The frames that plans need, in capture order."""
        names = {name for plan in plans.values() for name in plan.parts}
        return tuple(sorted(names, key=lambda name: self._frames[name].turn))

    def made(self, plans: Plans, *, hastily: bool = False) -> dict[TileKey, Layer | None]:
        """The tiles, except those that need a frame which is unavailable or, if `hastily`, not in memory."""
        pieces: dict[TileKey, dict[str, Piece | None]] = {key: {} for key in plans}
        # Those in memory first: loading another one may evict them.
        for name in sorted(self.order(plans), key=lambda name: not self._frame_cache.is_at_hand(name)):
            wanted = self._frame_cache.is_at_hand(name) or not hastily
            picture = self._picture_now(self._frames[name]) if wanted else None
            if picture is None:
                plans = {key: plan for key, plan in plans.items() if name not in plan.parts}
                continue
            for key, made in self._pieces(name, plans, picture).items():
                pieces[key][name] = made
        parts = [
            [(part, made) for name, part in plan.parts.items() if (made := pieces[key][name])]
            for key, plan in plans.items()
        ]
        return dict(zip(plans, spread(self._pool, mixed, parts), strict=True))

    def step(self, plans: Plans, name: str) -> bool:
        """Make a frame's pieces, and the tiles that need no other; False if its original is gone."""
        picture = self._frame_cache.picture(self._frames[name])
        if picture is None:
            return False
        pieces = self._pieces(name, plans, picture)
        for key, made in pieces.items():
            self._store.put((key, "piece", name), made)
        last = [key for key in pieces if name == list(plans[key].parts)[-1]]
        parts = [self._parts(key, plans[key]) for key in last]
        for key, layer in zip(last, spread(self._pool, mixed, parts), strict=True):
            self.drop({key: plans[key]})
            self._store.put(self.finished(key), layer)
        return True

    @staticmethod
    def finished(key: TileKey) -> Hashable:
        """Store key of a tile finished by steps; absent if the tile is empty."""
        return key, "fresh"

    def drop(self, plans: Plans) -> None:
        """Discard the results of steps."""
        for key, plan in plans.items():
            self._store.put(self.finished(key), None)
            for name in plan.parts:
                self._store.put((key, "piece", name), None)

    def whole(self, frame: FrameWarp, picture: FramePicture, keys: Iterable[TileKey]) -> dict[TileKey, Layer]:
        """A frame's full contribution to tiles, where not empty."""
        some = sorted(keys)

        def layer(key: TileKey) -> Layer | None:
            here = on_level(frame, window_around([key]))
            made = None if here is None else piece(here, picture, key[1], None, self._interpolation, self._keep)
            return None if made is None else alone(made)

        made = zip(some, spread(self._pool, layer, some), strict=True)
        return {key: one for key, one in made if one is not None}

    def _pieces(self, name: str, plans: Plans, picture: FramePicture) -> dict[TileKey, Piece | None]:
        """A frame's pieces of the tiles that it shows on."""
        frame = self._frame_cache.warp(self._frames[name])
        assert frame is not None, "it is on these tiles"
        keys = [key for key, plan in plans.items() if name in plan.parts]

        def made(key: TileKey) -> Piece | None:
            here = on_level(frame, window_around([key]))
            part = plans[key].parts[name]
            return None if here is None else piece(here, picture, key[1], part, self._interpolation, self._keep)

        return dict(zip(keys, spread(self._pool, made, keys), strict=True))

    def _parts(self, key: TileKey, plan: Plan) -> list[tuple[Part, Piece]]:
        made = [(part, self._store.get((key, "piece", name))) for name, part in plan.parts.items()]
        return [(part, one) for part, one in made if one is not None]

    def _picture_now(self, painted: RenderItem) -> FramePicture | None:
        """A frame's image; None also on errors that later steps will meet again: they are not the new frame's fault."""
        try:
            return self._frame_cache.picture(painted)
        except Exception:
            logger.warning("the original of %s cannot be had", painted.name, exc_info=True)
            return None
