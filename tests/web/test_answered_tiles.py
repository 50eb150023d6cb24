"""Tiles are made once for all who ask, and anew once something near them is painted."""

from __future__ import annotations

import itertools

import pytest

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.views.tile_reader import EncodedTile
from gcs_mosaic.web import answered_tiles, recent_answers
from gcs_mosaic.web.answered_tiles import AnsweredTiles
from gcs_mosaic.web.change import Change

TILE = Tile(16, 100, 200)


class Maker:
    def __init__(self) -> None:
        self.number = itertools.count()

    def __call__(self) -> EncodedTile:
        return EncodedTile(b"%d" % next(self.number), "image/jpeg")


def data(kept: AnsweredTiles, make: Maker, tile: Tile = TILE, revision: int = 0) -> bytes:
    answer = kept.get(0, tile, revision, make)
    assert answer is not None
    return answer.data


def test_a_tile_is_made_once_also_if_it_is_empty() -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()
    assert [data(kept, make) for _ in range(3)] == [b"0"] * 3
    asked: list[None] = []
    for _ in range(2):
        assert kept.get(1, TILE, 0, lambda: asked.append(None)) is None
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


def test_who_knows_of_a_later_revision_gets_no_older_tile() -> None:
    on_disk = iter([3, 4, 4])
    kept, make = AnsweredTiles(lambda: next(on_disk)), Maker()
    assert [data(kept, make, revision=revision) for revision in (2, 3, 4, 4)] == [b"0", b"0", b"1", b"1"]
    assert data(kept, make, revision=99) == b"2"  # a claim
    assert data(kept, make, revision=4) == b"2"


def test_what_was_made_while_something_was_painted_is_not_kept() -> None:
    kept, make = AnsweredTiles(lambda: 0), Maker()

    def interrupted() -> EncodedTile:
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
