from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.tiles import (
    LARGEST_BYTES,
    TileWriter,
    mask_path,
    pictures_in,
    read_mask,
    read_tile,
    remove_strays,
    tile_bytes,
    tile_path,
    tiles_in,
)
from tests.sure import sure

TILE = Tile(16, 32768, 32767)


def where(covered: NDArray[np.uint8], colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.copyTo(colour, covered), np.uint8)


def picture(seed: int = 1, covered: int = 256) -> TilePicture:
    """Smooth ground, covered from the left up to a column."""
    rough = np.random.default_rng(seed).integers(0, 255, (256, 256, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 6)
    colour = cv2.normalize(smooth, np.empty_like(smooth), 60, 200, cv2.NORM_MINMAX).astype(np.uint8)
    coverage = np.full((256, 256), 255, np.uint8)
    coverage[:, covered:] = 0
    return TilePicture(where(coverage, colour), coverage)


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[TileWriter]:
    writer = TileWriter(tmp_path)
    yield writer
    writer.close()


def names(root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())


def test_a_full_tile_has_no_mask(writer: TileWriter, tmp_path: Path) -> None:
    assert writer.write([(0, TILE)], lambda *_: lambda: picture()) == 1
    assert names(tmp_path) == ["tiles/0/16/32768/32767.jpg"]
    back = sure(read_tile(tmp_path, 0, TILE))
    assert np.abs(back.colour.astype(int) - picture().colour).mean() < 1.5
    assert (back.coverage == 255).all()


def test_a_partial_tile_has_its_coverage_beside_it(writer: TileWriter, tmp_path: Path) -> None:
    writer.write([(3, TILE)], lambda *_: lambda: picture(covered=100))
    assert names(tmp_path) == ["masks/3/16/32768/32767.png", "tiles/3/16/32768/32767.jpg"]
    back = sure(read_tile(tmp_path, 3, TILE))
    np.testing.assert_array_equal(back.coverage, picture(covered=100).coverage)
    assert (back.colour[:, 100:] == 0).all()


def test_black_does_not_bleed_into_what_is_covered(writer: TileWriter, tmp_path: Path) -> None:
    grey = TilePicture(np.full((256, 256, 3), 180, np.uint8), np.full((256, 256), 255, np.uint8))
    slanted = np.tri(256, dtype=np.uint8) * 255
    writer.write([(0, TILE)], lambda *_: lambda: TilePicture(where(slanted, grey.colour), slanted))
    back = sure(read_tile(tmp_path, 0, TILE))
    assert np.abs(back.colour[slanted > 0].astype(int) - 180).max() <= 2


def test_small_colours_stay_as_strong_as_they_were(writer: TileWriter, tmp_path: Path) -> None:
    field = np.full((256, 256, 3), (60, 110, 80), np.uint8)
    field[101:104, 50:53] = (40, 40, 220)
    writer.write([(0, TILE)], lambda *_: lambda: TilePicture(field, np.full((256, 256), 255, np.uint8)))
    assert sure(read_tile(tmp_path, 0, TILE)).colour[102, 51, 2] > 190


def test_a_tile_that_becomes_full_loses_its_mask(writer: TileWriter, tmp_path: Path) -> None:
    writer.write([(0, TILE)], lambda *_: lambda: picture(covered=100))
    writer.write([(0, TILE)], lambda *_: lambda: picture())
    assert not mask_path(tmp_path, 0, TILE).exists()


def test_a_tile_that_shows_nothing_any_more_is_removed(writer: TileWriter, tmp_path: Path) -> None:
    writer.write([(0, TILE)], lambda *_: lambda: picture(covered=100))
    assert writer.write([(0, TILE), (0, TILE.parent)], lambda *_: lambda: None) == 0
    assert names(tmp_path) == []


def test_many_tiles_are_all_there_when_write_comes_back(writer: TileWriter, tmp_path: Path) -> None:
    keys = [(0, Tile(16, x, y)) for x in range(12) for y in range(9)]
    assert writer.write(keys, lambda _, tile: lambda: picture(tile.x)) == len(keys)
    assert all(read_tile(tmp_path, *key) is not None for key in keys)
    assert len(names(tmp_path)) == len(keys)


def test_a_folder_that_takes_nothing_is_an_error_not_a_silence(writer: TileWriter, tmp_path: Path) -> None:
    (tmp_path / "tiles").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="tiles"):
        writer.write([(0, Tile(16, x, 0)) for x in range(80)], lambda *_: lambda: picture())


