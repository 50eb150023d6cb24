"""Plan of each tile: which frames show on it, where, and with which tone."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.render.cells import NOBODY, Owned, Window
from gcs_mosaic.render.pixels import Part
from gcs_mosaic.render.render_list import RenderItem, TileKey
from gcs_mosaic.render.tone import SQUARES
from gcs_mosaic.stitch.arrays import FrameNumbers, ToneShifts

Recipe = tuple[bytes, tuple[RenderItem, ...]]  # everything a tile's pixels depend on, except the originals


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Plan of one tile: the parts by frame name, in capture order."""

    recipe: Recipe
    parts: Mapping[str, Part]


def planned(
    keys: Iterable[TileKey],
    owned: Owned,
    window: Window,
    shifts: Mapping[int, tuple[Window, ToneShifts]],
    frames_on: Callable[[TileKey], Mapping[int, RenderItem]],
    sharp: bool,
) -> dict[TileKey, Plan]:
    """Plans of tiles within the window less one tile on each side. `frames_on`: frames of a tile, by number, in capture order."""
    return {key: _plan(key, _patch(owned, window, key), window, shifts, frames_on(key), sharp) for key in keys}


def _patch(owned: Owned, window: Window, key: TileKey) -> Owned:
    rows, columns = window.place(key, rim=1)
    return Owned(owned.first[rows, columns], owned.second[rows, columns], owned.share[rows, columns])


def _plan(
    key: TileKey,
    owned: Owned,
    window: Window,
    shifts: Mapping[int, tuple[Window, ToneShifts]],
    frames: Mapping[int, RenderItem],
    sharp: bool,
) -> Plan:
    parts: dict[str, Part] = {}
    digest = hashlib.blake2b(digest_size=16)
    # A neighbouring tile's frame extends a little onto this one, but without any owner there is no tile.
    anybody = bool((owned.first[1:-1, 1:-1] != NOBODY).any())
    there = _values(owned.first) | _values(owned.second) if anybody else set()
    for number, painted in frames.items():
        if number not in there:
            continue
        first, second = owned.first == number, owned.second == number
        share = first * owned.share + second * ~owned.share
        shift = _shift_on(key, shifts.get(number))
        part = parts[painted.name] = Part(share, first | second, shift, sharp)
        for one in (part.share, part.needed, part.shift):
            digest.update(b"-" if one is None else one.tobytes())
    return Plan((digest.digest(), tuple(frames[n] for n in frames if frames[n].name in parts)), parts)


def _values(numbers: FrameNumbers) -> set[int]:
    least = int(numbers.min())
    return {least} if least == int(numbers.max()) else set(np.unique(numbers).tolist())


def _shift_on(key: TileKey, shift: tuple[Window, ToneShifts] | None) -> ToneShifts | None:
    """The part of a frame's shift on a tile and the squares around; None if zero."""
    if shift is None:
        return None
    window, values = shift
    y, x, side = (key[1].y - window.top) * SQUARES - 1, (key[1].x - window.left) * SQUARES - 1, SQUARES + 2
    inner = values[:, max(0, y) : max(0, y + side), max(0, x) : max(0, x + side)]
    if not inner.any():
        return None
    patch = np.zeros((3, side, side), np.int8)
    top, left = max(0, -y), max(0, -x)
    patch[:, top : top + inner.shape[1], left : left + inner.shape[2]] = inner
    return patch
