"""Tiles are made once for all who ask, and anew once something near them is painted."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.tiles import tile_path, write_tile
from gcs_mosaic.views.tile_reader import EncodedTile, filled
from gcs_mosaic.web import answered_tiles, recent_answers
from gcs_mosaic.web.answered_tiles import AnsweredTiles
from gcs_mosaic.web.change import Change
from tests.sure import sure

TILE = Tile(16, 100, 200)


class Maker:
    def __init__(self) -> None:
        self.number = itertools.count()
        self.before: EncodedTile | None = None

    def __call__(self, before: EncodedTile | None = None) -> EncodedTile:
        self.before = before
        return EncodedTile(b"%d" % next(self.number), "image/jpeg")


def data(kept: AnsweredTiles, make: Maker, tile: Tile = TILE, revision: int = 0) -> bytes:
    answer = kept.get(0, tile, revision, make)
    assert answer is not None
    return answer.data


def test_a_tile_is_made_once_also_if_it_is_empty() -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()
    assert [data(kept, make) for _ in range(3)] == [b"0"] * 3
    asked: list[EncodedTile | None] = []
    for _ in range(2):
        assert kept.get(1, TILE, 0, asked.append) is None
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("painted", "is_made_anew"),
    [
        (TILE, True),
        (Tile(16, 101, 201), True),  # it may fade towards its neighbour
        (Tile(17, 200, 400), True),  # finer, within
        (Tile(18, 399, 800), True),  # finer, beside
        (Tile(15, 50, 100), True),  # coarser, which may fill its holes
        (Tile(16, 103, 200), False),
        (Tile(15, 55, 100), False),
        (Tile(18, 412, 800), False),
    ],
)
def test_it_is_made_anew_after_something_near_was_painted(painted: Tile, is_made_anew: bool) -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()
    data(kept, make)
    kept.forget(Change(1, frozenset([(1, painted)])))  # another island
    assert data(kept, make) == b"0"
    kept.forget(Change(2, frozenset([(0, painted)])))
    assert data(kept, make) == (b"1" if is_made_anew else b"0")


def test_after_a_change_of_which_nothing_is_known_all_are_made_anew() -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()
    data(kept, make)
    kept.forget(Change(1, None))
    assert data(kept, make) == b"1"


def test_who_makes_it_anew_is_given_what_was_kept() -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()
    first = data(kept, make)
    assert make.before is None
    for change in (Change(1, frozenset([(0, TILE)])), Change(2, None)):
        kept.forget(change)
        data(kept, make)
        assert sure(make.before).data == first
        first = data(kept, make)


def test_who_knows_of_a_later_revision_gets_no_older_tile() -> None:
    on_disk = iter([3, 4, 4])
    kept, make = AnsweredTiles(lambda: next(on_disk)), Maker()
    assert [data(kept, make, revision=revision) for revision in (2, 3, 4, 4)] == [b"0", b"0", b"1", b"1"]
    assert data(kept, make, revision=99) == b"2"  # a claim
    assert data(kept, make, revision=4) == b"2"


def test_what_was_made_while_something_was_painted_is_not_kept() -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()

    def interrupted(_before: EncodedTile | None) -> EncodedTile:
        kept.forget(Change(1, frozenset([(0, TILE)])))
        return make()

    kept.get(0, TILE, 0, interrupted)
    assert data(kept, make) == b"1"


def test_a_tile_is_made_anew_after_some_seconds_whatever_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()
    data(kept, make)
    monkeypatch.setattr(recent_answers, "KEPT_S", 0.0)
    assert data(kept, make) == b"1"


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answered_tiles, "MOST_BYTES", 10_000)
    kept, make = AnsweredTiles(lambda: 0), Maker()
    for x in range(100):
        data(kept, make, Tile(16, x, 0))
    assert data(kept, make, Tile(16, 99, 0)) == b"99"
    assert data(kept, make, Tile(16, 0, 0)) == b"100"


def test_a_mask_is_read_once_for_all_tiles_around_it_until_its_tile_is_painted(tmp_path: Path) -> None:
    kept, holed, beside = AnsweredTiles(lambda: 0), TILE, Tile(16, 101, 200)
    for tile in (holed.parent, *holed.parent.children):
        write_tile(tmp_path, 0, tile, picture(100 if tile == holed else 256), 95)
    first = filled(tmp_path, 0, beside, kept.masks(0))
    assert first == filled(tmp_path, 0, beside), "as without what is kept"
    assert first != EncodedTile(tile_path(tmp_path, 0, beside).read_bytes(), "image/jpeg"), (
        "it fades towards its neighbour"
    )
    write_tile(tmp_path, 0, holed, picture(256), 95)
    assert filled(tmp_path, 0, beside, kept.masks(0)) == first
    kept.forget(Change(1, frozenset([(0, Tile(17, 0, 0)), (0, holed.children[0])])))
    assert filled(tmp_path, 0, beside, kept.masks(0)) == filled(tmp_path, 0, beside) != first


def test_who_knows_of_a_later_revision_gets_no_tile_made_by_an_older_mask(tmp_path: Path) -> None:
    on_disk = iter(range(3, 100))
    kept = AnsweredTiles(lambda: next(on_disk))
    write_tile(tmp_path, 0, TILE, picture(256), 95)
    assert kept.masks(3)(tmp_path, 0, TILE) is full_coverage(256)
    write_tile(tmp_path, 0, TILE, picture(100), 95)
    assert kept.masks(3)(tmp_path, 0, TILE) is full_coverage(256)
    assert sure(kept.masks(4)(tmp_path, 0, TILE)).min() == 0


def test_once_a_folder_that_was_gone_is_back_its_masks_are_read(tmp_path: Path) -> None:
    kept, flight = AnsweredTiles(lambda: 0), tmp_path / "mosaic"
    with pytest.raises(FileNotFoundError):
        kept.masks(0)(flight, 0, TILE)
    flight.mkdir()
    write_tile(flight, 0, TILE, picture(256), 95)
    assert kept.masks(0)(flight, 0, TILE) is full_coverage(256)


def test_memory_of_masks_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answered_tiles, "MOST_MASK_BYTES", 100_000)
    kept, tiles = AnsweredTiles(lambda: 0), [Tile(16, x, 0) for x in range(3)]
    for tile in tiles:
        write_tile(tmp_path, 0, tile, picture(100), 95)
    for tile in tiles:
        kept.masks(0)(tmp_path, 0, tile)
    shutil.rmtree(tmp_path / "tiles")
    shutil.rmtree(tmp_path / "masks")
    assert [kept.masks(0)(tmp_path, 0, tile) is None for tile in tiles] == [True, True, False]


def picture(covered: int) -> TilePicture:
    coverage = np.zeros((256, 256), np.uint8)
    coverage[:, :covered] = 255
    return TilePicture(np.full((256, 256, 3), 100, np.uint8), coverage)