@pytest.mark.parametrize("content", [b"", b"not a picture", b"\xff\xd8\xff\xe0 torn"])
def test_what_is_not_a_tile_is_as_good_as_absent(tmp_path: Path, content: bytes) -> None:
    path = tile_path(tmp_path, 0, TILE)
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    assert read_tile(tmp_path, 0, TILE) is None
    path.write_bytes(bytes(cv2.imencode(".jpg", np.zeros((50, 50, 3), np.uint8))[1]))
    assert read_tile(tmp_path, 0, TILE) is None


def test_tiles_are_known_by_where_they_lie(tmp_path: Path) -> None:
    """Whatever else somebody has put there is left alone."""
    ours = ["tiles/0/16/5/7.jpg", "tiles/3/2/1/0.jpg"]
    others = [
        *("tiles/0/16/5/7.png", "tiles/0/16/5.jpg", "tiles/0/16/5/9/8.jpg", "tiles/0/16/5/x.jpg", "tiles/a/16/5/7.jpg"),
        *(
            "tiles/0/-1/5/7.jpg",
            "tiles/0/16/5/1234567890.jpg",
            "tiles/0/16/5/.7.jpg.part",
            "masks/0/16/5/7.png",
            "7.jpg",
        ),
    ]
    for name in (*ours, *others):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    assert {*tiles_in(tmp_path)} == {(0, Tile(16, 5, 7)), (3, Tile(2, 1, 0))}
    assert sorted(path.name for path in pictures_in(tmp_path, "tiles", ".jpg") if path.parts[-4] == "0") == [
        "1234567890.jpg",
        "7.jpg",
        "7.jpg",
        "x.jpg",
    ]
    assert [*pictures_in(tmp_path, "masks", ".png")] == [tmp_path / "masks/0/16/5/7.png"]
    remove_strays(tmp_path, [(3, Tile(2, 1, 0))])
    assert names(tmp_path) == sorted([*ours[1:], *(name for name in others if name != "masks/0/16/5/7.png")])


def test_the_coverage_of_a_tile_is_read_without_its_colours(writer: TileWriter, tmp_path: Path) -> None:
    assert read_mask(tmp_path, 0, TILE) is None
    writer.write([(0, TILE)], lambda island, tile: lambda: picture(covered=100))
    covered = sure(read_mask(tmp_path, 0, TILE))
    assert (covered[0, 99], covered[0, 100]) == (255, 0)
    writer.write([(0, TILE)], lambda island, tile: lambda: picture())
    assert sure(read_mask(tmp_path, 0, TILE)).min() == 255
    mask_path(tmp_path, 0, TILE).write_bytes(b"no picture")
    assert read_mask(tmp_path, 0, TILE) is None
    assert read_tile(tmp_path, 0, TILE) is None


def test_a_file_that_no_tile_is_as_large_as_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "0.jpg"
    assert tile_bytes(path, tmp_path) is None
    path.write_bytes(bytes(LARGEST_BYTES))
    assert len(sure(tile_bytes(path, tmp_path))) == LARGEST_BYTES
    path.write_bytes(bytes(LARGEST_BYTES + 1))
    assert tile_bytes(path, tmp_path) is None


def test_the_writer_tells_how_many_tiles_there_are(writer: TileWriter) -> None:
    keys = [(0, Tile(16, 32768 + n, 32767)) for n in range(3)]
    assert writer.write(keys, lambda island, tile: lambda: picture() if tile.x > 32768 else None) == 2
    assert writer.there == {*keys[1:]}
