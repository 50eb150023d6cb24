from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_grid import Tile, ancestor, tile_box
from gcs_mosaic.store.tiles import mask_path, tile_path, write_tile
from gcs_mosaic.views.hole_filling import WrittenTiles, filled_picture
from gcs_mosaic.views.tile_reader import EncodedTile, filled, level_within, picture
from tests.sure import sure

TILE = Tile(16, 32768, 32768)


def plain(value: int, covered: int = 256) -> TilePicture:
    coverage = np.zeros((256, 256), np.uint8)
    coverage[:, :covered] = 255
    return TilePicture((coverage[..., None] // 255 * value).repeat(3, axis=2).astype(np.uint8), coverage)


def put(root: Path, tile: Tile, shown: TilePicture) -> None:
    write_tile(root, 0, tile, shown, 95)


def decoded(tile: EncodedTile) -> np.ndarray:
    return sure(cv2.imdecode(np.frombuffer(tile.data, np.uint8), cv2.IMREAD_UNCHANGED))


def test_a_full_tile_is_passed_on_as_it_is(tmp_path: Path) -> None:
    put(tmp_path, TILE, plain(90))
    assert filled(tmp_path, 0, TILE) == EncodedTile(tile_path(tmp_path, 0, TILE).read_bytes(), "image/jpeg")


def test_where_nothing_was_seen_there_is_no_tile(tmp_path: Path) -> None:
    assert filled(tmp_path, 0, TILE) is None
    put(tmp_path, TILE.parent, plain(90, covered=100))
    assert filled(tmp_path, 0, TILE.parent.children[1]) is None
    assert filled(tmp_path, 1, TILE.parent) is None


def test_holes_are_filled_from_the_nearest_tile_above(tmp_path: Path) -> None:
    put(tmp_path, TILE, plain(200, covered=100))
    put(tmp_path, ancestor(TILE, 14), plain(120, covered=40))
    put(tmp_path, ancestor(TILE, 13), plain(60))
    tile = sure(filled(tmp_path, 0, TILE))
    row = decoded(tile)[100, :, 0].astype(int)
    assert tile.media_type == "image/jpeg"
    assert row[[50, 240]] == pytest.approx([200, 60], abs=3)
    assert 75 < row[120] < 110
    assert np.diff(row).max() <= 3


def test_the_finer_picture_fades_into_the_coarser_one_across_tiles(tmp_path: Path) -> None:
    left, right = TILE.parent.children[:2]
    put(tmp_path, left, plain(200))
    put(tmp_path, right, plain(200, covered=10))
    put(tmp_path, TILE.parent, plain(100))
    row = np.hstack([decoded(sure(filled(tmp_path, 0, tile)))[100, :, 0] for tile in (left, right)]).astype(int)
    assert (row[200], row[300]) == pytest.approx((200, 100), abs=2)
    assert np.diff(row).min() > -8
    assert np.diff(row).max() <= 2


def test_at_the_outer_border_nothing_fades(tmp_path: Path) -> None:
    left, right = TILE.parent.children[:2]
    for tile, covered in zip(TILE.parent.children, (256, 11, 256, 11), strict=True):
        put(tmp_path, tile, plain(200, covered))
    put(tmp_path, TILE.parent, plain(100, covered=133))
    assert sure(filled(tmp_path, 0, left)).data == tile_path(tmp_path, 0, left).read_bytes()
    assert sure(filled_picture(WrittenTiles(tmp_path, 0), right)).colour[100, :11, 0] == pytest.approx(
        [200] * 11, abs=2
    )


def test_holes_that_remain_are_transparent(tmp_path: Path) -> None:
    put(tmp_path, TILE, plain(200, covered=100))
    tile = sure(filled(tmp_path, 0, TILE))
    assert tile.media_type == "image/webp"
    assert decoded(tile)[100, [50, 99, 100, 200], 3].tolist() == [255, 255, 0, 0]
    assert decoded(tile)[100, 50, :3] == pytest.approx([200] * 3, abs=3)


def test_an_enlarged_tile_lies_where_the_coarse_one_does(tmp_path: Path) -> None:
    ramp = np.tile(np.arange(256, dtype=np.uint8)[:, None, None], (1, 256, 3))
    put(tmp_path, TILE.parent, TilePicture(ramp, np.full((256, 256), 255, np.uint8)))
    for child in TILE.parent.children:
        rows = sure(filled_picture(WrittenTiles(tmp_path, 0), child)).colour[:, 128, 0].astype(float)
        exact = (np.arange(256) + 0.5) / 2 - 0.5 + 128 * (child.y % 2)
        assert np.abs(rows - exact).max() < 2.1
        assert abs((rows - exact).mean()) < 0.12


def test_no_dark_fringe_where_the_coarse_tile_ends(tmp_path: Path) -> None:
    put(tmp_path, TILE.parent, plain(180, covered=60))
    shown = sure(filled_picture(WrittenTiles(tmp_path, 0), TILE.parent.children[0]))
    assert 100 < (shown.coverage > 0).mean(axis=1)[0] * 256 < 130
    assert np.abs(shown.colour[shown.coverage > 0].astype(int) - 180).max() <= 3


def test_a_tile_is_made_anew_only_if_something_that_it_is_made_of_has_changed(tmp_path: Path) -> None:
    left, right = TILE.parent.children[:2]
    put(tmp_path, left, plain(200, covered=100))
    put(tmp_path, TILE.parent, plain(100, covered=200))
    before = filled(tmp_path, 0, left)
    put(tmp_path, left.children[0], plain(50))
    put(tmp_path, left, plain(200, covered=100))
    assert filled(tmp_path, 0, left, before=before) is before, "written as it was"
    for changed, shown in (
        (left, plain(210, 100)),
        (left, plain(210, 90)),
        (right, plain(7, 60)),
        (TILE.parent, plain(90)),
    ):
        put(tmp_path, changed, shown)
        after = filled(tmp_path, 0, left, before=before)
        assert after is not before
        assert after == filled(tmp_path, 0, left)
        before = after
    for gone in (tile_path(tmp_path, 0, left), tile_path(tmp_path, 0, TILE.parent)):
        gone.unlink()
        before, was = filled(tmp_path, 0, left, before=before), before
        assert before != was
    assert before is None


@pytest.mark.parametrize("path", [tile_path, mask_path])
def test_a_file_that_is_torn_or_gone_counts_as_unseen(tmp_path: Path, path: Callable[[Path, int, Tile], Path]) -> None:
    put(tmp_path, TILE, plain(200, covered=100))
    put(tmp_path, TILE.parent, plain(60))
    path(tmp_path, 0, TILE).write_bytes(b"torn")
    assert decoded(sure(filled(tmp_path, 0, TILE)))[100, 50] == pytest.approx([60] * 3, abs=2)


def test_a_picture_holds_exactly_the_box_that_was_asked_for(tmp_path: Path) -> None:
    for i, child in enumerate(TILE.children):
        put(tmp_path, child, plain(40 + 50 * i))
    left, top, right, bottom = tile_box(TILE)
    whole = picture(tmp_path, 0, (left, top, right, bottom), 17)
    assert whole.shape == (512, 512, 4)
    assert whole[[100, 100, 400, 400], [100, 400, 100, 400], 0].tolist() == pytest.approx([40, 90, 140, 190], abs=2)
    part = picture(tmp_path, 0, (left + 100, top + 50, right - 20, bottom + 200), 17)
    np.testing.assert_array_equal(part[:412], whole[100:, 200:472])
    assert (part[412:] == 0).all()


def test_the_level_of_a_picture_keeps_to_the_limit() -> None:
    assert level_within((0, 0, 1000, 1000), 1_000_000, 16) == 16
    assert level_within((0, 0, 1000, 1000), 999_999, 16) == 15
    assert level_within((0, 0, 1e6, 1e6), 1_000_000, 18) == 6


def test_nothing_is_invented_beyond_the_outer_border(tmp_path: Path) -> None:
    """Coarser tiles made of a tile reach a little farther than it; what lies there was never seen."""
    covered = 101
    put(tmp_path, TILE, plain(200, covered))
    for level in range(TILE.z - 1, TILE.z - 5, -1):
        up = 2 ** (TILE.z - level)
        whole, part = divmod(covered, up)
        shown = plain(200, whole + 1)
        shown.coverage[:, whole] = 255 * part // up
        put(tmp_path, ancestor(TILE, level), shown)
    coverage = sure(filled_picture(WrittenTiles(tmp_path, 0), TILE)).coverage
    assert (coverage[:, :covered] == 255).all()
    assert not coverage[:, covered:].any()
